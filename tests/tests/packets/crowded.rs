//! Packets whose events come all at once, or many from each pixel: the same stream as any other.

use super::{check_contract, lamp, sensor};
use esaac_engine::{KernelPolicy, LevelsFirst, Rig, RigOptions};
use esaac_layout::QUEUE_PER_PX;
use esaac_model::packet::Event;
use esaac_model::{Packet, ReadoutKind, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use esaac_tests::device::{assert_silent, policy};
use esaac_tests::frames::{Sequence, crowded, gray, intensity_of, times};
use esaac_tests::run::{Step, engine_of_many, oracle, ran_again, rig, step, steps};

/// A sensor for [`flashes`], with so many pixels that bins are too large for one workgroup.
fn wide() -> SensorModel {
    SensorModel {
        width: 160,
        height: 120,
        synthesis: Synthesis::Linear,
        contrast_on: 0.2,
        contrast_off: 0.2,
        // Coarser than the difference between f32 and f64.
        timestamp_quantum_ns: 1000,
        ..sensor()
    }
}

/// The whole image changes at once in each interval, and rests at last. All pixels cross at the same few instants. No
/// level lies on a threshold of 0.1 or 0.2.
fn flashes(sensor: &SensorModel) -> Sequence {
    const LEVELS_LOG: [f64; 5] = [-1.0, 0.27, -0.87, 0.51, 0.51];
    gray(sensor, &times(0, LEVELS_LOG.len()), |frame, _| intensity_of(sensor, LEVELS_LOG[frame]))
}

/// Asserts that packets equal the oracle's in every field. The cameras must have no noise.
#[track_caller]
fn check_against_oracle(cameras: &[(SensorModel, Sequence)], runs: &[Vec<Step>]) {
    for ((sensor, sequence), steps) in cameras.iter().zip(runs) {
        check_contract(sensor, sequence, steps);
        for (index, (step, interval)) in steps.iter().zip(oracle(sensor, 0, sequence)).enumerate() {
            let (got, expected) = (step.packet.len(), interval.packet.len());
            assert_eq!(got, expected, "packet {index} of {sensor:?}");
            assert!(step.packet == interval.packet, "packet {index} of {sensor:?}");
        }
    }
}

#[test]
fn a_flash_sorts_like_any_other_packet() {
    let free = wide();
    let at_sample = |timestamp_quantum_ns| SensorModel {
        timestamps: Timestamps::AtSample,
        substeps: 3,
        substep_policy: SubstepPolicy::Fixed,
        contrast_on: 0.1,
        contrast_off: 0.1,
        timestamp_quantum_ns,
        ..wide()
    };
    let sensors = [
        // More events per pixel than there is room for in a tile.
        SensorModel { contrast_on: 0.1, contrast_off: 0.1, ..free.clone() },
        // Several events of one pixel and polarity at the same time, which have equal sort keys.
        at_sample(1),
        at_sample(10_000_000),
        SensorModel { max_events_per_interval: 100_001, ..free.clone() },
        SensorModel { width: 127, height: 61, ..free.clone() },
        // Bins of a middle size: too large to be ranked, too small for `merge`.
        SensorModel { width: 31, height: 29, ..free.clone() },
        SensorModel { width: 240, height: 180, ..free },
    ];
    let cameras = sensors.map(|sensor| (sensor.clone(), flashes(&sensor)));
    let runs = engine_of_many(&cameras, RigOptions::default());
    check_against_oracle(&cameras, &runs);
    for (steps, (sensor, _)) in runs.iter().zip(&cameras) {
        assert!(steps[1].packet.len() + steps[1].packet.dropped as usize >= 6 * sensor.pixels());
    }
    let equal = |packet: &Packet| {
        let keys: Vec<Event> = packet.iter().collect();
        keys.windows(2).filter(|pair| pair[0] == pair[1]).count()
    };
    assert!(equal(&runs[1][1].packet) > cameras[1].0.pixels());
    assert_silent();
}

#[test]
fn what_is_late_of_a_flash_comes_in_the_packets_after() {
    let cameras = [3_000_000, 20_000_000, 40_000_000].map(|latency_ns| {
        let sensor = SensorModel { latency_ns, ..wide() };
        (sensor.clone(), flashes(&sensor))
    });
    let runs = engine_of_many(&cameras, RigOptions::default());
    check_against_oracle(&cameras, &runs);
    let pixels = u64::from(wide().width * wide().height);
    let both = |step: &Step| step.packet.len() as u64 >= pixels && step.diagnostics.deferred_events >= pixels;
    assert!(runs.iter().all(|steps| steps.iter().any(both)), "no packet is heavy with more to come");
    assert_silent();
}

#[test]
fn a_flash_beside_a_calm_camera_while_both_grow() {
    // The calm camera has fewer frames, so that it takes no part in the last ticks.
    let calm = (sensor(), lamp(4));
    let delayed = SensorModel { latency_ns: 20_000_000, ..wide() };
    let cameras = [(wide(), flashes(&wide())), (delayed.clone(), flashes(&delayed)), calm];
    let options = RigOptions { initial_events: 64, ..RigOptions::default() };
    let together = engine_of_many(&cameras, options);
    assert!(
        together.iter().flat_map(|steps| steps.iter().map(|s| s.diagnostics.regrown).max()).all(|n| n > 0)
    );
    check_against_oracle(&cameras[..2], &together[..2]);
    let alone = engine_of_many(&cameras[2..], RigOptions::default());
    assert_eq!(alone[0].len(), together[2].len());
    for (index, (a, b)) in alone[0].iter().zip(&together[2]).enumerate() {
        assert!(a.packet == b.packet, "packet {index}");
    }
    assert_silent();
}

/// A rig that has met packets with crowded bins has more of them, and sorts without `merge` what a fresh one merges. It may
/// sort larger groups of them then, and sum them first.
#[test]
fn a_rig_takes_more_bins_for_crowded_packets_which_stay_as_they_are() {
    let free = SensorModel { width: 96, height: 80, contrast_on: 0.9, contrast_off: 0.9, ..wide() };
    let delayed = SensorModel { latency_ns: 500_000, ..free.clone() };
    let other_groups = KernelPolicy {
        group_bins: 8,
        group_bins_of_many: 16,
        many_bins: 256,
        summed_reads: 256 * 256 / 16,
        ..policy()
    };
    let with_bus = SensorModel { readout: ReadoutKind::Fifo, readout_event_ns: 1.0, ..free.clone() };
    let plain = [free.clone(), delayed, with_bus].map(|sensor| (sensor, None));
    for (sensor, policy) in plain.into_iter().chain([(free, Some(other_groups))]) {
        let options = RigOptions { stage_times: true, policy, ..RigOptions::default() };
        let sequence = crowded(&sensor, 6);
        let mut grown = rig(&sensor, &sequence, options);
        let bins = |rig: &Rig| {
            let of_bins = rig.memory().into_iter().filter(|part| part.purpose == "bins");
            of_bins.map(|part| part.bytes).sum::<u64>()
        };
        let first = bins(&grown);
        let mut steps = steps(&mut grown, &sequence, 0..3);
        for index in 3..sequence.frames.len() {
            let mut fresh = rig(&sensor, &sequence, options);
            fresh.restore(&grown.save().expect("a state")).expect("that of an equal rig");
            let got = step(&mut grown, &sequence, index);
            let expected = step(&mut fresh, &sequence, index);
            assert!(got.packet.len() > 4 * sensor.pixels(), "{} events", got.packet.len());
            assert!(got.packet == expected.packet, "packet {index} of {sensor:?}");
            assert!(ran_again(&fresh), "packet {index} of {sensor:?} is not heavy");
            // Where a bus is crowded, `readout` may run by itself.
            let merges = ran_again(&grown) && sensor.readout == ReadoutKind::None;
            assert!(!merges, "packet {index} of {sensor:?} is merged all the same");
            steps.push(got);
        }
        check_contract(&sensor, &sequence, &steps);
        assert!(bins(&grown) >= 2 * first - first / 4, "{first} bytes, then {}", bins(&grown));
    }
    assert_silent();
}

/// Each pixel has 50 to 100 events in an interval. Once the rig has met them, it has room for them while it walks.
#[test]
fn many_events_of_each_pixel_are_walked_once_and_stay_as_they_are() {
    let sensor = SensorModel { width: 64, height: 64, contrast_on: 0.04, contrast_off: 0.04, ..wide() };
    let sequence = gray(&sensor, &times(0, 8), |frame, pixel| {
        let swing = 1.0 + f64::from(pixel as u32) / f64::from(sensor.width * sensor.height);
        intensity_of(&sensor, if (pixel + frame) % 2 == 0 { swing } else { -swing } - 1.0)
    });
    let short =
        KernelPolicy { most_queue_per_px: QUEUE_PER_PX, levels_first: LevelsFirst::Never, ..policy() };
    let [once, again] = [None, Some(short)].map(|policy| {
        let options = RigOptions { stage_times: true, policy, ..RigOptions::default() };
        let mut rig = rig(&sensor, &sequence, options);
        let steps = steps(&mut rig, &sequence, 0..sequence.frames.len());
        (steps, ran_again(&rig))
    });
    assert!(!once.1, "sub-tiles run again");
    assert!(again.1, "so few events that none would");
    for (index, (got, expected)) in once.0.iter().zip(&again.0).enumerate() {
        assert!(got.packet == expected.packet, "packet {index}");
    }
    assert!(once.0[7].packet.len() > 50 * sensor.pixels());
    check_contract(&sensor, &sequence, &once.0);
    assert_silent();
}
