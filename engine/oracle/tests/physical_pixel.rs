//! Physics of the physical pixel's events, by whole cameras with exact intensities.

use esaac_model::packet::Event;
use esaac_model::physical::{PhysicalPixel, physical_preset};
use esaac_model::presets::preset;
use esaac_model::random::{PixelKey, leak_phase};
use esaac_model::{Polarity, ReadoutKind, SensorModel, SubstepPolicy};
use esaac_oracle::Oracle;

/// A row of pixels with events at their own instants.
fn row(pixels: u32) -> SensorModel {
    SensorModel {
        width: pixels,
        height: 1,
        substeps: 8,
        substep_policy: SubstepPolicy::Fixed,
        seed: 11,
        ..SensorModel::default()
    }
}

/// A pixel of focal-plane lux, without noise and leak.
fn quiet() -> PhysicalPixel {
    PhysicalPixel {
        lux_per_unit: 1.0,
        dark_lux: 0.01,
        noise_gain: 0.0,
        leak_rate_hz: 0.0,
        ..PhysicalPixel::default()
    }
}

/// Events of a camera that sees `lux(pixel, t_s)` in `intervals` intervals of `interval_ns`.
fn events(
    mut camera: Oracle,
    interval_ns: i64,
    intervals: i64,
    lux: &dyn Fn(usize, f64) -> f64,
) -> Vec<Event> {
    let mut events = Vec::new();
    for k in 0..=intervals {
        let start_s = (k - 1).max(0) as f64 * interval_ns as f64 * 1e-9;
        let interval = camera
            .step_samples(k * interval_ns, &|pixel, t_ns| lux(pixel, start_s + t_ns * 1e-9))
            .expect("in time");
        events.extend(interval.packet.iter());
    }
    events
}

fn physical(sensor: &SensorModel, pixel: &PhysicalPixel) -> Oracle {
    Oracle::new(sensor.clone().with_physical(pixel), 0).expect("valid")
}

fn of(events: &[Event], polarity: Polarity) -> usize {
    events.iter().filter(|event| event.polarity == polarity).count()
}

/// A scene of some decades, different at each pixel.
fn scene(pixel: usize, t_s: f64) -> f64 {
    let phase = pixel as f64 * 1.7;
    (1.5 * (23.0 * t_s + phase).sin() + 0.8 * (61.0 * t_s * (1.0 + 0.1 * phase.cos())).sin()).exp()
}

#[test]
fn infinitely_fast_and_without_noise_it_is_the_log_pixel() {
    let fast = PhysicalPixel {
        lux_per_unit: 1e5,
        dark_lux: 1e3,
        response_e_per_lux_s: 1e9,
        photoreceptor_charge_e: 1.0,
        second_pole_hz: 1e12,
        leak_rate_hz: 2.0,
        ..quiet()
    };
    for refractory_ns in [0, 300_000] {
        let sensor = SensorModel {
            contrast_mismatch: 0.02,
            leak_rate_hz: 2.0,
            log_offset: fast.dark_intensity(1.0),
            refractory_ns,
            ..row(12)
        };
        let log = events(Oracle::new(sensor.clone(), 0).expect("valid"), 20_000_000, 12, &scene);
        let physical = events(physical(&sensor, &fast), 20_000_000, 12, &scene);
        assert!(log.len() > 300, "{} events", log.len());
        assert_eq!(log.len(), physical.len(), "refractory period {refractory_ns} ns");
        // The lags of both poles, 1e-13 s, and the tolerance of a touch, 1e-12 neper, rarely take a crossing across
        // a nanosecond. They take it across a few where level and leak nearly cancel.
        let by_pixel = |events: &[Event], x: u16| {
            events.iter().filter(|e| e.x == x).map(|e| (e.polarity, e.t_ns)).collect::<Vec<_>>()
        };
        let mut moved = 0;
        for x in 0..12 {
            for (log, physical) in by_pixel(&log, x).into_iter().zip(by_pixel(&physical, x)) {
                assert_eq!(log.0, physical.0, "pixel {x}");
                let apart_ns = (log.1 - physical.1).abs();
                assert!(apart_ns <= 10, "pixel {x}: {} and {} ns", log.1, physical.1);
                moved += usize::from(apart_ns > 0);
            }
        }
        assert!(moved * 100 <= log.len(), "{moved} of {} have another time", log.len());
    }
}

#[test]
fn dim_light_is_slower_and_an_off_step_slower_than_an_on_step() {
    // The time at which the last event of a tenfold step comes, against the equation of the first stage.
    let sensor = SensorModel { substeps: 64, ..row(1) };
    let pixel = PhysicalPixel { second_pole_hz: 1e6, dark_lux: 1e-9, ..quiet() };
    for lux in [0.1, 1.0, 100.0] {
        for up in [true, false] {
            let (from, to) = if up { (lux, 10.0 * lux) } else { (10.0 * lux, lux) };
            let rate = pixel.drive_per_s(to);
            let interval_ns = (20e9 / rate) as i64;
            let edge_s = interval_ns as f64 * 1e-9;
            let step = |_: usize, t_s: f64| if t_s <= edge_s { from } else { to };
            let found = events(physical(&sensor, &pixel), interval_ns, 2, &step);
            let polarity = if up { Polarity::On } else { Polarity::Off };
            assert_eq!(
                (found.len(), of(&found, polarity)),
                (11, 11),
                "{lux} lux: ln 10 has 11 thresholds of .2"
            );
            // v falls from e^(change) to 1; an event is due when ln v is what the thresholds leave of the change.
            let change = (to / from).ln();
            let left = change - f64::from(polarity.sign()) * 11.0 * 0.2;
            let due_s = (change.exp_m1() / left.exp_m1()).ln() / rate;
            // The edge takes one sub-step.
            let after_s = (found[10].t_ns - interval_ns) as f64 * 1e-9;
            let substep_s = edge_s / 64.0;
            assert!((after_s - due_s - 0.5 * substep_s).abs() < substep_s, "{lux} {up}: {after_s} {due_s}");
        }
    }
}

#[test]
fn leak_has_a_sign_and_follows_light_and_temperature() {
    let sensor = row(4);
    // In 20 s of a leak that is `hz` at this light.
    let check = |pixel: &PhysicalPixel, lux: f64, polarity, hz: f64| {
        let found = events(physical(&sensor, pixel), 1_000_000_000, 20, &|_, _| lux);
        assert_eq!(found.len(), of(&found, polarity), "one polarity only");
        for x in 0..4 {
            let phase = leak_phase(PixelKey { seed: sensor.seed, camera: 0, pixel: u32::from(x) }, 0);
            let actual = found.iter().filter(|event| event.x == x).count();
            assert_eq!(actual, (20.0 * hz + phase) as usize, "pixel {x} at {lux} lux, {hz} Hz");
        }
    };
    let leaky = PhysicalPixel { leak_rate_hz: 1.02, leak_per_lux_hz: 0.05, ..quiet() };
    check(&leaky, 0.0, Polarity::On, 1.02);
    check(&leaky, 40.0, Polarity::On, 3.02);
    let warm = PhysicalPixel { temperature_c: 33.8, ..leaky.clone() };
    check(&warm, 0.0, Polarity::On, 2.04);
    let backwards = PhysicalPixel { leak_rate_hz: -1.02, leak_per_lux_hz: 0.0, ..quiet() };
    check(&backwards, 10.0, Polarity::Off, 1.02);
}

#[test]
fn a_held_pixel_is_silent_and_then_watches_anew() {
    let sensor = SensorModel { refractory_ns: 5_000_000, ..row(1) };
    // A ramp of 100 nepers a second: a threshold of .2 every 2 ms after each release.
    let ramp = |_: usize, t_s: f64| (100.0 * t_s).exp();
    let pixel = PhysicalPixel { response_e_per_lux_s: 1e9, second_pole_hz: 1e6, dark_lux: 1e-9, ..quiet() };
    let found = events(physical(&sensor, &pixel), 10_000_000, 10, &ramp);
    let gaps: Vec<i64> = found.windows(2).map(|pair| pair[1].t_ns - pair[0].t_ns).collect();
    assert!(gaps.len() > 10);
    for gap_ns in gaps {
        assert!((gap_ns - 7_000_000).abs() < 3_000, "{gap_ns}");
    }
}

#[test]
fn neither_sub_steps_nor_frames_change_the_events() {
    // A ramp that is straight in log intensity, so that every number of sub-steps shows the same light, with noise.
    let pixel = PhysicalPixel { dark_lux: 1e-9, noise_gain: 1.0, leak_rate_hz: 0.3, ..quiet() };
    let lux = |pixel: usize, t_s: f64| 0.5 * ((0.4 * pixel as f64 - 1.0) * t_s).exp();
    let found = |substeps, interval_ns, intervals| {
        let sensor = SensorModel { substeps, refractory_ns: 1_000_000, ..row(6) };
        let mut found = events(physical(&sensor, &pixel), interval_ns, intervals, &lux);
        found.sort_unstable_by_key(|event| (event.x, event.t_ns));
        found
    };
    let whole = found(1, 1_000_000_000, 2);
    assert!(whole.len() > 30, "{} events", whole.len());
    for (substeps, interval_ns, intervals) in
        [(64, 1_000_000_000, 2), (1, 10_000_000, 200), (7, 40_000_000, 50)]
    {
        let cut = found(substeps, interval_ns, intervals);
        assert_eq!(whole.len(), cut.len(), "{substeps} sub-steps of {interval_ns} ns");
        for (a, b) in whole.iter().zip(&cut) {
            assert_eq!((a.x, a.polarity), (b.x, b.polarity));
            // What the hazard's quadrature allows.
            assert!((a.t_ns - b.t_ns).abs() < 50_000, "pixel {}: {} and {} ns", a.x, a.t_ns, b.t_ns);
        }
    }
}

#[test]
fn extremes_stay_finite() {
    let sensor = SensorModel { refractory_ns: 100_000, ..row(3) };
    let noisy = PhysicalPixel { noise_gain: 1.0, leak_rate_hz: -0.1, ..quiet() };
    // Flashes over twelve decades with noise, from one sample to the next.
    let flash =
        |pixel: usize, t_s: f64| if ((t_s * 20.0) as usize).is_multiple_of(pixel + 2) { 1e6 } else { 1e-6 };
    let found = events(physical(&sensor, &noisy), 33_000_000, 30, &flash);
    assert!(of(&found, Polarity::On) > 100 && of(&found, Polarity::Off) > 20, "{} events", found.len());
    // Ten minutes in the cold dark, where the photoreceptor needs minutes, and in the hottest light.
    for (lux, temperature_c, seconds) in [(0.0, -40.0, 600), (1e6, 125.0, 20)] {
        let pixel = PhysicalPixel { temperature_c, ..noisy.clone() };
        let mut camera = physical(&sensor, &pixel);
        let mut count = 0;
        for k in 0..=seconds {
            count += camera.step_samples(k * 1_000_000_000, &|_, _| lux).expect("in time").packet.len();
        }
        let state = format!("{:?}", camera.physical_pixel(0).expect("armed"));
        assert!(!state.contains("NaN") && !state.contains("inf"), "{state}");
        // The leak is .1 Hz at 25 C, and .0006 and 264 Hz here.
        let leaked = 3.0 * seconds as f64 * pixel.leak_hz(lux, 1.0).abs();
        assert!((count as f64) < 1.1 * leaked + 100.0, "{count} events at {lux} lux");
        assert!((count as f64) > 0.9 * leaked - 3.0, "{count} events at {lux} lux");
    }
}

#[test]
fn a_day_of_darkness_and_of_noon_changes_nothing() {
    const LEAK_HZ: f64 = 0.0123;
    let sensor = SensorModel { refractory_ns: 100_000, contrast_on: 0.31, contrast_off: 0.29, ..row(4) };
    let pixel = PhysicalPixel {
        photoreceptor_charge_e: 150.0,
        dark_lux: 0.02,
        noise_gain: 1.0,
        leak_rate_hz: LEAK_HZ,
        ..quiet()
    };
    let day_s = 86_400;
    let dark_and_noon = |pixel: usize, _: f64| [0.0, 1e5][pixel % 2];
    let mut camera = physical(&sensor, &pixel);
    // Events in the dark in each tenth of the day, and at noon.
    let (mut dark, mut noon) = ([0_u32; 10], 0);
    for second in 0..=day_s {
        let packet = camera.step_samples(second * 1_000_000_000, &dark_and_noon).expect("in time").packet;
        for event in packet.iter() {
            assert!(event.x % 2 == 0 || event.polarity == Polarity::On, "a leak only: {event:?}");
            dark[((second - 1) * 10 / day_s) as usize] += u32::from(event.x % 2 == 0);
            noon += u32::from(event.x % 2 == 1);
        }
    }
    let [first, last] = [f64::from(dark[0]), f64::from(dark[9])];
    // Chains of events make such counts vary by more than their root.
    assert!(first > 4000.0 && (last / first - 1.0).abs() < 0.06, "{dark:?}");
    // What the noise at a release adds to the reference and takes from it is a percent of a threshold.
    let leaked = 2.0 * LEAK_HZ * day_s as f64;
    assert!((f64::from(noon) / leaked - 1.0).abs() < 0.005, "{noon} events, expected {leaked}");
    let state = format!("{:?}", (0..4).map(|pixel| camera.physical_pixel(pixel)).collect::<Vec<_>>());
    assert!(!state.contains("NaN") && !state.contains("inf"), "{state}");
    // The first change is answered by what its size asks for: ln 10 is seven or eight thresholds.
    let tenth = |pixel: usize, t_ns: f64| dark_and_noon(pixel, 0.0) * 10_f64.powf(-t_ns * 1e-9);
    let packet = camera.step_samples((day_s + 1) * 1_000_000_000, &tenth).expect("in time").packet;
    let off = |x: u16| packet.iter().filter(|e| e.x == x && e.polarity == Polarity::Off).count();
    assert!((6..=8).contains(&off(1)) && (6..=8).contains(&off(3)), "{} and {}", off(1), off(3));
}

#[test]
fn a_busy_row_loses_events_and_counts_them() {
    let mut sensor = SensorModel { width: 32, height: 24, ..preset("davis346").expect("listed") };
    let (pixel, _) = physical_preset("davis346").expect("listed").apply(&mut sensor);
    let pixel = PhysicalPixel { lux_per_unit: 1.0, ..pixel };
    let sensor = SensorModel { refractory_ns: 10_000, substeps: 8, readout_event_ns: 8e3, ..sensor };
    let step = |_: usize, t_s: f64| 100.0 * (60.0 * t_s).exp();
    let run = |readout| {
        let sensor = SensorModel { readout, ..sensor.clone() };
        let mut camera = Oracle::new(sensor.with_physical(&pixel), 0).expect("valid");
        let (mut sent, mut lost, mut waiting, mut times) = (0, 0, 0, Vec::new());
        for k in 0..4 {
            let start_s = f64::max(0.0, 0.03 * (f64::from(k) - 1.0));
            let interval = camera
                .step_samples(i64::from(k) * 30_000_000, &|p, t_ns| step(p, start_s + t_ns * 1e-9))
                .expect("in time");
            sent += interval.packet.len() as u64;
            lost += interval.diagnostics.lost_events;
            waiting = interval.diagnostics.deferred_events;
            times.extend(interval.packet.iter().map(|event| event.t_ns));
        }
        (sent, lost, waiting, times)
    };
    let (ideal, none_lost, _, _) = run(ReadoutKind::None);
    let (sent, lost, waiting, times) = run(ReadoutKind::Fifo);
    assert_eq!(none_lost, 0);
    assert!(lost > 100, "{lost} lost");
    assert_eq!(sent + lost + waiting, ideal, "served, lost and waiting add up");
    assert!(times.is_sorted() && times.iter().all(|t_ns| t_ns % 1000 == 0), "in the sensor's tick");
    let span_ns = times[times.len() - 1] - times[0];
    assert!(span_ns >= (times.len() as i64 - 1) * 8_000 - 1_000, "the bus takes 8 us an event");
}

/// Pixels are armed as if they had looked at still light for long. Their noise fires them before the leak brings them to a
/// threshold.
#[test]
fn leak_has_its_rate_from_the_first_frame() {
    for (lux, noise_gain, leak_rate_hz, refractory_ns) in
        [(1.0, 0.0, 0.1, 0), (100.0, 1.0, -0.1, 0), (5.0, 0.5, 0.1, 0), (5.0, 0.5, 0.1, 10_000_000)]
    {
        let sensor = SensorModel { substeps: 1, contrast_mismatch: 0.02, refractory_ns, ..row(1_000) };
        let pixel = PhysicalPixel { noise_gain, leak_rate_hz, leak_spread_log: 0.1, ..quiet() };
        let found = events(physical(&sensor, &pixel), 1_000_000_000, 14, &|_, _| lux);
        let mut by_second = [0; 14];
        for event in &found {
            by_second[((event.t_ns - 1) / 1_000_000_000) as usize] += 1;
        }
        println!("{lux} lux, gain {noise_gain}, leak {leak_rate_hz} Hz, {refractory_ns} ns: {by_second:?}");
        let mean = found.len() as f64 / 14.0;
        assert!(mean > 99.0);
        for seconds in by_second.chunks(3) {
            let rate = seconds.iter().sum::<i32>() as f64 / seconds.len() as f64;
            assert!((rate / mean - 1.0).abs() < 0.2, "{by_second:?}");
        }
    }
}
