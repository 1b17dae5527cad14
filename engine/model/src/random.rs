//! Counter-based random numbers: the same draw on every device, for every tiling and sub-step count. Kernels draw
//! with integer arithmetic alone. Draws made once per pixel (thresholds, leak spread) are computed here in f64 and
//! uploaded.

/// Purpose of a draw. It is part of the counter, so that draws of different purposes are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Stream {
    /// ON threshold of a pixel.
    ContrastOn = 0,
    /// OFF threshold of a pixel.
    ContrastOff = 1,
    /// Leak spread of a pixel.
    Leak = 2,
    /// Waiting time to the next OFF shot-noise event.
    ShotOff = 3,
    /// Waiting time to the next ON shot-noise event.
    ShotOn = 4,
    /// Latency jitter of an event.
    Jitter = 5,
    /// Dark current of a pixel ([`physical`](crate::physical)).
    Dark = 6,
    /// Noise that a signal meets at the threshold.
    Threshold = 7,
    /// Hazard until a noise event, its polarity and slope.
    Clock = 8,
    /// What is new in a pixel's noise at a release.
    Release = 9,
    /// How far a pixel's leak has come when it is armed.
    LeakPhase = 10,
}

/// Fractional bits of an exponential draw.
pub const HAZARD_FRACTION_BITS: u32 = 27;

/// Identifies the pixel of a draw: seed, camera, position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelKey {
    /// The sensor's seed.
    pub seed: u64,
    /// The camera's number.
    pub camera: u32,
    /// `y * width + x`.
    pub pixel: u32,
}

/// Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011).
#[must_use]
pub fn philox4x32_10(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    let mut c = counter;
    let mut k = key;
    for _ in 0..10 {
        let first = u64::from(c[0]) * 0xD251_1F53;
        let second = u64::from(c[2]) * 0xCD9E_8D57;
        c = [
            (second >> 32) as u32 ^ c[1] ^ k[0],
            second as u32,
            (first >> 32) as u32 ^ c[3] ^ k[1],
            first as u32,
        ];
        k = [k[0].wrapping_add(0x9E37_79B9), k[1].wrapping_add(0xBB67_AE85)];
    }
    c
}

/// Four words for draw `index` of `stream` at a pixel.
#[must_use]
pub fn draw(key: PixelKey, stream: Stream, index: u32) -> [u32; 4] {
    philox4x32_10([index, stream as u32, key.pixel, key.camera], [key.seed as u32, (key.seed >> 32) as u32])
}

/// `log2(1 + x) / x` on `[0, 1]`, Q2.30, constant term first: Chebyshev interpolation of degree 8, error
/// below 4e-8.
pub const LOG2_COEFFICIENTS_Q30: [i32; 9] = [
    1_549_081_952,
    -774_532_405,
    516_125_028,
    -384_720_696,
    295_516_526,
    -210_709_970,
    120_078_775,
    -45_038_110,
    7_940_753,
];

/// Exp(1) from one random word, Q5.27, by integer arithmetic alone: `-ln((word | 2) / 2^32)`. Setting bit 1 keeps the
/// result below 2^5.
#[must_use]
pub fn exponential_q27(word: u32) -> u32 {
    let u = word | 2;
    let zeros = u.leading_zeros();
    // The mantissa without its leading one, Q31.
    let x = ((u << zeros) & 0x7fff_ffff) as i32;
    let times_x = |value: i32| (((i64::from(value) * i64::from(x)) >> 32) as i32) << 1;
    let polynomial =
        times_x(LOG2_COEFFICIENTS_Q30.iter().rev().fold(0, |sum, &coefficient| times_x(sum) + coefficient));
    // The polynomial's error may push the result above log2(2) = 1.
    let log2_q30 = polynomial.min(1 << 30);
    let minus_log2_q27 = ((zeros + 1) << HAZARD_FRACTION_BITS) - (log2_q30 >> 3) as u32;
    const LN2_Q32: u64 = 2_977_044_472;
    ((u64::from(minus_log2_q27) * LN2_Q32) >> 32) as u32
}

/// Exp(1) from one random word, as [`exponential_q27`] has it.
#[must_use]
pub fn exponential(word: u32) -> f64 {
    f64::from(exponential_q27(word)) / f64::from(1_u32 << HAZARD_FRACTION_BITS)
}

/// Latency jitter in nanoseconds: the sum of four uniform words (Irwin-Hall, a bell truncated at
/// 3.46 sigma) scaled to standard deviation `sigma_ns`, by integer arithmetic alone.
#[must_use]
pub fn jitter_ns(words: [u32; 4], sigma_ns: u32) -> i64 {
    let sum: i64 = words.iter().map(|&w| i64::from(w >> 4)).sum::<i64>() - (1_i64 << 29);
    // sum has standard deviation 2^28 / sqrt(3); sqrt(3) in Q12 is 7094.
    let unit_q12 = (sum * 7094) >> 28;
    (unit_q12 * i64::from(sigma_ns)) >> 12
}

/// Largest `|jitter|` that [`jitter_ns`] returns for a sigma.
#[must_use]
pub fn jitter_bound_ns(sigma_ns: u32) -> i64 {
    jitter_ns([u32::MAX; 4], sigma_ns).max(-jitter_ns([0; 4], sigma_ns))
}

/// One standard normal deviate of draw `index` (Box-Muller on two words).
#[must_use]
pub fn normal(key: PixelKey, stream: Stream, index: u32) -> f64 {
    let words = draw(key, stream, index);
    let unit = |word: u32| (f64::from(word) + 0.5) / 4_294_967_296.0;
    (-2.0 * unit(words[0]).ln()).sqrt() * (std::f64::consts::TAU * unit(words[1])).cos()
}

/// One standard normal deviate from four random words by additions and multiplications alone, so that every device gets
/// the same bits: the sum of eight uniform half words, scaled to a deviation of 1, through the odd polynomial that takes
/// its distribution to the normal one. They differ by less than 3e-5, and in the tail beyond 4 by half a percent; the
/// largest deviate is 6.6.
#[must_use]
pub fn normal_from_words(words: [u32; 4]) -> f64 {
    let sum: u32 = words.iter().map(|word| (word & 0xffff) + (word >> 16)).sum();
    // A half word has the mean 32767.5 and the variance (2^32 - 1) / 12.
    let s = (f64::from(sum) - 262_140.0) * (1.5_f64 / 4_294_967_295.0).sqrt();
    let square = s * s;
    s * (0.980_888_271 + square * (6.144_712e-3 + square * (2.7378e-5 + square * 1.4452e-5)))
}

/// A pixel's factor relative to a nominal value: `exp(N(0, spread))`.
#[must_use]
pub fn log_normal(key: PixelKey, stream: Stream, spread_log: f64) -> f64 {
    if spread_log == 0.0 { 1.0 } else { (spread_log * normal(key, stream, 0)).exp() }
}

/// A pixel's threshold: `N(nominal, sigma)`, redrawn until inside `[0.1, 1.9] * nominal`.
#[must_use]
pub fn threshold_log(key: PixelKey, stream: Stream, nominal_log: f64, sigma_log: f64) -> f64 {
    if sigma_log == 0.0 {
        return nominal_log;
    }
    (0..64)
        .map(|index| nominal_log + sigma_log * normal(key, stream, index))
        .find(|c| (0.1 * nominal_log..=1.9 * nominal_log).contains(c))
        .unwrap_or(nominal_log)
}

/// A pixel's leak relative to the nominal one: `exp(N(0, spread))`.
#[must_use]
pub fn leak_factor(key: PixelKey, spread_log: f64) -> f64 {
    log_normal(key, Stream::Leak, spread_log)
}

/// How far the leak of a pixel has come when it is armed after `events` events, as a share of the way to its threshold:
/// uniform in [0, 1), as in a pixel that has looked at still light for long.
#[must_use]
pub fn leak_phase(key: PixelKey, events: u32) -> f64 {
    f64::from(draw(key, Stream::LeakPhase, events)[0] >> 8) / 16_777_216.0
}

/// The same of a log pixel with shot noise, which begins its leak anew at each shot. `shots` is how many of both polarities are
/// expected in a leak period. A pixel has leaked since its last shot, which is an exponential time ago, or since a leak event
/// after that. A shot further back than a leak period is drawn again, which is the same law, and after three such draws left
/// out.
#[must_use]
pub fn leak_phase_among_shots(key: PixelKey, shots: f64) -> f64 {
    let words = draw(key, Stream::LeakPhase, 0);
    words[1..]
        .iter()
        .map(|&word| exponential(word))
        .find(|&since_shot| since_shot < shots)
        .map_or_else(|| leak_phase(key, 0), |since_shot| since_shot / shots)
}

/// Most that a log pixel leaks, nepers a second. The engine holds a leak in 32 bits.
pub const MOST_LEAK_LOG_PER_S: f64 = 59.0;

/// How fast a log pixel's reference falls by its leak, nepers a second; at most [`MOST_LEAK_LOG_PER_S`].
#[must_use]
pub fn leak_log_per_s(key: PixelKey, nominal_log_per_s: f64, spread_log: f64) -> f64 {
    (nominal_log_per_s * leak_factor(key, spread_log)).min(MOST_LEAK_LOG_PER_S)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn philox_matches_the_published_vectors() {
        // Random123's kat_vectors, philox4x32 10.
        assert_eq!(philox4x32_10([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(
            philox4x32_10([u32::MAX; 4], [u32::MAX; 2]),
            [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]
        );
        assert_eq!(
            philox4x32_10([0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344], [0xa409_3822, 0x299f_31d0]),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    #[test]
    fn exponential_is_minus_ln() {
        for word in [1, 2, 3, 1000, 0x7fff_ffff, 0x8000_0000, 0xdead_beef, u32::MAX] {
            let exact = -(f64::from(word | 2) / 4_294_967_296.0).ln();
            let got = exponential(word);
            assert!((got - exact).abs() < 6e-8, "{word}: {got} against {exact}");
        }
    }

    #[test]
    fn normal_from_words_is_normal_to_its_tails() {
        let key = |pixel| PixelKey { seed: 5, camera: 0, pixel };
        let draws: Vec<f64> =
            (0..400_000).map(|p| normal_from_words(draw(key(p), Stream::Release, 0))).collect();
        let moment = |power| draws.iter().map(|z| z.powi(power)).sum::<f64>() / draws.len() as f64;
        for (power, exact, bound) in [(1, 0.0, 0.006), (2, 1.0, 0.009), (3, 0.0, 0.025), (4, 3.0, 0.06)] {
            assert!((moment(power) - exact).abs() < bound, "moment {power}: {}", moment(power));
        }
        for (bound, share) in [(1.0, 0.158_655), (2.0, 0.022_750), (3.0, 0.001_350), (4.0, 3.167e-5)] {
            let above = draws.iter().filter(|&&z| z > bound).count() as f64 / draws.len() as f64;
            let deviation = (share * (1.0 - share) / draws.len() as f64).sqrt();
            assert!((above - share).abs() < 4.0 * deviation, "above {bound}: {above}");
        }
        assert!(normal_from_words([u32::MAX; 4]) < 6.6 && normal_from_words([0; 4]) > -6.6);
    }

    #[test]
    fn jitter_has_the_stated_deviation_and_bound() {
        let key = |pixel| PixelKey { seed: 7, camera: 0, pixel };
        let draws: Vec<f64> =
            (0..40_000).map(|p| jitter_ns(draw(key(p), Stream::Jitter, 0), 10_000) as f64).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let deviation = (draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / draws.len() as f64).sqrt();
        assert!(mean.abs() < 200.0, "{mean}");
        assert!((deviation - 10_000.0).abs() < 150.0, "{deviation}");
        assert!(draws.iter().all(|d| d.abs() <= jitter_bound_ns(10_000) as f64));
        assert!(jitter_bound_ns(10_000) < 34_700);
    }

    #[test]
    fn thresholds_stay_positive_and_keep_their_mean() {
        let draws: Vec<f64> = (0..20_000)
            .map(|pixel| threshold_log(PixelKey { seed: 1, camera: 3, pixel }, Stream::ContrastOn, 0.2, 0.15))
            .collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        assert!(draws.iter().all(|&c| (0.02..=0.38).contains(&c)));
        assert!((mean - 0.2).abs() < 0.002, "{mean}");
    }
}
