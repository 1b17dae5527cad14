//! Pixels without noise whose stages are slow or fast beside the light, against the oracle.

use super::{against_oracle, quiet, sensor};
use esaac_model::SensorModel;
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{Sequence, gray, times};
use esaac_tests::run::{engine, events};

/// Light that falls by four decades within `fall_ns` and stays there. Each pixel falls from another level.
fn fall(sensor: &SensorModel, fall_ns: i64) -> Sequence {
    let mut frames_ns = times(0, 7);
    frames_ns[3] = frames_ns[2] + fall_ns;
    gray(sensor, &frames_ns, |frame, pixel| {
        let bright = 20.0 * (1.0 + 0.5 * (pixel as f32 * 0.37).sin());
        [1.0, 1.0, 1.0, 0.0001, 0.0001, 0.0001, 0.0001][frame] * bright
    })
}

/// The output is then far above the light, and the first stage is much faster than its time constant in the dark: a part
/// of that length would overshoot by hundreds of nepers, and send as many events down and up again.
#[test]
fn a_pixel_that_falls_into_the_dark_sends_the_oracles_events() {
    for (substeps, fall_ns) in [(2, 1), (2, 15_000_000), (32, 1_000)] {
        let sensor = SensorModel {
            contrast_on: 0.11,
            contrast_off: 0.2,
            contrast_mismatch: 0.03,
            refractory_ns: 1_262,
            height: 6,
            dark_lux: 0.01,
            second_pole_hz: 70_000.0,
            substeps,
            ..sensor()
        };
        let sequence = fall(&sensor, fall_ns);
        let total = against_oracle(&sensor, &sequence);
        assert!(total.apart_ns.len() > 10 * total.pixels, "many events");
        assert!(total.differing <= total.pixels / 200, "{} pixels", total.differing);
        assert!(total.apart_ns(0.99) < 30_000, "{} ns", total.apart_ns(0.99));
        // A little noise changes when they come, but not how many: all are OFF.
        let noisy = SensorModel { noise_gain: 0.01, ..sensor };
        let quiet = total.apart_ns.len();
        let noisy = events(&engine(&noisy, &sequence)).len();
        println!("with noise: {noisy} events, without {quiet}");
        assert!(noisy.abs_diff(quiet) < quiet / 50, "{noisy} events, {quiet}");
    }
    assert_silent();
}

/// In bright light the first stage is far faster than the second, so that all bends are the second one's. Light whose slope
/// changes from frame to frame.
#[test]
fn a_slow_second_stage_is_followed_after_each_change_of_slope() {
    let sensor = SensorModel {
        height: 6,
        contrast_on: 0.012,
        contrast_off: 0.011,
        second_pole_hz: 20_000.0,
        substeps: 16,
        ..sensor()
    };
    let sequence = gray(&sensor, &times(0, 6), |frame, pixel| {
        let phase = pixel as f64 * 0.37;
        (30_000.0 * (0.9 * (1.9 * frame as f64 + phase).sin()).exp()) as f32
    });
    let total = against_oracle(&sensor, &sequence);
    assert!(total.apart_ns.len() > 100 * total.pixels, "many events");
    assert!(total.differing <= total.pixels / 200, "{} pixels", total.differing);
    assert!(total.apart_ns(0.5) < 500 && total.apart_ns(0.99) < 2_000, "as exact as the closed form");
    assert_silent();
}

/// Light that changes at once and then stays: the second stage comes to rest within a thousandth of the long part that
/// follows. Where pixels are held for some nanoseconds, a crossing that is told too early would be told again and again. With
/// large thresholds most crossings lie where the output has nearly come to rest.
#[test]
fn a_step_before_a_long_still_interval_sends_the_oracles_events() {
    for (contrast, refractory_ns) in [(0.065, 0), (0.065, 7), (0.065, 20_000), (0.3, 0)] {
        let sensor = SensorModel {
            height: 6,
            contrast_on: contrast,
            contrast_off: contrast,
            contrast_mismatch: 0.03,
            refractory_ns,
            second_pole_hz: 40_000.0,
            substeps: 8,
            ..sensor()
        };
        let frames_ns = [0, 33_000_000, 33_000_061, 66_000_000, 66_010_000, 900_000_000];
        let sequence = gray(&sensor, &frames_ns, |frame, pixel| {
            let step = 0.3 + 0.6 * (pixel as f64 * 0.37).sin();
            (30_000.0 * [0.0, 0.0, -step, -step, 1.3, 1.3][frame].exp()) as f32
        });
        let total = against_oracle(&sensor, &sequence);
        println!("at most {} ns apart", total.apart_ns(1.0));
        assert!(total.apart_ns.len() > total.pixels, "many events");
        assert!(total.differing <= total.pixels / 200, "{} pixels", total.differing);
        assert!(total.apart_ns(0.99) < 200, "{} ns", total.apart_ns(0.99));
        assert!(total.apart_ns(1.0) < 10_000, "{} ns", total.apart_ns(1.0));
    }
    assert_silent();
}

/// The leak that light drives grows with it, by a factor of e in a frame: no straight line.
#[test]
fn a_leak_by_light_follows_the_light() {
    let sensor = SensorModel {
        height: 6,
        contrast_on: 0.15,
        contrast_off: 0.19,
        refractory_ns: 100_000,
        leak_per_lux_hz: 0.2,
        second_pole_hz: 25_000.0,
        substeps: 1,
        ..sensor()
    };
    let sequence = gray(&sensor, &times(0, 5), |frame, pixel| {
        (2_000.0 * (frame as f64 * 0.9 + (pixel as f64 * 0.37).sin()).exp()) as f32
    });
    let total = against_oracle(&sensor, &sequence);
    assert!(total.apart_ns.len() > 30 * total.pixels, "many events");
    assert!(total.differing <= total.pixels / 200, "{} pixels", total.differing);
    assert!(total.apart_ns(0.99) < 4_000, "{} ns", total.apart_ns(0.99));
    assert_silent();
}

/// A long interval is one part for a pixel in still light, and levels have bits for some nepers only. Still light, then light
/// that grows.
#[test]
fn all_of_a_fast_leak_comes_in_a_long_interval() {
    for leak_per_lux_hz in [0.4, -0.4] {
        let sensor = SensorModel {
            height: 1,
            contrast_on: 0.15,
            contrast_off: 0.19,
            leak_per_lux_hz,
            substeps: 1,
            ..sensor()
        };
        let sequence = gray(&sensor, &[0, 800_000_000, 1_400_000_000], |frame, pixel| {
            [4_000.0, 4_000.0, 6_000.0][frame] * (1.0 + 0.3 * (pixel as f32 * 0.37).sin())
        });
        let total = against_oracle(&sensor, &sequence);
        assert!(total.apart_ns.len() > 1_000 * total.pixels, "many events");
        assert!(total.differing <= 1, "{} pixels", total.differing);
        assert!(total.apart_ns(0.99) < 4_000, "{} ns", total.apart_ns(0.99));
        let noisy = SensorModel { noise_gain: 0.01, ..sensor.clone() };
        let [quiet, noisy] = [&sensor, &noisy].map(|sensor| events(&engine(sensor, &sequence)).len());
        println!("with noise: {noisy} events, without {quiet}");
        assert!(noisy.abs_diff(quiet) < quiet / 50, "{noisy} events, {quiet}");
    }
    assert_silent();
}

/// Darkness, noon, and flashes of five decades, in one sub-step or several. Beyond six decades light counts as a millionth of
/// what the first stage shows.
#[test]
fn pixels_send_the_oracles_events_in_flashes() {
    for substeps in [1, 4, 32] {
        let sensor = SensorModel { height: 4, dark_lux: 0.01, leak_per_lux_hz: 0.0, substeps, ..quiet() };
        let sequence = gray(&sensor, &times(0, 12), |frame, pixel| match (pixel % 4, frame % 3) {
            (0, _) => 0.0,
            (1, _) => 1e6,
            (2, 1) | (3, 0) => 1e3,
            _ => 1e-6,
        });
        let total = against_oracle(&sensor, &sequence);
        assert!(total.apart_ns.len() > 10 * total.pixels, "many events");
        assert!(total.differing <= total.pixels / 100, "{} pixels", total.differing);
        assert!(total.apart_ns(0.99) < 30_000, "{} ns", total.apart_ns(0.99));
    }
    assert_silent();
}
