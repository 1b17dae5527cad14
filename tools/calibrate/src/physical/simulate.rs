//! The exposures of a list, with a simulated sensor.

use super::exposure::{Exposure, Flicker, Shape};
use crate::LightBox;
use anyhow::Result;
use esaac_engine::Device;
use esaac_model::SensorModel;
use esaac_model::packet::Event;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Instants in a period of a flicker.
const PER_PERIOD: i64 = 16;

/// Periods before a flicker is counted: the references settle.
const SETTLING: i64 = 3;

/// Time for which still light is counted at most, seconds.
const LONGEST_S: f64 = 40.0;

/// Periods of steps before they are counted, and that are counted at most: every pixel answers each.
const STEP_SETTLING: i64 = 1;
const MOST_STEPS: i64 = 2;

/// Time that a step takes, nanoseconds, and by how much longer each interval after it is than the one before.
const STEP_NS: f64 = 1e3;
const GROWTH: f64 = 1.5;

/// Periods of a flicker that a fit counts at most: each is like the one before, and pixels tell more than periods do.
const MOST_PERIODS: f64 = 4.0;

/// Records one flicker, in whole periods, or still light for its time; long still light and steps not to the end.
///
/// `size_px` are columns and rows of the simulated sensor. Burn-in and settling come before and are left out.
pub fn expose(
    device: &Arc<Device>,
    sensor: &SensorModel,
    size_px: (u32, u32),
    light: &Light,
) -> Result<Exposure> {
    match light.flicker {
        Some(flicker) if flicker.shape == Shape::Step => steps(device, sensor, size_px, light, flicker),
        Some(flicker) => swing(device, sensor, size_px, light, flicker),
        None => Ok(still(device, sensor, size_px, std::slice::from_ref(light))?.remove(0)),
    }
}

/// The light of an exposure.
#[derive(Clone, Debug)]
pub struct Light {
    /// Mean, lux.
    pub lux: f64,
    /// How it swings.
    pub flicker: Option<Flicker>,
    /// Time before, for still light, seconds.
    pub burn_in_s: f64,
    /// Length, seconds.
    pub seconds: f64,
}

impl Light {
    /// That of an exposure, for as long as a fit needs it.
    #[must_use]
    pub fn of(exposure: &Exposure, burn_in_s: f64) -> Self {
        let longest_s = exposure.flicker.map_or(f64::INFINITY, |flicker| MOST_PERIODS / flicker.hz);
        let seconds = exposure.seconds.min(longest_s);
        Light { lux: exposure.lux, flicker: exposure.flicker, burn_in_s, seconds }
    }
}

fn named(light: &Light, size_px: (u32, u32), seconds: f64) -> Exposure {
    Exposure {
        name: String::new(),
        lux: light.lux,
        flicker: light.flicker,
        pixels: size_px.0 as usize * size_px.1 as usize,
        width_px: size_px.0,
        seconds,
        events: Vec::new(),
    }
}

/// Records still lights one below the other on one sensor, all of the first one's burn-in and of the longest one's time.
pub fn still(
    device: &Arc<Device>,
    sensor: &SensorModel,
    (columns, rows): (u32, u32),
    lights: &[Light],
) -> Result<Vec<Exposure>> {
    let Some(first) = lights.first() else { return Ok(Vec::new()) };
    let longest_s = lights.iter().map(|light| light.seconds).fold(0.0, f64::max).min(LONGEST_S).ceil();
    let mut light_box = LightBox::new(device, sensor, (columns, rows * lights.len() as u32), 1)?;
    let mut exposures: Vec<Exposure> =
        lights.iter().map(|light| named(light, (columns, rows), light.seconds.min(longest_s))).collect();
    let burn_in_ns = (first.burn_in_s * 1e9) as i64;
    let of_row = |row: usize| row / rows as usize;
    for second in 0..=(first.burn_in_s.ceil() + longest_s) as i64 {
        let lux = |pixel: usize| lights[of_row(pixel / columns as usize)].lux;
        for mut event in light_box.show(second * 1_000_000_000, lux)? {
            let exposure = &mut exposures[of_row(usize::from(event.y))];
            event.t_ns -= burn_in_ns;
            event.y %= rows as u16;
            if event.t_ns >= 0 && (event.t_ns as f64) < exposure.seconds * 1e9 {
                exposure.events.push(event);
            }
        }
    }
    Ok(exposures)
}

/// The events from an instant on, with times that count from it.
fn counted_from(begin_ns: i64, events: Vec<Event>) -> impl Iterator<Item = Event> {
    let since = events.into_iter().map(move |event| Event { t_ns: event.t_ns - begin_ns, ..event });
    since.filter(|event| event.t_ns >= 0)
}

fn steps(
    device: &Arc<Device>,
    sensor: &SensorModel,
    size_px: (u32, u32),
    light: &Light,
    flicker: Flicker,
) -> Result<Exposure> {
    let periods = ((light.seconds * flicker.hz + 1e-6) as i64).clamp(1, MOST_STEPS);
    let mut light_box = LightBox::new(device, sensor, size_px, 4)?;
    let mut exposure = named(light, size_px, periods as f64 / flicker.hz);
    let half_ns = 0.5e9 / flicker.hz;
    let begin_ns = (STEP_SETTLING as f64 / flicker.hz * 1e9).round() as i64;
    light_box.show(0, |_| light.lux * (1.0 - flicker.depth))?;
    for half in 0..2 * (STEP_SETTLING + periods) {
        let sign = if half % 2 == 1 { 1.0 } else { -1.0 };
        let lux = light.lux * (1.0 + sign * flicker.depth);
        let mut since_ns = STEP_NS.min(half_ns);
        loop {
            let t_ns = (half as f64 * half_ns + since_ns).round() as i64;
            exposure.events.extend(counted_from(begin_ns, light_box.show(t_ns, |_| lux)?));
            if since_ns >= half_ns {
                break;
            }
            // Not to leave a last interval that is too short.
            let next_ns = since_ns * GROWTH + STEP_NS;
            since_ns = if next_ns * GROWTH > half_ns { half_ns } else { next_ns };
        }
    }
    Ok(exposure)
}

fn swing(
    device: &Arc<Device>,
    sensor: &SensorModel,
    size_px: (u32, u32),
    light: &Light,
    flicker: Flicker,
) -> Result<Exposure> {
    // What a product of seconds and hertz lacks of a whole number is rounding.
    let periods = ((light.seconds * flicker.hz + 1e-6) as i64).max(1);
    // Intervals last at most a second.
    let per_period = PER_PERIOD.max((1.1 / flicker.hz).ceil() as i64);
    let mut light_box = LightBox::new(device, sensor, size_px, 4)?;
    let mut exposure = named(light, size_px, periods as f64 / flicker.hz);
    let begin_ns = (SETTLING as f64 / flicker.hz * 1e9) as i64;
    for instant in 0..=(SETTLING + periods) * per_period {
        let turns = instant as f64 / per_period as f64;
        let lux = light.lux * (1.0 + flicker.depth * (TAU * turns).sin());
        let shown = light_box.show((turns / flicker.hz * 1e9) as i64, |_| lux)?;
        exposure.events.extend(counted_from(begin_ns, shown));
    }
    Ok(exposure)
}
