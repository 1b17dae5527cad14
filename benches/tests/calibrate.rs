//! A sensor of known parameters is recovered from its own recording, through the engine on both sides.

use esaac_benches::calibrate::{fit, simulate};
use esaac_benches::recording::{Aps, Recording};
use esaac_engine::{CameraConfig, FrameBytes, Rig};
use esaac_model::{HdrFormat, Intensity, SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};

const SIZE: (u32, u32) = (96, 72);

/// Frames of the recording and renderings between two of them.
const FRAMES: usize = 41;
const RENDERED: usize = 8;

const FRAME_NS: i64 = 40_000_000;

/// Full scale of the frames in the scene's units.
const WHITE: f64 = 4.0;

/// How far off a fit may be: thresholds by a share, the others by what counts of events leave open.
const THRESHOLD_SHARE: f64 = 0.05;
const MISMATCH_LOG: f64 = 0.015;
const RATE_SHARE: f64 = 0.25;

/// Light of a pixel: two waves of different length and direction that move in the left half; the right half
/// stands still.
fn light(x: usize, y: usize, t_s: f64) -> f64 {
    let (x, y) = (x as f64, y as f64);
    let t_s = if x < f64::from(SIZE.0) / 2.0 { t_s } else { 0.0 };
    let wave = |u: f64, v: f64, hz: f64| (std::f64::consts::TAU * (u * x + v * y - hz * t_s)).sin();
    (0.8 * wave(0.031, 0.012, 2.3) + 0.5 * wave(-0.017, 0.043, 3.1)).exp()
}

/// What a sensor would have recorded.
fn record(sensor: &SensorModel) -> Recording {
    let config = CameraConfig { sensor: sensor.clone(), camera: 0, hdr: HdrFormat::F32x4, motion: None };
    let mut rig = Rig::new(&DEVICE, &[config]).unwrap();
    let pixels = |t_s: f64| {
        (0..SIZE.1 as usize).flat_map(move |y| (0..SIZE.0 as usize).map(move |x| light(x, y, t_s)))
    };
    let mut recording =
        Recording { name: "simulated".into(), width_px: SIZE.0, height_px: SIZE.1, ..Recording::default() };
    for step in 0..=(FRAMES - 1) * RENDERED {
        let t_ns = step as i64 * FRAME_NS / RENDERED as i64;
        let t_s = t_ns as f64 * 1e-9;
        let hdr: Vec<u8> = pixels(t_s).flat_map(|v| [v as f32; 4]).flat_map(f32::to_le_bytes).collect();
        rig.upload(0, &FrameBytes { hdr: &hdr, motion: None }).unwrap();
        recording.events.extend(rig.step(&[t_ns]).unwrap().packets[0].iter());
        if step % RENDERED == 0 {
            // Eight bits, as an APS has them.
            let quantised = |v: f64| ((v / WHITE).clamp(0.0, 1.0) * 255.0).round() / 255.0;
            let pixels = pixels(t_s).map(|v| quantised(v) as f32).collect();
            recording.frames.push(Aps { start_ns: t_ns - 1_000, end_ns: t_ns + 1_000, pixels });
        }
    }
    drop(rig);
    recording
}

fn sensor() -> SensorModel {
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

#[test]
fn a_known_sensor_is_recovered_from_its_recording() {
    let known = sensor();
    let recording = record(&known);
    let fit = fit(&DEVICE, &recording, 0.01).unwrap();
    let found = &fit.sensor;
    println!("{fit:?}");
    let share = |what: &str, actual: f64, expected: f64, bound: f64| {
        assert!(
            (actual / expected - 1.0).abs() <= bound,
            "{what}: {actual:.4}, expected {expected} +- {bound}"
        );
    };
    share("contrast_on", found.contrast_on, known.contrast_on, THRESHOLD_SHARE);
    share("contrast_off", found.contrast_off, known.contrast_off, THRESHOLD_SHARE);
    share("leak_rate_hz", found.leak_rate_hz, known.leak_rate_hz, RATE_SHARE);
    share("shot_noise_rate_hz", found.shot_noise_rate_hz, known.shot_noise_rate_hz, RATE_SHARE);
    let mismatch = (found.contrast_mismatch - known.contrast_mismatch).abs();
    assert!(mismatch <= MISMATCH_LOG, "contrast_mismatch: {:.4}", found.contrast_mismatch);
    // What it writes is a sensor file.
    assert_eq!(SensorModel::from_toml(&found.to_toml()).as_ref(), Ok(found));
    assert_silent();
}

#[test]
fn a_clean_sensor_has_no_noise_found_in_it() {
    let known = SensorModel {
        contrast_mismatch: 0.0,
        leak_rate_hz: 0.0,
        shot_noise_rate_hz: 0.0,
        contrast_on: 0.35,
        contrast_off: 0.25,
        ..sensor()
    };
    let found = fit(&DEVICE, &record(&known), 0.01).unwrap().sensor;
    println!("{found:?}");
    assert!((found.contrast_on / 0.35 - 1.0).abs() <= THRESHOLD_SHARE, "{}", found.contrast_on);
    assert!((found.contrast_off / 0.25 - 1.0).abs() <= THRESHOLD_SHARE, "{}", found.contrast_off);
    assert!(found.contrast_mismatch <= MISMATCH_LOG, "{}", found.contrast_mismatch);
    assert_eq!((found.leak_rate_hz, found.shot_noise_rate_hz), (0.0, 0.0));
    assert_silent();
}

#[test]
fn recordings_that_say_nothing_are_errors() {
    let mut recording = record(&sensor());
    let error = |recording: &Recording| format!("{:#}", fit(&DEVICE, recording, 0.01).unwrap_err());
    let frames = std::mem::take(&mut recording.frames);
    recording.frames = frames[..4].to_vec();
    assert!(error(&recording).contains("4 APS frames, expected at least 5"));
    recording.frames = vec![frames[0].clone(); 6];
    for (k, frame) in recording.frames.iter_mut().enumerate() {
        (frame.start_ns, frame.end_ns) = (k as i64 * FRAME_NS, k as i64 * FRAME_NS + 2_000);
    }
    assert!(error(&recording).contains("no thresholds follow"));
    recording.events.clear();
    assert!(error(&recording).contains("no events"));
    // Frames further apart than an interval may be.
    recording.frames[5].start_ns += 2_000_000_000;
    recording.frames[5].end_ns += 2_000_000_000;
    let late = simulate(&DEVICE, &recording, &sensor()).unwrap_err();
    assert!(format!("{late:#}").contains("frame 5"), "{late:#}");
}
