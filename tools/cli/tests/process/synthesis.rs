//! Which synthesis `esaac simulate` takes, what it says about it, and when it warns of the frames.

use crate::harness::{Frames, assert_error, run};
use esaac_ros::BagReader;
use serde_json::Value;
use std::io::Read;

/// Size of the frames.
const SMALL: [&str; 4] = ["--width", "48", "--height", "36"];

/// A folder of a built-in scene.
fn rendered(scene: &str, frames: &str) -> Frames {
    let folder = Frames::empty();
    let head = ["render", "--out", folder.argument(), "--scene", scene, "--frames", frames];
    let (code, _, error) = run(&[&head[..], &SMALL].concat());
    assert_eq!(code, 0, "{error}");
    folder
}

fn simulate(frames: &Frames, arguments: &[&str]) -> (Value, String) {
    let out = frames.file_argument("events.npz");
    let (code, text, error) =
        run(&[&["simulate", frames.argument(), "--json", "--out", &out], arguments].concat());
    assert_eq!(code, 0, "{error}");
    (serde_json::from_str(&text).unwrap(), error)
}

/// What was asked for, what was used, why, and the sensor's own word.
fn chosen(report: &Value) -> [&str; 4] {
    fn word(value: &Value) -> &str {
        value.as_str().unwrap_or("")
    }
    let of = &report["synthesis"];
    [
        word(&of["asked"]),
        word(&of["used"]),
        word(&of["reason"]),
        word(&report["cameras"][0]["sensor"]["synthesis"]),
    ]
}

#[test]
fn auto_takes_the_best_that_the_frames_allow_and_says_which() {
    let posed = rendered("bounce", "3");
    let (report, error) = simulate(&posed, &[]);
    assert_eq!(chosen(&report), ["auto", "rigid", "there are depth and poses", "rigid"]);
    assert!(!error.contains("warning"), "{error}");
    let diagnostics = &report["cameras"][0]["diagnostics"];
    for counter in ["without_depth", "without_poses", "without_lens", "unseen_samples"] {
        assert!(diagnostics[counter].is_u64(), "{diagnostics}");
    }
    assert!(report["memory"].as_array().unwrap().iter().any(|m| m["purpose"] == "input depth"));

    let out = posed.file_argument("events.npz");
    let (_, text, _) = run(&["simulate", posed.argument(), "--out", &out]);
    assert!(text.contains("synthesis rigid (auto: there are depth and poses)"), "{text}");

    std::fs::remove_file(posed.file("sequence.json")).unwrap();
    let (report, _) = simulate(&posed, &[]);
    assert_eq!(chosen(&report), ["auto", "motion", "there are motion vectors, but no poses", "motion"]);
    assert!(report["memory"].as_array().unwrap().iter().all(|m| m["purpose"] != "input depth"));

    let (report, error) = simulate(&Frames::new(3, false), &[]);
    let reason = "there are no channels `motion.X` and `motion.Y`, and no poses";
    assert_eq!(chosen(&report), ["auto", "linear", reason, "linear"]);
    assert!(!error.contains("warning"), "{error}");
}

#[test]
fn a_synthesis_by_name_is_taken_whatever_else_there_is() {
    let posed = rendered("bounce", "3");
    for name in ["none", "linear", "motion"] {
        let (report, _) = simulate(&posed, &["--synthesis", name]);
        assert_eq!(chosen(&report), [name, name, "", name]);
        assert_eq!(report["synthesis"]["reason"], Value::Null);
        assert!(report["memory"].as_array().unwrap().iter().all(|m| m["purpose"] != "input depth"));
    }
}

#[test]
fn rigid_by_name_without_what_it_needs_is_an_error_that_says_what() {
    let error = |frames: &Frames, parts: &[&str]| {
        let out = frames.file_argument("events.npz");
        let parts = [&["`rigid` needs depth and poses", "`auto`"], parts].concat();
        assert_error(&["simulate", frames.argument(), "--out", &out, "--synthesis", "rigid"], &parts);
    };
    error(&Frames::new(3, true), &["there are no poses"]);
    let posed = rendered("shake", "4");
    let text = std::fs::read_to_string(posed.file("sequence.json")).unwrap();
    let mut sequence: Value = serde_json::from_str(&text).unwrap();
    // Poses of the first two intervals only.
    sequence["camera_to_world"].as_array_mut().unwrap().truncate(65);
    for poses in sequence["instances"].as_object_mut().unwrap().values_mut() {
        poses.as_array_mut().unwrap().truncate(65);
    }
    std::fs::write(posed.file("sequence.json"), sequence.to_string()).unwrap();
    error(&posed, &["poses for all intervals", "poses from 0 to 66666667 ns", "span 0 to 100000000 ns"]);
    let (report, _) = simulate(&posed, &["--taps", "bilinear"]);
    assert_eq!(chosen(&report)[1], "motion");
    assert!(chosen(&report)[2].contains("no poses for all intervals"), "{report}");
    // Frames without depth.
    let flat = Frames::new(3, false);
    let still = "{\"key_rate_hz\": 30, \"intrinsics\": {\"fx\": 30, \"fy\": 30, \"cx\": 18, \"cy\": 11}, \
                 \"pose_rate_hz\": 30, \
                 \"camera_to_world\": [[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]]}";
    std::fs::write(flat.file("sequence.json"), still).unwrap();
    error(&flat, &["poses without depth"]);
}

#[test]
fn fast_motion_that_nothing_tells_is_warned_of() {
    let shaken = rendered("shake", "6");
    let (report, error) = simulate(&shaken, &["--synthesis", "linear"]);
    let found = &report["input_check"];
    assert!(found["motion_px"].as_f64().unwrap() > 2.0, "{found}");
    let warning = found["warning"].as_str().unwrap();
    assert!(
        warning.contains("two places at once") && error.contains(&format!("warning: {warning}")),
        "{error}"
    );
    let (report, error) = simulate(&shaken, &["--synthesis", "motion", "--taps", "bilinear"]);
    assert!(report["input_check"]["off_parabola_px"].as_f64().unwrap() > 0.5, "{report}");
    assert!(error.contains("leaves a parabola"), "{error}");
    let out = shaken.file_argument("events.npz");
    let (_, text, _) = run(&["simulate", shaken.argument(), "--out", &out, "--synthesis", "linear"]);
    assert!(text.lines().any(|line| line.starts_with("warning   part of the image moves")), "{text}");

    let still = rendered("lamp", "4");
    let (report, error) = simulate(&still, &["--synthesis", "linear"]);
    assert_eq!(report["input_check"]["warning"], Value::Null, "{report}");
    assert!(!error.contains("warning"), "{error}");
    let (report, _) = simulate(&still, &["--synthesis", "none"]);
    let found = &report["input_check"];
    assert_eq!((&found["motion_px"], &found["off_parabola_px"]), (&Value::Null, &Value::Null), "{found}");
    assert!(found["grain_log"].as_f64().unwrap() < 0.01 && found["warning"] == Value::Null, "{found}");
}

#[test]
fn instances_of_events_are_written_beside_them_and_what_lacks_them_is_told() {
    let posed = rendered("bounce", "3");
    let recording = posed.file_argument("run.mcap");
    simulate(&posed, &["--event-ids", "--record", &recording]);
    let file = std::fs::File::open(posed.file("events.npz")).unwrap();
    let mut archive = zip::ZipArchive::new(file).unwrap();
    let mut column = |name: &str| {
        let mut bytes = Vec::new();
        archive.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
        let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        bytes.split_off(start)
    };
    let ids: Vec<i64> =
        column("id.npy").chunks(8).map(|b| i64::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(8 * ids.len(), column("t.npy").len());
    // The same are published: behind header, sequence and length of each message of ids.
    let (mut bag, mut published) = (BagReader::open(recording.as_ref()).unwrap(), Vec::new());
    while let Some(message) = bag.next_message().unwrap() {
        if bag.topics()[message.topic].name == "/esaac/camera_0/event_ids" {
            published
                .extend(message.bytes[68..].chunks(8).map(|b| i64::from_le_bytes(b.try_into().unwrap())));
        }
    }
    assert_eq!(published, ids);
    let of = |wanted: i64| ids.iter().filter(|&&id| id == wanted).count();
    // The ball, and the wall behind it.
    let ball = ids.iter().copied().find(|&id| id > 0).unwrap();
    assert!(of(ball) > 100 && of(0) > 100 && of(ball) + of(0) == ids.len(), "{} and {}", of(ball), of(0));

    let refused = |frames: &Frames, name: &str, arguments: &[&str], parts: &[&str]| {
        let out = frames.file_argument(name);
        let head = ["simulate", frames.argument(), "--out", &out, "--event-ids"];
        assert_error(&[&head, arguments].concat(), parts);
        assert!(!frames.file(name).exists());
    };
    refused(&posed, "a.raw", &[], &["cannot write ids", "a.raw: .npz alone"]);
    refused(&posed, "a.npz", &["--synthesis", "linear"], &["needs synthesis `rigid`, and this is `linear`"]);
    refused(&posed, "a.npz", &["--id-channel", "nothing"], &["nothing"]);
}
