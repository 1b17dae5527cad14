//! The physics-grounded pixel: a photoreceptor that is slow in the dark, noise before the comparator, a leak that
//! depends on light and temperature, and a shared readout. It is an alternative to the log-intensity pixel of the
//! crate's sections 4 to 6 and shares everything else with it: intensity, synthesis, refractory period, thresholds,
//! latency, packets. A sensor has it with [`Pixel::Physical`](crate::Pixel). The readout
//! is one of its own, for either pixel ([`ReadoutKind`]).
//!
//! Sources: \[1\] Lichtsteiner, Posch, Delbruck, JSSC 43(2), 2008. \[2\] Graca, McReynolds, Delbruck, arXiv 2109.08640
//! and 2304.04019 (noise of the photoreceptor). \[3\] wengflow/rpg_esim (photoreceptor's circuit). \[4\] Rice, Bell
//! System Technical Journal 24, 1945 (level crossings). \[5\] arXiv 2605.16317 (Noise2Params).
//!
//! # The model
//!
//! ## 1. Light ([`light`], [`PhysicalPixel`])
//! The synthesis gives the intensity `S`. The focal plane has the illuminance `E = lux_per_unit S`. A pixel's
//! photocurrent is `I = response (E + E_d)`, electrons a second. `E_d = dark_lux f_d 2^((T - 25 C) / 8.8 K)` stands for
//! the dark current, with one log-normal draw `f_d` a pixel. Hot pixels are its upper tail. The level is
//! `L = ln(S + E_d / lux_per_unit)`, nepers: the log-intensity pixel's level, whose `log_offset` is the dark current
//! here. `L` is linear in time within a sub-step.
//!
//! ## 2. Photoreceptor ([`photoreceptor`])
//! Let `e^a` be the intensity that the photodiode's node shows. The node's charge obeys `da/dt = w_I - w_1`, where
//! `w_I = I / N_e` is the rate that the light drives, `w_1 = w_I e^(a - L)` the rate at which the node follows, and
//! `N_e` the charge, in electrons, that changes the node by one neper. Large steps are not small-signal: towards light
//! the node is faster than towards darkness. The second pole is the source follower: `dy/dt = w_2 (a - y)`.
//! The pixel's state is the **excess** `d = e^(L - a) - 1` and the **lag** `x = y - L`.
//!
//! ## 3. Noise ([`noise`])
//! Shot noise of photons and of the feedback transistor, both white, gives `a` the variance `1 / N_e` at every light.
//! Seen behind the second pole it has the variance `sigma^2 = w_2 / (N_e (w_1 + w_2))`, times `noise_gain^2`. It is
//! not sampled. A pixel keeps the noise `n_r` at its last **release** (when it began to watch, after an event and its
//! refractory period) and the two **phases** since, `P_1 = int w_1 dt` and `P_2 = w_2 t`. From them follow the mean `m`
//! and the standard deviation `s` of the noise now, and from those the **hazard** of an event.
//!
//! ## 4. Events
//! A release draws `z ~ N(0, 1)` and a clock `~ Exp(1)`. The next event is the earlier of two:
//! - *signal*: `y + m + s z` reaches `R + C_on` or `R - C_off`;
//! - *noise*: the integral of the hazards `lambda(b_on) + lambda(b_off)` over time reaches the clock, where
//!   `b_on = (R + C_on - y - m) / s`, `b_off = (y + m - R + C_off) / s`. One uniform draw picks the polarity, ON with
//!   the chance `lambda(b_on) / (lambda(b_on) + lambda(b_off))`. A signal at the same instant goes first.
//!
//! After an event at `t` with noise `n_e` (what the reached threshold lies above `y`; for a signal it is `m + s z`) the
//! pixel is held until `t + refractory_ns`. The noise's slope at the event is that of a path that crosses the threshold
//! outwards ([`crossing`]). At the hold's end noise `n_r` is drawn given `n_e` and the slope
//! ([`noise::release_log`]), and `R = y + n_r`. Without a refractory period `R` moves by exactly one threshold and
//! `n_r = n_e`. An event's time is rounded as in the crate's section 4.
//!
//! A pixel sends at most [`MOST_EVENTS`] events in an interval. One that would send more, as where the noise is as large
//! as the thresholds, sends no more in this interval. At its end it is armed anew, and counted.
//!
//! ## 5. Leak
//! `dR/dt = -C_on (leak_rate_hz f_l 2^((T - 25 C) / 8.8 K) + leak_per_lux_hz E)` with the nominal `C_on` and one
//! log-normal draw `f_l` a pixel. The rate has a sign: below 0 the pixel drifts to OFF events. A pixel is armed on its way
//! to the threshold, as after a long time in still light ([`noise::armed_leak_log`]).
//!
//! ## 6. Readout ([`Readout`])
//! Events at the pixels wait for a bus. A pixel with an event waiting has no place for another: further ones are
//! **lost by the sensor** and counted. Time stamps are those of the readout. The log-intensity pixel may have one too.
//!
//! ## 7. Random numbers
//! Functions of (seed, camera, pixel, stream, event index), as all draws of the model: see [`noise`]. No draw belongs to
//! a sub-step, a frame or a tile, so none of them can change statistics.

pub mod crossing;
mod illuminance;
pub mod light;
pub mod noise;
pub mod photoreceptor;
mod presets;
mod readout;

pub use illuminance::{DIM_LUX, Illuminances, LightReport, lux_of};
pub use presets::{PHYSICAL_PRESETS, PhysicalPreset, Sourced, assumed_note, physical_preset};
pub use readout::{Bus, MAX_DRAIN_PS, MAX_SERVICE_PS, Readout, ReadoutKind};

use crate::random::{PixelKey, Stream, leak_factor, log_normal};
use crate::sensor::Parameter;
use crate::{SensorError, SensorModel};
use serde::{Deserialize, Serialize};

/// Temperature to which dark current and leak refer, degrees Celsius.
pub const REFERENCE_TEMPERATURE_C: f64 = 25.0;

/// Warming that doubles dark current and leak, kelvin: an activation energy of .67 eV at 25 C, between the .6 eV of
/// generation in the depletion region and the band gap.
pub const DOUBLING_K: f64 = 8.8;

/// Most events that a pixel sends in an interval.
pub const MOST_EVENTS: u32 = 4096;

macro_rules! physical_pixel {
    ($($name:ident = $default:expr, $unit:literal, $about:literal;)*) => {
        /// Every parameter of the physical pixel that the log-intensity pixel does not have. Thresholds, their
        /// mismatch, refractory period, latency and time-stamp quantum are those of the [`SensorModel`].
        /// [`PhysicalPixel::validate`] states the ranges.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct PhysicalPixel {
            $(#[doc = $about] pub $name: f64,)*
        }

        impl Default for PhysicalPixel {
            fn default() -> Self {
                PhysicalPixel { $($name: $default,)* }
            }
        }

        /// Every parameter of [`PhysicalPixel`], in order.
        pub const PHYSICAL_PARAMETERS: &[Parameter] =
            &[$(Parameter { name: stringify!($name), unit: $unit, about: $about },)*];
    };
}

physical_pixel! {
    lux_per_unit = 100.0, "lux", "Focal-plane illuminance of an intensity of 1.";
    response_e_per_lux_s = 2.0e5, "e/s/lux", "Photocurrent of a pixel for each focal-plane lux.";
    dark_lux = 0.06, "lux", "Illuminance that stands for the dark current at 25 C.";
    dark_spread_log = 0.0, "log", "Spread of the dark current: standard deviation of its logarithm.";
    temperature_c = REFERENCE_TEMPERATURE_C, "C", "Temperature of the chip.";
    photoreceptor_charge_e = 340.0, "e", "Charge that changes the photoreceptor by one neper: speed and noise.";
    second_pole_hz = 1000.0, "Hz", "Corner frequency of the source follower.";
    noise_gain = 1.0, "", "Factor of the noise; 1 is twice photon shot noise, 0 is none.";
    leak_rate_hz = 0.1, "Hz", "Rate of leak events at 25 C in the dark: above 0 ON, below 0 OFF.";
    leak_per_lux_hz = 0.0, "Hz/lux", "Rate of leak events for each focal-plane lux.";
    leak_spread_log = 0.0, "log", "Spread of the dark leak: standard deviation of its logarithm.";
}

impl PhysicalPixel {
    /// Checks that every parameter is in its range.
    ///
    /// # Errors
    /// `SensorError::Range` names the first parameter that is not.
    pub fn validate(&self) -> Result<(), SensorError> {
        for (parameter, actual, low, high) in [
            ("lux_per_unit", self.lux_per_unit, 1e-9, 1e9),
            ("response_e_per_lux_s", self.response_e_per_lux_s, 1.0, 1e9),
            ("dark_lux", self.dark_lux, 1e-9, 1e3),
            ("dark_spread_log", self.dark_spread_log, 0.0, 2.0),
            ("temperature_c", self.temperature_c, -40.0, 125.0),
            ("photoreceptor_charge_e", self.photoreceptor_charge_e, 1.0, 1e6),
            ("second_pole_hz", self.second_pole_hz, 1.0, 1e12),
            ("noise_gain", self.noise_gain, 0.0, 10.0),
            ("leak_rate_hz", self.leak_rate_hz, -100.0, 100.0),
            ("leak_per_lux_hz", self.leak_per_lux_hz, -1.0, 1.0),
            ("leak_spread_log", self.leak_spread_log, 0.0, 2.0),
        ] {
            if !(actual.is_finite() && (low..=high).contains(&actual)) {
                return Err(SensorError::Range {
                    parameter,
                    expected: format!("{low} to {high}"),
                    actual: actual.to_string(),
                });
            }
        }
        Ok(())
    }

    /// Dark current and dark leak relative to those at 25 C.
    #[must_use]
    pub fn thermal_factor(&self) -> f64 {
        ((self.temperature_c - REFERENCE_TEMPERATURE_C) / DOUBLING_K).exp2()
    }

    /// Intensity, scene units, that stands for the dark current of a pixel with this factor. It is the `log_offset` of
    /// the pixel's level.
    #[must_use]
    pub fn dark_intensity(&self, dark_factor: f64) -> f64 {
        self.dark_lux * dark_factor * self.thermal_factor() / self.lux_per_unit
    }

    /// Rate `w_I` that light and dark current drive together, per second. `intensity` includes
    /// [`PhysicalPixel::dark_intensity`].
    #[must_use]
    pub fn drive_per_s(&self, intensity: f64) -> f64 {
        intensity * self.lux_per_unit * self.response_e_per_lux_s / self.photoreceptor_charge_e
    }

    /// The second pole `w_2`, radians per second.
    #[must_use]
    pub fn second_pole_per_s(&self) -> f64 {
        std::f64::consts::TAU * self.second_pole_hz
    }

    /// Rate of leak events at an illuminance, Hz, for a pixel with this leak factor.
    #[must_use]
    pub fn leak_hz(&self, lux: f64, leak_factor: f64) -> f64 {
        self.leak_rate_hz * leak_factor * self.thermal_factor() + self.leak_per_lux_hz * lux
    }
}

/// The random draws made once per pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhysicalDraws {
    /// OFF and ON threshold, nepers (indexed by [`Polarity`](crate::Polarity)).
    pub threshold_log: [f64; 2],
    /// Dark current relative to the nominal one.
    pub dark_factor: f64,
    /// Dark leak relative to the nominal one.
    pub leak_factor: f64,
}

impl PhysicalDraws {
    /// Draws of the pixel `key`.
    #[must_use]
    pub fn draw(sensor: &SensorModel, pixel: &PhysicalPixel, key: PixelKey) -> Self {
        let threshold =
            |stream, nominal| crate::random::threshold_log(key, stream, nominal, sensor.contrast_mismatch);
        PhysicalDraws {
            threshold_log: [
                threshold(Stream::ContrastOff, sensor.contrast_off),
                threshold(Stream::ContrastOn, sensor.contrast_on),
            ],
            dark_factor: log_normal(key, Stream::Dark, pixel.dark_spread_log),
            leak_factor: leak_factor(key, pixel.leak_spread_log),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_out_of_range_is_named() {
        PhysicalPixel::default().validate().expect("defaults are valid");
        for parameter in PHYSICAL_PARAMETERS {
            for bad in ["nan", "-1e13", "1e13"] {
                let pixel: PhysicalPixel =
                    toml::from_str(&format!("{} = {bad}", parameter.name)).expect("a float");
                let error = pixel.validate().expect_err(parameter.name).to_string();
                assert!(error.contains(parameter.name), "{error}");
            }
        }
        assert!(toml::from_str::<PhysicalPixel>("lux = 1.0").is_err(), "unknown keys are refused");
        let hot = PhysicalPixel { temperature_c: 126.0, ..PhysicalPixel::default() };
        assert!(hot.validate().unwrap_err().to_string().contains("-40 to 125"));
    }

    #[test]
    fn dark_current_and_leak_double_each_8_8_kelvin() {
        let at = |temperature_c| PhysicalPixel {
            temperature_c,
            leak_per_lux_hz: 0.01,
            ..PhysicalPixel::default()
        };
        let (cold, warm) = (at(25.0), at(33.8));
        assert!((warm.dark_intensity(1.0) / cold.dark_intensity(1.0) - 2.0).abs() < 1e-12);
        assert!((warm.leak_hz(0.0, 1.0) / cold.leak_hz(0.0, 1.0) - 2.0).abs() < 1e-12);
        assert!((warm.leak_hz(10.0, 1.0) - warm.leak_hz(0.0, 1.0) - 0.1).abs() < 1e-12, "light's part stays");
    }

    #[test]
    fn hot_pixels_are_the_tail_of_a_log_normal_draw() {
        let pixel = PhysicalPixel { dark_spread_log: 1.0, ..PhysicalPixel::default() };
        let sensor = SensorModel::default();
        let factor = |pixel_index| {
            let key = PixelKey { seed: 3, camera: 0, pixel: pixel_index };
            PhysicalDraws::draw(&sensor, &pixel, key).dark_factor
        };
        let hot = (0..20_000).filter(|&i| factor(i) > std::f64::consts::E.powi(2)).count();
        // The normal distribution has 2.28% above two standard deviations: 455 +- 21.
        assert!((390..520).contains(&hot), "{hot}");
    }
}
