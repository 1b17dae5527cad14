//! The comparison that the suites rely on finds the faults of known-bad streams.

use esaac_model::packet::Event;
use esaac_model::substeps::substep_end_ns;
use esaac_model::{HdrFormat, MotionFormat, Polarity, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use esaac_scene::SceneKind;
use esaac_tests::agreement::{Agreement, LEVEL_TOLERANCE_LOG, compare_streams};
use esaac_tests::frames::{Sequence, gray, intensity_of, scene, times};
use esaac_tests::run::{oracle, oracle_events};

const SIZE: (u32, u32) = (33, 21);

fn sensor() -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis: Synthesis::Linear,
        refractory_ns: 1000,
        ..SensorModel::default()
    }
}

fn frames() -> Sequence {
    scene(SceneKind::Lamp, SIZE, &times(0, 8), HdrFormat::F32x4, MotionFormat::F32x2)
}

/// Compares the oracle's events with the same events after `spoil` has changed them.
fn against(spoil: impl FnOnce(&mut Vec<Event>)) -> Agreement {
    let (sensor, frames) = (sensor(), frames());
    let intervals = oracle(&sensor, 0, &frames);
    let mut events = oracle_events(&intervals);
    assert!(events.len() > 1000);
    spoil(&mut events);
    compare_streams(&sensor, 0, &frames, &intervals, &events)
}

/// One pixel that passes through these levels, nepers, with straight lines between.
fn through(sensor: &SensorModel, levels_log: &[f64]) -> Sequence {
    gray(sensor, &times(0, levels_log.len()), |frame, _| intensity_of(sensor, levels_log[frame]))
}

fn one_pixel() -> SensorModel {
    SensorModel { width: 1, height: 1, synthesis: Synthesis::None, ..SensorModel::default() }
}

#[test]
fn a_stream_agrees_with_itself() {
    let got = against(|_| ());
    assert_eq!((got.differing, got.late.len(), got.prompt_share()), (0, 0, 1.0));
    assert_eq!(got.pixels, 33 * 21);
}

#[test]
fn one_event_that_is_missing_doubled_or_flipped_is_not_explained() {
    let missing = against(|events| {
        events.remove(500);
    });
    let doubled = against(|events| events.push(events[500]));
    let flipped = against(|events| {
        let event = &mut events[500];
        event.polarity = if event.polarity == Polarity::On { Polarity::Off } else { Polarity::On };
    });
    for got in [missing, doubled, flipped] {
        assert_eq!((got.differing, got.unexplained.len()), (1, 1), "{got:?}");
    }
}

#[test]
fn an_event_at_the_neighbour_is_not_explained() {
    let got = against(|events| events[500].x = (events[500].x + 1) % 33);
    assert_eq!((got.differing, got.unexplained.len()), (2, 2), "{got:?}");
}

#[test]
fn one_late_event_is_found() {
    // The lamp rises by some nepers in an interval. On that slope the tolerance is some microseconds.
    let got = against(|events| events[500].t_ns += 60_000);
    assert_eq!((got.differing, got.late.len()), (0, 1), "{got:?}");
    assert!(got.prompt_share() < 1.0);
}

#[test]
fn a_tie_is_explained_and_a_miss_is_not() {
    let rise = |beyond: f64| {
        let sensor = one_pixel();
        let frames = through(&sensor, &[0.0, sensor.contrast_on + beyond]);
        let intervals = oracle(&sensor, 0, &frames);
        assert_eq!(oracle_events(&intervals).len(), 1);
        compare_streams(&sensor, 0, &frames, &intervals, &[])
    };
    let tie = rise(0.5 * LEVEL_TOLERANCE_LOG);
    assert_eq!((tie.differing, tie.unexplained.len()), (1, 0));
    let miss = rise(2.0 * LEVEL_TOLERANCE_LOG);
    assert_eq!((miss.differing, miss.unexplained.len()), (1, 1));
}

#[test]
fn a_tie_may_move_an_event_to_the_next_crossing() {
    // The level comes to the threshold, goes back, and comes again.
    let peaks = |beyond: f64| {
        let sensor = one_pixel();
        let on = sensor.contrast_on;
        let frames = through(&sensor, &[0.0, on + beyond, 0.5 * on, 1.2 * on]);
        let intervals = oracle(&sensor, 0, &frames);
        let mut events = oracle_events(&intervals);
        assert_eq!(events.len(), 1);
        let (start_ns, end_ns) = (frames.frames[2].t_ns, frames.frames[3].t_ns);
        events[0].t_ns = start_ns + (end_ns - start_ns) * 5 / 7;
        compare_streams(&sensor, 0, &frames, &intervals, &events)
    };
    let tie = peaks(0.5 * LEVEL_TOLERANCE_LOG);
    assert_eq!((tie.differing, tie.late.len()), (1, 0), "{tie:?}");
    let miss = peaks(2.0 * LEVEL_TOLERANCE_LOG);
    assert_eq!((miss.differing, miss.late.len()), (0, 1), "{miss:?}");
}

#[test]
fn a_tie_is_explained_after_hundreds_of_events() {
    // 200 events OFF and 300 ON. Thresholds that are moved by the whole tolerance move the reference by a millineper and more
    // meanwhile. The levels that follow pass a threshold, and do not come to another, by half of that. The last is the tie.
    let after = |beyond: f64| {
        let contrast = 1.0 / 32.0;
        let sensor = SensorModel { contrast_on: contrast, contrast_off: contrast, ..one_pixel() };
        let level = |thresholds: f64, beyond_log: f64| 3.0 + thresholds * contrast + beyond_log;
        let frames = through(
            &sensor,
            &[
                level(0.0, 0.0),
                level(-200.5, 0.0),
                level(100.5, 0.0),
                level(101.0, 5e-4),
                level(99.5, 0.0),
                level(101.0, -5e-4),
                level(99.5, 0.0),
                level(99.0, -beyond),
            ],
        );
        let intervals = oracle(&sensor, 0, &frames);
        let mut events = oracle_events(&intervals);
        assert_eq!(events.len(), 503);
        events.pop();
        compare_streams(&sensor, 0, &frames, &intervals, &events)
    };
    let tie = after(0.2 * LEVEL_TOLERANCE_LOG);
    assert_eq!((tie.differing, tie.unexplained.len()), (1, 0), "{tie:?}");
    let miss = after(80.0 * LEVEL_TOLERANCE_LOG);
    assert_eq!((miss.differing, miss.unexplained.len()), (1, 1), "{miss:?}");
}

#[test]
fn a_tie_at_a_sample_is_explained_and_another_sample_is_not() {
    // The level at the end of the second of four sub-steps is `beyond` the threshold.
    let rise = |beyond: f64| {
        let sensor = SensorModel {
            synthesis: Synthesis::Linear,
            substeps: 4,
            substep_policy: SubstepPolicy::Fixed,
            timestamps: Timestamps::AtSample,
            ..one_pixel()
        };
        let light = |log: f64| intensity_of(&sensor, log);
        let half = light(sensor.contrast_on + beyond);
        let frames =
            gray(
                &sensor,
                &times(0, 2),
                |frame, _| if frame == 0 { light(0.0) } else { 2.0 * half - light(0.0) },
            );
        let intervals = oracle(&sensor, 0, &frames);
        let mut events = oracle_events(&intervals);
        assert_eq!((events.len(), events[0].t_ns), (1, frames.frames[1].t_ns / 2));
        events[0].t_ns = i64::from(substep_end_ns(frames.frames[1].t_ns as u32, 3, 4));
        compare_streams(&sensor, 0, &frames, &intervals, &events)
    };
    let tie = rise(0.5 * LEVEL_TOLERANCE_LOG);
    assert_eq!((tie.differing, tie.late.len()), (1, 0), "{tie:?}");
    let miss = rise(2.0 * LEVEL_TOLERANCE_LOG);
    assert_eq!((miss.differing, miss.late.len()), (0, 1), "{miss:?}");
}
