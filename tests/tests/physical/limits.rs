//! Physical pixels in rigs that repeat, grow, change and are reset, with too many events, and without light.

use super::{Agreement, SIZE, gpu, noisy, packets, quiet, sensor, waves, words};
use esaac_engine::RigOptions;
use esaac_layout::PhysicalWord;
use esaac_model::packet::Event;
use esaac_model::physical::MOST_EVENTS;
use esaac_model::{Pixel, SensorModel};
use esaac_tests::agreement::by_pixel;
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{FRAME_NS, Sequence, gray, times};
use esaac_tests::run::{Step, engine, engine_with, events, oracle, oracle_events, rig, steps};

#[test]
fn a_run_repeats_with_both_sets_of_kernels_and_goes_on_from_a_saved_state() {
    for (lux, sensor) in [(0.3, noisy()), (20.0, SensorModel { refractory_ns: 0, ..noisy() })] {
        let sequence = waves(&sensor, lux, 6);
        let whole = engine(&sensor, &sequence);
        assert!(events(&whole).len() > 1000);
        assert_eq!(packets(&whole), packets(&engine(&sensor, &sequence)), "the same again");
        assert_eq!(packets(&whole), packets(&engine_with(&sensor, &sequence, gpu())), "the GPU's kernels");
        let mut first = rig(&sensor, &sequence, RigOptions::default());
        steps(&mut first, &sequence, 0..3);
        let saved = first.save().expect("a rig that is not lost");
        let mut second = rig(&sensor, &sequence, gpu());
        second.restore(&saved).expect("a state of the same cameras");
        let rest = steps(&mut second, &sequence, 3..6);
        assert_eq!(packets(&rest), packets(&whole)[3..], "after a restore");
    }
}

#[test]
fn a_small_buffer_and_a_full_queue_lose_nothing() {
    let swings = |sensor: &SensorModel| {
        gray(sensor, &times(0, 5), |frame, pixel| {
            let decades = if frame % 2 == 0 || pixel % 5 == 0 { 0.0 } else { 4.0 };
            10.0_f64.powf(decades) as f32
        })
    };
    for sensor in [noisy(), SensorModel { refractory_ns: 0, contrast_on: 0.06, ..noisy() }] {
        let sequence = swings(&sensor);
        let small = RigOptions { initial_events: 64, ..RigOptions::default() };
        let large = RigOptions { initial_events: 1 << 20, ..RigOptions::default() };
        let ample = engine_with(&sensor, &sequence, large);
        assert_eq!(packets(&ample), packets(&engine_with(&sensor, &sequence, small)));
        let gpus = engine_with(&sensor, &sequence, RigOptions { initial_events: 64, ..gpu() });
        assert_eq!(packets(&ample), packets(&gpus));
        assert!(events(&ample).len() > 10 * sensor.pixels(), "{} events", events(&ample).len());
    }
}

/// Thresholds so small that a flash sends more events than a pixel may in an interval: those up to that are sent, the pixel is
/// armed anew, and the next interval is that of a fresh one.
#[test]
fn a_pixel_with_too_many_events_is_counted_and_armed_anew() {
    for refractory_ns in [0, 100] {
        let sensor = SensorModel {
            width: 3,
            height: 1,
            contrast_on: 1e-3,
            contrast_off: 1e-3,
            refractory_ns,
            dark_lux: 1.0,
            substeps: 4,
            ..sensor()
        };
        let sequence = gray(&sensor, &times(0, 4), |frame, pixel| {
            let lux = [10.0, if pixel % 7 == 0 { 1.5e4 } else { 11.0 }, 1e4, 1.2e4][frame];
            lux as f32
        });
        let expected = oracle(&sensor, 0, &sequence);
        let overrun = expected.iter().map(|interval| interval.diagnostics.overrun_pixels);
        let overrun: Vec<u64> = overrun.collect();
        let seventh = sensor.pixels().div_ceil(7) as u64;
        assert_eq!(overrun, [0, seventh, sensor.pixels() as u64 - seventh, 0]);
        let runs = [RigOptions::default(), gpu()].map(|options| engine_with(&sensor, &sequence, options));
        assert_eq!(packets(&runs[0]), packets(&runs[1]));
        for (step, expected) in runs[0].iter().zip(&expected) {
            assert_eq!(step.diagnostics.overrun_pixels, expected.diagnostics.overrun_pixels);
            let counts = |events: Vec<Event>| {
                by_pixel((sensor.width, sensor.height), &events).iter().map(Vec::len).collect::<Vec<_>>()
            };
            let [got, expected] =
                [&step.packet, &expected.packet].map(|packet| counts(packet.iter().collect()));
            // A hundredth of a neper, the photoreceptor's bound, is as much as ten of these thresholds.
            let most = MOST_EVENTS as usize;
            let agree = |(a, b): (&usize, &usize)| a == b || (*b != most && a.abs_diff(*b) <= 10);
            assert!(got.iter().zip(&expected).all(agree), "{got:?} and {expected:?}");
        }
    }
}

#[test]
fn pixels_without_light_start_late_and_then_as_the_oracles() {
    let sensor = SensorModel { substeps: 64, ..quiet() };
    let mut sequence = waves(&sensor, 5.0, 6);
    // Every third pixel is invalid in the first two frames, another in the third.
    for (frame, every, shift) in [(0, 3, 0), (1, 3, 0), (2, 4, 1)] {
        for pixel in (0..sensor.pixels()).filter(|pixel| pixel % every == shift) {
            sequence.frames[frame].hdr[16 * pixel..16 * pixel + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        }
    }
    let (got, expected) = (engine(&sensor, &sequence), oracle(&sensor, 0, &sequence));
    for (step, interval) in got.iter().zip(&expected) {
        assert_eq!(step.diagnostics.unarmed_pixels, interval.diagnostics.unarmed_pixels);
        assert_eq!(step.diagnostics.invalid_pixels, interval.diagnostics.invalid_pixels);
    }
    let mut agreement = Agreement::default();
    agreement.add(&sensor, &events(&got), &oracle_events(&expected));
    assert!(agreement.differing <= 12, "{} of {} pixels", agreement.differing, agreement.pixels);
    assert_eq!(packets(&got), packets(&engine_with(&sensor, &sequence, gpu())));
}

#[test]
fn a_running_rig_changes_its_pixel_and_begins_anew() {
    let physical = noisy();
    let log = SensorModel { pixel: Pixel::Log, leak_rate_hz: 0.0, leak_spread_log: 0.0, ..physical.clone() };
    let sequence = waves(&physical, 5.0, 7);
    let mut rig = rig(&log, &sequence, RigOptions::default());
    steps(&mut rig, &sequence, 0..2);
    rig.set_sensor(0, physical.clone()).expect("a valid sensor");
    let changed = steps(&mut rig, &sequence, 2..5);
    assert!(changed[0].packet.is_empty(), "the first frame of the new pixel arms it");
    let tail = |from: usize| Sequence { frames: sequence.frames[from..].to_vec(), ..sequence.clone() };
    let fresh = engine(&physical, &tail(2).first(3));
    let times_of =
        |steps: &[Step]| steps.iter().map(|step| step.packet.iter().collect()).collect::<Vec<Vec<_>>>();
    assert_eq!(times_of(&changed), times_of(&fresh), "as a rig that began with it");
    rig.set_sensor(0, log.clone()).expect("a valid sensor");
    assert_eq!(times_of(&steps(&mut rig, &sequence, 5..7)), times_of(&engine(&log, &tail(5))));
    drop(rig);
    assert_silent();
}

#[test]
fn a_reset_arms_the_pixels_anew_and_other_parameters_change_on_the_way() {
    let sensor = noisy();
    let sequence = waves(&sensor, 5.0, 7);
    let whole = engine(&sensor, &sequence);
    let mut rig = rig(&sensor, &sequence, RigOptions::default());
    steps(&mut rig, &sequence, 0..4);
    rig.reset(0).expect("a rig that is not lost");
    let tail = Sequence { frames: sequence.frames[4..].to_vec(), ..sequence.clone() };
    let fresh = engine(&sensor, &tail);
    let again = steps(&mut rig, &sequence, 4..7);
    for (again, fresh) in again.iter().zip(&fresh) {
        assert!(again.packet.iter().eq(fresh.packet.iter()));
    }
    assert!(!again[1].packet.iter().eq(whole[5].packet.iter()), "pixels go on otherwise");
    drop(rig);
    let mut rig = esaac_tests::run::rig(&sensor, &sequence, RigOptions::default());
    steps(&mut rig, &sequence, 0..4);
    let slow = SensorModel { second_pole_hz: 5.0, leak_rate_hz: 1.0, ..sensor };
    rig.set_sensor(0, slow).expect("a valid sensor");
    let slow = steps(&mut rig, &sequence, 4..7);
    assert!(!slow[0].packet.is_empty(), "no frame begins anew");
    assert!(events(&slow).len() < events(&whole[4..]).len() / 2, "a slow source follower");
    drop(rig);
    assert_silent();
}

#[test]
fn no_light_breaks_a_noisy_pixel() {
    // Darkness, noon, and flashes of eleven decades.
    let sensor = SensorModel { dark_lux: 1e-6, substeps: 4, ..noisy() };
    let sequence = gray(&sensor, &times(0, 12), |frame, pixel| match (pixel % 4, frame % 3) {
        (0, _) => 0.0,
        (1, _) => 1e6,
        (2, 1) | (3, 0) => 1e5,
        _ => 1e-6,
    });
    let mut rig = rig(&sensor, &sequence, RigOptions::default());
    let got = steps(&mut rig, &sequence, 0..sequence.frames.len());
    for word in [PhysicalWord::Excess, PhysicalWord::Lag, PhysicalWord::Noise, PhysicalWord::Phase] {
        for (pixel, word) in words(&rig, &sensor, word).into_iter().enumerate() {
            assert!(f32::from_bits(word).is_finite(), "pixel {pixel}: {}", f32::from_bits(word));
        }
    }
    drop(rig);
    assert_silent();
    // A pixel cannot send more often than its refractory period allows.
    let seconds = 11.0 * FRAME_NS as f64 * 1e-9;
    for (pixel, events) in by_pixel(SIZE, &events(&got)).iter().enumerate() {
        assert!(events.len() as f64 <= seconds / 0.0007 + 1.0, "pixel {pixel}: {} events", events.len());
        let gaps = events.windows(2).map(|pair| pair[1].0 - pair[0].0);
        assert!(gaps.min().is_none_or(|gap_ns| gap_ns >= 700_000), "pixel {pixel}");
    }
}
