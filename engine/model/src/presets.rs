//! Sensors and noise profiles by name.

use crate::sensor::{SensorModel, SubstepPolicy, Synthesis, Timestamps};
use serde::{Deserialize, Serialize};

/// Log offset of the paper's `log(S + 1)`, for intensities of 8-bit scale.
pub const LOG_OFFSET_PAPER: f64 = 1.0;

/// Log offset for HDR scene units, near the dark level: a 50% step at S = 0.01 keeps 70% of its size
/// (the paper's offset leaves 1%).
pub const LOG_OFFSET_HDR: f64 = 0.01;

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
    /// Every effect on. The values are those of v2e's "noisy" setting where it has them.
    Noisy,
    /// The paper's event model: `log(S + 1)`, its warp, events at sample times, fixed sub-steps.
    Paper,
}

impl Profile {
    /// Sets the profile's parameters and leaves the others as they are.
    pub fn apply(self, sensor: &mut SensorModel) {
        let clean = SensorModel::default();
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
                sensor.leak_spread_log = 0.2;
                sensor.shot_noise_rate_hz = 5.0;
                sensor.latency_ns = 100_000;
                sensor.latency_jitter_ns = 10_000;
                sensor.timestamp_quantum_ns = 1_000;
            }
            Profile::Paper => {
                sensor.log_offset = LOG_OFFSET_PAPER;
                sensor.synthesis = Synthesis::Paper;
                sensor.timestamps = Timestamps::AtSample;
                sensor.substep_policy = SubstepPolicy::Fixed;
            }
        }
    }
}

/// The sensor of the preset with this name, if there is one.
#[must_use]
pub fn preset(name: &str) -> Option<SensorModel> {
    PRESETS.iter().find(|p| p.name == name).map(|p| SensorModel {
        name: p.name.to_owned(),
        width: p.width_px,
        height: p.height_px,
        ..SensorModel::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_and_profile_is_valid() {
        for p in PRESETS {
            for profile in [Profile::Clean, Profile::Noisy, Profile::Paper] {
                let mut sensor = preset(p.name).expect("listed");
                profile.apply(&mut sensor);
                sensor.validate().unwrap_or_else(|e| panic!("{} {profile:?}: {e}", p.name));
            }
        }
        assert!(preset("nonesuch").is_none());
    }
}
