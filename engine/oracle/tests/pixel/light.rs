//! Light that tests shine on a sensor, and the events that follow.

use esaac_model::packet::Event;
use esaac_model::{SensorModel, SubstepPolicy, Synthesis};
use esaac_oracle::Oracle;

/// Length of an interval at 30 Hz, nanoseconds.
pub const FRAME_NS: i64 = 33_333_333;

/// A clean sensor of one row, whose intensity is exactly the given one.
pub fn sensor(width: u32) -> SensorModel {
    SensorModel {
        width,
        height: 1,
        synthesis: Synthesis::Linear,
        substep_policy: SubstepPolicy::Fixed,
        ..SensorModel::default()
    }
}

/// Intensity at which the log intensity is `log`.
pub fn intensity(sensor: &SensorModel, log: f64) -> f64 {
    log.exp() - sensor.log_offset
}

/// Steps `oracle` to each of `times_ns`. `log` is the log intensity of a pixel at a time in nanoseconds.
pub fn shine_on(
    oracle: &mut Oracle,
    times_ns: impl IntoIterator<Item = i64>,
    log: impl Fn(usize, f64) -> f64,
) -> Vec<Event> {
    let sensor = oracle.sensor().clone();
    let mut events = Vec::new();
    let mut previous_ns = None;
    for t_ns in times_ns {
        let start_ns = previous_ns.unwrap_or(t_ns) as f64;
        let sample =
            |pixel: usize, from_start_ns: f64| intensity(&sensor, log(pixel, start_ns + from_start_ns));
        let packet = oracle.step_samples(t_ns, &sample).expect("times ascend").packet;
        assert!(packet.is_sorted());
        events.extend(packet.iter());
        previous_ns = Some(t_ns);
    }
    events
}

/// As [`shine_on`], with a new camera.
pub fn shine(
    sensor: &SensorModel,
    times_ns: impl IntoIterator<Item = i64>,
    log: impl Fn(usize, f64) -> f64,
) -> Vec<Event> {
    let mut oracle = Oracle::new(sensor.clone(), 0).expect("a valid sensor");
    shine_on(&mut oracle, times_ns, log)
}

/// Frame times at 30 Hz: `0..=frames`.
pub fn frames(frames: i64) -> impl Iterator<Item = i64> {
    (0..=frames).map(|k| k * FRAME_NS)
}

/// Polarities as a string of `+` and `-`.
pub fn polarities(events: &[Event]) -> String {
    events.iter().map(|e| if e.polarity.sign() > 0 { '+' } else { '-' }).collect()
}

/// Asserts that the events have the expected times, to within `tolerance_ns`.
#[track_caller]
pub fn assert_times(events: &[Event], expected_ns: &[f64], tolerance_ns: f64) {
    let times: Vec<i64> = events.iter().map(|e| e.t_ns).collect();
    assert_eq!(events.len(), expected_ns.len(), "{times:?} against {expected_ns:?}");
    for (event, expected) in events.iter().zip(expected_ns) {
        assert!((event.t_ns as f64 - expected).abs() <= tolerance_ns, "{times:?} against {expected_ns:?}");
    }
}
