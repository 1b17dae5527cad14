//! A rigidly moving plane sends the same events whichever way its frames between are made: along exact paths, along
//! exact motion vectors in the limit of small motion, and rendered at 960 Hz.

use esaac_engine::{CameraConfig, FrameBytes, Rig, RigOptions};
use esaac_model::packet::Event;
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::{MotionFormat, SensorModel, Synthesis};
use esaac_oracle::metrics::{Comparison, compare};
use esaac_oracle::truth;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::geometry::{KeyFrame, Rendered};
use glam::{DQuat, DVec2, DVec3};

const SIZE: (u32, u32) = (64, 48);
const FRAME_NS: i64 = 33_333_312;
const FRAMES: i64 = 4;

/// Frames at 960 Hz for each one.
const FINE: i64 = 32;

const PLANE_ID: u32 = 1;

/// A tilted plane that turns and slides before a camera that stands; `pace` is how fast.
fn moving(pace: f64) -> SceneMotion {
    let times_ns: Vec<i64> = (0..=FINE * FRAMES).map(|i| i * FRAME_NS / FINE).collect();
    let pose = |&t_ns: &i64| {
        let t = pace * t_ns as f64 / FRAME_NS as f64;
        Pose::new(
            DQuat::from_scaled_axis(DVec3::new(0.2, 0.3 + 0.02 * t, 0.03 * t)),
            DVec3::new(0.12 * t, -0.07 * t, -3.0 + 0.04 * t),
        )
    };
    let poses = times_ns.iter().map(pose).collect::<Result<_, _>>().expect("poses");
    let lens = Intrinsics::pinhole(50.0, 50.0, 31.5, 23.5).expect("a lens");
    let mut scene = SceneMotion::new(lens, PoseTrack::still(Pose::IDENTITY));
    scene.insert(PLANE_ID, PoseTrack::new(times_ns, poses).expect("a track")).expect("one id");
    scene
}

/// Light and depth of each pixel. The texture is smooth, so that a pixel's centre speaks for it.
fn cast(scene: &SceneMotion, t_ns: i64) -> (Vec<f64>, Vec<f64>) {
    let pose = scene.instance(PLANE_ID).expect("the plane").at(t_ns).expect("a pose");
    let inverse = pose.inverse();
    let from = inverse.point(DVec3::ZERO);
    (0..SIZE.0 * SIZE.1)
        .map(|pixel| {
            let at = DVec2::new(f64::from(pixel % SIZE.0), f64::from(pixel / SIZE.0));
            let ray = scene.lens().ray(at).expect("a pinhole");
            let along = inverse.direction(ray);
            let depth_m = -from.z / along.z;
            let hit = from + along * depth_m;
            (((5.0 * hit.x + 2.0 * hit.y).sin() + 0.7 * (4.0 * hit.y - hit.x).cos()).exp(), depth_m)
        })
        .unzip()
}

fn rendered(pace: f64) -> Rendered {
    let scene = moving(pace);
    let frame = |index: i64| {
        let t_ns = index * FRAME_NS;
        let (light, depth_m) = cast(&scene, t_ns);
        let hdr = light.iter().flat_map(|&s| [s as f32, s as f32, s as f32, 1.0]).collect::<Vec<f32>>();
        let depth: Vec<f32> = depth_m.iter().map(|&d| d as f32).collect();
        let motion: Vec<f32> = (0..SIZE.0 * SIZE.1)
            .flat_map(|pixel| {
                let at = DVec2::new(f64::from(pixel % SIZE.0), f64::from(pixel / SIZE.0));
                let before_ns = (t_ns - FRAME_NS).max(0);
                let before = scene.path(at, depth_m[pixel as usize], PLANE_ID, t_ns, before_ns);
                (before.expect("before the camera").pixel_px - at).as_vec2().to_array()
            })
            .collect();
        let bytes = |values: &[f32]| bytemuck::cast_slice::<f32, u8>(values).to_vec();
        let ids = PLANE_ID.to_le_bytes().repeat(light.len());
        KeyFrame::new(t_ns, bytes(&hdr), bytes(&motion), bytes(&depth), ids)
    };
    let frames = (0..=FRAMES).map(frame).collect();
    Rendered { size: SIZE, scene, frames }
}

fn sensor(synthesis: Synthesis, contrast: f64) -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis,
        contrast_on: contrast,
        contrast_off: contrast,
        log_offset: 0.01,
        substeps: FINE as u32,
        // By speed: both ways are compared at the same instants.
        substep_error_ns: 0,
        // As many for both.
        transfers: 2,
        ..SensorModel::default()
    }
}

fn by_engine(rendered: &Rendered, sensor: &SensorModel) -> Vec<Event> {
    let camera = CameraConfig { motion: Some(MotionFormat::F32x2), ..rendered.camera(sensor) };
    let mut rig = Rig::with_options(&DEVICE, &[camera], RigOptions::default()).expect("a rig");
    rig.set_scene(0, rendered.scene.clone()).expect("poses of its lens");
    let mut events = Vec::new();
    for frame in &rendered.frames {
        rig.upload(0, &FrameBytes { motion: Some(&frame.motion), ..frame.bytes() }).expect("a frame");
        events.extend(rig.step(&[frame.t_ns]).expect("a frame in time").packets[0].iter());
    }
    assert_silent();
    events
}

fn by_rendering(rendered: &Rendered, sensor: &SensorModel) -> Vec<Event> {
    let times_ns: Vec<i64> = (0..=FINE * FRAMES).map(|i| i * FRAME_NS / FINE).collect();
    let frames: Vec<Vec<f64>> = times_ns.iter().map(|&t_ns| cast(&rendered.scene, t_ns).0).collect();
    let all = times_ns.iter().zip(&frames).map(|(&t_ns, frame)| (t_ns, &frame[..]));
    truth::events(sensor, 0, all).expect("a truth")
}

/// Pixels at the border whose surface one of the frames does not show.
const BORDER_PX: u16 = 8;

/// Compares the events of inner pixels after the first interval, before which nothing is known.
fn compare_inside(expected: &[Event], tested: &[Event]) -> Comparison {
    let (right, bottom) = (SIZE.0 as u16 - BORDER_PX, SIZE.1 as u16 - BORDER_PX);
    let inside = |e: &&Event| {
        (BORDER_PX..right).contains(&e.x) && (BORDER_PX..bottom).contains(&e.y) && e.t_ns > FRAME_NS
    };
    let [expected, tested] = [expected, tested].map(|events| events.iter().filter(inside).copied());
    compare(SIZE, expected, tested)
}

/// Events of `rigid` against those rendered, against those of `motion`, and those of `motion` against those rendered.
fn compare_ways(pace: f64, contrast: f64) -> [Comparison; 3] {
    let rendered = rendered(pace);
    let [rigid, motion] =
        [Synthesis::Rigid, Synthesis::Motion].map(|s| by_engine(&rendered, &sensor(s, contrast)));
    let truth = by_rendering(&rendered, &sensor(Synthesis::Rigid, contrast));
    [(&truth, &rigid), (&motion, &rigid), (&truth, &motion)]
        .map(|(expected, tested)| compare_inside(expected, tested))
}

/// How fast the plane moves (1: some 2 px a frame), the contrast threshold, and the bounds: least F1 of `rigid` against
/// frames rendered, and least F1 and largest mean time error, microseconds, of `rigid` against `motion`.
const CASES: [(f64, f64, f64, f64, f64); 3] =
    [(0.05, 0.01, 0.95, 1.0, 1.0), (0.3, 0.05, 0.7, 0.999, 3.0), (1.0, 0.1, 0.95, 0.995, 30.0)];

#[test]
fn a_moving_plane_sends_one_stream_whichever_way_its_frames_are_made() {
    for (pace, contrast, f1, f1_motion, apart_us) in CASES {
        let [rigid, rigid_to_motion, motion] = compare_ways(pace, contrast);
        assert!(rigid.truth_on_off.0 > 3000 && rigid.truth_on_off.1 > 3000, "{pace}: {rigid:?}");
        assert!(rigid.f1 >= f1 && rigid.f1 >= motion.f1 - 0.002, "{pace}: {rigid:?}, motion {motion:?}");
        assert!((rigid.count_ratio - 1.0).abs() < 0.005, "{pace}: {rigid:?}");
        assert!(rigid.same_sequence > 0.98, "{pace}: {rigid:?}");
        assert!(rigid_to_motion.f1 >= f1_motion, "{pace}: {rigid_to_motion:?}");
        assert!(rigid_to_motion.matched.mean_us <= apart_us, "{pace}: {rigid_to_motion:?}");
        assert!(rigid_to_motion.same_sequence > 0.999, "{pace}: {rigid_to_motion:?}");
    }
}
