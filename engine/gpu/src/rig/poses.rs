//! Where instances are before their cameras at some instants of an interval: `poses`.
//!
//! For few moving tracks the host works them out: the kernel `poses` would cost a tick more in latency. For many it
//! writes what the kernel needs, the segments of the tracks that hold an instant. Both give the same bits.

use super::CameraState;
use super::geometry::Place;
use super::scene::Instances;
use super::sensor::is_rigid;
use crate::policy::KernelPolicy;
use crate::threads;
use esaac_layout::{self as layout, POSE_ROWS, PoseSegment, TRACK_SEGMENTS, Track, TrackKind};
use esaac_model::paths::{Pose, PoseTrack, SceneMotion, Segment, square_root};
use esaac_model::synthesis::rigid::{KNOTS, POSE_INSTANTS, POSE_REST};
use glam::DMat3;

/// Who works out the poses of a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PosesBy {
    /// The kernel `poses`, not the host.
    pub device: bool,
    /// How many tracks of the tick move.
    moving: usize,
}

impl PosesBy {
    /// Chooses for a tick of `cameras` to `t_ns`; `room` says whether the arena has any for the device's tracks.
    pub(super) fn choose(
        &mut self,
        cameras: &[CameraState],
        t_ns: &[Option<i64>],
        policy: KernelPolicy,
        room: bool,
    ) {
        self.follow(posed(cameras, t_ns).map(|posed| posed.scene.moving_tracks()).sum(), policy);
        self.device &= room;
    }

    /// Chooses for a tick with so many moving tracks. A change costs new commands, so the device goes on until they are
    /// half as many.
    fn follow(&mut self, moving: usize, policy: KernelPolicy) {
        let least = policy.device_tracks as usize;
        self.device = moving >= if self.device { least / 2 } else { least };
        self.moving = moving;
    }

    /// Writes `poses` of the cameras that step with poses to `t_ns`.
    pub(super) fn write_poses(
        self,
        cameras: &[CameraState],
        t_ns: &[Option<i64>],
        mut poses: &mut [[f32; 4]],
    ) {
        let mut before = 0;
        let mut shares = Vec::new();
        for posed in posed(cameras, t_ns) {
            // Cameras have their rows in order.
            let rows = posed.camera.instances.len() * POSE_ROWS as usize;
            shares.push((take(&mut poses, &mut before, posed.camera.place.pose_base as usize, rows), posed));
        }
        in_threads(shares, self.moving / THREAD_TRACKS, |shares| {
            let mut scratch = Scratch::default();
            for (rows, Posed { camera, scene, interval_ns }) in shares {
                write_rows(&camera.instances, scene, *interval_ns, &mut scratch, rows);
            }
        });
    }

    /// Writes `tracks` and `segments` of these cameras, for the device.
    pub(super) fn write_tracks(
        self,
        cameras: &[CameraState],
        t_ns: &[Option<i64>],
        (mut tracks, mut segments): (&mut [Track], &mut [PoseSegment]),
    ) {
        let each = TRACK_SEGMENTS as usize;
        let (mut tracks_before, mut segments_before) = (0, 0);
        let mut shares = Vec::new();
        for posed in posed(cameras, t_ns) {
            let (first, count) = (posed.camera.place.track_base as usize, 1 + posed.camera.instances.len());
            let tracks = take(&mut tracks, &mut tracks_before, first, count);
            let segments = take(&mut segments, &mut segments_before, each * first, each * count);
            shares.push((tracks, segments, posed));
        }
        in_threads(shares, self.moving / THREAD_DEVICE_TRACKS, |shares| {
            let mut instants = Instants::default();
            for (tracks, segments, posed) in shares {
                posed.write_tracks(instants.of(posed.interval_ns), tracks, segments);
            }
        });
    }
}

/// Tracks that rigs with these cameras have room for in `segments`: none if too few for the device could move.
pub(super) fn device_tracks<'a>(places: impl Iterator<Item = &'a Place>, policy: KernelPolicy) -> u64 {
    let (mut movable, mut tracks) = (0, 0);
    for place in places {
        // Row 0 is the static world, which moves as the camera does.
        movable += place.elements()[layout::INSTANCES].unwrap_or(0);
        tracks += place.elements()[layout::TRACKS].unwrap_or(0);
    }
    if movable < u64::from(policy.device_tracks) { 0 } else { tracks }
}

/// A camera that steps with poses.
struct Posed<'a> {
    camera: &'a CameraState,
    scene: &'a SceneMotion,
    interval_ns: [i64; 2],
}

/// The cameras that step with poses to `t_ns`, in order.
fn posed<'a>(cameras: &'a [CameraState], t_ns: &'a [Option<i64>]) -> impl Iterator<Item = Posed<'a>> + 'a {
    cameras.iter().zip(t_ns).filter_map(|(camera, t_ns)| {
        let (Some(scene), Some(t_ns)) = (&camera.scene, *t_ns) else { return None };
        let interval_ns = [camera.last_ns.unwrap_or(t_ns), t_ns];
        is_rigid(&camera.config.sensor).then_some(Posed { camera, scene, interval_ns })
    })
}

/// The `count` elements from `first` on, of those that are `left`; `before` were taken or passed over.
fn take<'a, T>(left: &mut &'a mut [T], before: &mut usize, first: usize, count: usize) -> &'a mut [T] {
    let (taken, rest) = std::mem::take(left)[first - *before..].split_at_mut(count);
    (*left, *before) = (rest, first + count);
    taken
}

/// Moving tracks for which a thread is worth waking. Of one that the device works out a quarter is left to the host.
const THREAD_TRACKS: usize = 64;
const THREAD_DEVICE_TRACKS: usize = 128;

/// Does work on shares with so many threads, or as many as there are cores.
fn in_threads<T: Send>(mut shares: Vec<T>, worth: usize, work: impl Fn(&mut [T]) + Sync) {
    let threads = if worth < 2 { 1 } else { worth.min(threads::most()) };
    let each = shares.len().div_ceil(threads).max(1);
    threads::share(shares.chunks_mut(each), work);
}

/// Instants of an interval at which poses are worked out. They are kept: most cameras of a tick have the same.
struct Instants {
    interval_ns: [i64; 2],
    at_ns: [i64; POSE_INSTANTS],
}

impl Default for Instants {
    fn default() -> Self {
        Instants { interval_ns: [0; 2], at_ns: [0; POSE_INSTANTS] }
    }
}

impl Instants {
    fn of(&mut self, interval_ns: [i64; 2]) -> &[i64; POSE_INSTANTS] {
        if self.interval_ns != interval_ns {
            let [from_ns, to_ns] = interval_ns;
            let at_ns = std::array::from_fn(|i| {
                let fraction = i as f64 / (POSE_INSTANTS - 1) as f64;
                from_ns + (fraction * (to_ns - from_ns) as f64).round() as i64
            });
            *self = Instants { interval_ns, at_ns };
        }
        &self.at_ns
    }
}

impl Posed<'_> {
    /// Writes the camera's tracks and the segments that its instants lie in.
    fn write_tracks(
        &self,
        times_ns: &[i64; POSE_INSTANTS],
        tracks: &mut [Track],
        segments: &mut [PoseSegment],
    ) {
        let mut segments = segments.chunks_exact_mut(TRACK_SEGMENTS as usize);
        let moving = |track: &PoseTrack, room: &mut [PoseSegment]| {
            let mut next = 0;
            for (room, (segment, times)) in room.iter_mut().zip(track.segments(times_ns)) {
                *room = row_of(&segment, times_ns[0]);
                if times.start > 0 {
                    next |= 1 << (times.start - 1);
                }
            }
            next
        };
        let own = self.scene.camera();
        let kind = if own.stands() { TrackKind::Stands } else { TrackKind::Moves };
        let next = moving(own, segments.next().unwrap_or_default());
        tracks[0] = Track { kind: kind as u32, next, focal_px: focal_px(self.scene) };
        let of_rows = self.camera.instances.tracks(self.scene);
        for ((row, room), track) in tracks[1..].iter_mut().zip(segments).zip(of_rows) {
            let (kind, next) = match track {
                None => (TrackKind::None, 0),
                Some(None) => (TrackKind::Stands, 0),
                Some(Some(track)) => (TrackKind::Moves, moving(track, room)),
            };
            *row = Track { kind: kind as u32, next, focal_px: 0.0 };
        }
    }
}

/// The mean focal length.
fn focal_px(scene: &SceneMotion) -> f64 {
    0.5 * scene.lens().focal_px().element_sum()
}

/// The row of a segment in an interval from `from_ns` on.
fn row_of(segment: &Segment, from_ns: i64) -> PoseSegment {
    let (start, shift, turn) = (segment.start(), segment.shift_m(), segment.turned());
    let (rotation, translation_m) = (start.rotation(), start.translation_m());
    PoseSegment {
        // Kernels take it from later times, modulo 2^64.
        start_ns: segment.start_ns().wrapping_sub(from_ns),
        per_ns: segment.per_ns(),
        rotation_x: rotation.x,
        rotation_y: rotation.y,
        rotation_z: rotation.z,
        rotation_w: rotation.w,
        translation_x_m: translation_m.x,
        translation_y_m: translation_m.y,
        translation_z_m: translation_m.z,
        shift_x_m: shift.end.x,
        shift_y_m: shift.end.y,
        shift_z_m: shift.end.z,
        shift_start_x_m: shift.slopes[0].x,
        shift_start_y_m: shift.slopes[0].y,
        shift_start_z_m: shift.slopes[0].z,
        shift_end_x_m: shift.slopes[1].x,
        shift_end_y_m: shift.slopes[1].y,
        shift_end_z_m: shift.slopes[1].z,
        turn_x: turn.end.x,
        turn_y: turn.end.y,
        turn_z: turn.end.z,
        turn_start_x: turn.slopes[0].x,
        turn_start_y: turn.slopes[0].y,
        turn_start_z: turn.slopes[0].z,
        turn_end_x: turn.slopes[1].x,
        turn_end_y: turn.slopes[1].y,
        turn_end_z: turn.slopes[1].z,
    }
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
    instants: Instants,
    camera: Vec<Pose>,
    body: Vec<Pose>,
}

/// Writes a camera's rows of an interval, which the scene's poses span.
fn write_rows(
    instances: &Instances,
    scene: &SceneMotion,
    interval_ns: [i64; 2],
    Scratch { instants, camera, body }: &mut Scratch,
    rows: &mut [[f32; 4]],
) {
    let times_ns = instants.of(interval_ns);
    scene.camera().at_all(times_ns, camera).expect("poses that span the interval");
    let focal_px = focal_px(scene);
    // All that stands moves before the camera as the world does.
    let mut standing = scene.camera().stands().then_some(AT_REST);
    for (track, rows) in instances.tracks(scene).zip(rows.chunks_exact_mut(POSE_ROWS as usize)) {
        match track {
            None => rows.fill([0.0; 4]),
            Some(Some(track)) => {
                track.at_all(times_ns, body).expect("poses that span the interval");
                rows.copy_from_slice(&moving_rows(camera, Some(body), focal_px));
            }
            Some(None) => {
                rows.copy_from_slice(standing.get_or_insert_with(|| moving_rows(camera, None, focal_px)));
            }
        }
    }
}

/// The rows of an instance that moves: `camera` and `body` are its poses and the camera's at all instants, `None` for
/// one that stands. The kernel `poses` does the same in the same order.
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
        if shift_m.abs().max_element() < POSE_REST && pose.rotation().xyz().abs().max_element() < POSE_REST {
            return;
        }
        moves = true;
        let turn = DMat3::from_quat(pose.rotation());
        for axis in 0..3 {
            let (row, shift_m) = (turn.row(axis), shift_m[axis]);
            rows[3 * i + axis] = [row.x as f32, row.y as f32, row.z as f32, shift_m as f32];
        }
    };
    let mut largest_square: f64 = 0.0;
    for i in 0..=last {
        let pose = to_first(i);
        put(i, &pose);
        if i % (last / (KNOTS - 1)) == 0 {
            for pose in [pose, to_last(i)] {
                largest_square = largest_square.max(pose.translation_m().length_squared());
            }
        }
    }
    put(POSE_INSTANTS, &to_last(0));
    let parallax_px = (focal_px * square_root(largest_square)).max(1.0);
    rows[POSE_ROWS as usize - 1] = [parallax_px as f32, f32::from(u8::from(moves)), 0.0, 0.0];
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::paths::Intrinsics;
    use esaac_model::paths::conventions::Trust;
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
        write_rows(instances, scene, [0, 32], &mut Scratch::default(), &mut rows);
        rows
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

    #[test]
    fn the_device_takes_over_at_many_tracks_and_leaves_off_at_half_as_many() {
        let policy = KernelPolicy { device_tracks: 24, ..KernelPolicy::gpu() };
        let mut by = PosesBy::default();
        let chosen = [23, 24, 12, 11, 23, 40].map(|moving| {
            by.follow(moving, policy);
            by.device
        });
        assert_eq!(chosen, [false, true, true, false, false, true]);
    }
}
