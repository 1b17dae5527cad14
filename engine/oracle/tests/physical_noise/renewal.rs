//! Events of the oracle's hazard against those of sampled paths.

use crate::case::{CHARGE_E, Case, FIRST_PER_S};
use crate::path::{Path, STEPS};
use esaac_model::physical::PhysicalPixel;
use esaac_model::physical::noise::{correlation, forgotten, hazard_per_s};
use esaac_model::random::PixelKey;
use esaac_model::{Polarity, SensorModel, SubstepPolicy};
use esaac_oracle::Oracle;
use std::f64::consts::TAU;

/// What is counted of events.
#[derive(Clone, Copy, Debug)]
struct Counted {
    /// Events of a pixel and second.
    rate_hz: f64,
    events: f64,
    /// Share of events that follow one of the other polarity.
    opposite: f64,
    /// Coefficient of variation of the intervals.
    variation: f64,
}

/// Counts the events of each pixel after `from_s`, for a time of `span_s`.
fn count(pixels: &[Vec<(f64, Polarity)>], from_s: f64, span_s: f64) -> Counted {
    let late = |events: &[(f64, Polarity)]| {
        events.iter().copied().filter(|&(t_s, _)| t_s > from_s).collect::<Vec<_>>()
    };
    let (mut events, mut pairs, mut opposite, mut gaps) = (0, 0, 0, Vec::new());
    for pixel in pixels {
        let late = late(pixel);
        events += late.len();
        for pair in late.windows(2) {
            pairs += 1;
            opposite += usize::from(pair[0].1 != pair[1].1);
            gaps.push(pair[1].0 - pair[0].0);
        }
    }
    let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
    let variance = gaps.iter().map(|gap| (gap - mean).powi(2)).sum::<f64>() / gaps.len() as f64;
    Counted {
        rate_hz: events as f64 / (span_s * pixels.len() as f64),
        events: events as f64,
        opposite: opposite as f64 / pairs.max(1) as f64,
        variation: variance.sqrt() / mean,
    }
}

/// Events of the oracle's pixels, in order of time.
fn oracle_events(case: &Case, pixels: u32, seconds: u32) -> Vec<Vec<(f64, Polarity)>> {
    let sensor = SensorModel {
        width: pixels,
        height: 1,
        substeps: 1,
        substep_policy: SubstepPolicy::Fixed,
        contrast_on: case.threshold_log(),
        contrast_off: case.threshold_log(),
        refractory_ns: (case.refractory_s() * 1e9) as u32,
        seed: 5,
        ..SensorModel::default()
    };
    // A ramp of the light would change the first pole. So the leak moves the reference in its place.
    let pixel = PhysicalPixel {
        lux_per_unit: 1.0,
        dark_lux: 1e-6,
        response_e_per_lux_s: FIRST_PER_S * CHARGE_E,
        photoreceptor_charge_e: CHARGE_E,
        second_pole_hz: case.second_per_s() / TAU,
        leak_rate_hz: case.slope_log_per_s() / case.threshold_log(),
        ..PhysicalPixel::default()
    };
    let mut camera = Oracle::new(sensor.with_physical(&pixel), 0).expect("valid");
    let mut events = vec![Vec::new(); pixels as usize];
    for k in 0..=i64::from(seconds) {
        let interval = camera.step_samples(k * 1_000_000_000, &|_, _| 1.0).expect("in time");
        for event in interval.packet.iter() {
            events[usize::from(event.x)].push((event.t_ns as f64 * 1e-9, event.polarity));
        }
    }
    events
}

/// The same of sampled paths through both poles and the comparators.
fn path_events(case: &Case, pixels: u32, seconds: u32) -> Vec<Vec<(f64, Polarity)>> {
    let mut events = vec![Vec::new(); pixels as usize];
    for (number, events) in (0..).zip(&mut events) {
        // Two steps at least in a hold.
        let steps = STEPS.max(2.0 / (case.held * case.poles));
        let mut path = Path::settled(case, steps, number);
        let held_steps = case.refractory_s() / path.step_s;
        let rise_log = case.slope_log_per_s() * path.step_s;
        let threshold_log = case.threshold_log();
        let (mut reference_log, mut level_log, mut held_until) = (path.second_log, 0.0, 0);
        let mut before_log = 0.0;
        for step in 1..=(f64::from(seconds) / path.step_s) as u64 {
            path.step();
            level_log += rise_log;
            let shown_log = level_log + path.second_log;
            if step < held_until {
                continue;
            }
            if step == held_until {
                reference_log = shown_log;
            }
            let above_log: f64 = shown_log - reference_log;
            let before_log = std::mem::replace(&mut before_log, above_log);
            if above_log.abs() < threshold_log {
                continue;
            }
            let (sign, polarity) = if above_log > 0.0 { (1.0, Polarity::On) } else { (-1.0, Polarity::Off) };
            // Between two steps the path is a line. The hold ends at a step, late as often as early.
            let back = (sign * above_log - threshold_log) / (sign * (above_log - before_log));
            let crossed = step as f64 - back;
            events.push((crossed * path.step_s, polarity));
            held_until = ((crossed + held_steps).round() as u64).max(step + 1);
        }
    }
    events
}

/// Events of `[oracle, path]` pixels, counted from `from_s` to `to_s`.
fn both(case: &Case, [oracle, path]: [u32; 2], [from_s, to_s]: [u32; 2]) -> [Counted; 2] {
    let count = |events: Vec<_>| count(&events, f64::from(from_s), f64::from(to_s - from_s));
    [count(oracle_events(case, oracle, to_s)), count(path_events(case, path, to_s))]
}

/// Still pixels with this refractory period, in time constants of the first pole.
fn still(held: f64) -> impl Iterator<Item = Case> {
    let poles = [1.0, 5.0, 20.0];
    let case = move |distance| poles.map(|poles| Case { poles, held, distance, slope: 0.0 });
    [3.0, 4.0].into_iter().flat_map(case)
}

/// The oracle's rate is within `low` and `high` of the paths', and its pixels change polarity as often.
fn assert_noise_of_paths(case: &Case, [oracle, path]: [Counted; 2], [low, high]: [f64; 2]) {
    let ratio = oracle.rate_hz / path.rate_hz;
    let apart = oracle.opposite - path.opposite;
    println!("{case:?}: {} events of paths; rate {ratio:.3}, opposite {apart:.3}", path.events);
    // Four hundred events of many pixels have a rate to 5%.
    assert!(path.events > 400.0, "{case:?}: {path:?}");
    assert!((low..=high).contains(&ratio), "{case:?}: {oracle:?} against {path:?}");
    assert!(apart.abs() < 0.06, "{case:?}: {oracle:?} against {path:?}");
}

#[test]
fn still_pixels_send_noise_at_the_rate_of_sampled_paths() {
    for case in still(2.0) {
        let pixels = if case.distance > 3.5 { [800, 400] } else { [400, 200] };
        assert_noise_of_paths(&case, both(&case, pixels, [30, 120]), [0.85, 1.15]);
    }
}

/// Held for a tenth of a time constant, a pixel still shows at the release nearly what it did at the event.
#[test]
fn still_pixels_that_are_hardly_held_begin_at_the_rate_of_sampled_paths() {
    for case in still(0.1) {
        let pixels = if case.distance > 3.5 { [6000; 2] } else { [3000; 2] };
        assert_noise_of_paths(&case, both(&case, pixels, [0, 5]), [0.88, 1.12]);
    }
}

/// Chains of opposite events go on for as long as those of paths. What moves the reference from pair to pair is the slope
/// of the noise at each event.
#[test]
fn still_pixels_that_are_hardly_held_go_on_at_the_rate_of_sampled_paths() {
    for case in still(0.1) {
        let pixels = if case.distance > 3.5 { [900, 600] } else { [400, 300] };
        assert_noise_of_paths(&case, both(&case, pixels, [30, 120]), [0.88, 1.12]);
    }
}

#[test]
fn ramps_send_as_many_events_as_sampled_paths_and_as_regularly() {
    for case in [
        Case { poles: 5.0, held: 0.1, distance: 4.0, slope: 3.0 },
        Case { poles: 5.0, held: 0.1, distance: 4.0, slope: 30.0 },
        Case { poles: 20.0, held: 0.5, distance: 3.6, slope: 1.0 },
    ] {
        let [oracle, path] = both(&case, [30, 30], [8, 30]);
        let ratio = oracle.rate_hz / path.rate_hz;
        assert!((ratio - 1.0).abs() < 0.06, "{case:?}: {oracle:?} against {path:?}");
        let apart = oracle.variation - path.variation;
        assert!(apart.abs() < 0.03, "{case:?}: {oracle:?} against {path:?}");
    }
}

/// Slow light meets paths that cross outwards, fast light those that happen to be there. The slopes of the light are below,
/// at and above the noise's own; events are so regular that rates are good to a percent.
#[test]
fn between_slow_and_fast_light_ramps_send_as_many_events_as_sampled_paths() {
    for [poles, held] in [[1.0, 0.5], [5.0, 0.1], [20.0, 0.1]] {
        for speed in [0.3, 1.0, 3.0] {
            let case = Case { poles, held, distance: 3.0, slope: speed * f64::sqrt(poles) };
            let [oracle, path] = both(&case, [80, 40], [8, 30]);
            let ratio = oracle.rate_hz / path.rate_hz;
            println!("{case:?}: rate {ratio:.3}, variation {:.3} of {:.3}", oracle.variation, path.variation);
            assert!((ratio - 1.0).abs() < 0.02, "{case:?}: {oracle:?} against {path:?}");
            assert!(
                (oracle.variation - path.variation).abs() < 0.03,
                "{case:?}: {oracle:?} against {path:?}"
            );
        }
    }
}

/// Mean time from a release to the next event when the hold before it was so long that nothing is remembered: an
/// integral over the noise at the release and over what a signal meets.
fn mean_watch_s(case: &Case) -> f64 {
    let (sigma, threshold, second) = (case.sigma_log(), case.threshold_log(), case.second_per_s());
    let step = 0.25;
    let deviates = || (-20..=20).map(|i| step * f64::from(i));
    let mass = |x: f64| step * (-0.5 * x * x).exp() / TAU.sqrt();
    let mut mean_s = 0.0;
    for released in deviates() {
        // Hazard and noise along time: densely while the release is remembered, then constant.
        let step_s = 0.02 / FIRST_PER_S;
        let along: Vec<[f64; 3]> = (1..=500)
            .map(|i| {
                let t_s = step_s * f64::from(i);
                let (p, q) = (FIRST_PER_S * t_s, second * t_s);
                let forgotten = forgotten(p, q);
                let deviation = sigma * (forgotten * (2.0 - forgotten)).sqrt();
                let mean = (correlation(p, q) - 1.0) * sigma * released;
                let hazard = |gap: f64| hazard_per_s(gap / deviation, FIRST_PER_S, second);
                [mean, deviation, hazard(threshold - mean) + hazard(threshold + mean)]
            })
            .collect();
        for z in deviates() {
            let (mut alive, mut watch_s, mut crossed) = (1.0, 0.0, false);
            for &[mean, deviation, hazard] in &along {
                if (mean + deviation * z).abs() >= threshold {
                    crossed = true;
                    break;
                }
                let spent = hazard * step_s;
                watch_s += alive * step_s * (1.0 - 0.5 * spent);
                alive *= (-spent).exp();
            }
            if !crossed {
                watch_s += alive / along[along.len() - 1][2];
            }
            mean_s += mass(released) * mass(z) * watch_s;
        }
    }
    mean_s
}

#[test]
fn after_long_holds_the_noise_rate_has_a_closed_form() {
    for case in [
        Case { poles: 1.0, held: 9.0, distance: 3.0, slope: 0.0 },
        Case { poles: 20.0, held: 9.0, distance: 3.2, slope: 0.0 },
    ] {
        let exact_hz = 1.0 / (case.refractory_s() + mean_watch_s(&case));
        let oracle = count(&oracle_events(&case, 150, 240), 60.0, 180.0);
        // The intervals are nearly exponential: n of them have a mean good to 1 / sqrt(n).
        let bound = 4.0 / oracle.events.sqrt();
        assert!(oracle.events > 1500.0, "{case:?}: {oracle:?}");
        assert!((oracle.rate_hz / exact_hz - 1.0).abs() < bound, "{case:?}: {oracle:?} against {exact_hz}");
    }
}

#[test]
fn seeds_and_cameras_draw_apart_and_repeat() {
    let key = PixelKey { seed: 1, camera: 0, pixel: 7 };
    let draw = esaac_model::physical::noise::Renewal::draw;
    assert_eq!(draw(key, 3), draw(key, 3));
    assert_ne!(draw(key, 3), draw(key, 4));
    assert_ne!(draw(key, 3), draw(PixelKey { camera: 1, ..key }, 3));
}
