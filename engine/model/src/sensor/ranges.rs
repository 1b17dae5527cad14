//! The range of every parameter.

use super::{Pixel, SensorError, SensorModel, Synthesis};
use crate::MAX_LATENCY_NS;
use crate::optics::{PSF_MOST_SIGMA_PX, PSF_RADIUS_PX};
use crate::random::jitter_bound_ns;
use crate::substeps::MAX_SUBSTEPS;
use crate::synthesis::MAX_TRANSFERS;
use crate::synthesis::layers::MAX_LAYERS;

impl SensorModel {
    /// Checks that every parameter is in its range.
    ///
    /// # Errors
    /// `SensorError::Range` names the first parameter that is not.
    pub fn validate(&self) -> Result<(), SensorError> {
        fn check<T: std::fmt::Display>(
            parameter: &'static str,
            actual: T,
            expected: &str,
            holds: bool,
        ) -> Result<(), SensorError> {
            if holds {
                Ok(())
            } else {
                Err(SensorError::Range {
                    parameter,
                    expected: expected.to_owned(),
                    actual: actual.to_string(),
                })
            }
        }
        let within = |value: f64, low: f64, high: f64| value.is_finite() && (low..=high).contains(&value);
        check("width", self.width, "1 to 16384", (1..=16384).contains(&self.width))?;
        check("height", self.height, "1 to 16384", (1..=16384).contains(&self.height))?;
        let threshold = "0.0001 to 10";
        check("contrast_on", self.contrast_on, threshold, within(self.contrast_on, 1e-4, 10.0))?;
        check("contrast_off", self.contrast_off, threshold, within(self.contrast_off, 1e-4, 10.0))?;
        let smaller = self.contrast_on.min(self.contrast_off);
        check(
            "contrast_mismatch",
            self.contrast_mismatch,
            "0 to half the smaller threshold",
            within(self.contrast_mismatch, 0.0, 0.5 * smaller),
        )?;
        check("refractory_ns", self.refractory_ns, "0 to 1000000000", self.refractory_ns <= 1_000_000_000)?;
        if self.pixel == Pixel::Log {
            check("leak_rate_hz", self.leak_rate_hz, "0 to 100", within(self.leak_rate_hz, 0.0, 100.0))?;
            check("leak_spread_log", self.leak_spread_log, "0 to 1", within(self.leak_spread_log, 0.0, 1.0))?;
        }
        self.physical_pixel().validate()?;
        check(
            "shot_noise_rate_hz",
            self.shot_noise_rate_hz,
            "0 to 50",
            within(self.shot_noise_rate_hz, 0.0, 50.0),
        )?;
        check("white_level", self.white_level, "1e-6 to 1e6", within(self.white_level, 1e-6, 1e6))?;
        let delay_ns = i64::from(self.latency_ns).saturating_add(jitter_bound_ns(self.latency_jitter_ns));
        check(
            "latency_ns",
            delay_ns,
            "at most 1000000000 together with 3.46 times latency_jitter_ns",
            delay_ns <= MAX_LATENCY_NS,
        )?;
        check(
            "timestamp_quantum_ns",
            self.timestamp_quantum_ns,
            "1 to 1000000000",
            (1..=1_000_000_000).contains(&self.timestamp_quantum_ns),
        )?;
        self.check_readout()?;
        check("exposure_gain", self.exposure_gain, "1e-6 to 1e6", within(self.exposure_gain, 1e-6, 1e6))?;
        check("log_offset", self.log_offset, "1e-6 to 1e3", within(self.log_offset, 1e-6, 1e3))?;
        let fits = format!(
            "0 to {PSF_MOST_SIGMA_PX}: three times it must fit the {PSF_RADIUS_PX} px read around a tile"
        );
        check("psf_sigma_px", self.psf_sigma_px, &fits, within(self.psf_sigma_px, 0.0, PSF_MOST_SIGMA_PX))?;
        let fov = self.vignetting_fov_deg;
        let fov_holds = fov == 0.0 || within(fov, 0.1, 170.0);
        check("vignetting_fov_deg", fov, "0 for none, or .1 to 170", fov_holds)?;
        check("flicker_depth", self.flicker_depth, "0 to 1", within(self.flicker_depth, 0.0, 1.0))?;
        check("flicker_hz", self.flicker_hz, "1 to 1000", within(self.flicker_hz, 1.0, 1000.0))?;
        let phase = self.flicker_phase_deg;
        check("flicker_phase_deg", phase, "-360 to 360", within(phase, -360.0, 360.0))?;
        check(
            "synthesis",
            self.synthesis.name(),
            "one with sub-steps, as flicker_depth is above 0",
            self.flicker_depth == 0.0 || self.synthesis != Synthesis::None,
        )?;
        check("transfers", self.transfers, "0 to 3", self.transfers <= MAX_TRANSFERS)?;
        check("layers", self.layers, "0 to 3", self.layers <= MAX_LAYERS)?;
        check("substeps", self.substeps, "1 to 64", (1..=MAX_SUBSTEPS).contains(&self.substeps))?;
        check(
            "substep_error_ns",
            self.substep_error_ns,
            "0 to 1000000000",
            self.substep_error_ns <= 1_000_000_000,
        )?;
        check(
            "aps_exposure_ns",
            self.aps_exposure_ns,
            "0 to 1000000000",
            self.aps_exposure_ns <= 1_000_000_000,
        )?;
        check("aps_start_ns", self.aps_start_ns, "0 to 1000000000", self.aps_start_ns <= 1_000_000_000)?;
        check("aps_gain", self.aps_gain, "1e-6 to 1e6", within(self.aps_gain, 1e-6, 1e6))?;
        check("aps_bits", self.aps_bits, "1 to 16", (1..=16).contains(&self.aps_bits))?;
        // Sensor files and saved rigs are TOML, which has no larger numbers.
        let most_seed = i64::MAX as u64;
        check("seed", self.seed, "0 to 9223372036854775807", self.seed <= most_seed)?;
        Ok(())
    }
}
