//! `esaac simulate` on small folders of frames, and its event file as NumPy reads it.

use crate::harness::{Frames, HEIGHT, WIDTH, colour, esaac, finish, recorded_messages, run};
use esaac_formats::recording::{Recording, RecordingError, aedat4, evt3};
use exr::prelude::{AnyChannel, FlatSamples};
use std::path::Path;
use std::process::Command;

/// For tests that are not about the engine: the validation layer checks this kernel in seconds, and the
/// default one in a minute.
const QUICK: [&str; 2] = ["--synthesis", "none"];

/// The same, with motion.
const QUICK_MOTION: [&str; 2] = ["--taps", "bilinear"];

fn channel_of(name: &str, values: Vec<f32>) -> AnyChannel<FlatSamples> {
    AnyChannel::new(name, FlatSamples::F32(values))
}

fn simulate(frames: &Frames, arguments: &[&str]) -> (i32, serde_json::Value, String) {
    let out = frames.file_argument("events.npz");
    let mut all = vec!["simulate", frames.argument(), "--json", "--out", &out];
    all.extend(arguments);
    let (code, text, error) = run(&all);
    let report = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}{error}"));
    (code, report, error)
}

/// The first of the usual Pythons that has NumPy.
fn numpy_python() -> String {
    let given = std::env::var("ESAAC_PYTHON").ok();
    given
        .into_iter()
        .chain(["python3".to_owned(), "/usr/bin/python3".to_owned()])
        .find(|python| {
            Command::new(python).args(["-c", "import numpy"]).output().is_ok_and(|o| o.status.success())
        })
        .expect("a Python with NumPy: apt-get install python3-numpy, or name one in ESAAC_PYTHON")
}

#[test]
fn events_report_and_file_agree_and_numpy_reads_them() {
    let frames = Frames::new(4, true);
    let (code, report, error) = simulate(&frames, &["--contrast-on", "0.15"]);
    assert_eq!(code, 0, "{error}");
    let camera = &report["cameras"][0];
    assert_eq!(camera["sensor"]["width"], WIDTH);
    assert_eq!(camera["sensor"]["height"], HEIGHT);
    assert_eq!(camera["sensor"]["synthesis"], "motion");
    assert_eq!(report["intervals"], 3);
    assert!(camera["on"].as_u64().unwrap() > 100 && camera["off"].as_u64().unwrap() > 100, "{camera}");
    assert!(report["memory_bytes"].as_u64().unwrap() > 0);

    let script = "
import json, sys, numpy
file = numpy.load(sys.argv[1])
x, y, t, p = (file[name] for name in 'xytp')
assert [a.dtype.str for a in (x, y, t, p)] == ['<u2', '<u2', '<i8', '|i1'], 'types'
assert (numpy.diff(t) >= 0).all() and t.min() > 0 and t.max() <= 100_000_000, 'times'
assert x.max() < 37 and y.max() < 23 and set(numpy.unique(p)) == {-1, 1}, 'ranges'
print(json.dumps({'on': int((p == 1).sum()), 'off': int((p == -1).sum()), 'sensor': str(file['sensor'])}))
";
    let python = Command::new(numpy_python()).args(["-c", script]).arg(frames.file("events.npz")).output();
    let (code, text, error) = finish(python.unwrap());
    assert_eq!(code, 0, "{error}");
    let read: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&read["on"], &read["off"]), (&camera["on"], &camera["off"]));
    let sensor = esaac_model::SensorModel::from_toml(read["sensor"].as_str().unwrap()).unwrap();
    assert_eq!((sensor.contrast_on, sensor.width), (0.15, WIDTH as u32));
}

#[test]
fn a_sensor_that_nobody_names_is_custom() {
    let frames = Frames::new(2, true);
    let (out, file) = (frames.file_argument("e.npz"), frames.file_argument("mine.toml"));
    std::fs::write(&file, "contrast_on = 0.3\n").unwrap();
    for sensor in [&[][..], &["--sensor", &file]] {
        let arguments = ["simulate", frames.argument(), "--json", "--out", &out];
        let (code, text, error) = run(&[&arguments[..], &QUICK, sensor].concat());
        assert_eq!(code, 0, "{error}");
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(report["cameras"][0]["sensor"]["name"], "custom", "{sensor:?}");
    }
}

#[test]
fn the_ending_of_out_says_the_format() {
    let frames = Frames::new(3, true);
    let read = |name: &str, read: fn(&Path) -> Result<Recording, RecordingError>| {
        let out = frames.file_argument(name);
        let arguments = ["simulate", frames.argument(), "--json", "--out", &out];
        let (code, text, error) = run(&[&arguments[..], &QUICK].concat());
        assert_eq!(code, 0, "{error}");
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(report["files"], serde_json::json!([out]));
        let recording = read(frames.file(name).as_ref()).unwrap();
        assert_eq!((recording.width_px as usize, recording.height_px as usize), (WIDTH, HEIGHT));
        assert_eq!(report["cameras"][0]["events"], recording.events.len(), "{name}");
        recording.events
    };
    let evt3 = read("events.raw", evt3::read);
    assert!(evt3.len() > 100 && evt3 == read("events.aedat4", aedat4::read));
}

#[test]
fn the_light_of_a_physical_pixel_is_told() {
    let frames = Frames::new(3, false);
    let light =
        ["--synthesis", "none", "--pixel", "physical", "--scene-unit", "luminance", "--f-number", "2"];
    let (code, report, error) = simulate(&frames, &light);
    assert_eq!(code, 0, "{error}");
    let camera = &report["cameras"][0];
    // .9 pi / 16 lux for each cd/m2; most of the image has .1 cd/m2.
    assert!((camera["sensor"]["lux_per_unit"].as_f64().unwrap() - 0.1767).abs() < 1e-4, "{camera}");
    assert!((camera["light"]["median_lux"].as_f64().unwrap() / 0.0177 - 1.0).abs() < 0.1, "{camera}");
    assert!(camera["light"]["dim_share"].as_f64().unwrap() > 0.8, "{camera}");
    assert_eq!(camera["light_warnings"].as_array().unwrap().len(), 0, "no preset");
    let [out, bag] = ["events.npz", "run.mcap"].map(|name| frames.file_argument(name));
    let recorded = ["simulate", frames.argument(), "--out", &out, "--record", &bag];
    let (_, text, _) = run(&[&recorded, &light[..]].concat());
    let dim = "of pixels below 0.10 lux";
    assert!(text.contains("light") && text.contains(dim), "{text}");
    let diagnostics = recorded_messages(bag.as_ref(), "/diagnostics");
    let last = String::from_utf8_lossy(diagnostics.last().expect("the last is of the end"));
    assert!(last.contains("esaac: camera camera_0") && last.contains(dim), "{last}");

    let hd = esaac_model::presets::preset_with_physical_pixel("hd").unwrap();
    let (width, height) = (WIDTH as u32, HEIGHT as u32);
    let hd = esaac_model::SensorModel { width, height, lux_per_unit: 1000.0, ..hd };
    std::fs::write(frames.file("hd.toml"), hd.to_toml()).unwrap();
    let (_, report, error) =
        simulate(&frames, &["--synthesis", "none", "--sensor", &frames.file_argument("hd.toml")]);
    let warning = report["cameras"][0]["light_warnings"][0].as_str().unwrap();
    assert!(warning.contains("0.15 to 20 focal-plane lux; 100% of pixels have more"), "{warning}");
    assert!(error.contains(&format!("warning: {warning}")), "{error}");
}

#[test]
fn what_is_assumed_of_a_physical_pixel_is_told() {
    let frames = Frames::new(3, false);
    let size = [WIDTH, HEIGHT].map(|px| px.to_string());
    let vga = ["--synthesis", "none", "--sensor", "vga", "--width", &size[0], "--height", &size[1]];
    let physical = [&vga[..], &["--pixel", "physical"]].concat();
    let (code, report, error) = simulate(&frames, &physical);
    assert_eq!(code, 0, "{error}");
    let notes = report["cameras"][0]["notes"].as_array().unwrap();
    assert_eq!(notes.len(), 2, "{notes:?}");
    let out = frames.file_argument("events.npz");
    let (_, text, _) = run(&[&["simulate", frames.argument(), "--out", &out], &physical[..]].concat());
    for (note, part) in notes.iter().zip(["1 is 100 focal-plane lux", "`vga` is fitted to no measurement"]) {
        let note = note.as_str().unwrap();
        assert!(note.contains(part) && text.contains(&format!("note           {note}")), "{note}: {text}");
    }
    let (_, report, _) = simulate(&frames, &vga);
    assert_eq!(report["cameras"][0]["notes"].as_array().unwrap().len(), 0, "a log pixel");
}

#[test]
fn events_that_wait_after_the_last_frame_are_told() {
    let frames = Frames::new(4, true);
    let counts = |arguments: &[&str]| {
        let (code, report, error) = simulate(&frames, &[&QUICK[..], arguments].concat());
        assert_eq!(code, 0, "{error}");
        let camera = &report["cameras"][0];
        let [events, waiting] = ["events", "waiting_at_end"].map(|name| camera[name].as_u64().unwrap());
        assert_eq!(error.contains(&format!("warning: camera 0: {waiting} events are missing")), waiting > 0);
        (events, waiting)
    };
    let (all, none) = counts(&[]);
    assert!(all > 100 && none == 0);
    // The frames span 100 ms.
    for latency_ns in ["40000000", "100000000"] {
        let (events, waiting) = counts(&["--latency-ns", latency_ns]);
        assert!(waiting > 0 && events + waiting == all, "{events} and {waiting} of {all}");
    }
    let out = frames.file_argument("events.npz");
    let late = [&["simulate", frames.argument(), "--out", &out, "--latency-ns", "100000000"], &QUICK[..]];
    assert!(run(&late.concat()).1.contains(&format!("{all} events are missing")));
}

#[test]
fn dropped_events_are_counted_and_exit_with_3() {
    let frames = Frames::new(3, true);
    let (code, report, error) =
        simulate(&frames, &[&QUICK[..], &["--max-events-per-interval", "10"]].concat());
    assert_eq!(code, 3, "{error}");
    assert!(report["cameras"][0]["dropped"].as_u64().unwrap() > 0);
    assert_eq!(report["cameras"][0]["events"], 20);
}

#[test]
fn the_rate_comes_from_the_flag_else_the_folder_else_is_thirty() {
    let frames = Frames::new(3, true);
    let check = |arguments: &[&str], span_ns: i64, hz: f64, from: &str| {
        let report = simulate(&frames, &[&QUICK[..], arguments].concat()).1;
        assert_eq!(report["simulated_ns"], span_ns);
        assert_eq!(report["key_rate"]["hz"], hz);
        assert!(report["key_rate"]["from"].as_str().unwrap().contains(from), "{}", report["key_rate"]);
    };
    check(&[], 66_666_667, 30.0, "default");
    std::fs::write(frames.file("sequence.json"), "{\"key_rate_hz\": 50}").unwrap();
    check(&[], 40_000_000, 50.0, "sequence.json");
    check(&["--rate", "100"], 20_000_000, 100.0, "--rate");
}

#[test]
fn a_convention_is_undone_before_the_engine_sees_it() {
    let events = |motion_x: f32, arguments: &[&str]| {
        let frames = Frames::with_motion_x(4, Some(motion_x));
        assert_eq!(simulate(&frames, &[&QUICK_MOTION[..], arguments].concat()).0, 0);
        std::fs::read(frames.file("events.npz")).unwrap()
    };
    let plain = events(-2.0, &[]);
    assert!(plain == events(2.0, &["--motion-convention", "negated"]));
    assert!(plain == events(-2.0, &["--motion-convention", "blender"]), "y is 0 here, up or down");
    assert!(plain != events(2.0, &[]), "the bar moves the other way");
}

#[test]
fn a_frame_cut_short_leaves_no_event_file() {
    let frames = Frames::new(3, true);
    let whole = std::fs::read(frames.file("key_0002.exr")).unwrap();
    std::fs::write(frames.file("key_0002.exr"), &whole[..whole.len() - 40]).unwrap();
    let out = frames.file_argument("events.npz");
    let (code, _, error) = run(&["simulate", frames.argument(), "--out", &out, "--synthesis", "none"]);
    assert_eq!(code, 1);
    assert!(error.contains("key_0002.exr") && error.contains("truncated"), "{error}");
    assert!(!frames.file("events.npz").exists());
}

#[test]
fn a_file_s_name_need_not_be_utf_8() {
    use std::os::unix::ffi::OsStrExt;
    let frames = Frames::new(2, true);
    let out = frames.path().join(std::ffi::OsStr::from_bytes(b"ou\xff.npz"));
    let mut command = esaac(&["simulate", frames.argument(), "--synthesis", "none", "--out"]);
    let (code, _, error) = finish(command.arg(&out).output().unwrap());
    assert_eq!(code, 0, "{error}");
    assert!(out.exists());
}

#[test]
fn a_frame_that_is_missing_in_the_numbers_is_told() {
    let frames = Frames::new(4, false);
    assert!(!simulate(&frames, &QUICK).2.contains("missing"));
    std::fs::remove_file(frames.file("key_0001.exr")).unwrap();
    let (_, report, error) = simulate(&frames, &QUICK);
    let told = "after key_0000.exr comes key_0002.exr";
    assert!(error.contains(&format!("warning: {told}")), "{error}");
    assert!(report["warnings"][0].as_str().unwrap().starts_with(told), "{}", report["warnings"]);
}

#[test]
fn frames_that_cannot_be_used_are_told() {
    let pixels = WIDTH * HEIGHT;
    let told = |count: usize, value: f32, channel: &str| {
        let frames = Frames::empty();
        for index in 0..3 {
            let mut list = colour(index, (WIDTH, HEIGHT));
            list.extend(["motion.X", "motion.Y"].map(|name| channel_of(name, vec![0.0; pixels])));
            let mut values = vec![0.5; pixels];
            values[..count].fill(value);
            list.retain(|other| other.name.to_string() != channel);
            list.push(channel_of(channel, values));
            frames.write_channels(&format!("key_{index:04}.exr"), (WIDTH, HEIGHT), list);
        }
        let (code, report, error) = simulate(&frames, &QUICK_MOTION);
        assert_eq!(code, 0, "{error}");
        let told = report["cameras"][0]["frame_warning"].as_str().unwrap_or_default().to_owned();
        assert_eq!(error.contains(&format!("warning: {told}")), !told.is_empty(), "{error}");
        assert_eq!(report["warnings"].as_array().unwrap().len(), usize::from(!told.is_empty()), "{error}");
        told
    };
    for value in [f32::NAN, f32::INFINITY, -0.1] {
        assert!(
            told(pixels, value, "G").starts_with("100% of the pixels have a colour that is NaN, infinite")
        );
    }
    assert!(told(pixels / 10, f32::NAN, "G").starts_with("10% of the pixels have a colour"));
    assert_eq!(told(pixels / 100, f32::NAN, "G"), "");
    assert!(told(pixels, f32::NAN, "motion.Y").starts_with("100% of the pixels have a motion vector"));
    assert_eq!(told(pixels / 3, f32::NAN, "motion.Y"), "", "a background without vectors");
}

#[test]
fn frames_before_zero_come_first() {
    let events = |names: [&str; 4]| {
        let frames = Frames::empty();
        for (index, name) in names.into_iter().enumerate() {
            frames.write(name, index, (WIDTH, HEIGHT), Some(-2.0));
        }
        let (code, report, error) = simulate(&frames, &QUICK);
        assert_eq!((code, &report["intervals"]), (0, &3.into()), "{error}");
        assert!(!error.contains("missing"), "{error}");
        std::fs::read(frames.file("events.npz")).unwrap()
    };
    let plain = events(["f_0000.exr", "f_0001.exr", "f_0002.exr", "f_0003.exr"]);
    assert!(plain == events(["f_-0002.exr", "f_-0001.exr", "f_0000.exr", "f_0001.exr"]));
    assert!(plain == events(["f-0002.exr", "f-0001.exr", "f0000.exr", "f0001.exr"]));
    assert!(plain == events(["f-0001.exr", "f-0002.exr", "f-0003.exr", "f-0004.exr"]));
}

#[test]
fn names_that_may_be_of_other_sequences_are_told() {
    let frames = Frames::empty();
    for name in ["cam0_0.exr", "cam0_1.exr", "cam1_0.exr", "cam1_1.exr"] {
        frames.write(name, 0, (WIDTH, HEIGHT), None);
    }
    let (code, report, error) = simulate(&frames, &[&QUICK[..], &["--frames", "*.exr"]].concat());
    assert_eq!((code, &report["intervals"]), (0, &3.into()), "{error}");
    assert!(error.contains("warning: the frames seem to be several sequences, and are played as one: cam0"));
    let frames = Frames::empty();
    for name in ["f_0.exr", "f_1.exr", "reference.exr"] {
        frames.write(name, 0, (WIDTH, HEIGHT), None);
    }
    let error = simulate(&frames, &QUICK).2;
    assert!(error.contains("warning: reference.exr: not named like the other frames"), "{error}");
}

#[test]
fn flags_that_do_nothing_are_told() {
    let frames = Frames::new(2, false);
    let flags = ["--dark-lux", "0.1", "--motion-convention", "negated"];
    let (code, report, error) = simulate(&frames, &[&QUICK[..], &flags].concat());
    assert_eq!(code, 0, "{error}");
    let lines: Vec<&str> = error.lines().filter_map(|line| line.strip_prefix("warning: ")).collect();
    assert_eq!(report["warnings"], serde_json::json!(lines));
    assert!(error.contains("warning: --dark-lux does nothing: it is for --pixel physical alone"), "{error}");
    assert!(
        error.contains("warning: --motion-convention does nothing: the frames have no motion"),
        "{error}"
    );
    let (_, report, error) = simulate(&frames, &QUICK);
    assert!(!error.contains("does nothing"));
    assert_eq!(report["warnings"], serde_json::json!([]));
}

#[test]
fn flags_of_aps_frames_that_go_nowhere_are_told() {
    let frames = Frames::new(2, false);
    let aps = ["--aps-exposure-ns", "1000000", "--aps-bits", "10", "--white-level", "2"];
    let told = |more: &[&str]| {
        let (code, _, error) = simulate(&frames, &[&QUICK[..], &aps, more].concat());
        assert_eq!(code, 0, "{error}");
        let why = " does nothing: APS frames leave by --ros on or --record alone";
        ["--aps-exposure-ns", "--aps-bits", "--white-level"]
            .map(|flag| error.contains(&format!("{flag}{why}")))
    };
    assert_eq!(told(&[]), [true; 3]);
    assert_eq!(told(&["--record", &frames.file_argument("aps.mcap")]), [false; 3]);
}

#[test]
fn keys_of_a_sensor_file_that_do_nothing_are_told() {
    let frames = Frames::new(2, false);
    std::fs::write(frames.file("mine.toml"), "dark_lux = 0.5\nnoise_gain = 0.5\nreadout_event_ns = 5.0\n")
        .unwrap();
    let mine = frames.file_argument("mine.toml");
    let error = |more: &[&str]| simulate(&frames, &[&QUICK[..], &["--sensor", &mine], more].concat()).2;
    let told = format!("warning: {mine}: `dark_lux`, `noise_gain` do nothing: for a physical pixel alone");
    assert!(error(&[]).contains(&told), "{}", error(&[]));
    assert!(!error(&["--pixel", "physical"]).contains("nothing"), "{}", error(&["--pixel", "physical"]));
}

#[test]
fn events_go_through_a_pipe_and_the_report_beside_it() {
    let frames = Frames::new(3, true);
    let events = |out: &str| {
        let output = esaac(&["simulate", frames.argument(), "--json", "--out", out, "--synthesis", "none"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        (output.stdout, output.stderr)
    };
    let (report, _) = events(&frames.file_argument("events.npz"));
    let plain = std::fs::read(frames.file("events.npz")).unwrap();
    let (piped, told) = events("/dev/stdout");
    assert!(piped == plain, "{} and {} bytes", piped.len(), plain.len());
    let [report, told]: [serde_json::Value; 2] =
        [report, told].map(|text| serde_json::from_slice(&text).unwrap());
    assert_eq!(report["cameras"][0]["events"], told["cameras"][0]["events"]);
    // The same where it goes to a file.
    let to_file = std::fs::File::create(frames.file("redirected")).unwrap();
    let mut command = esaac(&["simulate", frames.argument(), "--out", "/dev/stdout", "--synthesis", "none"]);
    let output = command.stdout(to_file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(std::fs::read(frames.file("redirected")).unwrap() == plain);
}

#[test]
fn a_full_disk_is_named() {
    let frames = Frames::new(3, true);
    let output = esaac(&["simulate", frames.argument(), "--out", "/dev/full", "--synthesis", "none"])
        .output()
        .unwrap();
    let (code, _, error) = finish(output);
    assert_eq!(code, 1);
    assert!(error.starts_with("error: cannot write /dev/full") && error.lines().count() == 1, "{error}");
    assert_eq!(error.matches("No space left on device").count(), 1, "{error}");
}
