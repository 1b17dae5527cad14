//! What synthesis `rigid` reads besides images: instances, their poses within an interval, and the lens.

use super::geometry::Place;
use super::parameters::is_rigid;
use super::{CameraState, GeometryConfig, Rig};
use crate::error::EngineError;
use esaac_layout::{Geometry, POSE_ROWS};
use esaac_model::paths::conventions::Trust;
use esaac_model::paths::{Pose, PoseTrack, STATIC_WORLD, SceneMotion};
use esaac_model::synthesis::rigid::{KNOTS, POSE_INSTANTS};
use glam::DMat3;
use std::collections::HashSet;
use std::num::NonZero;

/// Most instances of a camera: `surfaces` has 16 bits for them, and one value means none.
pub(super) const MOST_INSTANCES: usize = 0xffff;

/// The row of an id that has none, in `instances`.
const NO_ROW: u32 = 0xffff;

/// How near to rest a motion counts as none: rounding of poses in f64, radians and metres.
const REST: f64 = 1e-9;

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
            known.push([STATIC_WORLD, NO_ROW]);
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
        for id in scene.ids().filter(|&id| trust.follows(id) && !named.contains(&id)) {
            let free = |row: &Row| matches!(row, Row::Left { frames: then, .. } if *then < frames);
            match rows.iter().position(free) {
                Some(row) => rows[row] = Row::Posed(id),
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

    /// `poses` of the interval from `from_ns` to `to_ns`, which the scene's poses span.
    pub(super) fn poses(&self, scene: &SceneMotion, [from_ns, to_ns]: [i64; 2]) -> Vec<[f32; 4]> {
        let times_ns: Vec<i64> = (0..POSE_INSTANTS)
            .map(|i| {
                let fraction = i as f64 / (POSE_INSTANTS - 1) as f64;
                from_ns + (fraction * (to_ns - from_ns) as f64).round() as i64
            })
            .collect();
        let at = |track: &PoseTrack| track.at_all(&times_ns).expect("poses that span the interval");
        let camera = at(scene.camera());
        let focal_px = 0.5 * scene.lens().focal_px().element_sum();
        let mut rows = Vec::with_capacity(self.rows.len() * POSE_ROWS as usize);
        for row in &self.rows {
            match *row {
                Row::Left { .. } => rows.resize(rows.len() + POSE_ROWS as usize, [0.0; 4]),
                Row::Posed(id) => {
                    push_poses(&mut rows, &camera, scene.instance(id).map(at).as_deref(), focal_px)
                }
            }
        }
        rows
    }
}

/// Appends the rows of an instance: `camera` and `body` are its poses and the camera's at all instants.
fn push_poses(rows: &mut Vec<[f32; 4]>, camera: &[Pose], body: Option<&[Pose]>, focal_px: f64) {
    let last = camera.len() - 1;
    let stands = |poses: &[Pose]| poses.iter().all(|pose| *pose == poses[0]);
    if stands(camera) && body.is_none_or(stands) {
        for _ in 0..=camera.len() {
            rows.extend([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]);
        }
        rows.push([1.0, 0.0, 0.0, 0.0]);
        return;
    }
    // From camera axes at instant `i` to those at the first instant, or the last.
    let [to_first, to_last] = [0, last].map(|key| {
        let from_world = camera[key].inverse();
        let from_body = body.map_or(from_world, |body| from_world * body[key]);
        move |i: usize| match body {
            Some(body) => from_body * body[i].inverse() * camera[i],
            None => from_body * camera[i],
        }
    });
    let mut moves = false;
    let mut push = |pose: &Pose| {
        let turn = DMat3::from_quat(pose.rotation());
        let shift_m = pose.translation_m();
        let rests = shift_m.abs().max_element() < REST && pose.rotation().xyz().abs().max_element() < REST;
        moves |= !rests;
        for axis in 0..3 {
            let row = if rests { (DMat3::IDENTITY.row(axis), 0.0) } else { (turn.row(axis), shift_m[axis]) };
            rows.push([row.0.x as f32, row.0.y as f32, row.0.z as f32, row.1 as f32]);
        }
    };
    let mut largest_m: f64 = 0.0;
    for i in 0..=last {
        let pose = to_first(i);
        push(&pose);
        if i % (last / (KNOTS - 1)) == 0 {
            let shift_m = to_last(i).translation_m().length();
            largest_m = largest_m.max(pose.translation_m().length()).max(shift_m);
        }
    }
    push(&to_last(0));
    rows.push([(focal_px * largest_m).max(1.0) as f32, f32::from(u8::from(moves)), 0.0, 0.0]);
}

/// The tables of a camera for a tick.
pub(super) struct Tables {
    /// Number of the camera.
    pub camera: usize,
    /// `poses`.
    pub poses: Vec<[f32; 4]>,
}

/// Instances for which a thread is worth starting.
const THREAD_INSTANCES: usize = 32;

/// Tables of the cameras that step with poses, to `t_ns`. Made by several threads if there are many instances.
pub(super) fn tables(cameras: &[CameraState], t_ns: &[Option<i64>]) -> Vec<Tables> {
    let wanted: Vec<_> = cameras
        .iter()
        .zip(t_ns)
        .enumerate()
        .filter(|(_, (camera, _))| is_rigid(&camera.config.sensor))
        .filter_map(|(index, (camera, t_ns))| Some((index, camera, camera.scene.as_ref()?, (*t_ns)?)))
        .collect();
    let make = |wanted: &[(usize, &CameraState, &SceneMotion, i64)]| -> Vec<Tables> {
        let tables = wanted.iter().map(|&(index, camera, scene, t_ns)| {
            let interval_ns = [camera.last_ns.unwrap_or(t_ns), t_ns];
            Tables { camera: index, poses: camera.instances.poses(scene, interval_ns) }
        });
        tables.collect()
    };
    let instances: usize = wanted.iter().map(|(_, camera, ..)| camera.instances.len()).sum();
    let cores = || std::thread::available_parallelism().map_or(1, NonZero::get);
    let threads = match instances / THREAD_INSTANCES {
        0 | 1 => 1,
        worth => worth.min(cores()),
    };
    let mut shares = wanted.chunks(wanted.len().div_ceil(threads).max(1));
    let own = shares.next().unwrap_or_default();
    std::thread::scope(|scope| {
        let others: Vec<_> = shares.map(|share| scope.spawn(|| make(share))).collect();
        let mut tables = make(own);
        for thread in others {
            tables.append(&mut thread.join().expect("a thread of poses does not panic"));
        }
        tables
    })
}

impl Rig {
    /// Sets the poses of a camera and of the instances that it sees, from its next step on. Synthesis `rigid` needs
    /// them: at a step they must span the time from the frame before to the frame. They stay until they are set again,
    /// and are not part of a saved state, as images are not. An instance that had no poses when a frame came has no
    /// path from that frame. Errors: the camera has no geometry or another lens; too many instances; no memory. On an
    /// error the camera keeps the poses that it had.
    pub fn set_scene(&mut self, camera: usize, scene: SceneMotion) -> Result<(), EngineError> {
        self.check_health()?;
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
        if *state.trust() == Trust::All && state.instances.are_those_of(&scene) {
            self.cameras[camera].scene = Some(scene);
            return Ok(());
        }
        let instances = state.instances.with(&scene, state.trust(), state.frames);
        // There is room for those too whose poses are not followed: they may be again.
        let rows = state.instances.with(&scene, &Trust::All, state.frames).len();
        if rows > MOST_INSTANCES {
            return Err(EngineError::TooManyInstances { camera, expected: MOST_INSTANCES, actual: rows });
        }
        let mut places = self.places();
        places[camera] = places[camera].with_instances(rows as u32);
        self.change(places, Vec::new(), &[])?;
        let state = &mut self.cameras[camera];
        state.instances = instances;
        state.scene = Some(scene);
        Ok(())
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
            unused: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::paths::Intrinsics;
    use glam::{DQuat, DVec3};

    fn scene(camera: PoseTrack, body: PoseTrack) -> SceneMotion {
        let mut scene = SceneMotion::new(Intrinsics::pinhole(20.0, 20.0, 7.5, 7.5).unwrap(), camera);
        scene.insert(4, body).unwrap();
        scene
    }

    fn pose(turn: f64, x_m: f64) -> Pose {
        Pose::new(DQuat::from_rotation_y(turn), DVec3::new(x_m, 2.0, -1.0)).unwrap()
    }

    #[test]
    fn what_is_doubted_has_a_row_and_no_poses() {
        let still = || PoseTrack::still(pose(0.1, 1.0));
        let (all, scene) = (Instances::new(), scene(still(), still()));
        let all = all.with(&scene, &Trust::All, 0);
        assert_eq!((all.known(), all.ids()), (&[[0, 0], [4, 1]][..], vec![0, 4]));
        let some = all.with(&scene, &Trust::Without([4].into()), 1);
        assert_eq!((some.known(), some.ids()), (&[[0, 0]][..], vec![0, 4]));
        let none = all.with(&scene, &Trust::Nothing, 1);
        assert_eq!((none.known(), none.ids()), (&[[0, NO_ROW]][..], vec![0, 4]));
        let rows = POSE_ROWS as usize;
        assert!(some.poses(&scene, [0, 32])[rows..].iter().all(|row| *row == [0.0; 4]));
        assert!(none.poses(&scene, [0, 32]).iter().all(|row| *row == [0.0; 4]));
        assert_eq!(none.with(&scene, &Trust::All, 2), all);
    }

    #[test]
    fn what_stands_is_what_moves_by_less_than_rounding() {
        let rows = |camera: PoseTrack, body: PoseTrack| {
            let scene = scene(camera, body);
            Instances::new().with(&scene, &Trust::All, 0).poses(&scene, [0, 32])
        };
        let track = |poses: [Pose; 2]| PoseTrack::new(vec![0, 32], poses.to_vec()).unwrap();
        let stands = rows(PoseTrack::still(pose(0.3, 1.0)), track([pose(-0.2, 5.0); 2]));
        let wavers = rows(
            track([pose(0.3, 1.0), pose(0.3, 1.0 + 1e-12)]),
            track([pose(-0.2, 5.0), pose(-0.2, 5.0 + 1e-12)]),
        );
        assert_eq!(stands, wavers);
        assert_eq!(stands.len(), 2 * POSE_ROWS as usize);
        // A body that moves before a camera that stands, and the world before a camera that moves.
        let moves = |rows: &[[f32; 4]], row: usize| rows[(row + 1) * POSE_ROWS as usize - 1][1] != 0.0;
        let body = rows(PoseTrack::still(pose(0.3, 1.0)), track([pose(0.0, 5.0), pose(0.1, 5.0)]));
        let camera = rows(track([pose(0.3, 1.0), pose(0.3, 1.1)]), PoseTrack::still(pose(0.0, 5.0)));
        assert_eq!([moves(&stands, 0), moves(&stands, 1)], [false, false]);
        assert_eq!([moves(&body, 0), moves(&body, 1)], [false, true]);
        assert_eq!([moves(&camera, 0), moves(&camera, 1)], [true, true]);
    }
}
