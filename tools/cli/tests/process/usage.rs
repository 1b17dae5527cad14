//! The command line itself: its version, and options that are given twice.

use crate::harness::{Frames, assert_error, esaac, finish, run};

/// The commit that the build script found; empty if the sources are no checkout.
const COMMIT: &str = env!("ESAAC_COMMIT");

#[test]
fn the_version_names_release_commit_and_features() {
    let (code, text, _) = run(&["--version"]);
    let line = text.trim_end();
    assert_eq!((code, text.lines().count()), (0, 1), "{text}");
    assert!(line.starts_with(concat!("esaac ", env!("CARGO_PKG_VERSION"), " (commit ")), "{text}");
    let commit = if COMMIT.is_empty() { "unknown" } else { COMMIT };
    assert!(line.contains(&format!("(commit {commit}")), "{text}, expected {commit}");
    assert_eq!(line.contains("features: none)"), !cfg!(feature = "zenoh"), "{text}");
    assert_eq!(run(&["-V"]).1, text);
}

#[test]
fn the_version_as_json_says_the_same() {
    let (code, text, _) = run(&["--version", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((code, &json["version"]), (0, &env!("CARGO_PKG_VERSION").into()));
    let plain = run(&["--version"]).1;
    assert_eq!(json["commit"].as_str().unwrap_or_default(), COMMIT);
    for feature in json["features"].as_array().unwrap() {
        assert!(plain.contains(feature.as_str().unwrap()), "{plain}{text}");
    }
    assert_eq!(run(&["--json", "--version"]).1, text);
}

#[test]
fn of_an_option_that_is_given_twice_the_last_one_counts() {
    let frames = Frames::new(2, true);
    let (first, last) = (frames.file_argument("first.npz"), frames.file_argument("last.npz"));
    let simulate = ["simulate", frames.argument(), "--json", "--synthesis", "motion", "--substeps", "32"];
    let more = ["--json", "--synthesis", "none", "--substeps", "8", "--out", &first, "--out", &last];
    let (code, text, error) = run(&[&simulate[..], &more].concat());
    assert_eq!(code, 0, "{error}");
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    let sensor = &report["cameras"][0]["sensor"];
    assert_eq!((&sensor["substeps"], &sensor["synthesis"]), (&8.into(), &"none".into()));
    assert!(frames.file("last.npz").exists() && !frames.file("first.npz").exists());
}

#[test]
fn an_option_that_collects_keeps_every_value() {
    let frames = Frames::new(2, true);
    let (out, record) = (frames.file_argument("e.npz"), frames.file_argument("r.mcap"));
    let simulate = ["simulate", frames.argument(), "--out", &out, "--record", &record];
    for qualities in [["nonesuch=reliable", "events=depth:3"], ["events=depth:3", "nonesuch=reliable"]] {
        let more = ["--ros-qos", qualities[0], "--ros-qos", qualities[1]];
        assert_error(&[&simulate[..], &more].concat(), &["`nonesuch`", "events"]);
    }
}

#[test]
fn a_standard_output_that_is_full_is_named() {
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let (code, _, error) = finish(esaac(&["sensors", "--json"]).stdout(full).output().unwrap());
    assert_eq!(code, 1, "{error}");
    assert!(error.starts_with("error: cannot write standard output: No space left"), "{error}");
}

#[test]
fn an_environment_variable_that_says_nothing_known_is_an_error_where_it_is_read() {
    let frames = Frames::new(2, true);
    let out = frames.file_argument("e.npz");
    let with =
        |arguments: &[&str]| finish(esaac(arguments).env("ESAAC_VALIDATION", "banana").output().unwrap());
    let (code, _, error) = with(&["simulate", frames.argument(), "--out", &out]);
    assert_eq!(code, 1, "{error}");
    assert!(error.contains("error: ESAAC_VALIDATION is `banana`, expected 1, calls or 0"), "{error}");
    let (code, _, error) = with(&["sensors", "hd"]);
    assert_eq!(code, 0, "{error}");
}

#[test]
fn a_device_that_is_not_there_is_not_listed_either() {
    let uuid = "01112131-4151-6171-8191-a1b1c1d1e1f1";
    for device in ["99", uuid] {
        assert_error(
            &["devices", "--device", device],
            &[&format!("no Vulkan device {device}; there are: 0 ")],
        );
    }
    assert_eq!(run(&["devices", "--device", "0"]).0, 0);
}

#[test]
fn a_negative_share_is_a_value_and_not_another_argument() {
    let calibrate = |flag: &str, value: &str, part: &str| {
        let arguments = ["calibrate", "a.aedat4", "--pixel", "physical", flag, value];
        assert_error(&arguments, &[part]);
    };
    calibrate("--log-offset", "-1", "--log-offset is -1, expected 1e-6 to 1");
    calibrate("--white-lux", "-2.5", "--white-lux is -2.5, expected 1e-6 to 1e6");
}
