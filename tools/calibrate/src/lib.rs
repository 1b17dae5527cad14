//! Fits a sensor to recordings. [`fit`] fits a log-intensity pixel to a scene with APS frames; [`physical`] a physical
//! pixel to exposures of known light.
//!
//! # A log-intensity pixel
//! Thresholds, mismatch, leak and shot noise from events and APS frames.
//!
//! Between two frames the log intensity of a pixel changes by `dL`, and its events say by how much:
//! `C_on n_on - C_off n_off = dL + leak - dx`. The remainder `dx` is smaller than a threshold. [`estimate`] adds this
//! up over all pixels that clearly became brighter and over all that clearly became darker: two equations for the two
//! thresholds. It selects pixels by `dL`, because a selection by counts would bias the counts.
//!
//! The remainder does not vanish in the sums: a pixel that has just turned from brighter to darker still owes most of a
//! threshold. So [`fit`] simulates the recording's own frames with the estimated thresholds, makes the same sums, and
//! corrects the thresholds by the ratio. It repeats this a few times.

mod estimate;
mod light_box;
pub mod physical;
mod simulate;

pub use estimate::{Estimate, Noise, Still, estimate};
pub use light_box::LightBox;
pub use simulate::simulate;

use anyhow::{Result, ensure};
use esaac_engine::Device;
use esaac_formats::recording::Recording;
use esaac_model::{Intensity, SensorModel, Synthesis};
use serde::Serialize;
use std::sync::Arc;

/// A fit needs this many frames: two intervals for each half of the mismatch's data.
pub const FEWEST_FRAMES: usize = 5;

/// Rounds of simulating and moving the thresholds.
const ROUNDS: usize = 4;

/// Range of plausible thresholds; estimates outside are clamped.
const THRESHOLDS_LOG: (f64, f64) = (0.02, 3.0);

/// A fitted sensor and what the fit rests on.
#[derive(Clone, Debug, Serialize)]
pub struct Fit {
    /// The sensor.
    pub sensor: SensorModel,
    /// The estimate before the correction by simulation.
    pub uncorrected: Estimate,
    /// Recorded over simulated threshold in the last round, ON and OFF. Near 1 if the fit has converged.
    pub last_ratio: [f64; 2],
    /// Events of still pixels. The noise rates follow from them.
    pub still: Still,
    /// What could not be determined and why.
    pub remarks: Vec<String>,
}

/// Fits a sensor to a recording. `log_offset` belongs to the frames' intensities, full scale being 1. Fails if the
/// recording has too few frames or too little change.
pub fn fit(device: &Arc<Device>, recording: &Recording, log_offset: f64) -> Result<Fit> {
    let frames = recording.frames.len();
    ensure!(
        frames >= FEWEST_FRAMES,
        "the recording has {frames} APS frames, expected at least {FEWEST_FRAMES}"
    );
    ensure!(!recording.events.is_empty(), "the recording has no events");
    let mut remarks = Vec::new();
    let measured = estimate(recording, &recording.events, log_offset)?;
    let base = SensorModel {
        name: "calibrated".to_owned(),
        width: recording.width_px,
        height: recording.height_px,
        intensity: Intensity::Gray,
        log_offset,
        synthesis: Synthesis::Linear,
        timestamp_quantum_ns: 1_000,
        ..SensorModel::default()
    };
    let clamp = |c: f64| c.clamp(THRESHOLDS_LOG.0, THRESHOLDS_LOG.1);
    let mut thresholds = [measured.contrast_on, measured.contrast_off].map(clamp);
    let (leak, shot) = match measured.still.noise() {
        Some(Noise { leak_rate_hz, shot_noise_rate_hz }) => (leak_rate_hz, shot_noise_rate_hz),
        None => (0.0, 0.0),
    };
    let with = |[contrast_on, contrast_off]: [f64; 2]| {
        let mismatch = measured.mismatch * 0.5 * (contrast_on + contrast_off);
        SensorModel {
            contrast_on,
            contrast_off,
            contrast_mismatch: mismatch.clamp(0.0, 0.5 * contrast_on.min(contrast_off)),
            leak_rate_hz: leak.clamp(0.0, 100.0),
            shot_noise_rate_hz: shot.clamp(0.0, 50.0),
            ..base.clone()
        }
    };
    let mut last_ratio = [1.0; 2];
    for _ in 0..ROUNDS {
        let sensor = with(thresholds);
        let events = simulate(device, recording, &sensor)?;
        let simulated = estimate(recording, &events, log_offset)?;
        last_ratio =
            [measured.contrast_on / simulated.contrast_on, measured.contrast_off / simulated.contrast_off];
        for (threshold, ratio) in thresholds.iter_mut().zip(last_ratio) {
            *threshold = clamp(*threshold * ratio);
        }
    }
    let [contrast_on, contrast_off] = thresholds;
    if measured.still.pixel_s < estimate::ENOUGH_STILL_PIXEL_S {
        remarks.push(format!(
            "only {:.0} pixel-seconds stand still, expected at least {:.0}: leak and shot noise are left at 0",
            measured.still.pixel_s,
            estimate::ENOUGH_STILL_PIXEL_S
        ));
    }
    let smaller = contrast_on.min(contrast_off);
    let mismatch = measured.mismatch * 0.5 * (contrast_on + contrast_off);
    if mismatch > 0.5 * smaller {
        remarks.push(format!(
            "pixels differ by {mismatch:.3} log, more than half the smaller threshold: motion between frames or \
             noise of the frames is in it; the mismatch is set to that bound"
        ));
    }
    for (what, rate, most) in [("leak", leak, 100.0), ("shot noise", shot, 50.0)] {
        if rate > most {
            remarks.push(format!("{what} of {rate:.1} Hz is beyond the model's {most} Hz and set to that"));
        }
    }
    let exposure_ns = recording.frames[0].end_ns - recording.frames[0].start_ns;
    let sensor = SensorModel {
        aps_exposure_ns: exposure_ns.clamp(0, 1_000_000_000) as u32,
        // The fit simulates without motion vectors, which a recording lacks. A renderer's frames have them, so the
        // sensor file gets the default synthesis.
        synthesis: SensorModel::default().synthesis,
        ..with(thresholds)
    };
    sensor.validate()?;
    Ok(Fit { sensor, still: measured.still.clone(), uncorrected: measured, last_ratio, remarks })
}
