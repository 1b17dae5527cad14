//! Whole frames through every stage: formats, mosaics, syntheses, diagnostics, APS.

use esaac_model::intensity::bayer_component;
use esaac_model::{
    FrameError, HdrFormat, Intensity, MotionFormat, SensorModel, SubstepPolicy, Synthesis, Taps,
};
use esaac_oracle::{Frame, Interval, Oracle};

const FRAME_NS: i64 = 33_333_333;

fn sensor(width: u32, height: u32) -> SensorModel {
    SensorModel { width, height, substeps: 8, substep_policy: SubstepPolicy::Fixed, ..SensorModel::default() }
}

fn hdr(sensor: &SensorModel, rgb: impl Fn(u32, u32) -> [f32; 3]) -> Vec<u8> {
    let texels = (0..sensor.height).flat_map(|y| (0..sensor.width).map(move |x| (x, y)));
    texels
        .flat_map(|(x, y)| {
            let [r, g, b] = rgb(x, y);
            [r, g, b, 1.0]
        })
        .flat_map(f32::to_le_bytes)
        .collect()
}

fn motion(sensor: &SensorModel, v: [f32; 2]) -> Vec<u8> {
    (0..sensor.pixels()).flat_map(|_| v).flat_map(f32::to_le_bytes).collect()
}

fn step(oracle: &mut Oracle, k: i64, hdr: &[u8], motion: &[u8]) -> Interval {
    let frame = Frame {
        t_ns: k * FRAME_NS,
        hdr: (HdrFormat::F32x4, hdr),
        motion: Some((MotionFormat::F32x2, motion)),
        depth: None,
        ids: None,
    };
    oracle.step(&frame).expect("a valid frame")
}

/// A texture of several colours, moved by `shift` pixels along x.
fn texture(shift: f32) -> impl Fn(u32, u32) -> [f32; 3] {
    move |x, y| {
        let (x, y) = (x as f32 - shift, y as f32);
        [
            (0.9 * (0.7 * x).sin()).exp(),
            (0.5 * (0.4 * x + 0.6 * y).cos()).exp(),
            (0.8 * (0.5 * x).cos()).exp(),
        ]
    }
}

const SYNTHESES: [Synthesis; 4] = [Synthesis::Motion, Synthesis::Linear, Synthesis::Paper, Synthesis::None];
const INTENSITIES: [Intensity; 3] = [Intensity::Gray, Intensity::Luminance, Intensity::BayerRggb];

#[test]
fn a_still_scene_is_silent_in_every_mode_and_odd_size() {
    for (width, height) in [(1, 1), (1, 9), (7, 1), (9, 17)] {
        for synthesis in SYNTHESES {
            for intensity in INTENSITIES {
                for taps in [Taps::Cubic, Taps::Bilinear] {
                    let policy = SubstepPolicy::Adaptive;
                    let base = sensor(width, height);
                    let sensor = SensorModel { synthesis, intensity, taps, substep_policy: policy, ..base };
                    let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
                    let (colour, still) = (hdr(&sensor, texture(0.0)), motion(&sensor, [0.0; 2]));
                    for k in 0..5 {
                        let got = step(&mut oracle, k, &colour, &still);
                        assert!(
                            got.packet.is_empty(),
                            "{width}x{height} {synthesis:?} {intensity:?} {taps:?}"
                        );
                        assert!(got.substeps_per_block.iter().all(|&n| n == 1));
                    }
                }
            }
        }
    }
}

#[test]
fn samples_begin_and_end_at_the_frames() {
    for synthesis in SYNTHESES {
        for intensity in INTENSITIES {
            let sensor = SensorModel { synthesis, intensity, ..sensor(19, 11) };
            let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
            oracle.keep_samples(true);
            let moving = motion(&sensor, [-1.5, 0.25]);
            step(&mut oracle, 0, &hdr(&sensor, texture(0.0)), &moving);
            let got = step(&mut oracle, 1, &hdr(&sensor, texture(1.5)), &moving);
            let samples = got.samples.expect("asked for");
            for y in 0..sensor.height {
                for x in 0..sensor.width {
                    let weights = esaac_model::intensity::weights(intensity, x, y);
                    let rgb = texture(1.5)(x, y).map(f64::from);
                    let expected: f64 = (0..3).map(|c| weights[c] * rgb[c]).sum();
                    let at = samples.at((y * sensor.width + x) as usize);
                    assert_eq!(at.len(), if synthesis == Synthesis::None { 1 } else { 8 });
                    assert!((at[at.len() - 1] / expected - 1.0).abs() < 1e-12);
                }
            }
        }
    }
}

#[test]
fn a_mosaic_is_sampled_after_the_warp() {
    let sensor =
        SensorModel { synthesis: Synthesis::Paper, intensity: Intensity::BayerRggb, ..sensor(24, 4) };
    let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
    oracle.keep_samples(true);
    // Each colour is uniform over the image, so that no event may come. Warping a mosaic would mix the colours.
    let flat = hdr(&sensor, |_, _| [1.0, 2.0, 3.0]);
    let moving = motion(&sensor, [-3.3, 0.7]);
    step(&mut oracle, 0, &flat, &moving);
    let got = step(&mut oracle, 1, &flat, &moving);
    assert!(got.packet.is_empty());
    let samples = got.samples.unwrap();
    for y in 0..4 {
        for x in 0..24 {
            let expected = [1.0, 2.0, 3.0][bayer_component(x, y)];
            for sample in samples.at((y * 24 + x) as usize) {
                assert!((sample - expected).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn an_invalid_vector_falls_back_to_linear_and_is_counted() {
    for synthesis in [Synthesis::Motion, Synthesis::Paper] {
        let sensor = SensorModel { synthesis, ..sensor(19, 11) };
        let linear = SensorModel { synthesis: Synthesis::Linear, ..sensor.clone() };
        let pixel = 5 * 19 + 7;
        let mut moving = motion(&sensor, [-1.5, 0.0]);
        moving[pixel * 8 + 4..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        let run = |sensor: &SensorModel| {
            let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
            oracle.keep_samples(true);
            step(&mut oracle, 0, &hdr(sensor, texture(0.0)), &moving);
            step(&mut oracle, 1, &hdr(sensor, texture(1.5)), &moving)
        };
        let (got, linear) = (run(&sensor), run(&linear));
        assert_eq!(got.diagnostics.invalid_motion, 1);
        let (samples, linear) = (got.samples.unwrap(), linear.samples.unwrap());
        assert_eq!(samples.at(pixel), linear.at(pixel));
        assert_ne!(samples.at(pixel + 1), linear.at(pixel + 1));
        assert!(
            (0..sensor.pixels()).all(|pixel| samples.at(pixel).iter().all(|s| s.is_finite() && *s >= 0.0))
        );
    }
}

#[test]
fn an_invalid_texel_is_held_and_counted() {
    let sensor = SensorModel { synthesis: Synthesis::Linear, ..sensor(4, 2) };
    let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
    let still = motion(&sensor, [0.0; 2]);
    step(&mut oracle, 0, &hdr(&sensor, |_, _| [1.0; 3]), &still);
    let broken = hdr(&sensor, |x, _| [if x == 1 { f32::INFINITY } else { 1.0 }, 4.0, 1.0]);
    let got = step(&mut oracle, 1, &broken, &still);
    assert_eq!(got.diagnostics.invalid_pixels, 2);
    assert!(!got.packet.is_empty() && got.packet.x.iter().all(|&x| x != 1));
    let back = step(&mut oracle, 2, &hdr(&sensor, |_, _| [1.0, 4.0, 1.0]), &still);
    assert!(back.packet.x.iter().all(|&x| x == 1));
}

#[test]
fn aps_is_the_mean_over_the_exposure_with_motion_blur() {
    let base =
        SensorModel { aps_start_ns: 8_333_333, aps_exposure_ns: 16_666_667, aps_bits: 12, ..sensor(2, 1) };
    let sensor = SensorModel { synthesis: Synthesis::Linear, white_level: 4.0, aps_gain: 2.0, ..base };
    let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
    let still = motion(&sensor, [0.0; 2]);
    let first = step(&mut oracle, 0, &hdr(&sensor, |_, _| [1.0; 3]), &still);
    assert_eq!(first.aps, None);
    let got = step(&mut oracle, 1, &hdr(&sensor, |x, _| [if x == 0 { 1.0 } else { 0.0 }; 3]), &still);
    // The first pixel stays at 1. The second falls from 1 to 0, on average 0.5. Gain over white level is 2 / 4.
    assert_eq!(got.aps, Some(vec![2048, 1024]));
}

#[test]
fn adaptive_substeps_stay_near_fixed_ones() {
    let run = |substep_policy| {
        let base = sensor(64, 24);
        let sensor = SensorModel { substep_policy, substeps: 32, intensity: Intensity::Gray, ..base };
        let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
        let moving = motion(&sensor, [-2.3, 0.0]);
        let mut events = Vec::new();
        for k in 0..4 {
            let got = step(&mut oracle, k, &hdr(&sensor, texture(2.3 * k as f32)), &moving);
            assert!(got.substeps_per_block.iter().all(|n| (1..=32).contains(n)));
            events.extend(got.packet.iter());
        }
        events
    };
    let (fixed, adaptive) = (run(SubstepPolicy::Fixed), run(SubstepPolicy::Adaptive));
    let got = esaac_oracle::metrics::compare((64, 24), fixed, adaptive);
    assert!(got.f1 > 0.9 && got.exact_channels > 0.9, "{got:?}");
}

#[test]
fn bad_frames_leave_the_camera_as_it_was() {
    let sensor = sensor(8, 8);
    let mut oracle = Oracle::new(sensor.clone(), 5).unwrap();
    let (colour, still) = (hdr(&sensor, texture(0.0)), motion(&sensor, [0.0; 2]));
    step(&mut oracle, 0, &colour, &still);
    let frame = |t_ns| Frame {
        t_ns,
        hdr: (HdrFormat::F32x4, &colour),
        motion: Some((MotionFormat::F32x2, &still)),
        depth: None,
        ids: None,
    };
    assert!(matches!(oracle.step(&frame(0)), Err(FrameError::Time { camera: 5, .. })));
    assert!(matches!(oracle.step(&frame(2_000_000_000)), Err(FrameError::Gap { .. })));
    let short = Frame { hdr: (HdrFormat::F16x4, &colour), ..frame(1000) };
    assert!(matches!(oracle.step(&short), Err(FrameError::Size { expected: 512, actual: 1024, .. })));
    let missing = Frame { motion: None, ..frame(1000) };
    assert!(matches!(oracle.step(&missing), Err(FrameError::MissingMotion { synthesis: "motion", .. })));
    let next = oracle.step(&frame(1000)).unwrap().packet;
    assert_eq!((next.sequence, next.base_ns, next.watermark_ns), (1, 0, 1000));
}

#[test]
fn parameters_may_change_between_frames() {
    let sensor = SensorModel { substeps: 4, ..sensor(16, 8) };
    let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
    let moving = motion(&sensor, [-1.0, 0.0]);
    let mut k = 0;
    for intensity in INTENSITIES {
        for synthesis in SYNTHESES {
            let log_offset = 0.01 * f64::from(k as i32 + 1);
            let changed = SensorModel { intensity, synthesis, log_offset, ..sensor.clone() };
            oracle.set_sensor(changed.clone()).unwrap();
            // A new log offset makes the next frame the first, as for a new camera.
            let mut fresh = Oracle::new(changed, 0).unwrap();
            for first in [true, false] {
                let image = hdr(&sensor, texture(k as f32));
                let packet = step(&mut oracle, k, &image, &moving).packet;
                assert_eq!(packet.sequence, k as u64, "packets keep counting");
                assert!(packet.iter().eq(step(&mut fresh, k, &image, &moving).packet.iter()));
                assert!(packet.is_sorted() && packet.is_empty() == first);
                k += 1;
            }
        }
    }
    assert!(oracle.set_sensor(SensorModel { contrast_on: 0.0, ..sensor }).is_err());
}
