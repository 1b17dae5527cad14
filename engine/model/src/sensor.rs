//! The parameters of a sensor. One list defines the struct, its TOML, the command-line flags and the printed
//! tables.

mod choices;
mod ranges;
#[cfg(test)]
mod tests;

use crate::physical::{PhysicalPixel, ReadoutKind};
use crate::synthesis::{TRANSFERS_BY_PATHS, TRANSFERS_BY_VECTORS};
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use choices::{Intensity, Pixel, SubstepPolicy, Synthesis, Taps, Timestamps};

/// Why a sensor is refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SensorError {
    /// A parameter outside its range.
    #[error("sensor parameter `{parameter}` is {actual}, expected {expected}")]
    Range {
        /// Parameter.
        parameter: &'static str,
        /// Allowed range.
        expected: String,
        /// Value given.
        actual: String,
    },
    /// A name that no parameter has.
    #[error("unknown sensor parameter `{0}`; `esaac sensors` lists them")]
    Unknown(String),
    /// A value that a parameter does not take.
    #[error("sensor parameter `{parameter}` cannot be `{value}`: {reason}")]
    Value {
        /// Parameter.
        parameter: String,
        /// Value given.
        value: String,
        /// The parser's message.
        reason: String,
    },
    /// TOML that cannot be read as a sensor.
    #[error("sensor file: {0}")]
    Toml(String),
}

/// One parameter, for flags, tables and documentation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parameter {
    /// Name of the field and TOML key. The command-line flag has hyphens in place of underscores.
    pub name: &'static str,
    /// Unit, empty for counts and choices.
    pub unit: &'static str,
    /// What it means.
    pub about: &'static str,
}

/// Name of a sensor that nobody has named.
pub const CUSTOM: &str = "custom";

/// The struct and [`PARAMETERS`] from one list: name, type, default, unit, meaning. The meaning of a parameter that only the
/// physical pixel reads begins with `Physical: `: so the command line knows when it does nothing
/// (`tools/cli/src/unread_flags.rs`).
macro_rules! sensor_model {
    ($($name:ident: $type:ty = $default:expr, $unit:literal, $about:literal;)*) => {
        /// Every parameter of a sensor. [`SensorModel::validate`] states the ranges.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct SensorModel {
            $(#[doc = $about] pub $name: $type,)*
        }

        impl Default for SensorModel {
            fn default() -> Self {
                SensorModel { $($name: $default,)* }
            }
        }

        /// Every parameter of [`SensorModel`], in order.
        pub const PARAMETERS: &[Parameter] =
            &[$(Parameter { name: stringify!($name), unit: $unit, about: $about },)*];
    };
}

sensor_model! {
    name: String = "davis346".to_owned(), "", "Name of the sensor.";
    width: u32 = 346, "px", "Columns.";
    height: u32 = 260, "px", "Rows.";
    pixel: Pixel = Pixel::Log, "", "What turns light into events: log, or physical with speed and noise of a real pixel.";
    contrast_on: f64 = 0.2, "log", "ON contrast threshold.";
    contrast_off: f64 = 0.2, "log", "OFF contrast threshold.";
    contrast_mismatch: f64 = 0.0, "log", "Standard deviation of the thresholds from pixel to pixel.";
    refractory_ns: u32 = 0, "ns", "Refractory period: how long a pixel is held after an event.";
    leak_rate_hz: f64 = 0.0, "Hz", "Rate of the ON events that a still pixel leaks; physical: at 25 C, below 0 OFF.";
    leak_spread_log: f64 = 0.0, "log", "Spread of the leak rate: standard deviation of its logarithm.";
    shot_noise_rate_hz: f64 = 0.0, "Hz", "Shot-noise events of a dark log pixel, both polarities together.";
    white_level: f64 = 1.0, "scene", "Intensity of white: full scale of the APS frame, lowest shot noise.";
    latency_ns: u32 = 0, "ns", "Constant delay of an event's time stamp.";
    latency_jitter_ns: u32 = 0, "ns", "Standard deviation of the delay.";
    timestamp_quantum_ns: u32 = 1, "ns", "Time stamps are floored to a multiple of this.";
    intensity: Intensity = Intensity::Luminance, "", "What a pixel sees: gray, luminance, bayer_rggb, silicon_front, silicon_back, silicon_front_ir or silicon_back_ir.";
    exposure_gain: f64 = 1.0, "", "Factor from the renderer's radiance to the sensor's intensity.";
    log_offset: f64 = crate::presets::LOG_OFFSET_HDR, "scene", "Dark level of the log pixel: L = ln(S + log_offset).";
    psf_sigma_px: f64 = 0.0, "px", "Blur of the lens: standard deviation of a Gaussian in linear light; 0 for none.";
    vignetting_fov_deg: f64 = 0.0, "deg", "Vignetting cos^4 of a lens with this horizontal field of view; 0 for none.";
    flicker_depth: f64 = 0.0, "", "Flicker of a lamp: light times 1 + depth sin(2 pi f t + phase); 0 for none.";
    flicker_hz: f64 = 100.0, "Hz", "Frequency of the flicker: twice the mains'.";
    flicker_phase_deg: f64 = 0.0, "deg", "Phase of the flicker at time 0.";
    synthesis: Synthesis = Synthesis::Auto, "", "Frame-gap synthesis: auto, rigid, motion, linear, paper or none.";
    taps: Taps = Taps::Cubic, "", "Interpolation of a warped frame: cubic or bilinear.";
    transfers: u32 = 0, "", "Transfers of detail (motion and rigid with cubic taps): 1 for speed, 2, or 3 for quality; 0 is 3 along exact paths, else 2.";
    layers: u32 = 0, "", "Surfaces that a pixel may show between two frames (motion): 1 for speed, 3 where things cover each other, 0 as the scene needs.";
    substeps: u32 = 32, "", "Largest number N of sub-steps in an interval.";
    substep_policy: SubstepPolicy = SubstepPolicy::Adaptive, "", "Sub-steps of a block: adaptive or fixed.";
    substep_error_ns: u32 = 150_000, "ns", "Adaptive: how far a crossing may be off between two sub-steps (motion, rigid; cubic taps); 0 for by speed alone.";
    timestamps: Timestamps = Timestamps::Interpolated, "", "Time of a crossing: interpolated or at_sample.";
    readout: ReadoutKind = ReadoutKind::None, "", "How events leave the sensor: none (at once), fifo (one by one) or rows.";
    readout_event_ns: f64 = 83.0, "ns", "Readout: time that the bus takes for an event.";
    readout_row_ns: f64 = 0.0, "ns", "Readout by rows: time that the bus takes for a row, besides its events.";
    readout_cap_events: u32 = 0, "", "Readout: events of a period at which the rate controller begins to drop; 0 for never.";
    readout_cap_period_ns: u32 = 50_000, "ns", "Readout: period of the rate controller.";
    max_events_per_interval: u32 = 0, "", "Hard cap of a packet, the earliest events kept; 0 for none.";
    aps_exposure_ns: u32 = 0, "ns", "Exposure of the APS frame; 0 for no APS.";
    aps_start_ns: u32 = 0, "ns", "Start of the exposure after the interval's start.";
    aps_gain: f64 = 1.0, "", "Gain of the APS frame.";
    aps_bits: u32 = 8, "bit", "Depth of an APS pixel.";
    lux_per_unit: f64 = 100.0, "lux", "Physical: focal-plane illuminance of an intensity of 1.";
    response_e_per_lux_s: f64 = 2.0e5, "e/s/lux", "Physical: photocurrent of a pixel for each focal-plane lux.";
    dark_lux: f64 = 0.06, "lux", "Physical: illuminance that stands for the dark current at 25 C.";
    dark_spread_log: f64 = 0.0, "log", "Physical: standard deviation of the dark current's logarithm (hot pixels).";
    temperature_c: f64 = 25.0, "C", "Physical: temperature of the chip.";
    photoreceptor_charge_e: f64 = 340.0, "e", "Physical: charge that moves the photoreceptor by one neper.";
    second_pole_hz: f64 = 1000.0, "Hz", "Physical: corner frequency of the source follower.";
    noise_gain: f64 = 1.0, "", "Physical: factor of the noise; 1 is twice photon shot noise, 0 is none.";
    leak_per_lux_hz: f64 = 0.0, "Hz/lux", "Physical: rate of leak events for each focal-plane lux.";
    seed: u64 = 0, "", "Seed of everything random.";
}

impl SensorModel {
    /// Transfers of detail in an interval: [`SensorModel::transfers`], or as many as the synthesis takes by default.
    #[must_use]
    pub fn detail_transfers(&self) -> u32 {
        match (self.transfers, self.synthesis) {
            (0, Synthesis::Rigid) => TRANSFERS_BY_PATHS,
            (0, _) => TRANSFERS_BY_VECTORS,
            (transfers, _) => transfers,
        }
    }

    /// Reads a sensor from TOML. Without a name it is [`CUSTOM`], and not the sensor that the default is of.
    ///
    /// # Errors
    /// `SensorError::Toml` for unknown keys and text that is not TOML, `SensorError::Range` for values out of range.
    pub fn from_toml(text: &str) -> Result<Self, SensorError> {
        let wrong = |e: toml::de::Error| SensorError::Toml(e.to_string());
        let mut sensor: SensorModel = toml::from_str(text).map_err(wrong)?;
        if !text.parse::<toml::Table>().map_err(wrong)?.contains_key("name") {
            CUSTOM.clone_into(&mut sensor.name);
        }
        sensor.validate()?;
        Ok(sensor)
    }

    /// The sensor as TOML, every parameter written out.
    ///
    /// # Panics
    /// If `seed` is beyond TOML's whole numbers, which `validate` refuses.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a flat struct of numbers and strings is TOML")
    }

    /// Sets one parameter from text, as a command-line flag does. Hyphens count as underscores. `pixel` changes others
    /// with it ([`SensorModel::with_pixel`]). Does not check the range; `validate` does.
    ///
    /// # Errors
    /// `SensorError::Unknown` for a name that no parameter has, `SensorError::Value` for text that cannot be parsed.
    ///
    /// # Panics
    /// As [`SensorModel::to_toml`].
    pub fn set(&mut self, parameter: &str, value: &str) -> Result<(), SensorError> {
        let key = parameter.replace('-', "_");
        let mut table = toml::Table::try_from(&*self).expect("a sensor is a table");
        let Some(current) = table.get(&key) else {
            return Err(SensorError::Unknown(parameter.to_owned()));
        };
        let bad =
            |reason: String| SensorError::Value { parameter: key.clone(), value: value.to_owned(), reason };
        let parsed = match current {
            toml::Value::Integer(_) => toml::Value::Integer(
                value.replace('_', "").parse().map_err(|_| bad("expected a whole number".to_owned()))?,
            ),
            toml::Value::Float(_) => {
                toml::Value::Float(value.parse().map_err(|_| bad("expected a number".to_owned()))?)
            }
            _ => toml::Value::String(value.to_owned()),
        };
        let is_number = matches!(parsed, toml::Value::Integer(_));
        table.insert(key.clone(), parsed);
        // A whole number that its type does not hold: below zero, most often.
        let reason = |e: toml::de::Error| match is_number {
            true => "expected a whole number, from 0 and in the range of the parameter".to_owned(),
            false => e.message().to_owned(),
        };
        let next: SensorModel = table.try_into().map_err(|e| bad(reason(e)))?;
        *self = if key == "pixel" { std::mem::take(self).with_pixel(next.pixel) } else { next };
        Ok(())
    }

    /// The physical pixel that the parameters describe.
    #[must_use]
    pub fn physical_pixel(&self) -> PhysicalPixel {
        PhysicalPixel {
            lux_per_unit: self.lux_per_unit,
            response_e_per_lux_s: self.response_e_per_lux_s,
            dark_lux: self.dark_lux,
            dark_spread_log: self.dark_spread_log,
            temperature_c: self.temperature_c,
            photoreceptor_charge_e: self.photoreceptor_charge_e,
            second_pole_hz: self.second_pole_hz,
            noise_gain: self.noise_gain,
            leak_rate_hz: self.leak_rate_hz,
            leak_per_lux_hz: self.leak_per_lux_hz,
            leak_spread_log: self.leak_spread_log,
        }
    }

    /// This sensor with a physical pixel in place of its own.
    #[must_use]
    pub fn with_physical(self, pixel: &PhysicalPixel) -> Self {
        SensorModel {
            pixel: Pixel::Physical,
            lux_per_unit: pixel.lux_per_unit,
            response_e_per_lux_s: pixel.response_e_per_lux_s,
            dark_lux: pixel.dark_lux,
            dark_spread_log: pixel.dark_spread_log,
            temperature_c: pixel.temperature_c,
            photoreceptor_charge_e: pixel.photoreceptor_charge_e,
            second_pole_hz: pixel.second_pole_hz,
            noise_gain: pixel.noise_gain,
            leak_rate_hz: pixel.leak_rate_hz,
            leak_per_lux_hz: pixel.leak_per_lux_hz,
            leak_spread_log: pixel.leak_spread_log,
            ..self
        }
    }

    /// Intensity, scene units, that is added before the logarithm: `log_offset`, or the physical pixel's dark current.
    #[must_use]
    pub fn dark_level(&self) -> f64 {
        match self.pixel {
            Pixel::Log => self.log_offset,
            Pixel::Physical => self.physical_pixel().dark_intensity(1.0),
        }
    }

    /// Number of pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}
