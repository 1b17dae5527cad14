//! The kernels of GPUs, forced on any device (in CI, the software driver) by [`RigOptions::policy`]. Compares them with
//! the oracle and with the device's own kernels.

use esaac_engine::{KernelPolicy, LevelsFirst, Rig, RigOptions};
use esaac_layout::{CROWDED_QUEUE_PER_PX, CrossConstants, IngestConstants, QUEUE_PER_PX};
use esaac_model::{HdrFormat, Intensity, MotionFormat, SensorModel, SubstepPolicy, Synthesis, Taps};
use esaac_scene::SceneKind;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{Sequence, gray, intensity_of, scene, times};
use esaac_tests::run::{Step, camera, engine_of_many, engine_with, ran_again, rig, steps};
use esaac_tests::{agreement, corpus};

/// An odd size: the image cuts blocks and sub-tiles off at the right and at the bottom.
const SIZE: (u32, u32) = (45, 21);

const POLICY: KernelPolicy = KernelPolicy { levels_first: LevelsFirst::Never, ..KernelPolicy::gpu() };

/// With the kernels for many events.
const DENSE: KernelPolicy = KernelPolicy { levels_first: LevelsFirst::Always, ..POLICY };

fn forced(policy: KernelPolicy) -> RigOptions {
    RigOptions { policy: Some(policy), ..RigOptions::default() }
}

fn sensor() -> SensorModel {
    SensorModel { width: SIZE.0, height: SIZE.1, substeps: 8, transfers: 1, ..SensorModel::default() }
}

fn noisy() -> SensorModel {
    SensorModel {
        contrast_mismatch: 0.03,
        refractory_ns: 1_000_000,
        leak_rate_hz: 5.0,
        shot_noise_rate_hz: 40.0,
        latency_ns: 200_000,
        latency_jitter_ns: 50_000,
        aps_exposure_ns: 10_000_000,
        ..sensor()
    }
}

fn moving() -> Sequence {
    scene(SceneKind::ALL[0], SIZE, &times(1_000, 4), HdrFormat::F32x4, MotionFormat::F32x2)
}

/// Specialisation constants of the compiled permutations of a kernel.
fn compiled(rig: &Rig, kernel: &str) -> Vec<Vec<u32>> {
    rig.permutations_compiled()
        .into_iter()
        .filter(|(name, _)| *name == kernel)
        .map(|(_, words)| words)
        .collect()
}

/// Place of a constant of `cross` among the words of a permutation.
fn word(field: &str) -> usize {
    CrossConstants::LIST.constants.iter().position(|c| c.field == field).expect("a constant of `cross`")
}

/// The compiled permutations of the kernels for few events and for many: whether they walk again, the sub-tiles in the list,
/// with a queue of which length.
fn kernels_of_cross(rig: &Rig) -> [Vec<[u32; 3]>; 2] {
    ["cross_gpu", "cross_dense_gpu"].map(|name| {
        let constants = ["walks_again", "second_run", "queue_per_px"];
        let mut found: Vec<_> =
            compiled(rig, name).iter().map(|words| constants.map(|field| words[word(field)])).collect();
        found.sort_unstable();
        found
    })
}

/// Steps a rig under the GPU policy and asserts that it ran the GPU kernels.
fn gpu_steps(sensor: &SensorModel, sequence: &Sequence, policy: KernelPolicy) -> Vec<Step> {
    let mut rig = rig(sensor, sequence, forced(policy));
    let got = steps(&mut rig, sequence, 0..sequence.frames.len());
    let cross = if policy.levels_first == LevelsFirst::Always { "cross_dense_gpu" } else { "cross_gpu" };
    for (kernel, constants) in [("ingest_gpu", IngestConstants::LIST), (cross, CrossConstants::LIST)] {
        let own = compiled(&rig, kernel);
        assert!(
            !own.is_empty() && own.iter().all(|words| words.len() == constants.constants.len()),
            "{kernel}: {own:?}"
        );
    }
    for stage in ["ingest", "cross"] {
        assert!(compiled(&rig, &format!("{stage}_cpu")).is_empty(), "{stage}: the software driver's ran");
    }
    // Constants: bins of a group, threads, native division.
    assert_eq!(compiled(&rig, "sort"), [vec![policy.group_bins, 256, 1, 0, 0, 0]]);
    drop(rig);
    assert_silent();
    got
}

/// The steps of a rig with time stamps between stages, and after which of them something ran again.
fn steps_and_retries(rig: &mut Rig, sequence: &Sequence) -> (Vec<Step>, Vec<bool>) {
    let step = |frame| {
        let step = steps(rig, sequence, frame..frame + 1).remove(0);
        (step, ran_again(rig))
    };
    (0..sequence.frames.len()).map(step).unzip()
}

#[track_caller]
fn check_against_oracle(sensor: &SensorModel, sequence: &Sequence, steps: &[Step]) {
    let found = agreement::compare(sensor, 0, sequence, steps);
    assert!(found.unexplained.is_empty() && found.late.is_empty(), "{sensor:?}: {found:?}");
    assert!(found.events > 300, "{sensor:?}: {} events", found.events);
}

#[test]
fn the_gpus_kernels_agree_with_the_oracle() {
    let sequence = moving();
    let bayer = Intensity::BayerRggb;
    for sensor in [
        sensor(),
        noisy(),
        SensorModel { intensity: bayer, transfers: 2, ..noisy() },
        SensorModel { intensity: bayer, taps: Taps::Bilinear, ..sensor() },
        SensorModel { synthesis: Synthesis::Linear, ..noisy() },
    ] {
        check_against_oracle(&sensor, &sequence, &gpu_steps(&sensor, &sequence, POLICY));
    }
    for sensor in [
        noisy(),
        SensorModel { intensity: bayer, ..sensor() },
        SensorModel { synthesis: Synthesis::Linear, flicker_depth: 0.5, ..sensor() },
    ] {
        check_against_oracle(&sensor, &sequence, &gpu_steps(&sensor, &sequence, DENSE));
    }
}

/// Among the cases are pixels that start late and pixels without any valid light.
#[test]
fn the_gpus_kernels_hold_every_case_of_the_corpus() {
    let cases = corpus::cases();
    for policy in [POLICY, DENSE] {
        let outcomes = corpus::by_engine(&DEVICE, &cases, forced(policy));
        for (case, outcome) in cases.iter().zip(&outcomes) {
            assert_eq!(case.judge(outcome), Ok(()), "{}", case.name);
        }
        assert_silent();
    }
}

/// With many events in some of the frames, in an image that is large enough.
#[test]
fn a_rig_takes_the_kernels_for_many_events_while_it_has_many() {
    let sensor = SensorModel {
        width: 640,
        height: 320,
        substeps: 2,
        substep_policy: SubstepPolicy::Fixed,
        synthesis: Synthesis::Linear,
        ..sensor()
    };
    let sequence = gray(&sensor, &times(0, 8), |frame, _| {
        intensity_of(&sensor, if [1, 3, 5].contains(&frame) { -0.13 } else { -1.0 })
    });
    let own = engine_with(&sensor, &sequence, RigOptions::default());
    let policy = KernelPolicy { levels_first: LevelsFirst::WherePaid, ..POLICY };
    let mut rig = rig(&sensor, &sequence, forced(policy));
    let mut taken = Vec::new();
    for (frame, own) in own.iter().enumerate() {
        let got = steps(&mut rig, &sequence, frame..frame + 1).remove(0);
        // What runs again has a longer queue.
        let dense = compiled(&rig, "cross_dense_gpu");
        taken.push(dense.iter().any(|words| words[word("queue_per_px")] == QUEUE_PER_PX));
        assert!(got.packet == own.packet && got.diagnostics == own.diagnostics, "frame {frame}");
    }
    // Two intervals are dense.
    assert_eq!(taken, [false, false, false, true, true, true, true, true]);
    assert!(own[1].packet.len() >= 3 * sensor.pixels() && own[7].packet.is_empty());
    drop(rig);
    assert_silent();
}

#[test]
fn the_gpus_kernels_and_the_devices_own_send_the_same_events() {
    let sequence = moving();
    for sensor in [sensor(), SensorModel { intensity: Intensity::BayerRggb, transfers: 2, ..noisy() }] {
        let own = engine_with(&sensor, &sequence, RigOptions::default());
        for (step, own) in gpu_steps(&sensor, &sequence, POLICY).iter().zip(&own) {
            assert!(step.packet == own.packet && step.aps == own.aps, "{sensor:?}");
            assert_eq!(step.diagnostics, own.diagnostics);
        }
    }
}

#[test]
fn larger_groups_of_bins_sort_the_same_packets_on_a_gpu() {
    let (sensor, sequence) = (noisy(), moving());
    let small = gpu_steps(&sensor, &sequence, POLICY);
    let large = gpu_steps(&sensor, &sequence, KernelPolicy { group_bins: 16, ..POLICY });
    for (small, large) in small.iter().zip(&large) {
        assert!(small.packet == large.packet);
    }
    // A rig with many bins chooses the larger groups by itself.
    let many = KernelPolicy { many_bins: 1, group_bins_of_small: 16, ..POLICY };
    let rig = Rig::with_options(
        &DEVICE,
        &[camera(&sensor, 0, &sequence)],
        RigOptions { policy: Some(many), ..RigOptions::default() },
    )
    .expect("a rig");
    assert_eq!(compiled(&rig, "sort"), [vec![16, 256, 1, 0, 0, 0]]);
}

/// Sub-tiles with more events than the queue holds run again, and no others; then the queue grows, if it may, or else ticks
/// have a second run, after which nothing is left. The kernel for many events walks them again at once. Buffers grow
/// meanwhile.
#[test]
fn a_queue_that_overflows_loses_nothing_on_a_gpu() {
    const STEPS: u32 = 6;
    let calm = SensorModel {
        synthesis: Synthesis::Linear,
        substeps: STEPS,
        substep_policy: SubstepPolicy::Fixed,
        contrast_on: 0.1,
        contrast_off: 0.1,
        ..sensor()
    };
    let noisy = SensorModel { shot_noise_rate_hz: 40.0, latency_jitter_ns: 50_000, ..calm.clone() };
    // From the second tile on, every fifth row swings by eighty thresholds. The other pixels swing by none to three.
    let swing = |pixel: usize| match (pixel % SIZE.0 as usize, pixel / SIZE.0 as usize) {
        (32.., row) if row % 5 == 2 => 8.04,
        (column, row) => 0.11 * ((row + column / 9) % 4) as f64,
    };
    for sensor in [calm, noisy] {
        let sequence = gray(&sensor, &times(0, 6), |frame, pixel| {
            // Levels stay away from whole numbers of thresholds, where f32 and f64 could differ.
            let log = -1.0 - 0.013 * frame as f64 + if frame % 2 == 1 { swing(pixel) } else { 0.0 };
            intensity_of(&sensor, log)
        });
        let short = KernelPolicy { most_queue_per_px: QUEUE_PER_PX, ..POLICY };
        let dense = KernelPolicy { most_queue_per_px: QUEUE_PER_PX, ..DENSE };
        let [many, few] = [1 << 20, 64];
        for (initial_events, policy) in
            [(many, POLICY), (many, short), (few, short), (many, dense), (few, dense)]
        {
            let options = RigOptions { initial_events, stage_times: true, ..forced(policy) };
            let mut rig = rig(&sensor, &sequence, options);
            let (got, retried) = steps_and_retries(&mut rig, &sequence);
            let [first, second] = match policy == dense {
                // Without room for its events.
                true => [initial_events == few, false],
                // Two ticks are busy.
                false => [true; 2],
            };
            assert_eq!(retried, [false, first, second, false, false, false], "{sensor:?} {initial_events}");
            let (length, crowded) = (QUEUE_PER_PX, CROWDED_QUEUE_PER_PX);
            let expected = match (policy == dense, policy == short) {
                (true, _) => [vec![], vec![[1, 0, crowded]]],
                (_, true) => [vec![[0, 0, length]], vec![[1, 0, crowded], [1, 1, crowded]]],
                (_, false) => [vec![[0, 0, length], [0, 0, 2 * length]], vec![[1, 0, crowded]]],
            };
            assert_eq!(kernels_of_cross(&rig), expected);
            drop(rig);
            assert_silent();
            check_against_oracle(&sensor, &sequence, &got);
            for step in &got[1..] {
                assert_eq!(step.diagnostics.substeps, u64::from(STEPS) * 6 * 3, "{sensor:?}");
            }
        }
    }
}

/// With bins for more than one chunk.
#[test]
fn bins_that_are_summed_in_chunks_sort_the_same_packets() {
    let sensor = SensorModel {
        width: 480,
        height: 320,
        synthesis: Synthesis::Linear,
        latency_ns: 3_000_000,
        contrast_on: 0.05,
        contrast_off: 0.05,
        ..SensorModel::default()
    };
    let swing = |pixel: usize| 0.3 * (pixel % 7) as f64 - 0.9;
    let sequence = gray(&sensor, &times(0, 3), |frame, pixel| {
        intensity_of(&sensor, -2.0 + if frame % 2 == 1 { swing(pixel) } else { 0.0 })
    });
    let packets = |summed_reads| {
        let policy = KernelPolicy { summed_reads, ..POLICY };
        let cameras = [(sensor.clone(), sequence.clone()), (self::sensor(), moving())];
        let rig =
            Rig::with_options(&DEVICE, &[camera(&sensor, 0, &sequence)], forced(policy)).expect("a rig");
        assert_eq!(compiled(&rig, "sort")[0][5], u32::from(summed_reads == 0));
        engine_of_many(&cameras, forced(policy))
    };
    let (summed, own) = (packets(0), packets(u64::MAX));
    assert!(own[0][1].packet.len() > 100_000 && own[0][1].diagnostics.deferred_events > 1000);
    for (summed, own) in summed.iter().flatten().zip(own.iter().flatten()) {
        assert!(summed.packet == own.packet && summed.diagnostics == own.diagnostics);
    }
}

#[test]
fn cameras_of_different_kernels_step_together_on_a_gpu() {
    let sequence = moving();
    let cameras = [(sensor(), sequence.clone()), (noisy(), sequence.clone()), (sensor(), sequence.clone())];
    let together = engine_of_many(&cameras, forced(POLICY));
    let own = engine_of_many(&cameras, RigOptions::default());
    for (gpu, own) in together.iter().flatten().zip(own.iter().flatten()) {
        assert!(gpu.packet == own.packet);
        assert_eq!(gpu.diagnostics, own.diagnostics);
    }
}

/// A tag has bits for 256 events of a pixel. A pixel with more events overflows the queue, even if the queue has room. Where
/// it is walked again, tags are long, if delays need the numbers.
#[test]
fn an_event_number_that_a_tag_has_no_bits_for_overflows_the_queue() {
    let calm =
        SensorModel { synthesis: Synthesis::Linear, contrast_on: 0.02, contrast_off: 0.02, ..sensor() };
    let late = SensorModel { latency_ns: 200_000, latency_jitter_ns: 50_000, ..calm.clone() };
    let sequence = gray(&calm, &times(0, 6), |frame, pixel| {
        intensity_of(&calm, if frame % 2 == 1 && pixel == 100 { 3.01 } else { -3.0 })
    });
    let (length, crowded) = (QUEUE_PER_PX, CROWDED_QUEUE_PER_PX);
    let few = [vec![[0, 0, length]], vec![[1, 0, crowded], [1, 1, crowded]]];
    let many = [vec![], vec![[1, 0, crowded]]];
    let runs = [(POLICY, [false, true, true, false, false, false], &few), (DENSE, [false; 6], &many)];
    for (sensor, (policy, retried, kernels)) in
        [&calm, &late].into_iter().flat_map(|s| runs.map(|run| (s, run)))
    {
        let policy = KernelPolicy { most_queue_per_px: QUEUE_PER_PX, ..policy };
        let mut rig = rig(sensor, &sequence, RigOptions { stage_times: true, ..forced(policy) });
        let (got, again) = steps_and_retries(&mut rig, &sequence);
        assert_eq!((again.as_slice(), &kernels_of_cross(&rig)), (&retried[..], kernels));
        drop(rig);
        assert_silent();
        assert!(got[1].packet.len() > 256 && got[1].packet.len() < 1024, "{} events", got[1].packet.len());
        check_against_oracle(sensor, &sequence, &got);
    }
}
