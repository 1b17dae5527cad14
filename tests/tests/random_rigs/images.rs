//! What the cameras of a case see: rendered frames, with pixels spoiled here and there, and poses.

use crate::case::{CameraCase, Case, FrameAt, Spoils};
use esaac_engine::{CameraConfig, FrameBytes, GeometryConfig};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::random::philox4x32_10;
use esaac_model::{DepthFormat, HdrFormat, IdFormat, MotionFormat, SensorModel};
use esaac_oracle::Frame as OracleFrame;
use esaac_scene::{Frame, render_cpu};

/// Poses of a scene for each interval, as physics gives them.
const POSES_AN_INTERVAL: i64 = 32;

/// An instance that no scene has.
const UNKNOWN_ID: u16 = 51_966;

/// A frame.
#[derive(Clone)]
pub struct Images {
    pub t_ns: i64,
    pub hdr: Vec<u8>,
    pub motion: Vec<u8>,
    pub depth: Vec<u8>,
    pub ids: Vec<u8>,
}

/// What one camera sees, tick by tick.
#[derive(Clone)]
pub struct View {
    pub case: CameraCase,
    pub lens: Intrinsics,
    pub poses: SceneMotion,
    pub frames: Vec<Option<Images>>,
}

impl View {
    /// For the engine.
    pub fn config(&self, sensor: &SensorModel) -> CameraConfig {
        let geometry = |geometry: crate::case::GeometryOf| GeometryConfig {
            depth: DepthFormat::F32,
            ids: geometry.ids,
            lens: self.lens,
        };
        CameraConfig {
            sensor: sensor.clone(),
            camera: self.case.number,
            hdr: self.case.hdr,
            motion: self.case.motion,
            geometry: self.case.geometry.map(geometry),
        }
    }

    fn has_ids(&self) -> Option<IdFormat> {
        self.case.geometry.and_then(|geometry| geometry.ids)
    }

    /// Frame of a tick for the engine.
    pub fn bytes<'a>(&self, images: &'a Images) -> FrameBytes<'a> {
        FrameBytes {
            hdr: &images.hdr,
            motion: self.case.motion.is_some().then_some(&images.motion[..]),
            depth: self.case.geometry.is_some().then_some(&images.depth[..]),
            ids: self.has_ids().is_some().then_some(&images.ids[..]),
        }
    }

    /// The same with all vectors moved, for the oracle.
    pub fn with_moved_vectors(&self, by_px: [f64; 2]) -> View {
        let Some(format) = self.case.motion else { return self.clone() };
        let pixels = self.case.sensor.pixels();
        let moved = |images: &Images| {
            let vectors = (0..pixels).map(|pixel| moved(format.decode(&images.motion, pixel), by_px));
            let motion = vectors.flatten().flat_map(f32::to_le_bytes).collect();
            Images { motion, ..images.clone() }
        };
        let frames = self.frames.iter().map(|images| images.as_ref().map(moved)).collect();
        let case = CameraCase { motion: Some(MotionFormat::F32x2), ..self.case.clone() };
        View { case, lens: self.lens, poses: self.poses.clone(), frames }
    }

    /// Frame of a tick for the oracle.
    pub fn oracle_frame<'a>(&self, images: &'a Images) -> OracleFrame<'a> {
        OracleFrame {
            t_ns: images.t_ns,
            hdr: (self.case.hdr, &images.hdr),
            motion: self.case.motion.map(|format| (format, &images.motion[..])),
            depth: self.case.geometry.is_some().then_some((DepthFormat::F32, &images.depth[..])),
            ids: self.has_ids().map(|format| (format, &images.ids[..])),
        }
    }
}

/// Length along an axis, pixels, that is lost in the last bit of a position in single precision.
const LOST_PX: f64 = 1e-8;

/// A vector moved by so much, or by its last bit where that is more. Along an axis along which it does not move it stays at
/// rest: there a position is exact.
fn moved(vector_px: [f64; 2], by_px: [f64; 2]) -> [f32; 2] {
    [0, 1].map(|axis| {
        let (from, to) = (vector_px[axis] as f32, (vector_px[axis] + by_px[axis]) as f32);
        if vector_px[axis].abs() < LOST_PX {
            0.0
        } else if to != from || by_px[axis] == 0.0 || !from.is_finite() {
            to
        } else if by_px[axis] > 0.0 {
            from.next_up()
        } else {
            from.next_down()
        }
    })
}

/// Renders what all cameras see.
pub fn views(case: &Case) -> Vec<View> {
    (0..case.cameras.len()).map(|camera| view(case, camera)).collect()
}

fn view(case: &Case, number: usize) -> View {
    let camera = case.cameras[number].clone();
    let (width, height) = camera.size_px();
    let scene = camera.scene.scene(width, height);
    let at: Vec<Option<FrameAt>> = case.ticks.iter().map(|tick| tick.frames[number]).collect();
    let frames_ns: Vec<i64> = at.iter().flatten().map(|frame| frame.t_ns).collect();
    let times_ns = pose_times_ns(&frames_ns);
    let seconds = |t_ns: i64| camera.scene_ns(t_ns) as f64 * 1e-9;
    let track = |pose_at: &dyn Fn(f64) -> Pose| {
        let poses = times_ns.iter().map(|&t_ns| pose_at(seconds(t_ns))).collect();
        PoseTrack::new(times_ns.clone(), poses).expect("ascending times")
    };
    let mut lens = scene.intrinsics();
    if camera.geometry.is_some_and(|geometry| geometry.fisheye) {
        let focal_px = 0.37 * f64::from(width);
        let (x_px, y_px) = (0.48 * f64::from(width), 0.49 * f64::from(height));
        lens = Intrinsics::fisheye(focal_px, 0.97 * focal_px, x_px, y_px).expect("a lens");
    }
    let mut poses = SceneMotion::new(lens, track(&|t_s| scene.camera_pose(t_s)));
    for id in scene.instances() {
        let known = |t_s| scene.instance_pose(id, t_s).expect("an id of this scene");
        poses.insert(id, track(&known)).expect("one id");
    }
    let motion = camera.motion.unwrap_or(MotionFormat::F32x2);
    let mut previous_ns = None;
    let frames = (0..)
        .zip(&at)
        .map(|(tick, frame)| {
            let FrameAt { t_ns, spoils } = (*frame)?;
            let scene_ns = camera.scene_ns(t_ns);
            let Frame { hdr, motion, depth, ids } =
                render_cpu(&scene, scene_ns, previous_ns, camera.hdr, motion);
            previous_ns = Some(scene_ns);
            let mut images = Images { t_ns, hdr, motion, depth, ids: ids_as(&ids, &camera) };
            spoil(&mut images, spoils, &camera, tick);
            Some(images)
        })
        .collect();
    View { case: camera, lens, poses, frames }
}

fn pose_times_ns(frames_ns: &[i64]) -> Vec<i64> {
    let mut times_ns: Vec<i64> = frames_ns
        .windows(2)
        .flat_map(|pair| {
            let (start_ns, length_ns) = (pair[0], pair[1] - pair[0]);
            (0..POSES_AN_INTERVAL).map(move |i| start_ns + length_ns * i / POSES_AN_INTERVAL)
        })
        .chain(frames_ns.last().copied())
        .collect();
    // Intervals of some nanoseconds have fewer.
    times_ns.dedup();
    if times_ns.is_empty() { vec![0] } else { times_ns }
}

fn ids_as(ids: &[u8], camera: &CameraCase) -> Vec<u8> {
    match camera.geometry.and_then(|geometry| geometry.ids) {
        Some(IdFormat::U16) => {
            let ids: Vec<u32> = bytemuck::pod_collect_to_vec(ids);
            ids.iter().flat_map(|&id| (id as u16).to_le_bytes()).collect()
        }
        _ => ids.to_vec(),
    }
}

/// A number that says which pixels are spoiled, and how.
fn word(pixel: usize, tick: u32, what: u32) -> u32 {
    philox4x32_10([pixel as u32, tick, what, 0], [9, 0])[0]
}

fn spoil(images: &mut Images, spoils: Spoils, camera: &CameraCase, tick: u32) {
    let pixels = camera.sensor.pixels();
    let struck = |what: u32, one_in: u32| {
        (0..pixels).filter(move |&pixel| one_in > 0 && word(pixel, tick, what).is_multiple_of(one_in))
    };
    for pixel in struck(0, spoils.colour_one_in) {
        let bad = [f64::NAN, f64::INFINITY, -1.0, f64::NEG_INFINITY][word(pixel, tick, 10) as usize % 4];
        let channel = word(pixel, tick, 11) as usize % 3;
        match camera.hdr {
            HdrFormat::F32x4 => put(&mut images.hdr, 4 * pixel + channel, &(bad as f32).to_le_bytes()),
            HdrFormat::F16x4 => {
                put(&mut images.hdr, 4 * pixel + channel, &half::f16::from_f64(bad).to_le_bytes());
            }
            // All its values are valid.
            HdrFormat::Srgb8x4 => {}
        }
    }
    for pixel in struck(1, spoils.motion_one_in) {
        let bad = [f64::NAN, f64::INFINITY, 1e30, f64::NAN][word(pixel, tick, 12) as usize % 4];
        let axis = word(pixel, tick, 13) as usize % 2;
        match camera.motion {
            Some(MotionFormat::F16x2) => {
                put(&mut images.motion, 2 * pixel + axis, &half::f16::from_f64(bad).to_le_bytes());
            }
            Some(MotionFormat::F32x4) => {
                put(&mut images.motion, 4 * pixel + axis, &(bad as f32).to_le_bytes())
            }
            _ => put(&mut images.motion, 2 * pixel + axis, &(bad as f32).to_le_bytes()),
        }
    }
    for pixel in struck(2, spoils.depth_one_in) {
        let bad = [f32::NAN, -1.0, 0.0, f32::INFINITY][word(pixel, tick, 14) as usize % 4];
        put(&mut images.depth, pixel, &bad.to_le_bytes());
    }
    for pixel in struck(3, spoils.ids_one_in) {
        match camera.geometry.and_then(|geometry| geometry.ids) {
            Some(IdFormat::U16) => put(&mut images.ids, pixel, &UNKNOWN_ID.to_le_bytes()),
            _ => put(&mut images.ids, pixel, &u32::from(UNKNOWN_ID).to_le_bytes()),
        }
    }
}

/// Puts a value into a row of values of its size.
fn put<const BYTES: usize>(row: &mut [u8], index: usize, value: &[u8; BYTES]) {
    row[index * BYTES..(index + 1) * BYTES].copy_from_slice(value);
}

#[test]
fn moved_vectors_are_others_but_for_those_at_rest_and_invalid_ones() {
    let by_px = [4e-6, -4e-6];
    assert_eq!(moved([0.0, -0.0], by_px), [0.0, 0.0]);
    assert_eq!(moved([4e-16, 0.5], by_px), [0.0, 0.5 - 4e-6]);
    assert_eq!(moved([-4e-16, 0.5], [0.0, 0.0]), [0.0, 0.5]);
    // The last bit of so long a vector is more.
    assert_eq!(moved([900.0, -900.0], by_px), [900.0_f32.next_up(), (-900.0_f32).next_down()]);
    let invalid = moved([f64::NAN, f64::INFINITY], by_px);
    assert!(invalid[0].is_nan() && invalid[1] == f32::INFINITY);
}
