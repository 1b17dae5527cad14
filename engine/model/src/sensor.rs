//! The parameters of a sensor. One list defines the struct, its TOML, the command-line flags and the printed
//! tables.

use crate::MAX_LATENCY_NS;
use crate::optics::{PSF_MOST_SIGMA_PX, PSF_RADIUS_PX};
use crate::physical::{PhysicalPixel, ReadoutKind};
use crate::random::jitter_bound_ns;
use crate::substeps::MAX_SUBSTEPS;
use crate::synthesis::MAX_TRANSFERS;
use crate::synthesis::layers::MAX_LAYERS;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// What turns light into events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pixel {
    /// Watches log intensity.
    Log,
    /// A photoreceptor with speed and noise of its own; see [`physical`](crate::physical).
    Physical,
}

/// How RGB becomes the scalar that a pixel sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum Intensity {
    /// Mean of R, G, B.
    Gray = 0,
    /// Rec. 709.
    Luminance = 1,
    /// One component a pixel, R at (0, 0).
    BayerRggb = 2,
    /// Front-illuminated silicon behind an infrared cut filter.
    SiliconFront = 3,
    /// Back-illuminated silicon behind an infrared cut filter.
    SiliconBack = 4,
    /// Front-illuminated silicon without an infrared cut filter.
    SiliconFrontIr = 5,
    /// Back-illuminated silicon without an infrared cut filter.
    SiliconBackIr = 6,
}

impl Intensity {
    /// Every intensity.
    pub const ALL: [Intensity; 7] = [
        Intensity::Gray,
        Intensity::Luminance,
        Intensity::BayerRggb,
        Intensity::SiliconFront,
        Intensity::SiliconBack,
        Intensity::SiliconFrontIr,
        Intensity::SiliconBackIr,
    ];
}

/// How the intensity between two rendered frames is synthesised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum Synthesis {
    /// Both frames warped along the trajectories of surface points.
    Motion = 0,
    /// Blend of the two frames in linear intensity.
    Linear = 1,
    /// The paper's equation as printed.
    Paper = 2,
    /// One sub-step: log-linear from frame to frame.
    None = 3,
    /// Both frames read along the exact paths of a simulator's poses ([`rigid`](crate::synthesis::rigid)).
    Rigid = 4,
    /// The best that a camera's input allows; see [`Synthesis::resolve`]. No kernel knows it.
    Auto = 5,
}

impl Synthesis {
    /// Every synthesis.
    pub const ALL: [Synthesis; 6] = [
        Synthesis::Motion,
        Synthesis::Linear,
        Synthesis::Paper,
        Synthesis::None,
        Synthesis::Rigid,
        Synthesis::Auto,
    ];

    /// The synthesis of a camera that may or may not get depth and poses, and motion vectors: `Auto` is the best of
    /// those that these allow, any other stays.
    #[must_use]
    pub fn resolve(self, has_geometry: bool, has_motion: bool) -> Synthesis {
        match self {
            Synthesis::Auto if has_geometry => Synthesis::Rigid,
            Synthesis::Auto if has_motion => Synthesis::Motion,
            Synthesis::Auto => Synthesis::Linear,
            chosen => chosen,
        }
    }

    /// Name, as in TOML and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Synthesis::Motion => "motion",
            Synthesis::Linear => "linear",
            Synthesis::Paper => "paper",
            Synthesis::None => "none",
            Synthesis::Rigid => "rigid",
            Synthesis::Auto => "auto",
        }
    }

    /// Whether it reads half-pel frames, with cubic taps.
    #[must_use]
    pub fn has_half_pels(self) -> bool {
        matches!(self, Synthesis::Motion | Synthesis::Rigid)
    }

    /// Whether it needs motion vectors.
    #[must_use]
    pub fn needs_motion(self) -> bool {
        matches!(self, Synthesis::Motion | Synthesis::Paper)
    }

    /// Whether it follows motion vectors, if there are some: `rigid` does where a pixel has no path.
    #[must_use]
    pub fn follows_motion(self) -> bool {
        self.needs_motion() || self == Synthesis::Rigid
    }
}

/// Interpolation between pixels of a warped frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum Taps {
    /// Twelve taps.
    Cubic = 0,
    /// Four taps.
    Bilinear = 1,
}

/// How the number of sub-steps is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum SubstepPolicy {
    /// Per block, from its motion and change, `substeps` at the most.
    Adaptive = 0,
    /// Always `substeps`.
    Fixed = 1,
}

/// The time of a crossing within a sub-step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum Timestamps {
    /// The crossing's own instant, interpolated within the sub-step.
    Interpolated = 0,
    /// The end of the sub-step.
    AtSample = 1,
}

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
    transfers: u32 = 1, "", "Transfers of detail (motion with cubic taps): 1 for speed, 2 for quality.";
    layers: u32 = 1, "", "Surfaces that a pixel may show between two frames (motion): 1 for speed, 3 where things cover each other.";
    substeps: u32 = 32, "", "Largest number N of sub-steps in an interval.";
    substep_policy: SubstepPolicy = SubstepPolicy::Adaptive, "", "Sub-steps of a block: adaptive or fixed.";
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
    /// Reads a sensor from TOML.
    ///
    /// # Errors
    /// `SensorError::Toml` for unknown keys and text that is not TOML, `SensorError::Range` for values out of range.
    pub fn from_toml(text: &str) -> Result<Self, SensorError> {
        let sensor: SensorModel = toml::from_str(text).map_err(|e| SensorError::Toml(e.to_string()))?;
        sensor.validate()?;
        Ok(sensor)
    }

    /// The sensor as TOML, every parameter written out.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a flat struct of numbers and strings is TOML")
    }

    /// Sets one parameter from text, as a command-line flag does. Hyphens count as underscores. Does not check the
    /// range; `validate` does.
    ///
    /// # Errors
    /// `SensorError::Unknown` for a name that no parameter has, `SensorError::Value` for text that cannot be parsed.
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
                value.replace('_', "").parse().map_err(|e: std::num::ParseIntError| bad(e.to_string()))?,
            ),
            toml::Value::Float(_) => {
                toml::Value::Float(value.parse().map_err(|e: std::num::ParseFloatError| bad(e.to_string()))?)
            }
            _ => toml::Value::String(value.to_owned()),
        };
        table.insert(key.clone(), parsed);
        *self = table.try_into().map_err(|e: toml::de::Error| bad(e.message().to_owned()))?;
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
        let threshold = "above 0 and at most 10 (at least 1e-4)";
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
        check("transfers", self.transfers, "1 or 2", (1..=MAX_TRANSFERS).contains(&self.transfers))?;
        check("layers", self.layers, "1 to 3", (1..=MAX_LAYERS).contains(&self.layers))?;
        check("substeps", self.substeps, "1 to 64", (1..=MAX_SUBSTEPS).contains(&self.substeps))?;
        check(
            "aps_exposure_ns",
            self.aps_exposure_ns,
            "0 to 1000000000",
            self.aps_exposure_ns <= 1_000_000_000,
        )?;
        check("aps_start_ns", self.aps_start_ns, "0 to 1000000000", self.aps_start_ns <= 1_000_000_000)?;
        check("aps_gain", self.aps_gain, "1e-6 to 1e6", within(self.aps_gain, 1e-6, 1e6))?;
        check("aps_bits", self.aps_bits, "1 to 16", (1..=16).contains(&self.aps_bits))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn toml_round_trips_and_refuses_unknown_keys() {
        let sensor =
            SensorModel { contrast_on: 0.3, intensity: Intensity::BayerRggb, ..SensorModel::default() };
        assert_eq!(SensorModel::from_toml(&sensor.to_toml()), Ok(sensor));
        let error = SensorModel::from_toml("contrast_one = 0.2").unwrap_err().to_string();
        assert!(error.contains("contrast_one"), "{error}");
    }

    #[test]
    fn auto_is_the_best_that_the_input_allows_and_a_choice_stays() {
        let auto = |geometry, motion| Synthesis::Auto.resolve(geometry, motion);
        assert_eq!(auto(true, true), Synthesis::Rigid);
        assert_eq!(auto(true, false), Synthesis::Rigid);
        assert_eq!(auto(false, true), Synthesis::Motion);
        assert_eq!(auto(false, false), Synthesis::Linear);
        for chosen in Synthesis::ALL.into_iter().filter(|&s| s != Synthesis::Auto) {
            assert_eq!(chosen.resolve(true, true), chosen);
            assert_eq!(chosen.resolve(false, false), chosen);
        }
    }

    #[test]
    fn names_are_those_of_toml() {
        for synthesis in Synthesis::ALL {
            let sensor = SensorModel { synthesis, ..SensorModel::default() };
            assert!(sensor.to_toml().contains(&format!("synthesis = \"{}\"", synthesis.name())));
        }
    }

    #[test]
    fn every_parameter_is_settable_by_name_and_shown_in_toml() {
        let toml = SensorModel::default().to_toml();
        for parameter in PARAMETERS {
            assert!(toml.contains(&format!("{} = ", parameter.name)), "{}", parameter.name);
        }
        let mut sensor = SensorModel::default();
        sensor.set("contrast-on", "0.25").unwrap();
        sensor.set("intensity", "bayer_rggb").unwrap();
        sensor.set("latency_ns", "100_000").unwrap();
        sensor.set("pixel", "physical").unwrap();
        sensor.set("temperature-c", "-12.5").unwrap();
        assert_eq!((sensor.pixel, sensor.temperature_c), (Pixel::Physical, -12.5));
        assert_eq!((sensor.contrast_on, sensor.latency_ns), (0.25, 100_000));
        assert!(matches!(sensor.set("contrast", "1"), Err(SensorError::Unknown(_))));
        assert!(matches!(sensor.set("substeps", "many"), Err(SensorError::Value { .. })));
        assert!(matches!(sensor.set("intensity", "red"), Err(SensorError::Value { .. })));
        assert!(matches!(sensor.set("substeps", "-1"), Err(SensorError::Value { .. })));
    }

    #[test]
    fn every_parameter_of_the_physical_pixel_is_one_of_the_sensor() {
        let names: Vec<&str> = PARAMETERS.iter().map(|parameter| parameter.name).collect();
        for parameter in crate::physical::PHYSICAL_PARAMETERS {
            assert!(names.contains(&parameter.name), "{}", parameter.name);
        }
        let sensor = SensorModel { leak_rate_hz: 0.1, ..SensorModel::default() };
        assert_eq!(sensor.physical_pixel(), PhysicalPixel::default(), "the defaults agree");
        let pixel = PhysicalPixel { dark_lux: 0.5, leak_rate_hz: -2.0, ..PhysicalPixel::default() };
        let physical = sensor.with_physical(&pixel);
        assert_eq!((physical.physical_pixel(), physical.validate()), (pixel, Ok(())));
        assert_eq!(physical.dark_level(), 0.005, "in scene units");
        let error = SensorModel { pixel: Pixel::Log, ..physical }.validate().unwrap_err().to_string();
        assert!(error.contains("leak_rate_hz"), "only a physical pixel leaks to OFF: {error}");
    }

    #[test]
    fn a_blur_wider_than_the_apron_names_the_largest() {
        let wide = SensorModel { psf_sigma_px: 2.5, ..SensorModel::default() };
        let error = wide.validate().unwrap_err().to_string();
        assert!(
            error.contains("`psf_sigma_px` is 2.5, expected 0 to 1: ") && error.contains("3 px"),
            "{error}"
        );
    }

    #[test]
    fn out_of_range_names_the_parameter() {
        let base = SensorModel::default();
        let with_bus = |readout| SensorModel { readout, readout_row_ns: 130.0, ..SensorModel::default() };
        for readout in [ReadoutKind::Fifo, ReadoutKind::Rows] {
            assert_eq!(with_bus(readout).validate(), Ok(()));
        }
        for (sensor, parameter) in [
            (SensorModel { contrast_on: 0.0, ..base.clone() }, "contrast_on"),
            (SensorModel { contrast_off: f64::NAN, ..base.clone() }, "contrast_off"),
            (SensorModel { transfers: 0, ..base.clone() }, "transfers"),
            (SensorModel { transfers: 3, ..base.clone() }, "transfers"),
            (SensorModel { substeps: 0, ..base.clone() }, "substeps"),
            (SensorModel { substeps: 65, ..base.clone() }, "substeps"),
            (SensorModel { width: 0, ..base.clone() }, "width"),
            (SensorModel { log_offset: 0.0, ..base.clone() }, "log_offset"),
            (SensorModel { latency_jitter_ns: 900_000_000, ..base.clone() }, "latency_ns"),
            (SensorModel { lux_per_unit: -1.0, ..base.clone() }, "lux_per_unit"),
            (SensorModel { lux_per_unit: f64::NAN, ..base.clone() }, "lux_per_unit"),
            (SensorModel { temperature_c: -40.5, ..base.clone() }, "temperature_c"),
            (SensorModel { psf_sigma_px: 1.01, ..base.clone() }, "psf_sigma_px"),
            (SensorModel { psf_sigma_px: -0.5, ..base.clone() }, "psf_sigma_px"),
            (SensorModel { vignetting_fov_deg: 180.0, ..base.clone() }, "vignetting_fov_deg"),
            (SensorModel { flicker_depth: 1.5, ..base.clone() }, "flicker_depth"),
            (SensorModel { flicker_hz: 0.0, ..base.clone() }, "flicker_hz"),
            (SensorModel { flicker_hz: 1e4, ..base.clone() }, "flicker_hz"),
            (SensorModel { flicker_phase_deg: f64::INFINITY, ..base.clone() }, "flicker_phase_deg"),
            (SensorModel { flicker_depth: 0.1, synthesis: Synthesis::None, ..base.clone() }, "synthesis"),
            (SensorModel { temperature_c: 126.0, ..base.clone() }, "temperature_c"),
            (SensorModel { readout_event_ns: 0.0, ..with_bus(ReadoutKind::Fifo) }, "readout_event_ns"),
            (SensorModel { readout_event_ns: -1.0, ..base.clone() }, "readout_event_ns"),
            (SensorModel { readout_event_ns: f64::NAN, ..with_bus(ReadoutKind::Rows) }, "readout_event_ns"),
            (SensorModel { readout_event_ns: 2e6, ..with_bus(ReadoutKind::Fifo) }, "readout_event_ns"),
            (SensorModel { readout_row_ns: 0.0, ..with_bus(ReadoutKind::Rows) }, "readout_row_ns"),
            (SensorModel { readout_row_ns: f64::INFINITY, ..base.clone() }, "readout_row_ns"),
            (SensorModel { readout_cap_events: 5, ..base.clone() }, "readout_cap_events"),
            (
                SensorModel { readout_cap_period_ns: 0, ..with_bus(ReadoutKind::Fifo) },
                "readout_cap_period_ns",
            ),
        ] {
            match sensor.validate() {
                Err(SensorError::Range { parameter: actual, .. }) => assert_eq!(actual, parameter),
                other => panic!("{parameter}: {other:?}"),
            }
        }
    }
}
