//! Sensors and noise profiles by name.

use crate::physical::{PhysicalPixel, physical_preset};
use crate::sensor::{Pixel, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use serde::{Deserialize, Serialize};

/// Log offset of the paper's `log(S + 1)`, for intensities of 8-bit scale.
pub const LOG_OFFSET_PAPER: f64 = 1.0;

/// Log offset for HDR scene units, near the dark level: a 50% step at S = 0.01 keeps 70% of its size
/// (the paper's offset leaves 1%).
pub const LOG_OFFSET_HDR: f64 = 0.01;

/// Spread of the leak in the profile `noisy`, log.
const LEAK_SPREAD_LOG: f64 = 0.2;

/// A sensor by name: the paper's five (Table 2) and two common sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// What it is.
    pub about: &'static str,
}

/// Every preset.
pub const PRESETS: &[Preset] = &[
    Preset { name: "dvs128", width_px: 128, height_px: 128, about: "iniVation DVS128" },
    Preset { name: "davis240", width_px: 240, height_px: 180, about: "iniVation DAVIS240" },
    Preset { name: "atis", width_px: 304, height_px: 240, about: "Prophesee ATIS" },
    Preset { name: "davis346", width_px: 346, height_px: 260, about: "iniVation DAVIS346" },
    Preset { name: "genx320", width_px: 320, height_px: 320, about: "Prophesee GenX320" },
    Preset { name: "vga", width_px: 640, height_px: 480, about: "640x480 (Prophesee Gen3/Gen4 VGA class)" },
    Preset { name: "hd", width_px: 1280, height_px: 720, about: "1280x720 (Prophesee IMX636 class)" },
];

/// A named set of sensor effects, applied on top of a preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// No noise, no refractory period, no latency.
    Clean,
    /// Every effect of the pixels on. The values are those of v2e's "noisy" setting where it has them. Lens, lamp and
    /// readout stay as they are.
    Noisy,
    /// The paper's event model: `log(S + 1)`, its warp, events at sample times, fixed sub-steps.
    Paper,
}

impl Profile {
    /// Sets the profile's parameters and leaves the others as they are. `Paper` is a log pixel; the others keep the pixel
    /// that a sensor has.
    pub fn apply(self, sensor: &mut SensorModel) {
        let clean = SensorModel::default();
        if sensor.pixel == Pixel::Physical {
            sensor.noise_gain = if self == Profile::Noisy { clean.noise_gain } else { 0.0 };
            // Assumed: as the leak's, since both come from junctions that differ from pixel to pixel.
            sensor.dark_spread_log =
                if self == Profile::Noisy { LEAK_SPREAD_LOG } else { clean.dark_spread_log };
            sensor.leak_per_lux_hz = clean.leak_per_lux_hz;
        }
        sensor.contrast_mismatch = clean.contrast_mismatch;
        sensor.refractory_ns = clean.refractory_ns;
        sensor.leak_rate_hz = clean.leak_rate_hz;
        sensor.leak_spread_log = clean.leak_spread_log;
        sensor.shot_noise_rate_hz = clean.shot_noise_rate_hz;
        sensor.latency_ns = clean.latency_ns;
        sensor.latency_jitter_ns = clean.latency_jitter_ns;
        sensor.timestamp_quantum_ns = clean.timestamp_quantum_ns;
        match self {
            Profile::Clean => {}
            Profile::Noisy => {
                sensor.contrast_mismatch = 0.05;
                sensor.refractory_ns = 500_000;
                sensor.leak_rate_hz = 0.1;
                sensor.leak_spread_log = LEAK_SPREAD_LOG;
                sensor.shot_noise_rate_hz = 5.0;
                sensor.latency_ns = 100_000;
                sensor.latency_jitter_ns = 10_000;
                sensor.timestamp_quantum_ns = 1_000;
            }
            Profile::Paper => {
                sensor.pixel = Pixel::Log;
                sensor.log_offset = LOG_OFFSET_PAPER;
                sensor.synthesis = Synthesis::Paper;
                sensor.timestamps = Timestamps::AtSample;
                sensor.substep_policy = SubstepPolicy::Fixed;
            }
        }
    }
}

/// The sensor of the preset with this name, if there is one. It has the service times of that sensor's bus, but no
/// readout until one is chosen.
#[must_use]
pub fn preset(name: &str) -> Option<SensorModel> {
    PRESETS.iter().find(|p| p.name == name).map(|p| {
        let clean = SensorModel::default();
        let service_ns = physical_preset(name).map(|preset| preset.service_ns.map(|service| service.value));
        let [readout_row_ns, readout_event_ns] =
            service_ns.unwrap_or([clean.readout_row_ns, clean.readout_event_ns]);
        let (name, width, height) = (p.name.to_owned(), p.width_px, p.height_px);
        SensorModel { name, width, height, readout_row_ns, readout_event_ns, ..clean }
    })
}

/// As [`preset`], with the physical pixel of that sensor.
#[must_use]
pub fn preset_with_physical_pixel(name: &str) -> Option<SensorModel> {
    preset(name).map(SensorModel::with_preset_pixel)
}

impl SensorModel {
    /// This sensor with the physical pixel of the preset that it is named after
    /// ([`PHYSICAL_PRESETS`](crate::physical::PHYSICAL_PRESETS)), or with a physical pixel of its own parameters if it has
    /// another name. The noise is on. The readout stays as it is.
    #[must_use]
    pub fn with_preset_pixel(mut self) -> Self {
        let pixel = match physical_preset(&self.name) {
            Some(preset) => preset.apply(&mut self).0,
            None => self.physical_pixel(),
        };
        let lux_per_unit = self.lux_per_unit;
        self.with_physical(&PhysicalPixel { lux_per_unit, ..pixel })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ReadoutKind;

    #[test]
    fn every_preset_and_profile_is_valid() {
        for p in PRESETS {
            for profile in [Profile::Clean, Profile::Noisy, Profile::Paper] {
                for sensor in [preset(p.name), preset_with_physical_pixel(p.name)] {
                    let mut sensor = sensor.expect("listed");
                    profile.apply(&mut sensor);
                    sensor.validate().unwrap_or_else(|e| panic!("{} {profile:?}: {e}", p.name));
                }
            }
        }
        assert!(preset("nonesuch").is_none() && preset_with_physical_pixel("nonesuch").is_none());
    }

    #[test]
    fn every_preset_has_the_readout_of_its_sensor() {
        for p in PRESETS {
            let sensor = preset(p.name).expect("listed");
            assert_eq!(sensor.readout, ReadoutKind::None, "{}: off unless it is asked for", p.name);
            let (_, expected) = physical_preset(p.name).expect("listed").apply(&mut sensor.clone());
            let readout = if sensor.readout_row_ns > 0.0 { ReadoutKind::Rows } else { ReadoutKind::Fifo };
            let chosen = SensorModel { readout, ..sensor.clone() };
            assert_eq!((chosen.validate(), chosen.readout_model()), (Ok(()), expected), "{}", p.name);
            let word_serial = SensorModel { readout: ReadoutKind::Rows, ..sensor };
            assert_eq!(word_serial.validate().is_ok(), readout == ReadoutKind::Rows, "{}", p.name);
        }
    }

    #[test]
    fn profiles_switch_the_noise_of_the_physical_pixel() {
        let hd = preset_with_physical_pixel("hd").expect("listed");
        assert_eq!((hd.pixel, hd.noise_gain, hd.leak_rate_hz), (Pixel::Physical, 1.0, -0.06));
        let with = |profile: Profile| {
            let mut sensor = hd.clone();
            profile.apply(&mut sensor);
            (sensor.pixel, sensor.noise_gain, sensor.dark_spread_log)
        };
        assert_eq!(with(Profile::Clean), (Pixel::Physical, 0.0, 0.0));
        assert_eq!(with(Profile::Noisy), (Pixel::Physical, 1.0, 0.2));
        assert_eq!(with(Profile::Paper).0, Pixel::Log);
        let mut log = preset("hd").expect("listed");
        Profile::Noisy.apply(&mut log);
        assert_eq!(log.dark_spread_log, 0.0, "a log pixel has no dark current");
    }
}
