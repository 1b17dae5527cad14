//! What synthesis `rigid` reads besides images: instances, their poses within an interval, and the lens.

use super::geometry::Place;
use super::sensor::is_rigid;
use super::{CameraConfig, CameraState, GeometryConfig, Rig};
use crate::error::EngineError;
use esaac_layout::{Geometry, MOST_INSTANCES, NO_INSTANCE};
use esaac_model::paths::conventions::Trust;
use esaac_model::paths::{PoseTrack, STATIC_WORLD, SceneMotion};
use std::collections::HashSet;

/// Cameras of a rig whose poses are watched. Many are environments, which are alike.
const WATCHED_CAMERAS: usize = 16;

/// The rows of a camera's instances in its tables. The surfaces of the last frame name instances by row, so a row keeps
/// its instance until no surface names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Instances {
    /// Row 0 is the static world.
    rows: Vec<Row>,
    /// Ids with poses, ascending, each with its row: `instances`.
    known: Vec<[u32; 2]>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Row {
    /// An instance with poses.
    Posed(u32),
    /// An instance whose poses were taken away when the camera had taken so many frames. Surfaces of the last of them
    /// may name it.
    Left { id: u32, frames: u64 },
}

impl Instances {
    /// The static world alone.
    pub(super) fn new() -> Self {
        Instances::of(vec![Row::Posed(STATIC_WORLD)])
    }

    fn of(rows: Vec<Row>) -> Self {
        let mut known: Vec<[u32; 2]> = rows
            .iter()
            .enumerate()
            .filter_map(|(row, &kind)| match kind {
                Row::Posed(id) => Some([id, row as u32]),
                Row::Left { .. } => None,
            })
            .collect();
        if known.is_empty() {
            // Kernels look for every id among one at least.
            known.push([STATIC_WORLD, NO_INSTANCE]);
        }
        known.sort_unstable();
        Instances { rows, known }
    }

    /// Whether the instances with poses are those of `scene`.
    fn are_those_of(&self, scene: &SceneMotion) -> bool {
        self.known.iter().map(|&[id, _]| id).eq(std::iter::once(STATIC_WORLD).chain(scene.ids()))
    }

    /// Rows for the instances of `scene` whose poses are trusted, after `frames` frames. No other instance has poses.
    pub(super) fn with(&self, scene: &SceneMotion, trust: &Trust, frames: u64) -> Self {
        let mut rows = self.rows.clone();
        for row in &mut rows {
            let (Row::Posed(id) | Row::Left { id, .. }) = *row;
            let posed = trust.follows(id) && (id == STATIC_WORLD || scene.instance(id).is_some());
            *row = match (posed, *row) {
                (true, _) => Row::Posed(id),
                (false, Row::Posed(_)) => Row::Left { id, frames },
                (false, left) => left,
            };
        }
        let named: HashSet<u32> = self.ids().into_iter().collect();
        // Rows before it are taken: none becomes free meanwhile, and each is looked at once.
        let mut next = 0;
        for id in scene.ids().filter(|&id| trust.follows(id) && !named.contains(&id)) {
            let is_taken = |row: &&Row| !matches!(row, Row::Left { frames: then, .. } if *then < frames);
            next += rows[next..].iter().take_while(is_taken).count();
            match rows.get_mut(next) {
                Some(row) => *row = Row::Posed(id),
                None => rows.push(Row::Posed(id)),
            }
        }
        Instances::of(rows)
    }

    /// Rows of a saved camera: the ids of its rows.
    pub(super) fn restored(ids: &[u32]) -> Self {
        Instances::of(ids.iter().map(|&id| Row::Posed(id)).collect())
    }

    /// The instance of each row.
    pub(super) fn ids(&self) -> Vec<u32> {
        self.rows.iter().map(|&(Row::Posed(id) | Row::Left { id, .. })| id).collect()
    }

    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Ids with poses, ascending, each with its row: `instances`.
    pub(super) fn known(&self) -> &[[u32; 2]] {
        &self.known
    }

    /// The track of each row: `None` if it has no poses; `None` in that for what stands.
    pub(super) fn tracks<'a>(
        &'a self,
        scene: &'a SceneMotion,
    ) -> impl Iterator<Item = Option<Option<&'a PoseTrack>>> + 'a {
        self.rows.iter().map(|row| match *row {
            Row::Posed(id) => Some(scene.instance(id).filter(|track| !track.stands())),
            Row::Left { .. } => None,
        })
    }
}

impl Rig {
    /// Sets the poses of a camera and of the instances that it sees, from its next step on. Synthesis `rigid` needs
    /// them: at a step they must span the time from the frame before to the frame. They stay until they are set again,
    /// and are not part of a saved state, as images are not. An instance that had no poses when a frame came has no
    /// path from that frame. Errors: the camera has no geometry or another lens; too many instances; no memory. On an
    /// error the camera keeps the poses that it had.
    pub fn set_scene(&mut self, camera: usize, scene: SceneMotion) -> Result<(), EngineError> {
        let past = self.set_scenes(vec![(camera, scene)])?;
        // Who sets scenes again and again between two steps does not pile them up.
        if self.past_scenes.len() >= self.cameras.len() {
            self.past_scenes.clear();
        }
        self.past_scenes.extend(past);
        Ok(())
    }

    /// As [`Rig::set_scene`], for several cameras at once: buffers that are too small grow once for all of them. On an
    /// error all keep the poses that they had. Returns the scenes that were replaced, whose memory may serve again
    /// ([`TrackMemory`](esaac_model::paths::TrackMemory)).
    pub fn set_scenes(&mut self, scenes: Vec<(usize, SceneMotion)>) -> Result<Vec<SceneMotion>, EngineError> {
        self.check_ready()?;
        let mut places = None;
        let mut instances = Vec::new();
        for (camera, scene) in &scenes {
            let Some((new, rows)) = self.new_instances(*camera, scene)? else { continue };
            if rows > self.cameras[*camera].place.instances {
                let places = places.get_or_insert_with(|| self.places());
                places[*camera] = places[*camera].with_instances(rows);
            }
            instances.push((*camera, new));
        }
        if let Some(places) = places {
            self.change(places, Vec::new(), &[])?;
        }
        for (camera, new) in instances {
            self.cameras[camera].has_paths = false;
            self.cameras[camera].instances = new;
        }
        let mut past = Vec::with_capacity(scenes.len());
        for (camera, scene) in scenes {
            if camera < WATCHED_CAMERAS {
                let CameraState { spacing, config: CameraConfig { sensor, .. }, .. } =
                    &mut self.cameras[camera];
                spacing.add(scene.lens(), (sensor.width, sensor.height), scene.camera());
            }
            past.extend(self.cameras[camera].scene.replace(scene));
        }
        Ok(past)
    }

    /// The instances of a camera with a scene that it may have, and how many rows they need; `None` if they are those that
    /// it has.
    fn new_instances(
        &self,
        camera: usize,
        scene: &SceneMotion,
    ) -> Result<Option<(Instances, u32)>, EngineError> {
        let state = self.camera(camera)?;
        let Some(GeometryConfig { lens, .. }) = state.config.geometry else {
            return Err(EngineError::NoGeometry { camera });
        };
        if *scene.lens() != lens {
            return Err(EngineError::Lens {
                camera,
                expected: Box::new(lens),
                actual: Box::new(*scene.lens()),
            });
        }
        if *state.trust() == Trust::All && state.instances.are_those_of(scene) {
            return Ok(None);
        }
        let instances = state.instances.with(scene, state.trust(), state.frames);
        // There is room for those too whose poses are not followed: they may be again.
        let rows = state.instances.with(scene, &Trust::All, state.frames).len();
        if rows > MOST_INSTANCES {
            return Err(EngineError::TooManyInstances { camera, expected: MOST_INSTANCES, actual: rows });
        }
        Ok(Some((instances, rows as u32)))
    }
}

impl CameraState {
    /// Checks that the camera has what a step to `t_ns` needs besides images.
    pub(super) fn check_scene(&self, camera: usize, t_ns: i64) -> Result<(), EngineError> {
        if !is_rigid(&self.config.sensor) {
            return Ok(());
        }
        let scene = self.scene.as_ref().ok_or(EngineError::NoScene { camera })?;
        scene
            .check_span(self.last_ns.unwrap_or(t_ns), t_ns)
            .map_err(|source| EngineError::Poses { camera, source: Box::new(source) })
    }

    /// The camera's row of `geometries`.
    pub(super) fn geometry_row(&self) -> Geometry {
        let Some(geometry) = self.config.geometry.filter(|_| is_rigid(&self.config.sensor)) else {
            return Geometry::default();
        };
        let (focal_px, centre_px) = (geometry.lens.focal_px(), geometry.lens.centre_px());
        let place: &Place = &self.place;
        Geometry {
            depth_address: self.inputs.depth,
            id_address: self.inputs.ids,
            focal_x_px: focal_px.x as f32,
            focal_y_px: focal_px.y as f32,
            inverse_focal_x: (1.0 / focal_px.x) as f32,
            inverse_focal_y: (1.0 / focal_px.y) as f32,
            centre_x_px: centre_px.x as f32,
            centre_y_px: centre_px.y as f32,
            surface_base: place.surface_base,
            representative_base: place.representative_base,
            passing_base: place.passing_base,
            instance_base: place.instance_base,
            known_ids: self.instances.known().len() as u32,
            instances: self.instances.len() as u32,
            pose_base: place.pose_base,
            path_base: place.path_base,
            path_instants: place.path_instants,
            track_base: place.track_base,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::paths::{Intrinsics, Pose};

    #[test]
    fn what_is_doubted_has_a_row_and_no_poses() {
        let still = || PoseTrack::still(Pose::IDENTITY);
        let lens = Intrinsics::pinhole(20.0, 20.0, 7.5, 7.5).unwrap();
        let mut scene = SceneMotion::new(lens, still());
        scene.insert(4, still()).unwrap();
        let posed = |rows: &Instances| rows.tracks(&scene).map(|row| row.is_some()).collect::<Vec<_>>();
        let all = Instances::new().with(&scene, &Trust::All, 0);
        assert_eq!((all.known(), all.ids()), (&[[0, 0], [4, 1]][..], vec![0, 4]));
        assert_eq!(posed(&all), [true, true]);
        let some = all.with(&scene, &Trust::Without([4].into()), 1);
        assert_eq!((some.known(), some.ids()), (&[[0, 0]][..], vec![0, 4]));
        assert_eq!(posed(&some), [true, false]);
        let none = all.with(&scene, &Trust::Nothing, 1);
        assert_eq!((none.known(), none.ids()), (&[[0, NO_INSTANCE]][..], vec![0, 4]));
        assert_eq!(posed(&none), [false, false]);
        assert_eq!(none.with(&scene, &Trust::All, 2), all);
    }

    #[test]
    fn rows_of_those_that_left_are_taken_in_order_once_no_surface_names_them() {
        let still = || PoseTrack::still(Pose::IDENTITY);
        let lens = Intrinsics::pinhole(20.0, 20.0, 7.5, 7.5).unwrap();
        let of = |ids: &[u32]| {
            let mut scene = SceneMotion::new(lens, still());
            ids.iter().for_each(|&id| scene.insert(id, still()).unwrap());
            scene
        };
        let first = Instances::new().with(&of(&[3, 5, 7]), &Trust::All, 0);
        let left = first.with(&of(&[5]), &Trust::All, 1);
        let at_once = left.with(&of(&[5, 8]), &Trust::All, 1);
        assert_eq!(at_once.ids(), [0, 3, 5, 7, 8], "the last frame may show 3 and 7");
        let later = left.with(&of(&[1, 5, 8, 9, 10]), &Trust::All, 2);
        assert_eq!(later.ids(), [0, 1, 5, 8, 9, 10]);
    }
}
