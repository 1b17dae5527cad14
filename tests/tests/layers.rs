//! Synthesis `motion` where motions meet: the engine against the oracle and against exact events.

use esaac_engine::{KernelPolicy, RigOptions};
use esaac_model::packet::Event;
use esaac_model::{
    HdrFormat, Intensity, MotionFormat, Pixel, SensorModel, SubstepPolicy, Synthesis, Taps, q24_to_log,
};
use esaac_oracle::metrics::{Comparison, compare as against_truth};
use esaac_scene::{SceneKind, exact_events};
use esaac_tests::agreement::{LEVEL_TOLERANCE_LOG, compare};
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{Sequence, scene, times};
use esaac_tests::run::{Step, engine_with as engine, oracle};

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
        assert!(one.len() > 1000 && one == run(3), "{kind:?}");
    }
    let sequence = frames(SceneKind::Poles);
    let run = |layers| packets(&engine(&sensor(layers), &sequence, RigOptions::default()));
    assert!(run(1) != run(3), "where they do, it does");
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
