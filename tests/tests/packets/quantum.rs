//! Time stamps of a camera whose quantum changes while it runs: none lies at or before what an earlier packet was said to be
//! complete up to.

use esaac_engine::{KernelPolicy, Rig, RigOptions};
use esaac_model::packet::Event;
use esaac_model::random::philox4x32_10;
use esaac_model::{ReadoutKind, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use esaac_oracle::Oracle;
use esaac_tests::device::{assert_silent, policy};
use esaac_tests::frames::{Sequence, gray, intensity_of};
use esaac_tests::run::{Step, rig, step};

const COARSE_NS: i64 = 7_777_777;

/// Two intervals of a thirtieth of a second, then some within one coarse quantum, and later ones before that.
const TIMES_NS: [i64; 11] = [
    0,
    33_333_333,
    66_666_666,
    67_666_666,
    68_666_666,
    69_000_000,
    69_500_000,
    100_000_000,
    10_000_000,
    40_000_000,
    60_000_000,
];

/// Frames before which the quantum becomes coarse and fine again.
const COARSE: std::ops::Range<usize> = 3..10;

/// Frames before which the camera is reset: one within the coarse quantum of the packet before, one of an earlier time.
const RESETS: [usize; 2] = [5, 8];

/// Frames before which the state is saved: before anything is floored, and when it has been.
const SAVED: [usize; 3] = [3, 4, 6];

fn sensors() -> Vec<SensorModel> {
    let plain = SensorModel {
        width: 31,
        height: 23,
        synthesis: Synthesis::Linear,
        substeps: 4,
        substep_policy: SubstepPolicy::Fixed,
        ..SensorModel::default()
    };
    let late = SensorModel { latency_ns: 17_500_000, latency_jitter_ns: 300_000, ..plain.clone() };
    let bus = |readout, readout_event_ns| SensorModel { readout, readout_event_ns, ..plain.clone() };
    let buses = [
        bus(ReadoutKind::Fifo, 50.0),
        bus(ReadoutKind::Fifo, 20_000.0),
        SensorModel { readout_row_ns: 200.0, ..bus(ReadoutKind::Rows, 50.0) },
    ];
    let at_sample = |sensor: &SensorModel| SensorModel { timestamps: Timestamps::AtSample, ..sensor.clone() };
    let at_samples = [at_sample(&plain), at_sample(&late), at_sample(&buses[0])];
    [plain, late].into_iter().chain(buses).chain(at_samples).collect()
}

/// Pixels that go to a new random level with each frame.
fn frames(sensor: &SensorModel) -> Sequence {
    gray(sensor, &TIMES_NS, |frame, pixel| {
        let [word, ..] = philox4x32_10([pixel as u32, frame as u32, 0, 0], [11, 0]);
        intensity_of(sensor, f64::from(word) / f64::from(u32::MAX) * 5.0 * sensor.contrast_on - 1.0)
    })
}

/// The sensor that takes a frame.
fn at_frame(sensor: &SensorModel, frame: usize, changes: bool) -> SensorModel {
    let is_coarse = changes && COARSE.contains(&frame);
    SensorModel { timestamp_quantum_ns: if is_coarse { COARSE_NS as u32 } else { 1 }, ..sensor.clone() }
}

fn change(rig: &mut Rig, sensor: &SensorModel, frame: usize) {
    if [COARSE.start, COARSE.end].contains(&frame) {
        rig.set_sensor(0, at_frame(sensor, frame, true)).expect("of the same size");
    }
    if RESETS.contains(&frame) {
        rig.reset(0).expect("a camera of the rig");
    }
}

/// Runs the frames with a quantum of 1 all along.
fn free_stamps(sensor: &SensorModel, frames: &Sequence, options: RigOptions) -> Vec<Step> {
    let mut rig = rig(sensor, frames, options);
    let each = |index| {
        if RESETS.contains(&index) {
            rig.reset(0).expect("a camera of the rig");
        }
        step(&mut rig, frames, index)
    };
    (0..TIMES_NS.len()).map(each).collect()
}

/// Runs the frames with a quantum that changes. Rigs that are restored from saved states must go on equally.
fn changing(sensor: &SensorModel, frames: &Sequence, options: RigOptions) -> Vec<Step> {
    let mut saving = rig(sensor, frames, options);
    let each = |index| {
        change(&mut saving, sensor, index);
        let saved = SAVED.contains(&index).then(|| saving.save().expect("a state"));
        let got = step(&mut saving, frames, index);
        if let Some(saved) = saved {
            let mut restored = rig(&at_frame(sensor, index, true), frames, options);
            restored.restore(&saved).expect("a state of such a rig");
            let packet = step(&mut restored, frames, index).packet;
            assert!(packet == got.packet, "restored before frame {index}");
        }
        got
    };
    (0..TIMES_NS.len()).map(each).collect()
}

fn check(sensor: &SensorModel, options: RigOptions) {
    let frames = frames(sensor);
    let what = |index: usize| {
        format!("packet {index}, {:?} {:?} {}", sensor.timestamps, sensor.readout, sensor.latency_ns)
    };
    let free = free_stamps(sensor, &frames, options);
    let got = changing(sensor, &frames, options);
    let mut oracle = Oracle::new(sensor.clone(), 0).expect("a valid sensor");
    let (mut complete_ns, mut moved, mut latest_ns) = (i64::MIN, 0, i64::MIN);
    for (index, (&t_ns, (got, free))) in TIMES_NS.iter().zip(got.iter().zip(&free)).enumerate() {
        if t_ns < complete_ns {
            (complete_ns, latest_ns) = (i64::MIN, i64::MIN);
        }
        let quantum_ns = i64::from(at_frame(sensor, index, true).timestamp_quantum_ns);
        let floored = |t_ns: i64| t_ns.div_euclid(quantum_ns) * quantum_ns;
        let stamped =
            |event: Event| Event { t_ns: floored(event.t_ns).max(complete_ns.saturating_add(1)), ..event };
        moved += free.packet.iter().filter(|event| floored(event.t_ns) <= complete_ns).count();
        let mut expected: Vec<Event> = free.packet.iter().map(stamped).collect();
        expected.sort_unstable();
        let events: Vec<Event> = got.packet.iter().collect();
        assert!(events == expected, "{}: {} events, expected {}", what(index), events.len(), expected.len());
        assert_eq!(got.diagnostics.deferred_events, free.diagnostics.deferred_events, "{}", what(index));
        assert!(
            events.iter().all(|event| event.t_ns > complete_ns && event.t_ns >= latest_ns),
            "{}",
            what(index)
        );
        complete_ns = complete_ns.max(floored(t_ns + 1) - 1);
        latest_ns = events.last().map_or(latest_ns, |event| event.t_ns);

        oracle.set_sensor(at_frame(sensor, index, true)).expect("of the same size");
        if RESETS.contains(&index) {
            oracle.reset();
        }
        let packet = oracle.step(&frames.oracle_frame(index)).expect("a frame in time").packet;
        assert_eq!(
            (got.packet.watermark_ns, packet.watermark_ns),
            (complete_ns, complete_ns),
            "{}",
            what(index)
        );
        assert_eq!(got.packet.base_ns, packet.base_ns, "{}", what(index));
        assert_eq!(got.packet.len(), packet.len(), "{}", what(index));
        if sensor.timestamps == Timestamps::AtSample {
            assert!(got.packet == packet, "{}: not the oracle's", what(index));
        }
    }
    assert!(moved > 20, "{}: {moved} events", what(COARSE.start));
}

#[test]
fn a_coarser_quantum_stamps_nothing_up_to_the_watermark_before() {
    for sensor in sensors() {
        check(&sensor, RigOptions::default());
    }
    assert_silent();
}

/// Where events hardly wait, `sort` serves the bus on GPUs; else `readout` does, chunks side by side.
#[test]
fn a_bus_stamps_alike_on_a_gpu() {
    let (gpu, software) = (KernelPolicy::gpu(), KernelPolicy::software_driver());
    let policy = KernelPolicy {
        readout_threads: gpu.readout_threads,
        // The software driver ends longer loops.
        readout_rounds: software.readout_rounds,
        readout_dispatches: gpu.readout_dispatches,
        readout_light: gpu.readout_light,
        readout_apart: gpu.readout_apart,
        sort_threads: gpu.sort_threads,
        group_bins: gpu.group_bins,
        ..policy()
    };
    for sensor in sensors().into_iter().filter(|sensor| sensor.readout != ReadoutKind::None) {
        check(&sensor, RigOptions { policy: Some(policy), ..RigOptions::default() });
    }
    assert_silent();
}
