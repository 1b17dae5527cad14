//! The physical pixel of the engine: against the oracle, whose photoreceptor and hazard are exact, with both sets of
//! kernels, and what must hold of any pixel.

use esaac_engine::{KernelPolicy, RigOptions};
use esaac_layout::PhysicalWord;
use esaac_model::packet::Event;
use esaac_model::physical::MOST_EVENTS;
use esaac_model::presets::preset;
use esaac_model::{
    HdrFormat, MotionFormat, Packet, Pixel, Polarity, SensorModel, SubstepPolicy, Synthesis, Timestamps,
};
use esaac_oracle::Oracle;
use esaac_scene::SceneKind;
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{FRAME_NS, Sequence, gray, scene, times};
use esaac_tests::geometry::Rendered;
use esaac_tests::run::{Step, engine, engine_with, events, oracle, oracle_events, rig, step, steps};
use std::f64::consts::TAU;

/// An odd size: the image cuts a block off at the right.
const SIZE: (u32, u32) = (45, 16);

/// A lux of light is an intensity of 1.
fn sensor() -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        pixel: Pixel::Physical,
        synthesis: Synthesis::Linear,
        substeps: 32,
        substep_policy: SubstepPolicy::Fixed,
        lux_per_unit: 1.0,
        dark_lux: 0.02,
        noise_gain: 0.0,
        seed: 21,
        ..SensorModel::default()
    }
}

/// Everything but noise.
fn quiet() -> SensorModel {
    SensorModel {
        contrast_on: 0.21,
        contrast_off: 0.19,
        contrast_mismatch: 0.02,
        refractory_ns: 700_000,
        leak_rate_hz: -3.1,
        leak_spread_log: 0.3,
        leak_per_lux_hz: 0.013,
        dark_spread_log: 0.4,
        ..sensor()
    }
}

fn noisy() -> SensorModel {
    SensorModel { noise_gain: 1.0, photoreceptor_charge_e: 150.0, ..quiet() }
}

fn gpu() -> RigOptions {
    RigOptions { policy: Some(KernelPolicy::gpu()), ..RigOptions::default() }
}

/// Light of some decades that moves at every pixel, around `lux`.
fn waves(sensor: &SensorModel, lux: f64, frames: usize) -> Sequence {
    gray(sensor, &times(7_000_000_013, frames), |frame, pixel| {
        let (t, phase) = (frame as f64, pixel as f64 * 0.37);
        (lux * (1.3 * (0.9 * t + phase).sin() + 0.8 * (2.3 * t + 0.1 * phase).cos()).exp()) as f32
    })
}

/// Events of each pixel, in order of time.
fn by_pixel(sensor: &SensorModel, events: &[Event]) -> Vec<Vec<(Polarity, i64)>> {
    let mut pixels = vec![Vec::new(); sensor.pixels()];
    for event in events {
        let pixel = usize::from(event.y) * sensor.width as usize + usize::from(event.x);
        pixels[pixel].push((event.polarity, event.t_ns));
    }
    pixels
}

/// How far engine and oracle agree.
#[derive(Debug, Default)]
struct Agreement {
    pixels: usize,
    /// Pixels whose polarities differ.
    differing: usize,
    /// Distance in time of each event of the others, nanoseconds.
    apart_ns: Vec<i64>,
}

impl Agreement {
    fn add(&mut self, sensor: &SensorModel, engine: &[Event], oracle: &[Event]) {
        for (engine, oracle) in by_pixel(sensor, engine).iter().zip(by_pixel(sensor, oracle)) {
            self.pixels += 1;
            if engine.iter().map(|e| e.0).eq(oracle.iter().map(|e| e.0)) {
                self.apart_ns.extend(engine.iter().zip(&oracle).map(|(e, o)| (e.1 - o.1).abs()));
            } else {
                self.differing += 1;
            }
        }
    }

    /// Time that a share of the events does not exceed.
    fn apart_ns(&self, share: f64) -> i64 {
        let mut apart_ns = self.apart_ns.clone();
        apart_ns.sort_unstable();
        apart_ns[(share * (apart_ns.len() - 1) as f64) as usize]
    }
}

fn packets(steps: &[Step]) -> Vec<&Packet> {
    steps.iter().map(|step| &step.packet).collect()
}

/// The light turns by up to five decades a second from one frame to the next. Where a turn just touches a threshold, the
/// cubics between the ends of sub-steps may miss it: at one pixel in a thousand, also where a refractory period hands small
/// errors on, as what the output is at its end is the next reference.
#[test]
fn without_noise_pixels_send_the_oracles_events() {
    for refractory_ns in [0, 700_000] {
        let mut total = Agreement::default();
        for lux in [0.05, 1.0, 30.0, 2000.0] {
            let sensor = SensorModel { substeps: 64, refractory_ns, ..quiet() };
            let sequence = waves(&sensor, lux, 5);
            let own = engine(&sensor, &sequence);
            let gpus = engine_with(&sensor, &sequence, gpu());
            assert_eq!(packets(&own), packets(&gpus), "both sets of kernels");
            let before = (total.differing, total.apart_ns.len());
            total.add(&sensor, &events(&own), &oracle_events(&oracle(&sensor, 0, &sequence)));
            assert!(total.apart_ns.len() > before.1 + 1000, "{lux} lux");
            println!("{lux} lux: {} of {} pixels differ", total.differing - before.0, sensor.pixels());
        }
        println!("{refractory_ns} ns: {} and {} ns apart", total.apart_ns(0.5), total.apart_ns(0.99));
        let share = total.differing as f64 / total.pixels as f64;
        assert!(share <= 0.001, "{} of {} pixels", total.differing, total.pixels);
        assert!(total.apart_ns(0.5) < 5_000 && total.apart_ns(0.99) < 200_000, "{refractory_ns} ns");
    }
}

/// With stamps at the ends of sub-steps nothing else changes: each event has the end of the sub-step that it is in.
#[test]
fn stamps_at_samples_move_no_hold() {
    let free = SensorModel { refractory_ns: 700_000, substep_policy: SubstepPolicy::Fixed, ..quiet() };
    let at_sample = SensorModel { timestamps: Timestamps::AtSample, ..free.clone() };
    let sequence = waves(&free, 30.0, 4);
    let by_pixel = |events: Vec<Event>| {
        let mut all: Vec<_> = events.into_iter().map(|e| ((e.y, e.x), e.t_ns, e.polarity)).collect();
        all.sort_by_key(|&(pixel, t_ns, _)| (pixel, t_ns));
        all
    };
    let own = [&free, &at_sample].map(|sensor| by_pixel(events(&engine(sensor, &sequence))));
    let gpus = [&free, &at_sample].map(|sensor| by_pixel(events(&engine_with(sensor, &sequence, gpu()))));
    let oracles = [&free, &at_sample].map(|sensor| by_pixel(oracle_events(&oracle(sensor, 0, &sequence))));
    for [free_events, at_samples] in [own, gpus, oracles] {
        assert!(free_events.len() > 1000, "{} events", free_events.len());
        assert_eq!(free_events.len(), at_samples.len());
        for (own, stamped) in free_events.iter().zip(&at_samples) {
            assert_eq!((own.0, own.2), (stamped.0, stamped.2));
            let frame = sequence.frames.iter().position(|frame| frame.t_ns >= own.1).expect("within the run");
            let (start_ns, end_ns) = (sequence.frames[frame - 1].t_ns, sequence.frames[frame].t_ns);
            let longest_ns = (end_ns - start_ns) / i64::from(free.substeps) + 1;
            assert!((0..=longest_ns).contains(&(stamped.1 - own.1)), "{own:?} and {stamped:?}");
        }
    }
    assert_silent();
}

#[test]
fn behind_a_lens_pixels_send_the_oracles_events() {
    let sensor = SensorModel { substeps: 64, psf_sigma_px: 0.7, vignetting_fov_deg: 60.0, ..quiet() };
    let sequence = waves(&sensor, 300.0, 4);
    let own = engine(&sensor, &sequence);
    assert_eq!(packets(&own), packets(&engine_with(&sensor, &sequence, gpu())), "both sets of kernels");
    let mut total = Agreement::default();
    total.add(&sensor, &events(&own), &oracle_events(&oracle(&sensor, 0, &sequence)));
    println!("{} of {} pixels differ, {} events", total.differing, total.pixels, total.apart_ns.len());
    assert!(total.apart_ns.len() > 1000 && total.differing as f64 <= 0.006 * total.pixels as f64);
    assert!(total.apart_ns(0.5) < 5_000 && total.apart_ns(0.99) < 200_000);
}

/// The light turns twenty times in these frames, forty events a pixel. Each turn that ends within the cubics' error of a
/// threshold is an event more or less: at one pixel in two hundred.
#[test]
fn in_the_light_of_a_lamp_pixels_follow_the_oracle() {
    // As bright as the second pole, so that the flicker of 100 Hz passes.
    let lamp = SensorModel { substeps: 64, flicker_depth: 0.4, flicker_phase_deg: 40.0, ..quiet() };
    let sequence = waves(&lamp, 300.0, 4);
    let mut rig = rig(&lamp, &sequence, RigOptions::default());
    let mut oracle = Oracle::new(lamp.clone(), 0).expect("a valid sensor");
    let (mut own, mut expected, mut worst) = (Vec::new(), Vec::new(), 0.0_f64);
    for frame in 0..sequence.frames.len() {
        own.push(step(&mut rig, &sequence, frame));
        expected.push(oracle.step(&sequence.oracle_frame(frame)).expect("a valid frame"));
        for (pixel, &lag) in words(&rig, &lamp, PhysicalWord::Lag).iter().enumerate() {
            let exact = oracle.physical_pixel(pixel).expect("armed").photoreceptor.lag_log;
            worst = worst.max((f64::from(f32::from_bits(lag)) - exact).abs());
        }
    }
    assert!(worst < 0.01, "{worst} neper");
    assert_eq!(packets(&own), packets(&engine_with(&lamp, &sequence, gpu())), "both sets of kernels");
    let (engine, oracle) = (events(&own), oracle_events(&expected));
    let mut total = Agreement::default();
    total.add(&lamp, &engine, &oracle);
    let (differing, pixels) = (total.differing, total.pixels);
    println!(
        "{worst} neper; {differing} of {pixels} pixels differ; {} of {} events",
        engine.len(),
        oracle.len()
    );
    println!("{} and {} ns apart", total.apart_ns(0.5), total.apart_ns(0.9));
    assert!(engine.len() > 25 * pixels && engine.len().abs_diff(oracle.len()) < oracle.len() / 2000);
    assert!(differing <= pixels / 200 && total.apart_ns(0.5) < 2_000 && total.apart_ns(0.9) < 10_000);
    drop(rig);
    assert_silent();
}

/// In dim light that jumps and then stays, a pixel sends many events in one part of the walk, which bends. Each holds the
/// pixel for a microsecond, and what its instant is off moves the reference of all that follow.
#[test]
fn events_of_a_pixel_that_settles_in_the_dark_are_the_oracles() {
    let sensor = SensorModel {
        contrast_on: 0.09,
        contrast_off: 0.06,
        contrast_mismatch: 0.01,
        refractory_ns: 1_255,
        second_pole_hz: 10_000.0,
        substeps: 8,
        ..sensor()
    };
    let sequence = gray(&sensor, &times(0, 6), |frame, pixel| {
        let phase = (pixel as f64 * 0.37).sin();
        [0.6, 2.9, 0.7, 0.7, 0.2, 0.2][frame] * (0.5 * phase).exp() as f32
    });
    let mut total = Agreement::default();
    let own = engine(&sensor, &sequence);
    total.add(&sensor, &events(&own), &oracle_events(&oracle(&sensor, 0, &sequence)));
    let apart_ns = [0.5, 0.9, 0.99].map(|share| total.apart_ns(share));
    println!(
        "{} of {} pixels differ, {} events, {apart_ns:?} ns apart",
        total.differing,
        total.pixels,
        total.apart_ns.len()
    );
    assert!(total.apart_ns.len() > 20 * total.pixels, "many events");
    assert!(total.differing <= total.pixels / 200, "{} pixels", total.differing);
    assert!(apart_ns[1] < 10_000 && apart_ns[2] < 20_000, "{apart_ns:?}");
    assert_silent();
}

/// What a rig tells of the light: the median of frames at fixed places in the run, the same in every run.
#[test]
fn the_light_is_looked_at_and_told() {
    let hd = SensorModel { width: 64, height: 40, lux_per_unit: 10.0, ..quiet() };
    let hd = SensorModel { name: "hd".to_owned(), ..hd }.with_preset_pixel();
    // Half of the image has 40 lux, the other half .02.
    let sequence = gray(&hd, &times(0, 6), |_, pixel| if pixel % 64 < 32 { 4.0 } else { 0.002 });
    let mut rig = rig(&hd, &sequence, RigOptions::default());
    assert_eq!(rig.light(0).expect("a camera"), None, "before the first frame");
    steps(&mut rig, &sequence, 0..6);
    let light = rig.light(0).expect("a camera").expect("it has seen light");
    // Frames 0, 1, 2 and 4; fourteen of forty rows.
    assert_eq!((light.frames, light.pixels, light.dim_share), (4, 4 * 13 * 64, 0.5), "{light}");
    assert!(
        (light.low_lux / 0.02 - 1.0).abs() < 0.05 && (light.high_lux / 40.0 - 1.0).abs() < 0.05,
        "{light}"
    );
    let warnings = rig.light_warnings(0).expect("a camera");
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(
        warnings[0].contains("0.15 to 20 focal-plane lux") && warnings[0].contains("50%"),
        "{warnings:?}"
    );
    let brighter = SensorModel { lux_per_unit: 1000.0, ..hd.clone() };
    rig.set_sensor(0, brighter).expect("of the same size");
    assert_eq!(rig.light(0).expect("a camera"), None, "other light");
    let lamp = SensorModel { flicker_depth: 0.2, flicker_hz: 300.0, ..hd.clone() };
    rig.set_sensor(0, lamp).expect("of the same size");
    let warnings = rig.light_warnings(0).expect("a camera");
    assert!(warnings[0].contains("needs 80 sub-steps") && warnings[0].contains("32"), "{warnings:?}");
    drop(rig);
    let log = SensorModel { pixel: Pixel::Log, leak_rate_hz: 0.0, ..hd };
    let mut rig = esaac_tests::run::rig(&log, &sequence, RigOptions::default());
    steps(&mut rig, &sequence, 0..2);
    assert_eq!(rig.light(0).expect("a camera"), None, "a log pixel knows no lux");
    assert_silent();
}

/// A word of each pixel's state.
fn words(rig: &esaac_engine::Rig, sensor: &SensorModel, word: PhysicalWord) -> Vec<u32> {
    let all = rig.words(0, "state").expect("a rig that is not lost");
    let first = word as usize * sensor.pixels();
    all[first..first + sensor.pixels()].to_vec()
}

#[test]
fn the_photoreceptor_is_the_solution_of_its_equations() {
    // Steps of up to five decades, in a single sub-step or in eight.
    for substeps in [1, 8] {
        let sensor = SensorModel { substeps, dark_lux: 1e-4, ..sensor() };
        let sequence = gray(&sensor, &times(0, 9), |frame, pixel| {
            let decades = [-3.0, -2.0, -1.0, 0.0, 0.5, 1.0, 2.0][(pixel + frame * (pixel / 7)) % 7];
            let shift = [0.0, 1.0, 3.0, 4.0][pixel % 4];
            10.0_f64.powf(decades + shift) as f32
        });
        let mut rig = rig(&sensor, &sequence, RigOptions::default());
        let mut oracle = Oracle::new(sensor.clone(), 0).expect("a valid sensor");
        let mut worst = 0.0_f64;
        for frame in 0..sequence.frames.len() {
            step(&mut rig, &sequence, frame);
            oracle.step(&sequence.oracle_frame(frame)).expect("a valid frame");
            for (pixel, &lag) in words(&rig, &sensor, PhysicalWord::Lag).iter().enumerate() {
                let exact = oracle.physical_pixel(pixel).expect("armed").photoreceptor.lag_log;
                worst = worst.max((f64::from(f32::from_bits(lag)) - exact).abs());
            }
        }
        println!("{substeps} sub-steps: {worst} neper");
        assert!(worst < 0.01, "{substeps} sub-steps: {worst} neper");
        assert_silent();
    }
}

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
    for pixel in by_pixel(sensor, events) {
        let late: Vec<_> = pixel.iter().filter(|event| event.1 > 2_000_000_000).collect();
        count += late.len();
        pairs += late.windows(2).count();
        opposite += late.windows(2).filter(|pair| pair[0].0 != pair[1].0).count();
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

#[test]
fn without_lag_and_noise_it_sends_the_log_pixels_events() {
    for (refractory_ns, leak_rate_hz) in [(0, 0.0), (700_000, 2.0)] {
        let [fast, log] = <[SensorModel; 2]>::from(twins(Synthesis::Linear)).map(|sensor| SensorModel {
            contrast_mismatch: 0.02,
            refractory_ns,
            leak_rate_hz,
            ..sensor
        });
        let sequence = waves(&fast, 1.0, 5);
        let (physical, log) = (events(&engine(&fast, &sequence)), events(&engine(&log, &sequence)));
        let mut agreement = Agreement::default();
        agreement.add(&fast, &physical, &log);
        println!(
            "{refractory_ns} ns: {} differ; {} events, apart {} ns at most",
            agreement.differing,
            agreement.apart_ns.len(),
            agreement.apart_ns(1.0)
        );
        assert!(log.len() > 5000, "{} events", log.len());
        assert_eq!(agreement.differing, 0);
        // Parts of a sub-step end at whole nanoseconds and whole units of Q7.24, from which crossings are rounded anew.
        // On flat slopes that takes them further.
        assert!(agreement.apart_ns(0.99) <= 20, "{} ns", agreement.apart_ns(0.99));
        assert!(agreement.apart_ns(1.0) <= 1000, "{} ns", agreement.apart_ns(1.0));
    }
}

/// A pixel without lag and noise, and the log-intensity pixel of the same dark level.
fn twins(synthesis: Synthesis) -> (SensorModel, SensorModel) {
    let physical = SensorModel {
        synthesis,
        lux_per_unit: 1e5,
        response_e_per_lux_s: 1e9,
        photoreceptor_charge_e: 1.0,
        second_pole_hz: 1e12,
        dark_lux: 1e3,
        ..sensor()
    };
    let log = SensorModel { pixel: Pixel::Log, log_offset: physical.dark_level(), ..physical.clone() };
    (physical, log)
}

#[track_caller]
fn assert_same_polarities(sensor: &SensorModel, physical: &[Event], log: &[Event]) {
    let mut agreement = Agreement::default();
    agreement.add(sensor, physical, log);
    assert!(log.len() > 500, "{} events", log.len());
    assert_eq!(agreement.differing, 0);
    assert!(agreement.apart_ns(0.99) <= 20, "{} ns", agreement.apart_ns(0.99));
}

#[test]
fn it_follows_motion_vectors_as_the_log_pixel_does() {
    let (physical, log) = twins(Synthesis::Motion);
    let formats = (HdrFormat::F32x4, MotionFormat::F32x2);
    let sequence = scene(SceneKind::Flight, SIZE, &times(0, 4), formats.0, formats.1);
    let own = engine(&physical, &sequence);
    assert_same_polarities(&physical, &events(&own), &events(&engine(&log, &sequence)));
    assert_eq!(packets(&own), packets(&engine_with(&physical, &sequence, gpu())));
}

#[test]
fn it_follows_exact_paths_of_rigid_as_the_log_pixel_does() {
    let (physical, log) = twins(Synthesis::Rigid);
    let rendered = Rendered::of(SceneKind::Flight, SIZE, 4);
    let [physical_events, log_events] = [&physical, &log].map(|sensor| {
        let mut rig = rendered.rig(sensor, RigOptions::default());
        let mut events = Vec::new();
        for frame in &rendered.frames {
            rig.upload(0, &frame.bytes()).expect("a frame");
            events.extend(rig.step(&[frame.t_ns]).expect("a step").packets[0].iter());
        }
        events
    });
    assert_same_polarities(&physical, &physical_events, &log_events);
    assert_silent();
}

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
            let counts =
                |events: Vec<Event>| by_pixel(&sensor, &events).iter().map(Vec::len).collect::<Vec<_>>();
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
    for (pixel, events) in by_pixel(&sensor, &events(&got)).iter().enumerate() {
        assert!(events.len() as f64 <= seconds / 0.0007 + 1.0, "pixel {pixel}: {} events", events.len());
        let gaps = events.windows(2).map(|pair| pair[1].1 - pair[0].1);
        assert!(gaps.min().is_none_or(|gap_ns| gap_ns >= 700_000), "pixel {pixel}");
    }
}

#[test]
fn a_preset_in_the_dark_is_slow_and_in_light_fast() {
    // Delay of the first event of a step to the double, by illuminance.
    let mut before_ns = i64::MAX;
    for lux in [0.2, 2.0, 50.0] {
        let hd = SensorModel { width: 32, height: 8, ..preset("hd").expect("listed").with_preset_pixel() };
        let sensor = SensorModel {
            lux_per_unit: 1.0,
            noise_gain: 0.0,
            latency_ns: 0,
            contrast_mismatch: 0.0,
            substeps: 64,
            substep_policy: SubstepPolicy::Fixed,
            synthesis: Synthesis::Linear,
            ..hd
        };
        let step_ns = [0, 1_000_000, 1_010_000, 101_010_000];
        let sequence = gray(&sensor, &step_ns, |frame, _| (lux * if frame < 2 { 1.0 } else { 2.0 }) as f32);
        let got = events(&engine(&sensor, &sequence));
        assert!(got.iter().all(|event| event.polarity == Polarity::On), "{lux} lux");
        let delay_ns = got.iter().map(|event| event.t_ns).min().expect("an event") - 1_010_000;
        println!("{lux} lux: {delay_ns} ns");
        assert!(delay_ns < before_ns, "{lux} lux: {delay_ns} ns");
        before_ns = delay_ns;
    }
    assert!(before_ns < 500_000, "{before_ns} ns");
}
