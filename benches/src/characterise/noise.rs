//! Noise in still light, and the leak without noise.

use super::Lab;
use anyhow::Result;
use esaac_calibrate::LightBox;
use esaac_model::physical::DOUBLING_K;
use esaac_model::{Polarity, SensorModel};
use serde::Serialize;

/// Light at which noise is counted, focal-plane lux.
const LEVELS_LUX: [f64; 17] =
    [0.003, 0.01, 0.03, 0.08, 0.15, 0.3, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 300.0, 1000.0];

/// Light at which the leak is counted, lux.
const LEAK_LUX: [f64; 6] = [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0];

/// Longest time for which a leak is watched, seconds.
const LONGEST_LEAK_S: f64 = 200.0;

/// Noise at a level of light.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct NoisePoint {
    /// Light, lux.
    pub lux: f64,
    /// ON events of a pixel and second.
    pub on_hz: f64,
    /// OFF events of a pixel and second.
    pub off_hz: f64,
    /// Events of the model's leak at this light, Hz, below 0 for OFF events: what remains in bright light.
    pub leak_hz: f64,
}

impl NoisePoint {
    /// Events of a pixel and second.
    #[must_use]
    pub fn hz(&self) -> f64 {
        self.on_hz + self.off_hz
    }
}

/// Leak at a light and a temperature.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LeakPoint {
    /// Light, lux.
    pub lux: f64,
    /// Temperature, Celsius.
    pub temperature_c: f64,
    /// Events of a pixel and second without noise, below 0 for OFF events.
    pub measured_hz: f64,
    /// The same by the model's equation.
    pub model_hz: f64,
}

/// Counts the noise at each of `levels_lux`, after the burn-in.
pub fn noise_at(lab: &Lab<'_>, sensor: &SensorModel, levels_lux: &[f64]) -> Result<Vec<NoisePoint>> {
    let width = lab.pixels as usize;
    let mut light = LightBox::new(lab.device, sensor, (lab.pixels, levels_lux.len() as u32), 1)?;
    let mut counts = vec![[0_u32; 2]; levels_lux.len()];
    for second in 0..=i64::from(lab.burn_in_s + lab.seconds) {
        for event in light.show(second * 1_000_000_000, |pixel| levels_lux[pixel / width])? {
            // A delay may bring an event of the burn-in here, and keep one of the end back.
            if event.t_ns > i64::from(lab.burn_in_s) * 1_000_000_000 {
                counts[usize::from(event.y)][event.polarity as usize] += 1;
            }
        }
        lab.progress.tick();
    }
    let pixel_s = f64::from(lab.pixels) * f64::from(lab.seconds);
    let point = |(&lux, [off, on]): (&f64, [u32; 2])| NoisePoint {
        lux,
        on_hz: f64::from(on) / pixel_s,
        off_hz: f64::from(off) / pixel_s,
        leak_hz: leak_events_hz(sensor, lux),
    };
    Ok(levels_lux.iter().zip(counts).map(point).collect())
}

/// Leak events of a pixel and second, below 0 for OFF events. The model states a leak in ON thresholds; OFF events come
/// once for each OFF threshold.
fn leak_events_hz(sensor: &SensorModel, lux: f64) -> f64 {
    let leak_hz = sensor.physical_pixel().leak_hz(lux, 1.0);
    if leak_hz < 0.0 { leak_hz * sensor.contrast_on / sensor.contrast_off } else { leak_hz }
}

/// The noise against light.
pub fn noise(lab: &Lab<'_>, sensor: &SensorModel) -> Result<Vec<NoisePoint>> {
    noise_at(lab, sensor, &LEVELS_LUX)
}

/// The sensor's temperature, and one at which the leak in the dark is twice as much; half as much where the chip may not be
/// warmer.
fn temperatures_c(sensor: &SensorModel) -> [f64; 2] {
    let own_c = sensor.temperature_c;
    let warmer = SensorModel { temperature_c: own_c + DOUBLING_K, ..sensor.clone() };
    [own_c, if warmer.validate().is_ok() { warmer.temperature_c } else { own_c - DOUBLING_K }]
}

/// The leak at the sensor's temperature and where it should have doubled or halved in the dark.
pub fn leak(lab: &Lab<'_>, sensor: &SensorModel) -> Result<Vec<LeakPoint>> {
    let mut points = Vec::new();
    for temperature_c in temperatures_c(sensor) {
        let quiet = SensorModel {
            noise_gain: 0.0,
            contrast_mismatch: 0.0,
            leak_spread_log: 0.0,
            temperature_c,
            ..sensor.clone()
        };
        let rates_hz = LEAK_LUX.map(|lux| leak_events_hz(&quiet, lux));
        let slowest_hz =
            rates_hz.iter().map(|hz| hz.abs()).filter(|&hz| hz > 0.0).fold(f64::INFINITY, f64::min);
        let seconds = (2.5 / slowest_hz).ceil().clamp(2.0, LONGEST_LEAK_S) as i64;
        let mut light = LightBox::new(lab.device, &quiet, (1, LEAK_LUX.len() as u32), 1)?;
        let mut times = vec![Vec::new(); LEAK_LUX.len()];
        for second in 0..=seconds {
            for event in light.show(second * 1_000_000_000, |pixel| LEAK_LUX[pixel])? {
                let sign = if event.polarity == Polarity::On { 1.0 } else { -1.0 };
                times[usize::from(event.y)].push((event.t_ns as f64 * 1e-9, sign));
            }
        }
        for ((lux, model_hz), times) in LEAK_LUX.into_iter().zip(rates_hz).zip(times) {
            // All gaps are equal: the time between the first event and the last says more than their number.
            let measured_hz = match (times.first(), times.last()) {
                (Some(first), Some(last)) if last.0 > first.0 => {
                    last.1 * (times.len() - 1) as f64 / (last.0 - first.0)
                }
                _ => 0.0,
            };
            points.push(LeakPoint { lux, temperature_c, measured_hz, model_hz });
        }
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_temperature_is_one_that_a_chip_may_have() {
        for (own_c, second_c) in
            [(-40.0, -31.2), (25.0, 33.8), (116.2, 125.0), (116.3, 107.5), (125.0, 116.2)]
        {
            let [first, second] =
                temperatures_c(&SensorModel { temperature_c: own_c, ..SensorModel::default() });
            assert_eq!(first, own_c);
            assert!((second - second_c).abs() < 1e-9, "{own_c} C: {second}");
        }
    }
}
