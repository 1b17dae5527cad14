//! `esaac demo`, small.

use crate::harness::{assert_error, run};

const SMALL: [&str; 6] = ["--width", "48", "--height", "40", "--frames", "4"];

#[test]
fn a_demo_that_cannot_be_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let started = std::time::Instant::now();
    let wide = ["demo", "--out", out, "--width", "20000", "--height", "20000"];
    assert_error(&wide, &["`width` is 20000", "1 to 16384"]);
    assert!(started.elapsed().as_secs() < 20, "{:?}", started.elapsed());
    let (code, _, error) = run(&["demo", "--out", out, "--frames", "two"]);
    assert!(code == 2 && error.contains("expected a whole number, 2 to 100000"), "{error}");
}

#[test]
fn it_writes_a_picture_events_and_the_report_it_prints() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut arguments = vec!["demo", "--json", "--out", out.to_str().unwrap()];
    arguments.extend(SMALL);
    let (code, text, error) = run(&arguments);
    assert_eq!(code, 0, "{error}");
    assert_eq!(std::fs::read_to_string(out.join("report.json")).unwrap(), text);
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["intervals"], 3);
    assert_eq!(report["cameras"][0]["sensor"]["intensity"], "luminance");
    assert_eq!(report["cameras"][1]["sensor"]["intensity"], "bayer_rggb");
    for camera in report["cameras"].as_array().unwrap() {
        let accuracy = &camera["accuracy"];
        assert!(accuracy["exact_events"].as_u64().unwrap() > 50, "{accuracy}");
        assert!(accuracy["f1"].as_f64().unwrap() > 0.5, "{accuracy}");
    }
    let picture = std::fs::File::open(out.join("overview.png")).unwrap();
    let picture = png::Decoder::new(std::io::BufReader::new(picture)).read_info().unwrap();
    assert!(picture.info().width > 5 * 48);
    assert!(out.join("events.npz").metadata().unwrap().len() > 1000);
}

#[test]
fn a_still_scene_has_no_events() {
    let folder = tempfile::tempdir().unwrap();
    let mut arguments = vec!["demo", "--json", "--scene", "still", "--out", folder.path().to_str().unwrap()];
    // Kernels that the validation layer checks quickly.
    arguments.extend(["--taps", "bilinear"]);
    arguments.extend(SMALL);
    let (code, text, error) = run(&arguments);
    assert_eq!(code, 0, "{error}");
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["cameras"][0]["events"], 0);
    assert_eq!(report["cameras"][0]["accuracy"]["exact_sequences"], 1.0);
}

#[test]
fn what_is_assumed_of_a_physical_pixel_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let mut arguments = vec!["demo", "--json", "--in-process", "--out", folder.path().to_str().unwrap()];
    arguments.extend(SMALL);
    arguments.extend(["--sensor", "vga", "--taps", "bilinear", "--pixel", "physical"]);
    let (code, text, error) = run(&arguments);
    assert_eq!(code, 0, "{error}");
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    for camera in report["cameras"].as_array().unwrap() {
        let notes = camera["notes"].as_array().unwrap();
        assert_eq!(notes.len(), 2, "{notes:?}");
        assert!(notes[0].as_str().unwrap().contains("by --lux-per-unit"), "{notes:?}");
    }
}

#[test]
fn exact_paths_are_simulated_in_one_process_and_in_two() {
    let folder = tempfile::tempdir().unwrap();
    let mut arguments = vec!["demo", "--json", "--scene", "poles", "--out", folder.path().to_str().unwrap()];
    arguments.extend(SMALL);
    let f1 = |synthesis: &str, in_process: &[&str]| {
        let (code, text, error) = run(&[&arguments[..], in_process, &["--synthesis", synthesis]].concat());
        assert_eq!(code, 0, "{error}");
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(report["cameras"][0]["sensor"]["synthesis"], synthesis);
        report["cameras"][0]["accuracy"]["f1"].as_f64().unwrap()
    };
    let motion = f1("motion", &["--in-process", "--layers", "1"]);
    for in_process in [&["--in-process"][..], &[]] {
        let rigid = f1("rigid", in_process);
        assert!(rigid > motion + 0.4, "{in_process:?}: rigid {rigid}, motion {motion}");
    }
}

#[test]
fn an_unknown_scene_is_a_usage_error_that_lists_them() {
    let (code, _, error) = run(&["demo", "--scene", "nonesuch"]);
    assert_eq!(code, 2);
    assert!(error.contains("nonesuch") && error.contains("sinusoid"), "{error}");
}

#[test]
fn a_folder_that_cannot_be_made_is_named() {
    assert_error(&["demo", "--out", "/proc/nonesuch"], &["cannot make folder /proc/nonesuch"]);
}
