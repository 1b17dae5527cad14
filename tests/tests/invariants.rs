//! Properties that hold for all frames: integration, symmetry, continuation, independence.

use esaac_engine::{CameraConfig, FrameBytes, Rig, RigOptions};
use esaac_model::packet::Event;
use esaac_model::{HdrFormat, Intensity, MotionFormat, Packet, Polarity, SensorModel, Synthesis, Timestamps};
use esaac_oracle::metrics::compare;
use esaac_scene::SceneKind;
use esaac_tests::agreement::LEVEL_TOLERANCE_LOG;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{FRAME_NS, Sequence, gray, intensity_of, scene, times};
use esaac_tests::run::{camera, engine, engine_of_many, events, rig, step, steps};

/// Difference of shot-event times between runs with intervals of different lengths, nanoseconds. Hazards are sums of
/// f32, rounded to 2^-27 once per interval. At the lowest hazard here, 2.5 per second, this covers some hundred
/// roundings and an ulp of a hazard of 30.
const NOISE_TIME_TOLERANCE_NS: i64 = 2_000;

/// Largest drift of the reference after a million events, as a share of the threshold (a requirement).
const DRIFT_SHARE: f64 = 0.01;

fn sensor((width, height): (u32, u32)) -> SensorModel {
    SensorModel { width, height, synthesis: Synthesis::Linear, substeps: 8, ..SensorModel::default() }
}

/// A sensor with every effect on.
fn loud(size: (u32, u32)) -> SensorModel {
    SensorModel {
        contrast_mismatch: 0.03,
        refractory_ns: 2_000_000,
        leak_rate_hz: 5.0,
        leak_spread_log: 0.3,
        shot_noise_rate_hz: 40.0,
        latency_ns: 45_000_000,
        latency_jitter_ns: 900_000,
        timestamp_quantum_ns: 10,
        seed: 12,
        ..sensor(size)
    }
}

/// Light of many frequencies that differs from pixel to pixel, nepers.
fn waves(pixel: usize, t_ns: i64) -> f64 {
    let (t, phase) = (t_ns as f64 * 1e-9, pixel as f64);
    0.9 * (11.0 * t + phase).sin() + 0.6 * (31.0 * t + 2.0 * phase).sin()
}

fn wave_frames(sensor: &SensorModel, times_ns: &[i64], sign: f64) -> Sequence {
    gray(sensor, times_ns, |frame, pixel| intensity_of(sensor, sign * waves(pixel, times_ns[frame])))
}

fn packets(steps: &[esaac_tests::run::Step]) -> Vec<Packet> {
    steps.iter().map(|step| step.packet.clone()).collect()
}

#[test]
fn integrated_events_stay_within_one_threshold_of_the_light() {
    let sensor = SensorModel { contrast_on: 0.13, contrast_off: 0.19, ..sensor((33, 9)) };
    let frames = wave_frames(&sensor, &times(0, 30), 1.0);
    let log = |frame: usize, pixel: usize| {
        (HdrFormat::F32x4.decode(&frames.frames[frame].hdr, pixel)[0] + sensor.log_offset).ln()
    };
    let mut level: Vec<f64> = (0..sensor.pixels()).map(|pixel| log(0, pixel)).collect();
    let mut count = 0;
    for (frame, step) in engine(&sensor, &frames).iter().enumerate() {
        for event in step.packet.iter() {
            let pixel = usize::from(event.y) * 33 + usize::from(event.x);
            level[pixel] += if event.polarity == Polarity::On { 0.13 } else { -0.19 };
            count += 1;
        }
        for (pixel, level) in level.iter().enumerate() {
            let distance = log(frame, pixel) - level;
            let allowed = -0.19 - LEVEL_TOLERANCE_LOG..0.13 + LEVEL_TOLERANCE_LOG;
            assert!(allowed.contains(&distance), "pixel {pixel} after frame {frame}: {distance}");
        }
    }
    assert!(count > 10_000, "{count}");
    assert_silent();
}

#[test]
fn a_run_that_was_saved_and_restored_is_one_run() {
    const STOP: usize = 4;
    const FRAMES: usize = 8;
    let size = (29, 23);
    let moving = scene(SceneKind::Flight, size, &times(0, FRAMES), HdrFormat::F32x4, MotionFormat::F32x2);
    let cameras = [
        SensorModel { synthesis: Synthesis::Motion, intensity: Intensity::BayerRggb, ..loud(size) },
        SensorModel { aps_exposure_ns: 9_000_000, ..loud(size) },
    ];
    let configs: Vec<CameraConfig> =
        (3..).zip(&cameras).map(|(number, sensor)| camera(sensor, number, &moving)).collect();
    let new_rig = || Rig::new(&DEVICE, &configs).expect("a rig of two cameras");
    let go = |rig: &mut Rig, range: std::ops::Range<usize>| {
        let mut got = Vec::new();
        for frame in &moving.frames[range] {
            for number in 0..2 {
                let bytes =
                    FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref(), ..FrameBytes::default() };
                rig.upload(number, &bytes).expect("a frame that fits");
            }
            let tick = rig.step(&[frame.t_ns; 2]).expect("a frame in time");
            let deferred: Vec<u64> = tick.diagnostics.iter().map(|d| d.deferred_events).collect();
            got.push((tick.packets.to_vec(), tick.aps.to_vec(), deferred));
        }
        got
    };
    let mut whole = new_rig();
    go(&mut whole, 0..STOP);
    let saved = whole.save().expect("a state");
    let expected = go(&mut whole, STOP..FRAMES);
    assert!(expected.iter().all(|(packets, ..)| packets.iter().all(|p| !p.is_empty())));
    assert!(expected[0].2.iter().all(|&late| late > 0), "events wait while the state is saved");

    let mut fresh = new_rig();
    fresh.restore(&saved).expect("a state of such a rig");
    assert!(go(&mut fresh, STOP..FRAMES) == expected, "a new rig goes on otherwise");
    whole.restore(&saved).expect("its own state");
    assert!(go(&mut whole, STOP..FRAMES) == expected, "a rig that went back goes on otherwise");
    drop((whole, fresh));
    assert_silent();
}

#[test]
fn negated_light_with_swapped_thresholds_swaps_polarities() {
    let size = (31, 17);
    let base =
        SensorModel { synthesis: Synthesis::None, contrast_on: 0.15, contrast_off: 0.25, ..sensor(size) };
    let variants = [
        base.clone(),
        SensorModel { refractory_ns: 1_000_000, ..base.clone() },
        SensorModel { timestamps: Timestamps::AtSample, ..base },
    ];
    let times_ns = times(0, 12);
    let cameras: Vec<_> = variants
        .into_iter()
        .flat_map(|sensor| {
            let swapped = SensorModel {
                contrast_on: sensor.contrast_off,
                contrast_off: sensor.contrast_on,
                ..sensor.clone()
            };
            let upright = wave_frames(&sensor, &times_ns, 1.0);
            let negated = wave_frames(&sensor, &times_ns, -1.0);
            [(sensor, upright), (swapped, negated)]
        })
        .collect();
    let runs = engine_of_many(&cameras, RigOptions::default());
    for (pair, (sensor, _)) in runs.chunks(2).zip(cameras.iter().step_by(2)) {
        let flip = |p| if p == Polarity::On { Polarity::Off } else { Polarity::On };
        let negated = events(&pair[1]).into_iter().map(|e| Event { polarity: flip(e.polarity), ..e });
        let got = compare(size, events(&pair[0]), negated);
        assert!(got.truth_on_off.0 > 1000 && got.truth_on_off.1 > 1000, "{got:?}");
        assert_eq!(got.same_sequence, 1.0, "{sensor:?}");
        assert!(got.ranked.p99_us <= 2.0, "{sensor:?}: {:?}", got.ranked);
    }
    assert_silent();
}

#[test]
fn noise_depends_neither_on_substeps_nor_on_the_frame_rate() {
    const SECONDS: i64 = 4;
    let size = (19, 11);
    let noisy = SensorModel { refractory_ns: 0, latency_ns: 0, latency_jitter_ns: 0, ..loud(size) };
    let noisy = SensorModel { timestamp_quantum_ns: 1, shot_noise_rate_hz: 20.0, ..noisy };
    let cameras: Vec<_> = [(1, 1), (64, 30), (8, 100), (32, 7)]
        .into_iter()
        .map(|(substeps, rate_hz)| {
            let times_ns: Vec<i64> = (0..=SECONDS * rate_hz).map(|k| k * 1_000_000_000 / rate_hz).collect();
            let sensor = SensorModel { substeps, ..noisy.clone() };
            let frames = gray(&sensor, &times_ns, |_, pixel| 0.004 * pixel as f32);
            (sensor, frames)
        })
        .collect();
    let options = RigOptions::default();
    // Each camera runs alone as number 0, because noise depends on the camera's number.
    let runs: Vec<Vec<Event>> = cameras
        .iter()
        .map(|camera| events(&engine_of_many(std::slice::from_ref(camera), options)[0]))
        .map(|mut events| {
            events.sort_by_key(|e| (e.y, e.x, e.t_ns));
            events
        })
        .collect();
    assert!(runs[0].len() > 10_000, "{}", runs[0].len());
    for (run, (sensor, _)) in runs.iter().zip(&cameras).skip(1) {
        let what = format!("N = {}", sensor.substeps);
        assert_eq!(run.len(), runs[0].len(), "{what}");
        for (a, b) in runs[0].iter().zip(run) {
            assert!((a.x, a.y, a.polarity) == (b.x, b.y, b.polarity), "{what}: {a:?} against {b:?}");
            assert!((a.t_ns - b.t_ns).abs() <= NOISE_TIME_TOLERANCE_NS, "{what}: {a:?} against {b:?}");
        }
    }
    assert_silent();
}

#[test]
fn a_still_scene_is_silent_for_an_hour() {
    let size = (9, 10);
    let base = sensor(size);
    let cameras = [
        base.clone(),
        // With an APS exposure no block is skipped.
        SensorModel { aps_exposure_ns: 1_000_000, substep_policy: esaac_model::SubstepPolicy::Fixed, ..base },
    ];
    let frames = gray(&cameras[0], &[0], |_, pixel| 0.0003 * (pixel * pixel) as f32);
    let configs = cameras.map(|sensor| camera(&sensor, 0, &frames));
    let mut rig = Rig::new(&DEVICE, &configs).unwrap();
    for number in 0..2 {
        rig.upload(number, &FrameBytes { hdr: &frames.frames[0].hdr, motion: None, ..FrameBytes::default() })
            .unwrap();
    }
    // One hour in intervals of the longest length. The input buffers stay as they are.
    for second in 0..=3600_i64 {
        let tick = rig.step(&[second * 1_000_000_000; 2]).unwrap();
        assert!(tick.packets.iter().all(Packet::is_empty), "after {second} s");
        assert!(
            second == 0 || (tick.diagnostics[0].skipped_blocks, tick.diagnostics[1].skipped_blocks) == (4, 0)
        );
    }
    drop(rig);
    assert_silent();
}

#[test]
fn a_reference_does_not_drift_in_a_million_events() {
    const CONTRAST: f64 = 0.001;
    const SWINGS: usize = 101;
    let sensor = SensorModel {
        synthesis: Synthesis::None,
        contrast_on: CONTRAST,
        contrast_off: CONTRAST,
        log_offset: 1e-4,
        ..sensor((3, 1))
    };
    // The level swings between -5 and 5 and rises slowly at last. The time of the next event reveals the reference.
    let last_rise = 3.0 * CONTRAST;
    let low = |pixel: usize| -5.0 + 0.01 * pixel as f64;
    let level = |frame: usize, pixel: usize| match frame {
        0..SWINGS => low(pixel) + if frame % 2 == 1 { 10.0 } else { 0.0 },
        _ => low(pixel) + last_rise,
    };
    let frames =
        gray(&sensor, &times(0, SWINGS + 1), |frame, pixel| intensity_of(&sensor, level(frame, pixel)));
    let log = |frame: usize, pixel: usize| {
        (HdrFormat::F32x4.decode(&frames.frames[frame].hdr, pixel)[0] + sensor.log_offset).ln()
    };
    let steps = engine(&sensor, &frames);
    let (swings, last) = steps.split_at(SWINGS);
    let swings = events(swings);
    for pixel in 0..3 {
        let of_pixel: Vec<&Event> = swings.iter().filter(|e| usize::from(e.x) == pixel).collect();
        assert!(of_pixel.len() >= 999_000, "{}", of_pixel.len());
        let net: i64 = of_pixel.iter().map(|e| i64::from(e.polarity.sign())).sum();
        let reference = log(0, pixel) + net as f64 * CONTRAST;
        let (from, to) = (log(SWINGS - 1, pixel), log(SWINGS, pixel));
        let next = last[0].packet.iter().find(|e| usize::from(e.x) == pixel).expect("three thresholds");
        assert_eq!(next.polarity, Polarity::On);
        let fraction = (next.t_ns - frames.frames[SWINGS - 1].t_ns) as f64 / FRAME_NS as f64;
        let drift = from + fraction * (to - from) - CONTRAST - reference;
        println!(
            "pixel {pixel}: {} events, drift {:.4} % of a threshold",
            of_pixel.len(),
            100.0 * drift / CONTRAST
        );
        assert!(drift.abs() < DRIFT_SHARE * CONTRAST, "pixel {pixel}: {drift}");
    }
    assert_silent();
}

#[test]
fn parameters_change_between_ticks_for_one_camera_alone() {
    let size = (21, 14);
    let base = sensor(size);
    let times_ns = times(0, 13);
    let frames = wave_frames(&base, &times_ns, 1.0);
    let changes: [(&str, &str); 10] = [
        ("contrast_on", "0.1"),
        ("contrast_off", "0.35"),
        ("refractory_ns", "4000000"),
        ("leak_rate_hz", "30"),
        ("contrast_mismatch", "0.02"),
        ("refractory_ns", "0"),
        ("substeps", "32"),
        ("timestamps", "at_sample"),
        ("latency_ns", "3000000"),
        ("leak_rate_hz", "0"),
    ];
    let mut rig = Rig::new(&DEVICE, &[0, 1].map(|number| camera(&base, number, &frames))).unwrap();
    let mut oracles = [0, 1].map(|number| esaac_oracle::Oracle::new(base.clone(), number).unwrap());
    let mut sensor = base.clone();
    let (mut got, mut expected) = (vec![Vec::new(); 2], vec![Vec::new(); 2]);
    for (index, frame) in frames.frames.iter().enumerate() {
        if let Some((parameter, value)) = index.checked_sub(2).and_then(|change| changes.get(change)) {
            sensor.set(parameter, value).unwrap();
            rig.set_sensor(1, sensor.clone()).unwrap();
            oracles[1].set_sensor(sensor.clone()).unwrap();
        }
        for number in 0..2 {
            rig.upload(number, &FrameBytes { hdr: &frame.hdr, motion: None, ..FrameBytes::default() })
                .unwrap();
            let interval = oracles[number].step(&frames.oracle_frame(index)).unwrap();
            expected[number].extend(interval.packet.iter());
        }
        let tick = rig.step(&[frame.t_ns; 2]).unwrap();
        for (got, packet) in got.iter_mut().zip(tick.packets) {
            got.extend(packet.iter());
        }
    }
    for (number, (expected, got)) in expected.iter().zip(&got).enumerate() {
        let agreement = compare(size, expected.iter().copied(), got.iter().copied());
        assert_eq!(agreement.same_sequence, 1.0, "camera {number}: {agreement:?}");
        assert!(agreement.ranked.p99_us <= 2.0, "camera {number}: {agreement:?}");
    }
    drop(rig);
    assert!(got[0] == events(&engine(&base, &frames)), "the camera that was left alone");
    assert_silent();
}

#[test]
fn jitter_switched_on_counts_the_events_sent_before() {
    let size = (13, 9);
    let base = sensor(size);
    let frames = wave_frames(&base, &times(0, 6), 1.0);
    let jittery = SensorModel { latency_ns: 5_000_000, latency_jitter_ns: 1_000_000, ..base.clone() };
    let mut rig = rig(&base, &frames, RigOptions::default());
    let mut oracle = esaac_oracle::Oracle::new(base, 0).unwrap();
    for index in 0..6 {
        if index == 3 {
            rig.set_sensor(0, jittery.clone()).unwrap();
            oracle.set_sensor(jittery.clone()).unwrap();
        }
        let expected = oracle.step(&frames.oracle_frame(index)).unwrap().packet;
        let got = step(&mut rig, &frames, index).packet;
        let agreement = compare(size, expected.iter(), got.iter());
        assert!(agreement.ranked.p99_us <= 2.0, "frame {index}: {agreement:?}");
        assert!(expected.len().abs_diff(got.len()) <= 1, "frame {index}: {agreement:?}");
    }
    drop(rig);
    assert_silent();
}

/// The engine's and the oracle's packets of each frame agree, although the camera starts anew twice: the stored frames
/// hold other values after a change of `exposure_gain`, and a reset forgets them. Deferred events are discarded, noise
/// begins again, packets keep counting.
#[test]
fn a_changed_exposure_gain_and_a_reset_start_the_camera_anew() {
    const CHANGED: usize = 5;
    const RESET: usize = 10;
    let size = (13, 9);
    let base = SensorModel { latency_ns: 20_000_000, timestamp_quantum_ns: 1, ..loud(size) };
    let frames = wave_frames(&base, &times(0, 15), 1.0);
    let brighter = SensorModel { exposure_gain: 1.7, ..base.clone() };
    let mut rig = rig(&base, &frames, RigOptions::default());
    let mut oracle = esaac_oracle::Oracle::new(base, 0).unwrap();
    let mut deferred = 0;
    for index in 0..15 {
        match index {
            CHANGED => {
                rig.set_sensor(0, brighter.clone()).unwrap();
                oracle.set_sensor(brighter.clone()).unwrap();
            }
            RESET => {
                rig.reset(0).unwrap();
                oracle.reset();
            }
            _ => {}
        }
        let expected = oracle.step(&frames.oracle_frame(index)).unwrap();
        let got = step(&mut rig, &frames, index);
        let header = |packet: &Packet| (packet.sequence, packet.base_ns, packet.watermark_ns);
        assert_eq!(header(&got.packet), header(&expected.packet), "frame {index}");
        let agreement = compare(size, expected.packet.iter(), got.packet.iter());
        assert!(agreement.ranked.p99_us <= 2.0, "frame {index}: {agreement:?}");
        assert!(expected.packet.len().abs_diff(got.packet.len()) <= 1, "frame {index}: {agreement:?}");
        if index == CHANGED || index == RESET {
            assert!(got.packet.is_empty() && deferred > 0, "frame {index}: {deferred} events were deferred");
        }
        deferred = expected.diagnostics.deferred_events;
    }
    drop(rig);
    assert_silent();
}

#[test]
fn cameras_of_one_rig_are_as_if_alone() {
    let still_noise = SensorModel { latency_ns: 0, latency_jitter_ns: 0, ..loud((16, 16)) };
    let sensors = [
        sensor((37, 21)),
        SensorModel { intensity: Intensity::BayerRggb, substeps: 32, ..sensor((1, 1)) },
        still_noise,
        SensorModel { synthesis: Synthesis::None, aps_exposure_ns: 5_000_000, ..sensor((64, 8)) },
        SensorModel { contrast_on: 0.05, timestamp_quantum_ns: 1_000_000, ..sensor((8, 63)) },
        SensorModel { synthesis: Synthesis::Paper, ..sensor((9, 40)) },
    ];
    let formats = [(HdrFormat::F32x4, MotionFormat::F32x2), (HdrFormat::F16x4, MotionFormat::F16x2)];
    let cameras: Vec<_> = sensors
        .into_iter()
        .enumerate()
        .map(|(number, sensor)| {
            let (hdr, motion) = formats[number % 2];
            let size = (sensor.width, sensor.height);
            // Each camera has its own number of frames, so that in some ticks only some cameras have a frame.
            let times_ns = times(1_000_000 * number as i64, 3 + number);
            (sensor, scene(SceneKind::Hdr, size, &times_ns, hdr, motion))
        })
        .collect();
    let together = engine_of_many(&cameras, RigOptions::default());
    for (number, ((sensor, sequence), together)) in cameras.iter().zip(&together).enumerate() {
        let config = camera(sensor, number as u32, sequence);
        let mut alone = Rig::new(&DEVICE, &[config]).unwrap();
        let alone = steps(&mut alone, sequence, 0..sequence.frames.len());
        assert!(&alone == together, "camera {number} of {sensor:?}");
        assert!(number == 1 || alone.iter().any(|step| !step.packet.is_empty()), "camera {number}");
    }
    assert_silent();
}

#[test]
fn one_rig_may_have_cameras_of_different_numbers_of_transfers() {
    let size = (37, 29);
    let frames = scene(SceneKind::Flight, size, &times(0, 5), HdrFormat::F32x4, MotionFormat::F32x2);
    let cameras: Vec<_> =
        [(Intensity::Gray, 2), (Intensity::BayerRggb, 1), (Intensity::Gray, 3), (Intensity::BayerRggb, 2)]
            .map(|(intensity, transfers)| {
                let sensor =
                    SensorModel { synthesis: Synthesis::Motion, intensity, transfers, ..sensor(size) };
                (sensor, frames.clone())
            })
            .into();
    let together = engine_of_many(&cameras, RigOptions::default());
    for ((sensor, frames), together) in cameras.iter().zip(&together) {
        let alone = &engine(sensor, frames);
        assert!(alone == together, "{:?}, {} transfers", sensor.intensity, sensor.transfers);
        assert!(alone.iter().any(|step| !step.packet.is_empty()));
    }
    for [one, two] in [[2, 0], [1, 3]] {
        assert!(events(&together[one]) != events(&together[two]), "a second transfer changes something");
    }
    assert_silent();
}

#[test]
fn skipped_blocks_would_have_sent_nothing() {
    let size = (61, 50);
    let frames = scene(SceneKind::Lamp, size, &times(0, 6), HdrFormat::F32x4, MotionFormat::F32x2);
    // A spot that is lit in few frames. Refractory periods then end while the light is still.
    let spot = gray(&sensor(size), &times(0, 12), |frame, pixel| {
        let lit = frame == 2 || frame == 6;
        0.2 + if lit && pixel % 61 < 20 { 0.01 * (pixel % 61) as f32 } else { 0.0 }
    });
    let variants = [sensor(size), SensorModel { refractory_ns: 50_000_000, ..sensor(size) }];
    let mut total = 0;
    for frames in [frames, spot] {
        let cameras: Vec<_> = variants
            .iter()
            .flat_map(|sensor| {
                let exposed = SensorModel { aps_exposure_ns: 10_000_000, ..sensor.clone() };
                [(sensor.clone(), frames.clone()), (exposed, frames.clone())]
            })
            .collect();
        let runs = engine_of_many(&cameras, RigOptions::default());
        for pair in runs.chunks(2) {
            assert!(packets(&pair[0]) == packets(&pair[1]));
            assert!(pair[0].iter().any(|step| !step.packet.is_empty()));
            let skipped = |run: &[esaac_tests::run::Step]| -> u64 {
                run.iter().map(|step| step.diagnostics.skipped_blocks).sum()
            };
            total += skipped(&pair[0]);
            assert_eq!(skipped(&pair[1]), 0);
        }
    }
    assert!(total > 0, "no block was skipped");
    assert_silent();
}

#[test]
fn a_reset_camera_starts_anew() {
    let size = (17, 15);
    let base = loud(size);
    let frames = wave_frames(&base, &times(0, 4), 1.0);
    let mut rig = rig(&base, &frames, RigOptions::default());
    let first = steps(&mut rig, &frames, 0..4);
    rig.reset(0).unwrap();
    let again = steps(&mut rig, &frames, 0..4);
    assert!(events(&first) == events(&again));
    assert!(!events(&first).is_empty());
    drop(rig);
    assert_silent();
}

#[test]
fn cameras_that_are_reset_together_start_anew_and_the_others_go_on() {
    let base = loud((17, 15));
    let frames = wave_frames(&base, &times(0, 8), 1.0);
    let configs: Vec<CameraConfig> = (0..3).map(|number| camera(&base, number, &frames)).collect();
    let mut rig = Rig::new(&DEVICE, &configs).unwrap();
    // The packets of the frames `of` each camera, if it takes any.
    let run = |rig: &mut Rig, of: [Option<usize>; 3]| -> Vec<Packet> {
        for (number, frame) in of.iter().enumerate() {
            let Some(frame) = frame.map(|index| &frames.frames[index]) else { continue };
            let bytes =
                FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref(), ..FrameBytes::default() };
            rig.upload(number, &bytes).unwrap();
        }
        let t_ns = of.map(|frame| frame.map(|index| frames.frames[index].t_ns));
        rig.step_some(&t_ns).unwrap().packets.to_vec()
    };
    let first: Vec<_> = (0..4).map(|index| run(&mut rig, [Some(index); 3])).collect();
    assert!(rig.reset_some(&[0, 7]).is_err(), "there are three cameras");
    rig.reset_some(&[2, 0, 2]).unwrap();
    let same = |one: &Packet, other: &Packet| {
        let columns = |packet: &Packet| {
            let Packet { x, y, t_offset_ns, polarity, .. } = packet.clone();
            (x, y, t_offset_ns, polarity)
        };
        columns(one) == columns(other)
    };
    let mut events = 0;
    for (index, before) in first.iter().enumerate() {
        let again = run(&mut rig, [Some(index), Some(4 + index), Some(index)]);
        assert!(same(&again[0], &before[0]) && same(&again[2], &before[2]), "frame {index}");
        assert!(index > 0 || !again[1].is_empty(), "camera 1 goes on");
        events += again[0].len();
    }
    assert!(events > 100, "{events} events");
    drop(rig);
    assert_silent();
}
