//! Fits a physical pixel to recordings under known light: still light of several levels, and light that flickers.
//!
//! Every parameter is found by simulation: the engine records the same exposures with a guessed sensor, and the guess is
//! moved until event rates agree ([`Summary`]). What says what:
//!
//! | parameter | from |
//! |---|---|
//! | thresholds | events of a period in bright, slow flicker |
//! | first pole (response over charge), second pole | what dim or fast flicker loses; times to the first event after a step |
//! | charge, dark current, leak | noise against light: its height, its dim end, its surplus of one polarity |
//! | mismatch | counts of flicker that differ from pixel to pixel in the same way all the time |
//! | refractory period | the shortest times between two events of a pixel |
//!
//! Still light alone does not tell thresholds: noise knows them in units of itself only. What the exposures do not tell
//! stays near the first guess, and is named.

mod exposure;
mod least_squares;
mod scene;
mod simulate;
mod summary;

pub use exposure::{Exposure, Exposures, Flicker, Shape, read_exposures};
pub use scene::fit_scene;
pub use simulate::{Light, expose};
pub use summary::Summary;

use anyhow::{Result, ensure};
use esaac_engine::Device;
use esaac_model::{Pixel, SensorModel};
use least_squares::{Step, solve};
use serde::Serialize;
use std::sync::Arc;

/// Columns and rows of the simulated sensor, for each exposure.
const SIZE_PX: (u32, u32) = (16, 12);

/// Rounds of moving the guess.
const ROUNDS: usize = 10;

/// Weight of the first guess: a parameter that changes no rate by a tenth of this share stays where it is.
const GUESS: f64 = 0.02;

/// Error of a rate that no number of events makes smaller, as a share.
const FLOOR: f64 = 0.03;

/// A parameter of the fit.
struct Fitted {
    name: &'static str,
    /// Step for derivatives.
    step: f64,
    /// Moves the parameter.
    shift: fn(&mut SensorModel, f64),
}

/// What is fitted together. Positive quantities move by factors. The response stays in step with the charge, since
/// their ratio is the first pole.
const FITTED: [Fitted; 9] = [
    Fitted { name: "contrast_on", step: 0.05, shift: |s, by| s.contrast_on *= by.exp() },
    Fitted { name: "contrast_off", step: 0.05, shift: |s, by| s.contrast_off *= by.exp() },
    Fitted { name: "response_e_per_lux_s", step: 0.15, shift: |s, by| s.response_e_per_lux_s *= by.exp() },
    Fitted { name: "second_pole_hz", step: 0.15, shift: |s, by| s.second_pole_hz *= by.exp() },
    Fitted {
        name: "photoreceptor_charge_e",
        step: 0.1,
        shift: |s, by| {
            s.photoreceptor_charge_e *= by.exp();
            s.response_e_per_lux_s *= by.exp();
        },
    },
    Fitted {
        name: "refractory_ns",
        step: 0.1,
        shift: |s, by| s.refractory_ns = (f64::from(s.refractory_ns) * by.exp()).clamp(1e3, 1e9) as u32,
    },
    Fitted { name: "dark_lux", step: 0.3, shift: |s, by| s.dark_lux *= by.exp() },
    // Hz, in place of nepers.
    Fitted { name: "leak_rate_hz", step: 0.1, shift: |s, by| s.leak_rate_hz += by },
    Fitted {
        name: "contrast_mismatch",
        step: 0.02,
        // As a share of the thresholds.
        shift: |s, by| s.contrast_mismatch += by * 0.5 * (s.contrast_on + s.contrast_off),
    },
];

/// A fitted physical pixel and what the fit rests on.
#[derive(Clone, Debug, Serialize)]
pub struct PhysicalFit {
    /// The sensor.
    pub sensor: SensorModel,
    /// Each exposure's rates, recorded and simulated with the fit.
    pub exposures: Vec<Compared>,
    /// Root mean square of the differences, in their errors.
    pub misfit: f64,
    /// What the exposures do not tell.
    pub remarks: Vec<String>,
}

/// An exposure's rates.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// Recording.
    pub name: String,
    /// Mean light, lux.
    pub lux: f64,
    /// How it swings.
    pub flicker: Option<Flicker>,
    /// Recorded.
    pub recorded: Summary,
    /// Simulated.
    pub simulated: Summary,
}

/// Fits the physical pixel of `guess` to exposures.
///
/// # Errors
/// Too few exposures, exposures without events, and what the engine refuses. `round` is called before each round.
pub fn fit_physical(
    device: &Arc<Device>,
    exposures: &Exposures,
    guess: &SensorModel,
    mut round: impl FnMut(usize, usize),
) -> Result<PhysicalFit> {
    ensure!(
        guess.pixel == Pixel::Physical,
        "the first guess has a log-intensity pixel, expected a physical one"
    );
    let all = &exposures.all;
    let still = all.iter().filter(|exposure| exposure.flicker.is_none()).count();
    let have = if still == 1 { "exposure has" } else { "exposures have" };
    ensure!(still >= 2, "{still} {have} still light, expected at least 2");
    let recorded: Vec<Summary> = all.iter().map(Summary::of).collect();
    for (exposure, summary) in all.iter().zip(&recorded) {
        ensure!(summary.events > 0.0, "{}: no events after the burn-in", exposure.name);
    }
    let fit = Fit { device, exposures, recorded: &recorded };
    let mut sensor = guess.clone();
    // A refractory period is no longer than the shortest gaps.
    let shortest_ns = recorded.iter().map(|summary| summary.short_gap_ns).fold(f64::INFINITY, f64::min);
    if shortest_ns.is_finite() {
        sensor.refractory_ns = shortest_ns.max(1e3) as u32;
    }
    let mut simulated = fit.simulate(&sensor)?;
    // The shortest gaps are longer than the refractory period, by about as much as in the simulation.
    let simulated_ns = simulated.iter().map(|summary| summary.short_gap_ns).fold(f64::INFINITY, f64::min);
    if shortest_ns.is_finite() && simulated_ns.is_finite() {
        sensor.refractory_ns = (shortest_ns * shortest_ns / simulated_ns).max(1e3) as u32;
        simulated = fit.simulate(&sensor)?;
    }
    let mut best = fit.residuals(&simulated);
    let mut told = [0.0; FITTED.len()];
    let mut moved = [0.0; FITTED.len()];
    let mut damping = 0.1;
    for number in 0..ROUNDS {
        round(number, ROUNDS);
        let mut slopes = Vec::new();
        for parameter in &FITTED {
            let shifted = shifted(&sensor, std::slice::from_ref(parameter), &[parameter.step]);
            let residuals = fit.residuals(&fit.simulate(&shifted)?);
            slopes.push(
                best.iter().zip(residuals).map(|(a, b)| (b - a) / parameter.step).collect::<Vec<f64>>(),
            );
        }
        told = std::array::from_fn(|i| slopes[i].iter().map(|slope| slope * slope).sum::<f64>().sqrt());
        let step = Step { slopes: &slopes, residuals: &best, moved: &moved, guess: GUESS, damping };
        let by = solve(&step);
        let candidate = shifted(&sensor, &FITTED, &by);
        let tried = fit.simulate(&candidate)?;
        let residuals = fit.residuals(&tried);
        if norm(&residuals) < norm(&best) {
            (sensor, simulated, best) = (candidate, tried, residuals);
            moved.iter_mut().zip(&by).for_each(|(moved, by)| *moved += by);
            damping *= 0.3;
        } else {
            damping *= 10.0;
        }
    }
    sensor.validate()?;
    // A parameter that moves all rates together by less than their errors over a factor of e is not told.
    let not_told = FITTED.iter().zip(told).filter(|(_, told)| *told < 3.0).map(|(parameter, _)| {
        format!("the exposures say little about {}: it stays near the first guess", parameter.name)
    });
    let remarks = not_told.collect();
    let misfit = (norm(&best) / best.len() as f64).sqrt();
    let compared =
        all.iter().zip(&recorded).zip(simulated).map(|((exposure, &recorded), simulated)| Compared {
            name: exposure.name.clone(),
            lux: exposure.lux,
            flicker: exposure.flicker,
            recorded,
            simulated,
        });
    Ok(PhysicalFit { exposures: compared.collect(), sensor, misfit, remarks })
}

/// The sensor with parameters moved, kept within what sensors may be.
fn shifted(sensor: &SensorModel, parameters: &[Fitted], by: &[f64]) -> SensorModel {
    let mut sensor = sensor.clone();
    for (parameter, &by) in parameters.iter().zip(by) {
        (parameter.shift)(&mut sensor, by);
    }
    sensor.contrast_on = sensor.contrast_on.clamp(0.02, 3.0);
    sensor.contrast_off = sensor.contrast_off.clamp(0.02, 3.0);
    let smaller = sensor.contrast_on.min(sensor.contrast_off);
    sensor.contrast_mismatch = sensor.contrast_mismatch.clamp(0.0, 0.5 * smaller);
    sensor.response_e_per_lux_s = sensor.response_e_per_lux_s.clamp(1.0, 1e9);
    sensor.second_pole_hz = sensor.second_pole_hz.clamp(1.0, 1e6);
    sensor.photoreceptor_charge_e = sensor.photoreceptor_charge_e.clamp(10.0, 1e5);
    sensor.dark_lux = sensor.dark_lux.clamp(1e-5, 1e2);
    sensor.leak_rate_hz = sensor.leak_rate_hz.clamp(-100.0, 100.0);
    sensor
}

fn norm(residuals: &[f64]) -> f64 {
    residuals.iter().map(|r| r * r).sum()
}

struct Fit<'a> {
    device: &'a Arc<Device>,
    exposures: &'a Exposures,
    recorded: &'a [Summary],
}

impl Fit<'_> {
    /// The exposures' rates with a sensor.
    fn simulate(&self, sensor: &SensorModel) -> Result<Vec<Summary>> {
        let lights: Vec<Light> =
            self.exposures.all.iter().map(|e| Light::of(e, self.exposures.burn_in_s)).collect();
        let steady: Vec<Light> = lights.iter().filter(|light| light.flicker.is_none()).cloned().collect();
        let mut steady = simulate::still(self.device, sensor, SIZE_PX, &steady)?.into_iter();
        lights
            .iter()
            .map(|light| {
                let exposure = match light.flicker {
                    Some(_) => expose(self.device, sensor, SIZE_PX, light)?,
                    None => steady.next().expect("one for each still light"),
                };
                Ok(Summary::of(&exposure))
            })
            .collect()
    }

    /// Differences of simulated and recorded rates, in their errors.
    fn residuals(&self, simulated: &[Summary]) -> Vec<f64> {
        let mut residuals = Vec::new();
        for ((exposure, recorded), simulated) in self.exposures.all.iter().zip(self.recorded).zip(simulated) {
            let error = |a: f64, b: f64| (1.0 / (a + 1.0) + 1.0 / (b + 1.0) + FLOOR * FLOOR).sqrt();
            let all = error(recorded.events, simulated.events);
            let ratio = |a: f64, b: f64, least: f64| ((a + least) / (b + least)).ln();
            if recorded.short_gap_ns.is_finite() && simulated.short_gap_ns.is_finite() {
                residuals.push(ratio(simulated.short_gap_ns, recorded.short_gap_ns, 1.0) / FLOOR);
            } else {
                residuals.push(0.0);
            }
            if exposure.flicker.is_some() {
                residuals.push(ratio(simulated.on, recorded.on, 0.02) / all);
                residuals.push(ratio(simulated.off, recorded.off, 0.02) / all);
                residuals.push((simulated.spread - recorded.spread) / 0.02);
                for (simulated, recorded) in
                    [(simulated.rise_ns, recorded.rise_ns), (simulated.fall_ns, recorded.fall_ns)]
                {
                    let told = simulated.is_finite() && recorded.is_finite();
                    residuals.push(if told { ratio(simulated, recorded, 1.0) / FLOOR } else { 0.0 });
                }
            } else {
                let [sum, other] = [simulated, recorded].map(|s| s.on + s.off);
                residuals.push(ratio(sum, other, 1e-3) / all);
                let [surplus, other] = [simulated, recorded].map(|s| s.on - s.off);
                let pixel_s = exposure.pixels as f64 * exposure.seconds;
                // ON and OFF noise come in pairs: what is left over has the error of the leak's own events.
                let error_hz = ((surplus.abs() + other.abs()) / pixel_s).sqrt() + 0.003 + 0.01 * sum;
                residuals.push((surplus - other) / error_hz);
            }
        }
        residuals
    }
}
