//! Speed: bandwidth, latency and refractory period.

use super::{Lab, at_the_pixel, without_noise};
use anyhow::Result;
use esaac_calibrate::LightBox;
use esaac_model::physical::noise::corner_hz;
use esaac_model::physical::photoreceptor::{Drive, Photoreceptor, advance};
use esaac_model::{Polarity, SensorModel};
use serde::Serialize;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Light at which the bandwidth is measured, lux.
const BANDWIDTH_LUX: [f64; 6] = [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0];

/// Frequencies at which a light is modulated, over the model's corner.
const RATIOS: [f64; 9] = [0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.6];

/// Depth of the modulation.
const DEPTH: f64 = 0.1;

/// Thresholds through which the modulation is read, as a share of its swing.
const READING: f64 = 0.005;

/// Largest such share at which events still tell the swing.
const COARSEST_READING: f64 = 0.02;

/// Lowest threshold that a sensor may have, log.
const LOWEST_THRESHOLD_LOG: f64 = 1e-4;

/// Light after a step, lux, at which latencies are measured.
const LATENCY_LUX: [f64; 11] = [0.03, 0.1, 0.3, 1.0, 1.5, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0];

/// Pixels that see the same step.
const LATENCY_PIXELS: usize = 32;

/// Light to which a pixel rises from darkness when its refractory period is measured, lux.
const RISE_LUX: [f64; 7] = [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6];

/// Pixels that see the same rise.
const RISE_PIXELS: usize = 64;

/// Gaps between two events of a pixel in a rise from darkness.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RefractoryPoint {
    /// Light after the rise, lux.
    pub lux: f64,
    /// Shortest gap, microseconds; infinite if no pixel had two events.
    pub shortest_us: f64,
    /// Median gap, microseconds.
    pub median_us: f64,
}

/// The corner frequency at a level of light.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BandwidthPoint {
    /// Light, lux.
    pub lux: f64,
    /// Frequency at which events show the modulation of the light reduced by 3 dB, Hz; NaN (`null` in JSON) if they do
    /// not tell.
    pub f3db_hz: f64,
    /// The same by the model's equation.
    pub model_hz: f64,
}

/// A step of the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LightStep {
    /// From half the light; ON.
    Doubled,
    /// From darkness; ON.
    FromDark,
    /// To half the light; OFF.
    Halved,
    /// To darkness; OFF.
    ToDark,
}

impl LightStep {
    /// All of them.
    pub const ALL: [LightStep; 4] =
        [LightStep::Doubled, LightStep::FromDark, LightStep::Halved, LightStep::ToDark];

    /// Light before and after, lux, where `lux` is the brighter of both.
    #[must_use]
    pub fn ends_lux(self, lux: f64) -> (f64, f64) {
        match self {
            LightStep::Doubled => (0.5 * lux, lux),
            LightStep::FromDark => (0.0, lux),
            LightStep::Halved => (lux, 0.5 * lux),
            LightStep::ToDark => (lux, 0.0),
        }
    }

    /// Polarity of the events.
    #[must_use]
    pub fn polarity(self) -> Polarity {
        match self {
            LightStep::Doubled | LightStep::FromDark => Polarity::On,
            LightStep::Halved | LightStep::ToDark => Polarity::Off,
        }
    }

    /// Name in a plot.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            LightStep::Doubled => "ON, light doubles",
            LightStep::FromDark => "ON, from darkness",
            LightStep::Halved => "OFF, light halves",
            LightStep::ToDark => "OFF, to darkness",
        }
    }
}

/// Latency after a step.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LatencyPoint {
    /// The step.
    pub step: LightStep,
    /// The brighter light, lux.
    pub lux: f64,
    /// Median time to the first event, microseconds.
    pub median_us: f64,
    /// Half the time between the 16th and the 84th percentile, microseconds.
    pub jitter_us: f64,
    /// Share of pixels that answer.
    pub answered: f64,
    /// Time by the model's equations without noise, microseconds.
    pub model_us: f64,
}

/// The bandwidth against light.
pub fn bandwidth(lab: &Lab<'_>, sensor: &SensorModel) -> Result<Vec<BandwidthPoint>> {
    BANDWIDTH_LUX.iter().map(|&lux| bandwidth_at(lab, sensor, lux)).collect()
}

/// The bandwidth at a level of light. Events of a pixel without noise and with tiny thresholds count the swing of what
/// the photoreceptor shows.
pub fn bandwidth_at(lab: &Lab<'_>, sensor: &SensorModel, lux: f64) -> Result<BandwidthPoint> {
    let physical = sensor.physical_pixel();
    let dark_lux = physical.dark_lux * physical.thermal_factor();
    let swing_log = ((lux * (1.0 + DEPTH) + dark_lux) / (lux * (1.0 - DEPTH) + dark_lux)).ln();
    let threshold_log = (READING * swing_log).max(LOWEST_THRESHOLD_LOG);
    let first_per_s = physical.drive_per_s((lux + dark_lux) / physical.lux_per_unit);
    let model_hz = corner_hz(first_per_s, physical.second_pole_per_s());
    if threshold_log > COARSEST_READING * swing_log {
        // The dark current drowns the light: hardly an event of it is left.
        return Ok(BandwidthPoint { lux, f3db_hz: f64::NAN, model_hz });
    }
    let reader = without_noise(sensor, threshold_log);
    let mut light = LightBox::new(lab.device, &reader, (RATIOS.len() as u32, 1), 4)?;
    let step_s = 1.0 / (48.0 * model_hz);
    // Each frequency settles for two periods of its own, then two are counted.
    let last = (4.0 / RATIOS[0] * 48.0).ceil() as i64;
    let mut counts = [0.0; RATIOS.len()];
    for step in 0..=last {
        let t_s = step as f64 * step_s;
        let shown = |pixel: usize| lux * (1.0 - DEPTH * (TAU * RATIOS[pixel] * model_hz * t_s).cos());
        for event in light.show((t_s * 1e9).round() as i64, shown)? {
            let periods = event.t_ns as f64 * 1e-9 * RATIOS[usize::from(event.x)] * model_hz;
            if (2.0..4.0).contains(&periods) {
                counts[usize::from(event.x)] += 0.5;
            }
        }
        lab.progress.tick();
    }
    // ON and OFF events of two periods, halved twice: the swing in thresholds.
    let gains = counts.map(|count| 0.5 * count * threshold_log / swing_log);
    let f3db_hz = model_hz * falls_to(&gains, FRAC_1_SQRT_2);
    Ok(BandwidthPoint { lux, f3db_hz, model_hz })
}

/// Ratio at which the gain falls to `least`, between those that were measured; NaN if it falls before or after them.
fn falls_to(gains: &[f64], least: f64) -> f64 {
    let Some(after) = gains.iter().position(|&gain| gain < least).filter(|after| *after > 0) else {
        return f64::NAN;
    };
    let (high, low) = (gains[after - 1], gains[after]);
    let share = (high - least) / (high - low);
    (RATIOS[after - 1].ln() * (1.0 - share) + RATIOS[after].ln() * share).exp()
}

/// The latency against light and contrast, without the bus and the tick of time stamps.
pub fn latency(lab: &Lab<'_>, sensor: &SensorModel) -> Result<Vec<LatencyPoint>> {
    latency_at(lab, sensor, &LATENCY_LUX)
}

/// The same at each of `levels_lux`.
pub fn latency_at(lab: &Lab<'_>, sensor: &SensorModel, levels_lux: &[f64]) -> Result<Vec<LatencyPoint>> {
    let width = LATENCY_PIXELS * LightStep::ALL.len();
    let size = (width as u32, levels_lux.len() as u32);
    let mut light = LightBox::new(lab.device, &at_the_pixel(sensor), size, 8)?;
    let ends =
        |pixel: usize| LightStep::ALL[pixel % width / LATENCY_PIXELS].ends_lux(levels_lux[pixel / width]);
    let mut first_ns = vec![None; width * levels_lux.len()];
    light.show(0, |pixel| ends(pixel).0)?;
    let (mut t_ns, mut step_ns) = (0_i64, 1_000_i64);
    // The step takes a microsecond. Then the light stays for a second, which is watched in ever longer intervals.
    while t_ns < 1_000_000_000 {
        t_ns += step_ns;
        step_ns = (t_ns / 4).max(1_000);
        for event in light.show(t_ns, |pixel| ends(pixel).1)? {
            let pixel = usize::from(event.y) * width + usize::from(event.x);
            if event.polarity == LightStep::ALL[usize::from(event.x) / LATENCY_PIXELS].polarity() {
                first_ns[pixel].get_or_insert(event.t_ns);
            }
        }
        lab.progress.tick();
    }
    let mut points = Vec::new();
    for (row, &lux) in levels_lux.iter().enumerate() {
        for (group, &step) in LightStep::ALL.iter().enumerate() {
            let from = row * width + group * LATENCY_PIXELS;
            let mut answers: Vec<f64> =
                first_ns[from..from + LATENCY_PIXELS].iter().flatten().map(|&ns| ns as f64 * 1e-3).collect();
            answers.sort_unstable_by(f64::total_cmp);
            let at = |share: f64| answers.get((share * answers.len() as f64) as usize).copied();
            points.push(LatencyPoint {
                step,
                lux,
                median_us: at(0.5).unwrap_or(f64::INFINITY),
                jitter_us: 0.5 * (at(0.84).unwrap_or(f64::INFINITY) - at(0.16).unwrap_or(0.0)),
                answered: answers.len() as f64 / LATENCY_PIXELS as f64,
                model_us: latency_model_us(sensor, step, lux),
            });
        }
    }
    Ok(points)
}

/// Time from a step to the threshold by the model's equations without noise, with the sensor's fixed delay,
/// microseconds; infinite if the step does not reach it.
#[must_use]
pub fn latency_model_us(sensor: &SensorModel, step: LightStep, lux: f64) -> f64 {
    let physical = sensor.physical_pixel();
    let dark_lux = physical.dark_lux * physical.thermal_factor();
    let (from, to) = step.ends_lux(lux);
    let change_log = ((to + dark_lux) / (from + dark_lux)).ln();
    let threshold_log =
        if step.polarity() == Polarity::On { sensor.contrast_on } else { sensor.contrast_off };
    if change_log.abs() <= threshold_log {
        return f64::INFINITY;
    }
    let start_per_s = physical.drive_per_s((to + dark_lux) / physical.lux_per_unit);
    let second_pole_per_s = physical.second_pole_per_s();
    let mut state = Photoreceptor { excess: change_log.exp_m1(), lag_log: -change_log };
    let mut t_s = 0.0;
    let left_log = change_log.abs() - threshold_log;
    let mut step_s = 1e-7;
    loop {
        let drive = Drive { start_per_s, change_log: 0.0, duration_s: step_s, second_pole_per_s };
        let (next, _) = advance(state, &drive);
        if next.lag_log.abs() <= left_log {
            let share = (state.lag_log.abs() - left_log) / (state.lag_log.abs() - next.lag_log.abs());
            return (t_s + share * step_s) * 1e6 + f64::from(sensor.latency_ns) * 1e-3;
        }
        (state, t_s) = (next, t_s + step_s);
        step_s = (0.01 * t_s).max(1e-7);
    }
}

/// Gaps between two events of a pixel whose light rises from darkness by decades: the refractory period and the time to
/// the next threshold, which is the shorter the brighter the light.
pub fn refractory(lab: &Lab<'_>, sensor: &SensorModel) -> Result<Vec<RefractoryPoint>> {
    let size = (RISE_PIXELS as u32, RISE_LUX.len() as u32);
    // Jitter moves each event by itself, and would make gaps of any length.
    let without_delay = SensorModel { latency_ns: 0, latency_jitter_ns: 0, ..at_the_pixel(sensor) };
    let mut light = LightBox::new(lab.device, &without_delay, size, 64)?;
    light.show(0, |_| 0.0)?;
    let mut last_ns = [[None; RISE_PIXELS]; RISE_LUX.len()];
    let mut gaps_us = vec![Vec::new(); RISE_LUX.len()];
    for t_ns in [1_000, 100_000, 300_000, 1_000_000, 3_000_000, 10_000_000, 30_000_000] {
        for event in light.show(t_ns, |pixel| RISE_LUX[pixel / RISE_PIXELS])? {
            let row = usize::from(event.y);
            if let Some(before_ns) = last_ns[row][usize::from(event.x)].replace(event.t_ns) {
                gaps_us[row].push((event.t_ns - before_ns) as f64 * 1e-3);
            }
        }
    }
    lab.progress.tick();
    let point = |(lux, mut gaps_us): (f64, Vec<f64>)| {
        gaps_us.sort_unstable_by(f64::total_cmp);
        let at = |place: usize| gaps_us.get(place).copied().unwrap_or(f64::INFINITY);
        RefractoryPoint { lux, shortest_us: at(0), median_us: at(gaps_us.len() / 2) }
    };
    Ok(RISE_LUX.into_iter().zip(gaps_us).map(point).collect())
}
