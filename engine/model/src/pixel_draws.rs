//! The random draws made once per pixel when a camera is created: two thresholds, and the leak or, of a physical pixel, its
//! factors.

use crate::physical::PhysicalDraws;
use crate::random::{PixelKey, Stream, leak_log_per_s, threshold_log};
use crate::{LOG_FRACTION_BITS, SensorModel, log_to_q24, q24_to_log};

/// Draws of all pixels, row-major, in the fixed point that the kernels use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PixelDraws {
    /// ON thresholds, Q7.24.
    pub contrast_on_q24: Vec<i32>,
    /// OFF thresholds, Q7.24.
    pub contrast_off_q24: Vec<i32>,
    /// Leak per nanosecond: Q7.24 times 2^32.
    pub leak_per_ns: Vec<u32>,
}

/// Units of a neper in the logarithms of [`SensorModel::pixel_factors`].
pub const FACTOR_UNITS: f64 = 2048.0;

impl SensorModel {
    /// Factors of the physical pixels of the camera with this number, row-major: logarithm of the dark current's in the
    /// low half of a word and of the leak's in the high half, signed, in units of 1 / [`FACTOR_UNITS`].
    #[must_use]
    pub fn pixel_factors(&self, camera: u32) -> Vec<u32> {
        let pixel = self.physical_pixel();
        let half = |factor: f64| u32::from((factor.ln() * FACTOR_UNITS).round() as i16 as u16);
        (0..self.pixels() as u32)
            .map(|index| {
                let key = PixelKey { seed: self.seed, camera, pixel: index };
                let draws = PhysicalDraws::draw(self, &pixel, key);
                half(draws.dark_factor) | half(draws.leak_factor) << 16
            })
            .collect()
    }

    /// Draws for the camera with this number. Cameras of different numbers draw independently.
    #[must_use]
    pub fn pixel_draws(&self, camera: u32) -> PixelDraws {
        // The leak lowers the reference towards an ON event. Its rate counts nominal ON thresholds per second.
        let nominal_log_per_s = self.leak_rate_hz * q24_to_log(log_to_q24(self.contrast_on));
        let mut draws = PixelDraws::default();
        for pixel in 0..self.pixels() as u32 {
            let key = PixelKey { seed: self.seed, camera, pixel };
            let threshold_q24 =
                |stream, contrast| log_to_q24(threshold_log(key, stream, contrast, self.contrast_mismatch));
            draws.contrast_on_q24.push(threshold_q24(Stream::ContrastOn, self.contrast_on));
            draws.contrast_off_q24.push(threshold_q24(Stream::ContrastOff, self.contrast_off));
            draws.leak_per_ns.push(leak_per_ns(leak_log_per_s(key, nominal_log_per_s, self.leak_spread_log)));
        }
        draws
    }
}

/// Converts a leak from nepers per second to Q7.24 per nanosecond, times 2^32.
fn leak_per_ns(leak_log_per_s: f64) -> u32 {
    (leak_log_per_s * 1e-9 * f64::from(1_u32 << LOG_FRACTION_BITS) * 4_294_967_296.0).round() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::MOST_LEAK_LOG_PER_S;

    #[test]
    fn a_leak_that_32_bits_do_not_hold_is_the_most_that_there_is() {
        let fast = SensorModel { leak_rate_hz: 100.0, contrast_on: 0.6, ..SensorModel::default() };
        let draws = SensorModel { width: 4, height: 2, ..fast }.pixel_draws(0);
        assert!(draws.leak_per_ns.iter().all(|&leak| leak == leak_per_ns(MOST_LEAK_LOG_PER_S)));
        assert!(leak_per_ns(MOST_LEAK_LOG_PER_S) < u32::MAX);
    }

    #[test]
    fn factors_are_logarithms_in_half_words() {
        let even = SensorModel { width: 8, height: 4, ..SensorModel::default() };
        assert_eq!(even.pixel_factors(0), [0; 32]);
        let uneven = SensorModel { dark_spread_log: 1.0, leak_spread_log: 0.5, ..even };
        for (pixel, word) in (0_u32..).zip(uneven.pixel_factors(3)) {
            let key = PixelKey { seed: uneven.seed, camera: 3, pixel };
            let draws = PhysicalDraws::draw(&uneven, &uneven.physical_pixel(), key);
            let dark_log = f64::from(word as u16 as i16) / FACTOR_UNITS;
            let leak_log = f64::from((word >> 16) as u16 as i16) / FACTOR_UNITS;
            assert!((dark_log - draws.dark_factor.ln()).abs() < 3e-4, "{pixel}: {dark_log}");
            assert!((leak_log - draws.leak_factor.ln()).abs() < 3e-4, "{pixel}: {leak_log}");
        }
    }

    #[test]
    fn without_mismatch_all_pixels_are_alike_and_with_it_they_differ() {
        let even = SensorModel { width: 8, height: 4, leak_rate_hz: 0.1, ..SensorModel::default() };
        let draws = even.pixel_draws(0);
        assert_eq!(draws.contrast_on_q24, vec![log_to_q24(even.contrast_on); 32]);
        assert_eq!(draws.contrast_off_q24, vec![log_to_q24(even.contrast_off); 32]);
        assert!(draws.leak_per_ns.iter().all(|&leak| leak == draws.leak_per_ns[0] && leak > 0));
        let uneven = SensorModel { contrast_mismatch: 0.03, leak_spread_log: 0.5, ..even };
        let draws = uneven.pixel_draws(0);
        assert!(draws.contrast_on_q24[0] != draws.contrast_on_q24[1]);
        assert!(draws.leak_per_ns[0] != draws.leak_per_ns[1]);
        assert_ne!(draws, uneven.pixel_draws(1), "another camera draws anew");
    }
}
