//! A physical pixel from a scene with APS frames, whose light is known on the whole only.
//!
//! Thresholds are fitted as those of a log-intensity pixel are: the sums of the simulated recording must be those of the
//! real one, and so must the time that almost no gap between two events of a pixel falls short of. Speed, noise and
//! dark current stay those of the guess: still pixels of a scene are too few, and their light is not known.

use crate::{THRESHOLDS_LOG, estimate, simulate};
use anyhow::{Result, ensure};
use esaac_engine::Device;
use esaac_formats::recording::Recording;
use esaac_model::packet::Event;
use esaac_model::{Intensity, Pixel, SensorModel, Synthesis};
use std::sync::Arc;

/// Rounds of simulating and moving the parameters.
const ROUNDS: usize = 5;

/// Share of gaps that fall short: what the sensor's clock and bus misplace.
const SHORT: f64 = 5e-4;

/// Refractory periods that the shortest gaps are at most if they tell it. In a slow scene they are longer.
const TELLING: i64 = 2;

/// Fits the physical pixel of `guess`, with its `lux_per_unit` for the frames' full scale, to a recording. `log_offset`
/// belongs to the frames' intensities in the sums.
///
/// # Errors
/// As those of [`fit`](crate::fit), and a guess with a log-intensity pixel.
pub fn fit_scene(
    device: &Arc<Device>,
    recording: &Recording,
    log_offset: f64,
    guess: &SensorModel,
) -> Result<SensorModel> {
    ensure!(
        guess.pixel == Pixel::Physical,
        "the first guess has a log-intensity pixel, expected a physical one"
    );
    let coarse = crate::fit(device, recording, log_offset)?;
    let measured = &coarse.uncorrected;
    let mut sensor = SensorModel {
        name: "calibrated".to_owned(),
        width: recording.width_px,
        height: recording.height_px,
        intensity: Intensity::Gray,
        synthesis: Synthesis::Linear,
        timestamp_quantum_ns: 1_000,
        contrast_on: coarse.sensor.contrast_on,
        contrast_off: coarse.sensor.contrast_off,
        contrast_mismatch: coarse.sensor.contrast_mismatch,
        // Measured at the guess's temperature; the parameter is the rate at 25 C.
        leak_rate_hz: coarse.sensor.leak_rate_hz / guess.physical_pixel().thermal_factor(),
        ..guess.clone()
    };
    let gap_ns = |events: &[Event]| short_gap_ns(events, recording.width_px);
    let recorded_ns = gap_ns(&recording.events);
    for _ in 0..ROUNDS {
        let events = simulate(device, recording, &sensor)?;
        let simulated = estimate(recording, &events, log_offset)?;
        if let (Some(recorded_ns), Some(simulated_ns)) = (recorded_ns, gap_ns(&events)) {
            // Gaps tell the period only where it is what makes them long.
            let period_ns = i64::from(sensor.refractory_ns);
            if simulated_ns < TELLING * period_ns {
                let moved_ns = period_ns + recorded_ns - simulated_ns;
                sensor.refractory_ns = moved_ns.clamp(0, recorded_ns.max(0)).min(1_000_000_000) as u32;
            }
        }
        let ratio = |measured: f64, simulated: f64| (measured / simulated).clamp(0.5, 2.0);
        let clamp = |contrast: f64| contrast.clamp(THRESHOLDS_LOG.0, THRESHOLDS_LOG.1);
        sensor.contrast_on = clamp(sensor.contrast_on * ratio(measured.contrast_on, simulated.contrast_on));
        sensor.contrast_off =
            clamp(sensor.contrast_off * ratio(measured.contrast_off, simulated.contrast_off));
        // The mismatch's sum takes in what frames blur and what noise adds; both are in the simulation as well.
        if simulated.mismatch > 0.0 {
            sensor.contrast_mismatch *= ratio(measured.mismatch, simulated.mismatch);
        }
        let smaller = sensor.contrast_on.min(sensor.contrast_off);
        sensor.contrast_mismatch = sensor.contrast_mismatch.min(0.5 * smaller);
    }
    sensor.synthesis = SensorModel::default().synthesis;
    sensor.validate()?;
    Ok(sensor)
}

/// The time that almost no gap between two events of a pixel falls short of, nanoseconds; `None` if there are too few.
fn short_gap_ns(events: &[Event], width_px: u32) -> Option<i64> {
    let mut last_ns = std::collections::HashMap::new();
    let mut gaps_ns = Vec::new();
    for event in events {
        let pixel = u32::from(event.y) * width_px + u32::from(event.x);
        gaps_ns.extend(last_ns.insert(pixel, event.t_ns).map(|before_ns| event.t_ns - before_ns));
    }
    gaps_ns.sort_unstable();
    let short = (SHORT * gaps_ns.len() as f64) as usize;
    (short > 0).then(|| gaps_ns[short])
}
