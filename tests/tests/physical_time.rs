//! The physical pixel over time: its noise has one distribution however time is cut into frames and sub-steps, and hours of
//! darkness and of noon change nothing.

use esaac_engine::{FrameBytes, Rig, RigOptions};
use esaac_layout::PhysicalWord;
use esaac_model::packet::Event;
use esaac_model::random::{PixelKey, leak_phase};
use esaac_model::{Pixel, SensorModel, SubstepPolicy, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{Sequence, gray};
use esaac_tests::run::{camera, engine, events, oracle, oracle_events};
use std::f64::consts::TAU;

const SECOND_NS: i64 = 1_000_000_000;

/// A lux of light is an intensity of 1.
fn sensor() -> SensorModel {
    SensorModel {
        pixel: Pixel::Physical,
        synthesis: Synthesis::Linear,
        substep_policy: SubstepPolicy::Fixed,
        lux_per_unit: 1.0,
        ..SensorModel::default()
    }
}

/// In a lux its first pole turns 200 times a second, its second 1000 times. Its thresholds are at some three standard
/// deviations of the noise.
fn loud() -> SensorModel {
    SensorModel {
        width: 64,
        height: 16,
        contrast_on: 0.28,
        contrast_off: 0.26,
        contrast_mismatch: 0.01,
        refractory_ns: 2_500_000,
        dark_lux: 1e-3,
        response_e_per_lux_s: 20_000.0,
        photoreceptor_charge_e: 100.0,
        second_pole_hz: 1000.0 / TAU,
        ..sensor()
    }
}

/// Light that rises from 1 lux to 1.25 and falls again, for .8 s. It turns at each tenth of a second, at which there are
/// frames of 30, 240 and 1000 Hz.
fn swings(sensor: &SensorModel, rate_hz: i64) -> Sequence {
    let times_ns: Vec<i64> = (0..=8 * rate_hz / 10).map(|k| k * SECOND_NS / rate_hz).collect();
    gray(sensor, &times_ns, |frame, _| {
        let tenths = times_ns[frame] as f64 * 1e-8;
        let from_turn = (tenths % 2.0 - 1.0).abs();
        (1.25 - 0.25 * from_turn) as f32
    })
}

/// Times between one event and the next of the same pixel, nanoseconds, sorted.
fn gaps_ns(sensor: &SensorModel, events: &[Event]) -> Vec<i64> {
    let mut last_ns = vec![None; sensor.pixels()];
    let mut gaps_ns = Vec::new();
    for event in events {
        let pixel = usize::from(event.y) * sensor.width as usize + usize::from(event.x);
        gaps_ns.extend(last_ns[pixel].replace(event.t_ns).map(|before_ns: i64| event.t_ns - before_ns));
    }
    gaps_ns.sort_unstable();
    gaps_ns
}

/// Kolmogorov-Smirnov distance of two samples, in units of the one that one of a thousand pairs of one distribution
/// exceeds.
fn distance(a: &[i64], b: &[i64]) -> f64 {
    let share = |sample: &[i64], gap_ns: i64| {
        sample.partition_point(|&other_ns| other_ns <= gap_ns) as f64 / sample.len() as f64
    };
    let apart = a.iter().chain(b).map(|&gap_ns| (share(a, gap_ns) - share(b, gap_ns)).abs());
    let [n, m] = [a, b].map(|sample| sample.len() as f64);
    apart.fold(0.0, f64::max) / (1.95 * ((n + m) / (n * m)).sqrt())
}

#[test]
fn gaps_have_one_distribution_for_any_sub_steps_and_frame_rate() {
    // Each run has draws of its own.
    let gaps = |seed, substeps, rate_hz| {
        let sensor = SensorModel { seed, substeps, ..loud() };
        gaps_ns(&sensor, &events(&engine(&sensor, &swings(&sensor, rate_hz))))
    };
    let of_oracle = |seed, sensor: SensorModel| {
        let sensor = SensorModel { seed, height: 8, substeps: 7, ..sensor };
        gaps_ns(&sensor, &oracle_events(&oracle(&sensor, 0, &swings(&sensor, 30))))
    };
    let reference = of_oracle(100, loud());
    assert!(reference.len() > 3000, "{} gaps", reference.len());
    for (seed, (substeps, rate_hz)) in (0..).zip([(1, 30), (7, 30), (64, 30), (1, 240), (7, 240), (1, 1000)])
    {
        let gaps = gaps(seed, substeps, rate_hz);
        assert!(gaps.len() > 6000, "{} gaps", gaps.len());
        let distance = distance(&gaps, &reference);
        println!("{substeps} sub-steps at {rate_hz} Hz: {distance:.2}");
        assert!(distance < 1.0, "{substeps} sub-steps at {rate_hz} Hz: {distance}");
    }
    // Another noise or hold is told apart.
    let softer = SensorModel { noise_gain: 0.93, ..loud() };
    let held = SensorModel { refractory_ns: 4_000_000, ..loud() };
    for other in [softer, held] {
        let distance = distance(&of_oracle(101, other), &reference);
        assert!(distance > 1.0, "{distance}");
    }
}

const WIDTH_PX: u32 = 32;

/// Light of even and of odd columns, lux: darkness and noon.
const DARK_AND_NOON: [f32; 2] = [0.0, 1e5];

/// A pixel that is noisy in the dark and quiet at noon but for its leak.
fn awake() -> SensorModel {
    SensorModel {
        width: WIDTH_PX,
        height: 8,
        substeps: 8,
        contrast_on: 0.31,
        contrast_off: 0.29,
        refractory_ns: 100_000,
        photoreceptor_charge_e: 150.0,
        dark_lux: 0.02,
        leak_rate_hz: 0.0123,
        ..sensor()
    }
}

/// Two cameras, with noise and without.
struct Watch {
    rig: Rig,
    sensors: [SensorModel; 2],
    second: i64,
}

impl Watch {
    fn new() -> Self {
        let sensors = [awake(), SensorModel { noise_gain: 0.0, ..awake() }];
        let dark = gray(&sensors[0], &[0], |_, _| 0.0);
        let cameras = [0, 1].map(|number| camera(&sensors[number], number as u32, &dark));
        let rig = Rig::with_options(&DEVICE, &cameras, RigOptions::default()).expect("a rig");
        Watch { rig, sensors, second: 0 }
    }

    /// Shows this light for so many seconds; returns the events of each camera's pixels.
    fn show(&mut self, lux: [f32; 2], seconds: i64) -> [Vec<u32>; 2] {
        let mut counts = [0, 1].map(|camera| vec![0; self.sensors[camera].pixels()]);
        let frames = gray(&self.sensors[0], &[0], |_, pixel| lux[pixel % 2]);
        let bytes = FrameBytes { hdr: &frames.frames[0].hdr, ..FrameBytes::default() };
        for _ in 0..seconds {
            for camera in 0..2 {
                self.rig.upload(camera, &bytes).expect("a frame");
            }
            let tick = self.rig.step(&[self.second * SECOND_NS; 2]).expect("in time");
            for (counts, packet) in counts.iter_mut().zip(tick.packets) {
                for event in packet.iter() {
                    counts[usize::from(event.y) * WIDTH_PX as usize + usize::from(event.x)] += 1;
                }
            }
            self.second += 1;
        }
        counts
    }
}

/// Events of the pixels in even and in odd columns.
fn of_columns(counts: &[u32]) -> [f64; 2] {
    [0, 1].map(|column| f64::from(counts.iter().skip(column).step_by(2).sum::<u32>()))
}

#[test]
fn hours_of_darkness_and_of_noon_change_nothing() {
    let (mut watch, burn_in_s, hour_s) = (Watch::new(), 300, 3600);
    let mut leaks = vec![0; watch.sensors[1].pixels()];
    let mut noise = Vec::new();
    for seconds in [burn_in_s, hour_s, hour_s, hour_s] {
        let [noisy, leaky] = watch.show(DARK_AND_NOON, seconds);
        noise.push(of_columns(&noisy));
        leaks.iter_mut().zip(leaky).for_each(|(all, new)| *all += new);
    }
    // Without noise a pixel's reference arrives once in 1 / .0123 s, to the end.
    let due = 0.0123 * (burn_in_s + 3 * hour_s - 1) as f64;
    for (pixel, &events) in (0..).zip(&leaks) {
        let leaked_before = leak_phase(PixelKey { seed: watch.sensors[1].seed, camera: 1, pixel }, 0);
        assert_eq!(events, (due + leaked_before) as u32, "pixel {pixel}");
    }
    let [dark, noon] = [0, 1].map(|column| [noise[1][column], noise[3][column]]);
    // Chains of events make the counts vary by a percent.
    assert!(dark[0] > 1e5 && (dark[1] / dark[0] - 1.0).abs() < 0.03, "in the dark: {noise:?}");
    let leaked = 128.0 * 0.0123 * hour_s as f64;
    assert!(noon.into_iter().all(|events| (events / leaked - 1.0).abs() < 0.02), "at noon: {noise:?}");
    let all = watch.rig.words(0, "state").expect("a rig that is not lost");
    for word in [PhysicalWord::Excess, PhysicalWord::Lag, PhysicalWord::Noise, PhysicalWord::Phase] {
        let pixels = watch.sensors[0].pixels();
        let of_pixels = all[word as usize * pixels..].iter().take(pixels);
        assert!(of_pixels.into_iter().all(|&bits| f32::from_bits(bits).is_finite()), "{word:?}");
    }

    // The first change after it is answered as by a rig that has hardly begun.
    let mut fresh = Watch::new();
    fresh.show(DARK_AND_NOON, burn_in_s);
    let change = [0.5, 1e4];
    let [[late, late_leaky], [early, early_leaky]] =
        [&mut watch, &mut fresh].map(|watch| watch.show(change, 2));
    let [dark_late, dark_early] = [&late, &early].map(|counts| of_columns(counts)[0]);
    // Half of these events are noise, at which pixels differ by their rate itself: the deviation is 7%.
    assert!(
        dark_early > 1000.0 && (dark_late / dark_early - 1.0).abs() < 0.2,
        "{dark_late} and {dark_early}"
    );
    // Where there is no noise, what has leaked since the last event makes a difference of one.
    let noon = late.iter().zip(&early).skip(1).step_by(2);
    for (late, early) in noon.chain(late_leaky.iter().zip(&early_leaky)) {
        assert!(late.abs_diff(*early) <= 1, "{late} and {early} events");
    }
    drop((watch, fresh));
    assert_silent();
}
