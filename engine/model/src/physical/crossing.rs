//! The slope of the noise at an event, which is not sampled either.
//!
//! A path crosses a threshold outwards. So what is known of its slope depends on how fast the watched level moves without
//! it. All slopes here count outwards, in standard deviations `sigma sqrt(w_1 w_2)` of a slope of which nothing is known,
//! and values of the noise in `sigma`.
//!
//! # The law
//! Given the noise at the last release and at the event, the slope `s` of the noise is normal ([`SlopeLaw`]). Its mean
//! `m` is how fast the noise that a signal meets moves at that instant, its deviation `d` what is left open. With the
//! slope `l` of the light behind the photoreceptor, and that of the leak, a path has the speed `v = l + s`. In a given
//! time a path of twice the speed comes to a threshold from twice as far, so of the paths that cross, speeds have the
//! density `v N(v; l + m, d^2)`, `v > 0` (Rice \[4\]). With `z = (l + m) / d` and `h = Phi(z) / (phi(z) + z Phi(z))`
//! ([`Crossing`]), `s` has
//!
//! - the mean `m + d h`,
//! - the standard deviation `d sqrt(2 - h (h + z))`.
//!
//! In still light, long after a release, `s` is Rayleigh distributed (`z = 0`). In fast light `h` is `1 / z`: a signal
//! that is driven through the threshold says nothing about the slope. [`SlopeLaw::at_event`] shifts and stretches a
//! Rayleigh draw to the mean and the deviation between both. Signal and noise events have the same law.

use super::noise::{correlation, forgotten, slope_correlation};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Least deviation of a slope.
const LEAST_DEVIATION: f64 = 1e-3;

/// Largest mean of a slope: no noise moves faster, and single precision tells no more right after a release.
const MOST_MEAN: f64 = 6.0;

/// Bounds of `z`. Further down hardly a path crosses, and further up no path is left out.
const DRIVEN: [f64; 2] = [-2.0, 100.0];

/// What is known of the noise's slope, given the noise at the last release and now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlopeLaw {
    /// Its mean.
    pub mean: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

impl SlopeLaw {
    /// The law, given the noise when it was `released` and `now`, the phases `p` and `q` later.
    #[must_use]
    pub fn between(released: f64, now: f64, p: f64, q: f64) -> Self {
        let turned = slope_correlation(p, q);
        let forgotten = forgotten(p, q);
        // Variance of the noise now, of which its slope explains `turned^2`.
        let new = (forgotten * (2.0 - forgotten)).max(turned * turned).max(f64::MIN_POSITIVE);
        SlopeLaw {
            mean: (turned * (correlation(p, q) * now - released) / new).clamp(-MOST_MEAN, MOST_MEAN),
            deviation: (1.0 - turned * turned / new).max(0.0).sqrt().max(LEAST_DEVIATION),
        }
    }

    /// Slope of the noise at an event in light of the slope `light`. `rayleigh` is a renewal's draw.
    #[must_use]
    pub fn at_event(&self, light: f64, rayleigh: f64) -> f64 {
        let crossing = Crossing::driven((light + self.mean) / self.deviation);
        let drawn = (rayleigh - FRAC_PI_2.sqrt()) / (2.0 - FRAC_PI_2).sqrt();
        self.mean + self.deviation * (crossing.ahead + crossing.spread * drawn)
    }
}

/// Speeds of crossing paths, in standard deviations of all speeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Their mean, above that of all paths.
    pub ahead: f64,
    /// Their standard deviation.
    pub spread: f64,
}

impl Crossing {
    /// Speeds of crossing paths where those of all paths have the mean `z`. The normal distribution is that of Abramowitz
    /// and Stegun, 26.2.17, with an error below 1e-7.
    #[must_use]
    pub fn driven(z: f64) -> Self {
        let z = z.clamp(DRIVEN[0], DRIVEN[1]);
        let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
        let series = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
        let density = (-0.5 * z * z).exp() / TAU.sqrt();
        let tail = density * series.iter().rev().fold(0.0, |sum, c| (sum + c) * t);
        let below = if z < 0.0 { tail } else { 1.0 - tail };
        let ahead = below / (density + z * below);
        Crossing { ahead, spread: (2.0 - ahead * (ahead + z)).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean above `z` and standard deviation of the density `v N(v; z, 1)`, `v > 0`, by a sum.
    fn summed(z: f64) -> [f64; 2] {
        let step = 1e-3;
        let (mut mass, mut mean, mut square) = (0.0, 0.0, 0.0);
        for i in 0..20_000 {
            let ahead = (-z).max(-10.0) + step * (f64::from(i) + 0.5);
            let density = (z + ahead) * (-0.5 * ahead * ahead).exp();
            mass += density;
            mean += density * ahead;
            square += density * ahead * ahead;
        }
        let mean = mean / mass;
        [mean, (square / mass - mean * mean).sqrt()]
    }

    #[test]
    fn crossing_paths_have_the_speeds_of_rice() {
        for i in -20..300 {
            let z = 0.1 * f64::from(i);
            let Crossing { ahead, spread } = Crossing::driven(z);
            let [exact_ahead, exact_spread] = summed(z);
            assert!((ahead - exact_ahead).abs() < 3e-4, "{z}: {ahead}, by the sum {exact_ahead}");
            assert!((spread - exact_spread).abs() < 3e-4, "{z}: {spread}, by the sum {exact_spread}");
        }
        assert_eq!(Crossing::driven(-1e30), Crossing::driven(-2.0));
        assert_eq!(Crossing::driven(1e30), Crossing::driven(100.0));
    }

    #[test]
    fn still_light_has_the_draw_and_fast_light_the_slope_of_all_paths() {
        let forgotten = SlopeLaw::between(0.3, 2.0, 40.0, 50.0);
        for rayleigh in [0.0, 0.5, 1.3, 4.0] {
            assert!((forgotten.at_event(0.0, rayleigh) - rayleigh).abs() < 1e-6, "{rayleigh}");
            let driven = forgotten.at_event(50.0, rayleigh);
            let normal = (rayleigh - FRAC_PI_2.sqrt()) / (2.0 - FRAC_PI_2).sqrt();
            assert!((driven - 0.02 - normal).abs() < 1e-3, "{rayleigh}: {driven}");
        }
        let mean = |light| forgotten.at_event(light, FRAC_PI_2.sqrt());
        for i in -10..100 {
            let light = 0.2 * f64::from(i);
            assert!(mean(light) > mean(light + 0.2) && mean(light) > 0.0, "{light}: {}", mean(light));
        }
    }

    /// What the law follows from: how fast the noise with a given deviate moves, and what of the slope's variance is known at
    /// the release and by the noise now.
    #[test]
    fn a_slope_is_that_of_the_noise_that_a_signal_meets() {
        for ratio in [0.05_f64, 1.0, 7.0] {
            for p in [0.03_f64, 0.3, 1.0, 4.0] {
                let q = p * ratio;
                let deviation = |p: f64, q: f64| (1.0 - correlation(p, q).powi(2)).sqrt();
                // In the clock in which a slope has the deviation 1.
                let step = 1e-4 * (p * q).sqrt();
                let along = |f: &dyn Fn(f64, f64) -> f64| {
                    let by = 5e-5;
                    (f(p * (1.0 + by), q * (1.0 + by)) - f(p * (1.0 - by), q * (1.0 - by))) / step
                };
                let widens = along(&deviation);
                for (released, deviate) in [(0.0, 1.0), (1.0, 0.0), (-2.0, 1.5)] {
                    let met = |p, q| correlation(p, q) * released + deviation(p, q) * deviate;
                    let law = SlopeLaw::between(released, met(p, q), p, q);
                    let moves = along(&met);
                    assert!((law.mean - moves).abs() < 1e-4, "{p} {q}: {law:?}, the path moves by {moves}");
                    let all = 1.0 - slope_correlation(p, q).powi(2);
                    let left = law.deviation.powi(2) + widens * widens;
                    assert!((left - all).abs() < 1e-4, "{p} {q}: {left} of {all}");
                }
            }
        }
    }

    #[test]
    fn no_instant_and_no_light_breaks_a_slope() {
        for exponent in [-80.0, -20.0, -5.0, 0.0, 5.0] {
            for ratio in [1e-9, 1.0, 1e9] {
                let p = f64::exp2(exponent);
                for light in [-1e30, -1.0, 0.0, 1.0, 1e30] {
                    for now in [-4.0, 1.0, 1.0 + 1e-7, 4.0] {
                        let law = SlopeLaw::between(1.0, now, p, p * ratio);
                        let slope = law.at_event(light, 1.0);
                        assert!(slope.abs() < 9.0, "{p} {ratio} {light} {now}: {slope}");
                    }
                }
            }
        }
        assert!(SlopeLaw::between(1.0, 1.0, 0.0, 0.0).at_event(1.0, 0.0).is_finite());
    }
}
