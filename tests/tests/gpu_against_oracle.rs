//! Compares the engine with the float64 oracle: the same events at every pixel, in every mode and with every effect.

use esaac_engine::RigOptions;
use esaac_model::{
    HdrFormat, Intensity, MotionFormat, Profile, SensorModel, SubstepPolicy, Synthesis, Taps, Timestamps,
};
use esaac_scene::SceneKind;
use esaac_tests::agreement::{self, Agreement};
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{scene, times};
use esaac_tests::pairs::{Choice, every_pair};
use esaac_tests::run::{Step, engine_of_many};

/// Least share of pixels with the oracle's sequence of polarities, over all cases of a test (a requirement).
const SAME_SHARE: f64 = 0.9999;

/// Pixels needed to measure a share of one in ten thousand. With fewer pixels, one may differ.
const POOL_PX: usize = 10_000;

/// Least share of events within 2 us, regardless of their slope. The others lie on slopes so flat that the last bits of
/// the light decide their time.
const PROMPT_SHARE: f64 = 0.99;

/// Frames of a run. Three intervals, so that the motion of the frame before and gathered detail take effect.
const FRAMES: usize = 4;

/// Time of the first frame: far from zero, where times in single precision would be wrong.
const FIRST_NS: i64 = 20_000_000_007;

const FORMATS: [(HdrFormat, MotionFormat); 3] = [
    (HdrFormat::F32x4, MotionFormat::F32x2),
    (HdrFormat::F16x4, MotionFormat::F16x2),
    (HdrFormat::F32x4, MotionFormat::F32x4),
];

/// Odd sizes: the image cuts blocks off at the right and at the bottom. One size is narrower than a block.
const SIZES: [(u32, u32); 4] = [(45, 37), (37, 45), (61, 23), (7, 50)];

/// Scenes that run in every mode and with every effect. The scenes that are hard to synthesise run in the default mode
/// only: what is hard about them is no other code of the kernels.
const SCENES: [SceneKind; 7] = [
    SceneKind::Edge,
    SceneKind::Sinusoid,
    SceneKind::Lamp,
    SceneKind::Flight,
    SceneKind::Hdr,
    SceneKind::Dark,
    SceneKind::Still,
];

/// Runs one kernel permutation on all given scenes, as cameras of one rig. Sub-step policy, size and format vary from
/// camera to camera. Asserts that every difference is explained. [`check_share`] asserts how many there may be.
fn check(sensor: &SensorModel, scenes: &[SceneKind]) -> Agreement {
    let policies = [SubstepPolicy::Adaptive, SubstepPolicy::Fixed];
    let cameras: Vec<_> = scenes
        .iter()
        .enumerate()
        .map(|(number, &kind)| {
            let size = SIZES[number % SIZES.len()];
            let (hdr, motion) = FORMATS[number % FORMATS.len()];
            let substep_policy = policies[number % 2];
            let (width, height) = size;
            let sensor = SensorModel { width, height, substep_policy, ..sensor.clone() };
            (sensor, scene(kind, size, &times(FIRST_NS, FRAMES), hdr, motion))
        })
        .collect();
    let runs = engine_of_many(&cameras, RigOptions::default());
    let mut total = Agreement::default();
    for (number, ((sensor, sequence), steps)) in cameras.iter().zip(&runs).enumerate() {
        let got = agreement::compare(sensor, number as u32, sequence, steps);
        println!(
            "{:?}: {} events, {} of {} pixels differ ({} unexplained), {} late, {:.4} prompt",
            scenes[number],
            got.events,
            got.differing,
            got.pixels,
            got.unexplained.len(),
            got.late.len(),
            got.prompt_share()
        );
        check_packets(steps);
        total.add(got);
    }
    assert!(total.unexplained.is_empty(), "{sensor:?}:\n{}", total.unexplained.join("\n"));
    assert!(total.late.is_empty(), "{sensor:?}:\n{}", total.late.join("\n"));
    assert!(total.events > 0, "{sensor:?} sees nothing");
    assert!(total.prompt_share() >= PROMPT_SHARE, "{sensor:?}: {}", total.prompt_share());
    assert_silent();
    total
}

fn check_share(cases: impl IntoIterator<Item = Agreement>) {
    let mut total = Agreement::default();
    cases.into_iter().for_each(|case| total.add(case));
    let allowed = (1.0 - SAME_SHARE) * total.pixels.max(POOL_PX) as f64;
    assert!(total.differing as f64 <= allowed, "{} of {} pixels differ", total.differing, total.pixels);
}

fn check_packets(steps: &[Step]) {
    for step in steps {
        assert!(step.packet.is_sorted());
        assert_eq!(step.packet.dropped, 0);
    }
}

fn clean() -> SensorModel {
    SensorModel { contrast_on: 0.17, contrast_off: 0.23, seed: 77, ..SensorModel::default() }
}

#[test]
fn every_scene_in_the_default_mode() {
    let scenes: Vec<SceneKind> = SCENES.into_iter().chain(SceneKind::ALL).collect();
    check_share([check(&clean(), &scenes)]);
}

#[test]
fn motion_cubic() {
    let modes = [(Intensity::BayerRggb, 32), (Intensity::Gray, 8)];
    check_share(modes.into_iter().flat_map(|(intensity, substeps)| {
        [1, 2, 3].map(|transfers| check(&SensorModel { intensity, substeps, transfers, ..clean() }, &SCENES))
    }));
}

#[test]
fn motion_bilinear() {
    let modes = [(Intensity::Luminance, 64), (Intensity::BayerRggb, 8), (Intensity::Luminance, 1)];
    check_share(modes.map(|(intensity, substeps)| {
        check(&SensorModel { taps: Taps::Bilinear, intensity, substeps, ..clean() }, &SCENES)
    }));
}

#[test]
fn linear() {
    let modes = [(Intensity::Gray, 32), (Intensity::BayerRggb, 8), (Intensity::Luminance, 64)];
    check_share(modes.map(|(intensity, substeps)| {
        let sensor = SensorModel { synthesis: Synthesis::Linear, intensity, substeps, ..clean() };
        check(&sensor, &SCENES)
    }));
}

#[test]
fn paper() {
    let modes = [(Intensity::Luminance, 32), (Intensity::BayerRggb, 8)];
    check_share(modes.map(|(intensity, substeps)| {
        check(&SensorModel { synthesis: Synthesis::Paper, intensity, substeps, ..clean() }, &SCENES)
    }));
}

#[test]
fn none() {
    check_share(
        [Intensity::Gray, Intensity::Luminance, Intensity::BayerRggb].map(|intensity| {
            check(&SensorModel { synthesis: Synthesis::None, intensity, ..clean() }, &SCENES)
        }),
    );
}

#[test]
fn every_effect_alone() {
    let effects = [
        ("contrast_mismatch", "0.04"),
        ("refractory_ns", "3000000"),
        // Chosen so that no leak event of a still pixel falls on the run's last nanosecond, where rounding could remove
        // it from one of the streams.
        ("leak_rate_hz", "23"),
        ("shot_noise_rate_hz", "50"),
        ("latency_ns", "40000000"),
        ("latency_jitter_ns", "2000000"),
        ("timestamp_quantum_ns", "1000"),
        ("timestamps", "at_sample"),
    ];
    check_share(effects.map(|(parameter, value)| {
        println!("{parameter} = {value}");
        // An effect does not depend on the synthesis. `linear` compiles fastest of those that have sub-steps.
        let mut sensor = SensorModel { synthesis: Synthesis::Linear, ..clean() };
        sensor.set(parameter, value).expect("a valid effect");
        check(&sensor, &SCENES)
    }));
}

#[test]
fn all_effects_together() {
    let mut noisy = clean();
    Profile::Noisy.apply(&mut noisy);
    let loud = SensorModel {
        synthesis: Synthesis::Linear,
        substeps: 8,
        leak_rate_hz: 5.0,
        shot_noise_rate_hz: 50.0,
        white_level: 0.5,
        latency_jitter_ns: 300_000,
        aps_exposure_ns: 10_000_000,
        ..noisy.clone()
    };
    let sensors = [
        SensorModel { intensity: Intensity::BayerRggb, ..noisy },
        SensorModel { intensity: Intensity::Gray, ..loud.clone() },
        SensorModel { timestamps: Timestamps::AtSample, ..loud },
    ];
    check_share(sensors.map(|sensor| check(&sensor, &SCENES)));
}

/// Parameters that select a kernel's code, and effects that interact.
const CHOICES: [Choice; 14] = [
    ("synthesis", &["motion", "linear", "paper", "none"]),
    ("intensity", &["gray", "luminance", "bayer_rggb"]),
    ("substeps", &["32", "8", "1"]),
    ("taps", &["bilinear", "cubic"]),
    ("transfers", &["1", "2", "3"]),
    ("timestamps", &["interpolated", "at_sample"]),
    ("contrast_mismatch", &["0", "0.04"]),
    ("refractory_ns", &["0", "1500000"]),
    ("leak_rate_hz", &["0", "23"]),
    ("shot_noise_rate_hz", &["0", "50"]),
    ("latency_ns", &["0", "40000000"]),
    ("latency_jitter_ns", &["0", "300000"]),
    ("timestamp_quantum_ns", &["1", "1000"]),
    ("aps_exposure_ns", &["0", "10000000"]),
];

#[test]
fn every_two_parameters_together() {
    check_share(every_pair(&CHOICES).into_iter().map(|row| {
        let mut sensor = clean();
        for ((parameter, values), value) in CHOICES.iter().zip(row) {
            sensor.set(parameter, values[value]).expect("a valid value");
        }
        check(&sensor, &SCENES)
    }));
}
