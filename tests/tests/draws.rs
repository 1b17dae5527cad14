//! Compares the engine's random draws with a second implementation of the generator. It shares no code with the engine
//! or the oracle: it follows the published description of Philox and the model's documentation. The times of the
//! engine's events reveal its draws of thresholds and leak. How pixels are armed by such draws is compared with the oracle.

use esaac_engine::{Rig, RigOptions};
use esaac_layout::StateWord;
use esaac_model::{Pixel, Polarity, SensorModel, Synthesis, q24_to_log};
use esaac_oracle::Oracle;
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{Sequence, gray, intensity_of};
use esaac_tests::run::{Step, engine_of_many, events, rig, step};
use std::f64::consts::{SQRT_2, TAU};

/// Second implementation of the generator and of the draws made from its words.
mod second {
    /// Philox 4x32 with ten rounds: Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3",
    /// SC 2011. A round multiplies the even words, swaps the halves of the products and mixes in odd words and key.
    pub fn philox(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
        let [mut left0, mut right0, mut left1, mut right1] = counter;
        for round in 0..10_u32 {
            // Each round adds the golden ratio and the square root of three less one to the key's words, as fractions
            // of 2^32.
            let key0 = key[0].wrapping_add(round.wrapping_mul(0x9E37_79B9));
            let key1 = key[1].wrapping_add(round.wrapping_mul(0xBB67_AE85));
            let (high0, low0) = halves(0xD251_1F53, left0);
            let (high1, low1) = halves(0xCD9E_8D57, left1);
            (left0, left1) = (high1 ^ right0 ^ key0, high0 ^ right1 ^ key1);
            (right0, right1) = (low1, low0);
        }
        [left0, right0, left1, right1]
    }

    fn halves(a: u32, b: u32) -> (u32, u32) {
        let product = u128::from(a) * u128::from(b);
        ((product / (1 << 32)) as u32, (product % (1 << 32)) as u32)
    }

    /// Numbers of the streams, as in the model.
    pub const CONTRAST_ON: u32 = 0;
    pub const CONTRAST_OFF: u32 = 1;
    pub const LEAK: u32 = 2;
    pub const SHOT_OFF: u32 = 3;
    pub const SHOT_ON: u32 = 4;
    pub const JITTER: u32 = 5;
    pub const LEAK_PHASE: u32 = 10;

    /// A pixel of a camera.
    #[derive(Clone, Copy)]
    pub struct At {
        pub seed: u64,
        pub camera: u32,
        pub pixel: u32,
    }

    /// The words of a draw.
    pub fn philox_of(at: At, stream: u32, index: u32) -> [u32; 4] {
        philox(
            [index, stream, at.pixel, at.camera],
            [(at.seed % (1 << 32)) as u32, (at.seed / (1 << 32)) as u32],
        )
    }

    /// A standard normal deviate by Box and Muller's method, from the first two words as fractions of 2^32, plus half a
    /// unit.
    pub fn normal(at: At, stream: u32, index: u32) -> f64 {
        let [first, second, ..] = philox_of(at, stream, index);
        let [u, v] = [first, second].map(|word| (f64::from(word) + 0.5) * 2.0_f64.powi(-32));
        (-2.0 * u.ln()).sqrt() * (super::TAU * v).cos()
    }

    /// A threshold, and the number of draws rejected because they lay outside 0.1 to 1.9 times the nominal threshold.
    pub fn threshold(at: At, stream: u32, nominal: f64, sigma: f64) -> (f64, u32) {
        let mut index = 0;
        loop {
            let drawn = nominal + sigma * normal(at, stream, index);
            if drawn >= 0.1 * nominal && drawn <= 1.9 * nominal {
                return (drawn, index);
            }
            index += 1;
        }
    }

    /// Leak relative to the nominal leak.
    pub fn leak_factor(at: At, spread_log: f64) -> f64 {
        (spread_log * normal(at, LEAK, 0)).exp()
    }

    /// The part of its threshold that a pixel without shot noise has leaked before it is armed, in units of 2^-24.
    pub fn leak_phase(at: At) -> f64 {
        let [word, ..] = philox_of(at, LEAK_PHASE, 0);
        f64::from(word / 256) * 2.0_f64.powi(-24)
    }
}

const SIDE_PX: u32 = 64;

/// Seed that sets bits in both words of the key.
const SEED: u64 = 0x1f3c_51d2_8ab0_47e6;

/// One interval of the greatest length, so that the time of an event resolves thresholds finely.
const INTERVAL_NS: i64 = 1_000_000_000;

/// How far a threshold computed from an event may be from the drawn one, nepers: rounding to Q7.24, and f32 levels and
/// times.
const TOLERANCE_LOG: f64 = 2e-6;

/// How far the time of a leak event may be off, seconds.
const TOLERANCE_S: f64 = 2e-6;

/// Standard errors within which a statistic of independent draws must lie.
const STANDARD_ERRORS: f64 = 5.0;

/// Rise or fall of the light, nepers. It exceeds every threshold.
const SWING_LOG: f64 = 0.9;

fn sensor() -> SensorModel {
    SensorModel {
        width: SIDE_PX,
        height: SIDE_PX,
        synthesis: Synthesis::None,
        contrast_on: 0.2,
        contrast_off: 0.3,
        contrast_mismatch: 0.02,
        seed: SEED,
        ..SensorModel::default()
    }
}

/// Light that changes by `change_log` over the interval, the same at every pixel.
fn light(sensor: &SensorModel, change_log: f64) -> Sequence {
    gray(sensor, &[0, INTERVAL_NS], |frame, _| intensity_of(sensor, change_log * frame as f64))
}

/// Seconds until each pixel's first event.
fn first_event_s(steps: &[Step]) -> Vec<f64> {
    let mut first = vec![f64::NAN; (SIDE_PX * SIDE_PX) as usize];
    for event in events(steps) {
        let time_s = &mut first[usize::from(event.y) * SIDE_PX as usize + usize::from(event.x)];
        if time_s.is_nan() {
            *time_s = event.t_ns as f64 * 1e-9;
        }
    }
    assert!(first.iter().all(|t| t.is_finite()), "each pixel sends an event");
    first
}

fn at(camera: u32, pixel: usize) -> second::At {
    second::At { seed: SEED, camera, pixel: pixel as u32 }
}

#[test]
fn the_second_generator_matches_the_published_vectors() {
    // Known answers from Random123's kat_vectors, philox4x32 10.
    assert_eq!(second::philox([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
    assert_eq!(
        second::philox([u32::MAX; 4], [u32::MAX; 2]),
        [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]
    );
    // Counter and key are the digits of pi.
    assert_eq!(
        second::philox([0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344], [0xa409_3822, 0x299f_31d0]),
        [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
    );
}

#[test]
fn the_oracle_draws_what_the_documentation_says() {
    let sensor = SensorModel { contrast_mismatch: 0.1, leak_rate_hz: 3.0, leak_spread_log: 0.4, ..sensor() };
    let mut drawn_again = 0;
    for camera in [0, 7] {
        let oracle = Oracle::new(sensor.clone(), camera).expect("a valid sensor");
        for (pixel, drawn) in oracle.constants().iter().enumerate() {
            let at = at(camera, pixel);
            let (off, again) =
                second::threshold(at, second::CONTRAST_OFF, sensor.contrast_off, sensor.contrast_mismatch);
            let (on, more) =
                second::threshold(at, second::CONTRAST_ON, sensor.contrast_on, sensor.contrast_mismatch);
            drawn_again += again.min(1) + more.min(1);
            let leak = 1e-9
                * sensor.leak_rate_hz
                * sensor.contrast_on
                * second::leak_factor(at, sensor.leak_spread_log);
            let expected = [off, on, leak];
            let actual = [drawn.threshold_log[0], drawn.threshold_log[1], drawn.leak_log_per_ns];
            for (expected, actual) in expected.iter().zip(actual) {
                assert!(
                    (actual / expected - 1.0).abs() < 1e-12,
                    "pixel {pixel}: {actual}, expected {expected}"
                );
            }
        }
    }
    // 7.2% of the ON thresholds lie beyond 1.8 deviations, .7% of the OFF thresholds beyond 2.7.
    let expected = 0.079 * 2.0 * sensor.pixels() as f64;
    assert!((f64::from(drawn_again) / expected - 1.0).abs() < 0.2, "{drawn_again} of about {expected:.0}");
}

#[test]
fn the_engine_draws_what_the_documentation_says() {
    let wide = SensorModel { contrast_mismatch: 0.1, ..sensor() };
    let leaky = SensorModel { leak_rate_hz: 10.0, leak_spread_log: 0.3, ..sensor() };
    let cameras = [
        (sensor(), light(&sensor(), SWING_LOG)),
        (sensor(), light(&sensor(), -SWING_LOG)),
        (wide.clone(), light(&wide, SWING_LOG)),
        (leaky.clone(), light(&leaky, 0.0)),
    ];
    let runs = engine_of_many(&cameras, RigOptions::default());
    assert_silent();
    // At a pixel's first event the level equals its threshold.
    let seen_log = |camera: usize| -> Vec<f64> {
        first_event_s(&runs[camera]).into_iter().map(|t_s| SWING_LOG * t_s).collect()
    };
    let (on, off, wide_on) = (seen_log(0), seen_log(1), seen_log(2));
    for (camera, (stream, nominal, seen)) in (0_u32..).zip([
        (second::CONTRAST_ON, wide.contrast_on, &on),
        (second::CONTRAST_OFF, wide.contrast_off, &off),
        (second::CONTRAST_ON, wide.contrast_on, &wide_on),
    ]) {
        let sigma = cameras[camera as usize].0.contrast_mismatch;
        for (pixel, seen) in seen.iter().enumerate() {
            let (drawn, _) = second::threshold(at(camera, pixel), stream, nominal, sigma);
            assert!(
                (seen - drawn).abs() <= TOLERANCE_LOG,
                "camera {camera}, pixel {pixel}: threshold {seen}, expected {drawn}"
            );
        }
    }
    let leak_s = first_event_s(&runs[3]);
    for (pixel, seen_s) in leak_s.iter().enumerate() {
        let at = at(3, pixel);
        let (threshold, _) =
            second::threshold(at, second::CONTRAST_ON, leaky.contrast_on, leaky.contrast_mismatch);
        let rate_log_per_s =
            leaky.leak_rate_hz * leaky.contrast_on * second::leak_factor(at, leaky.leak_spread_log);
        let expected_s = threshold * (1.0 - second::leak_phase(at)) / rate_log_per_s;
        assert!(
            (seen_s - expected_s).abs() <= TOLERANCE_S,
            "pixel {pixel}: first leak event at {seen_s} s, expected {expected_s} s"
        );
    }

    // Independently of the generator, the draws must have the right distribution.
    let deviations = |seen: &[f64], nominal: f64| -> Vec<f64> {
        seen.iter().map(|c| (c - nominal) / sensor().contrast_mismatch).collect()
    };
    let (on, off) = (deviations(&on, sensor().contrast_on), deviations(&off, sensor().contrast_off));
    assert_eq!(check_normal(&on), Ok(()));
    assert_eq!(check_normal(&off), Ok(()));
    assert!(correlation(&on, &off).abs() < STANDARD_ERRORS / (on.len() as f64).sqrt());
}

/// Jitter is drawn by the kernels. It too must follow the documentation. No delay is below zero.
#[test]
fn jitter_is_what_the_documentation_says() {
    let plain = SensorModel { contrast_mismatch: 0.0, ..sensor() };
    let delayed = |latency_ns| SensorModel { latency_ns, latency_jitter_ns: 10_000_000, ..plain.clone() };
    // Of the second one's draws, half would be below zero.
    let sensors = [plain.clone(), delayed(40_000_000), delayed(1_000_000)];
    let rise = light(&plain, 0.3);
    let runs = engine_of_many(&sensors.clone().map(|sensor| (sensor, rise.clone())), RigOptions::default());
    assert_silent();
    let plain_s = first_event_s(&runs[0]);
    for (camera, sensor) in (0_u32..).zip(&sensors).skip(1) {
        let delayed_s = first_event_s(&runs[camera as usize]);
        let mut at_once = 0;
        for (pixel, (delayed_s, plain_s)) in delayed_s.iter().zip(&plain_s).enumerate() {
            // The sum of four words, of standard deviation 2^32 / sqrt(3); sqrt(3) is 7094 in twelve bits.
            let words = second::philox_of(at(camera, pixel), second::JITTER, 0);
            let sum: i128 = words.iter().map(|&word| i128::from(word / 16)).sum::<i128>() - (1 << 29);
            let jitter_ns = (sum * 7094).div_euclid(1 << 28) * i128::from(sensor.latency_jitter_ns);
            let expected_ns = (i128::from(sensor.latency_ns) + jitter_ns.div_euclid(1 << 12)).max(0);
            at_once += u32::from(expected_ns == 0);
            let seen_ns = ((delayed_s - plain_s) * 1e9).round() as i128;
            assert_eq!(seen_ns, expected_ns, "camera {camera}, pixel {pixel}");
        }
        assert_eq!(at_once > 0, camera == 2, "camera {camera}: {at_once} events without delay");
    }
}

/// How far the time of a shot event may be off, seconds: hazards are integers, and their times are computed in f32.
const SHOT_TOLERANCE_S: f64 = 2e-6;

/// Each polarity of a pixel sends its shot events after waits of its own, one draw after the other. A pixel with a
/// smaller threshold waits less.
#[test]
fn shot_events_come_when_the_documentation_says() {
    let even = SensorModel { contrast_mismatch: 0.0, shot_noise_rate_hz: 50.0, ..sensor() };
    let uneven = SensorModel { contrast_mismatch: 0.05, ..even.clone() };
    let sensors = [even, uneven];
    let runs = engine_of_many(
        &sensors.clone().map(|sensor| (sensor.clone(), gray(&sensor, &[0, INTERVAL_NS], |_, _| 0.0))),
        RigOptions::default(),
    );
    assert_silent();
    for (camera, (sensor, steps)) in (0..).zip(sensors.iter().zip(&runs)) {
        let mut seen = vec![Vec::new(); 2 * sensor.pixels()];
        for event in events(steps) {
            let pixel = usize::from(event.y) * SIDE_PX as usize + usize::from(event.x);
            seen[2 * pixel + usize::from(event.polarity == Polarity::On)].push(event.t_ns as f64 * 1e-9);
        }
        for (number, seen_s) in seen.iter().enumerate() {
            let (pixel, is_on) = (number / 2, number % 2 == 1);
            let expected_s = shots_s(sensor, at(camera, pixel), is_on);
            // The last one may lie on either side of the interval's end.
            let until = |end_s: f64| expected_s.iter().filter(|&&t_s| t_s < end_s).count();
            let counts = until(1.0 - SHOT_TOLERANCE_S)..=until(1.0 + SHOT_TOLERANCE_S);
            assert!(
                counts.contains(&seen_s.len()),
                "camera {camera}, pixel {pixel}, ON {is_on}: {} events, expected {counts:?}",
                seen_s.len()
            );
            for (seen_s, expected_s) in seen_s.iter().zip(&expected_s) {
                assert!(
                    (seen_s - expected_s).abs() < SHOT_TOLERANCE_S,
                    "camera {camera}, pixel {pixel}, ON {is_on}: {seen_s} s, expected {expected_s} s"
                );
            }
        }
    }
}

/// When a pixel in the dark sends shot events of a polarity, seconds, up to the first one after a second.
fn shots_s(sensor: &SensorModel, at: second::At, is_on: bool) -> Vec<f64> {
    let (stream, threshold_stream, nominal) = if is_on {
        (second::SHOT_ON, second::CONTRAST_ON, sensor.contrast_on)
    } else {
        (second::SHOT_OFF, second::CONTRAST_OFF, sensor.contrast_off)
    };
    let threshold = match sensor.contrast_mismatch {
        0.0 => nominal,
        sigma => second::threshold(at, threshold_stream, nominal, sigma).0,
    };
    // Each polarity has half the rate.
    let wait_s = threshold / nominal / (0.5 * sensor.shot_noise_rate_hz);
    let mut times_s = Vec::new();
    let mut t_s = 0.0;
    for index in 0.. {
        let word = second::philox_of(at, stream, index)[0];
        t_s -= (f64::from(word | 2) * 2.0_f64.powi(-32)).ln() * wait_s;
        times_s.push(t_s);
        if t_s > 1.0 + SHOT_TOLERANCE_S {
            break;
        }
    }
    times_s
}

/// Whether deviations are independent standard normal draws: tests moments, shape and correlation of neighbours.
fn check_normal(deviations: &[f64]) -> Result<(), String> {
    let n = deviations.len() as f64;
    let moment = |power: i32| deviations.iter().map(|d| d.powi(power)).sum::<f64>() / n;
    let limits = [
        ("mean", moment(1), 0.0, 1.0),
        ("variance", moment(2), 1.0, 2.0_f64.sqrt()),
        ("third moment", moment(3), 0.0, 15.0_f64.sqrt()),
        ("fourth moment", moment(4), 3.0, 96.0_f64.sqrt()),
    ];
    for (what, actual, expected, deviation) in limits {
        if (actual - expected).abs() > STANDARD_ERRORS * deviation / n.sqrt() {
            return Err(format!("{what} {actual}, expected {expected}"));
        }
    }
    for (what, apart) in [("columns", 1), ("rows", SIDE_PX as usize)] {
        let r = correlation(&deviations[apart..], &deviations[..deviations.len() - apart]);
        if r.abs() > STANDARD_ERRORS / n.sqrt() {
            return Err(format!("neighbouring {what} correlate by {r}"));
        }
    }
    // Kolmogorov-Smirnov distance. One of a thousand right samples exceeds the limit.
    let mut sorted = deviations.to_vec();
    sorted.sort_by(f64::total_cmp);
    let distance = (0..).zip(&sorted).map(|(i, &d)| {
        let share = normal_share_below(d);
        (share - f64::from(i) / n).abs().max((f64::from(i + 1) / n - share).abs())
    });
    let distance = distance.fold(0.0, f64::max);
    if distance > 1.95 / n.sqrt() {
        Err(format!("distance {distance} from a normal distribution"))
    } else {
        Ok(())
    }
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / a.len() as f64
}

/// Share of a standard normal distribution below `d`: Abramowitz and Stegun, 7.1.26, to 2e-7.
fn normal_share_below(d: f64) -> f64 {
    let x = d.abs() / SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let polynomial = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592]
        .iter()
        .fold(0.0, |sum, coefficient| (sum + coefficient) * t);
    let above = 0.5 * polynomial * (-x * x).exp();
    if d < 0.0 { above } else { 1.0 - above }
}

#[test]
fn draws_that_are_wrong_are_found() {
    let right: Vec<f64> =
        (0..(SIDE_PX * SIDE_PX) as usize).map(|pixel| second::normal(at(0, pixel), 9, 0)).collect();
    assert_eq!(check_normal(&right), Ok(()));
    let wrong: [(&str, Vec<f64>); 5] = [
        ("off centre", right.iter().map(|d| d + 0.1).collect()),
        ("too wide", right.iter().map(|d| 1.08 * d).collect()),
        ("uniform", right.iter().map(|&d| 12.0_f64.sqrt() * (normal_share_below(d) - 0.5)).collect()),
        ("two a draw", (0..right.len()).map(|i| right[i & !1]).collect()),
        ("every row the same", (0..right.len()).map(|i| right[i % SIDE_PX as usize]).collect()),
    ];
    for (what, deviations) in wrong {
        assert!(check_normal(&deviations).is_err(), "{what}");
    }
}

/// How far the reference of an armed log pixel may be from the oracle's, nepers, and that of a physical pixel, whose factors have
/// half a word each.
const REFERENCE_TOLERANCE_LOG: [f64; 2] = [1e-6, 1.5e-4];

/// Asserts that the engine's pixels of which `chosen` holds have the references of the oracle's, `age_ns` after the first frame.
#[track_caller]
fn check_references(rig: &Rig, oracle: &Oracle, age_ns: i64, chosen: impl Fn(usize) -> bool) {
    let words = rig.words(0, "state").expect("a rig that is not lost");
    let pixels = oracle.sensor().pixels();
    let references = &words[StateWord::Reference as usize * pixels..][..pixels];
    for pixel in (0..pixels).filter(|&pixel| chosen(pixel)) {
        let (exact_log, tolerance_log) = match oracle.physical_pixel(pixel) {
            Some(state) => (state.reference_log, REFERENCE_TOLERANCE_LOG[1]),
            None => {
                let state = oracle.pixel(pixel).expect("an armed pixel");
                let leaked = oracle.constants()[pixel].leak_log(age_ns);
                (state.reference.minus_split(leaked).value(), REFERENCE_TOLERANCE_LOG[0])
            }
        };
        let seen_log = q24_to_log(references[pixel] as i32);
        assert!(
            (seen_log - exact_log).abs() <= tolerance_log,
            "{:?}, pixel {pixel}: {seen_log}, expected {exact_log}",
            oracle.sensor()
        );
    }
}

/// What has leaked before and, in a physical pixel, the noise. Even pixels are armed at the first frame, odd ones in an interval.
#[test]
fn pixels_are_armed_with_the_oracles_references() {
    let log = SensorModel { width: 32, height: 16, leak_rate_hz: 0.5, leak_spread_log: 0.2, ..sensor() };
    let physical = SensorModel {
        pixel: Pixel::Physical,
        lux_per_unit: 20.0,
        dark_spread_log: 0.3,
        refractory_ns: 1_000_000,
        ..log.clone()
    };
    let sensors = [
        SensorModel { leak_rate_hz: 0.0, ..log.clone() },
        SensorModel { shot_noise_rate_hz: 1.0, ..log.clone() },
        log,
        SensorModel { leak_rate_hz: -0.5, ..physical.clone() },
        SensorModel { leak_per_lux_hz: -0.05, ..physical.clone() },
        SensorModel { noise_gain: 3.0, ..physical.clone() },
        SensorModel { noise_gain: 6.0, lux_per_unit: 1.0, refractory_ns: 0, ..physical.clone() },
        SensorModel { noise_gain: 0.0, ..physical.clone() },
        SensorModel { leak_rate_hz: 0.0, ..physical.clone() },
        SensorModel { refractory_ns: 0, ..physical.clone() },
        physical,
    ];
    for sensor in sensors {
        let sequence = gray(&sensor, &[0, 20_000], |frame, pixel| {
            if frame == 0 && pixel % 2 == 1 { f32::NAN } else { 0.1 + (pixel as f32 * 0.37).sin().abs() }
        });
        let mut rig = rig(&sensor, &sequence, RigOptions::default());
        let mut oracle = Oracle::new(sensor, 0).expect("a valid sensor");
        for index in 0..2 {
            step(&mut rig, &sequence, index);
            oracle.step(&sequence.oracle_frame(index)).expect("in time");
            check_references(&rig, &oracle, sequence.frames[index].t_ns, |pixel| pixel % 2 == index);
        }
        drop(rig);
        assert_silent();
    }
}
