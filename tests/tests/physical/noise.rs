//! The physical pixel's noise: as often, and as steep, as the oracle's, whose hazard is exact.

use super::{noisy, waves};
use esaac_model::packet::Event;
use esaac_model::{Polarity, SensorModel};
use esaac_tests::agreement::by_pixel;
use esaac_tests::frames::{Sequence, gray};
use esaac_tests::run::{engine, events, oracle, oracle_events};
use std::f64::consts::TAU;

/// Still light, a frame each second.
fn still(sensor: &SensorModel, seconds: usize, lux: f64) -> Sequence {
    let times_ns: Vec<i64> = (0..=seconds as i64).map(|k| k * 1_000_000_000).collect();
    gray(sensor, &times_ns, |_, _| lux as f32)
}

/// What is counted of noise after a burn-in of two seconds.
#[derive(Debug)]
struct Counted {
    events: usize,
    rate_hz: f64,
    /// Share of events that follow one of the other polarity.
    opposite: f64,
}

fn count(sensor: &SensorModel, events: &[Event], seconds: usize) -> Counted {
    let (mut count, mut pairs, mut opposite) = (0, 0, 0);
    for pixel in by_pixel((sensor.width, sensor.height), events) {
        let late: Vec<_> = pixel.iter().filter(|event| event.0 > 2_000_000_000).collect();
        count += late.len();
        pairs += late.windows(2).count();
        opposite += late.windows(2).filter(|pair| pair[0].1 != pair[1].1).count();
    }
    let rate_hz = count as f64 / ((seconds - 2) * sensor.pixels()) as f64;
    Counted { events: count, rate_hz, opposite: opposite as f64 / pairs.max(1) as f64 }
}

/// In a lux the first pole turns 20 times a second, the second 100 times; thresholds are at three standard deviations.
fn loud() -> SensorModel {
    let (first_per_s, second_per_s, charge_e) = (20.0, 100.0, 100.0);
    let threshold = 3.0 * f64::sqrt(second_per_s / (charge_e * (first_per_s + second_per_s)));
    SensorModel {
        contrast_on: threshold,
        contrast_off: threshold,
        contrast_mismatch: 0.01,
        leak_rate_hz: 0.01,
        leak_spread_log: 0.0,
        leak_per_lux_hz: 0.0,
        dark_spread_log: 0.0,
        dark_lux: 1e-6,
        response_e_per_lux_s: first_per_s * charge_e,
        photoreceptor_charge_e: charge_e,
        second_pole_hz: second_per_s / TAU,
        refractory_ns: 25_000_000,
        ..noisy()
    }
}

#[test]
fn noise_has_the_oracles_rate_for_any_number_of_substeps() {
    let seconds = 22;
    let few = SensorModel { width: 24, height: 8, substeps: 1, ..loud() };
    let reference = oracle_events(&oracle(&few, 0, &still(&few, seconds, 1.0)));
    let reference = count(&few, &reference, seconds);
    println!("oracle: {reference:?}");
    assert!(reference.events > 2000, "{reference:?}");
    for substeps in [1, 7, 64] {
        let sensor = SensorModel { substeps, width: 64, height: 16, ..loud() };
        let counted = count(&sensor, &events(&engine(&sensor, &still(&sensor, seconds, 1.0))), seconds);
        println!("{substeps} sub-steps: {counted:?}");
        let ratio = counted.rate_hz / reference.rate_hz;
        // The oracle's count has a deviation of 2%.
        assert!((ratio - 1.0).abs() < 0.07, "{substeps} sub-steps: {counted:?} against {reference:?}");
        assert!((counted.opposite - reference.opposite).abs() < 0.04, "{counted:?} against {reference:?}");
    }
}

/// Held for a tenth of a time constant, a pixel still shows at the release how far the noise was at the event, and how fast it
/// crossed the threshold. In still light the reference moves by little else.
#[test]
fn noise_crosses_thresholds_as_fast_as_the_oracles() {
    // The leak drives the level at up to three standard deviations of the noise's slope.
    for (leak_rate_hz, seconds, bound) in [(0.0, 22, 0.04), (15.0, 8, 0.004), (45.0, 5, 0.004)] {
        let sensor = SensorModel {
            width: 32,
            height: 24,
            leak_rate_hz,
            refractory_ns: 5_000_000,
            substeps: 2,
            ..loud()
        };
        let sequence = still(&sensor, seconds, 1.0);
        let own = count(&sensor, &events(&engine(&sensor, &sequence)), seconds);
        let exact = count(&sensor, &oracle_events(&oracle(&sensor, 0, &sequence)), seconds);
        println!("leak {leak_rate_hz} Hz: {own:?} against {exact:?}");
        let ratio = own.rate_hz / exact.rate_hz;
        assert!((ratio - 1.0).abs() < bound, "leak {leak_rate_hz} Hz: {own:?} against {exact:?}");
        assert!(
            (own.opposite - exact.opposite).abs() < 0.02,
            "leak {leak_rate_hz} Hz: {own:?} against {exact:?}"
        );
    }
}

/// The light moves by decades between frames: hazards grow and fall within a sub-step, and signals meet the noise.
#[test]
fn noisy_pixels_in_moving_light_send_as_many_events_as_the_oracles() {
    let sensor = SensorModel { substeps: 16, width: 24, height: 8, ..noisy() };
    for lux in [0.3, 10.0] {
        let sequence = waves(&sensor, lux, 9);
        let (own, exact) =
            (events(&engine(&sensor, &sequence)), oracle_events(&oracle(&sensor, 0, &sequence)));
        for polarity in [Polarity::Off, Polarity::On] {
            let [own, exact] =
                [&own, &exact].map(|events| events.iter().filter(|event| event.polarity == polarity).count());
            println!("{lux} lux, {polarity:?}: {own} and {exact}");
            assert!(exact > 1000, "{exact} events");
            assert!((own as f64 / exact as f64 - 1.0).abs() < 0.03, "{lux} lux: {own} and {exact}");
        }
    }
}
