//! The operations during which faults strike, and what they need: two sensors and the frames of their cameras.

use esaac_model::{Intensity, SensorModel, SubstepPolicy, Synthesis, Timestamps};
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

/// One operation on a rig.
#[derive(Clone, Debug)]
pub enum Operation {
    Step,
    Change(usize, SensorModel),
    Reset(usize),
}

pub const FRAMES: usize = 8;

pub fn operations() -> Vec<Operation> {
    let bayer = SensorModel { intensity: Intensity::BayerRggb, ..flashing() };
    let quicker = SensorModel { latency_ns: 3_000_000, contrast_on: 0.15, ..delayed() };
    vec![
        Operation::Step,
        Operation::Step,
        Operation::Change(0, bayer),
        Operation::Step,
        Operation::Step,
        Operation::Change(1, quicker),
        Operation::Step,
        Operation::Change(0, flashing()),
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
