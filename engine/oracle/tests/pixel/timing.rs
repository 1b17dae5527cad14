//! Refractory period, latency, quantisation and packets.

use crate::light::{FRAME_NS, assert_times, frames, intensity, polarities, sensor, shine, shine_on};
use esaac_model::{SensorModel, Timestamps};
use esaac_oracle::Oracle;

/// Log intensity that rises by ten thresholds per frame.
fn ramp(_: usize, t_ns: f64) -> f64 {
    2.0 * t_ns / FRAME_NS as f64
}

const TENTH_NS: f64 = FRAME_NS as f64 / 10.0;

#[test]
fn a_held_pixel_starts_anew_from_the_light_of_its_release() {
    // Without a hold there is an event every tenth of a frame. A hold of 2.5 tenths makes that one every 3.5 tenths.
    let sensor = SensorModel { refractory_ns: (2.5 * TENTH_NS) as u32, ..sensor(1) };
    let events = shine(&sensor, frames(3), ramp);
    let expected: Vec<f64> = (0..9).map(|j| (1.0 + 3.5 * f64::from(j)) * TENTH_NS).collect();
    assert_times(&events, &expected, 20.0);
}

#[test]
fn a_hold_straddles_intervals() {
    let sensor = SensorModel { refractory_ns: 5 * FRAME_NS as u32 / 2, ..sensor(1) };
    let events = shine(&sensor, frames(6), ramp);
    assert_times(&events, &[1.0, 27.0, 53.0].map(|tenths| tenths * TENTH_NS), 4.0);
}

#[test]
fn noise_within_a_hold_is_suppressed_and_its_draw_spent() {
    let free = SensorModel { shot_noise_rate_hz: 50.0, ..sensor(50) };
    let held = SensorModel { refractory_ns: 5_000_000, ..free.clone() };
    let still = |_: usize, _: f64| -4.0;
    let (free, held) = (shine(&free, frames(60), still), shine(&held, frames(60), still));
    for x in 0..50 {
        let mut until_ns = i64::MIN;
        let expected = free.iter().filter(|e| e.x == x).filter(|e| {
            let passes = e.t_ns >= until_ns;
            if passes {
                until_ns = e.t_ns + 5_000_000;
            }
            passes
        });
        assert!(held.iter().filter(|e| e.x == x).eq(expected), "pixel {x}");
    }
    assert!(held.len() < free.len());
}

#[test]
fn at_sample_stamps_the_ends_of_substeps() {
    let sensor = SensorModel { substeps: 4, timestamps: Timestamps::AtSample, ..sensor(1) };
    let events = shine(&sensor, frames(1), ramp);
    let ends = [1, 1, 2, 2, 3, 3, 3, 4, 4, 4].map(|i| (FRAME_NS * i / 4) as f64);
    assert_times(&events, &ends, 0.0);
    let held = SensorModel { refractory_ns: 1, ..sensor };
    assert_times(&shine(&held, frames(1), ramp), &[1, 2, 3, 4].map(|i| (FRAME_NS * i / 4) as f64), 0.0);
}

#[test]
fn latency_carries_events_to_the_packet_of_their_stamp() {
    let late = SensorModel { latency_ns: 50_000_000, latency_jitter_ns: 1_000_000, ..sensor(20) };
    let light = |pixel: usize, t_ns: f64| (t_ns * 4e-8 + pixel as f64).sin();
    let undelayed = shine(&sensor(20), frames(10), light);
    let mut oracle = Oracle::new(late.clone(), 0).unwrap();
    let mut delayed = Vec::new();
    let mut watermark_ns = i64::MIN;
    for k in 0..=13 {
        let start_ns = ((k - 1).max(0) * FRAME_NS) as f64;
        let sample = |pixel: usize, from_ns: f64| {
            intensity(&late, light(pixel, (start_ns + from_ns).min((10 * FRAME_NS) as f64)))
        };
        let packet = oracle.step_samples(k * FRAME_NS, &sample).unwrap().packet;
        assert_eq!((packet.sequence, packet.watermark_ns), (k as u64, k * FRAME_NS));
        assert!(packet.iter().all(|e| e.t_ns > watermark_ns && e.t_ns <= packet.watermark_ns));
        watermark_ns = packet.watermark_ns;
        delayed.extend(packet.iter());
    }
    assert_eq!(delayed.len(), undelayed.len());
    let mean_ns: f64 = delayed.iter().map(|e| e.t_ns as f64).sum::<f64>() / delayed.len() as f64
        - undelayed.iter().map(|e| e.t_ns as f64).sum::<f64>() / undelayed.len() as f64;
    assert!((mean_ns - 50e6).abs() < 1e5, "{mean_ns}");
}

#[test]
fn quantised_stamps_never_decrease_and_respect_the_watermark() {
    for timestamp_quantum_ns in [1000, 40_000_000] {
        let sensor = SensorModel { timestamp_quantum_ns, ..sensor(20) };
        let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
        let (mut latest_ns, mut watermark_ns) = (i64::MIN, i64::MIN);
        let mut events = Vec::new();
        for k in 0..=10 {
            let start_ns = ((k - 1).max(0) * FRAME_NS) as f64;
            let sample =
                |pixel: usize, from_ns: f64| 2.0 + ((start_ns + from_ns) * 4e-8 + pixel as f64).sin();
            let packet = oracle.step_samples(k * FRAME_NS, &sample).unwrap().packet;
            for event in packet.iter() {
                assert_eq!(event.t_ns % i64::from(timestamp_quantum_ns), 0);
                assert!(event.t_ns >= latest_ns && event.t_ns > watermark_ns);
                latest_ns = event.t_ns;
            }
            watermark_ns = packet.watermark_ns;
            events.extend(packet.iter());
        }
        assert!(events.len() > 300);
    }
}

#[test]
fn an_interval_shorter_than_its_substeps_are_many_loses_nothing() {
    let sensor = SensorModel { substeps: 64, ..sensor(1) };
    for interval_ns in [1, 3, 63] {
        let events = shine(&sensor, [0, interval_ns], |_, t_ns| -t_ns / interval_ns as f64);
        assert_eq!(polarities(&events), "-----", "{interval_ns} ns");
        assert!(events.iter().all(|e| (1..=interval_ns).contains(&e.t_ns)));
    }
}

#[test]
fn a_reset_camera_forgets() {
    let mut oracle = Oracle::new(SensorModel { seed: 4, shot_noise_rate_hz: 50.0, ..sensor(4) }, 0).unwrap();
    let first = shine_on(&mut oracle, frames(5), ramp);
    oracle.reset();
    assert_eq!(first, shine_on(&mut oracle, frames(5), ramp));
}

#[test]
fn convergence_is_of_second_order() {
    const AMPLITUDE: f64 = 0.95;
    const HALF_PERIOD_US: f64 = 1e6 / 120.0;
    let light = |_: usize, t_ns: f64| AMPLITUDE * (std::f64::consts::PI * t_ns * 1e-3 / HALF_PERIOD_US).sin();
    let end_us = 4.0 * FRAME_NS as f64 * 1e-3;
    // Between neighbouring extrema the light is monotonic. Its zero between them is at `half` half periods.
    let mut exact_us = Vec::new();
    let mut reference = 0_i32;
    for half in 0..17 {
        let sign = if half % 2 == 0 { 1 } else { -1 };
        while (reference + sign).abs() <= 4 {
            reference += sign;
            let from_zero = (f64::from(sign * reference) * 0.2 / AMPLITUDE).asin() / std::f64::consts::PI;
            exact_us.push((f64::from(half) + from_zero) * HALF_PERIOD_US);
        }
    }
    exact_us.retain(|t_us| *t_us <= end_us);
    let mean_error_us = |substeps| {
        let events = shine(&SensorModel { substeps, ..sensor(1) }, frames(4), light);
        assert_eq!(events.len(), exact_us.len(), "N = {substeps}");
        let errors = events.iter().zip(&exact_us).map(|(e, t_us)| (e.t_ns as f64 * 1e-3 - t_us).abs());
        errors.sum::<f64>() / exact_us.len() as f64
    };
    let (coarse, fine) = (mean_error_us(32), mean_error_us(64));
    assert!(coarse / fine > 3.0 && fine < 10.0, "{coarse} us, {fine} us");
}
