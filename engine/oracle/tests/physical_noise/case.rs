//! Noisy pixels, in units of their noise.

use esaac_model::physical::noise::sigma_log;

/// Charge of the photoreceptor, electrons: one pole has the deviation .1.
pub const CHARGE_E: f64 = 100.0;

/// The first pole, per second.
pub const FIRST_PER_S: f64 = 10.0;

/// A noisy pixel in still light or on a ramp.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Second pole over first.
    pub poles: f64,
    /// Refractory period in time constants of the first pole.
    pub held: f64,
    /// Threshold in standard deviations.
    pub distance: f64,
    /// Slope of the level in standard deviations per time constant of the first pole.
    pub slope: f64,
}

impl Case {
    pub fn second_per_s(&self) -> f64 {
        self.poles * FIRST_PER_S
    }

    pub fn sigma_log(&self) -> f64 {
        sigma_log(CHARGE_E, 1.0, FIRST_PER_S, self.second_per_s())
    }

    pub fn threshold_log(&self) -> f64 {
        self.distance * self.sigma_log()
    }

    pub fn refractory_s(&self) -> f64 {
        self.held / FIRST_PER_S
    }

    pub fn slope_log_per_s(&self) -> f64 {
        self.slope * self.sigma_log() * FIRST_PER_S
    }
}
