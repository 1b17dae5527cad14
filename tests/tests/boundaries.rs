//! Values exactly on a boundary: a level on a threshold, an event at the end of a hold, the event number that no longer
//! fits into a tag. A comparison that is off by one there is right everywhere else, so that no other test finds it.

use esaac_engine::{FrameBytes, KernelPolicy, Rig, RigOptions};
use esaac_model::packet::Event;
use esaac_model::{Polarity, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use esaac_oracle::Oracle;
use esaac_tests::agreement::compare;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{Sequence, gray, intensity_of, times};
use esaac_tests::run::{camera, engine_with, events, oracle, oracle_events};

const MILLISECOND_NS: i64 = 1_000_000;

fn pixel_row(width: u32) -> SensorModel {
    SensorModel { width, height: 1, synthesis: Synthesis::None, ..SensorModel::default() }
}

/// One frame per millisecond with the given log intensities, the same at every pixel.
fn levels(sensor: &SensorModel, log: &[f64]) -> Sequence {
    let times_ns: Vec<i64> = (0..log.len() as i64).map(|k| k * MILLISECOND_NS).collect();
    gray(sensor, &times_ns, |frame, _| intensity_of(sensor, log[frame]))
}

/// The device's own kernel policy, and that of GPUs, forced on any device.
fn policies() -> [RigOptions; 2] {
    [None, Some(KernelPolicy::gpu())].map(|policy| RigOptions { policy, ..RigOptions::default() })
}

fn by_engine(sensor: &SensorModel, frames: &Sequence) -> Vec<Event> {
    events(&engine_with(sensor, frames, policies()[0]))
}

fn by_gpu_kernels(sensor: &SensorModel, frames: &Sequence) -> Vec<Event> {
    events(&engine_with(sensor, frames, policies()[1]))
}

fn by_oracle(sensor: &SensorModel, frames: &Sequence) -> Vec<Event> {
    oracle_events(&oracle(sensor, 0, frames))
}

/// Runs a sequence and returns its events.
type Run = fn(&SensorModel, &Sequence) -> Vec<Event>;

const RUNS: [(&str, Run); 3] =
    [("engine", by_engine), ("engine with a GPU's kernels", by_gpu_kernels), ("oracle", by_oracle)];

fn signs_and_times(events: &[Event]) -> Vec<(Polarity, i64)> {
    events.iter().map(|event| (event.polarity, event.t_ns)).collect()
}

/// The level returns to where it began. It is then exactly one threshold from the reference, to the last bit.
#[test]
fn a_level_that_comes_back_onto_a_threshold_sends_its_event() {
    let sensor = pixel_row(1);
    for (swing, there, back) in [(0.25, Polarity::On, Polarity::Off), (-0.25, Polarity::Off, Polarity::On)] {
        let frames = levels(&sensor, &[0.0, swing, 0.0, 0.0]);
        for (who, run) in RUNS {
            let got = signs_and_times(&run(&sensor, &frames));
            assert_eq!(got.len(), 2, "{who}: {got:?}");
            assert_eq!((got[0].0, got[1].0), (there, back), "{who}");
            assert_eq!(got[1].1, 2 * MILLISECOND_NS, "{who}: with the level's last nanosecond");
        }
    }
}

/// A threshold that is made smaller may lie exactly on the level afterwards. Its event is due at once, whether the light
/// then moves away from it or stays, so that the tile is still.
#[test]
fn a_threshold_that_is_moved_onto_the_level_sends_its_event_at_once() {
    for swing in [0.3, -0.3] {
        for last in [0.35 * swing, 0.0] {
            for (who, first, second, got) in moved_threshold(&pixel_row(1), swing, last) {
                assert_eq!(got.len(), 2, "{who}, to {last}: {got:?}");
                assert_eq!(got[0].0, first, "{who}, to {last}");
                assert_eq!(got[1], (second, 2 * MILLISECOND_NS + 1), "{who}, to {last}");
            }
        }
    }
    assert_silent();
}

/// The same with stamps at samples: what the light has left by the next sample sends nothing.
#[test]
fn a_threshold_that_is_moved_onto_the_level_counts_at_the_next_sample() {
    let base = SensorModel { timestamps: Timestamps::AtSample, ..pixel_row(1) };
    for swing in [0.3, -0.3] {
        for (last, is_sent) in [(0.35 * swing, false), (0.0, true)] {
            for (who, first, second, got) in moved_threshold(&base, swing, last) {
                let mut expected = vec![(first, MILLISECOND_NS)];
                expected.extend(is_sent.then_some((second, 3 * MILLISECOND_NS)));
                assert_eq!(got, expected, "{who}, to {last}");
            }
        }
    }
    // A shot event before that sample sets the reference to the light: such pixels have no crossing there.
    let width = 2_000;
    let noisy = SensorModel { width, shot_noise_rate_hz: 50.0, white_level: 1e6, ..base };
    for (who, .., got) in moved_threshold(&noisy, 0.3, 0.0) {
        let count = |from_ns, to_ns| got.iter().filter(|event| (from_ns..to_ns).contains(&event.1)).count();
        let (noise, crossings) =
            (count(2 * MILLISECOND_NS, 3 * MILLISECOND_NS), count(3 * MILLISECOND_NS, i64::MAX));
        assert!(noise > 50, "{who}: {noise} shot events");
        assert!(crossings > 0 && crossings + noise <= width as usize, "{who}: {crossings} and {noise}");
    }
    assert_silent();
}

type SignsAndTimes = Vec<(Polarity, i64)>;

/// The light goes to `swing` and back, then to `last`. The threshold of the way back is out of reach at first, and is
/// moved onto the level before the last interval. Returns who sent which events, and the polarities of both crossings.
fn moved_threshold(
    base: &SensorModel,
    swing: f64,
    last: f64,
) -> [(&'static str, Polarity, Polarity, SignsAndTimes); 2] {
    let (first, second, wide) = if swing > 0.0 {
        (Polarity::On, Polarity::Off, SensorModel { contrast_off: 0.3, ..base.clone() })
    } else {
        (Polarity::Off, Polarity::On, SensorModel { contrast_on: 0.3, ..base.clone() })
    };
    let frames = levels(base, &[0.0, swing, 0.0, last]);
    let mut rig = Rig::new(&DEVICE, &[camera(&wide, 0, &frames)]).expect("a rig");
    let mut oracle = Oracle::new(wide, 0).expect("a valid sensor");
    let (mut by_engine, mut by_oracle) = (Vec::new(), Vec::new());
    for (index, frame) in frames.frames.iter().enumerate() {
        if index == 3 {
            rig.set_sensor(0, base.clone()).expect("a sensor of the same size");
            oracle.set_sensor(base.clone()).expect("a sensor of the same size");
        }
        rig.upload(0, &FrameBytes { hdr: &frame.hdr, motion: None, ..FrameBytes::default() })
            .expect("a frame that fits");
        by_engine.extend(rig.step(&[frame.t_ns]).expect("a frame in time").packets[0].iter());
        by_oracle.extend(oracle.step(&frames.oracle_frame(index)).expect("in time").packet.iter());
    }
    [("engine", by_engine), ("oracle", by_oracle)]
        .map(|(who, events)| (who, first, second, signs_and_times(&events)))
}

/// A hold that ends exactly with an interval sets the reference to the light of that instant.
#[test]
fn a_hold_that_ends_with_an_interval_ends_with_it() {
    let free = pixel_row(1);
    // `held` intervals pass until the hold ends. The light then rises by less than a threshold twice, which together
    // is more than one from the event's level, and at last to just beyond one from the light at the hold's end.
    for held in [1, 2] {
        let mut log = vec![0.0, 0.25];
        log.extend(vec![0.25; held - 1]);
        log.extend([0.35, 0.44, 0.46]);
        let frames = levels(&free, &log);
        for (who, run) in RUNS {
            let first_ns = run(&free, &frames)[0].t_ns;
            let refractory_ns = (held as i64 * MILLISECOND_NS - first_ns) as u32;
            let got = signs_and_times(&run(&SensorModel { refractory_ns, ..free.clone() }, &frames));
            assert_eq!(got.len(), 2, "{who}, {held} intervals: {got:?}");
            assert_eq!(got[0], (Polarity::On, first_ns), "{who}");
            // The crossing is at .45, half-way from .44 to .46.
            let expected_ns = (2 * held as i64 + 5) * MILLISECOND_NS / 2;
            assert!((got[1].1 - expected_ns).abs() < 1_000, "{who}, {held} intervals: {got:?}");
        }
    }
}

/// Events of 40 pixels that see `log`, one frame per millisecond, with `before` and, from frame 2 on, with `after`: by the engine
/// under each policy, and by the oracle.
fn changed_at_frame_2(
    before: &SensorModel,
    after: &SensorModel,
    log: &[f64],
) -> [Vec<(&'static str, Vec<Event>)>; 2] {
    let frames = levels(before, log);
    policies().map(|options| {
        let mut rig = Rig::with_options(&DEVICE, &[camera(before, 0, &frames)], options).expect("a rig");
        let mut oracle = Oracle::new(before.clone(), 0).expect("a valid sensor");
        let (mut by_engine, mut by_oracle) = (Vec::new(), Vec::new());
        for (index, frame) in frames.frames.iter().enumerate() {
            if index == 2 {
                rig.set_sensor(0, after.clone()).expect("of the same size");
                oracle.set_sensor(after.clone()).expect("of the same size");
            }
            rig.upload(0, &FrameBytes { hdr: &frame.hdr, ..FrameBytes::default() })
                .expect("a frame that fits");
            by_engine.extend(rig.step(&[frame.t_ns]).expect("in time").packets[0].iter());
            by_oracle.extend(oracle.step(&frames.oracle_frame(index)).expect("in time").packet.iter());
        }
        vec![("engine", by_engine), ("oracle", by_oracle)]
    })
}

/// A hold that began under a refractory period ends when it would have, also if that is switched off and the pixel stands still at
/// that instant: the reference is the light of then.
#[test]
fn a_hold_ends_in_a_still_interval_after_its_period_is_switched_off() {
    let held = SensorModel { refractory_ns: 1_500_000, ..pixel_row(40) };
    let free = SensorModel { refractory_ns: 0, ..held.clone() };
    // An event at .2, held from .8 to 2.3 ms; the light is .75 from 2 to 3 ms. The next event is one threshold above that.
    for run in changed_at_frame_2(&held, &free, &[0.0, 0.25, 0.75, 0.75, 0.8, 0.96]) {
        for (who, got) in run {
            assert_eq!(got.len(), 2 * 40, "{who}");
            for pixel in [0, 39] {
                let own: Vec<_> = got.iter().filter(|event| event.x == pixel).copied().collect();
                let [first, second] = signs_and_times(&own)[..] else { panic!("{who}: {own:?}") };
                assert_eq!((first.0, second.0), (Polarity::On, Polarity::On), "{who}");
                // From .80 to .96 between 4 and 5 ms.
                let expected_ns = 4 * MILLISECOND_NS + MILLISECOND_NS * 15 / 16;
                assert!((second.1 - expected_ns).abs() < 1_000, "{who}: {second:?}");
            }
        }
    }
    assert_silent();
}

/// Thresholds that fall below what has gathered, as the refractory period is switched off: nothing is held, so that all events are
/// sent that are due, and the reference moves by their thresholds alone.
#[test]
fn all_events_that_are_due_are_sent_as_a_period_is_switched_off() {
    let held = SensorModel { refractory_ns: 1_500_000, contrast_on: 0.5, ..pixel_row(40) };
    let free = SensorModel { refractory_ns: 0, contrast_on: 0.2, ..held.clone() };
    // Two thresholds of .2 below .45, the next at .6: between 2 and 3 ms.
    for run in changed_at_frame_2(&held, &free, &[0.0, 0.45, 0.45, 0.7]) {
        for (who, got) in run {
            let own: Vec<_> = got.iter().filter(|event| event.x == 39).copied().collect();
            let [first, second, third] = signs_and_times(&own)[..] else { panic!("{who}: {own:?}") };
            let change_ns = MILLISECOND_NS + 1;
            assert_eq!([first, second], [(Polarity::On, change_ns); 2], "{who}");
            let expected_ns = 2 * MILLISECOND_NS + MILLISECOND_NS * 3 / 5;
            assert!((third.1 - expected_ns).abs() < 1_000, "{who}: {third:?}");
        }
    }
    assert_silent();
}

/// The end of a hold precedes a shot event of the same nanosecond, so that the event is emitted. A shot event one
/// nanosecond earlier is not.
#[test]
fn a_shot_event_at_the_end_of_a_hold_is_sent() {
    let free =
        SensorModel { synthesis: Synthesis::Linear, shot_noise_rate_hz: 50.0, seed: 5, ..pixel_row(32) };
    // One second of darkness.
    let frames = gray(&free, &[0, 1_000_000_000], |_, _| 0.0);
    for (who, run) in RUNS {
        let all = run(&free, &frames);
        for x in [0, 13, 31] {
            let own: Vec<Event> = all.iter().filter(|event| event.x == x).copied().collect();
            assert!(own.len() > 10, "{who}: pixel {x} has {} events in a second", own.len());
            let apart_ns = (own[1].t_ns - own[0].t_ns) as u32;
            for (refractory_ns, is_sent) in [(apart_ns, true), (apart_ns + 1, false)] {
                let held = run(&SensorModel { refractory_ns, ..free.clone() }, &frames);
                let sent = held.contains(&own[1]);
                assert_eq!(sent, is_sent, "{who}: {:?} in a hold of {refractory_ns} ns", own[1]);
                assert!(held.contains(&own[0]), "{who}: nothing holds the first event");
            }
        }
    }
}

/// A crossing precedes a shot event of the same nanosecond. In the other order it would be lost, because a shot event
/// sets the reference to the light.
#[test]
fn a_crossing_goes_before_a_shot_event_of_the_same_nanosecond() {
    let sensor = SensorModel {
        synthesis: Synthesis::Linear,
        substeps: 2,
        substep_policy: SubstepPolicy::Fixed,
        timestamps: Timestamps::AtSample,
        shot_noise_rate_hz: 50.0,
        // So bright a white level that this light does not change the noise rate.
        white_level: 1e6,
        ..pixel_row(32)
    };
    // Half-way the level has risen by .25. From there to the end it rises by less than .2.
    let rise_until = |end_ns: i64| {
        let half_way = sensor.log_offset * (0.25_f64.exp() - 1.0);
        gray(&sensor, &[0, end_ns], |frame, _| (2.0 * half_way * frame as f64) as f32)
    };
    for (who, run) in RUNS {
        let in_a_second = run(&sensor, &rise_until(1_000_000_000));
        for x in [1, 14, 30] {
            let shot = *in_a_second.iter().find(|event| event.x == x).expect("a shot event in a second");
            // All crossings of the first half are stamped with its end, at which the shot event is due.
            let mut got = run(&sensor, &rise_until(2 * shot.t_ns));
            got.retain(|event| event.x == x && event.t_ns <= shot.t_ns);
            let crossing = Event { polarity: Polarity::On, ..shot };
            let both = got.len() == 2 && got.contains(&crossing) && got.contains(&shot);
            assert!(both, "{who}: {got:?}, expected {crossing:?} and {shot:?}");
        }
    }
}

/// The software driver ends a thread's loops after 65 535 rounds in all.
#[test]
fn a_pixel_sends_tens_of_thousands_of_events_in_an_interval() {
    const EVENTS: usize = 50_000;
    // A whole number of units of Q7.24.
    let threshold = 1.0 / 8192.0;
    let sensor = SensorModel { contrast_on: threshold, contrast_off: threshold, ..pixel_row(3) };
    let rise = threshold * (EVENTS as f64 + 0.5);
    let got = by_engine(&sensor, &levels(&sensor, &[-3.0, -3.0 + rise, -3.0 + rise]));
    for x in 0..3 {
        let of_pixel: Vec<i64> = got.iter().filter(|e| e.x == x).map(|e| e.t_ns).collect();
        assert_eq!(of_pixel.len(), EVENTS, "pixel {x}");
        let (first, last) = (of_pixel[0], of_pixel[EVENTS - 1]);
        assert!(first < 25 && last > MILLISECOND_NS - 25, "pixel {x}: from {first} to {last} ns");
    }
    assert_silent();
}

/// Packets whose events all have one time: as many as one workgroup sorts, one more, and as many as fill several runs.
/// Where the quantum leaves few times, a bin is one time and a range of pixels; otherwise all these events are in one
/// bin.
#[test]
fn flashes_of_as_many_events_as_a_run_has_room_for() {
    for (width, height) in [(89, 23), (64, 32), (683, 3), (64, 64), (128, 64), (241, 17)] {
        for timestamp_quantum_ns in [1_000_000, 1] {
            let sensor = SensorModel { height, timestamp_quantum_ns, ..pixel_row(width) };
            let frames = levels(&sensor, &[0.0, 0.25, 0.25]);
            let steps = engine_with(&sensor, &frames, RigOptions::default());
            let what = format!("{width}x{height}, quantum {timestamp_quantum_ns} ns");
            let flash = &steps[1].packet;
            let t_ns = flash.iter().next().expect("events").t_ns;
            // The threshold is at four fifths of the rise.
            let expected_ns = 800_000 / i64::from(timestamp_quantum_ns) * i64::from(timestamp_quantum_ns);
            assert!((t_ns - expected_ns).abs() <= 2, "{what}: at {t_ns} ns, expected {expected_ns} ns");
            let expected = (0..height as u16)
                .flat_map(|y| (0..width as u16).map(move |x| (y, x)))
                .map(|(y, x)| Event { t_ns, y, x, polarity: Polarity::On });
            assert!(flash.iter().eq(expected), "{what}: {} events", flash.len());
            assert_eq!(steps[2].packet.len(), 0, "{what}: after the flash");
        }
    }
}

/// A pixel's events are numbered within an interval, and the number selects an event's jitter. A tag in the event queue
/// has bits for 256 numbers.
#[test]
fn jitter_goes_by_an_events_number_beyond_the_256th_of_an_interval() {
    let sensor = SensorModel {
        contrast_on: 1e-3,
        contrast_off: 1e-3,
        latency_ns: 2_000_000,
        latency_jitter_ns: 300_000,
        ..pixel_row(40)
    };
    // One pixel has 255, 256, 257 or 400 events and its neighbours have none, so that no event queue is full.
    for crossings in [255, 256, 257, 400] {
        let rise_log = (f64::from(crossings) + 0.5) * sensor.contrast_on;
        let frames = gray(&sensor, &times(0, 3), |frame, pixel| {
            intensity_of(&sensor, if pixel == 17 && frame > 0 { rise_log } else { 0.0 })
        });
        for options in policies() {
            let steps = engine_with(&sensor, &frames, options);
            let found = compare(&sensor, 0, &frames, &steps);
            assert_eq!((found.unexplained, found.late), (vec![], vec![]), "{crossings} events, {options:?}");
            assert_eq!(events(&steps).len(), crossings as usize);
        }
    }
}
