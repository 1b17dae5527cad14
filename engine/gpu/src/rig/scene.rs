//! What synthesis `rigid` reads besides images: instances, their poses within an interval, and the lens.

use super::geometry::Place;
use super::parameters::is_rigid;
use super::{CameraState, GeometryConfig, Rig};
use crate::error::EngineError;
use esaac_layout::{Geometry, POSE_ROWS};
use esaac_model::paths::{Pose, PoseTrack, STATIC_WORLD, SceneMotion};
use esaac_model::synthesis::rigid::{KNOTS, POSE_INSTANTS};
use glam::DMat3;

/// Most instances of a camera: `surfaces` has 16 bits for them, and one value means none.
pub(super) const MOST_INSTANCES: usize = 0xffff;

/// How near to rest a motion counts as none: rounding of poses in f64, radians and metres.
const REST: f64 = 1e-9;

/// The rows of a camera's instances in its tables. The surfaces of the last frame name instances by row, so a row keeps
/// its instance until no surface names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Instances {
    /// Row 0 is the static world.
    rows: Vec<Row>,
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
        Instances { rows: vec![Row::Posed(STATIC_WORLD)] }
    }

    /// Rows for the instances of `scene`, after `frames` frames. No other instance has poses.
    pub(super) fn with(&self, scene: &SceneMotion, frames: u64) -> Self {
        let mut rows = self.rows.clone();
        for row in &mut rows {
            let (Row::Posed(id) | Row::Left { id, .. }) = *row;
            let posed = id == STATIC_WORLD || scene.instance(id).is_some();
            *row = match (posed, *row) {
                (true, _) => Row::Posed(id),
                (false, Row::Posed(_)) => Row::Left { id, frames },
                (false, left) => left,
            };
        }
        for id in scene.ids().filter(|&id| self.row(id).is_none()) {
            let free = |row: &Row| matches!(row, Row::Left { frames: then, .. } if *then < frames);
            match rows.iter().position(free) {
                Some(row) => rows[row] = Row::Posed(id),
                None => rows.push(Row::Posed(id)),
            }
        }
        Instances { rows }
    }

    /// Rows of a saved camera: the ids of its rows.
    pub(super) fn restored(ids: &[u32]) -> Self {
        Instances { rows: ids.iter().map(|&id| Row::Posed(id)).collect() }
    }

    /// The instance of each row.
    pub(super) fn ids(&self) -> Vec<u32> {
        self.rows.iter().map(|&(Row::Posed(id) | Row::Left { id, .. })| id).collect()
    }

    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    fn row(&self, id: u32) -> Option<usize> {
        self.rows
            .iter()
            .position(|&row| matches!(row, Row::Posed(own) | Row::Left { id: own, .. } if own == id))
    }

    /// Ids with poses, each with its row.
    fn posed(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        self.rows.iter().enumerate().filter_map(|(row, &kind)| match kind {
            Row::Posed(id) => Some([id, row as u32]),
            Row::Left { .. } => None,
        })
    }

    /// Ids with poses, ascending, each with its row: `instances`.
    pub(super) fn known(&self) -> Vec<[u32; 2]> {
        let mut known: Vec<_> = self.posed().collect();
        known.sort_unstable();
        known
    }

    /// `poses` of the interval from `from_ns` to `to_ns`, which the scene's poses span.
    pub(super) fn poses(&self, scene: &SceneMotion, [from_ns, to_ns]: [i64; 2]) -> Vec<[f32; 4]> {
        let times_ns: Vec<i64> = (0..POSE_INSTANTS)
            .map(|i| {
                let fraction = i as f64 / (POSE_INSTANTS - 1) as f64;
                from_ns + (fraction * (to_ns - from_ns) as f64).round() as i64
            })
            .collect();
        let at = |track: &PoseTrack| -> Vec<Pose> {
            times_ns.iter().map(|&t_ns| track.at(t_ns).expect("poses that span the interval")).collect()
        };
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
    // From camera axes at instant `i` to those at instant `key`.
    let relative = |i: usize, key: usize| match body {
        Some(body) => camera[key].inverse() * body[key] * body[i].inverse() * camera[i],
        None => camera[key].inverse() * camera[i],
    };
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
    for i in 0..=last {
        push(&relative(i, 0));
    }
    push(&relative(0, last));
    let shift_m =
        |i: usize| relative(i, 0).translation_m().length().max(relative(i, last).translation_m().length());
    let largest_m = (0..KNOTS).map(|knot| shift_m(knot * last / (KNOTS - 1))).fold(0.0, f64::max);
    rows.push([(focal_px * largest_m).max(1.0) as f32, f32::from(u8::from(moves)), 0.0, 0.0]);
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
        let instances = state.instances.with(&scene, state.frames);
        if instances.len() > MOST_INSTANCES {
            let (expected, actual) = (MOST_INSTANCES, instances.len());
            return Err(EngineError::TooManyInstances { camera, expected, actual });
        }
        let mut places = self.places();
        places[camera] = places[camera].with_instances(instances.len() as u32);
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
            known_ids: self.instances.posed().count() as u32,
            instances: self.instances.len() as u32,
            pose_base: place.pose_base,
            path_base: place.path_base,
            path_instants: place.path_instants,
            unused: 0,
        }
    }
}
