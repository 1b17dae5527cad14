//! The contract of packets: order, completeness, and the same stream however buffers, bins and batches are arranged.

mod crowded;
mod quantum;

use esaac_engine::{FrameInput, InputBuffers, MemoryLocation, Rig, RigOptions, SubmitHooks};
use esaac_model::packet::Event;
use esaac_model::{HdrFormat, MotionFormat, ReadoutKind, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use esaac_oracle::Oracle;
use esaac_scene::SceneKind;
use esaac_tests::agreement::compare;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{FRAME_NS, Sequence, gray, intensity_of, scene, times};
use esaac_tests::run::{Step, engine_of_many, engine_with, events, oracle, oracle_events, rig, step};

const SIZE: (u32, u32) = (61, 43);

fn sensor() -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis: Synthesis::None,
        substeps: 8,
        ..SensorModel::default()
    }
}

/// Light that changes everywhere: tens of events per pixel.
fn busy(frames: usize) -> Sequence {
    scene(SceneKind::Hdr, SIZE, &times(0, frames), HdrFormat::F32x4, MotionFormat::F32x2)
}

fn lamp(frames: usize) -> Sequence {
    scene(SceneKind::Lamp, SIZE, &times(-100_000_001, frames), HdrFormat::F32x4, MotionFormat::F32x2)
}

/// Asserts what holds for the packets of every sensor.
fn check_contract(sensor: &SensorModel, sequence: &Sequence, steps: &[Step]) {
    let mut last: Option<(Event, i64)> = None;
    for (index, (step, frame)) in steps.iter().zip(&sequence.frames).enumerate() {
        let packet = &step.packet;
        assert!(packet.is_sorted(), "packet {index} of {sensor:?}");
        assert_eq!((packet.width_px, packet.height_px), (sensor.width, sensor.height));
        assert_eq!(packet.sequence, index as u64);
        let quantum_ns = i64::from(sensor.timestamp_quantum_ns);
        let watermark_ns = (frame.t_ns + 1).div_euclid(quantum_ns) * quantum_ns - 1;
        assert_eq!(packet.watermark_ns, watermark_ns, "packet {index} of {sensor:?}");
        for event in packet.iter() {
            assert!(event.t_ns <= frame.t_ns && event.t_ns % quantum_ns == 0, "{event:?} of packet {index}");
            assert!(u32::from(event.x) < sensor.width && u32::from(event.y) < sensor.height);
        }
        if let (Some((before, watermark_ns)), false) = (last, packet.is_empty()) {
            let first = packet.event(0);
            assert!(first.t_ns >= before.t_ns, "{before:?} in an earlier packet than {first:?}");
            assert!(first.t_ns > watermark_ns, "{first:?} though the stream was complete to {watermark_ns}");
        }
        if !packet.is_empty() {
            last = Some((packet.event(packet.len() - 1), packet.watermark_ns));
        } else if let Some((_, complete_ns)) = &mut last {
            *complete_ns = packet.watermark_ns;
        }
    }
}

/// Sensors whose time stamps need different bins: free times, few different times, times of samples.
fn stampings() -> Vec<SensorModel> {
    let at_sample = |substeps, substep_policy| SensorModel {
        timestamps: Timestamps::AtSample,
        synthesis: Synthesis::Linear,
        substeps,
        substep_policy,
        ..sensor()
    };
    let mut all: Vec<SensorModel> = [1, 7, 1_000, 1_000_000, 33_333_333, 50_000_000]
        .map(|timestamp_quantum_ns| SensorModel { timestamp_quantum_ns, ..sensor() })
        .into();
    all.extend([at_sample(8, SubstepPolicy::Fixed), at_sample(5, SubstepPolicy::Fixed)]);
    // Shots have times of their own.
    all.push(SensorModel { shot_noise_rate_hz: 50.0, ..at_sample(8, SubstepPolicy::Fixed) });
    all.push(at_sample(8, SubstepPolicy::Adaptive));
    all.push(SensorModel { timestamp_quantum_ns: 10_000, ..at_sample(8, SubstepPolicy::Fixed) });
    all
}

#[test]
fn every_kind_of_stamp_sorts() {
    let cameras: Vec<_> =
        stampings().into_iter().flat_map(|sensor| [(sensor.clone(), busy(4)), (sensor, lamp(4))]).collect();
    let runs = engine_of_many(&cameras, RigOptions::default());
    for (number, ((sensor, sequence), steps)) in cameras.iter().zip(&runs).enumerate() {
        check_contract(sensor, sequence, steps);
        let expected = oracle_events(&oracle(sensor, number as u32, sequence));
        let got = events(steps);
        assert!(got.len() > 1000, "{sensor:?}: {}", got.len());
        assert_eq!(got.len(), expected.len(), "{sensor:?}");
    }
    assert_silent();
}

/// Bins with so many events that they are split before they are ranked: by time, and where a bin has one time, by pixel.
#[test]
fn crowded_bins_are_split_and_lose_nothing() {
    /// Bins of a small camera, and the most events of a bin that is not split.
    const BINS: usize = 128;
    const UNSPLIT_EVENTS: usize = 64;
    let free = SensorModel { contrast_on: 0.02, contrast_off: 0.02, ..sensor() };
    let at_sample = SensorModel {
        timestamps: Timestamps::AtSample,
        synthesis: Synthesis::Linear,
        substep_policy: SubstepPolicy::Fixed,
        ..free.clone()
    };
    let sensors = [
        SensorModel { timestamp_quantum_ns: 1000, ..free.clone() },
        free,
        at_sample.clone(),
        SensorModel { timestamp_quantum_ns: 10_000_000, ..at_sample },
    ];
    for sensor in sensors {
        let sequence = busy(3);
        let steps = engine_with(&sensor, &sequence, RigOptions::default());
        check_contract(&sensor, &sequence, &steps);
        let found = compare(&sensor, 0, &sequence, &steps);
        assert_eq!((found.unexplained, found.late), (vec![], vec![]), "{sensor:?}");
        for step in &steps[1..] {
            let events = step.packet.len();
            assert!(events > BINS * UNSPLIT_EVENTS, "{events} events in {BINS} bins of {sensor:?}");
        }
    }
    assert_silent();
}

#[test]
fn delays_carry_over_and_lose_nothing() {
    let delays = [(1, 0), (20_000_000, 0), (0, 3_000_000), (90_000_000, 9_000_000), (999_999_999, 0)];
    let (busy_frames, still_frames) = (4, 33);
    // After the light has stopped, enough frames follow for the longest delay to end.
    let mut frames = busy(busy_frames);
    for k in busy_frames..busy_frames + still_frames {
        let mut frame = frames.frames[busy_frames - 1].clone();
        frame.t_ns = k as i64 * FRAME_NS;
        frames.frames.push(frame);
    }
    let cameras: Vec<_> = delays
        .into_iter()
        .flat_map(|(latency_ns, latency_jitter_ns)| {
            [1, 1000].map(|timestamp_quantum_ns| {
                let delay = SensorModel { latency_ns, latency_jitter_ns, ..sensor() };
                (SensorModel { timestamp_quantum_ns, ..delay }, frames.clone())
            })
        })
        .collect();
    let runs = engine_of_many(&cameras, RigOptions::default());
    let undelayed = events(&engine_with(&sensor(), &frames, RigOptions::default()));
    for ((sensor, sequence), steps) in cameras.iter().zip(&runs) {
        check_contract(sensor, sequence, steps);
        assert_eq!(events(steps).len(), undelayed.len(), "{sensor:?}");
        assert_eq!(steps.last().map(|s| s.diagnostics.deferred_events), Some(0));
        if sensor.latency_ns > FRAME_NS as u32 {
            let most = steps.iter().map(|s| s.diagnostics.deferred_events).max();
            assert!(most > Some(0), "{sensor:?}");
        }
        if sensor.latency_jitter_ns == 0 && sensor.timestamp_quantum_ns == 1 {
            let delayed =
                undelayed.iter().map(|e| Event { t_ns: e.t_ns + i64::from(sensor.latency_ns), ..*e });
            assert!(events(steps).into_iter().eq(delayed), "{sensor:?}");
        }
    }
    assert_silent();
}

/// What waits when a latency is switched off is sent when its time comes, among events that are all at the ends of sub-steps.
#[test]
fn what_waits_is_sent_after_a_latency_is_switched_off() {
    const FRAMES: usize = 8;
    for readout in [ReadoutKind::None, ReadoutKind::Fifo] {
        let prompt = SensorModel {
            timestamps: Timestamps::AtSample,
            synthesis: Synthesis::Linear,
            substep_policy: SubstepPolicy::Fixed,
            readout,
            ..sensor()
        };
        let delayed = SensorModel { latency_ns: 80_000_001, latency_jitter_ns: 3_000_000, ..prompt.clone() };
        let sequence = busy(FRAMES);
        let mut rig = rig(&delayed, &sequence, RigOptions::default());
        let mut oracle = Oracle::new(delayed.clone(), 0).expect("a valid sensor");
        let (mut got, mut expected) = (Vec::new(), Vec::new());
        for index in 0..FRAMES {
            if index == 4 {
                rig.set_sensor(0, prompt.clone()).expect("of the same size");
                oracle.set_sensor(prompt.clone()).expect("of the same size");
            }
            got.push(step(&mut rig, &sequence, index));
            expected.push(oracle.step(&sequence.oracle_frame(index)).expect("a frame in time"));
            let waiting = |index: usize| got[index].diagnostics.deferred_events;
            assert_eq!(waiting(index), expected[index].diagnostics.deferred_events, "{readout:?}, {index}");
            assert!(index != 3 || waiting(3) > 1000, "{} events wait", waiting(3));
        }
        assert!(got.iter().all(|step| step.packet.is_sorted()), "{readout:?}");
        assert_eq!(events(&got).len(), oracle_events(&expected).len(), "{readout:?}");
    }
    assert_silent();
}

fn loud() -> SensorModel {
    SensorModel {
        contrast_on: 0.03,
        contrast_off: 0.03,
        contrast_mismatch: 0.005,
        shot_noise_rate_hz: 50.0,
        leak_rate_hz: 5.0,
        latency_ns: 40_000_000,
        latency_jitter_ns: 1_000_000,
        ..sensor()
    }
}

#[test]
fn runs_are_bit_identical() {
    let frames = busy(5);
    let cameras: Vec<_> = (0..3).map(|_| (loud(), frames.clone())).collect();
    let first = engine_of_many(&cameras, RigOptions::default());
    for _ in 0..2 {
        let again = engine_of_many(&cameras, RigOptions::default());
        let packets =
            |runs: &[Vec<Step>]| runs.iter().flatten().map(|step| step.packet.clone()).collect::<Vec<_>>();
        assert!(packets(&first) == packets(&again), "two runs differ");
    }
    assert!(events(&first[0]).len() > 50_000);
    assert_silent();
}

/// Bytes of a rig's bin storage.
fn bin_storage_bytes(rig: &Rig) -> u64 {
    rig.memory().iter().filter(|used| used.purpose == "bin_storage").map(|used| used.bytes).sum()
}

#[test]
fn bins_without_room_give_the_same_packet_as_those_that_have_grown() {
    let sensor = SensorModel { contrast_on: 0.008, contrast_off: 0.008, contrast_mismatch: 0.002, ..loud() };
    let frames = busy(5);
    let mut grown = rig(&sensor, &frames, RigOptions::default());
    let at_first = bin_storage_bytes(&grown);
    for index in 0..4 {
        step(&mut grown, &frames, index);
    }
    assert!(bin_storage_bytes(&grown) > at_first, "{at_first} bytes had room for all");
    let saved = grown.save().expect("a state");
    let expected = step(&mut grown, &frames, 4).packet;
    let mut fresh = rig(&sensor, &frames, RigOptions::default());
    assert_eq!(bin_storage_bytes(&fresh), at_first);
    fresh.restore(&saved).expect("a state of such a rig");
    let overflow = step(&mut fresh, &frames, 4);
    assert!(overflow.packet == expected, "{} events, expected {}", overflow.packet.len(), expected.len());
    assert!(bin_storage_bytes(&fresh) > at_first, "a bin had room for all");
    drop((grown, fresh));
    assert_silent();
}

/// A rig with many bins sorts them in larger groups than a small rig.
#[test]
fn packets_are_the_same_in_a_rig_of_many_cameras() {
    const CAMERAS: u32 = 64;
    let sequence = busy(2);
    // The cameras' events range from more than a group sorts at once to hardly any.
    let cameras: Vec<_> = (0..CAMERAS)
        .map(|number| {
            let threshold = 0.05 * 1.08_f64.powi(number as i32);
            let sensor = SensorModel { contrast_on: threshold, contrast_off: threshold, ..sensor() };
            (sensor, sequence.clone())
        })
        .collect();
    let together = engine_of_many(&cameras, RigOptions::default());
    for ((sensor, sequence), steps) in cameras.iter().zip(&together).step_by(9) {
        check_contract(sensor, sequence, steps);
        let alone = engine_with(sensor, sequence, RigOptions::default());
        assert_eq!(events(steps), events(&alone), "thresholds of {}", sensor.contrast_on);
    }
}

#[test]
fn a_small_buffer_grows_and_gives_the_same_packets() {
    let frames = busy(5);
    let many = loud();
    let large = engine_with(&many, &frames, RigOptions { initial_events: 1 << 20, ..RigOptions::default() });
    assert!(large.iter().all(|step| step.diagnostics.regrown == 0));
    for initial_events in [1, 63, 10_007] {
        let small = engine_with(&many, &frames, RigOptions { initial_events, ..RigOptions::default() });
        let regrown: u64 = small.iter().map(|step| step.diagnostics.regrown).sum();
        assert!(regrown > 0, "{initial_events} at first");
        for (index, (small, large)) in small.iter().zip(&large).enumerate() {
            assert!(small.packet == large.packet, "packet {index} with {initial_events} at first");
            let (a, b) = (small.diagnostics, large.diagnostics);
            assert_eq!((a.deferred_events, a.dropped_events), (b.deferred_events, 0));
            assert_eq!((a.substeps, a.invalid_pixels), (b.substeps, b.invalid_pixels));
        }
    }
    assert_silent();
}

/// A row with more events than the event queue holds makes its own sub-tile run again, and no other.
#[test]
fn rows_with_many_events_leave_the_others_alone() {
    const STEPS: u32 = 6;
    let calm = SensorModel {
        width: 70,
        height: 21,
        synthesis: Synthesis::Linear,
        substeps: STEPS,
        substep_policy: SubstepPolicy::Fixed,
        contrast_on: 0.1,
        contrast_off: 0.1,
        ..SensorModel::default()
    };
    let noisy = SensorModel {
        shot_noise_rate_hz: 40.0,
        leak_rate_hz: 5.0,
        contrast_mismatch: 0.01,
        latency_jitter_ns: 50_000,
        ..calm.clone()
    };
    // From the second tile on, every fifth row swings by eighty thresholds. The other pixels swing by none to three.
    let swing = |pixel: usize| match (pixel % 70, pixel / 70) {
        (32.., row) if row % 5 == 2 => 8.04,
        (column, row) => 0.11 * ((row + column / 9) % 4) as f64,
    };
    for sensor in [calm, noisy] {
        let frames = gray(&sensor, &times(0, 5), |frame, pixel| {
            // Levels stay away from whole numbers of thresholds, where f32 and f64 could differ.
            intensity_of(
                &sensor,
                -1.0 - 0.013 * frame as f64 + if frame % 2 == 1 { swing(pixel) } else { 0.0 },
            )
        });
        for initial_events in [1 << 20, 64] {
            let options = RigOptions { initial_events, ..RigOptions::default() };
            let steps = engine_with(&sensor, &frames, options);
            check_contract(&sensor, &frames, &steps);
            let found = compare(&sensor, 0, &frames, &steps);
            assert_eq!((found.unexplained, found.late), (vec![], vec![]), "{sensor:?}");
            assert!(
                found.events > 4 * 80 * 38 && found.differing <= 1,
                "{} of {}",
                found.differing,
                found.events
            );
            for step in &steps[1..] {
                assert_eq!(step.diagnostics.substeps, u64::from(STEPS) * 9 * 3, "{sensor:?}");
            }
        }
    }
    assert_silent();
}

#[test]
fn growing_leaves_the_other_cameras_alone() {
    let calm = (sensor(), lamp(4));
    let alone = engine_of_many(std::slice::from_ref(&calm), RigOptions::default());
    let mut busy = (loud(), busy(4));
    busy.0.latency_ns = 0;
    let options = RigOptions { initial_events: 64, ..RigOptions::default() };
    let together = engine_of_many(&[calm, busy.clone(), busy], options);
    for (a, b) in alone[0].iter().zip(&together[0]) {
        assert!(a.packet == b.packet);
    }
    assert!(together[1].iter().any(|step| step.diagnostics.regrown > 0));
    assert_silent();
}

#[test]
fn the_cap_keeps_the_earliest_and_counts_the_rest() {
    const CAPS: [u32; 4] = [0, 1, 100, 777];
    let frames = busy(4);
    for (timestamps, timestamp_quantum_ns) in
        [(Timestamps::Interpolated, 1), (Timestamps::AtSample, 1_000_000)]
    {
        let free = SensorModel { timestamps, timestamp_quantum_ns, ..sensor() };
        let cameras = CAPS.map(|max_events_per_interval| {
            (SensorModel { max_events_per_interval, ..free.clone() }, frames.clone())
        });
        let runs = engine_of_many(&cameras, RigOptions::default());
        for (capped, cap) in runs.iter().zip(CAPS).skip(1) {
            for (capped, whole) in capped.iter().zip(&runs[0]) {
                let kept = whole.packet.len().min(cap as usize);
                assert_eq!(capped.packet.len(), kept);
                assert!(capped.packet.iter().eq(whole.packet.iter().take(kept)));
                assert_eq!(capped.packet.dropped, (whole.packet.len() - kept) as u64);
                assert_eq!(capped.diagnostics.dropped_events, capped.packet.dropped);
            }
            assert!(capped.iter().any(|step| step.packet.dropped > 0));
        }
    }
    assert_silent();
}

#[test]
fn the_first_frame_gives_an_empty_packet() {
    let frames = busy(2);
    let mut rig = rig(&sensor(), &frames, RigOptions::default());
    let first = step(&mut rig, &frames, 0);
    assert!(first.packet.is_empty() && first.packet.base_ns == frames.frames[0].t_ns);
    assert_eq!(first.packet.watermark_ns, frames.frames[0].t_ns);
    let second = step(&mut rig, &frames, 1);
    assert_eq!((second.packet.base_ns, second.packet.sequence), (frames.frames[0].t_ns, 1));
    drop(rig);
    assert_silent();
}

#[test]
fn frames_may_lie_elsewhere_each_time() {
    let frames = busy(4);
    let expected = engine_with(&sensor(), &frames, RigOptions::default());
    let mut rig = rig(&sensor(), &frames, RigOptions::default());
    // All buffers stay alive, so that each has a different address.
    let mut buffers = Vec::new();
    for (index, (frame, expected)) in frames.frames.iter().zip(&expected).enumerate() {
        let buffer = |image: &str, bytes: &[u8]| {
            let mut buffer = DEVICE
                .allocate(image, bytes.len() as u64, Default::default(), MemoryLocation::CpuToGpu)
                .expect("a buffer");
            buffer.write(0, bytes);
            buffer
        };
        let motion = frame.motion.as_deref().expect("the scene has motion");
        let (hdr, motion) = (buffer("hdr", &frame.hdr), buffer("motion", motion));
        let inputs = InputBuffers { hdr: &hdr, motion: Some(&motion), depth: None, ids: None };
        let input = FrameInput { t_ns: frame.t_ns, inputs: Some(inputs) };
        let tick = rig.step_frames(&[Some(input)], &SubmitHooks::default()).expect("a frame in time");
        assert_eq!(tick.packets[0], expected.packet, "frame {index}");
        buffers.extend([hdr, motion]);
    }
    drop(rig);
    assert_silent();
}
