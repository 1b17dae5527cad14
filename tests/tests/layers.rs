//! Synthesis `motion` where motions meet: the engine against the oracle and against exact events.

use esaac_engine::{KernelPolicy, RigOptions};
use esaac_model::packet::Event;
use esaac_model::synthesis::layers::pairs::Pairs;
use esaac_model::{
    HdrFormat, Intensity, MotionFormat, Pixel, SensorModel, SubstepPolicy, Synthesis, Taps, q24_to_log,
};
use esaac_oracle::metrics::{Comparison, compare as against_truth};
use esaac_scene::{SceneKind, exact_events};
use esaac_tests::agreement::{LEVEL_TOLERANCE_LOG, compare};
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{FRAME_NS, Frame, Sequence, scene, times};
use esaac_tests::run::{Step, engine_with as engine, oracle, rig, step, steps};
use glam::DVec2;

/// Neither side is a multiple of a block.
const SIZE: (u32, u32) = (75, 53);

const SCENES: [SceneKind; 4] =
    [SceneKind::Poles, SceneKind::Foliage, SceneKind::Propeller, SceneKind::Bounce];

/// Share of levels and of pixels that may differ: a test that falls the other way by rounding.
const DIFFERING_SHARE: f64 = 1e-4;

fn sensor(layers: u32) -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis: Synthesis::Motion,
        log_offset: 0.01,
        substeps: 16,
        layers,
        ..SensorModel::default()
    }
}

fn frames(kind: SceneKind) -> Sequence {
    scene(kind, SIZE, &times(0, 4), HdrFormat::F32x4, MotionFormat::F32x2)
}

fn packets(steps: &[Step]) -> Vec<Event> {
    steps.iter().flat_map(|step| step.packet.iter()).collect()
}

/// Levels in all, and those that are not the oracle's.
fn levels(sensor: &SensorModel, sequence: &Sequence, steps: &[Step]) -> (usize, usize) {
    let (mut all, mut differing) = (0, 0);
    for (interval, step) in oracle(sensor, 0, sequence).iter().zip(steps).skip(1) {
        let expected: u64 = interval.substeps_per_block.iter().map(|&n| u64::from(n)).sum();
        assert_eq!(step.diagnostics.substeps, expected, "sub-steps of all blocks");
        let samples = interval.samples.as_ref().expect("runs keep samples");
        let substeps_q24 = step.substeps_q24.as_ref().expect("the rig keeps them");
        for pixel in 0..sensor.pixels() {
            for (sample, levels) in samples.at(pixel).iter().zip(&substeps_q24[1..]) {
                let apart = (q24_to_log(levels[pixel]) - (sample + sensor.log_offset).ln()).abs();
                all += 1;
                differing += usize::from(apart > LEVEL_TOLERANCE_LOG);
            }
        }
    }
    (all, differing)
}

#[test]
fn levels_and_events_are_those_of_the_oracle() {
    let modes = [
        (Taps::Cubic, Intensity::Luminance, 3, SubstepPolicy::Adaptive),
        (Taps::Bilinear, Intensity::Gray, 3, SubstepPolicy::Fixed),
        (Taps::Cubic, Intensity::BayerRggb, 2, SubstepPolicy::Adaptive),
        (Taps::Cubic, Intensity::Gray, 0, SubstepPolicy::Adaptive),
    ];
    let (mut all, mut differing, mut pixels, mut unexplained) = (0, 0, 0, 0);
    for (taps, intensity, layers, substep_policy) in modes {
        for kind in SCENES {
            let sequence = frames(kind);
            let sensor = SensorModel { taps, intensity, substep_policy, ..sensor(layers) };
            let keep = RigOptions { keep_substeps: true, ..RigOptions::default() };
            let steps = engine(&sensor, &sequence, keep);
            let (of_scene, off) = levels(&sensor, &sequence, &steps);
            let agreement = compare(&sensor, 0, &sequence, &steps);
            println!(
                "{kind:?} {taps:?} {intensity:?}: {off} of {of_scene} levels, {} pixels",
                agreement.differing
            );
            all += of_scene;
            differing += off;
            pixels += agreement.pixels;
            unexplained += agreement.unexplained.len();
        }
    }
    assert!(differing as f64 <= DIFFERING_SHARE * all as f64, "{differing} of {all} levels differ");
    let most = DIFFERING_SHARE * pixels as f64;
    assert!(unexplained as f64 <= most, "{unexplained} of {pixels} pixels differ without a tie");
    assert_silent();
}

#[test]
fn packets_are_the_same_bits_from_run_to_run_and_by_every_kernel() {
    let sequence = frames(SceneKind::Poles);
    for pixel in [Pixel::Log, Pixel::Physical] {
        let sensor = SensorModel { pixel, noise_gain: 0.0, ..sensor(3) };
        let run =
            |policy| packets(&engine(&sensor, &sequence, RigOptions { policy, ..RigOptions::default() }));
        let first = run(None);
        assert!(first.len() > 1000, "{} events", first.len());
        assert!(first == run(None), "{pixel:?}: another run");
        assert!(first == run(Some(KernelPolicy::gpu())), "{pixel:?}: the kernels for GPUs");
    }
    assert_silent();
}

#[test]
fn where_motions_do_not_meet_nothing_changes() {
    let times_ns = times(0, 4);
    for kind in [SceneKind::Sinusoid, SceneKind::Hdr] {
        let sequence = scene(kind, SIZE, &times_ns, HdrFormat::F16x4, MotionFormat::F16x2);
        let run = |layers| packets(&engine(&sensor(layers), &sequence, RigOptions::default()));
        let one = run(1);
        assert!(one.len() > 1000 && one == run(3) && one == run(0), "{kind:?}");
    }
    let sequence = frames(SceneKind::Poles);
    let run = |layers| packets(&engine(&sensor(layers), &sequence, RigOptions::default()));
    assert!(run(1) != run(3), "where they do, it does");
    assert_silent();
}

/// Frames of a bar of 16 columns that moves by so many pixels in each interval, before a wall that stands still.
fn bar(steps_px: &[i32]) -> Sequence {
    let hdr = HdrFormat::F32x4;
    let motion = MotionFormat::F32x2;
    let mut left = 24;
    let frames = (0..).zip([0].iter().chain(steps_px)).map(|(index, &step_px)| {
        left += step_px;
        let columns = (0..SIZE.0 as i32).map(|x| (left..left + 16).contains(&x));
        let row: Vec<bool> = columns.collect();
        let pixel = |y: u32, x: usize| {
            let texture =
                if row[x] { 2.0 + (x as f32 - left as f32).sin() } else { 0.5 + 0.2 * (x as f32).cos() };
            let level = texture * (1.0 + 0.3 * (y as f32 / 3.0).sin());
            [level, level, level, 1.0]
        };
        let vector = |x: usize| if row[x] { [-step_px as f32, 0.0] } else { [0.0; 2] };
        let pixels = || (0..SIZE.1).flat_map(|y| (0..SIZE.0 as usize).map(move |x| (y, x)));
        Frame {
            t_ns: index * FRAME_NS,
            hdr: pixels().flat_map(|(y, x)| pixel(y, x)).flat_map(f32::to_le_bytes).collect(),
            motion: Some(pixels().flat_map(|(_, x)| vector(x)).flat_map(f32::to_le_bytes).collect()),
        }
    });
    Sequence { hdr, motion: Some(motion), frames: frames.collect() }
}

/// Frames of a texture. Vectors are one for all in the first, and then of two kinds, block by block: what goes apart now
/// went together before.
fn parting() -> Sequence {
    let pixels = || (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
    let frames = (0..3).map(|index| {
        let vector = |x: u32, y: u32| match (index, (x / 8 + y / 8) % 2) {
            (0 | 1, _) => [7.3_f32, -0.7],
            (_, 0) => [6.1, -1.9],
            _ => [9.7, 1.3],
        };
        let texel = |x: u32, y: u32| {
            let level = 1.0 + 0.5 * (x as f32 * 0.9).sin() * (y as f32 * 0.7 + index as f32).cos();
            [level, level, level, 1.0]
        };
        Frame {
            t_ns: index * FRAME_NS,
            hdr: pixels().flat_map(|(x, y)| texel(x, y)).flat_map(f32::to_le_bytes).collect(),
            motion: Some(pixels().flat_map(|(x, y)| vector(x, y)).flat_map(f32::to_le_bytes).collect()),
        }
    });
    Sequence { hdr: HdrFormat::F32x4, motion: Some(MotionFormat::F32x2), frames: frames.collect() }
}

/// Rounding must not say which of two layers a pixel of the earlier frame is of, where both have its vector.
#[test]
fn layers_with_one_earlier_vector_are_the_oracles() {
    let (sensor, sequence) = (sensor(3), parting());
    for policy in [None, Some(KernelPolicy::gpu())] {
        let options = RigOptions { keep_substeps: true, policy, ..RigOptions::default() };
        let (all, differing) = levels(&sensor, &sequence, &engine(&sensor, &sequence, options));
        assert!(differing as f64 <= DIFFERING_SHARE * all as f64, "{differing} of {all} levels differ");
    }
    assert_silent();
}

/// Blocks that pairs of a frame's vectors pass.
fn meeting_blocks(frame: &Frame) -> u64 {
    let (vectors, columns) = (frame.motion.as_deref().expect("frames have motion"), SIZE.0 as usize);
    let vector = |x, y| Some(DVec2::from(MotionFormat::F32x2.decode(vectors, y * columns + x)));
    Pairs::new((columns, SIZE.1 as usize), vector).meeting_blocks()
}

#[test]
fn the_scene_says_how_many_layers_there_are() {
    // Each interval, how far the bar moves and whether there are several layers: as told by the interval before, and in the
    // first by itself.
    for told in [
        [(9, true), (9, true), (0, true), (0, false), (9, false), (9, true)],
        [(0, false), (9, false), (9, true), (2, true), (2, false), (-9, false)],
    ] {
        let sequence = bar(&told.map(|(step_px, _)| step_px));
        let steps = engine(&sensor(0), &sequence, RigOptions::default());
        let layered: Vec<u64> = steps.iter().skip(1).map(|step| step.diagnostics.layered_intervals).collect();
        assert_eq!(layered, told.map(|(_, layered)| u64::from(layered)));
        for (step, frame) in steps.iter().zip(&sequence.frames).skip(1) {
            assert_eq!(step.diagnostics.meeting_blocks, meeting_blocks(frame));
        }
        let agreement = compare(&sensor(0), 0, &sequence, &steps);
        assert!(agreement.unexplained.is_empty(), "{:?}", agreement.unexplained);
        let one = engine(&sensor(1), &sequence, RigOptions::default());
        assert!(packets(&steps) != packets(&one), "layers that change nothing");
        // With so little room for levels that ticks have several passes, whether the camera has layers in them or not.
        let narrow = KernelPolicy { least_level_rows: 0, ..KernelPolicy::gpu() };
        let narrow = RigOptions { policy: Some(narrow), ..RigOptions::default() };
        assert!(packets(&steps) == packets(&engine(&sensor(0), &sequence, narrow)));
    }
    assert_silent();
}

#[test]
fn a_restored_rig_has_the_layers_of_the_one_that_was_saved() {
    let sequence = frames(SceneKind::Poles);
    let new_rig = || rig(&sensor(0), &sequence, RigOptions::default());
    let mut first = new_rig();
    steps(&mut first, &sequence, 0..3);
    let saved = first.save().unwrap();
    let whole = step(&mut first, &sequence, 3);
    let mut restored = new_rig();
    restored.restore(&saved).unwrap();
    assert_eq!(whole.diagnostics.layered_intervals, 1);
    let after = step(&mut restored, &sequence, 3);
    assert_eq!(after.diagnostics.layered_intervals, 1);
    assert!(packets(&[after]) == packets(&[whole]), "one surface, or other events");
    // After a reset the first interval tells again.
    restored.reset(0).unwrap();
    let again = steps(&mut restored, &sequence, 0..2);
    assert_eq!([0, 1].map(|index| again[index].diagnostics.layered_intervals), [0, 1]);
    assert_silent();
}

/// Events of a scene of 160x120 in three intervals against exact ones, at every seventh pixel.
fn judged(kind: SceneKind, (first_s, rate_hz): (f64, f64), synthesis: Synthesis, layers: u32) -> Comparison {
    let size = (160, 120);
    let times_ns: Vec<i64> =
        (0..4).map(|k| ((first_s + f64::from(k) / rate_hz) * 1e9).round() as i64).collect();
    let sensor = SensorModel { width: size.0, height: size.1, substeps: 32, synthesis, ..sensor(layers) };
    let sequence = scene(kind, size, &times_ns, HdrFormat::F16x4, MotionFormat::F16x2);
    let every = |x: u32, y: u32| (y * size.0 + x).is_multiple_of(7);
    let pixels: Vec<(u32, u32)> =
        (0..size.0 * size.1).map(|i| (i % size.0, i / size.0)).filter(|&(x, y)| every(x, y)).collect();
    let truth = exact_events(&kind.scene(size.0, size.1), &sensor, &pixels, times_ns[0], times_ns[3]);
    let events = packets(&engine(&sensor, &sequence, RigOptions::default()));
    let tested = events.into_iter().filter(|e| every(e.x.into(), e.y.into()));
    against_truth(size, truth.into_iter().flatten(), tested)
}

#[test]
fn what_is_thin_or_turns_does_not_fall_apart() {
    for (kind, at, f1) in [
        (SceneKind::Poles, (0.0, 30.0), 0.68),
        (SceneKind::Poles, (0.71, 24.0), 0.66),
        (SceneKind::Foliage, (0.0, 30.0), 0.63),
        (SceneKind::Propeller, (0.0, 30.0), 0.73),
    ] {
        let linear = judged(kind, at, Synthesis::Linear, 1);
        let one = judged(kind, at, Synthesis::Motion, 1);
        let layers = judged(kind, at, Synthesis::Motion, 3);
        let told = [linear, one, layers].map(|c| (c.f1, c.victor_purpura, c.count_ratio));
        println!("{kind:?} {at:?}: {told:.3?}");
        assert!(layers.f1 >= f1 && layers.f1 > one.f1, "{kind:?}");
        assert!(layers.victor_purpura < one.victor_purpura.min(linear.victor_purpura), "{kind:?}");
        assert!(layers.count_ratio <= 1.15, "{kind:?}");
    }
    assert_silent();
}
