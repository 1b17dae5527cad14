//! The operations during which faults strike, and what they need: two sensors and the frames of their cameras.

use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::{Intensity, ReadoutKind, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use esaac_tests::frames::{Sequence, gray, intensity_of, times};

/// A sensor that stamps events with the ends of sub-steps. When the light jumps, all events lie in one bin: the event
/// queue of `cross` overflows, event buffers grow, and `merge` sorts the packet.
pub fn flashing() -> SensorModel {
    SensorModel {
        width: 16,
        height: 16,
        synthesis: Synthesis::Linear,
        substeps: 1,
        timestamps: Timestamps::AtSample,
        contrast_on: 0.2,
        contrast_off: 0.2,
        contrast_mismatch: 0.02,
        aps_exposure_ns: 5_000_000,
        ..SensorModel::default()
    }
}

/// A sensor with noise, and with events deferred to later packets.
pub fn delayed() -> SensorModel {
    SensorModel {
        width: 19,
        height: 9,
        synthesis: Synthesis::Linear,
        substeps: 4,
        substep_policy: SubstepPolicy::Fixed,
        shot_noise_rate_hz: 40.0,
        latency_ns: 20_000_000,
        latency_jitter_ns: 100_000,
        refractory_ns: 1000,
        ..SensorModel::default()
    }
}

/// The first sensor as it follows surfaces along exact paths.
pub fn following() -> SensorModel {
    SensorModel { synthesis: Synthesis::Rigid, substeps: 6, aps_exposure_ns: 0, ..flashing() }
}

/// The lens of the first camera.
pub fn lens() -> Intrinsics {
    Intrinsics::pinhole(14.0, 14.0, 7.5, 7.5).expect("a lens")
}

/// Poses for all frames of the first camera, which moves sideways before instances that rest.
pub fn scene(instances: u32) -> SceneMotion {
    let end = Pose::from_xyz_qxyzw(&[0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).expect("a pose");
    let end_ns = *times(0, FRAMES).last().expect("frames");
    let camera = PoseTrack::new(vec![0, end_ns], vec![Pose::IDENTITY, end]).expect("a track");
    let mut scene = SceneMotion::new(lens(), camera);
    for id in 1..=instances {
        scene.insert(id, PoseTrack::still(Pose::IDENTITY)).expect("one id");
    }
    scene
}

/// Depth (f32) and instances (u32) of the first camera: a wall, before it a post of instance 1.
pub fn depth_and_ids() -> (Vec<u8>, Vec<u8>) {
    let post = |pixel: usize| (5..9).contains(&(pixel % 16));
    let pixels = 0..flashing().pixels();
    let depth = pixels.clone().flat_map(|pixel| if post(pixel) { 1.0_f32 } else { 3.0 }.to_le_bytes());
    let ids = pixels.flat_map(|pixel| u32::from(post(pixel)).to_le_bytes());
    (depth.collect(), ids.collect())
}

/// One operation on a rig.
#[derive(Clone, Debug)]
pub enum Operation {
    Step,
    Change(usize, Box<SensorModel>),
    /// Poses for the first camera, and for as many instances.
    Scene(u32),
    Reset(usize),
}

pub const FRAMES: usize = 11;

pub fn operations() -> Vec<Operation> {
    let bayer = SensorModel { intensity: Intensity::BayerRggb, ..flashing() };
    let quicker = SensorModel { latency_ns: 3_000_000, contrast_on: 0.15, ..delayed() };
    let with_a_bus = SensorModel { readout: ReadoutKind::Fifo, seed: 7, ..quicker.clone() };
    vec![
        Operation::Step,
        Operation::Step,
        Operation::Change(0, Box::new(bayer)),
        Operation::Step,
        Operation::Scene(1),
        Operation::Change(0, Box::new(following())),
        Operation::Step,
        Operation::Step,
        Operation::Scene(9),
        Operation::Step,
        Operation::Change(1, Box::new(quicker)),
        Operation::Step,
        Operation::Change(1, Box::new(with_a_bus)),
        Operation::Step,
        Operation::Change(0, Box::new(flashing())),
        Operation::Step,
        Operation::Reset(1),
        Operation::Step,
        Operation::Step,
    ]
}

pub fn sequences() -> [Sequence; 2] {
    // Every other frame is brighter by twenty thresholds.
    let flash = gray(&flashing(), &times(0, FRAMES), |frame, pixel| {
        intensity_of(&flashing(), if frame % 2 == 1 { 0.0 } else { -4.0 } - 0.003 * (pixel % 16) as f64)
    });
    let waves = gray(&delayed(), &times(0, FRAMES), |frame, pixel| {
        intensity_of(&delayed(), -2.0 + (0.9 * frame as f64 + 0.4 * (pixel % 19) as f64).sin())
    });
    [flash, waves]
}
