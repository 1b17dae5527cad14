//! `sensors`, `devices` and `doctor`.

use crate::harness::{assert_error, run};
use esaac_model::SensorModel;

#[test]
fn sensors_prints_a_file_that_simulate_reads() {
    let (code, text, _) = run(&["sensors", "genx320", "--toml"]);
    assert_eq!(code, 0);
    let sensor = SensorModel::from_toml(&text).unwrap();
    assert_eq!((sensor.name.as_str(), sensor.width, sensor.height), ("genx320", 320, 320));
}

#[test]
fn sensors_as_json_holds_presets_and_parameters() {
    let (code, text, _) = run(&["sensors", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(code, 0);
    assert_eq!(json["presets"].as_array().unwrap().len(), esaac_model::PRESETS.len());
    assert_eq!(json["parameters"].as_array().unwrap().len(), esaac_model::PARAMETERS.len());
    assert_eq!(json["presets"][3]["parameters"]["width"], 346);
}

#[test]
fn sensors_shows_a_file_and_what_is_wrong_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    let mine = path.to_str().unwrap();
    std::fs::write(&path, "name = \"mine\"\nwidth = 64\nreadout_row_ns = 5.0\ndark_lux = 0.1\n").unwrap();
    let (code, text, error) = run(&["sensors", mine]);
    assert_eq!(code, 0, "{error}");
    assert!(text.contains(&format!("sensor file {mine}")) && text.contains("mine"), "{text}");
    assert!(text.contains("note: `readout_row_ns` does nothing: --readout is none"), "{text}");
    assert!(text.contains("note: `dark_lux` does nothing: it is for --pixel physical alone"), "{text}");
    let (code, text, error) = run(&["sensors", mine, "--pixel", "physical", "--json"]);
    assert_eq!(code, 0, "{error}");
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let [sensor] = &json["presets"].as_array().unwrap()[..] else { panic!("{text}") };
    assert_eq!((&sensor["name"], &sensor["parameters"]["width"]), (&"mine".into(), &64.into()));
    assert_eq!(sensor["notes"].as_array().unwrap().len(), 1, "{sensor}");
    let (code, text, error) = run(&["sensors", mine, "--toml"]);
    assert_eq!(code, 0, "{error}");
    let sensor = SensorModel::from_toml(&text).unwrap();
    assert_eq!((sensor.width, sensor.dark_lux), (64, 0.1));
    for (text, part) in [("contrast_on = -1.0\n", "`contrast_on` is -1"), ("contrast = 1.0\n", "contrast")] {
        std::fs::write(&path, text).unwrap();
        assert_error(&["sensors", mine], &["mine.toml", part]);
    }
    assert_error(&["sensors", "/nonesuch.toml"], &["cannot read sensor file /nonesuch.toml"]);
}

/// The sensor file that `esaac sensors` prints with these arguments.
fn printed(arguments: &[&str]) -> SensorModel {
    let (code, text, error) = run(&[&["sensors"], arguments, &["--toml"]].concat());
    assert_eq!(code, 0, "{error}");
    SensorModel::from_toml(&text).unwrap()
}

#[test]
fn a_printed_preset_with_another_pixel_has_the_numbers_of_that_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hd.toml");
    let file = path.to_str().unwrap();
    let [log, physical] = ["log", "physical"].map(|pixel| printed(&["hd", "--pixel", pixel]));
    assert_ne!(SensorModel { pixel: log.pixel, ..physical.clone() }, log);
    for (own, pixel, expected) in [(&log, "physical", &physical), (&physical, "log", &log)] {
        let change = |sensor: &SensorModel| SensorModel { contrast_on: 0.3, seed: 7, ..sensor.clone() };
        std::fs::write(&path, change(own).to_toml()).unwrap();
        assert_eq!(printed(&[file, "--pixel", pixel]), change(expected), "{pixel}");
    }
    let other = SensorModel { name: "other".to_owned(), ..physical };
    std::fs::write(&path, other.to_toml()).unwrap();
    assert_error(
        &["sensors", file, "--pixel", "log"],
        &["hd.toml", "`leak_rate_hz` is -0.06, expected 0 to 100"],
    );
}

#[test]
fn an_unknown_sensor_is_an_error() {
    assert_error(&["sensors", "davis"], &["unknown sensor `davis`", "davis240"]);
    assert_error(&["sensors", "vga", "--toml", "--json"], &["--toml and --json", "expected one"]);
}

#[test]
fn devices_and_doctor_find_what_this_machine_has() {
    let (code, text, error) = run(&["devices", "--json"]);
    assert_eq!(code, 0, "{text}{error}");
    let devices: serde_json::Value = serde_json::from_str(&text).unwrap();
    let uuid = devices[0]["uuid"].as_str().unwrap();
    assert_eq!(uuid.len(), 36, "{uuid}");
    let (code, text, error) = run(&["doctor", "--device", uuid]);
    assert_eq!(code, 0, "{text}{error}");
    assert!(!text.contains("MISSING"), "{text}");
    for row in ["ROS 2 network", "ROS 2 receive buffer", "glslc (to build, and for --glsl)"] {
        assert!(text.contains(row), "{row}: {text}");
    }
    let (code, text, _) = run(&["doctor", "--device", "99"]);
    assert_eq!(code, 1);
    assert!(text.contains("99"), "{text}");
}
