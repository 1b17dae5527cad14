//! Tests of the parameters: names, TOML, ranges.

use super::*;

#[test]
fn toml_round_trips_and_refuses_unknown_keys() {
    let sensor = SensorModel { contrast_on: 0.3, intensity: Intensity::BayerRggb, ..SensorModel::default() };
    assert_eq!(SensorModel::from_toml(&sensor.to_toml()), Ok(sensor));
    let error = SensorModel::from_toml("contrast_one = 0.2").unwrap_err().to_string();
    assert!(error.contains("contrast_one"), "{error}");
}

#[test]
fn a_file_without_a_name_is_of_no_preset() {
    let name = |text: &str| SensorModel::from_toml(text).unwrap().name;
    assert_eq!((name("contrast_on = 0.3").as_str(), name("").as_str()), (CUSTOM, CUSTOM));
    assert_eq!(name("name = \"mine\""), "mine");
    assert_eq!(SensorModel::from_toml("contrast_on = 0.3").unwrap().width, SensorModel::default().width);
}

#[test]
fn auto_is_the_best_that_the_input_allows_and_a_choice_stays() {
    let auto = |geometry, motion| Synthesis::Auto.resolve(geometry, motion);
    assert_eq!(auto(true, true), Synthesis::Rigid);
    assert_eq!(auto(true, false), Synthesis::Rigid);
    assert_eq!(auto(false, true), Synthesis::Motion);
    assert_eq!(auto(false, false), Synthesis::Linear);
    for chosen in Synthesis::ALL.into_iter().filter(|&s| s != Synthesis::Auto) {
        assert_eq!(chosen.resolve(true, true), chosen);
        assert_eq!(chosen.resolve(false, false), chosen);
    }
}

#[test]
fn names_are_those_of_toml() {
    for synthesis in Synthesis::ALL {
        let sensor = SensorModel { synthesis, ..SensorModel::default() };
        assert!(sensor.to_toml().contains(&format!("synthesis = \"{}\"", synthesis.name())));
    }
}

#[test]
fn every_parameter_is_settable_by_name_and_shown_in_toml() {
    let toml = SensorModel::default().to_toml();
    for parameter in PARAMETERS {
        assert!(toml.contains(&format!("{} = ", parameter.name)), "{}", parameter.name);
    }
    let mut sensor = SensorModel::default();
    sensor.set("contrast-on", "0.25").unwrap();
    sensor.set("intensity", "bayer_rggb").unwrap();
    sensor.set("latency_ns", "100_000").unwrap();
    sensor.set("pixel", "physical").unwrap();
    sensor.set("temperature-c", "-12.5").unwrap();
    assert_eq!((sensor.pixel, sensor.temperature_c), (Pixel::Physical, -12.5));
    assert_eq!((sensor.contrast_on, sensor.latency_ns), (0.25, 100_000));
    assert!(matches!(sensor.set("contrast", "1"), Err(SensorError::Unknown(_))));
    assert!(matches!(sensor.set("substeps", "many"), Err(SensorError::Value { .. })));
    assert!(matches!(sensor.set("intensity", "red"), Err(SensorError::Value { .. })));
    assert!(matches!(sensor.set("substeps", "-1"), Err(SensorError::Value { .. })));
}

#[test]
fn every_parameter_of_the_physical_pixel_is_one_of_the_sensor() {
    let names: Vec<&str> = PARAMETERS.iter().map(|parameter| parameter.name).collect();
    for parameter in crate::physical::PHYSICAL_PARAMETERS {
        assert!(names.contains(&parameter.name), "{}", parameter.name);
    }
    let sensor = SensorModel { leak_rate_hz: 0.1, ..SensorModel::default() };
    assert_eq!(sensor.physical_pixel(), PhysicalPixel::default(), "the defaults agree");
    let pixel = PhysicalPixel { dark_lux: 0.5, leak_rate_hz: -2.0, ..PhysicalPixel::default() };
    let physical = sensor.with_physical(&pixel);
    assert_eq!((physical.physical_pixel(), physical.validate()), (pixel, Ok(())));
    assert_eq!(physical.dark_level(), 0.005, "in scene units");
    let error = SensorModel { pixel: Pixel::Log, ..physical }.validate().unwrap_err().to_string();
    assert!(error.contains("leak_rate_hz"), "only a physical pixel leaks to OFF: {error}");
}

/// TOML has no larger numbers. A sensor with a larger seed could neither be written nor be part of a saved rig.
#[test]
fn the_largest_seed_can_be_written() {
    let sensor = SensorModel { seed: i64::MAX as u64, ..SensorModel::default() };
    assert_eq!(SensorModel::from_toml(&sensor.to_toml()), Ok(sensor));
}

#[test]
fn a_blur_wider_than_the_apron_names_the_largest() {
    let wide = SensorModel { psf_sigma_px: 2.5, ..SensorModel::default() };
    let error = wide.validate().unwrap_err().to_string();
    assert!(error.contains("`psf_sigma_px` is 2.5, expected 0 to 1: ") && error.contains("3 px"), "{error}");
}

#[test]
fn out_of_range_names_the_parameter() {
    let base = SensorModel::default();
    let with_bus = |readout| SensorModel { readout, readout_row_ns: 130.0, ..SensorModel::default() };
    for readout in [ReadoutKind::Fifo, ReadoutKind::Rows] {
        assert_eq!(with_bus(readout).validate(), Ok(()));
    }
    for (sensor, parameter) in [
        (SensorModel { contrast_on: 0.0, ..base.clone() }, "contrast_on"),
        (SensorModel { contrast_off: f64::NAN, ..base.clone() }, "contrast_off"),
        (SensorModel { transfers: 4, ..base.clone() }, "transfers"),
        (SensorModel { substeps: 0, ..base.clone() }, "substeps"),
        (SensorModel { substeps: 65, ..base.clone() }, "substeps"),
        (SensorModel { width: 0, ..base.clone() }, "width"),
        (SensorModel { log_offset: 0.0, ..base.clone() }, "log_offset"),
        (SensorModel { latency_jitter_ns: 900_000_000, ..base.clone() }, "latency_ns"),
        (SensorModel { lux_per_unit: -1.0, ..base.clone() }, "lux_per_unit"),
        (SensorModel { lux_per_unit: f64::NAN, ..base.clone() }, "lux_per_unit"),
        (SensorModel { temperature_c: -40.5, ..base.clone() }, "temperature_c"),
        (SensorModel { psf_sigma_px: 1.01, ..base.clone() }, "psf_sigma_px"),
        (SensorModel { psf_sigma_px: -0.5, ..base.clone() }, "psf_sigma_px"),
        (SensorModel { vignetting_fov_deg: 180.0, ..base.clone() }, "vignetting_fov_deg"),
        (SensorModel { flicker_depth: 1.5, ..base.clone() }, "flicker_depth"),
        (SensorModel { flicker_hz: 0.0, ..base.clone() }, "flicker_hz"),
        (SensorModel { flicker_hz: 1e4, ..base.clone() }, "flicker_hz"),
        (SensorModel { flicker_phase_deg: f64::INFINITY, ..base.clone() }, "flicker_phase_deg"),
        (SensorModel { flicker_depth: 0.1, synthesis: Synthesis::None, ..base.clone() }, "synthesis"),
        (SensorModel { temperature_c: 126.0, ..base.clone() }, "temperature_c"),
        (SensorModel { readout_event_ns: 0.0, ..with_bus(ReadoutKind::Fifo) }, "readout_event_ns"),
        (SensorModel { readout_event_ns: -1.0, ..base.clone() }, "readout_event_ns"),
        (SensorModel { readout_event_ns: f64::NAN, ..with_bus(ReadoutKind::Rows) }, "readout_event_ns"),
        (SensorModel { readout_event_ns: 2e6, ..with_bus(ReadoutKind::Fifo) }, "readout_event_ns"),
        (SensorModel { readout_row_ns: 0.0, ..with_bus(ReadoutKind::Rows) }, "readout_row_ns"),
        (SensorModel { readout_row_ns: f64::INFINITY, ..base.clone() }, "readout_row_ns"),
        (SensorModel { readout_cap_events: 5, ..base.clone() }, "readout_cap_events"),
        (SensorModel { seed: 1 << 63, ..base.clone() }, "seed"),
        (SensorModel { readout_cap_period_ns: 0, ..with_bus(ReadoutKind::Fifo) }, "readout_cap_period_ns"),
    ] {
        match sensor.validate() {
            Err(SensorError::Range { parameter: actual, .. }) => assert_eq!(actual, parameter),
            other => panic!("{parameter}: {other:?}"),
        }
    }
}
