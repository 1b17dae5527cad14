//! A recording of a sensor with known parameters: the engine's events of a moving pattern, with APS frames of eight
//! bits and inertial samples.

use crate::device::DEVICE;
use esaac_engine::{CameraConfig, FrameBytes, Rig};
use esaac_formats::recording::aedat4_writer::{Compression, ImuSample, write};
use esaac_formats::recording::{Aps, Recording};
use esaac_model::{HdrFormat, Intensity, SensorModel, Synthesis};
use std::path::Path;

/// Columns and rows.
pub const SIZE: (u32, u32) = (96, 72);

/// Time from one APS frame to the next, nanoseconds.
pub const FRAME_NS: i64 = 40_000_000;

/// Rendered frames per APS frame.
const RENDERED: usize = 8;

/// Full scale of the APS frames in the scene's units.
const WHITE: f64 = 4.0;

/// A sensor with every effect that calibration can fit.
#[must_use]
pub fn sensor() -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        contrast_on: 0.21,
        contrast_off: 0.29,
        contrast_mismatch: 0.03,
        leak_rate_hz: 1.5,
        shot_noise_rate_hz: 4.0,
        white_level: WHITE,
        intensity: Intensity::Gray,
        synthesis: Synthesis::Linear,
        timestamp_quantum_ns: 1_000,
        seed: 5,
        ..SensorModel::default()
    }
}

/// Light of a pixel: two waves of different length and direction. They move in the left half and rest in the right
/// half.
fn light(x: usize, y: usize, t_s: f64) -> f64 {
    let (x, y) = (x as f64, y as f64);
    let t_s = if x < f64::from(SIZE.0) / 2.0 { t_s } else { 0.0 };
    let wave = |u: f64, v: f64, hz: f64| (std::f64::consts::TAU * (u * x + v * y - hz * t_s)).sin();
    (0.8 * wave(0.031, 0.012, 2.3) + 0.5 * wave(-0.017, 0.043, 3.1)).exp()
}

/// Records `frames` APS frames and the events between them.
#[must_use]
pub fn record(sensor: &SensorModel, frames: usize) -> Recording {
    let config = CameraConfig {
        sensor: sensor.clone(),
        camera: 0,
        hdr: HdrFormat::F32x4,
        motion: None,
        geometry: None,
    };
    let mut rig = Rig::new(&DEVICE, &[config]).expect("a rig of one camera");
    let pixels = |t_s: f64| {
        (0..SIZE.1 as usize).flat_map(move |y| (0..SIZE.0 as usize).map(move |x| light(x, y, t_s)))
    };
    let mut recording =
        Recording { name: "simulated".into(), width_px: SIZE.0, height_px: SIZE.1, ..Recording::default() };
    for step in 0..=(frames - 1) * RENDERED {
        let t_ns = step as i64 * FRAME_NS / RENDERED as i64;
        let t_s = t_ns as f64 * 1e-9;
        let hdr: Vec<u8> = pixels(t_s).flat_map(|v| [v as f32; 4]).flat_map(f32::to_le_bytes).collect();
        rig.upload(0, &FrameBytes { hdr: &hdr, motion: None, ..FrameBytes::default() })
            .expect("a frame of the rig's size");
        recording.events.extend(rig.step(&[t_ns]).expect("frames in order").packets[0].iter());
        if step % RENDERED == 0 {
            // The APS frames of such sensors have eight bits.
            let quantised = |v: f64| ((v / WHITE).clamp(0.0, 1.0) * 255.0).round() / 255.0;
            let pixels = pixels(t_s).map(|v| quantised(v) as f32).collect();
            recording.frames.push(Aps { start_ns: t_ns - 1_000, end_ns: t_ns + 1_000, pixels });
        }
    }
    recording
}

/// Inertial samples of a camera at rest, at 1 kHz over the recording.
#[must_use]
pub fn imu(recording: &Recording) -> Vec<ImuSample> {
    let end_ns = recording.frames.last().map_or(0, Aps::middle_ns);
    (0..=end_ns / 1_000_000)
        .map(|ms| ImuSample {
            t_ns: ms * 1_000_000,
            acceleration_g: [0.0, -1.0, 0.0],
            turning_deg_per_s: [0.0; 3],
            temperature_c: 31.0,
        })
        .collect()
}

/// Writes the recording and its inertial samples to an AEDAT 4 file.
pub fn save(path: &Path, recording: &Recording) {
    let mut file = std::fs::File::create(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    write(&mut file, recording, &imu(recording), Compression::Lz4)
        .unwrap_or_else(|e| panic!("{}: {e:#}", path.display()));
}
