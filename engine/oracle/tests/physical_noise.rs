//! Noise events of the physical pixel against sampled paths of the noise itself, and against their closed form. The
//! oracle draws no path: it has a hazard. Here is one, in steps far shorter than the poles' time constants.

use esaac_model::physical::PhysicalPixel;
use esaac_model::physical::noise::{correlation, forgotten, hazard_per_s, sigma_log};
use esaac_model::random::{PixelKey, philox4x32_10};
use esaac_model::{Polarity, SensorModel, SubstepPolicy};
use esaac_oracle::Oracle;
use std::f64::consts::TAU;

/// Charge of the photoreceptor in these tests, electrons: one pole has the deviation .1.
const CHARGE_E: f64 = 100.0;

/// The first pole, per second.
const FIRST_PER_S: f64 = 10.0;

/// A noisy pixel in still light or on a ramp.
#[derive(Clone, Copy, Debug)]
struct Case {
    /// Second pole over first.
    poles: f64,
    /// Refractory period in time constants of the first pole.
    held: f64,
    /// Threshold in standard deviations.
    distance: f64,
    /// Slope of the level in standard deviations per time constant of the first pole.
    slope: f64,
}

impl Case {
    fn second_per_s(&self) -> f64 {
        self.poles * FIRST_PER_S
    }

    fn sigma_log(&self) -> f64 {
        sigma_log(CHARGE_E, 1.0, FIRST_PER_S, self.second_per_s())
    }

    fn threshold_log(&self) -> f64 {
        self.distance * self.sigma_log()
    }

    fn refractory_s(&self) -> f64 {
        self.held / FIRST_PER_S
    }

    fn slope_log_per_s(&self) -> f64 {
        self.slope * self.sigma_log() * FIRST_PER_S
    }
}

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

/// Events of the oracle's pixels, and how they are counted after a burn-in of a quarter of the time.
fn by_oracle(case: &Case, pixels: u32, seconds: u32) -> Counted {
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
    let span_s = f64::from(seconds);
    count(&events, 0.25 * span_s, 0.75 * span_s)
}

/// The same of sampled paths through both poles and the comparators.
fn by_path(case: &Case, pixels: u32, seconds: u32) -> Counted {
    let steps_per_s = 12.0 * FIRST_PER_S.max(case.second_per_s());
    let step_s = 1.0 / steps_per_s;
    let held_steps = (case.refractory_s() * steps_per_s).round() as u64;
    let (kept_first, kept_second) = ((-FIRST_PER_S * step_s).exp(), (-case.second_per_s() * step_s).exp());
    let deviation = (1.0 / CHARGE_E).sqrt();
    let new = deviation * (1.0 - kept_first * kept_first).sqrt();
    let threshold = case.threshold_log();
    let rise = case.slope_log_per_s() * step_s;
    let mut events = vec![Vec::new(); pixels as usize];
    for (pixel, events) in (0..).zip(&mut events) {
        let mut normals = Normals { pixel, counter: 0, spare: None };
        // Both stages in the stationary state: the covariance of the second with the first is its own variance.
        let mut first = deviation * normals.next();
        let sigma = case.sigma_log();
        let share = sigma * sigma / (deviation * deviation);
        let mut second = share * first + sigma * (1.0 - share).sqrt() * normals.next();
        let (mut reference, mut level, mut held_until) = (second, 0.0, 0);
        for step in 1..=(f64::from(seconds) * steps_per_s) as u64 {
            let before = first;
            first = kept_first * first + new * normals.next();
            second = kept_second * second + (1.0 - kept_second) * 0.5 * (before + first);
            level += rise;
            let shown = level + second;
            if step < held_until {
                continue;
            }
            if step == held_until {
                reference = shown;
            }
            let above = shown - reference;
            let polarity = if above >= threshold {
                Polarity::On
            } else if above <= -threshold {
                Polarity::Off
            } else {
                continue;
            };
            events.push((step as f64 * step_s, polarity));
            held_until = step + held_steps.max(1);
        }
    }
    let span_s = f64::from(seconds);
    count(&events, 0.25 * span_s, 0.75 * span_s)
}

/// Normal deviates by Box-Muller, none of which the oracle draws.
struct Normals {
    pixel: u32,
    counter: u32,
    spare: Option<f64>,
}

impl Normals {
    fn next(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let words = philox4x32_10([self.counter, u32::MAX, self.pixel, 0], [99, 0]);
        self.counter += 1;
        let unit = |word: u32| (f64::from(word) + 0.5) / 4_294_967_296.0;
        let radius = (-2.0 * unit(words[0]).ln()).sqrt();
        let (sine, cosine) = (TAU * unit(words[1])).sin_cos();
        self.spare = Some(radius * sine);
        radius * cosine
    }
}

#[test]
fn still_pixels_send_noise_at_the_rate_of_sampled_paths() {
    for case in [
        Case { poles: 1.0, held: 0.1, distance: 3.0, slope: 0.0 },
        Case { poles: 5.0, held: 0.5, distance: 3.0, slope: 0.0 },
        Case { poles: 5.0, held: 2.0, distance: 3.0, slope: 0.0 },
        Case { poles: 20.0, held: 0.5, distance: 3.0, slope: 0.0 },
    ] {
        let (path, oracle) = (by_path(&case, 60, 120), by_oracle(&case, 240, 120));
        let ratio = oracle.rate_hz / path.rate_hz;
        // Counts of a thousand events have a deviation of 3%.
        assert!(path.events > 700.0, "{case:?}: {path:?}");
        assert!((ratio - 1.0).abs() < 0.18, "{case:?}: {oracle:?} against {path:?}");
        assert!((oracle.opposite - path.opposite).abs() < 0.06, "{case:?}: {oracle:?} against {path:?}");
    }
}

#[test]
fn ramps_send_as_many_events_as_sampled_paths_and_as_regularly() {
    for case in [
        Case { poles: 5.0, held: 0.1, distance: 4.0, slope: 3.0 },
        Case { poles: 5.0, held: 0.1, distance: 4.0, slope: 30.0 },
        Case { poles: 20.0, held: 0.5, distance: 3.6, slope: 1.0 },
    ] {
        let (path, oracle) = (by_path(&case, 30, 30), by_oracle(&case, 30, 30));
        let ratio = oracle.rate_hz / path.rate_hz;
        assert!((ratio - 1.0).abs() < 0.06, "{case:?}: {oracle:?} against {path:?}");
        let apart = oracle.variation - path.variation;
        assert!(apart.abs() < 0.03, "{case:?}: {oracle:?} against {path:?}");
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
        let oracle = by_oracle(&case, 150, 240);
        // The intervals are nearly exponential: n of them have a mean good to 1 / sqrt(n).
        let bound = 4.0 / oracle.events.sqrt();
        assert!(oracle.events > 1500.0, "{case:?}: {oracle:?}");
        assert!((oracle.rate_hz / exact_hz - 1.0).abs() < bound, "{case:?}: {oracle:?} against {exact_hz}");
    }
}

/// Noise rate of still pixels of a preset, Hz, over `seconds` after the burn-in.
fn still_rate_hz(preset: &str, lux: f64, (pixels, burn_in_s, seconds): (u32, u32, u32)) -> f64 {
    let sensor = esaac_model::presets::preset_with_physical_pixel(preset).expect("listed");
    let pixel = PhysicalPixel { lux_per_unit: 1.0, ..sensor.physical_pixel() };
    let sensor = SensorModel {
        width: pixels,
        height: 1,
        substeps: 1,
        substep_policy: SubstepPolicy::Fixed,
        seed: 5,
        ..sensor
    };
    let mut camera = Oracle::new(sensor.with_physical(&pixel), 0).expect("valid");
    let mut count = 0;
    for k in 0..=burn_in_s + seconds {
        let packet = camera.step_samples(i64::from(k) * 1_000_000_000, &|_, _| lux).expect("in time").packet;
        count += if k > burn_in_s { packet.len() } else { 0 };
    }
    count as f64 / f64::from(pixels * seconds)
}

#[test]
fn the_noise_of_a_still_hd_pixel_is_the_published_one_from_5_s_on() {
    // Published: the EVK4's noise against light, ON and OFF, Hz a pixel.
    let published =
        [(0.15, 0.49), (0.5, 0.88), (1.0, 1.15), (2.0, 1.31), (5.0, 0.99), (10.0, 0.48), (20.0, 0.145)];
    let mut peak = (0.0, 0.0);
    for (lux, published_hz) in published {
        let rate_hz = still_rate_hz("hd", lux, (200, 5, 30));
        let ratio = rate_hz / published_hz;
        println!("{lux} lux: {rate_hz:.3} Hz, {ratio:.2} of the published rate");
        assert!((1.0 / 1.5..1.5).contains(&ratio), "{lux} lux: {rate_hz} Hz, published {published_hz} Hz");
        peak = if rate_hz > peak.1 { (lux, rate_hz) } else { peak };
    }
    assert!((1.0..=5.0).contains(&peak.0), "the peak is at {} lux", peak.0);
}

#[test]
fn still_pixels_of_the_older_sensors_are_as_quiet_in_an_office_as_published() {
    // Published: .05 to .1 events of a pixel and second. Ten lux are an office behind a lens.
    for preset in ["dvs128", "davis240"] {
        let rate_hz = still_rate_hz(preset, 10.0, (120, 5, 40));
        assert!((0.03..0.25).contains(&rate_hz), "{preset}: {rate_hz} Hz");
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
