//! Whether poses are close enough in time to tell the paths between them.
//!
//! A track is made again from every second of its poses, and from every fourth. Poses that were left out lie off the new
//! track, and what the camera sees of them moves by that: by `d2` and `d4` pixels, which a tenth of them exceeds. To halve
//! the rate of poses from all to every second multiplies the error about as the next halving does, and by 4 at least. So
//! the track through all poses is off by some `d2 / max(d4 / d2, 4)`.

use super::{Intrinsics, Pose, PoseTrack, STATIC_WORLD, SceneMotion};
use crate::quantile::upper;
use glam::DVec2;
use std::collections::BTreeMap;
use std::fmt;

/// Error from which on poses are too far apart, pixels. Events along paths that are off by less are hardly others.
pub const COARSE_PX: f64 = 1.0;

/// Poses from which on a track is judged.
const FEWEST_POSES: usize = 5;

/// Poses from which on every fourth is a path, too.
const POSES_OF_BOTH: usize = 9;

/// What halving the rate of poses multiplies the error by at least: that of a straight line between poses.
const LEAST_RATIO: f64 = 4.0;

/// The share of the left-out poses that lie as far off as is told, or farther.
const MOVED_SHARE: f64 = 0.1;

/// Points of an instance in a frame.
const POINTS_OF_INSTANCE: usize = 64;

/// Left-out poses that are looked at.
const MOST_POSES: usize = 256;

/// Tracks of a running camera that are taken together. What a simulator lacks, it lacks in all of them.
const WATCHED_TRACKS: usize = 16;

/// Poses of a running camera that are kept. Who gives so many lacks none.
const MOST_WATCHED: usize = 4096;

/// Collects points that a camera sees.
#[derive(Clone, Debug, Default)]
pub struct SpacingCheck {
    points: BTreeMap<u32, Vec<SeenPoint>>,
}

#[derive(Clone, Copy, Debug)]
struct SeenPoint {
    pixel_px: DVec2,
    depth_m: f64,
    t_ns: i64,
}

/// The poses of a running camera, track by track, until there are enough to judge how it turns. Points at infinity tell
/// that without any depth.
#[derive(Clone, Debug, Default)]
pub struct SpacingWatch {
    poses: BTreeMap<i64, Pose>,
    tracks: usize,
    is_over: bool,
    found: Option<CoarseTrack>,
}

/// A track whose poses are too far apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoarseTrack {
    /// The instance, or [`STATIC_WORLD`] for the camera.
    pub id: u32,
    /// Median time from pose to pose, nanoseconds.
    pub spacing_ns: i64,
    /// Estimated error of the paths between poses, pixels.
    pub error_px: f64,
}

impl fmt::Display for CoarseTrack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (spacing_ms, error_px) = (self.spacing_ns as f64 * 1e-6, self.error_px);
        match self.id {
            STATIC_WORLD => f.write_str("the camera")?,
            id => write!(f, "instance {id}")?,
        }
        write!(
            f,
            " has a pose each {spacing_ms:.1} ms, and its paths between them may be off by {error_px:.1} px"
        )
    }
}

/// What to tell of tracks whose poses are too far apart; `None` if there are none.
#[must_use]
pub fn coarse_warning(coarse: &[CoarseTrack]) -> Option<String> {
    let all: Vec<String> = coarse.iter().map(ToString::to_string).collect();
    (!all.is_empty()).then(|| {
        format!("poses are too far apart in time: {}; give those of every physics step", all.join("; "))
    })
}

impl SpacingWatch {
    /// Takes the track of the camera's next interval, while more are wanted. Times that go back begin anew.
    pub fn add(&mut self, lens: &Intrinsics, size_px: (u32, u32), track: &PoseTrack) {
        if self.is_over {
            return;
        }
        let times_ns = track.times_ns();
        if self.poses.last_key_value().is_some_and(|(last_ns, _)| times_ns.last() < Some(last_ns)) {
            *self = SpacingWatch::default();
        }
        self.tracks += 1;
        self.poses.extend(times_ns.iter().copied().zip(track.poses().iter().copied()));
        self.is_over = self.tracks == WATCHED_TRACKS || self.poses.len() > MOST_WATCHED;
        if self.is_over {
            let (times_ns, poses): (Vec<i64>, _) = std::mem::take(&mut self.poses).into_iter().unzip();
            let check = SpacingCheck::at_infinity(size_px, times_ns[0]);
            let track =
                PoseTrack::new(times_ns, poses).expect("times of a map ascend, and there is one at least");
            self.found = check.coarse(&SceneMotion::new(*lens, track)).pop();
        }
    }

    /// What to tell the user, once it is known that the poses are too far apart.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        coarse_warning(self.found.as_slice())
    }
}

impl SpacingCheck {
    /// Points at infinity all over an image, seen at `t_ns`.
    fn at_infinity((width_px, height_px): (u32, u32), t_ns: i64) -> Self {
        let at = |part: usize, length_px: u32| f64::from(length_px) * (part as f64 + 0.5) / 3.0;
        let points = (0..9).map(|i| SeenPoint {
            pixel_px: DVec2::new(at(i % 3, width_px), at(i / 3, height_px)),
            depth_m: f64::INFINITY,
            t_ns,
        });
        SpacingCheck { points: BTreeMap::from([(STATIC_WORLD, points.collect())]) }
    }

    /// Takes points of the frame at `t_ns` with a usable depth, evenly spread, some of each instance. Images are row by
    /// row; without ids all belongs to the static world.
    pub fn add(&mut self, width_px: u32, t_ns: i64, depth_m: &[f32], ids: Option<&[u32]>) {
        let mut pixels: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for i in (0..depth_m.len()).filter(|&i| depth_m[i] >= 0.0) {
            pixels.entry(ids.map_or(STATIC_WORLD, |ids| ids[i])).or_default().push(i);
        }
        for (id, pixels) in pixels {
            let stride = pixels.len().div_ceil(POINTS_OF_INSTANCE);
            self.points.entry(id).or_default().extend(pixels.iter().step_by(stride).map(|&i| SeenPoint {
                pixel_px: DVec2::new((i % width_px as usize) as f64, (i / width_px as usize) as f64),
                depth_m: f64::from(depth_m[i]),
                t_ns,
            }));
        }
    }

    /// The tracks of `scene` whose poses are too far apart, by id.
    #[must_use]
    pub fn coarse(&self, scene: &SceneMotion) -> Vec<CoarseTrack> {
        let judge = |(&id, points): (&u32, &Vec<SeenPoint>)| {
            let track = if id == STATIC_WORLD { scene.camera() } else { scene.instance(id)? };
            let error_px = error_px(scene, id, track, points)?;
            (error_px > COARSE_PX).then(|| CoarseTrack { id, spacing_ns: spacing_ns(track), error_px })
        };
        self.points.iter().filter_map(judge).collect()
    }
}

/// The estimate for a track by the points that show it. `None` if it cannot be judged.
fn error_px(scene: &SceneMotion, id: u32, track: &PoseTrack, points: &[SeenPoint]) -> Option<f64> {
    if track.stands() || track.poses().len() < FEWEST_POSES {
        return None;
    }
    let second = left_out_px(scene, id, track, points, 2)?;
    let is_enough = track.poses().len() >= POSES_OF_BOTH;
    let fourth = is_enough.then(|| left_out_px(scene, id, track, points, 4)).flatten().unwrap_or(0.0);
    // `max` leaves out the NaN of a straight line, where both are 0.
    Some(second / (fourth / second).max(LEAST_RATIO))
}

/// By how many pixels poses lie off the track through every `step`-th, which a tenth of them exceeds.
fn left_out_px(
    scene: &SceneMotion,
    id: u32,
    track: &PoseTrack,
    points: &[SeenPoint],
    step: usize,
) -> Option<f64> {
    let last = track.poses().len() - 1;
    let is_kept = |i: usize| i.is_multiple_of(step) || i == last;
    let kept = (0..=last).filter(|&i| is_kept(i));
    let (times_ns, poses) = kept.map(|i| (track.times_ns()[i], track.poses()[i])).unzip();
    let thinned = PoseTrack::new(times_ns, poses).ok()?;
    let left_out: Vec<usize> = (0..=last).filter(|&i| !is_kept(i)).collect();
    let stride = left_out.len().div_ceil(MOST_POSES);
    let errors = left_out.iter().step_by(stride).filter_map(|&i| {
        let (t_ns, pose) = (track.times_ns()[i], track.poses()[i]);
        let off = thinned.at(t_ns).ok()? * pose.inverse();
        let moved = points.iter().filter_map(|point| moved_px(scene, id, off, point));
        upper(&mut moved.collect::<Vec<_>>(), 0.5)
    });
    upper(&mut errors.collect::<Vec<_>>(), MOVED_SHARE)
}

/// By how many pixels a point moves if the pose of what shows it is off, in world axes.
fn moved_px(scene: &SceneMotion, id: u32, off: Pose, point: &SeenPoint) -> Option<f64> {
    let camera = scene.camera().at(point.t_ns).ok()?;
    let off = if id == STATIC_WORLD { off.inverse() } else { off };
    let moved = scene.lens().path(point.pixel_px, point.depth_m, &(camera.inverse() * off * camera)).ok()?;
    Some(moved.pixel_px.distance(point.pixel_px))
}

/// Median time from pose to pose.
fn spacing_ns(track: &PoseTrack) -> i64 {
    let mut apart: Vec<i64> =
        track.times_ns().windows(2).map(|pair| pair[1].saturating_sub(pair[0])).collect();
    let middle = apart.len() / 2;
    *apart.select_nth_unstable(middle).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths::Intrinsics;
    use glam::{DQuat, DVec3};
    use std::f64::consts::TAU;

    const WIDTH_PX: u32 = 32;
    const FRAME_NS: i64 = 33_333_333;
    const BODY: u32 = 7;

    /// A second of poses.
    fn track(poses_hz: i64, path: impl Fn(f64) -> Pose) -> PoseTrack {
        let times_ns: Vec<i64> = (0..=poses_hz).map(|k| k * 1_000_000_000 / poses_hz).collect();
        PoseTrack::through(&times_ns, path).unwrap()
    }

    /// A camera that shakes at 9 and 11 Hz, some 8 px from frame to frame.
    fn shaking(t_s: f64) -> Pose {
        let turn = DVec3::new((TAU * 9.0 * t_s).sin() * 0.03, (TAU * 11.0 * t_s).sin() * 0.03, 0.0);
        Pose::new(DQuat::from_scaled_axis(turn), DVec3::ZERO).unwrap()
    }

    /// A camera that drives, speeds up and turns, tens of pixels a frame.
    fn driving(t_s: f64) -> Pose {
        let place = DVec3::new(0.0, 1.0, -2.0 * t_s - 3.0 * t_s * t_s);
        Pose::new(DQuat::from_rotation_y(1.5 * t_s), place).unwrap()
    }

    /// A ball that bounces each quarter of a second.
    fn bouncing(t_s: f64) -> Pose {
        let in_bounce = (4.0 * t_s).fract();
        Pose::new(DQuat::IDENTITY, DVec3::new(0.0, 4.0 * in_bounce * (1.0 - in_bounce), -4.0)).unwrap()
    }

    fn scene(camera: PoseTrack) -> SceneMotion {
        SceneMotion::new(Intrinsics::pinhole(200.0, 200.0, 15.5, 11.5).unwrap(), camera)
    }

    /// What is told of an image 2 to 5 m away, with a body in its upper half and background at infinity in one row.
    fn coarse(scene: &SceneMotion) -> Vec<CoarseTrack> {
        let mut check = SpacingCheck::default();
        for frame in 0..4 {
            let pixels = WIDTH_PX as usize * 24;
            let depth_m: Vec<f32> = (0..pixels)
                .map(|i| match i / WIDTH_PX as usize {
                    20 => f32::INFINITY,
                    21 => f32::NAN,
                    row => 2.0 + row as f32 / 8.0,
                })
                .collect();
            let ids: Vec<u32> =
                (0..pixels).map(|i| if i < pixels / 2 { BODY } else { STATIC_WORLD }).collect();
            check.add(WIDTH_PX, 7 * frame * FRAME_NS, &depth_m, Some(&ids));
        }
        check.coarse(scene)
    }

    #[test]
    fn poses_as_sparse_as_frames_do_not_tell_how_a_camera_shakes() {
        for (poses_hz, is_coarse) in [(30, true), (60, false), (120, false), (240, false), (960, false)] {
            let track = track(poses_hz, shaking);
            let found = coarse(&scene(track.clone()));
            assert_eq!(!found.is_empty(), is_coarse, "{poses_hz} poses a second: {found:?}");
            let turn = |t_ns: i64| {
                let off =
                    track.at(t_ns).unwrap().rotation().inverse() * shaking(t_ns as f64 * 1e-9).rotation();
                200.0 * off.to_scaled_axis().length()
            };
            let mut off_px: Vec<f64> = (0..1000).map(|k| turn(k * 1_000_000)).collect();
            off_px.sort_by(f64::total_cmp);
            let off_px = off_px[900];
            match &found[..] {
                [only] => {
                    assert_eq!((only.id, only.spacing_ns / 1_000_000), (STATIC_WORLD, 1000 / poses_hz));
                    assert!((off_px / 3.0..off_px * 3.0).contains(&only.error_px), "{only:?}, {off_px} px");
                }
                _ => assert!(off_px < COARSE_PX / 2.0, "{poses_hz} poses a second are {off_px} px off"),
            }
        }
    }

    #[test]
    fn smooth_ways_need_no_more_poses_than_frames() {
        assert_eq!(coarse(&scene(track(30, driving))), []);
        // A few frames alone.
        let times_ns: Vec<i64> = (0..6).map(|k| k * FRAME_NS).collect();
        assert_eq!(coarse(&scene(PoseTrack::through(&times_ns, driving).unwrap())), []);
        let shaken = coarse(&scene(PoseTrack::through(&times_ns, shaking).unwrap()));
        assert_eq!(shaken.iter().map(|track| track.id).collect::<Vec<_>>(), [STATIC_WORLD]);
        // Fewer poses tell nothing, and what stands has none between.
        assert_eq!(coarse(&scene(PoseTrack::through(&times_ns[..4], shaking).unwrap())), []);
        assert_eq!(coarse(&scene(PoseTrack::still(Pose::IDENTITY))), []);
    }

    #[test]
    fn a_running_camera_is_told_of_after_some_tracks() {
        let size_px = (WIDTH_PX, 24);
        let lens = Intrinsics::pinhole(200.0, 200.0, 15.5, 11.5).unwrap();
        let interval = |k: i64, poses: i64, path: fn(f64) -> Pose| {
            let times_ns: Vec<i64> = (0..=poses).map(|j| (k * poses + j) * FRAME_NS / poses).collect();
            PoseTrack::through(&times_ns, path).unwrap()
        };
        let after = |intervals: i64, poses: i64, path: fn(f64) -> Pose| {
            let mut watch = SpacingWatch::default();
            (0..intervals).for_each(|k| watch.add(&lens, size_px, &interval(k, poses, path)));
            watch.warning()
        };
        assert_eq!(after(15, 1, shaking), None);
        let warning = after(16, 1, shaking).expect("a pose a frame");
        assert!(
            warning.contains("the camera has a pose each 33.3 ms") && warning.contains("every physics step")
        );
        assert_eq!(
            [after(16, 8, shaking), after(16, 1, driving), after(16, 600, shaking)],
            [None, None, None]
        );
        // Another run from the same time on is not mixed with the first.
        let mut watch = SpacingWatch::default();
        (0..9).for_each(|k| watch.add(&lens, size_px, &interval(k, 1, shaking)));
        (0..16).for_each(|k| watch.add(&lens, size_px, &interval(k, 1, driving)));
        assert_eq!((watch.warning(), watch.is_over), (None, true));
    }

    #[test]
    fn a_body_has_poses_of_its_own() {
        for (poses_hz, is_coarse) in [(30, true), (240, false)] {
            let mut scene = scene(track(30, driving));
            scene.insert(BODY, track(poses_hz, bouncing)).unwrap();
            let found = coarse(&scene);
            assert_eq!(found.iter().map(|track| track.id).eq([BODY]), is_coarse, "{poses_hz}: {found:?}");
        }
        let told = CoarseTrack { id: BODY, spacing_ns: 33_333_333, error_px: 12.4 };
        let text = "instance 7 has a pose each 33.3 ms, and its paths between them may be off by 12.4 px";
        assert_eq!(told.to_string(), text);
    }
}
