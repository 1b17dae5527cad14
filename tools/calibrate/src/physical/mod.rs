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
//! is named. For the second pole, which fast flicker tells and little else, the fit says how far off it may be
//! ([`SecondPole`]).

mod compare;
mod exposure;
mod interval;
mod least_squares;
mod parameters;
mod scene;
mod search;
mod second_pole;
mod simulate;
mod summary;

pub use exposure::{Exposure, Exposures, Flicker, Shape, read_exposures};
pub use scene::fit_scene;
pub use second_pole::SecondPole;
pub use simulate::{Light, expose};
pub use summary::Summary;

use anyhow::{Result, ensure};
use compare::Fit;
use esaac_engine::Device;
use esaac_model::presets::preset_with_physical_pixel;
use esaac_model::{Pixel, SensorModel};
use interval::{Around, look_around, variance};
use parameters::{FITTED, SECOND_POLE, like, shifted};
use search::{Found, ROUNDS, nearest, search, squares};
use serde::Serialize;
use std::sync::Arc;

/// Times that a search may begin anew, where a better second pole was met.
const RESTARTS: usize = 2;

/// A parameter whose standard deviation is larger (mostly as a share) is not told by the exposures.
const NOT_TOLD: f64 = 0.33;

/// Presets whose pixels are first guesses too, if the search does not come near from the given one.
const OTHER_GUESSES: [&str; 3] = ["davis346", "hd", "dvs128"];

/// Guesses that are searched from at most.
const MOST_GUESSES: usize = 3;

/// A misfit that is near: the differences are as large as their errors.
const NEAR: f64 = 1.2;

/// An exposure that differs by more errors is named.
const FAR_OFF: f64 = 3.0;

/// A fitted physical pixel and what the fit rests on.
#[derive(Clone, Debug, Serialize)]
pub struct PhysicalFit {
    /// The sensor.
    pub sensor: SensorModel,
    /// How well the exposures tell the second pole.
    pub second_pole: SecondPole,
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
    let others = OTHER_GUESSES.iter().filter_map(|name| preset_with_physical_pixel(name));
    let others = others.map(|preset| like(guess, &preset)).filter(|other| other != guess);
    let guesses = std::iter::once(guess.clone()).chain(others).take(MOST_GUESSES);
    let found = nearest(guesses, NEAR, |guess| {
        let found = fit_from(device, exposures, &recorded, guess, &mut round)?;
        Ok((misfit(&found.found), found))
    })?;
    let FoundSensor { guess, found, around } = found.expect("there is a first guess");
    let fit = Fit { device, exposures, recorded: &recorded, guess: &guess };
    let sensor = shifted(&guess, &found.point);
    let simulated = fit.simulate(&sensor)?;
    sensor.validate()?;
    let others = FITTED.iter().enumerate().filter(|(number, _)| *number != SECOND_POLE);
    let not_told =
        others.filter(|(number, _)| variance(&found, *number).sqrt() > NOT_TOLD).map(|(_, parameter)| {
            format!("the exposures say little about {}: it may be far off", parameter.name)
        });
    let second_pole = SecondPole::of(sensor.second_pole_hz, around.interval);
    let largest = all.iter().zip(fit.largest(&found.residuals));
    let far_off: Vec<String> = largest
        .filter(|(_, errors)| *errors > FAR_OFF)
        .map(|(exposure, errors)| format!("{} (by {errors:.1} errors)", exposure.name))
        .collect();
    let far_off = (!far_off.is_empty()).then(|| {
        format!(
            "the fit is far from what was recorded in {}, expected at most {FAR_OFF} errors: check the light of the list, \
             or begin at another --guess",
            far_off.join(", ")
        )
    });
    let remarks = not_told.chain(second_pole.remark()).chain(far_off).collect();
    let compared =
        all.iter().zip(&recorded).zip(simulated).map(|((exposure, &recorded), simulated)| Compared {
            name: exposure.name.clone(),
            lux: exposure.lux,
            flicker: exposure.flicker,
            recorded,
            simulated,
        });
    let misfit = misfit(&found);
    Ok(PhysicalFit { exposures: compared.collect(), sensor, second_pole, misfit, remarks })
}

/// Root mean square of the residuals.
fn misfit(found: &Found) -> f64 {
    (squares(&found.residuals) / found.residuals.len() as f64).sqrt()
}

/// What a search finds from one guess.
struct FoundSensor {
    /// The guess, with a refractory period that fits the recordings.
    guess: SensorModel,
    found: Found,
    around: Around,
}

fn fit_from(
    device: &Arc<Device>,
    exposures: &Exposures,
    recorded: &[Summary],
    guess: SensorModel,
    round: &mut impl FnMut(usize, usize),
) -> Result<FoundSensor> {
    let mut sensor = guess;
    // A refractory period is no longer than the shortest gaps.
    let shortest_ns = recorded.iter().map(|summary| summary.short_gap_ns).fold(f64::INFINITY, f64::min);
    if shortest_ns.is_finite() {
        sensor.refractory_ns = shortest_ns.max(1e3) as u32;
    }
    let simulated = Fit { device, exposures, recorded, guess: &sensor }.simulate(&sensor)?;
    // The shortest gaps are longer than the refractory period, by about as much as in the simulation.
    let simulated_ns = simulated.iter().map(|summary| summary.short_gap_ns).fold(f64::INFINITY, f64::min);
    if shortest_ns.is_finite() && simulated_ns.is_finite() {
        sensor.refractory_ns = (shortest_ns * shortest_ns / simulated_ns).max(1e3) as u32;
    }
    let fit = Fit { device, exposures, recorded, guess: &sensor };
    let mut found = search(&fit, vec![0.0; FITTED.len()], |number| round(number, ROUNDS))?;
    let mut around = look_around(&fit, &found, SECOND_POLE)?;
    for _ in 0..RESTARTS {
        let Some(better) = around.better.take() else { break };
        found = search(&fit, better, |number| round(number, ROUNDS))?;
        around = look_around(&fit, &found, SECOND_POLE)?;
    }
    Ok(FoundSensor { guess: sensor, found, around })
}
