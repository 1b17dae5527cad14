//! `bench` and `calibrate`.

use crate::harness::{Frames, assert_error, run};
use std::path::Path;

fn recording() -> String {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/recordings/davis346_emlb_demo01.aedat4");
    path.to_str().expect("UTF-8").to_owned()
}

#[test]
fn bench_writes_figures_tables_and_plots() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let arguments = ["bench", "--quick", "--part", "time", "--only", "dvs128", "--json", "--out", out];
    let (code, text, error) = run(&arguments);
    assert_eq!(code, 0, "{error}");
    let printed: serde_json::Value = serde_json::from_str(&text).unwrap();
    let file = std::fs::read_to_string(folder.path().join("bench.json")).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(&file).unwrap(), printed);
    let rows = printed["parts"]["time"].as_array().unwrap();
    assert_eq!(rows.len(), 4);
    for row in rows {
        assert_eq!(row["sensor"], "dvs128", "{row}");
        let [median, floor] =
            [&row["gpu_us"]["median"], &row["floor_us"]].map(|figure| figure.as_f64().unwrap());
        assert!(median > floor && floor > 0.0, "{row}");
        assert!(row["events"].as_f64().unwrap() > 100.0, "{row}");
    }
    assert_eq!(printed["clock"]["reference_us"].as_array().unwrap().len(), 2);
    let markdown = std::fs::read_to_string(folder.path().join("bench.md")).unwrap();
    assert!(markdown.contains("## Time per interval") && markdown.contains("| dvs128 |"), "{markdown}");
    assert!(markdown.contains("(time.svg)"), "{markdown}");
    let svg = std::fs::read_to_string(folder.path().join("time.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("x32 bayer"));
}

#[test]
fn a_sensor_that_calibrate_writes_is_one_that_simulate_takes() {
    let frames = Frames::new(3, true);
    let (toml, events) = (frames.file_argument("fitted.toml"), frames.file_argument("events.npz"));
    let (code, text, error) = run(&["calibrate", &recording(), "--out", &toml, "--json"]);
    assert_eq!(code, 0, "{error}");
    let fit: serde_json::Value = serde_json::from_str(&text).unwrap();
    for (parameter, low, high) in [("contrast_on", 0.25, 0.45), ("contrast_off", 0.25, 0.5)] {
        let value = fit["sensor"][parameter].as_f64().unwrap();
        assert!((low..high).contains(&value), "{parameter}: {value}");
    }
    let size = ["--width", "37", "--height", "23"];
    let arguments = ["simulate", frames.argument(), "--sensor", &toml, "--out", &events];
    let (code, _, error) = run(&[&arguments[..], &size[..]].concat());
    assert_eq!(code, 0, "{error}");
}

#[test]
fn wrong_input_is_named() {
    assert_error(&["calibrate", "/nonesuch.aedat4"], &["/nonesuch.aedat4"]);
    let frames = Frames::new(1, false);
    let frame = frames.file_argument("key_0000.exr");
    assert_error(&["calibrate", &frame], &["key_0000.exr", "not an AEDAT 4 file"]);
    assert_error(&["calibrate", &frame, "--log-offset", "2"], &["--log-offset is 2", "1e-6 to 1"]);
    assert_error(&["bench", "--out", "/dev/null/bench"], &["/dev/null/bench"]);
}
