//! What synthesis `rigid` reads besides images: instances, their poses within an interval, and the lens.

use super::geometry::Place;
use super::parameters::is_rigid;
use super::{CameraState, GeometryConfig, Rig};
use crate::error::EngineError;
use esaac_layout::{Geometry, POSE_ROWS};
use esaac_model::paths::conventions::Trust;
use esaac_model::paths::{Pose, STATIC_WORLD, SceneMotion};
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

    /// Writes `poses` of the interval from `from_ns` to `to_ns`, which the scene's poses span.
    fn write_poses(
        &self,
        scene: &SceneMotion,
        interval_ns: [i64; 2],
        Scratch { camera, body }: &mut Scratch,
        rows: &mut [[f32; 4]],
    ) {
        let times_ns = instants_ns(interval_ns);
        let standing_camera = scene.camera().stands();
        scene.camera().at_all(&times_ns, camera).expect("poses that span the interval");
        let focal_px = 0.5 * scene.lens().focal_px().element_sum();
        // All that stands moves before the camera as the world does.
        let mut standing = standing_camera.then_some(AT_REST);
        for (row, rows) in self.rows.iter().zip(rows.chunks_exact_mut(POSE_ROWS as usize)) {
            let Row::Posed(id) = *row else {
                rows.fill([0.0; 4]);
                continue;
            };
            match scene.instance(id).filter(|track| !track.stands()) {
                Some(track) => {
                    track.at_all(&times_ns, body).expect("poses that span the interval");
                    rows.copy_from_slice(&moving_rows(camera, Some(body), focal_px));
                }
                None => {
                    rows.copy_from_slice(standing.get_or_insert_with(|| moving_rows(camera, None, focal_px)))
                }
            }
        }
    }
}

/// Instants of an interval at which poses are worked out.
fn instants_ns([from_ns, to_ns]: [i64; 2]) -> [i64; POSE_INSTANTS] {
    std::array::from_fn(|i| {
        let fraction = i as f64 / (POSE_INSTANTS - 1) as f64;
        from_ns + (fraction * (to_ns - from_ns) as f64).round() as i64
    })
}

/// Rows of an instance in `poses`.
type InstanceRows = [[f32; 4]; POSE_ROWS as usize];

/// Of an instance that does not move before the camera.
const AT_REST: InstanceRows = {
    let mut rows = [[1.0, 0.0, 0.0, 0.0]; POSE_ROWS as usize];
    let mut row = 0;
    while row + 1 < rows.len() {
        rows[row] = [0.0; 4];
        rows[row][row % 3] = 1.0;
        row += 1;
    }
    rows
};

/// What poses are worked out in, kept from one camera to the next.
#[derive(Default)]
struct Scratch {
    camera: Vec<Pose>,
    body: Vec<Pose>,
}

/// The rows of an instance that moves: `camera` and `body` are its poses and the camera's at all instants, `None` for
/// one that stands.
fn moving_rows(camera: &[Pose], body: Option<&[Pose]>, focal_px: f64) -> InstanceRows {
    let mut rows = AT_REST;
    let last = POSE_INSTANTS - 1;
    // From camera axes at instant `i` to those at the first instant, or the last.
    let [to_first, to_last] = [0, last].map(|key| {
        let from_world = camera[key].inverse();
        let from_body = body.map_or(from_world, |body| from_world * body[key]);
        move |i: usize| match body {
            Some(body) => from_body * (body[i].inverse() * camera[i]),
            None => from_body * camera[i],
        }
    });
    let mut moves = false;
    let mut put = |i: usize, pose: &Pose| {
        let shift_m = pose.translation_m();
        if shift_m.abs().max_element() < REST && pose.rotation().xyz().abs().max_element() < REST {
            return;
        }
        moves = true;
        let turn = DMat3::from_quat(pose.rotation());
        for axis in 0..3 {
            let (row, shift_m) = (turn.row(axis), shift_m[axis]);
            rows[3 * i + axis] = [row.x as f32, row.y as f32, row.z as f32, shift_m as f32];
        }
    };
    let mut largest_m: f64 = 0.0;
    for i in 0..=last {
        let pose = to_first(i);
        put(i, &pose);
        if i % (last / (KNOTS - 1)) == 0 {
            let shift_m = to_last(i).translation_m().length();
            largest_m = largest_m.max(pose.translation_m().length()).max(shift_m);
        }
    }
    put(POSE_INSTANTS, &to_last(0));
    rows[POSE_ROWS as usize - 1] =
        [(focal_px * largest_m).max(1.0) as f32, f32::from(u8::from(moves)), 0.0, 0.0];
    rows
}

/// A camera that steps with poses.
struct Posed<'a> {
    instances: &'a Instances,
    scene: &'a SceneMotion,
    interval_ns: [i64; 2],
    /// Its rows of `poses`.
    rows: &'a mut [[f32; 4]],
}

/// Moving instances for which a thread is worth starting: starting one takes as long as some ten of them.
const THREAD_INSTANCES: usize = 64;

/// Writes `poses` of the cameras that step with poses to `t_ns`, with several threads if many instances move.
pub(super) fn write_poses(cameras: &[CameraState], t_ns: &[Option<i64>], mut poses: &mut [[f32; 4]]) {
    let mut posed = Vec::new();
    let mut before = 0;
    for (camera, t_ns) in cameras.iter().zip(t_ns) {
        let (CameraState { instances, scene: Some(scene), .. }, Some(t_ns)) = (camera, *t_ns) else {
            continue;
        };
        if !is_rigid(&camera.config.sensor) {
            continue;
        }
        // Cameras have their rows in order.
        let first = camera.place.pose_base as usize;
        let (rows, rest) =
            std::mem::take(&mut poses)[first - before..].split_at_mut(instances.len() * POSE_ROWS as usize);
        (poses, before) = (rest, first + rows.len());
        let interval_ns = [camera.last_ns.unwrap_or(t_ns), t_ns];
        posed.push(Posed { instances, scene, interval_ns, rows });
    }
    let work = |posed: &mut [Posed<'_>]| {
        let mut scratch = Scratch::default();
        for Posed { instances, scene, interval_ns, rows } in posed {
            instances.write_poses(scene, *interval_ns, &mut scratch, rows);
        }
    };
    let instances: usize = posed.iter().map(|camera| camera.scene.moving_tracks()).sum();
    let cores = || std::thread::available_parallelism().map_or(1, NonZero::get);
    let threads = match instances / THREAD_INSTANCES {
        0 | 1 => 1,
        worth => worth.min(cores()),
    };
    let each = posed.len().div_ceil(threads).max(1);
    let mut shares = posed.chunks_mut(each);
    let own = shares.next().unwrap_or_default();
    std::thread::scope(|scope| {
        for share in shares {
            scope.spawn(move || work(share));
        }
        work(own);
    });
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
            self.replace_scene(camera, scene);
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
        self.cameras[camera].instances = instances;
        self.replace_scene(camera, scene);
        Ok(())
    }

    fn replace_scene(&mut self, camera: usize, scene: SceneMotion) {
        // Who sets scenes again and again between two steps does not pile them up.
        if self.past_scenes.len() >= self.cameras.len() {
            self.past_scenes.clear();
        }
        self.past_scenes.extend(self.cameras[camera].scene.replace(scene));
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
    use esaac_model::paths::{Intrinsics, PoseTrack};
    use glam::{DQuat, DVec3};

    fn scene(camera: PoseTrack, body: PoseTrack) -> SceneMotion {
        let mut scene = SceneMotion::new(Intrinsics::pinhole(20.0, 20.0, 7.5, 7.5).unwrap(), camera);
        scene.insert(4, body).unwrap();
        scene
    }

    fn pose(turn: f64, x_m: f64) -> Pose {
        Pose::new(DQuat::from_rotation_y(turn), DVec3::new(x_m, 2.0, -1.0)).unwrap()
    }

    /// The rows of an interval of 32 ns.
    fn poses(instances: &Instances, scene: &SceneMotion) -> Vec<[f32; 4]> {
        let mut rows = vec![[f32::NAN; 4]; instances.len() * POSE_ROWS as usize];
        instances.write_poses(scene, [0, 32], &mut Scratch::default(), &mut rows);
        rows
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
        assert!(poses(&some, &scene)[rows..].iter().all(|row| *row == [0.0; 4]));
        assert!(poses(&none, &scene).iter().all(|row| *row == [0.0; 4]));
        assert_eq!(none.with(&scene, &Trust::All, 2), all);
    }

    #[test]
    fn what_stands_is_what_moves_by_less_than_rounding() {
        let rows = |camera: PoseTrack, body: PoseTrack| {
            let scene = scene(camera, body);
            poses(&Instances::new().with(&scene, &Trust::All, 0), &scene)
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
