//! What a laboratory would measure of a sensor with a physical pixel. The engine's sensor stands in a box of stated
//! light ([`LightBox`](esaac_calibrate::LightBox)); beside what it measures are the model's closed forms and published
//! points ([`public`]).

pub mod noise;
pub mod public;
pub mod response;
pub mod s_curve;
pub mod saturation;
mod show;

pub use show::{document, plots};

use anyhow::{Context, Result, ensure};
use esaac_engine::Device;
use esaac_model::{Pixel, ReadoutKind, SensorModel};
use indicatif::{ProgressBar, ProgressStyle};
use noise::{LeakPoint, NoisePoint};
use public::Published;
use response::{BandwidthPoint, LatencyPoint, RefractoryPoint};
use s_curve::SCurve;
use saturation::SaturationPoint;
use serde::Serialize;
use std::sync::Arc;

/// A sensor whose events have the times at which their pixels send them, to the nanosecond: none waits for the bus. Its pixels
/// begin to watch with the light that they see first: in the little time of a step they would hardly leak, but a leak
/// would have brought them on their way to a threshold before. A laboratory's steps follow each other.
fn at_the_pixel(sensor: &SensorModel) -> SensorModel {
    SensorModel {
        timestamp_quantum_ns: 1,
        readout: ReadoutKind::None,
        readout_cap_events: 0,
        max_events_per_interval: 0,
        leak_rate_hz: 0.0,
        leak_per_lux_hz: 0.0,
        ..sensor.clone()
    }
}

/// A sensor whose pixels are alike and read what they are shown: without noise and delays, both thresholds the same.
fn without_noise(sensor: &SensorModel, threshold_log: f64) -> SensorModel {
    SensorModel {
        contrast_on: threshold_log,
        contrast_off: threshold_log,
        contrast_mismatch: 0.0,
        refractory_ns: 0,
        latency_ns: 0,
        latency_jitter_ns: 0,
        noise_gain: 0.0,
        dark_spread_log: 0.0,
        ..at_the_pixel(sensor)
    }
}

/// The device and how much is measured.
pub struct Lab<'a> {
    /// The device.
    pub device: &'a Arc<Device>,
    /// Pixels for each level of light, of S-curves and noise.
    pub pixels: u32,
    /// Time before noise is counted, seconds: noise rates depend on what a pixel has sent before.
    pub burn_in_s: u32,
    /// Time for which noise is counted, seconds.
    pub seconds: u32,
    /// The progress bar.
    pub progress: ProgressBar,
}

impl<'a> Lab<'a> {
    /// A laboratory with a progress bar on standard error.
    #[must_use]
    pub fn new(device: &'a Arc<Device>, pixels: u32, burn_in_s: u32, seconds: u32) -> Self {
        let style = ProgressStyle::with_template("{prefix:14} {bar:40} {pos}/{len} {spinner}, {elapsed}")
            .expect("the template is well formed");
        let progress = ProgressBar::new(CURVES).with_style(style);
        Lab { device, pixels, burn_in_s, seconds, progress }
    }

    fn begin(&self, curve: &str) {
        self.progress.set_prefix(curve.to_owned());
        self.progress.inc(1);
    }
}

/// Number of curves.
const CURVES: u64 = 7;

/// Everything that is measured of a sensor.
#[derive(Clone, Debug, Serialize)]
pub struct Characterisation {
    /// The sensor.
    pub sensor: SensorModel,
    /// Time before noise was counted, seconds.
    pub burn_in_s: u32,
    /// Time for which noise was counted, seconds.
    pub seconds: u32,
    /// Pixels for each level of light, of S-curves and noise.
    pub pixels: u32,
    /// S-curves.
    pub s_curves: Vec<SCurve>,
    /// Noise against light.
    pub noise: Vec<NoisePoint>,
    /// Bandwidth against light.
    pub bandwidth: Vec<BandwidthPoint>,
    /// Latency against light and contrast.
    pub latency: Vec<LatencyPoint>,
    /// Gaps between two events of a pixel against light.
    pub refractory: Vec<RefractoryPoint>,
    /// Leak against light and temperature.
    pub leak: Vec<LeakPoint>,
    /// Events that leave the bus against active pixels.
    pub saturation: Vec<SaturationPoint>,
    /// What is published about the sensor.
    pub published: Published,
}

/// Measures a sensor.
///
/// # Errors
/// A sensor without a physical pixel, and what the engine refuses.
pub fn characterise(lab: &Lab<'_>, sensor: &SensorModel) -> Result<Characterisation> {
    ensure!(
        sensor.pixel == Pixel::Physical,
        "sensor `{}` has a log-intensity pixel, whose speed and noise do not depend on light in lux; expected \
         `pixel = \"physical\"`",
        sensor.name
    );
    sensor.validate()?;
    // Its curve comes last.
    saturation::with_bus(sensor).validate().context("the sensor's bus, for the curve of its saturation")?;
    lab.begin("S-curve");
    let s_curves = s_curve::s_curves(lab, sensor)?;
    lab.begin("noise");
    let noise = noise::noise(lab, sensor)?;
    lab.begin("bandwidth");
    let bandwidth = response::bandwidth(lab, sensor)?;
    lab.begin("latency");
    let latency = response::latency(lab, sensor)?;
    lab.begin("refractory");
    let refractory = response::refractory(lab, sensor)?;
    lab.begin("leak");
    let leak = noise::leak(lab, sensor)?;
    lab.begin("saturation");
    let saturation = saturation::saturation(lab, sensor)?;
    lab.progress.finish_and_clear();
    Ok(Characterisation {
        burn_in_s: lab.burn_in_s,
        seconds: lab.seconds,
        pixels: lab.pixels,
        s_curves,
        noise,
        bandwidth,
        latency,
        refractory,
        leak,
        saturation,
        published: public::published_of(sensor),
        sensor: sensor.clone(),
    })
}
