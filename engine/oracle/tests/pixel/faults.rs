//! Faults found in other simulators. Each test is named after the right behaviour; its comment describes the fault.

use crate::light::{FRAME_NS, assert_times, frames, intensity, polarities, sensor, shine};
use esaac_model::random::{PixelKey, Stream, leak_phase, threshold_log};
use esaac_model::{SensorModel, Synthesis};
use esaac_oracle::{Oracle, truth};

/// Fault: a level that touches a threshold exactly stops all events of that polarity.
#[test]
fn touching_a_threshold_is_crossing_it() {
    for base in [0.0, -4.0, 1.3] {
        let sensor = SensorModel { substeps: 1, ..sensor(1) };
        let events = shine(&sensor, frames(4), |_, t_ns| {
            base + 0.2 * ((t_ns / FRAME_NS as f64).round() as i64 % 2) as f64
        });
        assert_eq!(polarities(&events), "+-+-", "around {base}");
        assert_times(&events, &[1.0, 2.0, 3.0, 4.0].map(|k| k * FRAME_NS as f64), 1.0);
    }
}

/// Fault: in a still scene the leak gives no events.
#[test]
fn leak_of_a_still_scene_gives_its_events() {
    let sensor = SensorModel { leak_rate_hz: 1.0, ..sensor(1) };
    let events = shine(&sensor, frames(300), |_, _| -1.0);
    assert_eq!(polarities(&events), "++++++++++");
    let phase = leak_phase(PixelKey { seed: 0, camera: 0, pixel: 0 }, 0);
    assert!(phase > 0.1, "the pixel has leaked before: {phase}");
    assert_times(&events, &std::array::from_fn::<_, 10, _>(|k| (k as f64 + 1.0 - phase) * 1e9), 1.0);
}

/// Fault: a small leak is lost where frames are close together.
#[test]
fn leak_does_not_vanish_at_ten_microseconds_a_frame() {
    let sensor = SensorModel { leak_rate_hz: 0.1, substeps: 32, ..sensor(1) };
    let events = shine(&sensor, (0..=1_000_000).map(|k| k * 10_000), |_, _| 0.5);
    let phase = leak_phase(PixelKey { seed: 0, camera: 0, pixel: 0 }, 0);
    assert_times(&events, &[(1.0 - phase) * 10e9], 1.0);
}

/// Fault: thresholds are drawn again at each frame, which loses most events of a slow ramp.
#[test]
fn thresholds_are_drawn_once() {
    let sensor = SensorModel { contrast_mismatch: 0.06, substeps: 4, seed: 9, ..sensor(200) };
    let rise = 3.0;
    let events = shine(&sensor, frames(300), |_, t_ns| -2.0 + rise * t_ns / (300 * FRAME_NS) as f64);
    for pixel in 0..200 {
        let key = PixelKey { seed: 9, camera: 0, pixel };
        let threshold = threshold_log(key, Stream::ContrastOn, 0.2, 0.06);
        assert!(threshold > 0.0);
        let count = events.iter().filter(|e| u32::from(e.x) == pixel).count();
        assert_eq!(count, (rise / threshold).floor() as usize, "pixel {pixel}, threshold {threshold}");
    }
}

/// Fault: times are interpolated over the distance to the reference in place of the change within the step.
#[test]
fn crossings_of_a_ramp_have_their_closed_form_times() {
    let sensor = SensorModel { substeps: 8, ..sensor(1) };
    let slope_per_s = 37.0;
    let events = shine(&sensor, frames(2), |_, t_ns| -3.0 + slope_per_s * t_ns * 1e-9);
    let count = (slope_per_s * 2.0 * FRAME_NS as f64 * 1e-9 / 0.2).floor() as usize;
    let expected: Vec<f64> = (1..=count).map(|j| 0.2 * j as f64 / slope_per_s * 1e9).collect();
    // Interpolated times are rounded up to whole nanoseconds.
    assert_times(&events, &expected, 1.0 + 1e-3);
}

/// Faults: the first interval starts at time zero instead of the clip's first frame; times are single-precision
/// seconds.
#[test]
fn first_interval_and_late_times_are_as_exact_as_any() {
    let sensor = SensorModel { substeps: 8, ..sensor(1) };
    for start_ns in [0, 20_000_000_000, -5_000_000_000, 1_763_000_000_000_000_000] {
        // f64 cannot hold the nanoseconds of present-day clocks exactly, so the light counts from the clip's start.
        let mut oracle = Oracle::new(sensor.clone(), 0).unwrap();
        let mut events = Vec::new();
        for k in 0..3_i64 {
            let from_ns = ((k - 1).max(0) * FRAME_NS) as f64;
            let light = |_: usize, t_ns: f64| intensity(&sensor, (from_ns + t_ns) * 1.5e-8);
            events.extend(oracle.step_samples(start_ns + k * FRAME_NS, &light).unwrap().packet.iter());
        }
        let expected: Vec<f64> = (1..=4).map(|j| 0.2 * f64::from(j) / 1.5e-8).collect();
        let relative: Vec<_> =
            events.iter().map(|e| esaac_model::packet::Event { t_ns: e.t_ns - start_ns, ..*e }).collect();
        assert_times(&relative, &expected, 1.0 + 1e-3);
    }
}

/// Fault: with a refractory period longer than the gap between frames, the events of one step are spread over the time
/// after it.
#[test]
fn a_step_within_a_long_refractory_period_is_one_event() {
    let sensor = SensorModel { refractory_ns: 80_000_000, substeps: 4, ..sensor(1) };
    let step = |t_ns: f64| if t_ns > 10e6 { 1.0 } else { 0.0 };
    let events = shine(&sensor, frames(9), |_, t_ns| step(t_ns));
    assert_eq!(polarities(&events), "+");
    // Four sub-steps of 8.33 ms. The change lies in the second and is five thresholds.
    assert_times(&events, &[FRAME_NS as f64 * 1.2 / 4.0], 2.0);
}

/// Fault: the reference follows the extrema, so that a swing below the threshold gives events.
#[test]
fn a_swing_below_the_threshold_is_silent() {
    let sensor = sensor(1);
    let events = shine(&sensor, frames(60), |_, t_ns| 0.95 * 0.2 * (t_ns * 1e-9 * 7.0).sin());
    assert!(events.is_empty(), "{events:?}");
}

/// The number of events of a lamp in the dark follows from the logarithm with the log offset.
#[test]
fn a_lamp_in_the_dark_follows_the_offset() {
    for log_offset in [1e-6, 1e-3, 0.01, 1.0] {
        let sensor = SensorModel { log_offset, ..sensor(1) };
        let frames = [[0.0], [1.0]];
        let times = [0, FRAME_NS];
        let events = truth::events(&sensor, 0, times.into_iter().zip(frames.iter().map(|f| &f[..]))).unwrap();
        let count = (((1.0 + log_offset) / log_offset).ln() / 0.2).floor();
        assert_eq!(events.len(), count as usize, "offset {log_offset}");
    }
}

/// Fault: without state from frame to frame, the rest of a change between one and two thresholds is lost, and so are
/// small changes that add up.
#[test]
fn small_changes_add_up_over_frames() {
    let sensor = SensorModel { substeps: 1, synthesis: Synthesis::None, ..sensor(2) };
    let events = shine(&sensor, frames(10), |pixel, t_ns| {
        let frame = (t_ns / FRAME_NS as f64).round();
        if pixel == 0 { 0.3 * frame.min(1.0) } else { 0.07 * frame }
    });
    let count = |x| events.iter().filter(|e| e.x == x).count();
    assert_eq!((count(0), count(1)), (1, 3));
}

/// Fault: of several crossings in one step all but one are lost.
#[test]
fn every_crossing_of_a_step_has_its_own_time() {
    let sensor = SensorModel { substeps: 1, ..sensor(1) };
    let events = shine(&sensor, frames(1), |_, t_ns| -t_ns / FRAME_NS as f64);
    assert_eq!(polarities(&events), "-----");
    assert_times(&events, &[0.2, 0.4, 0.6, 0.8, 1.0].map(|f| f * FRAME_NS as f64), 1.0 + 1e-3);
}

/// Fault: one NaN spoils a pixel for ever, or spoils its neighbours.
#[test]
fn invalid_light_is_held_and_counted() {
    let sensor = SensorModel { substeps: 1, ..sensor(3) };
    let mut oracle = Oracle::new(sensor, 0).unwrap();
    let bad = [f64::NAN, f64::INFINITY, -1.0];
    let first = oracle.step_samples(0, &|pixel, _| if pixel == 2 { bad[0] } else { 1.0 }).unwrap();
    assert_eq!((first.diagnostics.invalid_pixels, first.diagnostics.unarmed_pixels), (1, 1));
    for (k, bad) in (1..).zip(bad) {
        let t_ns = k * FRAME_NS;
        let got = oracle
            .step_samples(t_ns, &|pixel, from_ns| if pixel >= 1 && from_ns > 0.0 { bad } else { 1.0 })
            .unwrap();
        assert_eq!((got.packet.len(), got.diagnostics.invalid_pixels), (0, 2));
        assert_eq!(got.diagnostics.unarmed_pixels, 1);
    }
    let level = |pixel| if pixel == 0 { 1.0 } else { 2.0 };
    let armed =
        oracle.step_samples(4 * FRAME_NS, &|pixel, from_ns| if from_ns > 0.0 { level(pixel) } else { 1.0 });
    let armed = armed.unwrap();
    assert_eq!(armed.diagnostics.unarmed_pixels, 0);
    assert_eq!(armed.packet.iter().map(|e| e.x).collect::<Vec<_>>(), [1; 3], "unarmed pixels send nothing");
    let after = oracle.step_samples(5 * FRAME_NS, &|pixel, _| level(pixel)).unwrap();
    assert!(after.packet.is_empty(), "its reference is its first valid frame");
}
