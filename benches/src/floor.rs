//! Lower bound on the time of an interval: bytes over the memory's bandwidth, or operations over the arithmetic rate.
//! Both rates are measured on the same device.

use esaac_model::{HdrFormat, Intensity, MotionFormat, SensorModel, Synthesis, Taps};
use serde::Serialize;

/// Bytes of an event in a packet: u32 time, two u16, u8.
pub const EVENT_BYTES: f64 = 9.0;

/// Bytes that an event moves before it is in the packet: eight, written to its bin and read again.
const EMITTED_BYTES: f64 = 2.0 * 8.0;

/// The highest rates of a device, measured in this run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rates {
    /// Bytes read and written a second.
    pub bytes_per_s: f64,
    /// f32 multiplications and additions a second.
    pub operations_per_s: f64,
}

/// Formats of the images. Measurements that use others say so.
pub const FORMATS: (HdrFormat, MotionFormat) = (HdrFormat::F16x4, MotionFormat::F32x2);

fn channels(sensor: &SensorModel) -> f64 {
    if sensor.intensity == Intensity::BayerRggb { 3.0 } else { 1.0 }
}

fn has_half_pel_frames(sensor: &SensorModel) -> bool {
    sensor.synthesis.has_half_pels() && sensor.taps == Taps::Cubic
}

/// Depth as f32 and instance id as u32.
const GEOMETRY_BYTES: f64 = 4.0 + 4.0;

/// Surface of a pixel: inverse depth, instance and bits, slopes.
const SURFACE_BYTES: f64 = 8.0 + 4.0;

/// Bytes that any implementation has to move for an interval of one camera: it reads the images and the previous
/// frame's planes and vectors (or depth and ids), reads and writes each pixel's reference, and writes the packet.
#[must_use]
pub fn compulsory_bytes(sensor: &SensorModel, hdr: HdrFormat, motion: MotionFormat, events: f64) -> f64 {
    let path_bytes = match sensor.synthesis {
        Synthesis::Rigid => 2.0 * GEOMETRY_BYTES,
        of_vectors if of_vectors.needs_motion() => 2.0 * motion.texel_bytes() as f64,
        _ => 0.0,
    };
    let pixel = hdr.texel_bytes() as f64 + path_bytes + 4.0 * channels(sensor) + 2.0 * 4.0;
    sensor.pixels() as f64 * pixel + EVENT_BYTES * events
}

/// Bytes that this engine's stages read and write for an interval of one camera. Each buffer counts once for every
/// stage that reads or writes it. This is a count, not a measurement.
#[must_use]
pub fn moved_bytes(sensor: &SensorModel, hdr: HdrFormat, motion: MotionFormat, events: f64) -> f64 {
    let pixels = sensor.pixels() as f64;
    let frame = 4.0 * channels(sensor) * pixels;
    let planes = if has_half_pel_frames(sensor) {
        let entries = f64::from(2 * sensor.width + 4) * f64::from(2 * sensor.height + 3);
        let half_pel_frame = 4.0 * channels(sensor) * entries;
        // Each transfer reads one half-pel frame and writes the other, `cross` reads both.
        2.0 * half_pel_frame * f64::from(sensor.detail_transfers()) + 2.0 * half_pel_frame
    } else {
        3.0 * frame
    };
    let paths = match sensor.synthesis {
        // `ingest` writes a frame's surfaces, `cross` reads those of both.
        Synthesis::Rigid => GEOMETRY_BYTES + 3.0 * SURFACE_BYTES,
        of_vectors if of_vectors.needs_motion() => motion.texel_bytes() as f64 + 3.0 * 8.0,
        _ => 0.0,
    };
    let words = 2.0
        + if sensor.contrast_mismatch > 0.0 { 2.0 } else { 0.0 }
        + if sensor.refractory_ns > 0 { 4.0 } else { 0.0 }
        + if sensor.leak_rate_hz > 0.0 { 1.0 } else { 0.0 }
        + if sensor.shot_noise_rate_hz > 0.0 { 8.0 } else { 0.0 }
        + if sensor.latency_jitter_ns > 0 { 2.0 } else { 0.0 };
    let pixel = hdr.texel_bytes() as f64 + paths + 4.0 * words;
    pixels * pixel + planes + (EMITTED_BYTES + EVENT_BYTES) * events
}

/// Operations of one sub-step of one pixel, counted by hand in the model's equations: addresses, taps, weights,
/// exponential or logarithm, crossing test.
#[must_use]
pub fn operations_per_sample(sensor: &SensorModel) -> f64 {
    let one_plane = match (sensor.synthesis, sensor.taps) {
        (Synthesis::None, _) => 10.0,
        (Synthesis::Linear, _) => 30.0,
        (Synthesis::Paper, _) => 50.0,
        (Synthesis::Motion | Synthesis::Auto, Taps::Bilinear) => 100.0,
        // The trajectory takes 10. Each of two frames takes 62: cell and address 10, loads 12, weights 12, rows and
        // columns 20, clamping 8. Blending and crossing test take 16.
        (Synthesis::Motion | Synthesis::Auto, Taps::Cubic) => 150.0,
        // As `motion` with one candidate, and 60 for the exact path in place of 10.
        (Synthesis::Rigid, Taps::Bilinear) => 150.0,
        (Synthesis::Rigid, Taps::Cubic) => 200.0,
    };
    // A pixel of a mosaic reads only the plane of its own colour, so this holds for Bayer as well.
    one_plane
}

/// Least time of an interval of all cameras, in microseconds. `samples` counts the sub-steps of all pixels.
#[must_use]
pub fn floor_us(rates: Rates, bytes: f64, samples: f64, operations_per_sample: f64) -> f64 {
    let memory_s = bytes / rates.bytes_per_s;
    let arithmetic_s = samples * operations_per_sample / rates.operations_per_s;
    memory_s.max(arithmetic_s) * 1e6
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::presets::preset;

    #[test]
    fn more_work_has_a_higher_floor() {
        let (hdr, motion) = FORMATS;
        let cubic = SensorModel { synthesis: Synthesis::Motion, ..preset("genx320").expect("a preset") };
        let rigid = SensorModel { synthesis: Synthesis::Rigid, ..cubic.clone() };
        let bilinear = SensorModel { taps: Taps::Bilinear, ..cubic.clone() };
        let bayer = SensorModel { intensity: Intensity::BayerRggb, ..cubic.clone() };
        for bytes in [compulsory_bytes, moved_bytes] {
            let of = |sensor| bytes(sensor, hdr, motion, 1e5);
            assert!(of(&bayer) > of(&cubic) && of(&cubic) >= of(&bilinear) && of(&rigid) >= of(&cubic));
            assert!(bytes(&cubic, hdr, motion, 0.0) < of(&cubic));
        }
        assert!(moved_bytes(&cubic, hdr, motion, 1e5) > compulsory_bytes(&cubic, hdr, motion, 1e5));
        let rates = Rates { bytes_per_s: 1e12, operations_per_s: 1e13 };
        assert_eq!(floor_us(rates, 1e6, 0.0, 250.0), 1.0);
        assert_eq!(floor_us(rates, 1e6, 1e6, 250.0), 25.0);
    }
}
