//! The readout: what leaves a sensor's bus is what a queue lets out that serves one event after the other, bit for bit.
//!
//! The events that come to the bus are those of the same sensor without one, with free time stamps.

mod queue;

use esaac_engine::{KernelPolicy, PacketPlace, Representation, RigOptions};
use esaac_model::physical::MAX_DRAIN_PS;
use esaac_model::presets::preset;
use esaac_model::{Packet, ReadoutKind, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use esaac_scene::SceneKind;
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{crowded, gray, intensity_of, scene, times};
use esaac_tests::run::{Step, engine_of_many, events, oracle, oracle_events, ran_again, rig, step, steps};
use queue::{
    SIZE, Served, at_once, check, few, orders, queued, random, random_by_pixel, sensor, served, without_bus,
};

const KINDS: [ReadoutKind; 2] = [ReadoutKind::Fifo, ReadoutKind::Rows];

#[test]
fn random_streams_from_idle_to_tenfold_overload_are_served_as_by_a_queue() {
    // Some 5000 events an interval of 33 ms: a bus of 7 us an event just keeps up.
    let loads = [0.05, 0.7, 3.0, 7.0, 14.0, 70.0].map(|us| us * 1e3);
    let cameras: Vec<_> = KINDS
        .into_iter()
        .flat_map(|kind| loads.map(|event_ns| sensor(kind, event_ns)))
        .map(|sensor| (sensor.clone(), random(&sensor, 5, 5.0)))
        .collect();
    let [.., runs] = orders().map(|options| check(&cameras, options));
    let lost = |run: &Vec<Served>| run.iter().map(|s| s.lost).sum::<u64>();
    for of_kind in runs.chunks(loads.len()) {
        assert_eq!(lost(&of_kind[0]), 0, "an idle bus loses nothing");
        assert!(lost(&of_kind[5]) > 5_000, "an overloaded one does: {}", lost(&of_kind[5]));
        assert!(of_kind[4].last().is_some_and(|s| s.waiting > 500), "events wait at the end");
    }
}

#[test]
fn any_number_of_events_is_served_as_by_a_queue() {
    let counts = [0, 1, 2, 31, 32, 33, 63, 64, 65, 127, 128, 129, 511, 512, 513, 1025];
    let cameras: Vec<_> = KINDS
        .into_iter()
        .flat_map(|kind| [83.0, 50_000.0].map(|event_ns| sensor(kind, event_ns)))
        .map(|sensor| (sensor.clone(), few(&sensor, &counts)))
        .collect();
    for options in orders() {
        check(&cameras, options);
    }
}

/// All pixels send events within two nanoseconds. Their rows wait, and are through long before the first event of the next
/// interval, which hardly waits.
#[test]
fn what_waits_is_served_before_a_quiet_interval() {
    let cameras = KINDS.map(|kind| {
        let sensor = SensorModel {
            width: 5,
            height: 26,
            contrast_on: 0.2,
            contrast_mismatch: 0.0,
            ..sensor(kind, 83.0)
        };
        let frames = gray(&sensor, &[0, 2, 1_000_000_002], |frame, pixel| {
            // In the last interval each pixel sends one event, at a time of its own in the middle.
            let level = [0.0, 0.5, 0.75 + 0.0003 * pixel as f64][frame];
            intensity_of(&sensor, level - 1.0)
        });
        (sensor, frames)
    });
    let gpu = RigOptions { policy: Some(KernelPolicy::gpu()), ..RigOptions::default() };
    for options in orders().into_iter().chain([gpu]) {
        for run in check(&cameras, options) {
            assert!(run[1].waiting > 50, "{} events wait", run[1].waiting);
            assert_eq!((run[2].events.len(), run[2].waiting), (2 * 130, 0), "all leave in the last interval");
        }
    }
}

/// Rows whose service begins within the last nanosecond of an interval leave in it: the next packet begins after it.
#[test]
fn no_event_leaves_with_an_earlier_time_than_the_packet_before_it_ended() {
    let rows = SensorModel {
        width: 5,
        height: 26,
        readout_row_ns: 0.0023,
        timestamps: Timestamps::AtSample,
        ..sensor(ReadoutKind::Rows, 0.025)
    };
    let frames = gray(&rows, &[0, 1_000, 2_000], |frame, _| intensity_of(&rows, 0.5 * frame as f64 - 1.0));
    for options in orders() {
        let runs = check(&[(rows.clone(), frames.clone())], options);
        let times_ns: Vec<Vec<i64>> =
            runs[0].iter().map(|served| served.events.iter().map(|event| event.t_ns).collect()).collect();
        assert!(!times_ns[1].is_empty() && runs[0][1].waiting > 0, "some leave at once, some wait");
        assert!(times_ns[2].iter().all(|&t_ns| t_ns > 1_000), "{:?}", times_ns[2]);
    }
}

/// A line of pixels, and one pixel that sends many events, none of which another may pass.
#[test]
fn long_chains_of_losses_are_served_as_by_a_queue() {
    let narrow = |kind, event_ns, width, height| {
        let sensor =
            SensorModel { width, height, contrast_on: 0.01, contrast_off: 0.01, ..sensor(kind, event_ns) };
        (sensor.clone(), random(&sensor, 4, 1000.0))
    };
    let cameras: Vec<_> = KINDS
        .into_iter()
        .flat_map(|kind| {
            [30_000.0, 200_000.0]
                .into_iter()
                .flat_map(move |event_ns| [(1, 1), (9, 1), (1, 9)].map(|(w, h)| narrow(kind, event_ns, w, h)))
        })
        .collect();
    let runs = check(&cameras, RigOptions::default());
    assert!(runs.iter().any(|run| run.iter().map(|s| s.lost).sum::<u64>() > 500));
}

/// A few pixels send nearly all events, many times more than a bus serves.
#[test]
fn what_few_pixels_send_too_much_is_served_as_by_a_queue() {
    let cameras = KINDS.map(|kind| {
        let sensor = SensorModel { contrast_on: 0.002, contrast_off: 0.002, ..sensor(kind, 40_000.0) };
        let frames = random_by_pixel(&sensor, 3, |pixel| if pixel % 401 < 2 { 2000.0 } else { 1.5 });
        (sensor, frames)
    });
    for options in orders() {
        let lost = check(&cameras, options).iter().map(|run| run.iter().map(|s| s.lost).sum::<u64>()).min();
        assert!(lost.is_some_and(|lost| lost > 2_000), "{lost:?} events lost at the least");
    }
}

/// The bus takes just as long for a pixel's first event as the second comes after it, or a picosecond less. Both events
/// are of one interval, or of one each.
#[test]
fn an_event_at_the_very_nanosecond_at_which_its_pixel_becomes_free_is_lost() {
    for levels in [[0.0, 2.4, 2.4], [0.0, 1.2, 2.4]] {
        let sensor = |kind, service_ns: f64| SensorModel {
            width: 3,
            height: 2,
            readout_row_ns: service_ns - 83.0,
            ..sensor(kind, if kind == ReadoutKind::Rows { 83.0 } else { service_ns })
        };
        let frames = |sensor: &SensorModel| {
            gray(sensor, &[0, 200_000, 400_000], |frame, pixel| {
                let level = if pixel == 4 { levels[frame] * sensor.contrast_on } else { 0.0 };
                intensity_of(sensor, level - 3.0)
            })
        };
        let plain = without_bus(&sensor(ReadoutKind::Fifo, 100.0));
        let arrivals = engine_of_many(&[(plain.clone(), frames(&plain))], RigOptions::default());
        let times_ns: Vec<i64> = events(&arrivals[0]).iter().map(|event| event.t_ns).collect();
        let &[first_ns, second_ns] = &times_ns[..] else { panic!("two events, not at {times_ns:?}") };
        let cameras: Vec<_> = KINDS
            .into_iter()
            .flat_map(|kind| [0.0, 0.001].map(|less_ns| (kind, (second_ns - first_ns) as f64 - less_ns)))
            .map(|(kind, service_ns)| sensor(kind, service_ns))
            .map(|sensor| (sensor.clone(), frames(&sensor)))
            .collect();
        for options in orders() {
            let runs = check(&cameras, options);
            let lost: Vec<u64> = runs.iter().map(|run| run.iter().map(|s| s.lost).sum()).collect();
            assert_eq!(lost, [1, 0, 1, 0], "events at {times_ns:?}");
        }
    }
}

/// All pixels cross at one instant: packets that `merge` sorts, before the bus and behind it.
#[test]
fn a_flash_of_all_pixels_is_served_as_by_a_queue_though_buffers_grow() {
    let flash = |kind, event_ns: f64, quantum_ns| {
        let sensor = SensorModel {
            timestamps: Timestamps::AtSample,
            synthesis: Synthesis::Linear,
            substep_policy: SubstepPolicy::Fixed,
            substeps: 2,
            timestamp_quantum_ns: quantum_ns,
            width: 120,
            height: 90,
            ..sensor(kind, event_ns)
        };
        let frames = gray(&sensor, &times(-1, 6), |frame, _| if frame % 2 == 0 { 0.2 } else { 0.3 });
        (sensor, frames)
    };
    let mut cameras =
        vec![(sensor(ReadoutKind::None, 83.0), random(&sensor(ReadoutKind::None, 83.0), 3, 4.0))];
    for kind in KINDS {
        cameras.extend([flash(kind, 0.001, 1), flash(kind, 83.0, 1_000), flash(kind, 4_000.0, 20_000_000)]);
    }
    for (options, initial_events) in orders().into_iter().zip([0, 64, 64]) {
        check(&cameras, RigOptions { initial_events, ..options });
    }
}

/// So many events that a rig takes more bins than it has at first, and its outlets with it.
#[test]
fn packets_whose_bins_are_crowded_are_served_as_by_a_queue() {
    let cameras = KINDS.map(|kind| {
        let sensor = SensorModel {
            width: 96,
            height: 80,
            synthesis: Synthesis::Linear,
            contrast_on: 0.9,
            contrast_off: 0.9,
            ..sensor(kind, 40.0)
        };
        (sensor.clone(), crowded(&sensor, 5))
    });
    for options in orders().into_iter().take(3) {
        let runs = check(&cameras, options);
        let events = runs.iter().flat_map(|run| &run[1..]).map(|served| served.events.len());
        assert!(events.min() > Some(256 * 128), "too few for more bins");
    }
}

#[test]
fn the_rate_controller_the_tick_and_the_latency_are_those_of_the_queue() {
    let cameras: Vec<_> = KINDS
        .into_iter()
        .flat_map(|kind| {
            [(0, 1_000_000), (3, 50_000), (40, 3_000_000), (300, 100_000_000)].map(|(cap, period)| {
                SensorModel {
                    readout_cap_events: cap,
                    readout_cap_period_ns: period,
                    timestamp_quantum_ns: if cap == 40 { 7_000 } else { 1_000 },
                    latency_ns: 5_000_000,
                    latency_jitter_ns: 100_000,
                    refractory_ns: 10_000,
                    ..sensor(kind, 4_000.0)
                }
            })
        })
        .map(|sensor| (sensor.clone(), random(&sensor, 4, 5.0)))
        .collect();
    let runs = check(&cameras, at_once());
    let capped: Vec<u64> = runs.iter().map(|run| run.iter().map(|s| s.capped).sum()).collect();
    assert!(
        capped[0] == 0 && capped[4] == 0 && capped.iter().filter(|&&n| n > 100).count() == 6,
        "{capped:?}"
    );
}

#[test]
fn a_davis346_sends_12_million_events_a_second_and_10_000_at_once_in_a_millisecond() {
    let davis = SensorModel {
        readout: ReadoutKind::Fifo,
        synthesis: Synthesis::None,
        timestamps: Timestamps::AtSample,
        ..preset("davis346").expect("listed")
    };
    // Each fourth pixel, up to 10 000, crosses at the end of the second interval.
    let millisecond = |k: i64| k * 1_000_000;
    let frames = gray(&davis, &(0..5).map(millisecond).collect::<Vec<_>>(), |frame, pixel| {
        let crosses = frame >= 2 && pixel % 4 == 0 && pixel / 4 < 10_000;
        intensity_of(&davis, if crosses { -0.7 } else { -1.0 })
    });
    let run = check(&[(davis, frames)], at_once()).remove(0);
    let counts: Vec<usize> = run.iter().map(|s| s.events.len()).collect();
    assert_eq!(counts, [0, 0, 0, 10_000, 0]);
    let times_ns: Vec<i64> = run[3].events.iter().map(|event| event.t_ns).collect();
    assert_eq!((times_ns[0], times_ns[9_999]), (2_000_083, 2_830_000));
    let per_second = 10_000.0 / 830_000e-9;
    assert!((per_second / 12e6_f64 - 1.0).abs() < 0.01, "{per_second} events a second");
}

#[test]
fn an_infinitely_fast_bus_changes_nothing() {
    let fast = |kind| SensorModel {
        readout_event_ns: if kind == ReadoutKind::Rows { 0.0 } else { 0.001 },
        readout_row_ns: 0.001,
        timestamp_quantum_ns: 1_000,
        ..sensor(kind, 1.0)
    };
    for physical in [false, true] {
        let cameras = [ReadoutKind::None, ReadoutKind::Fifo, ReadoutKind::Rows].map(|kind| {
            let sensor = if physical { fast(kind).with_preset_pixel() } else { fast(kind) };
            (sensor.clone(), random(&SensorModel { log_offset: 0.01, ..sensor }, 4, 5.0))
        });
        // All of them have the same number in random draws.
        let runs = cameras.map(|(sensor, frames)| {
            let mut rig = rig(&sensor, &frames, at_once());
            steps(&mut rig, &frames, 0..4)
        });
        assert!(events(&runs[0]).len() > 1000);
        assert_eq!(runs[0], runs[1], "one by one");
        assert_eq!(runs[0], runs[2], "by row");
    }
    assert_silent();
}

#[test]
fn the_oracle_has_the_same_bus_for_both_pixels() {
    for kind in KINDS {
        for physical in [false, true] {
            let sensor = SensorModel { timestamp_quantum_ns: 1_000, ..sensor(kind, 20_000.0) };
            let sensor = if physical { sensor.with_preset_pixel() } else { sensor };
            let sensor = SensorModel { noise_gain: 0.0, ..sensor };
            let frames = scene(
                SceneKind::Hdr,
                SIZE,
                &times(0, 4),
                esaac_model::HdrFormat::F32x4,
                esaac_model::MotionFormat::F32x2,
            );
            let mut rig = rig(&sensor, &frames, RigOptions::default());
            let got = steps(&mut rig, &frames, 0..4);
            let expected = oracle(&sensor, 0, &frames);
            let lost = |n: &[u64]| n.iter().sum::<u64>();
            let engine_lost = lost(&got.iter().map(|s| s.diagnostics.lost_events).collect::<Vec<_>>());
            let oracle_lost = lost(&expected.iter().map(|s| s.diagnostics.lost_events).collect::<Vec<_>>());
            let (a, b) = (events(&got).len(), oracle_events(&expected).len());
            assert!(a > 1000 && a.abs_diff(b) <= a / 200, "{kind:?}: {a} and {b} events");
            assert!(
                engine_lost.abs_diff(oracle_lost) <= 5 + engine_lost / 50,
                "{engine_lost}, {oracle_lost}"
            );
        }
    }
    assert_silent();
}

#[test]
fn a_saved_bus_goes_on_as_if_nothing_had_happened() {
    for (kind, cap) in [(ReadoutKind::Fifo, 900), (ReadoutKind::Rows, 900), (ReadoutKind::Fifo, 0)] {
        let sensor = SensorModel {
            latency_ns: 3_000_000,
            readout_cap_events: cap,
            readout_cap_period_ns: 50_000_000,
            ..sensor(kind, 10_000.0)
        };
        let frames = random(&sensor, 6, 5.0);
        // Its buffers grow; the other rig's do not.
        let small = RigOptions { initial_events: 64, ..at_once() };
        let mut whole = rig(&sensor, &frames, small);
        steps(&mut whole, &frames, 0..3);
        let saved = whole.save().expect("a healthy rig");
        assert_eq!(saved, whole.save().expect("a healthy rig"), "saving twice gives the same bytes");
        let expected = steps(&mut whole, &frames, 3..6);
        assert!(expected[0].diagnostics.deferred_events > 100);
        let mut other = rig(&sensor, &frames, RigOptions::default());
        other.restore(&saved).expect("the same sensor");
        let served = |steps: &[Step]| steps.iter().map(served).collect::<Vec<_>>();
        assert_eq!(served(&steps(&mut other, &frames, 3..6)), served(&expected), "in another rig");
        whole.restore(&saved).expect("the same sensor");
        assert_eq!(served(&steps(&mut whole, &frames, 3..6)), served(&expected), "in the same rig");
        whole.reset(0).expect("there is a camera");
        let later = gray(&sensor, &times(10_000_000_000, 3), |_, _| 0.2);
        let after = steps(&mut whole, &later, 0..3);
        assert!(events(&after).is_empty(), "nothing waits after a reset");
        assert_eq!(after[2].diagnostics.deferred_events, 0);
    }
    assert_silent();
}

#[test]
fn a_bus_is_switched_on_and_off_while_a_camera_runs() {
    let (off, on) = (sensor(ReadoutKind::None, 9_000.0), sensor(ReadoutKind::Rows, 9_000.0));
    let frames = random(&off, 12, 5.0);
    let alone = |sensor: &SensorModel, range| {
        let mut rig = rig(sensor, &frames, RigOptions::default());
        steps(&mut rig, &frames, range)
    };
    let mut switched = rig(&off, &frames, at_once());
    for (sensor, range) in [(&off, 0..3), (&on, 3..6), (&off, 6..9), (&on, 9..12)] {
        switched.set_sensor(0, sensor.clone()).expect("a valid sensor");
        let got = steps(&mut switched, &frames, range.clone());
        let expected = alone(sensor, range);
        for (got, expected) in got.iter().zip(&expected) {
            let events = |packet: &Packet| packet.iter().collect::<Vec<_>>();
            assert_eq!(events(&got.packet), events(&expected.packet));
            assert_eq!(got.diagnostics.lost_events, expected.diagnostics.lost_events);
        }
    }
    drop(switched);
    assert_silent();
}

#[test]
fn packets_behind_a_bus_are_the_same_wherever_they_lie() {
    let sensor = SensorModel { timestamp_quantum_ns: 1_000, ..sensor(ReadoutKind::Fifo, 7_000.0) };
    let frames = random(&sensor, 4, 5.0);
    let mut owned = rig(&sensor, &frames, RigOptions::default());
    let place = |packets| RigOptions { packets, ..at_once() };
    let mut in_place = rig(&sensor, &frames, place(PacketPlace::InPlace));
    let mut on_device = rig(&sensor, &frames, place(PacketPlace::OnDevice));
    for index in 0..4 {
        let expected = step(&mut owned, &frames, index).packet;
        step(&mut in_place, &frames, index);
        assert_eq!(in_place.last_tick().view(0).to_packet(), expected);
        let held = in_place.last_tick().hold();
        assert_eq!(held.map(|held| held.view(0).to_packet()), Some(expected.clone()));
        step(&mut on_device, &frames, index);
        assert_eq!(on_device.last_tick().events, [expected.len() as u32]);
        for what in
            [Representation::Gathered, Representation::EventFrame, Representation::VoxelGrid { bins: 3 }]
        {
            let (a, b) = (owned.represent_to_host(what), on_device.represent_to_host(what));
            assert_eq!(a.expect("it fits"), b.expect("it fits"), "{what:?}");
        }
        let gathered = on_device.represent_to_host(Representation::Gathered).expect("it fits");
        let times_ns: Vec<u8> = expected.iter().flat_map(|event| event.t_ns.to_le_bytes()).collect();
        assert_eq!(gathered[..times_ns.len()], times_ns);
    }
    drop((owned, in_place, on_device));
    assert_silent();
}

/// A pixel's event is on its way when an interval ends in which events hardly wait. The next one, in which they do, begins
/// before it has left.
#[test]
fn a_place_that_is_taken_when_a_quiet_interval_ends_is_taken_in_a_crowded_one() {
    let bus =
        SensorModel { contrast_on: 0.005, contrast_mismatch: 0.0, ..sensor(ReadoutKind::Fifo, 200_000.0) };
    let frames = gray(&bus, &times(0, 3), |frame, pixel| {
        // Pixel 0 comes to its threshold 40 us before the second frame, and leaves 160 us after it. Then ten pixels rise by a
        // threshold each 120 us.
        let first = if pixel == 0 { 1.0 / (1.0 - 40.0 / 33_333.0) } else { 0.0 };
        let rises = if pixel < 10 { 277.0 } else { 0.0 };
        let thresholds = [0.0, first, first + rises][frame];
        intensity_of(&bus, thresholds * bus.contrast_on - 1.0)
    });
    for options in orders() {
        let all = check(&[(bus.clone(), frames.clone())], options);
        let [quiet, crowded] = [&all[0][1], &all[0][2]];
        assert_eq!((quiet.events.len(), quiet.waiting), (0, 1));
        assert!(crowded.lost > 500, "{}", crowded.lost);
    }
}

#[test]
fn a_tick_in_which_events_hardly_wait_takes_one_submission() {
    for (kind, event_ns) in
        [(ReadoutKind::Fifo, 50.0), (ReadoutKind::Rows, 50.0), (ReadoutKind::Fifo, 2_000.0)]
    {
        let sensor = SensorModel { timestamp_quantum_ns: 1_000, ..sensor(kind, event_ns) };
        let frames = random(&sensor, 12, 5.0);
        let arrivals =
            engine_of_many(&[(without_bus(&sensor), frames.clone())], RigOptions::default()).remove(0);
        let expected = queued(&sensor, &frames, &arrivals);
        let mut rig = rig(&sensor, &frames, RigOptions { stage_times: true, ..at_once() });
        let (mut at_once, mut carried) = (0, 0);
        for (index, expected) in expected.iter().enumerate() {
            let got = served(&step(&mut rig, &frames, index));
            assert_eq!(&got, expected, "packet {index}, {kind:?} {event_ns} ns");
            let again = ran_again(&rig);
            at_once += usize::from(!again && index > 0);
            carried += usize::from(!again && got.waiting > 0);
        }
        println!(
            "{kind:?} {event_ns} ns: {at_once} of 11 at once, {carried} of them with events that leave later"
        );
        if event_ns < 100.0 {
            assert!(at_once >= 9, "{kind:?} {event_ns} ns: {at_once} of 11");
        } else {
            assert!(carried >= 1, "{kind:?} {event_ns} ns: {carried} of {at_once}");
        }
    }
    assert_silent();
}

#[test]
fn a_bus_that_could_not_empty_its_pixels_in_time_is_refused() {
    let sensor =
        SensorModel { width: 100, height: 100, readout_row_ns: 0.0, ..sensor(ReadoutKind::Fifo, 300_000.0) };
    assert_eq!(MAX_DRAIN_PS, 10_000 * 300_000_000);
    assert_eq!(sensor.validate(), Ok(()));
    let error = SensorModel { readout_event_ns: 300_000.1, ..sensor }.validate().unwrap_err().to_string();
    assert!(error.contains("readout_event_ns") && error.contains("100x100"), "{error}");
}
