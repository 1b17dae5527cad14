//! Wrong input: exit code 1 (2 for usage) and an error that names expected and actual. No test needs a
//! device, because input is checked before a device is opened.

use crate::harness::{Frames, HEIGHT, WIDTH, assert_error, colour, finish, run};
use exr::prelude::{AnyChannels, Encoding, Image, Layer, LayerAttributes, Vec2, WritableImage};

#[test]
fn usage_errors_exit_with_2() {
    for arguments in [
        &["simulate"][..],
        &["simulate", "x", "--contrast", "1"],
        &["simulate", "x", "--motion-convention", "sideways"],
        &["simulate", "x", "--motion-channels", "only.X"],
        &["--device", "fastest", "devices"],
        &["nonesuch"],
        &[],
    ] {
        assert_eq!(run(arguments).0, 2, "{arguments:?}");
    }
}

#[test]
fn a_missing_folder_and_a_file_in_its_place() {
    let frames = Frames::new(2, true);
    assert_error(&["simulate", "/nonesuch", "--out", "/tmp/e.npz"], &["no folder /nonesuch"]);
    let file = frames.file_argument("key_0000.exr");
    assert_error(&["simulate", &file, "--out", "/tmp/e.npz"], &["is a file", "expected a folder"]);
}

fn simulate_error(frames: &Frames, arguments: &[&str], parts: &[&str]) {
    let out = frames.file_argument("events.npz");
    let mut all = vec!["simulate", frames.argument(), "--out", &out];
    all.extend(arguments);
    assert_error(&all, parts);
    assert!(!frames.file("events.npz").exists(), "{arguments:?}");
}

#[test]
fn too_few_frames() {
    simulate_error(&Frames::empty(), &[], &["0 frames", "key_*.exr or *.exr", "at least 2"]);
    let frames = Frames::new(2, true);
    simulate_error(&frames, &["--frames", "key_*1.exr"], &["1 frames", "key_*1.exr", "at least 2"]);
}

#[test]
fn frames_of_several_sequences_are_listed() {
    let frames = Frames::empty();
    let write = |name: &str, index: usize| frames.write(name, index, (WIDTH, HEIGHT), Some(-2.0));
    for index in 0..3 {
        write(&format!("left_{index:04}.exr"), index);
        write(&format!("right_{index:04}.exr"), index);
    }
    let both = "left_*.exr (3 frames), right_*.exr (3 frames); choose one with --frames";
    simulate_error(&frames, &[], &["several sequences", both]);
    simulate_error(&frames, &["--frames", "*.exr"], &[both]);
    let frames = Frames::empty();
    for name in ["cam0_0.exr", "cam0_1.exr", "cam1_0.exr", "cam1_1.exr"] {
        frames.write(name, 0, (WIDTH, HEIGHT), Some(-2.0));
    }
    simulate_error(&frames, &[], &["cam0_*.exr (2 frames), cam1_*.exr (2 frames)", "--frames '*.exr'"]);
}

#[test]
fn frames_of_different_sizes() {
    let frames = Frames::new(2, true);
    frames.write("key_0002.exr", 2, (36, 23), Some(-2.0));
    simulate_error(&frames, &[], &["key_0002.exr", "36x23", "expected 37x23", "key_0000.exr"]);
}

#[test]
fn a_data_window_beside_the_display_window() {
    let frames = Frames::new(2, false);
    let channels = AnyChannels::sort(colour(0, (WIDTH, HEIGHT)).into_iter().collect());
    let layer = Layer::new((WIDTH, HEIGHT), LayerAttributes::default(), Encoding::FAST_LOSSLESS, channels);
    let mut image = Image::from_layer(layer);
    image.layer_data.attributes.layer_position = Vec2(3, -1);
    image.write().to_file(frames.file("key_0001.exr")).unwrap();
    let window = "37x23 px at (3, -1), expected the whole display window of 37x23 px at (0, 0)";
    simulate_error(&frames, &[], &["key_0001.exr", window]);
}

#[test]
fn a_sensor_of_another_size() {
    let frames = Frames::new(2, true);
    simulate_error(&frames, &["--sensor", "davis240"], &["--sensor davis240", "240x180", "37x23"]);
    let alone = &["with --width but its own height has 38x260 px", "37x23"];
    simulate_error(&frames, &["--width", "38"], alone);
    let both = &["with --width and --height has 38x24 px", "37x23"];
    simulate_error(&frames, &["--width", "38", "--height", "24"], both);
}

#[test]
fn missing_channels_are_named_with_what_is_there() {
    let frames = Frames::new(2, true);
    let there = "B, G, R, depth.Z, motion.X, motion.Y";
    simulate_error(&frames, &["--colour-channels", "R,G,Blue"], &["`Blue`", there]);
    simulate_error(&frames, &["--motion-channels", "Vector.X,Vector.Y"], &["Vector.X", there]);
    simulate_error(&frames, &["--motion-channels", "motion.X,motion.Z"], &["`motion.Z`", there]);
}

#[test]
fn motion_asked_for_by_name_and_missing() {
    let frames = Frames::new(2, false);
    simulate_error(&frames, &["--synthesis", "motion"], &["`motion.X` and `motion.Y`", "B, G, R", "linear"]);
    simulate_error(&frames, &["--profile", "paper"], &["`paper`", "linear"]);
    std::fs::write(frames.file("s.toml"), "synthesis = \"motion\"\n").unwrap();
    simulate_error(&frames, &["--sensor", &frames.file_argument("s.toml")], &["`motion`"]);
}

#[test]
fn motion_in_some_frames_only() {
    let frames = Frames::new(2, true);
    frames.write("key_0002.exr", 2, (37, 23), None);
    simulate_error(&frames, &[], &["key_0002.exr has no motion", "key_0000.exr has", "all or none"]);
}

#[test]
fn unreadable_and_truncated_frames() {
    let frames = Frames::new(3, true);
    std::fs::write(frames.file("key_0001.exr"), b"not an image").unwrap();
    simulate_error(&frames, &[], &["key_0001.exr (12 bytes)", "no OpenEXR file, or truncated"]);
    let whole = std::fs::read(frames.file("key_0002.exr")).unwrap();
    std::fs::write(frames.file("key_0001.exr"), &whole[..100]).unwrap();
    simulate_error(&frames, &[], &["key_0001.exr (100 bytes)", "truncated"]);
}

#[test]
fn sensor_parameters_out_of_range_or_unknown() {
    let frames = Frames::new(2, true);
    simulate_error(&frames, &["--contrast-on", "-0.2"], &["`contrast_on` is -0.2", "expected 0.0001 to 10"]);
    simulate_error(&frames, &["--substeps", "65"], &["`substeps` is 65", "1 to 64"]);
    simulate_error(&frames, &["--intensity", "red"], &["`intensity` cannot be `red`", "bayer_rggb"]);
    simulate_error(&frames, &["--sensor", "davis"], &["unknown sensor `davis`", "davis346"]);
    std::fs::write(frames.file("s.toml"), "contrast_one = 0.2\n").unwrap();
    simulate_error(&frames, &["--sensor", &frames.file_argument("s.toml")], &["s.toml", "contrast_one"]);
    simulate_error(&frames, &["--sensor", "/nonesuch.toml"], &["cannot read sensor file /nonesuch.toml"]);
}

#[test]
fn light_that_is_none_or_half_said() {
    let frames = Frames::new(2, true);
    simulate_error(&frames, &["--lux-per-unit", "-3"], &["`lux_per_unit` is -3", "expected"]);
    simulate_error(&frames, &["--temperature-c", "126"], &["`temperature_c` is 126", "-40 to 125"]);
    simulate_error(&frames, &["--temperature-c", "-41"], &["`temperature_c` is -41", "-40 to 125"]);
    simulate_error(&frames, &["--psf-sigma-px", "2"], &["`psf_sigma_px` is 2", "0 to 1", "3 px"]);
    simulate_error(&frames, &["--vignetting-fov-deg", "200"], &["`vignetting_fov_deg` is 200", "170"]);
    simulate_error(&frames, &["--flicker-depth", "1.2"], &["`flicker_depth` is 1.2", "0 to 1"]);
    let no_substeps = ["--flicker-depth", "0.2", "--synthesis", "none"];
    simulate_error(&frames, &no_substeps, &["`synthesis` is none", "one with sub-steps", "flicker_depth"]);
    simulate_error(&frames, &["--scene-unit", "luminance"], &["without --f-number", "expected both"]);
    simulate_error(&frames, &["--scene-unit", "lux", "--f-number", "2"], &["`lux`", "expected luminance"]);
}

#[test]
fn rates_that_are_none() {
    let frames = Frames::new(2, true);
    for command in [&["simulate", frames.argument()][..], &["render", "--out", "/nonesuch/a"]] {
        for rate in ["0", "NaN", "-30", "1e7"] {
            let (code, _, error) = run(&[command, &["--rate", rate]].concat());
            assert!(code == 2 && error.contains("expected 1 to 1000000"), "{command:?} {rate}: {error}");
        }
    }
    std::fs::write(frames.file("sequence.json"), "{\"key_rate_hz\": 0}").unwrap();
    simulate_error(&frames, &[], &["rate is 0 Hz", "expected 1 to 1000000"]);
    std::fs::write(frames.file("sequence.json"), "{\"key_rate_hz\": \"fast\"}").unwrap();
    simulate_error(&frames, &[], &["sequence.json", "expected f64"]);
}

#[test]
fn an_output_that_cannot_be_written() {
    let frames = Frames::new(2, true);
    assert_error(
        &["simulate", frames.argument(), "--out", "/nonesuch/e.npz"],
        &["/nonesuch/e.npz", "no folder"],
    );
    assert_error(&["simulate", frames.argument(), "--out", "/"], &["folder, expected the name of a file"]);
    for name in ["events.h5", "events.txt", "events"] {
        let out = frames.file_argument(name);
        assert_error(
            &["simulate", frames.argument(), "--out", &out],
            &[name, ".npz, .raw (EVT3) or .aedat4", "expected a name that ends so", "Python"],
        );
        assert!(!frames.file(name).exists());
    }
}

#[test]
fn an_output_that_is_another_output() {
    let frames = Frames::new(2, true);
    let [link, recording] = ["e.npz", "run.mcap"].map(|name| frames.file_argument(name));
    std::os::unix::fs::symlink(&recording, &link).unwrap();
    assert_error(
        &["simulate", frames.argument(), "--out", &link, "--record", &recording],
        &["run.mcap: it is the output", "e.npz"],
    );
}

#[test]
fn a_key_of_sequence_json_that_is_nearly_right() {
    let frames = Frames::new(2, true);
    let wrong = |text: &str, parts: &[&str]| {
        std::fs::write(frames.file("sequence.json"), text).unwrap();
        simulate_error(&frames, &[], &[&["sequence.json"], parts].concat());
    };
    wrong("{\"key_rate\": 60}", &["`key_rate`", "`key_rate_hz` is missing"]);
    wrong("{\"key_rate_hz\": 60, \"camera_to_wrld\": []}", &["`camera_to_wrld`", "`camera_to_world`"]);
    wrong("{\"key_rate_hz\": 60, \"instance\": {}}", &["`instance`", "`instances`"]);
    wrong("[]", &["the file begins with `[`, expected a JSON object"]);
    wrong("{\"key_rate_hz\": 60", &["ends too early, after 18 bytes"]);
}

#[test]
fn a_device_variable_that_is_empty_is_none() {
    let mut command = crate::harness::esaac(&["sensors", "vga"]);
    assert_eq!(finish(command.env("ESAAC_DEVICE", "").output().unwrap()).0, 0);
}

#[test]
fn a_device_variable_that_names_none_is_told_where_a_device_is_used() {
    let run_with = |arguments: &[&str]| {
        let mut command = crate::harness::esaac(arguments);
        finish(command.env("ESAAC_DEVICE", "foo").output().unwrap())
    };
    assert_eq!(run_with(&["sensors", "vga"]).0, 0);
    let frames = Frames::new(2, true);
    let out = frames.file_argument("events.npz");
    let simulate = ["simulate", frames.argument(), "--out", &out, "--synthesis", "none"];
    let (code, _, error) = run_with(&simulate);
    assert_eq!(code, 1);
    assert_eq!(
        error,
        "error: ESAAC_DEVICE is `foo`, expected a device's number or its UUID of 32 hexadecimal digits\n"
    );
    let (code, _, error) = run_with(&[&simulate[..], &["--device", "0"]].concat());
    assert_eq!(code, 0, "{error}");
    let (code, _, error) = run_with(&["simulate", "x", "--device", "bar"]);
    assert!(code == 2 && error.contains("--device"), "{error}");
}

#[test]
fn whole_seconds_are_told_as_such() {
    for seconds in ["0.1", "-1", "3601", "x"] {
        for flag in ["--burn-in", "--seconds", "--pixels"] {
            let (code, _, error) =
                run(&["characterise", "hd", flag, if flag == "--pixels" { "4097" } else { seconds }]);
            assert!(code == 2 && error.contains("expected a whole number, "), "{flag} {seconds}: {error}");
        }
    }
}

#[test]
fn values_say_what_is_expected() {
    let frames = Frames::new(2, true);
    simulate_error(&frames, &["--contrast-on", "x"], &["`contrast_on` cannot be `x`: expected a number"]);
    simulate_error(&frames, &["--substeps", "3.5"], &["`substeps` cannot be `3.5`: expected a whole number"]);
    simulate_error(&frames, &["--seed", "-1"], &["`seed` cannot be `-1`: expected a whole number, from 0"]);
}

#[test]
fn no_driver() {
    let frames = Frames::new(2, true);
    let out = frames.file_argument("events.npz");
    let without_driver = |arguments: &[&str]| {
        let mut command = crate::harness::esaac(arguments);
        command.env("VK_DRIVER_FILES", "/nonesuch.json").env("VK_ICD_FILENAMES", "/nonesuch.json");
        finish(command.output().unwrap())
    };
    let (code, _, error) = without_driver(&["simulate", frames.argument(), "--out", &out]);
    assert_eq!(code, 1, "{error}");
    assert!(error.contains("no Vulkan driver") && error.contains("mesa-vulkan-drivers"), "{error}");
    let (code, text, _) = without_driver(&["doctor"]);
    assert_eq!(code, 1);
    assert!(text.contains("MISSING") && text.contains("apt-get install mesa-vulkan-drivers"), "{text}");
    let (code, text, _) = without_driver(&["devices"]);
    assert_eq!(code, 1);
    assert!(text.contains("esaac doctor"), "{text}");
}

#[test]
fn no_loader() {
    let frames = Frames::new(2, true);
    std::fs::write(frames.file("libvulkan.so.1"), "no library").unwrap();
    let out = frames.file_argument("events.npz");
    let without_loader = |arguments: &[&str]| {
        let mut command = crate::harness::esaac(arguments);
        finish(command.env("LD_LIBRARY_PATH", frames.path()).output().unwrap())
    };
    let (code, _, error) = without_loader(&["simulate", frames.argument(), "--out", &out]);
    assert_eq!(code, 1, "{error}");
    assert!(error.contains("Vulkan loader") && error.contains("apt-get install libvulkan1"), "{error}");
    let (code, text, _) = without_loader(&["doctor"]);
    assert_eq!(code, 1);
    assert!(text.contains("MISSING") && text.contains("apt-get install libvulkan1"), "{text}");
}
