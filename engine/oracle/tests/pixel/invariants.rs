//! Properties that must hold under any light.

use crate::light::{FRAME_NS, frames, sensor, shine, shine_on};
use esaac_model::packet::Event;
use esaac_model::{Polarity, SensorModel, Timestamps};
use esaac_oracle::Oracle;

/// Band-limited light that differs from pixel to pixel, swinging over four nepers.
fn waves(pixel: usize, t_ns: f64) -> f64 {
    let (t, phase) = (t_ns * 1e-9, pixel as f64);
    1.3 * (11.0 * t + phase).sin()
        + 0.7 * (47.0 * t + 2.0 * phase).sin()
        + 0.1 * (333.0 * t + 3.0 * phase).sin()
}

fn flipped(events: &[Event]) -> Vec<Event> {
    let flip = |p| if p == Polarity::On { Polarity::Off } else { Polarity::On };
    events.iter().map(|e| Event { polarity: flip(e.polarity), ..*e }).collect()
}

fn by_pixel(events: &[Event], x: u16) -> Vec<Event> {
    events.iter().filter(|e| e.x == x).copied().collect()
}

#[test]
fn integrated_events_stay_within_one_threshold_of_the_light() {
    let sensor = SensorModel { contrast_on: 0.17, contrast_off: 0.23, substeps: 16, ..sensor(8) };
    let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
    let mut level: Vec<f64> = (0..8).map(|pixel| waves(pixel, 0.0)).collect();
    let mut previous_ns = 0;
    shine_on(&mut oracle, [0], waves);
    for t_ns in frames(60).skip(1) {
        // The light is a function of absolute time; the oracle asks for it from the interval's start.
        let start_ns = previous_ns as f64;
        let sample = |pixel: usize, from_ns: f64| waves(pixel, start_ns + from_ns).exp() - sensor.log_offset;
        for event in oracle.step_samples(t_ns, &sample).unwrap().packet.iter() {
            let threshold = if event.polarity == Polarity::On { 0.17 } else { -0.23 };
            level[usize::from(event.x)] += threshold;
        }
        for (pixel, level) in level.iter().enumerate() {
            let distance = waves(pixel, t_ns as f64) - level;
            assert!((-0.23..0.17).contains(&distance), "pixel {pixel} at {t_ns} ns: {distance}");
        }
        previous_ns = t_ns;
    }
}

#[test]
fn negated_light_with_swapped_thresholds_swaps_polarities() {
    for (refractory_ns, timestamps) in
        [(0, Timestamps::Interpolated), (1_000_000, Timestamps::Interpolated), (0, Timestamps::AtSample)]
    {
        let base =
            SensorModel { refractory_ns, timestamps, contrast_on: 0.15, contrast_off: 0.25, ..sensor(6) };
        let swapped = SensorModel { contrast_on: 0.25, contrast_off: 0.15, ..base.clone() };
        let events = shine(&base, frames(40), waves);
        let negated = flipped(&shine(&swapped, frames(40), |pixel, t_ns| -waves(pixel, t_ns)));
        assert!(events.len() > 500);
        for x in 0..6 {
            let (a, b) = (by_pixel(&events, x), by_pixel(&negated, x));
            assert_eq!(a.len(), b.len());
            for (a, b) in a.iter().zip(&b) {
                assert!(a.polarity == b.polarity && (a.t_ns - b.t_ns).abs() <= 1, "{a:?} {b:?}");
            }
        }
    }
}

#[test]
fn a_still_scene_is_silent() {
    let sensor = SensorModel { substeps: 4, ..sensor(5) };
    // One hour of frames at the longest interval.
    let events = shine(&sensor, (0..=3600).map(|s| s * 1_000_000_000), |pixel, _| pixel as f64 - 4.0);
    assert!(events.is_empty());
}

#[test]
fn a_reference_does_not_drift_in_a_million_events() {
    let sensor = SensorModel { contrast_on: 0.01, contrast_off: 0.01, substeps: 64, ..sensor(1) };
    // A triangle of 32 periods a second between -2 and 2: 400 thresholds up, 400 down.
    let triangle = |_: usize, t_ns: f64| {
        let phase = (t_ns * 32e-9).rem_euclid(1.0);
        -2.0 + 8.0 * phase.min(1.0 - phase)
    };
    let mut oracle = Oracle::new(sensor, 0).unwrap();
    let events = shine_on(&mut oracle, (0..=40).map(|s| s * 1_000_000_000), triangle);
    assert!(events.len() > 1_000_000, "{}", events.len());
    let reference = oracle.pixel(0).unwrap().reference.value();
    let sum: i64 = events.iter().map(|e| i64::from(e.polarity.sign())).sum();
    let drift = reference - (-2.0 + 0.01 * sum as f64);
    assert!(drift.abs() < 0.01 * 0.01, "{drift}");
    assert!(drift.abs() < 1e-9, "{drift}: far below what is asked");
}

#[test]
fn a_run_stopped_and_resumed_is_one_run() {
    let sensor = SensorModel {
        refractory_ns: 500_000,
        shot_noise_rate_hz: 50.0,
        leak_rate_hz: 2.0,
        leak_spread_log: 0.2,
        contrast_mismatch: 0.05,
        latency_ns: 100_000,
        latency_jitter_ns: 10_000,
        timestamp_quantum_ns: 1000,
        ..sensor(6)
    };
    let whole = shine(&sensor, frames(20), waves);
    let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
    let mut resumed = shine_on(&mut oracle, frames(10), waves);
    let mut copy = oracle.clone();
    drop(oracle);
    for k in 11..=20 {
        let start_ns = ((k - 1) * FRAME_NS) as f64;
        let sample = |pixel: usize, from_ns: f64| waves(pixel, start_ns + from_ns).exp() - sensor.log_offset;
        resumed.extend(copy.step_samples(k * FRAME_NS, &sample).unwrap().packet.iter());
    }
    assert_eq!(whole, resumed);
}

#[test]
fn the_cap_keeps_the_earliest_events() {
    let whole = shine(&sensor(6), frames(1), waves);
    let capped_sensor = SensorModel { max_events_per_interval: 10, ..sensor(6) };
    let mut oracle = Oracle::new(capped_sensor, 0).unwrap();
    assert_eq!(shine_on(&mut oracle, frames(1), waves), whole[..10]);
}

#[test]
fn a_changed_threshold_acts_within_a_nanosecond_of_the_next_interval() {
    let mut oracle = Oracle::new(sensor(1), 0).unwrap();
    let light = |_: usize, from_ns: f64| if from_ns > 0.0 { 1.19 } else { 1.0 };
    oracle.step_samples(0, &|_, _| 1.0).unwrap();
    assert!(oracle.step_samples(FRAME_NS, &light).unwrap().packet.is_empty());
    oracle.set_sensor(SensorModel { contrast_on: 0.1, ..sensor(1) }).unwrap();
    let packet = oracle.step_samples(2 * FRAME_NS, &|_, _| 1.19).unwrap().packet;
    assert_eq!(packet.iter().map(|e| e.t_ns).collect::<Vec<_>>(), [FRAME_NS + 1]);
    let resized = SensorModel { width: 2, ..sensor(1) };
    assert!(oracle.set_sensor(resized).is_err());
}
