//! The S-curve: which share of the pixels answers a small step of the light.

use super::{Lab, at_the_pixel};
use anyhow::Result;
use esaac_calibrate::LightBox;
use esaac_model::physical::noise::{corner_hz, correlation, forgotten, hazard_per_s, sigma_log};
use esaac_model::{Polarity, SensorModel};
use serde::Serialize;
use std::f64::consts::TAU;

/// Light before the step, lux.
const LEVELS_LUX: [f64; 3] = [1.0, 30.0, 1000.0];

/// Steps, from a tenth of a threshold to twice it.
const STEPS: usize = 39;

/// How long a step is watched, in time constants of the corner frequency.
const WATCHED: f64 = 5.0;

/// Share of pixels that answer a step.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct StepAnswer {
    /// The step, nepers.
    pub step_log: f64,
    /// Share of pixels that sent an ON event.
    pub answered: f64,
    /// `Phi((step - threshold) / sqrt(sigma^2 + mismatch^2))`: of a comparator that looks once.
    pub one_look: f64,
    /// The same of one that watches all the time, by the model's law of the noise.
    pub watched: f64,
}

/// The S-curve at a level of light.
#[derive(Clone, Debug, Serialize)]
pub struct SCurve {
    /// Light before the step, lux.
    pub lux: f64,
    /// Standard deviation of the noise, nepers.
    pub sigma_log: f64,
    /// Share of answers at each step.
    pub steps: Vec<StepAnswer>,
    /// The step that half of the pixels answer, nepers.
    pub half_log: f64,
    /// Half the distance of the steps that 16% and 84% answer, nepers.
    pub width_log: f64,
}

/// The S-curves at some levels of light.
pub fn s_curves(lab: &Lab<'_>, sensor: &SensorModel) -> Result<Vec<SCurve>> {
    LEVELS_LUX.iter().map(|&lux| s_curve(lab, sensor, lux)).collect()
}

/// Longest interval in which a pixel is watched, nanoseconds.
const LONGEST_NS: usize = 500_000_000;

/// The S-curve at a level of light. Pixels begin to watch in it, and see the step at once.
pub fn s_curve(lab: &Lab<'_>, sensor: &SensorModel, lux: f64) -> Result<SCurve> {
    let width = lab.pixels as usize;
    let physical = sensor.physical_pixel();
    let dark_lux = physical.dark_lux * physical.thermal_factor();
    let first_per_s = physical.drive_per_s((lux + dark_lux) / physical.lux_per_unit);
    let second_per_s = physical.second_pole_per_s();
    let watched_s = WATCHED / (TAU * corner_hz(first_per_s, second_per_s));
    let sigma = sigma_log(physical.photoreceptor_charge_e, physical.noise_gain, first_per_s, second_per_s);
    let step_log = |row: usize| sensor.contrast_on * 0.05 * (row + 2) as f64;
    let instant = SensorModel { latency_ns: 0, latency_jitter_ns: 0, ..at_the_pixel(sensor) };
    let mut light = LightBox::new(lab.device, &instant, (lab.pixels, STEPS as u32), 16)?;
    light.show(0, |_| lux)?;
    let after = |pixel: usize| (lux + dark_lux) * step_log(pixel / width).exp() - dark_lux;
    let mut answered = vec![false; width * STEPS];
    let begin_ns = 1_000;
    let end_ns = begin_ns + (watched_s * 1e9) as i64;
    // A slow pixel is watched for longer than an interval may be.
    let times_ns = (begin_ns..end_ns).step_by(LONGEST_NS).chain([end_ns]);
    for t_ns in times_ns {
        for event in light.show(t_ns, after)? {
            let pixel = usize::from(event.y) * width + usize::from(event.x);
            answered[pixel] |= event.polarity == Polarity::On;
        }
        lab.progress.tick();
    }
    let watch = Watch {
        threshold_log: sensor.contrast_on,
        mismatch_log: sensor.contrast_mismatch,
        sigma_log: sigma,
        poles_per_s: [first_per_s, second_per_s],
        watched_s,
    };
    let spread = sigma.hypot(sensor.contrast_mismatch).max(1e-9);
    let steps: Vec<StepAnswer> = answered
        .chunks(width)
        .enumerate()
        .map(|(row, answered)| StepAnswer {
            step_log: step_log(row),
            answered: answered.iter().filter(|&&answered| answered).count() as f64 / width as f64,
            one_look: normal_cdf((step_log(row) - sensor.contrast_on) / spread),
            watched: watch.answers(step_log(row)),
        })
        .collect();
    let at = |share: f64| reaches(&steps, share);
    Ok(SCurve { lux, sigma_log: sigma, half_log: at(0.5), width_log: 0.5 * (at(0.84) - at(0.16)), steps })
}

/// A pixel that watches a step.
struct Watch {
    threshold_log: f64,
    mismatch_log: f64,
    sigma_log: f64,
    poles_per_s: [f64; 2],
    watched_s: f64,
}

impl Watch {
    /// Share of pixels that answer a small step: one less the mean, over threshold, noise at the release and noise that
    /// a signal meets, of the chance that neither the signal nor the hazard reaches the threshold.
    fn answers(&self, step_log: f64) -> f64 {
        const TIMES: usize = 40;
        let deviates = || (-4..=4).map(|i| 0.85 * f64::from(i));
        let mass = |x: f64| 0.85 * (-0.5 * x * x).exp() / TAU.sqrt();
        let [first_per_s, second_per_s] = self.poles_per_s;
        let time_s = self.watched_s / TIMES as f64;
        let along: Vec<(f64, f64)> = (1..=TIMES)
            .map(|i| {
                let t_s = (i as f64 - 0.5) * time_s;
                let (p, q) = (first_per_s * t_s, second_per_s * t_s);
                let forgotten = forgotten(p, q);
                (1.0 - correlation(p, q), self.sigma_log * (forgotten * (2.0 - forgotten)).sqrt())
            })
            .collect();
        let mut silent = 0.0;
        for apart in deviates() {
            for released in deviates() {
                let mut spent = 0.0;
                let mut most = f64::INFINITY;
                for &(gone, deviation_log) in &along {
                    // What the step lacks to the threshold: both poles follow it as they forget the noise.
                    let gap_log = self.threshold_log
                        + self.mismatch_log * apart
                        + gone * (self.sigma_log * released - step_log);
                    if deviation_log == 0.0 {
                        most = if gap_log <= 0.0 { f64::NEG_INFINITY } else { most };
                        continue;
                    }
                    most = most.min(gap_log / deviation_log);
                    spent += time_s * hazard_per_s(gap_log / deviation_log, first_per_s, second_per_s);
                }
                // The signal meets the noise `z`: silent only if that lies below the least distance.
                silent += mass(apart) * mass(released) * normal_cdf(most) * (-spent).exp();
            }
        }
        1.0 - silent
    }
}

/// The step at which the share of answers first reaches `share`, between those that were tried.
fn reaches(steps: &[StepAnswer], share: f64) -> f64 {
    let Some(after) = steps.iter().position(|step| step.answered >= share) else { return f64::INFINITY };
    if after == 0 {
        return steps[0].step_log;
    }
    let (low, high) = (steps[after - 1], steps[after]);
    let part = (share - low.answered) / (high.answered - low.answered);
    low.step_log + part * (high.step_log - low.step_log)
}

/// The normal distribution's share below `x` (Abramowitz and Stegun 26.2.17; error below 1e-7).
fn normal_cdf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let series = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let polynomial = series.iter().rev().fold(0.0, |sum, c| (sum + c) * t);
    let tail = (-0.5 * x * x).exp() / TAU.sqrt() * polynomial;
    if x < 0.0 { tail } else { 1.0 - tail }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_distribution_is_right_to_six_digits() {
        for (x, share) in [(0.0, 0.5), (1.0, 0.841_344_75), (-2.0, 0.022_750_13), (4.0, 0.999_968_33)] {
            assert!((normal_cdf(x) - share).abs() < 1e-6, "{x}");
        }
    }
}
