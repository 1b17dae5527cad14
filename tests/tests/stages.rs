//! Compares each stage of the engine with the oracle's stage of the same name: ingest, plan, synthesis, APS.

use esaac_engine::{FrameBytes, KernelPolicy, Rig, RigOptions};
use esaac_model::intensity::weights;
use esaac_model::{
    HdrFormat, Intensity, MotionFormat, SensorModel, SubstepPolicy, Synthesis, Taps, q24_to_log,
};
use esaac_oracle::{Interval, Oracle, Samples};
use esaac_scene::SceneKind;
use esaac_tests::agreement::LEVEL_TOLERANCE_LOG;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{Frame, Sequence, gray, scene, times};
use esaac_tests::run::{Step, camera, engine_of_many, oracle, step};

/// An APS pixel is rounded to the nearest count. Near a half, f32 may round to the other side.
const APS_TOLERANCE_COUNTS: u16 = 1;

/// Least share of equal APS pixels. Values near a half are rare.
const APS_EQUAL_SHARE: f64 = 0.99;

fn keep() -> RigOptions {
    RigOptions { keep_substeps: true, ..RigOptions::default() }
}

fn sensor(
    (width, height): (u32, u32),
    synthesis: Synthesis,
    taps: Taps,
    intensity: Intensity,
) -> SensorModel {
    SensorModel { width, height, synthesis, taps, intensity, substeps: 16, ..SensorModel::default() }
}

/// Largest level error over all pixels and sub-steps, nepers. Engine and oracle must have equally many sub-steps.
fn worst_level(sensor: &SensorModel, intervals: &[Interval], steps: &[Step]) -> f64 {
    let of_interval = |(interval, step): (&Interval, &Step)| {
        let samples = interval.samples.as_ref().expect("runs keep samples");
        let substeps_q24 = step.substeps_q24.as_ref().expect("the rig keeps them");
        worst_level_of(sensor, samples, substeps_q24)
    };
    intervals.iter().zip(steps).skip(1).map(of_interval).fold(0.0, f64::max)
}

/// As [`worst_level`], for one interval.
fn worst_level_of(sensor: &SensorModel, samples: &Samples, substeps_q24: &[Vec<i32>]) -> f64 {
    let mut worst = 0.0_f64;
    for pixel in 0..sensor.pixels() {
        for (sample, levels) in samples.at(pixel).iter().zip(&substeps_q24[1..]) {
            let expected = (sample + sensor.log_offset).ln();
            worst = worst.max((q24_to_log(levels[pixel]) - expected).abs());
        }
    }
    worst
}

/// Lens and lamp, alone and together, of every synthesis that reads frames in its own way; both sets of kernels, both
/// formats of a frame, broken pixels.
#[test]
fn lens_and_lamp() {
    const MODES: [(Synthesis, Taps, u32, Intensity); 6] = [
        (Synthesis::Motion, Taps::Cubic, 1, Intensity::SiliconFront),
        (Synthesis::Motion, Taps::Cubic, 3, Intensity::BayerRggb),
        (Synthesis::Motion, Taps::Bilinear, 1, Intensity::SiliconBackIr),
        (Synthesis::Linear, Taps::Cubic, 1, Intensity::BayerRggb),
        (Synthesis::Paper, Taps::Cubic, 1, Intensity::SiliconFrontIr),
        (Synthesis::Linear, Taps::Cubic, 1, Intensity::SiliconBack),
    ];
    let size = (45, 37);
    let mut cameras = Vec::new();
    let frames = scene(SceneKind::Hdr, size, &times(5_000_000_003, 4), HdrFormat::F32x4, MotionFormat::F32x2);
    for (number, (synthesis, taps, transfers, intensity)) in MODES.into_iter().enumerate() {
        let base = SensorModel { transfers, substeps: 32, ..sensor(size, synthesis, taps, intensity) };
        let blur = SensorModel { psf_sigma_px: 0.7, ..base.clone() };
        let dark_corners = SensorModel { vignetting_fov_deg: 80.0, ..base.clone() };
        let lamp = SensorModel { flicker_depth: 0.6, flicker_phase_deg: 70.0, ..base };
        let all =
            SensorModel { psf_sigma_px: 1.0, vignetting_fov_deg: 50.0, flicker_hz: 55.0, ..lamp.clone() };
        let alone = [blur, dark_corners, lamp].into_iter().filter(|_| number == 0);
        cameras.extend(alone.chain([all]).map(|sensor| (sensor, frames.clone())));
    }
    let broken_sensor = SensorModel {
        psf_sigma_px: 0.6,
        flicker_depth: 1.0,
        flicker_hz: 47.0,
        ..sensor((19, 13), Synthesis::Linear, Taps::Cubic, Intensity::Gray)
    };
    cameras.push((broken_sensor.clone(), broken(&broken_sensor)));
    let own = engine_of_many(&cameras, keep());
    let gpus = engine_of_many(&cameras, RigOptions { policy: Some(KernelPolicy::gpu()), ..keep() });
    let mut worst = 0.0_f64;
    for (number, (sensor, sequence)) in cameras.iter().enumerate() {
        let what =
            format!("camera {number}: {:?} {:?} {:?}", sensor.synthesis, sensor.taps, sensor.intensity);
        let intervals = oracle(sensor, number as u32, sequence);
        for steps in [&own[number], &gpus[number]] {
            let level = if sequence.motion.is_some() {
                worst_level(sensor, &intervals, steps)
            } else {
                // Levels of pixels that never had a valid value are undefined.
                worst_armed_level(sensor, &intervals, steps)
            };
            println!("{what}: {level:.2e}");
            worst = worst.max(level);
            check_plan(&what, &intervals, steps);
            for (interval, step) in intervals.iter().zip(steps) {
                assert_eq!(step.diagnostics.invalid_pixels, interval.diagnostics.invalid_pixels, "{what}");
            }
        }
    }
    assert!(worst <= LEVEL_TOLERANCE_LOG, "levels off by up to {worst:.2e}");
    assert_silent();
}

/// As [`worst_level`], over the pixels of [`broken`] frames that have had a valid value.
fn worst_armed_level(sensor: &SensorModel, intervals: &[Interval], steps: &[Step]) -> f64 {
    let mut worst = 0.0_f64;
    for (interval, step) in intervals.iter().zip(steps).skip(1) {
        let (samples, levels) =
            (interval.samples.as_ref().expect("kept"), step.substeps_q24.as_ref().expect("kept"));
        for pixel in (0..sensor.pixels()).filter(|pixel| !matches!(pixel % 11, 3 | 7)) {
            for (sample, levels) in samples.at(pixel).iter().zip(&levels[1..]) {
                worst = worst.max((q24_to_log(levels[pixel]) - (sample + sensor.log_offset).ln()).abs());
            }
        }
    }
    worst
}

/// Tiles in the light of a lamp are never still, and have the sub-steps that its flicker needs.
#[test]
fn a_still_scene_flickers() {
    let still = sensor((40, 24), Synthesis::Linear, Taps::Cubic, Intensity::Gray);
    let lamp = SensorModel { substeps: 64, flicker_depth: 0.5, flicker_hz: 90.0, ..still.clone() };
    let frames =
        |sensor: &SensorModel| gray(sensor, &times(0, 4), |_, pixel| if pixel == 0 { 0.0 } else { 1.0 });
    let cameras = [(still.clone(), frames(&still)), (lamp.clone(), frames(&lamp))];
    let [still_steps, lamp_steps] =
        <[Vec<Step>; 2]>::try_from(engine_of_many(&cameras, RigOptions::default())).expect("two");
    assert!(
        still_steps[1..].iter().all(|step| step.diagnostics.skipped_blocks == 15 && step.packet.is_empty())
    );
    let intervals = oracle(&lamp, 1, &cameras[1].1);
    check_plan("lamp", &intervals, &lamp_steps);
    assert!(intervals[1].substeps_per_block.iter().all(|&n| n == 24), "three periods");
    for (interval, step) in intervals.iter().zip(&lamp_steps).skip(1) {
        assert_eq!(step.diagnostics.skipped_blocks, 0);
        let counts = |events: &mut dyn Iterator<Item = esaac_model::packet::Event>| {
            let mut counts = [0_u32; 2];
            events.for_each(|e| counts[e.polarity as usize] += 1);
            counts
        };
        let [off, on] = counts(&mut step.packet.iter());
        assert_eq!([off, on], counts(&mut interval.packet.iter()), "as the oracle's");
        // The dark pixel has no light that could flicker.
        assert!(step.packet.iter().all(|e| (e.x, e.y) != (0, 0)));
        assert!(on > 3 * 959 && off > 3 * 959, "{on} ON, {off} OFF: frames alone show steady light");
    }
    assert_silent();
}

fn check_plan(what: &str, intervals: &[Interval], steps: &[Step]) {
    for (index, (interval, step)) in intervals.iter().zip(steps).enumerate() {
        let expected: u64 = interval.substeps_per_block.iter().map(|&n| u64::from(n)).sum();
        assert_eq!(step.diagnostics.substeps, expected, "{what}, frame {index}: sub-steps of all blocks");
    }
}

#[test]
fn synthesis_and_plan() {
    const MODES: [(Synthesis, Taps, u32, Intensity); 8] = [
        (Synthesis::Motion, Taps::Cubic, 1, Intensity::Luminance),
        (Synthesis::Motion, Taps::Cubic, 1, Intensity::BayerRggb),
        (Synthesis::Motion, Taps::Cubic, 2, Intensity::Luminance),
        (Synthesis::Motion, Taps::Cubic, 3, Intensity::BayerRggb),
        (Synthesis::Motion, Taps::Bilinear, 2, Intensity::Gray),
        (Synthesis::Linear, Taps::Cubic, 1, Intensity::BayerRggb),
        (Synthesis::Paper, Taps::Cubic, 1, Intensity::Luminance),
        (Synthesis::None, Taps::Cubic, 1, Intensity::Luminance),
    ];
    const SCENES: [(SceneKind, (u32, u32)); 3] =
        [(SceneKind::Flight, (45, 37)), (SceneKind::Hdr, (33, 26)), (SceneKind::Lamp, (7, 31))];
    let mut cameras = Vec::new();
    for (synthesis, taps, transfers, intensity) in MODES {
        for (kind, size) in SCENES {
            let frames = scene(kind, size, &times(5_000_000_003, 4), HdrFormat::F32x4, MotionFormat::F32x2);
            for (substep_policy, substep_error_ns) in
                [(SubstepPolicy::Adaptive, 0), (SubstepPolicy::Adaptive, 150_000), (SubstepPolicy::Fixed, 0)]
            {
                let base = sensor(size, synthesis, taps, intensity);
                let sensor = SensorModel { substep_policy, substep_error_ns, transfers, ..base };
                cameras.push((sensor, frames.clone()));
            }
        }
    }
    let runs = engine_of_many(&cameras, keep());
    let mut worst = 0.0_f64;
    let mut failures = Vec::new();
    for (number, ((sensor, sequence), steps)) in cameras.iter().zip(&runs).enumerate() {
        let intervals = oracle(sensor, number as u32, sequence);
        let level = worst_level(sensor, &intervals, steps);
        let what = format!(
            "{:?} {:?} {} {:?} {:?} {} {}x{}",
            sensor.synthesis,
            sensor.taps,
            sensor.transfers,
            sensor.intensity,
            sensor.substep_policy,
            sensor.substep_error_ns,
            sensor.width,
            sensor.height
        );
        println!("{what}: {level:.2e}");
        worst = worst.max(level);
        let plan = std::panic::catch_unwind(|| check_plan(&what, &intervals, steps));
        if level > LEVEL_TOLERANCE_LOG || plan.is_err() {
            failures.push(format!("{what}: {level:.2e}"));
        }
    }
    assert!(
        failures.is_empty(),
        "levels off by up to {worst:.2e}, or plans differ:\n{}",
        failures.join("\n")
    );
    assert_silent();
}

#[test]
fn transfers_may_change_between_ticks() {
    // Transfers of the second camera. The first camera stays at one.
    const TRANSFERS: [u32; 9] = [1, 1, 2, 2, 1, 2, 3, 3, 1];
    let size = (45, 37);
    let frames =
        scene(SceneKind::Flight, size, &times(0, TRANSFERS.len()), HdrFormat::F32x4, MotionFormat::F32x2);
    let mut worst = 0.0_f64;
    for intensity in [Intensity::Luminance, Intensity::BayerRggb] {
        // The same number of sub-steps everywhere: beyond a block's last sub-step the kept values are undefined.
        let base = SensorModel {
            transfers: 1,
            substep_policy: SubstepPolicy::Fixed,
            ..sensor(size, Synthesis::Motion, Taps::Cubic, intensity)
        };
        let configs = [0, 1].map(|number| camera(&base, number, &frames));
        let mut rig = Rig::with_options(&DEVICE, &configs, keep()).expect("a rig of two cameras");
        let mut oracle = Oracle::new(base.clone(), 1).expect("a valid sensor");
        oracle.keep_samples(true);
        for (index, (&transfers, frame)) in TRANSFERS.iter().zip(&frames.frames).enumerate() {
            let sensor = SensorModel { transfers, ..base.clone() };
            rig.set_sensor(1, sensor.clone()).expect("of the same size");
            oracle.set_sensor(sensor).expect("of the same size");
            for number in 0..2 {
                let bytes =
                    FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref(), ..FrameBytes::default() };
                rig.upload(number, &bytes).expect("a frame that fits");
            }
            rig.step(&[frame.t_ns; 2]).expect("a frame in time");
            let interval = oracle.step(&frames.oracle_frame(index)).expect("a frame in time");
            let Some(samples) = interval.samples else { continue };
            let [one, changed] = [0, 1].map(|number| rig.substeps_q24(number).expect("the rig keeps them"));
            worst = worst.max(worst_level_of(&base, &samples, &changed));
            // The second transfer must have no effect beyond its own interval. The third leaves its frame better.
            let taken = ..=base.substeps as usize;
            let differs = transfers > 1 || TRANSFERS[..index].contains(&3);
            assert_eq!(one[taken] != changed[taken], differs, "{intensity:?}, frame {index}");
        }
    }
    assert!(worst <= LEVEL_TOLERANCE_LOG, "levels off by up to {worst:.2e}");
    assert_silent();
}

/// A frame keeps what its sub-steps needed by the bound at its time, also for the interval after it.
#[test]
fn the_bound_of_substeps_may_change_between_ticks() {
    const BOUNDS_NS: [u32; 8] = [0, 150_000, 150_000, 20_000, 1_000_000, 1_000_000, 0, 150_000];
    const TIMES_MS: [i64; 8] = [0, 33, 66, 110, 133, 150, 190, 223];
    let size = (45, 37);
    let times_ns = TIMES_MS.map(|ms| 1_000_000 * ms);
    let frames = scene(SceneKind::Flight, size, &times_ns, HdrFormat::F32x4, MotionFormat::F32x2);
    let base = sensor(size, Synthesis::Motion, Taps::Cubic, Intensity::Luminance);
    let of = |substep_error_ns| SensorModel { substep_error_ns, ..base.clone() };
    let mut rig = Rig::with_options(&DEVICE, &[camera(&of(0), 0, &frames)], keep()).expect("a rig");
    let mut oracle = Oracle::new(of(0), 0).expect("a valid sensor");
    let by_speed = self::oracle(&of(0), 0, &frames);
    let mut spared = Vec::new();
    for (index, &bound_ns) in BOUNDS_NS.iter().enumerate() {
        rig.set_sensor(0, of(bound_ns)).expect("of the same size");
        oracle.set_sensor(of(bound_ns)).expect("of the same size");
        let got = step(&mut rig, &frames, index);
        let interval = oracle.step(&frames.oracle_frame(index)).expect("a frame in time");
        let total = |substeps: &[u32]| substeps.iter().map(|&n| u64::from(n)).sum::<u64>();
        let expected = total(&interval.substeps_per_block);
        assert_eq!(got.diagnostics.substeps, expected, "frame {index}");
        if expected < total(&by_speed[index].substeps_per_block) {
            spared.push(index);
        }
    }
    // Those between two frames of a wide bound. A camera's first frame has no motion.
    assert_eq!(spared, [1, 2, 5], "intervals with fewer sub-steps than by speed");
    assert_silent();
}

/// Frames with NaN, infinities, negative values and pixels that never are valid.
fn broken(sensor: &SensorModel) -> Sequence {
    const BAD: [f32; 4] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.5];
    gray(sensor, &times(0, 4), |frame, pixel| match pixel % 11 {
        3 => f32::NAN,
        5 if frame > 0 && frame < 3 => BAD[pixel % 4],
        7 if frame == 0 => BAD[pixel % 4],
        _ => 0.02 * (1 + pixel + 3 * frame) as f32,
    })
}

#[test]
fn ingest_holds_and_counts_invalid_pixels() {
    let cameras: Vec<_> = [Intensity::Gray, Intensity::Luminance, Intensity::BayerRggb]
        .into_iter()
        .map(|intensity| {
            let sensor = sensor((19, 13), Synthesis::Linear, Taps::Cubic, intensity);
            let frames = broken(&sensor);
            (sensor, frames)
        })
        .collect();
    let runs = engine_of_many(&cameras, keep());
    for ((sensor, sequence), steps) in cameras.iter().zip(&runs) {
        let intervals = oracle(sensor, 0, sequence);
        for (frame, (interval, step)) in intervals.iter().zip(steps).enumerate() {
            let (expected, actual) = (interval.diagnostics, step.diagnostics);
            assert_eq!(actual.invalid_pixels, expected.invalid_pixels, "frame {frame}");
            assert_eq!(actual.unarmed_pixels, expected.unarmed_pixels, "frame {frame}");
            let silent =
                |pixel: usize| step.packet.iter().all(|e| usize::from(e.y) * 19 + usize::from(e.x) != pixel);
            assert!((0..sensor.pixels()).filter(|pixel| pixel % 11 == 3).all(silent));
            assert!(expected.invalid_pixels > 0 && expected.unarmed_pixels > 0);
        }
        // Compares levels of pixels that have had a valid value. Those of other pixels are undefined.
        for (interval, step) in intervals.iter().zip(steps).skip(1) {
            let (samples, levels) =
                (interval.samples.as_ref().expect("kept"), step.substeps_q24.as_ref().expect("kept"));
            for pixel in (0..sensor.pixels()).filter(|pixel| !matches!(pixel % 11, 3 | 7)) {
                for (sample, levels) in samples.at(pixel).iter().zip(&levels[1..]) {
                    let error = (q24_to_log(levels[pixel]) - (sample + sensor.log_offset).ln()).abs();
                    assert!(error <= LEVEL_TOLERANCE_LOG, "pixel {pixel}: {error:.2e}");
                }
            }
        }
    }
    assert_silent();
}

#[test]
fn ingest_reads_every_format() {
    let formats = [
        (HdrFormat::F16x4, MotionFormat::F16x2),
        (HdrFormat::F32x4, MotionFormat::F32x4),
        (HdrFormat::Srgb8x4, MotionFormat::F32x2),
    ];
    let size = (23, 17);
    let base = sensor(size, Synthesis::Paper, Taps::Cubic, Intensity::Luminance);
    let cameras: Vec<_> = formats
        .into_iter()
        .map(|(hdr, motion)| {
            let frames = scene(SceneKind::Edge, size, &times(0, 3), hdr, motion);
            (SensorModel { exposure_gain: 1.7, ..base.clone() }, frames)
        })
        .collect();
    let runs = engine_of_many(&cameras, keep());
    for ((sensor, sequence), steps) in cameras.iter().zip(&runs) {
        let level = worst_level(sensor, &oracle(sensor, 0, sequence), steps);
        assert!(level <= LEVEL_TOLERANCE_LOG, "{:?} {:?}: {level:.2e}", sequence.hdr, sequence.motion);
        let frame = &sequence.frames[2];
        let rgb = sequence.hdr.decode(&frame.hdr, 40);
        let sum: f64 = weights(sensor.intensity, 0, 0).iter().zip(rgb).map(|(w, c)| w * c).sum();
        assert!(sum > 0.0, "the frame shows something");
    }
    assert_silent();
}

/// sRGB is linear for the darkest codes and a power above.
#[test]
fn ingest_reads_every_code_of_srgb() {
    let sensor = sensor((16, 16), Synthesis::None, Taps::Cubic, Intensity::Gray);
    let frames = (0..3)
        .map(|frame| {
            let code = |pixel: usize| ((pixel + 85 * frame) % 256) as u8;
            let hdr = (0..sensor.pixels()).flat_map(|pixel| [code(pixel), code(pixel), code(pixel), 255]);
            Frame { t_ns: 1_000_000 * frame as i64, hdr: hdr.collect(), motion: None }
        })
        .collect();
    let sequence = Sequence { hdr: HdrFormat::Srgb8x4, motion: None, frames };
    let runs = engine_of_many(&[(sensor.clone(), sequence.clone())], keep());
    let level = worst_level(&sensor, &oracle(&sensor, 0, &sequence), &runs[0]);
    assert!(level <= LEVEL_TOLERANCE_LOG, "{level:.2e}");
    assert_silent();
}

#[test]
fn invalid_vectors_are_counted_and_blended() {
    let size = (29, 21);
    let mut frames = scene(SceneKind::Edge, size, &times(0, 4), HdrFormat::F32x4, MotionFormat::F32x2);
    for frame in &mut frames.frames {
        let motion = frame.motion.as_mut().expect("the scene has motion");
        for pixel in (0..29 * 21).filter(|pixel| pixel % 37 == 5) {
            let bad = [f32::NAN, f32::INFINITY][pixel % 2];
            motion[8 * pixel..8 * pixel + 4].copy_from_slice(&bad.to_le_bytes());
        }
    }
    let cameras: Vec<_> = [(Synthesis::Motion, Taps::Bilinear), (Synthesis::Paper, Taps::Cubic)]
        .into_iter()
        .map(|(synthesis, taps)| (sensor(size, synthesis, taps, Intensity::Luminance), frames.clone()))
        .collect();
    let runs = engine_of_many(&cameras, keep());
    for ((sensor, sequence), steps) in cameras.iter().zip(&runs) {
        let intervals = oracle(sensor, 0, sequence);
        for (interval, step) in intervals.iter().zip(steps) {
            assert_eq!(step.diagnostics.invalid_motion, interval.diagnostics.invalid_motion);
            assert_eq!(interval.diagnostics.invalid_motion, 17);
        }
        let level = worst_level(sensor, &intervals, steps);
        assert!(level <= LEVEL_TOLERANCE_LOG, "{:?}: {level:.2e}", sensor.synthesis);
    }
    assert_silent();
}

/// What follows a vector is blended in the log, where a change does not bend. What has none is blended in linear light.
#[test]
fn a_change_needs_substeps_where_a_vector_is_invalid() {
    let size = (45, 37);
    let mut frames = scene(SceneKind::Lamp, size, &times(0, 8), HdrFormat::F32x4, MotionFormat::F32x2);
    for frame in &mut frames.frames {
        let motion = frame.motion.as_mut().expect("the scene has motion");
        let pixel = 20 * 45 + 30;
        motion[8 * pixel..8 * pixel + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    }
    let sensor = sensor(size, Synthesis::Motion, Taps::Cubic, Intensity::Luminance);
    let cameras = [(sensor, frames)];
    let steps = &engine_of_many(&cameras, keep())[0];
    let mut with_change = 0;
    for (interval, step) in oracle(&cameras[0].0, 0, &cameras[0].1).iter().zip(steps) {
        let cut: Vec<u32> = interval.substeps_per_block.iter().copied().filter(|&n| n > 1).collect();
        assert!(cut.len() <= 1, "{cut:?} sub-steps in blocks, expected one block with more than one");
        with_change += cut.len();
        let expected: u64 = interval.substeps_per_block.iter().map(|&n| u64::from(n)).sum();
        assert_eq!(step.diagnostics.substeps, expected);
    }
    assert!(with_change > 0, "the lamp changes");
    assert_silent();
}

#[test]
fn aps() {
    let size = (31, 22);
    let base = SensorModel {
        aps_start_ns: 7_000_000,
        aps_exposure_ns: 20_000_000,
        aps_bits: 12,
        aps_gain: 0.8,
        white_level: 2.0,
        ..sensor(size, Synthesis::Linear, Taps::Cubic, Intensity::Gray)
    };
    let variants = [
        base.clone(),
        SensorModel { intensity: Intensity::BayerRggb, aps_bits: 16, ..base.clone() },
        // The exposure exceeds the interval and ends with it.
        SensorModel { aps_exposure_ns: 500_000_000, aps_bits: 8, ..base.clone() },
        // The exposure starts after the interval: no frame.
        SensorModel { aps_start_ns: 40_000_000, ..base },
    ];
    let frames = scene(SceneKind::Lamp, size, &times(0, 4), HdrFormat::F32x4, MotionFormat::F32x2);
    let cameras: Vec<_> = variants.into_iter().map(|sensor| (sensor, frames.clone())).collect();
    let runs = engine_of_many(&cameras, RigOptions::default());
    for ((sensor, sequence), steps) in cameras.iter().zip(&runs) {
        for (frame, (interval, step)) in oracle(sensor, 0, sequence).iter().zip(steps).enumerate() {
            let (expected, actual) = (&interval.aps, step.aps.as_ref().map(|aps| &aps.pixels));
            assert_eq!(expected.is_some(), actual.is_some(), "frame {frame} of {sensor:?}");
            let (Some(expected), Some(actual)) = (expected, actual) else { continue };
            let off: Vec<u16> = expected.iter().zip(actual).map(|(a, b)| a.abs_diff(*b)).collect();
            // One count of sixteen bits is near the precision of an intensity in f32.
            let tolerance = APS_TOLERANCE_COUNTS << sensor.aps_bits.saturating_sub(14);
            assert!(off.iter().all(|&d| d <= tolerance), "frame {frame}: {:?}", off.iter().max());
            let equal = off.iter().filter(|&&d| d == 0).count() as f64 / off.len() as f64;
            assert!(sensor.aps_bits > 14 || equal >= APS_EQUAL_SHARE, "frame {frame}: {equal}");
        }
    }
    assert_silent();
}
