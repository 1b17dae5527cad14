//! Saturation of the bus: how many events leave the sensor against how many pixels are active.

use super::{Lab, without_noise};
use anyhow::Result;
use esaac_calibrate::LightBox;
use esaac_model::physical::Bus;
use esaac_model::{ReadoutKind, SensorModel};
use serde::Serialize;

/// Columns and rows of the part of the sensor that is lit.
const SIZE_PX: (u32, u32) = (64, 64);

/// Active pixels, row by row from the upper left one on.
const ACTIVE: [usize; 7] = [64, 128, 256, 512, 1024, 2048, 4096];

/// What all pixels together ask for, over what the bus can do.
const LOAD: f64 = 2.0;

/// Threshold of the pixels, log, and their second pole; events of a pixel in an interval; intervals before events are counted, and in which they
/// are.
const THRESHOLD_LOG: f64 = 0.01;
const SECOND_POLE_HZ: f64 = 1e6;
const PER_INTERVAL: f64 = 8.0;
const SETTLING: i64 = 2;
const COUNTED: i64 = 5;

/// Light before it rises, lux: so bright that pixels follow at once.
const LUX: f64 = 1e4;

/// Events that leave if so many pixels are active.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SaturationPoint {
    /// Pixels whose light rises.
    pub active: usize,
    /// Events that these ask for, in a second.
    pub asked_hz: f64,
    /// Events that leave the sensor, in a second.
    pub left_hz: f64,
    /// The same by the equation: what is asked for, and no more than if each pixel always has one event waiting.
    pub model_hz: f64,
}

/// The saturation of the sensor's own bus, whether it is on or not.
pub fn saturation(lab: &Lab<'_>, sensor: &SensorModel) -> Result<Vec<SaturationPoint>> {
    ACTIVE.iter().map(|&active| saturation_at(lab, sensor, active)).collect()
}

/// The sensor's bus before pixels that send as many events as the light asks for. With the sensor's own thresholds,
/// refractory period and speed these would saturate before the bus does.
pub(super) fn with_bus(sensor: &SensorModel) -> SensorModel {
    let readout = if sensor.readout_row_ns > 0.0 { ReadoutKind::Rows } else { ReadoutKind::Fifo };
    SensorModel {
        width: SIZE_PX.0,
        height: SIZE_PX.1,
        readout,
        second_pole_hz: SECOND_POLE_HZ,
        ..without_noise(sensor, THRESHOLD_LOG)
    }
}

/// What the curve is of, for its table.
pub(super) fn told() -> String {
    let (width, height) = SIZE_PX;
    format!(
        "The curve is that of the sensor's bus, not of its pixels: of its service times, before {width}x{height} pixels whose \
         light rises together. So that they, and not their speed, ask for more than the bus can do, they have thresholds of \
         {THRESHOLD_LOG}, no refractory period, a second pole of {:.0} MHz, and neither noise, mismatch, leak nor delay. The \
         rate controller is off.",
        SECOND_POLE_HZ * 1e-6
    )
}

/// The saturation with so many active pixels. Their light rises steadily in log, so that each sends events at the same rate
/// and all of them at the same instants.
pub fn saturation_at(lab: &Lab<'_>, sensor: &SensorModel, active: usize) -> Result<SaturationPoint> {
    let with_bus = with_bus(sensor);
    let pixels = (SIZE_PX.0 * SIZE_PX.1) as usize;
    let rate_hz = LOAD * most_hz(&with_bus, pixels) / pixels as f64;
    let asked_hz =
        rate(lab, &SensorModel { readout: ReadoutKind::None, ..with_bus.clone() }, active, rate_hz)?;
    let left_hz = rate(lab, &with_bus, active, rate_hz)?;
    Ok(SaturationPoint { active, asked_hz, left_hz, model_hz: asked_hz.min(most_hz(&with_bus, active)) })
}

/// Events a second that leave if each of the active pixels always has one waiting.
fn most_hz(sensor: &SensorModel, active: usize) -> f64 {
    let rows = active.div_ceil(SIZE_PX.0 as usize) as f64;
    let all_ps = match sensor.readout_model().bus {
        Bus::Ideal => 0.0,
        Bus::Fifo { event_ps } => active as f64 * event_ps as f64,
        Bus::Rows { row_ps, event_ps } => rows * row_ps as f64 + active as f64 * event_ps as f64,
    };
    active as f64 / (all_ps * 1e-12)
}

/// Events a second of a sensor whose active pixels send `rate_hz` each.
fn rate(lab: &Lab<'_>, sensor: &SensorModel, active: usize, rate_hz: f64) -> Result<f64> {
    let mut light = LightBox::new(lab.device, sensor, SIZE_PX, 1)?;
    let interval_ns = ((PER_INTERVAL / rate_hz * 1e9) as i64).clamp(1_000, 1_000_000_000);
    let slope_log = rate_hz * THRESHOLD_LOG * interval_ns as f64 * 1e-9;
    let mut count = 0;
    for interval in 0..=SETTLING + COUNTED {
        let risen = LUX * (slope_log * interval as f64).exp();
        let events = light.show(interval * interval_ns, |pixel| if pixel < active { risen } else { LUX })?;
        count += if interval > SETTLING { events.len() } else { 0 };
    }
    lab.progress.tick();
    Ok(count as f64 / (COUNTED * interval_ns) as f64 * 1e9)
}
