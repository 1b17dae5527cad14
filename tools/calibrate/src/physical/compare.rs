//! Rates of the recordings against those that a sensor has in the simulation, in their errors.

use super::exposure::{Exposure, Exposures};
use super::parameters::{STEPS, shifted};
use super::search::Residuals;
use super::simulate::{self, Light, expose};
use super::summary::Summary;
use anyhow::Result;
use esaac_engine::Device;
use esaac_model::SensorModel;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Columns and rows of the simulated sensor, for each exposure.
const SIZE_PX: (u32, u32) = (24, 16);

/// Error of a rate that no number of events makes smaller, as a share.
const FLOOR: f64 = 0.03;

/// Numbers of residuals of an exposure whose light swings, and of one under still light.
const OF_SWING: usize = 6;
const OF_STILL: usize = 3;

/// Exposures, and the sensor that points are distances from.
pub struct Fit<'a> {
    /// Simulates.
    pub device: &'a Arc<Device>,
    /// Recordings.
    pub exposures: &'a Exposures,
    /// Their rates.
    pub recorded: &'a [Summary],
    /// The sensor at the point of zeros.
    pub guess: &'a SensorModel,
}

impl Residuals for Fit<'_> {
    fn steps(&self) -> &[f64] {
        &STEPS
    }

    /// Simulates the points side by side.
    fn at(&self, points: &[Vec<f64>]) -> Result<Vec<Vec<f64>>> {
        let next = AtomicUsize::new(0);
        let work = || -> Result<Vec<(usize, Vec<f64>)>> {
            let mut done = Vec::new();
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                let Some(point) = points.get(number) else { return Ok(done) };
                done.push((number, self.residuals(&self.simulate(&shifted(self.guess, point))?)));
            }
        };
        let threads = std::thread::available_parallelism().map_or(1, usize::from).min(points.len());
        let results: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
            threads.into_iter().map(|thread| thread.join().expect("a simulation panicked")).collect()
        });
        let mut done = results.into_iter().collect::<Result<Vec<_>>>()?.concat();
        done.sort_unstable_by_key(|(number, _)| *number);
        Ok(done.into_iter().map(|(_, residuals)| residuals).collect())
    }
}

impl Fit<'_> {
    /// The exposures' rates with a sensor.
    pub fn simulate(&self, sensor: &SensorModel) -> Result<Vec<Summary>> {
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

    /// The largest of each exposure's residuals, without its sign.
    pub fn largest(&self, residuals: &[f64]) -> Vec<f64> {
        let mut rest = residuals;
        let largest = |exposure: &Exposure| {
            let (own, others) = rest.split_at(if exposure.flicker.is_some() { OF_SWING } else { OF_STILL });
            rest = others;
            own.iter().fold(0.0, |largest: f64, residual| largest.max(residual.abs()))
        };
        self.exposures.all.iter().map(largest).collect()
    }

    /// Differences of simulated and recorded rates, in their errors.
    fn residuals(&self, simulated: &[Summary]) -> Vec<f64> {
        let mut residuals = Vec::new();
        for ((exposure, recorded), simulated) in self.exposures.all.iter().zip(self.recorded).zip(simulated) {
            let all = recorded.rate_error.hypot(simulated.rate_error).hypot(FLOOR);
            let ratio = |a: f64, b: f64, least: f64| ((a + least) / (b + least)).ln();
            if recorded.short_gap_ns.is_finite() && simulated.short_gap_ns.is_finite() {
                let sampling = simulated.short_gap_error.hypot(recorded.short_gap_error);
                residuals
                    .push(ratio(simulated.short_gap_ns, recorded.short_gap_ns, 1.0) / sampling.hypot(FLOOR));
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
