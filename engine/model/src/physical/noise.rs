//! Noise before the comparator, without sampling it.
//!
//! # The law
//! The node of the first stage is driven by white noise. Photons and the feedback transistor give equal shares, so its
//! variance is `1 / N_e` whatever the light. The light sets the speed only. In the clock of the phase
//! `P_1 = int w_1 dt` the node's noise is therefore one stationary process, also when the light changes. Behind the
//! second pole the standard deviation is [`sigma_log`] and the correlation with the noise of an instant ago, after the
//! phases `P_1` and `P_2`, is [`correlation`]. Phases only grow, so what is forgotten in a flash stays forgotten in the
//! darkness after it. (With `w_1 t`, at the present `w_1`, it would come back.)
//!
//! # The hazard
//! [`hazard_per_s`] is the rate at which a stationary noise comes to a level `b` standard deviations away: Rice's
//! \[4\] rate of upward crossings for a smooth noise, `nu e^(-b^2/2)`, `nu = sqrt(w_1 w_2) / 2 pi`, and the first
//! passage of an Ornstein-Uhlenbeck process, `kappa e^(-b^2/2)`, for one whose poles lie far apart. Crossings of the
//! latter come in clusters, of which only the first counts. Beyond a far-off level the noise is pulled back by a force that
//! hardly changes, so the share of first crossings depends on a single number, `sqrt(w_1 w_2) b / (w_1 + w_2)`: the time in
//! which a path loses its slope, over the time until it is back. Times `sqrt(2 pi)` it is that share where it is small, the
//! passage's rate over Rice's. Where it is large, nearly all crossings are alone.
//!
//! # Draws ([`Renewal`], [`release_log`])
//! Each event begins a new **renewal**, which draws from three counters, with the number of events before it as index:
//!
//! | stream | words | draw |
//! |---|---|---|
//! | `Threshold` | 0 to 3 | `z`, the noise that a signal meets |
//! | `Clock` | 0 | hazard to be spent, Exp(1) |
//! | | 1 | polarity of a noise event, uniform |
//! | | 2 | slope of the noise at the event ([`crossing`](super::crossing)), Rayleigh |
//! | `Release` | 0 to 3 | what is new in the noise after the refractory period |
//!
//! Index 0 is the renewal that begins when the pixel is armed.

use super::photoreceptor::phi;
use crate::random::{PixelKey, Stream, draw, exponential, normal_from_words};

/// Standard deviation of the noise behind both poles, nepers.
#[must_use]
pub fn sigma_log(charge_e: f64, gain: f64, first_per_s: f64, second_per_s: f64) -> f64 {
    gain * (second_per_s / (charge_e * (first_per_s + second_per_s))).sqrt()
}

/// Correlation of the noise with itself after the phases `p` and `q`:
/// `(q e^-p - p e^-q) / (q - p)`. It falls in both.
#[must_use]
pub fn correlation(p: f64, q: f64) -> f64 {
    let (low, high) = (p.min(q), p.max(q));
    (-low).exp() * (1.0 + low * phi(low - high))
}

/// `1 - correlation(p, q)` without cancellation. Near a release it is `p q / 2`.
#[must_use]
pub fn forgotten(p: f64, q: f64) -> f64 {
    let high = p.max(q);
    if high > 0.1 {
        return 1.0 - correlation(p, q);
    }
    // The power series of the correlation: p q sum over k of (-1)^k h_k(p, q) / (k + 2)!, with the complete homogeneous
    // polynomials h_k = p^k + p^(k-1) q + ... + q^k.
    let (mut sum, mut homogeneous, mut power, mut factorial, mut sign) = (0.0, 1.0, 1.0, 2.0, 1.0);
    for k in 0..6 {
        sum += sign * homogeneous / factorial;
        power *= q;
        homogeneous = homogeneous * p + power;
        factorial *= f64::from(k + 3);
        sign = -sign;
    }
    p * q * sum
}

/// Correlation of the noise with its slope, in standard deviations of both, at the phases' start:
/// `sqrt(p q) (e^-p - e^-q) / (q - p)`.
#[must_use]
pub fn slope_correlation(p: f64, q: f64) -> f64 {
    let (low, high) = (p.min(q), p.max(q));
    (p * q).sqrt() * (-low).exp() * phi(low - high)
}

/// Rate, per second, at which noise comes to a level `distance` standard deviations away.
///
/// Rice's rate counts by the share of crossings that are the first of their cluster. Below a distance of 1, where
/// neither holds, the rate is at least that at which the noise moves at all, reached at .7. (Without the ramp from 1 to
/// .7 the rate would jump.)
#[must_use]
pub fn hazard_per_s(distance: f64, first_per_s: f64, second_per_s: f64) -> f64 {
    // How fast the share of first crossings comes to 1, found by sampled paths.
    const JOIN: f64 = 0.8;
    let b = distance.max(0.7);
    if b > 38.0 {
        return 0.0;
    }
    let crossing = (first_per_s * second_per_s).sqrt() / std::f64::consts::TAU;
    // The passage's rate over Rice's.
    let apart = (first_per_s * second_per_s).sqrt() / (first_per_s + second_per_s);
    let passage = std::f64::consts::TAU.sqrt() * apart * (b + 1.5 * (-b).exp());
    let first = (-(-passage.powf(JOIN)).exp_m1()).powf(1.0 / JOIN);
    let far = crossing * first * (-0.5 * b * b).exp();
    let near = 0.6 * first_per_s * second_per_s / (first_per_s + second_per_s);
    far.max(near * ((1.0 - b) / 0.3).clamp(0.0, 1.0))
}

/// What a renewal draws when it begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Renewal {
    /// Noise that a signal meets, in standard deviations of what is not known about it.
    pub z: f64,
    /// Hazard to be spent until a noise event.
    pub clock: f64,
    /// Uniform in [0, 1): a noise event is ON if it lies below the ON hazard's share.
    pub polarity: f64,
    /// Slope of the noise at an event in still light, in its standard deviations: Rayleigh.
    pub slope: f64,
}

impl Renewal {
    /// Draws of the renewal after `events` events.
    #[must_use]
    pub fn draw(key: PixelKey, events: u32) -> Self {
        let words = draw(key, Stream::Clock, events);
        Renewal {
            z: normal_from_words(draw(key, Stream::Threshold, events)),
            clock: exponential(words[0]),
            polarity: f64::from(words[1]) / 4_294_967_296.0,
            slope: (2.0 * exponential(words[2])).sqrt(),
        }
    }
}

/// Noise of a pixel that is armed, nepers: a draw from the stationary law.
#[must_use]
pub fn armed_log(key: PixelKey, events: u32, sigma_log: f64) -> f64 {
    sigma_log * normal_from_words(draw(key, Stream::Release, events))
}

/// How near to a threshold a leak brings what a pixel shows before its noise fires it, about, in standard deviations.
pub const LEAK_CLEARANCE: f64 = 3.5;

/// How far a leak has moved the reference of a pixel that is armed, nepers towards its threshold of `threshold_log`, as in one
/// that has looked at still light for long. Noise fires it before the leak is there, and afterwards its reference is as much
/// beyond what it shows, but for what the noise forgets while it is held: it keeps the share `kept`. `phase` is the draw
/// [`leak_phase`](crate::random::leak_phase).
#[must_use]
pub fn armed_leak_log(phase: f64, threshold_log: f64, sigma_log: f64, kept: f64) -> f64 {
    let clearance_log = LEAK_CLEARANCE * sigma_log;
    let beyond_log = kept * clearance_log.min(0.5 * threshold_log);
    phase * ((threshold_log - clearance_log).max(beyond_log) + beyond_log) - beyond_log
}

/// Most of the way to a threshold that a pixel has gone when it is armed.
pub const ARMED_WITHIN: f64 = 0.99999;

/// The noise at an event.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AtEvent {
    /// Its value, nepers.
    pub noise_log: f64,
    /// Its slope, in standard deviations of a slope of which nothing is known; above 0 towards the ON threshold.
    pub slope: f64,
}

/// Noise at a release, nepers, given the noise at the event and the phases `p` and `q` since. `events` counts the event.
#[must_use]
pub fn release_log(key: PixelKey, events: u32, at_event: AtEvent, sigma_log: f64, p: f64, q: f64) -> f64 {
    let (kept, turned) = (correlation(p, q), slope_correlation(p, q));
    let forgotten = forgotten(p, q);
    let unknown = (forgotten * (2.0 - forgotten) - turned * turned).max(0.0).sqrt();
    let new = normal_from_words(draw(key, Stream::Release, events));
    kept * at_event.noise_log + sigma_log * (turned * at_event.slope + unknown * new)
}

/// Frequency at which the two poles together have lost 3 dB, Hz.
#[must_use]
pub fn corner_hz(first_per_s: f64, second_per_s: f64) -> f64 {
    // (1 + w^2 / a)(1 + w^2 / b) = 2 for a, b the squared poles: w^4 + (a + b) w^2 - a b = 0, solved without
    // cancellation.
    let (a, b) = (first_per_s * first_per_s, second_per_s * second_per_s);
    let squared = 2.0 * a * b / ((a + b) + ((a + b) * (a + b) + 4.0 * a * b).sqrt());
    squared.sqrt() / std::f64::consts::TAU
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlation_is_that_of_two_poles_and_falls_in_both_phases() {
        for (p, q) in [(0.3, 0.7), (2.0, 0.1), (5.0, 5.0 + 1e-4), (1e-3, 40.0)] {
            let exact = (q * f64::exp(-p) - p * f64::exp(-q)) / (q - p);
            assert!((correlation(p, q) - exact).abs() < 1e-11, "{p} {q}");
            assert!(correlation(1.01 * p, q) < correlation(p, q), "{p} {q}");
            assert!(correlation(p, 1.01 * q) < correlation(p, q), "{p} {q}");
        }
        assert!((correlation(2.0, 2.0) - 3.0 * f64::exp(-2.0)).abs() < 1e-12, "equal poles");
        assert_eq!(correlation(0.0, 3.0), 1.0);
    }

    #[test]
    fn what_is_forgotten_has_no_cancellation() {
        for (p, q) in [(0.1, 0.05), (0.1 - 1e-9, 0.1), (0.01, 0.02)] {
            let exact = 1.0 - correlation(p, q);
            assert!((forgotten(p, q) / exact - 1.0).abs() < 1e-9, "{p} {q}");
        }
        assert!((forgotten(1e-9, 3e-9) / 1.5e-18 - 1.0).abs() < 1e-8);
        // Value and slope together never say more than everything.
        for exponent in -40..12 {
            let p = f64::exp2(f64::from(exponent) / 2.0);
            for ratio in [0.01, 0.5, 1.0, 3.0] {
                let (q, forgotten) = (p * ratio, forgotten(p, p * ratio));
                let rest = forgotten * (2.0 - forgotten) - slope_correlation(p, q).powi(2);
                assert!(rest > -1e-12 * forgotten, "{p} {q}: {rest}");
            }
        }
    }

    #[test]
    fn hazard_falls_with_distance_and_is_never_negative() {
        for (first, second) in [(10.0, 6000.0), (300.0, 300.0), (1e6, 6000.0)] {
            let hazard = |b: f64| hazard_per_s(b, first, second);
            for i in -200..400 {
                let b = 0.1 * f64::from(i);
                assert!(hazard(b) >= hazard(b + 0.1) && hazard(b).is_finite(), "{first} {b}");
                assert!((hazard(b) - hazard(b + 1e-9)) <= 1e-6 * hazard(b) + 1e-300, "a jump at {b}");
            }
        }
    }

    #[test]
    fn corner_follows_the_light_until_the_second_pole() {
        let second = std::f64::consts::TAU * 1215.0;
        for (lux, hz) in [(0.1, 6.0), (1.0, 46.0), (10.0, 401.0), (100.0, 1138.0)] {
            let corner = corner_hz(281.0 * (lux + 0.035), second);
            assert!((corner / hz - 1.0).abs() < 0.02, "{lux} lux: {corner}");
        }
        assert!((corner_hz(10.0, 1e30) * std::f64::consts::TAU - 10.0).abs() < 1e-9);
    }

    #[test]
    fn a_release_after_no_time_keeps_the_noise_and_after_long_draws_anew() {
        let key = PixelKey { seed: 1, camera: 0, pixel: 0 };
        let at_event = AtEvent { noise_log: 0.2, slope: 1.5 };
        assert!((release_log(key, 1, at_event, 0.05, 0.0, 0.0) - 0.2).abs() < 1e-12);
        let long: Vec<f64> = (0..20_000)
            .map(|pixel| release_log(PixelKey { pixel, ..key }, 1, at_event, 0.05, 50.0, 60.0))
            .collect();
        let mean = long.iter().sum::<f64>() / long.len() as f64;
        let deviation = (long.iter().map(|n| (n - mean).powi(2)).sum::<f64>() / long.len() as f64).sqrt();
        assert!(mean.abs() < 0.0015 && (deviation - 0.05).abs() < 0.001, "{mean} {deviation}");
    }
}
