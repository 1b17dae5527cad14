//! Sequences that are right in everything, and the same with a mistake planted.

use super::super::*;
use crate::paths::Intrinsics;
use glam::{DQuat, DVec3};

pub(super) const WIDTH_PX: u32 = 64;
pub(super) const HEIGHT_PX: u32 = 48;
pub(super) const FRAME_NS: i64 = 33_333_333;
pub(super) const FRAMES: i64 = 6;
pub(super) const BALL: u32 = 9;
pub(super) const OTHER: u32 = 11;

/// A camera by hand, unevenly: nothing about it is symmetric or steady.
pub(super) fn camera(k: f64) -> Pose {
    let turn = DVec3::new(
        0.9 + 0.06 * (1.1 * k).sin(),
        0.4 + 0.05 * (0.8 * k + 1.0).sin(),
        0.2 + 0.04 * (1.7 * k).cos(),
    );
    let place = DVec3::new(0.3 * (0.9 * k).sin(), -2.0 + 0.2 * (1.3 * k).cos(), 1.5 + 0.1 * (0.7 * k).sin());
    Pose::new(DQuat::from_scaled_axis(turn), place).unwrap()
}

/// A ball that tumbles and speeds up.
pub(super) fn ball(k: f64) -> Pose {
    let turn = DVec3::new(0.3 * k, 0.5 + 0.05 * k * k, 0.4);
    Pose::new(DQuat::from_scaled_axis(turn), DVec3::new(0.2 * k, 1.0 - 0.02 * k * k, 0.5)).unwrap()
}

/// A body that goes another way.
pub(super) fn other(k: f64) -> Pose {
    let turn = DVec3::new(0.1, 0.4 * k, 0.2 * k);
    Pose::new(DQuat::from_scaled_axis(turn), DVec3::new(1.0, 0.3 * k, -0.1 * k)).unwrap()
}

/// Time, depth, ids and vectors of a key frame.
pub(super) type Images = (i64, Vec<f32>, Vec<u32>, Vec<[f32; 2]>);

pub(super) struct Sequence {
    pub(super) scene: SceneMotion,
    pub(super) frames: Vec<Images>,
}

pub(super) fn pixel_px(i: usize) -> DVec2 {
    DVec2::new((i % WIDTH_PX as usize) as f64, (i / WIDTH_PX as usize) as f64)
}

pub(super) fn track(pose: impl Fn(f64) -> Pose) -> PoseTrack {
    let samples = 0..=4 * FRAMES;
    PoseTrack::new(
        samples.clone().map(|j| j * FRAME_NS / 4).collect(),
        samples.map(|j| pose(j as f64 / 4.0)).collect(),
    )
    .unwrap()
}

pub(super) fn scene(
    lens: Intrinsics,
    camera: impl Fn(f64) -> Pose,
    ball: impl Fn(f64) -> Pose,
) -> SceneMotion {
    let mut scene = SceneMotion::new(lens, track(camera));
    scene.insert(BALL, track(ball)).unwrap();
    scene
}

pub(super) fn lens() -> Intrinsics {
    Intrinsics::pinhole(60.0, 55.0, 31.0, 24.0).unwrap()
}

/// Right in everything: a rough surface, a ball in the middle, a few pixels of sky and of edges.
pub(super) fn right() -> Sequence {
    right_of(scene(lens(), camera, ball))
}

/// The same of another scene.
pub(super) fn right_of(scene: SceneMotion) -> Sequence {
    let frames = (1..FRAMES).map(|k| {
        let (mut depth, mut ids, mut motion) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..WIDTH_PX * HEIGHT_PX {
            let (x, y) = (f64::from(i % WIDTH_PX), f64::from(i / WIDTH_PX));
            let id = if (x - 30.0).hypot(y - 20.0) < 9.0 { BALL } else { STATIC_WORLD };
            let depth_m =
                if i < 40 { f64::INFINITY } else { 3.0 + (0.3 * x).sin() + 0.8 * (0.2 * y + 0.1 * x).cos() };
            let pixel_px = DVec2::new(x, y);
            let end = scene.path(pixel_px, depth_m, id, k * FRAME_NS, (k - 1) * FRAME_NS).unwrap();
            let at_edge = i % 11 == 0;
            let vector = if at_edge { DVec2::new(9.0, -7.0) } else { end.pixel_px - pixel_px };
            depth.push(depth_m as f32);
            ids.push(id);
            motion.push(vector.to_array().map(|v| v as f32));
        }
        (k * FRAME_NS, depth, ids, motion)
    });
    Sequence { frames: frames.collect(), scene }
}

pub(super) fn report(sequence: &Sequence) -> ConventionReport {
    let mut check = ConventionCheck::default();
    for (t_ns, depth, ids, motion) in &sequence.frames {
        let times = (t_ns - FRAME_NS, *t_ns);
        check.add(&KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap());
    }
    check.report(&sequence.scene).expect("enough pixels")
}

pub(super) fn change_vectors(sequence: &mut Sequence, mut change: impl FnMut([f32; 2]) -> [f32; 2]) {
    for vector in sequence.frames.iter_mut().flat_map(|(_, _, _, motion)| motion) {
        *vector = change(*vector);
    }
}

pub(super) fn change_depth(sequence: &mut Sequence, change: impl Fn(f64, DVec2) -> f64) {
    for (_, depth, _, _) in &mut sequence.frames {
        for (i, depth_m) in depth.iter_mut().enumerate() {
            *depth_m = change(f64::from(*depth_m), pixel_px(i)) as f32;
        }
    }
}

/// World and ball as they are, with columns exchanged or signs changed: `pose` with other axes of the camera.
pub(super) fn with_axes(pose: Pose, axes: [[f64; 3]; 3]) -> Pose {
    let rows = pose.to_rows();
    let mut other = rows;
    for (i, row) in other.iter_mut().take(3).enumerate() {
        for (j, axis) in axes.iter().enumerate() {
            row[j] = (0..3).map(|l| rows[i][l] * axis[l]).sum();
        }
    }
    Pose::from_rows(&other).unwrap()
}

pub(super) fn with_transposed_rotation(pose: Pose) -> Pose {
    let rows = pose.to_rows();
    let mut other = rows;
    for i in 0..3 {
        for j in 0..3 {
            other[i][j] = rows[j][i];
        }
    }
    Pose::from_rows(&other).unwrap()
}

pub(super) fn read_scalar_first_as_last(pose: Pose) -> Pose {
    let [x, y, z, w] = pose.rotation().to_array();
    let [tx, ty, tz] = pose.translation_m().to_array();
    Pose::from_xyz_qxyzw(&[tx, ty, tz, w, x, y, z]).unwrap()
}

/// The sequence with a mistake made in it. Each is written as who makes it would, not as it is undone.
pub(super) fn planted(mistake: Mistake) -> Sequence {
    let mut sequence = right();
    let (width, height) = (WIDTH_PX as f32, HEIGHT_PX as f32);
    let with_camera = |change: fn(Pose) -> Pose| scene(lens(), |k| change(camera(k)), ball);
    let with_ball = |change: fn(Pose) -> Pose| scene(lens(), camera, |k| change(ball(k)));
    match mistake {
        Mistake::VectorsNegated => change_vectors(&mut sequence, |[x, y]| [-x, -y]),
        Mistake::VectorsYUp => change_vectors(&mut sequence, |[x, y]| [x, -y]),
        Mistake::VectorsXLeft => change_vectors(&mut sequence, |[x, y]| [-x, y]),
        Mistake::VectorsExchanged => change_vectors(&mut sequence, |[x, y]| [y, x]),
        Mistake::VectorsPerSecond => change_vectors(&mut sequence, |[x, y]| [30.0 * x, 30.0 * y]),
        Mistake::VectorsTimes(factor) => {
            change_vectors(&mut sequence, |vector| vector.map(|v| v / factor as f32));
        }
        Mistake::VectorsOfImageSize => change_vectors(&mut sequence, |[x, y]| [x / width, y / height]),
        Mistake::VectorsOfHalfSize => {
            change_vectors(&mut sequence, |[x, y]| [2.0 * x / width, 2.0 * y / height]);
        }
        Mistake::VectorsToNextFrame => {
            for (t_ns, depth, ids, motion) in &mut sequence.frames {
                for i in 0..motion.len() {
                    let pixel_px = pixel_px(i);
                    let end = sequence
                        .scene
                        .path(pixel_px, f64::from(depth[i]), ids[i], *t_ns, *t_ns + FRAME_NS)
                        .unwrap();
                    motion[i] = (end.pixel_px - pixel_px).to_array().map(|v| v as f32);
                }
            }
        }
        Mistake::PosesAhead => {
            sequence.scene = scene(lens(), |k| camera(k + 1.0), |k| ball(k + 1.0));
        }
        Mistake::PosesBehind => {
            sequence.scene = scene(lens(), |k| camera(k - 1.0), |k| ball(k - 1.0));
        }
        Mistake::PosesTimes(factor) => {
            sequence.scene = scene(lens(), |k| camera(k / factor), |k| ball(k / factor));
        }
        // Columns: right, down, forward.
        Mistake::CameraOpenCv => {
            sequence.scene =
                with_camera(|pose| with_axes(pose, [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]));
        }
        // Left, up, forward.
        Mistake::CameraAlongZ => {
            sequence.scene =
                with_camera(|pose| with_axes(pose, [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]));
        }
        // Forward, left, up.
        Mistake::CameraAlongX => {
            sequence.scene =
                with_camera(|pose| with_axes(pose, [[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
        }
        // Right, up, backward; those of the renderer are taken for forward, left, up.
        Mistake::CameraReadAlongX => {
            sequence.scene =
                with_camera(|pose| with_axes(pose, [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]));
        }
        Mistake::CameraInverted => sequence.scene = with_camera(|pose| pose.inverse()),
        Mistake::CameraTransposed => sequence.scene = with_camera(with_transposed_rotation),
        Mistake::CameraScalarFirst => sequence.scene = with_camera(read_scalar_first_as_last),
        Mistake::LensOfOtherKind => {
            let fisheye = Intrinsics::fisheye(60.0, 55.0, 31.0, 24.0).unwrap();
            sequence = right_of(scene(fisheye, camera, ball));
            sequence.scene = scene(lens(), camera, ball);
        }
        Mistake::DepthOfOtherKind => change_depth(&mut sequence, |depth_m, pixel_px| {
            let point = lens().unproject(pixel_px, depth_m).unwrap();
            point.truncate().length() * depth_m
        }),
        Mistake::DepthTimes(factor) => change_depth(&mut sequence, |depth_m, _| depth_m / factor),
        Mistake::RowsFromBottom => {
            let size = WIDTH_PX as usize;
            for (_, depth, ids, motion) in &mut sequence.frames {
                *depth = depth.chunks(size).rev().flatten().copied().collect();
                *ids = ids.chunks(size).rev().flatten().copied().collect();
                *motion = motion.chunks(size).rev().flatten().map(|&[x, y]| [x, -y]).collect();
            }
        }
        Mistake::BodyInverted => sequence.scene = with_ball(|pose| pose.inverse()),
        Mistake::BodyTransposed => sequence.scene = with_ball(with_transposed_rotation),
        Mistake::BodyScalarFirst => sequence.scene = with_ball(read_scalar_first_as_last),
        Mistake::BodyOf(_) => {
            sequence.scene = scene(lens(), camera, other);
            sequence.scene.insert(OTHER, track(ball)).unwrap();
        }
        Mistake::BodyStill => {
            let still = scene(lens(), camera, |_| Pose::IDENTITY);
            for (t_ns, depth, ids, motion) in &mut sequence.frames {
                for i in (0..motion.len()).filter(|&i| ids[i] == BALL) {
                    let pixel_px = pixel_px(i);
                    let end =
                        still.path(pixel_px, f64::from(depth[i]), BALL, *t_ns, *t_ns - FRAME_NS).unwrap();
                    motion[i] = (end.pixel_px - pixel_px).to_array().map(|v| v as f32);
                }
            }
        }
    }
    sequence
}
