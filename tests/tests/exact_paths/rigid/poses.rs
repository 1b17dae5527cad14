//! Poses by the kernel `poses` against those by the host, bit for bit, and both against the tracks.

use esaac_engine::{CameraConfig, FrameBytes, GeometryConfig, KernelPolicy, Rig, RigOptions};
use esaac_layout::POSE_ROWS;
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, STATIC_WORLD, SceneMotion};
use esaac_model::synthesis::rigid::POSE_INSTANTS;
use esaac_model::{DepthFormat, HdrFormat, IdFormat, SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::PI;

const SIDE_PX: u32 = 8;

const FRAME_NS: i64 = 33_333_333;

/// Frames: the first, and three intervals.
const FRAMES: i64 = 4;

/// Error of a number of a pose in f32, of metres or less.
const TOLERANCE: f64 = 1e-6;

fn lens() -> Intrinsics {
    Intrinsics::pinhole(20.0, 21.5, 3.5, 3.5).expect("a lens")
}

fn pose(turn: DVec3, shift_m: DVec3) -> Pose {
    Pose::new(DQuat::from_scaled_axis(turn), shift_m).expect("finite numbers")
}

/// A track through what `path` gives at these times, nanoseconds and seconds.
fn track(times_ns: impl IntoIterator<Item = i64>, path: impl Fn(f64) -> Pose) -> PoseTrack {
    PoseTrack::through(&times_ns.into_iter().collect::<Vec<_>>(), path).expect("ascending times")
}

/// So many samples from frame to frame, the last one on the last frame.
fn samples(each: i64) -> impl Iterator<Item = i64> {
    (0..=each * (FRAMES - 1)).map(move |k| k * FRAME_NS / each)
}

fn shaking(t_s: f64) -> Pose {
    let wave = |hz: f64, phase: f64| (2.0 * PI * hz * t_s + phase).sin();
    pose(
        DVec3::new(0.02 * wave(9.0, 0.3), 0.02 * wave(11.0, 2.0) + 0.3 * t_s, 0.01 * wave(17.0, 0.7)),
        DVec3::new(0.02 * wave(10.0, 0.0), 0.01 * wave(13.0, 1.0), 1.5 + 0.005 * wave(21.0, 0.0)),
    )
}

/// Tracks that are hard to get right, each with how far its poses may be from [`PoseTrack::at`], in parts of
/// [`TOLERANCE`]: what is far away has fewer digits.
fn hard_tracks() -> Vec<(PoseTrack, f64)> {
    let axis = DVec3::new(1.0, -2.0, 0.5).normalize();
    let spinning = |rad_a_sample: f64, each: i64| {
        let rad_s = rad_a_sample * each as f64 / (FRAME_NS as f64 * 1e-9);
        track(samples(each), move |t_s| pose(axis * (rad_s * t_s), DVec3::new(3.0 * t_s, 0.0, -2.0)))
    };
    // A turn that starts within a microsecond, then a long gap: the cubic between turns many times around.
    let jerked = [0, 1_000, 2_000, 3_000, FRAME_NS / 2, FRAME_NS, 2 * FRAME_NS, 3 * FRAME_NS];
    let bouncing = |t_s: f64| {
        let phase = (t_s * 41.0).fract();
        pose(DVec3::new(0.0, 9.0 * t_s, 0.0), DVec3::new(0.1, 4.0 * phase * (1.0 - phase), -3.0))
    };
    let noise = |t_s: f64| {
        let hash = ((t_s * 1e9).round() as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        f64::from(hash as u32) / f64::from(1 << 24) - 0.5
    };
    vec![
        (track(samples(8), shaking), 1.0),
        (track(samples(1), shaking), 1.0),
        (track(samples(47).chain([4 * FRAME_NS]), shaking), 1.0),
        // Turns for which the short series serve no more, and nearly half a turn between samples.
        (spinning(0.25, 4), 4.0),
        (spinning(3.1, 4), 4.0),
        (spinning(2.9, 1), 4.0),
        (track(jerked, |t_s| pose(axis * (2e3 * t_s.min(3e-6)), DVec3::new(t_s, 0.0, -1.0))), 4.0),
        (track(samples(13), bouncing), 4.0),
        // Samples a microsecond apart, with what a tracker's noise is.
        (
            track((0..=100_000).map(|k| k * 1_000), |t_s| {
                pose(axis * (1e-7 * noise(t_s) + t_s), DVec3::new(1e-6 * noise(t_s + 1.0), t_s, -1.0))
            }),
            1.0,
        ),
        (track((0..20).map(|k| k * k * k * 15_000), shaking), 1.0),
        (PoseTrack::still(shaking(0.4)), 1.0),
        (track(samples(3), |_| shaking(0.1)), 1.0),
        // Motion that is only rounding, and motion that is hardly more.
        (track(samples(4), |t_s| pose(DVec3::ZERO, DVec3::new(5.0, 1e-10 * t_s, 0.0))), 5.0),
        (track(samples(4), |t_s| pose(axis * (3e-8 * t_s), DVec3::new(5.0, 2.0, 0.0))), 5.0),
        (track(samples(5), |t_s| pose(axis * t_s, DVec3::new(4e5, 3.0 * t_s, 1e5))), 1e6),
    ]
}

/// For each camera its scene: each hard track is a camera's, among bodies with three others.
fn scenes() -> Vec<(SceneMotion, f64)> {
    let tracks = hard_tracks();
    (0..tracks.len())
        .map(|camera| {
            let mut scene = SceneMotion::new(lens(), tracks[camera].0.clone());
            let mut parts = tracks[camera].1;
            for id in 1..4 {
                let (track, more) = &tracks[(camera * 3 + 4 * id) % tracks.len()];
                scene.insert(id as u32, track.clone()).expect("an id of its own");
                parts += more;
            }
            (scene, parts)
        })
        .collect()
}

/// The rows of each camera after each frame. Some cameras stay out of the second frame, and in the third the second body
/// of each has no poses any more.
fn rows(device_tracks: u32, scenes: &[(SceneMotion, f64)]) -> Vec<Vec<Vec<u32>>> {
    let own = if DEVICE.is_software() { KernelPolicy::software_driver() } else { KernelPolicy::gpu() };
    let policy = Some(KernelPolicy { device_tracks, ..own });
    let sensor = SensorModel {
        width: SIDE_PX,
        height: SIDE_PX,
        synthesis: Synthesis::Rigid,
        substeps: 2,
        ..SensorModel::default()
    };
    let geometry = GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U32), lens: lens() };
    let config = |camera| CameraConfig {
        sensor: sensor.clone(),
        camera,
        hdr: HdrFormat::F32x4,
        motion: None,
        geometry: Some(geometry),
    };
    let configs: Vec<_> = (0..scenes.len() as u32).map(config).collect();
    let options = RigOptions { policy, ..RigOptions::default() };
    let mut rig = Rig::with_options(&DEVICE, &configs, options).expect("a rig");
    let pixels = sensor.pixels();
    let (hdr, depth) = (1.0_f32.to_le_bytes().repeat(4 * pixels), 3.0_f32.to_le_bytes().repeat(pixels));
    let ids: Vec<u8> = (0..pixels).flat_map(|pixel| (pixel as u32 % 4).to_le_bytes()).collect();
    let images = FrameBytes { hdr: &hdr, depth: Some(&depth), ids: Some(&ids), ..FrameBytes::default() };
    for (camera, (scene, _)) in scenes.iter().enumerate() {
        rig.upload(camera, &images).expect("images that fit");
        rig.set_scene(camera, scene.clone()).expect("poses");
    }
    let mut found = Vec::new();
    for frame in 0..FRAMES {
        if frame == 2 {
            for (camera, (scene, _)) in scenes.iter().enumerate() {
                let mut scene = scene.clone();
                scene.remove(2);
                rig.set_scene(camera, scene).expect("poses");
            }
        }
        let t_ns: Vec<_> = (0..scenes.len())
            .map(|camera| (frame != 1 || camera % 5 != 3).then_some(frame * FRAME_NS))
            .collect();
        rig.step_some(&t_ns).expect("frames in time");
        found.push(
            (0..scenes.len()).map(|camera| rig.words(camera, "poses").expect("a rig that is well")).collect(),
        );
    }
    let by_device = rig.permutations_compiled().iter().any(|(name, _)| *name == "poses");
    assert_eq!(by_device, device_tracks == 0, "who works out poses");
    found
}

#[test]
fn poses_by_the_device_are_those_by_the_host_bit_for_bit() {
    let scenes = scenes();
    let (host, device) = (rows(u32::MAX, &scenes), rows(0, &scenes));
    let mut moving = 0;
    for (frame, (host, device)) in host.iter().zip(&device).enumerate() {
        for (camera, (host, device)) in host.iter().zip(device).enumerate() {
            let differ = host.iter().zip(device).position(|(host, device)| host != device);
            assert_eq!(host.len(), device.len());
            if let Some(word) = differ {
                let [host, device] = [host, device].map(|words| f32::from_bits(words[word]));
                panic!("frame {frame}, camera {camera}, word {word}: {host:e} by the host, {device:e}");
            }
            moving += host.chunks(4 * POSE_ROWS as usize).filter(|rows| rows[rows.len() - 3] != 0).count();
        }
    }
    assert!(moving > 2 * scenes.len(), "{moving} instances move");
    assert_silent();
}

#[test]
fn poses_by_the_device_are_those_of_the_tracks() {
    let scenes = scenes();
    for (frame, found) in rows(0, &scenes).iter().enumerate().skip(1) {
        let to_ns = frame as i64 * FRAME_NS;
        for (camera, (scene, parts)) in scenes.iter().enumerate().filter(|(camera, _)| camera % 5 != 3) {
            let from_ns = to_ns - FRAME_NS;
            for (row, id) in [STATIC_WORLD, 1, 2, 3].into_iter().enumerate() {
                let numbers: Vec<f32> = found[camera][4 * row * POSE_ROWS as usize..]
                    [..4 * POSE_ROWS as usize]
                    .iter()
                    .map(|&word| f32::from_bits(word))
                    .collect();
                if frame >= 2 && id == 2 {
                    assert!(numbers.iter().all(|&number| number == 0.0), "it has no poses");
                    continue;
                }
                for i in 0..=POSE_INSTANTS {
                    let (at_ns, key_ns) = match i {
                        POSE_INSTANTS => (from_ns, to_ns),
                        _ => (from_ns + (i as i64 * FRAME_NS + 16) / 32, from_ns),
                    };
                    let expected = scene.relative(id, at_ns, key_ns).expect("poses");
                    let turn = DMat3::from_quat(expected.rotation());
                    for axis in 0..3 {
                        let exact = turn.row(axis).extend(expected.translation_m()[axis]);
                        let off = (0..4)
                            .map(|k| (f64::from(numbers[4 * (3 * i + axis) + k]) - exact[k]).abs())
                            .fold(0.0, f64::max);
                        assert!(
                            off <= parts * TOLERANCE,
                            "frame {frame}, camera {camera}, id {id}, instant {i}: {off:e}"
                        );
                    }
                }
            }
        }
    }
    assert_silent();
}
