//! A physical pixel without lag and noise sends what the log-intensity pixel sends.

use super::{Agreement, SIZE, gpu, packets, sensor, waves};
use esaac_engine::RigOptions;
use esaac_model::packet::Event;
use esaac_model::{HdrFormat, MotionFormat, Pixel, SensorModel, Synthesis};
use esaac_scene::SceneKind;
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{scene, times};
use esaac_tests::geometry::Rendered;
use esaac_tests::run::{engine, engine_with, events};

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
