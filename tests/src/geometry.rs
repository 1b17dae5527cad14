//! Frames with depth, instance ids and poses, from the analytic scenes.

use crate::device::DEVICE;
use esaac_engine::{CameraConfig, FrameBytes, GeometryConfig, Rig, RigOptions};
use esaac_model::paths::{Intrinsics, SceneMotion};
use esaac_model::{DepthFormat, HdrFormat, IdFormat, Intensity, MotionFormat, SensorModel};
use esaac_oracle::synthesize::rigid::Input;
use esaac_oracle::synthesize::rigid::surface::Geometry;
use esaac_scene::{SceneKind, render_cpu};

/// Poses of a scene for each frame, as physics gives them.
const POSES_A_FRAME: i64 = 32;

/// A key frame.
#[derive(Clone, Debug)]
pub struct KeyFrame {
    /// Time.
    pub t_ns: i64,
    /// Colour, f32x4.
    pub hdr: Vec<u8>,
    /// Motion, f32x2.
    pub motion: Vec<u8>,
    /// Depth, f32.
    pub depth: Vec<u8>,
    /// Instances, u32.
    pub ids: Vec<u8>,
    depth_m: Vec<f64>,
    instances: Vec<u32>,
}

/// Key frames of one camera, and its poses.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Columns and rows.
    pub size: (u32, u32),
    /// Poses from the first frame to the last.
    pub scene: SceneMotion,
    /// In order.
    pub frames: Vec<KeyFrame>,
}

impl KeyFrame {
    /// A key frame of the given images.
    #[must_use]
    pub fn new(t_ns: i64, hdr: Vec<u8>, motion: Vec<u8>, depth: Vec<u8>, ids: Vec<u8>) -> Self {
        let words = |bytes: &[u8]| -> Vec<u32> { bytemuck::pod_collect_to_vec(bytes) };
        let depth_m = words(&depth).into_iter().map(|bits| f64::from(f32::from_bits(bits))).collect();
        let instances = words(&ids);
        KeyFrame { t_ns, hdr, motion, depth, ids, depth_m, instances }
    }

    /// For the engine, without motion vectors.
    #[must_use]
    pub fn bytes(&self) -> FrameBytes<'_> {
        FrameBytes { hdr: &self.hdr, motion: None, depth: Some(&self.depth), ids: Some(&self.ids) }
    }

    /// Intensity planes of a sensor, for the oracle: one, or one for each colour of a mosaic.
    #[must_use]
    pub fn planes(&self, sensor: &SensorModel) -> Vec<Vec<f64>> {
        let plane = |weights: [f64; 3]| -> Vec<f64> {
            (0..self.instances.len())
                .map(|pixel| {
                    let rgb = HdrFormat::F32x4.decode(&self.hdr, pixel);
                    let sum: f64 = weights.iter().zip(rgb).map(|(w, c)| w * c).sum();
                    sum * sensor.exposure_gain
                })
                .collect()
        };
        match sensor.intensity {
            Intensity::BayerRggb => {
                vec![plane([1.0, 0.0, 0.0]), plane([0.0, 1.0, 0.0]), plane([0.0, 0.0, 1.0])]
            }
            gray => vec![plane(esaac_model::intensity::weights(gray, 0, 0))],
        }
    }

    /// For the oracle, with its intensity planes.
    #[must_use]
    pub fn input<'a>(&'a self, size: (u32, u32), planes: &'a [Vec<f64>]) -> Input<'a> {
        let size = (size.0 as usize, size.1 as usize);
        let geometry = Geometry { size, depth_m: &self.depth_m, ids: &self.instances };
        Input { t_ns: self.t_ns, planes, geometry }
    }

    /// Depth of each pixel, metres.
    #[must_use]
    pub fn depth_m(&self) -> &[f64] {
        &self.depth_m
    }
}

impl Rendered {
    /// `count` frames of an analytic scene at 30 Hz.
    #[must_use]
    pub fn of(kind: SceneKind, size: (u32, u32), count: usize) -> Self {
        let scene = kind.scene(size.0, size.1);
        let times_ns = crate::frames::times(0, count);
        let last_ns = *times_ns.last().expect("at least one frame");
        let steps = POSES_A_FRAME * (count as i64 - 1);
        let pose_times_ns: Vec<i64> = (0..=steps).map(|i| last_ns * i / steps).collect();
        let mut previous_ns = None;
        let frames = times_ns
            .iter()
            .map(|&t_ns| {
                let image = render_cpu(&scene, t_ns, previous_ns, HdrFormat::F32x4, MotionFormat::F32x2);
                previous_ns = Some(t_ns);
                KeyFrame::new(t_ns, image.hdr, image.motion, image.depth, image.ids)
            })
            .collect();
        Rendered { size, scene: scene.scene_motion(&pose_times_ns), frames }
    }

    /// The camera that takes them.
    #[must_use]
    pub fn camera(&self, sensor: &SensorModel) -> CameraConfig {
        let geometry = geometry(*self.scene.lens());
        CameraConfig {
            sensor: sensor.clone(),
            camera: 0,
            hdr: HdrFormat::F32x4,
            motion: None,
            geometry: Some(geometry),
        }
    }

    /// A rig of that camera, with its poses.
    #[must_use]
    pub fn rig(&self, sensor: &SensorModel, options: RigOptions) -> Rig {
        let mut rig = Rig::with_options(&DEVICE, &[self.camera(sensor)], options).expect("a rig");
        rig.set_scene(0, self.scene.clone()).expect("poses of its lens");
        rig
    }
}

/// Depth as f32 and ids as u32 through a lens.
#[must_use]
pub fn geometry(lens: Intrinsics) -> GeometryConfig {
    GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U32), lens }
}
