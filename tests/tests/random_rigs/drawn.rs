//! What is drawn is valid, and everything that may be drawn is.

use crate::case::{Case, Change, Refusal};
use esaac_engine::KernelSet;
use esaac_model::{HdrFormat, Intensity, MotionFormat, Pixel, ReadoutKind, SensorModel, Synthesis};
use esaac_scene::SceneKind;

const SEEDS: std::ops::Range<u64> = 0..2_000;

fn cases() -> Vec<Case> {
    SEEDS.map(Case::draw).collect()
}

/// All sensors of a case, with whether their camera gets motion vectors and a geometry.
fn sensors(case: &Case) -> Vec<(SensorModel, bool, bool)> {
    let of = |camera: usize| {
        let input = case.cameras[camera].input();
        case.sensors(camera).into_iter().map(move |sensor| (sensor, input.motion, input.geometry))
    };
    (0..case.cameras.len()).flat_map(of).collect()
}

#[test]
fn a_seed_gives_one_case_and_another_seed_another() {
    assert_eq!(Case::draw(17), Case::draw(17));
    assert_ne!(Case::draw(17), Case::draw(18));
    assert_ne!(Case::draw(17).to_string(), Case::draw(18).to_string());
}

#[test]
fn every_sensor_is_valid_and_gets_what_it_needs() {
    for (seed, case) in SEEDS.zip(cases()) {
        for (sensor, has_motion, has_geometry) in sensors(&case) {
            assert_eq!(sensor.validate(), Ok(()), "seed {seed}");
            assert!(has_motion || !sensor.synthesis.needs_motion(), "seed {seed}: {:?}", sensor.synthesis);
            assert!(has_geometry || sensor.synthesis != Synthesis::Rigid, "seed {seed}");
        }
    }
}

#[test]
fn all_that_a_user_may_combine_occurs() {
    let cases = cases();
    let sensors: Vec<SensorModel> = cases.iter().flat_map(sensors).map(|(sensor, ..)| sensor).collect();
    let some = |what: &str, holds: &dyn Fn(&SensorModel) -> bool| {
        let count = sensors.iter().filter(|sensor| holds(sensor)).count();
        assert!(count > 50 && count < sensors.len(), "{what}: {count} of {} sensors", sensors.len());
    };
    for synthesis in Synthesis::ALL {
        some(synthesis.name(), &|sensor| sensor.synthesis == synthesis);
    }
    for intensity in Intensity::ALL {
        some("intensity", &|sensor| sensor.intensity == intensity);
    }
    for readout in [ReadoutKind::None, ReadoutKind::Fifo, ReadoutKind::Rows] {
        some(readout.name(), &|sensor| sensor.readout == readout);
    }
    let physical = |sensor: &SensorModel| sensor.pixel == Pixel::Physical;
    some("physical without noise", &|sensor| physical(sensor) && sensor.noise_gain == 0.0);
    some("physical with noise", &|sensor| physical(sensor) && sensor.noise_gain > 0.0);
    // Each parameter but name and size has other values than the default's, and it or another one has the default's.
    let default = SensorModel::default();
    let table = |sensor: &SensorModel| toml::Table::try_from(sensor).expect("a sensor is a table");
    let (tables, default): (Vec<_>, _) = (sensors.iter().map(table).collect(), table(&default));
    for (name, value) in default.iter().filter(|(name, _)| *name != "name") {
        let others = tables.iter().filter(|table| table.get(name) != Some(value)).count();
        assert!(others > 50, "{name} is another than {value} in {others} sensors only");
    }
    let cameras: Vec<_> = cases.iter().flat_map(|case| &case.cameras).collect();
    for scene in SceneKind::ALL {
        assert!(cameras.iter().any(|camera| camera.scene == scene), "{scene:?}");
    }
    for hdr in [HdrFormat::F16x4, HdrFormat::F32x4, HdrFormat::Srgb8x4] {
        assert!(cameras.iter().any(|camera| camera.hdr == hdr), "{hdr:?}");
    }
    for motion in [None, Some(MotionFormat::F16x2), Some(MotionFormat::F32x2), Some(MotionFormat::F32x4)] {
        assert!(cameras.iter().any(|camera| camera.motion == motion), "{motion:?}");
    }
    for count in 1..=3 {
        assert!(cases.iter().any(|case| case.cameras.len() == count), "{count} cameras");
    }
    let ticks: Vec<_> = cases.iter().flat_map(|case| &case.ticks).collect();
    let changes: Vec<&Change> = ticks.iter().flat_map(|tick| &tick.changes).collect();
    assert!(changes.iter().any(|change| matches!(change, Change::Reset(_))));
    assert!(changes.iter().any(|change| matches!(change, Change::Sensor(..))));
    for refusal in [Refusal::ShortImage, Refusal::NoMotion, Refusal::SameTime, Refusal::OtherSize] {
        assert!(changes.iter().any(|change| matches!(change, Change::Refused(_, r) if *r == refusal)));
    }
    let frames = ticks.iter().flat_map(|tick| &tick.frames);
    assert!(frames.clone().any(Option::is_none), "a camera is skipped");
    let spoils: Vec<_> = frames.flatten().map(|frame| frame.spoils).collect();
    assert!(
        spoils.iter().any(|spoils| spoils.colour_one_in > 0) && spoils.iter().any(|s| s.motion_one_in == 1)
    );
    assert!(spoils.iter().any(|spoils| spoils.depth_one_in > 0) && spoils.iter().any(|s| s.ids_one_in > 0));
    for kernels in [KernelSet::Gpu, KernelSet::SoftwareDriver] {
        let has = |case: &Case| case.other_options.policy.is_some_and(|policy| policy.kernels == kernels);
        assert!(cases.iter().any(has), "{kernels:?}");
    }
}
