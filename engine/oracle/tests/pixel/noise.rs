//! Leak and shot noise compared with their rates.

use crate::light::{FRAME_NS, frames, sensor, shine};
use esaac_model::packet::Event;
use esaac_model::random::{PixelKey, leak_phase};
use esaac_model::{Polarity, SensorModel};
use esaac_oracle::Oracle;

/// The first pixel of a camera with the seed 0.
const FIRST: PixelKey = PixelKey { seed: 0, camera: 0, pixel: 0 };

fn noisy() -> SensorModel {
    SensorModel {
        shot_noise_rate_hz: 5.0,
        leak_rate_hz: 0.5,
        leak_spread_log: 0.3,
        contrast_mismatch: 0.03,
        seed: 3,
        ..sensor(64)
    }
}

fn assert_same_to_a_nanosecond(a: &[Event], b: &[Event]) {
    let in_pixel_order = |events: &[Event]| {
        let mut events = events.to_vec();
        events.sort_by_key(|e| (e.x, e.t_ns));
        events
    };
    let (a, b) = (in_pixel_order(a), in_pixel_order(b));
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(&b) {
        assert!(a.x == b.x && a.polarity == b.polarity && (a.t_ns - b.t_ns).abs() <= 1, "{a:?} {b:?}");
    }
}

#[test]
fn noise_depends_neither_on_substeps_nor_on_the_frame_rate() {
    let still = |pixel: usize, _: f64| -3.0 + 0.05 * pixel as f64;
    let seconds = 20;
    let reference = shine(&noisy(), (0..=seconds).map(|s| s * 1_000_000_000), still);
    assert!(reference.len() > 2000);
    for (substeps, rate_hz) in [(1, 1), (64, 30), (8, 1000)] {
        let sensor = SensorModel { substeps, ..noisy() };
        let times = (0..=seconds * rate_hz).map(|k| k * 1_000_000_000 / rate_hz);
        assert_same_to_a_nanosecond(&reference, &shine(&sensor, times, still));
    }
}

/// Asserts that a Poisson count lies within five sigma of its mean.
#[track_caller]
fn assert_poisson(count: usize, mean: f64) {
    assert!((count as f64 - mean).abs() < 5.0 * mean.sqrt(), "{count} events, expected {mean}");
}

#[test]
fn shot_noise_has_its_rate_and_falls_with_light() {
    let sensor = SensorModel { shot_noise_rate_hz: 6.25, white_level: 0.5, ..sensor(1000) };
    for (level, factor) in [(0.0, 1.0), (0.25, 0.625), (0.5, 0.25), (5.0, 0.25)] {
        let events = shine(&sensor, frames(300), |_, _| (level + sensor.log_offset).ln());
        let mean = 1000.0 * 300.0 * FRAME_NS as f64 * 1e-9 * 6.25 / 2.0 * factor;
        for polarity in [Polarity::On, Polarity::Off] {
            assert_poisson(events.iter().filter(|e| e.polarity == polarity).count(), mean);
        }
    }
}

#[test]
fn shot_noise_waits_are_exponential() {
    let sensor = SensorModel { shot_noise_rate_hz: 50.0, ..sensor(500) };
    let events = shine(&sensor, frames(120), |_, _| sensor.log_offset.ln());
    let mut waits = Vec::new();
    for x in 0..500 {
        let times: Vec<i64> =
            events.iter().filter(|e| e.x == x && e.polarity == Polarity::On).map(|e| e.t_ns).collect();
        waits.extend(times.first().map(|t| *t as f64 * 25e-9));
        waits.extend(times.windows(2).map(|w| (w[1] - w[0]) as f64 * 25e-9));
    }
    // Tests the distribution at one mean wait, so short that the end of the run cuts off few waits:
    // P(wait < 1) = 1 - 1/e.
    let short = waits.iter().filter(|w| **w < 1.0).count() as f64 / waits.len() as f64;
    assert!((short - (1.0 - (-1.0_f64).exp())).abs() < 0.01, "{short}");
}

#[test]
fn a_pixel_with_a_low_threshold_is_noisier() {
    let sensor = SensorModel { shot_noise_rate_hz: 20.0, contrast_mismatch: 0.1, seed: 5, ..sensor(400) };
    let events = shine(&sensor, frames(300), |_, _| sensor.log_offset.ln());
    let oracle = Oracle::new(sensor, 0).unwrap();
    let seconds = 300.0 * FRAME_NS as f64 * 1e-9;
    let mean: f64 = oracle.constants().iter().map(|c| 10.0 * seconds * 0.2 / c.threshold_log[1]).sum();
    assert_poisson(events.iter().filter(|e| e.polarity == Polarity::On).count(), mean);
}

#[test]
fn shot_noise_resets_the_reference() {
    let sensor = SensorModel { shot_noise_rate_hz: 30.0, substeps: 1, ..sensor(300) };
    // The light rises by 0.9 thresholds in all, so that it crosses nothing by itself. A shot event sets the reference
    // to the light of its instant, from which the rest of the rise is less than a threshold too.
    let rise = |_: usize, t_ns: f64| (0.01_f64).ln() + 0.18 * t_ns / (30 * FRAME_NS) as f64;
    let with = shine(&sensor, frames(30), rise);
    let still = shine(&sensor, frames(30), |_, _| (0.01_f64).ln());
    let ratio = with.len() as f64 / still.len() as f64;
    assert!((ratio - 1.0).abs() < 0.01, "only the noise's fall with light may differ: {ratio}");
}

#[test]
fn leak_is_exact_after_a_day() {
    let sensor = SensorModel { leak_rate_hz: 0.1, substeps: 2, ..sensor(1) };
    let events = shine(&sensor, (0..=86_400).map(|s| s * 1_000_000_000), |_, _| 0.3);
    let expected: Vec<f64> = (1..=8640).map(|j| (f64::from(j) - leak_phase(FIRST, 0)) * 10e9).collect();
    crate::light::assert_times(&events, &expected, 1.0);
}

#[test]
fn leak_shifts_crossings_by_its_ramp() {
    let sensor = SensorModel { leak_rate_hz: 100.0, substeps: 3, ..sensor(1) };
    // The log intensity falls by 10 per second and the leak adds 20: the sum rises by 10 per second.
    let events = shine(&sensor, frames(3), |_, t_ns| 2.0 - 10e-9 * t_ns);
    let expected: Vec<f64> = (1..=5).map(|j| (f64::from(j) - leak_phase(FIRST, 0)) * 0.02e9).collect();
    crate::light::assert_times(&events, &expected, 1.0 + 1e-3);
    assert!(events.iter().all(|e| e.polarity == Polarity::On));
}

#[test]
fn a_changed_leak_does_not_move_the_reference() {
    let sensor = SensorModel { leak_rate_hz: 0.1, substeps: 1, ..sensor(1) };
    let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
    let step = |oracle: &mut Oracle, s: i64| {
        oracle
            .step_samples(s * 1_000_000_000, &|_, _| 1.0)
            .unwrap()
            .packet
            .iter()
            .map(|e| e.t_ns)
            .collect::<Vec<_>>()
    };
    let first_s = (1.0 - leak_phase(FIRST, 0)) * 10.0;
    let whole_s = first_s.ceil() as i64 + 4;
    let before: Vec<i64> = (0..=whole_s).flat_map(|s| step(&mut oracle, s)).collect();
    assert_eq!(before.len(), 1, "{before:?}");
    // What is left of a threshold takes a tenth of its time at ten times the rate.
    oracle.set_sensor(SensorModel { leak_rate_hz: 1.0, ..sensor }).unwrap();
    let expected_ns = (whole_s as f64 + 0.1 * (first_s + 10.0 - whole_s as f64)) * 1e9;
    let times = step(&mut oracle, whole_s + 1);
    assert!(times.len() == 1 && (times[0] as f64 - expected_ns).abs() <= 1.0, "{times:?}");
}

/// Pixels are armed as if they had looked at still light for long: there are as many leak events in the first seconds as later,
/// also where shots come between.
#[test]
fn leak_has_its_rate_from_the_first_frame() {
    for (leak_rate_hz, shot_noise_rate_hz) in [(0.1, 0.0), (0.1, 0.02), (0.1, 0.1), (0.5, 3.0)] {
        let sensor = SensorModel {
            leak_rate_hz,
            shot_noise_rate_hz,
            leak_spread_log: 0.1,
            contrast_mismatch: 0.02,
            ..sensor(16_000)
        };
        let events = shine(&sensor, (0..=24).map(|s| s * 1_000_000_000), |_, _| sensor.log_offset.ln());
        let mut on = [0.0_f64; 24];
        for event in events.iter().filter(|event| event.polarity == Polarity::On) {
            on[((event.t_ns - 1) / 1_000_000_000) as usize] += 1.0;
        }
        println!("leak {leak_rate_hz} Hz, shots {shot_noise_rate_hz} Hz: {on:?}");
        let [first, last] = [&on[..3], &on[12..]].map(|part| part.iter().sum::<f64>() / part.len() as f64);
        assert!((first / last - 1.0).abs() < 0.1, "{on:?}");
    }
}
