//! `bench` and `calibrate`.

use crate::harness::{Frames, assert_error, run};
use esaac_tests::recording::{record, save, sensor};

/// How far a fitted threshold may be off, as a share of it.
const THRESHOLD_SHARE: f64 = 0.08;

#[test]
fn bench_writes_figures_tables_and_plots() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let results = folder.path().join("RESULTS.md");
    std::fs::write(&results, "# Results\n\n## Another device\n\nIts figures.\n").unwrap();
    let measured = ["bench", "--quick", "--part", "time", "--only", "dvs128", "--json"];
    let places = ["--out", out, "--write-results", results.to_str().unwrap()];
    let (code, text, error) = run(&[&measured[..], &places[..]].concat());
    assert_eq!(code, 0, "{error}");
    let printed: serde_json::Value = serde_json::from_str(&text).unwrap();
    let file = std::fs::read_to_string(folder.path().join("bench.json")).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(&file).unwrap(), printed);
    let rows = printed["parts"]["time"].as_array().unwrap();
    // A quick run has fewer sub-steps than x32 too, except on a software driver. At x32 each tap count has two modes,
    // `rigid` has two, and layers and the physical pixel have one.
    assert_eq!(rows.iter().filter(|row| row["substeps"] == 32).count(), 8, "{rows:?}");
    for row in rows {
        assert_eq!(row["sensor"], "dvs128", "{row}");
        let [median, floor] =
            [&row["gpu_us"]["median"], &row["floor_us"]].map(|figure| figure.as_f64().unwrap());
        // Three ticks of a busy machine may be quicker than its memory was a moment before.
        assert!(median > 0.1 * floor && floor > 0.0, "{row}");
        assert!(row["events"].as_f64().unwrap() > 100.0, "{row}");
    }
    assert_eq!(printed["clock"]["reference_us"].as_array().unwrap().len(), 2);
    let markdown = std::fs::read_to_string(folder.path().join("bench.md")).unwrap();
    assert!(markdown.contains("## Time per interval") && markdown.contains("| dvs128 |"), "{markdown}");
    assert!(markdown.contains("(time.svg)"), "{markdown}");
    let svg = std::fs::read_to_string(folder.path().join("time.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("x32 bayer"));
    let results = std::fs::read_to_string(results).unwrap();
    let device = printed["device"].as_str().unwrap();
    assert!(results.starts_with("# Results\n\n## Another device\n\nIts figures.\n\n## "), "{results}");
    let parts =
        [&format!("## {device}\n\n### Time per interval"), "| dvs128 |", printed["driver"].as_str().unwrap()];
    for part in parts.into_iter().chain(["part `time` of `esaac bench --part time --quick --only dvs128`"]) {
        assert!(results.contains(part), "no `{part}` in {results}");
    }
}

#[test]
fn what_bench_lacks_or_would_spoil_is_told_before_it_measures() {
    let folder = tempfile::tempdir().unwrap();
    let notes = folder.path().join("notes.txt");
    std::fs::write(&notes, "notes").unwrap();
    let out = folder.path().to_str().unwrap();
    let bench = ["bench", "--quick", "--out", out, "--part"];
    let results = ["time", "--write-results", notes.to_str().unwrap()];
    let (code, _, error) = run(&[&bench[..], &results].concat());
    assert!(code == 2 && error.contains("expected a name that ends in .md"), "{error}");
    assert_eq!(std::fs::read(&notes).unwrap(), b"notes");
    let parts = ["`real-sensor` has no recording", "--recording FILE.aedat4"];
    assert_error(&[&bench[..], &["real-sensor"]].concat(), &parts);
    assert_error(&["bench", "--out", notes.to_str().unwrap()], &["it is a file, expected a folder"]);
}

#[test]
fn a_sensor_that_calibrate_writes_is_one_that_simulate_takes() {
    let frames = Frames::new(3, true);
    let (toml, events) = (frames.file_argument("fitted.toml"), frames.file_argument("events.npz"));
    let recording = frames.file_argument("recording.aedat4");
    let known = sensor();
    save(recording.as_ref(), &record(&known, 21));
    let (code, text, error) = run(&["calibrate", &recording, "--out", &toml, "--json"]);
    assert_eq!(code, 0, "{error}");
    let fit: serde_json::Value = serde_json::from_str(&text).unwrap();
    for (parameter, true_log) in [("contrast_on", known.contrast_on), ("contrast_off", known.contrast_off)] {
        let log = fit["sensor"][parameter].as_f64().unwrap();
        assert!((log / true_log - 1.0).abs() < THRESHOLD_SHARE, "{parameter}: {log}, expected {true_log}");
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
    let broken = frames.file_argument("broken.aedat4");
    std::fs::write(&broken, b"#!AER-DAT4.0\r\n\x10\0\0\0aaaaaaaaaaaaaaaaaaaa").unwrap();
    assert_error(&["calibrate", &broken], &["broken.aedat4: the header: byte 1633771873", "below 16"]);
    assert_error(&["calibrate", &frame, "--log-offset", "2"], &["--log-offset is 2", "1e-6 to 1"]);
    let list = frames.file_argument("list.toml");
    std::fs::write(&list, "[[exposure]]\nfile = \"a1.npz\"\nlux = 1.0\n").unwrap();
    let overwritten = frames.file_argument("a1.npz");
    assert_error(&["calibrate", &list, "--out", &overwritten], &["a1.npz", "expected a name that ends so"]);
    let raw = frames.file_argument("a.raw");
    assert_error(&["calibrate", &raw], &["a.raw has no APS frames"]);
    std::fs::write(&list, "[[exposure]]\nfile = \"a.raw\"\nlux = 1.0\n").unwrap();
    for (text, part) in [
        ("% evt 2.1\n% geometry 1280x720\n% end\n", "`evt 2.1`, expected `evt 3.0`"),
        ("% evt 3.0\n% geometry 8x8\n% end\n\0\x10", "the word at byte 31 is of kind 1"),
    ] {
        std::fs::write(&raw, text).unwrap();
        assert_error(&["calibrate", &list], &["a.raw: ", part]);
    }
    let roundabout = frames.file_argument("./list.toml");
    assert_error(&["calibrate", &list, "--out", &roundabout], &["list.toml: it is the input", "another"]);
    assert_error(&["bench", "--out", "/dev/null/bench"], &["/dev/null/bench"]);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let only = ["bench", "--quick", "--part", "time", "--only", "nonesuch", "--out", out];
    assert_error(&only, &["no row's name contains `nonesuch`", "dvs128"]);
    let without_rows = ["bench", "--quick", "--part", "memory", "--only", "dvs128", "--out", out];
    assert_error(&without_rows, &["`dvs128`", "expected one of the parts that have such: frontier, time"]);
}
