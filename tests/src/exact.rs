//! A scene whose frames come with depth, instance ids and poses, for what feeds synthesis `rigid`.

use crate::device::DEVICE;
use esaac_engine::{CameraConfig, FrameBytes, GeometryConfig, Rig};
use esaac_formats::scene_file::pose_times_ns;
use esaac_model::paths::{Intrinsics, SceneMotion};
use esaac_model::{DepthFormat, HdrFormat, IdFormat, MotionFormat, Packet, SensorModel, Synthesis};
use esaac_scene::{Frame, Scene, SceneKind, render_cpu};

const RATE_HZ: f64 = 30.0;

/// Frames of a run.
pub const FRAMES: usize = 4;

/// Columns and rows.
pub const SIZE: (u32, u32) = (40, 24);

fn sensor(synthesis: Synthesis) -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        substeps: 8,
        shot_noise_rate_hz: 5.0,
        synthesis,
        ..SensorModel::default()
    }
}

/// A camera of this synthesis that takes depth, ids and poses.
#[must_use]
pub fn config(synthesis: Synthesis, ids: IdFormat, lens: Intrinsics) -> CameraConfig {
    CameraConfig {
        sensor: sensor(synthesis),
        camera: 0,
        hdr: HdrFormat::F16x4,
        motion: Some(MotionFormat::F16x2),
        geometry: Some(GeometryConfig { depth: DepthFormat::F32, ids: Some(ids), lens }),
    }
}

/// A scene with moving bodies, its frames and all its poses.
pub struct Run {
    /// The scene.
    pub scene: Scene,
    /// All poses.
    pub motion: SceneMotion,
    /// Times and frames.
    pub frames: Vec<(i64, Frame)>,
}

impl Default for Run {
    fn default() -> Self {
        let scene = SceneKind::Propeller.scene(SIZE.0, SIZE.1);
        let motion = scene.scene_motion(&pose_times_ns(FRAMES + 1, RATE_HZ, 960.0));
        let mut previous_ns = None;
        let frames = (0..FRAMES)
            .map(|k| {
                let t_ns = (k as f64 * 1e9 / RATE_HZ).round() as i64;
                let frame = render_cpu(&scene, t_ns, previous_ns, HdrFormat::F16x4, MotionFormat::F16x2);
                previous_ns = Some(t_ns);
                (t_ns, frame)
            })
            .collect();
        Run { scene, motion, frames }
    }
}

impl Run {
    /// Its camera.
    #[must_use]
    pub fn config(&self, ids: IdFormat) -> CameraConfig {
        config(Synthesis::Rigid, ids, self.scene.intrinsics())
    }

    /// Ids of a frame in a format.
    #[must_use]
    pub fn ids(&self, index: usize, format: IdFormat) -> Vec<u8> {
        let ids = bytemuck::pod_collect_to_vec::<u8, u32>(&self.frames[index].1.ids);
        match format {
            IdFormat::U32 => self.frames[index].1.ids.clone(),
            IdFormat::U16 => ids.iter().flat_map(|&id| (id as u16).to_le_bytes()).collect(),
        }
    }

    /// Events of some of the frames in one process.
    ///
    /// # Panics
    /// If the engine refuses them.
    #[must_use]
    pub fn alone(&self, indices: &[usize]) -> Vec<Packet> {
        let mut rig = Rig::new(&DEVICE, &[self.config(IdFormat::U32)]).unwrap();
        rig.set_scene(0, self.motion.clone()).unwrap();
        let step = |&index: &usize| {
            let (t_ns, frame) = &self.frames[index];
            let (depth, ids) = (Some(&*frame.depth), Some(&*frame.ids));
            rig.upload(0, &FrameBytes { hdr: &frame.hdr, motion: Some(&frame.motion), depth, ids }).unwrap();
            rig.step(&[*t_ns]).unwrap().packets[0].clone()
        };
        indices.iter().map(step).collect()
    }
}
