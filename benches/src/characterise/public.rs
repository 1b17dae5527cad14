//! What has been published about real sensors: points that stand in the plots.

use super::response::LightStep;
use esaac_model::SensorModel;
use esaac_model::physical::light::WHITE_EFFICACY_LM_PER_W;
use esaac_model::presets::preset_with_physical_pixel;
use serde::Serialize;

/// Published noise at a light.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PublishedNoise {
    /// Light, focal-plane lux.
    pub lux: f64,
    /// ON events of a pixel and second.
    pub on_hz: f64,
    /// OFF events of a pixel and second.
    pub off_hz: f64,
}

/// A published latency.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PublishedLatency {
    /// The step.
    pub step: LightStep,
    /// The brighter light, focal-plane lux.
    pub lux: f64,
    /// Latency, microseconds.
    pub us: f64,
}

/// A published corner frequency.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PublishedBandwidth {
    /// Light, focal-plane lux.
    pub lux: f64,
    /// Frequency, Hz.
    pub hz: f64,
}

/// What is published about a preset's sensor.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Published {
    /// Noise, and its source.
    pub noise: Vec<PublishedNoise>,
    /// Latency.
    pub latency: Vec<PublishedLatency>,
    /// Bandwidth.
    pub bandwidth: Vec<PublishedBandwidth>,
    /// Refractory period, microseconds.
    pub refractory_us: Option<f64>,
    /// Where all that comes from.
    pub sources: Vec<&'static str>,
}

/// Noise of an EVK4 at its default biases: lux, ON and OFF, Hz.
const EVK4_NOISE: [(f64, f64, f64); 8] = [
    (0.15, 0.18, 0.31),
    (0.5, 0.40, 0.48),
    (1.0, 0.56, 0.59),
    (2.0, 0.64, 0.67),
    (5.0, 0.44, 0.55),
    (10.0, 0.17, 0.31),
    (20.0, 0.035, 0.11),
    (50.0, 0.010, 0.035),
];

/// Irradiance at which NIST measured latencies, W/m2.
pub const NIST_W_PER_M2: [f64; 3] = [0.006, 0.046, 0.398];

/// ON latencies of an IMX646 and a Gen3.1, microseconds. The latter are those of NIST's fit, 369 + 2.85 / E.
const IMX646_ON_US: [f64; 3] = [562.0, 102.0, 32.0];
const GEN31_ON_US: [f64; 3] = [844.0, 431.0, 376.0];

/// OFF latency of the IMX646 at the least irradiance, microseconds.
const IMX646_OFF_US: f64 = 657.0;

/// Focal-plane lux of a white light's irradiance.
#[must_use]
pub fn lux_of(w_per_m2: f64) -> f64 {
    WHITE_EFFICACY_LM_PER_W * w_per_m2
}

const NIST: &str = "latencies: NIST, IEEE TIM 2025, digitised; W/m2 taken as white light";
const STILL: &str =
    "still noise of .05 to .1 Hz at 25 C, second-hand; here at 10 lux, an office behind a lens";

/// What is published about a sensor that is a preset with its physical pixel. Another sensor of the same name has other
/// parameters that its figures follow from: nothing is published about it.
#[must_use]
pub fn published_of(sensor: &SensorModel) -> Published {
    match preset_with_physical_pixel(&sensor.name) {
        Some(preset) if is_alike(sensor, &preset) => published(&sensor.name),
        _ => Published::default(),
    }
}

/// Whether two sensors differ in nothing but what the characterisation replaces, what a log-intensity pixel alone reads,
/// seed, and readout.
fn is_alike(sensor: &SensorModel, preset: &SensorModel) -> bool {
    let changed_back = SensorModel {
        width: preset.width,
        height: preset.height,
        seed: preset.seed,
        // The light box's.
        lux_per_unit: preset.lux_per_unit,
        exposure_gain: preset.exposure_gain,
        intensity: preset.intensity,
        psf_sigma_px: preset.psf_sigma_px,
        vignetting_fov_deg: preset.vignetting_fov_deg,
        flicker_depth: preset.flicker_depth,
        flicker_hz: preset.flicker_hz,
        flicker_phase_deg: preset.flicker_phase_deg,
        synthesis: preset.synthesis,
        taps: preset.taps,
        transfers: preset.transfers,
        layers: preset.layers,
        substeps: preset.substeps,
        substep_policy: preset.substep_policy,
        substep_error_ns: preset.substep_error_ns,
        aps_exposure_ns: preset.aps_exposure_ns,
        aps_start_ns: preset.aps_start_ns,
        aps_gain: preset.aps_gain,
        aps_bits: preset.aps_bits,
        // The log-intensity pixel's.
        shot_noise_rate_hz: preset.shot_noise_rate_hz,
        log_offset: preset.log_offset,
        white_level: preset.white_level,
        // Published noise and speed are of pixels, whatever their bus does.
        readout: preset.readout,
        readout_event_ns: preset.readout_event_ns,
        readout_row_ns: preset.readout_row_ns,
        readout_cap_events: preset.readout_cap_events,
        readout_cap_period_ns: preset.readout_cap_period_ns,
        ..sensor.clone()
    };
    changed_back == *preset
}

/// What is published about the sensor of a preset; nothing for one that is not listed.
#[must_use]
pub fn published(preset: &str) -> Published {
    let on = |us: [f64; 3]| {
        let points = NIST_W_PER_M2.into_iter().zip(us);
        points.map(|(e, us)| PublishedLatency { step: LightStep::FromDark, lux: lux_of(e), us }).collect()
    };
    // OFF as often as ON: only the sum is published.
    let still = |hz: f64| PublishedNoise { lux: 10.0, on_hz: 0.5 * hz, off_hz: 0.5 * hz };
    match preset {
        "hd" => {
            let mut latency: Vec<PublishedLatency> = on(IMX646_ON_US);
            let lux = lux_of(NIST_W_PER_M2[0]);
            latency.push(PublishedLatency { step: LightStep::ToDark, lux, us: IMX646_OFF_US });
            let noise = EVK4_NOISE.map(|(lux, on_hz, off_hz)| PublishedNoise { lux, on_hz, off_hz });
            Published {
                noise: noise.to_vec(),
                latency,
                refractory_us: Some(79.0),
                sources: vec!["noise, refractory period: EVK4, Noise2Params, arXiv 2605.16317", NIST],
                ..Published::default()
            }
        }
        "vga" => Published { latency: on(GEN31_ON_US), sources: vec![NIST], ..Published::default() },
        "dvs128" => Published {
            noise: vec![still(0.05), still(0.1)],
            bandwidth: vec![
                PublishedBandwidth { lux: 10.0, hz: 3000.0 },
                PublishedBandwidth { lux: 0.01, hz: 300.0 },
            ],
            sources: vec![
                STILL,
                "bandwidth: 3 kHz at a scene of 1 klux, JSSC 43(2), 2008; 300 Hz at a thousandth, second-hand",
            ],
            ..Published::default()
        },
        "davis240" | "davis346" => {
            Published { noise: vec![still(0.05), still(0.1)], sources: vec![STILL], ..Published::default() }
        }
        _ => Published::default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::{Pixel, ReadoutKind, Synthesis};

    fn hd() -> SensorModel {
        preset_with_physical_pixel("hd").expect("listed")
    }

    #[test]
    fn figures_are_published_of_the_preset_alone() {
        let has = |sensor: &SensorModel| !published_of(sensor).sources.is_empty();
        let from_file = SensorModel::from_toml(&hd().to_toml()).unwrap();
        let elsewhere = SensorModel {
            width: 64,
            height: 64,
            seed: 7,
            lux_per_unit: 3.0,
            synthesis: Synthesis::Linear,
            substeps: 8,
            readout: ReadoutKind::Rows,
            ..hd()
        };
        for sensor in [hd(), from_file, elsewhere] {
            assert!(has(&sensor), "{sensor:?}");
        }
        let others: [fn(&mut SensorModel); 12] = [
            |s| s.name = "mine".to_owned(),
            |s| s.pixel = Pixel::Log,
            |s| s.contrast_on = 0.3,
            |s| s.contrast_off = 0.3,
            |s| s.contrast_mismatch = 0.05,
            |s| s.refractory_ns = 500_000,
            |s| s.dark_lux = 0.1,
            |s| s.photoreceptor_charge_e = 200.0,
            |s| s.second_pole_hz = 2000.0,
            |s| s.noise_gain = 0.5,
            |s| s.temperature_c = 60.0,
            |s| s.leak_rate_hz = 0.1,
        ];
        for change in others {
            let mut sensor = hd();
            change(&mut sensor);
            assert!(!has(&sensor), "{sensor:?}");
        }
    }
}
