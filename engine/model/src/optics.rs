//! What a lens and a lamp do to light, before a pixel sees it.
//!
//! Everything here is about intensity `S`, in linear light, before the logarithm:
//! - **Blur.** `psf_sigma_px` is the standard deviation of a Gaussian ([`psf_weights`]). A pixel's intensity is the
//!   weighted mean of the valid pixels up to [`PSF_RADIUS_PX`] away along each axis; beyond the image the border pixels
//!   repeat. A mosaic is sampled after it.
//! - **Vignetting.** Light that meets a pinhole lens at the angle `theta` to its axis is weaker by `cos^4 theta`
//!   ([`vignetting`]).
//! - **Flicker.** Frames are rendered in steady light. A lamp that flickers makes the intensity at a time `t`
//!   `S(t) (1 + M sin(2 pi f t + phase))` ([`Flicker`]), at every end of a sub-step. The level is
//!   `ln(S (1 + M sin) + dark)`: dark current does not flicker. A rate that follows the light of an interval's frames
//!   (shot noise) follows the steady light.

use crate::SensorModel;
use crate::substeps::FLICKER_SUBSTEPS;

/// How far light is spread, pixels along each axis: what `ingest` reads around a tile for a blurred frame.
pub const PSF_RADIUS_PX: usize = 3;

/// Largest standard deviation of the blur, pixels: three of it are within [`PSF_RADIUS_PX`].
pub const PSF_MOST_SIGMA_PX: f64 = 1.0;

/// Weights of the blur at distances 0 to [`PSF_RADIUS_PX`] along one axis; over both sides they sum to 1. They are those
/// of the discrete Gaussian `e^-s I_n(s)`, `s = sigma^2`, whose variance is that of the Gaussian for any sigma.
#[must_use]
pub fn psf_weights(sigma_px: f64) -> [f64; PSF_RADIUS_PX + 1] {
    let half = 0.5 * sigma_px * sigma_px;
    let weight = |n: usize| {
        // I_n(s) as its series.
        let mut term = (1..=n).fold(1.0, |product, k| product * half / k as f64);
        let mut sum = term;
        for m in 1..12 {
            term *= half * half / (m * (m + n)) as f64;
            sum += term;
        }
        sum
    };
    let weights: [f64; PSF_RADIUS_PX + 1] = std::array::from_fn(weight);
    let sum: f64 = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    weights.map(|weight| weight / sum)
}

/// Focal length, pixels, of a pinhole lens with the horizontal field of view `fov_deg` over `width_px` pixels.
#[must_use]
pub fn focal_px(width_px: u32, fov_deg: f64) -> f64 {
    0.5 * f64::from(width_px) / (0.5 * fov_deg).to_radians().tan()
}

/// Share of the light that the vignetting leaves at pixel `(x, y)`: 1 at the centre of the image, and everywhere for a
/// sensor without it.
#[must_use]
pub fn vignetting(sensor: &SensorModel, x: u32, y: u32) -> f64 {
    if sensor.vignetting_fov_deg == 0.0 {
        return 1.0;
    }
    let from_centre = |at: u32, size: u32| f64::from(at) - 0.5 * (f64::from(size) - 1.0);
    let (dx, dy) = (from_centre(x, sensor.width), from_centre(y, sensor.height));
    let focal = focal_px(sensor.width, sensor.vignetting_fov_deg);
    let tangent = dx.hypot(dy) / focal;
    // cos^2 = 1 / (1 + tan^2).
    1.0 / (1.0 + tangent * tangent).powi(2)
}

/// A lamp that flickers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flicker {
    /// Frequency, Hz.
    pub hz: f64,
    /// Depth `M`, above 0 and at most 1.
    pub depth: f64,
    /// Phase at time 0, degrees.
    pub phase_deg: f64,
}

impl Flicker {
    /// Phase at a time, turns, from 0 up to but not including 1. It is exact to some 1e-12 turns for times since 1970, too.
    #[must_use]
    pub fn turns(&self, t_ns: i64) -> f64 {
        const SECOND_NS: i64 = 1_000_000_000;
        let (seconds, rest_ns) = (t_ns.div_euclid(SECOND_NS) as f64, t_ns.rem_euclid(SECOND_NS) as f64);
        // Turns of whole seconds are many: the product's rounding error is added back.
        let product = self.hz * seconds;
        let error = self.hz.mul_add(seconds, -product);
        let turns = (product.rem_euclid(1.0) + error) + self.hz * rest_ns * 1e-9 + self.phase_deg / 360.0;
        // `rem_euclid` of a tiny negative number is 1.
        turns.rem_euclid(1.0) % 1.0
    }

    /// Factor of the light at a time.
    #[must_use]
    pub fn factor(&self, t_ns: i64) -> f64 {
        1.0 + self.depth * (std::f64::consts::TAU * self.turns(t_ns)).sin()
    }

    /// Sub-steps that an interval needs so that none is longer than a part in [`FLICKER_SUBSTEPS`] of a period.
    #[must_use]
    pub fn substeps(&self, interval_ns: u32) -> u32 {
        (f64::from(FLICKER_SUBSTEPS) * self.hz * f64::from(interval_ns) * 1e-9).ceil() as u32
    }
}

impl SensorModel {
    /// The lamp's flicker, if there is any.
    #[must_use]
    pub fn flicker(&self) -> Option<Flicker> {
        (self.flicker_depth > 0.0).then_some(Flicker {
            hz: self.flicker_hz,
            depth: self.flicker_depth,
            phase_deg: self.flicker_phase_deg,
        })
    }

    /// What to tell if an interval of this length has too few sub-steps for the flicker; `None` if it has enough.
    #[must_use]
    pub fn flicker_warning(&self, interval_ns: u32) -> Option<String> {
        let needed = self.flicker()?.substeps(interval_ns);
        let ms = f64::from(interval_ns) * 1e-6;
        (needed > self.substeps).then(|| {
            format!(
                "a flicker of {} Hz needs {needed} sub-steps in an interval of {ms:.1} ms, {FLICKER_SUBSTEPS} for each \
                 period, and `substeps` allows {}: its events are {}; render more frames per second or raise `substeps`",
                self.flicker_hz,
                self.substeps,
                if 4 * self.substeps < needed { "aliased" } else { "coarse" },
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_blur_has_its_variance_and_loses_no_light() {
        for sigma_px in [0.01, 0.1, 0.3, 0.5, 0.7, PSF_MOST_SIGMA_PX] {
            let weights = psf_weights(sigma_px);
            let sum: f64 = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
            assert!((sum - 1.0).abs() < 1e-15, "{sigma_px}: {sum}");
            let variance: f64 = weights.iter().enumerate().map(|(n, w)| 2.0 * (n * n) as f64 * w).sum();
            let error = variance.sqrt() / sigma_px - 1.0;
            assert!(error.abs() < if sigma_px > 0.7 { 0.02 } else { 0.005 }, "{sigma_px}: {error}");
            assert!(weights.windows(2).all(|pair| pair[0] > pair[1]), "{weights:?}");
        }
        assert_eq!(psf_weights(0.0), [1.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn corners_darken_by_the_fourth_power_of_the_cosine() {
        let sensor =
            SensorModel { width: 101, height: 81, vignetting_fov_deg: 90.0, ..SensorModel::default() };
        assert_eq!(vignetting(&sensor, 50, 40), 1.0);
        // The border of the image, half a pixel beyond the last one, is at 45 degrees.
        let expected = (50.0_f64 / 50.5).atan().cos().powi(4);
        assert!((vignetting(&sensor, 100, 40) - expected).abs() < 1e-12);
        assert_eq!(vignetting(&sensor, 0, 0), vignetting(&sensor, 100, 80));
        assert_eq!(vignetting(&SensorModel { vignetting_fov_deg: 0.0, ..sensor }, 0, 0), 1.0);
    }

    #[test]
    fn the_phase_is_exact_for_times_since_1970() {
        const EPOCH_NS: i64 = 1_764_000_000_000_000_000;
        for (hz, depth) in [(100.0, 0.3), (120.0, 1.0), (99.9, 0.1)] {
            let lamp = Flicker { hz, depth, phase_deg: 30.0 };
            for t_ns in [0, 1, 123_456_789, EPOCH_NS + 987_654_321, -5_000_000_001] {
                // Tenths of a hertz times nanoseconds are whole numbers.
                let tenths = i128::from((hz * 10.0).round() as i64) * i128::from(t_ns);
                let exact = (tenths.rem_euclid(10_000_000_000) as f64 / 1e10 + 30.0 / 360.0).rem_euclid(1.0);
                let off = (lamp.turns(t_ns) - exact + 0.5).rem_euclid(1.0) - 0.5;
                // A frequency is an f64: 99.9 Hz is off by 1e-15 of it, over 55 years by 3e-6 turns.
                let tolerance = if hz == 99.9 && t_ns > EPOCH_NS { 2e-5 } else { 1e-11 };
                assert!(off.abs() < tolerance, "{hz} Hz at {t_ns}: {off}");
                assert!((0.0..1.0).contains(&lamp.turns(t_ns)));
                assert!((0.0..=2.0).contains(&lamp.factor(t_ns)));
            }
        }
    }

    #[test]
    fn substeps_follow_the_flicker_or_it_is_told() {
        let sensor = SensorModel { flicker_depth: 0.3, substeps: 32, ..SensorModel::default() };
        assert_eq!(sensor.flicker().map(|lamp| lamp.substeps(33_333_333)), Some(27), "100 Hz at 30 Hz");
        assert_eq!(sensor.flicker_warning(33_333_333), None);
        let slow = sensor.flicker_warning(100_000_000).expect("80 sub-steps");
        assert!(
            slow.contains("needs 80 sub-steps") && slow.contains("allows 32: its events are coarse"),
            "{slow}"
        );
        assert!(sensor.flicker_warning(500_000_000).expect("400").contains("aliased"));
        assert_eq!(SensorModel { flicker_depth: 0.0, ..sensor }.flicker_warning(500_000_000), None);
    }
}
