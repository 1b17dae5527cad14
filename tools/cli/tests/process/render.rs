//! `esaac render --out`: a scene's frames, poses and true events in a folder that other commands read.

use crate::harness::{Frames, assert_error, esaac, run};
use esaac_formats::exr_frame::{ChannelNames, DEPTH_CHANNEL, FrameLayout, ID_CHANNEL, read_frame};
use esaac_formats::scene_file::{FolderScene, KeyFrames, SequenceFile, pose_times_ns};
use esaac_formats::truth_file;
use esaac_model::{HdrFormat, MotionFormat};
use esaac_scene::{SceneKind, all_pixels, exact_events, render_cpu};
use glam::DVec2;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::Stdio;
use std::time::{Duration, Instant};

const SIZE_PX: (u32, u32) = (48, 36);
const TIMES_NS: [i64; 3] = [0, 33_333_333, 66_666_667];

/// Renders `scene` into a folder with these options, and returns what the command printed.
fn render(frames: &Frames, scene: SceneKind, arguments: &[&str]) -> Value {
    let size = SIZE_PX;
    let (width, height) = (size.0.to_string(), size.1.to_string());
    let all = ["render", "--out", frames.argument(), "--scene", scene.name(), "--frames", "3", "--json"];
    let (code, text, error) = run(&[&all[..], &["--width", &width, "--height", &height], arguments].concat());
    assert_eq!(code, 0, "{error}");
    serde_json::from_str(&text).unwrap()
}

fn paths(frames: &Frames) -> Vec<PathBuf> {
    (0..TIMES_NS.len()).map(|k| frames.file(&format!("key_{k:04}.exr"))).collect()
}

#[test]
fn the_files_hold_the_scenes_images_poses_and_true_events() {
    for kind in [SceneKind::Bounce, SceneKind::Sinusoid] {
        let frames = Frames::empty();
        let scene = kind.scene(SIZE_PX.0, SIZE_PX.1);
        let written = render(&frames, kind, &["--truth"]);
        assert_eq!((&written["frames"], &written["poses"]), (&json!(3), &json!(65)));
        assert_eq!(written["instances"], 1);
        let layout = FrameLayout {
            width_px: SIZE_PX.0,
            height_px: SIZE_PX.1,
            names: ChannelNames::default(),
            hdr: HdrFormat::F16x4,
            motion: Some(MotionFormat::F32x2),
            motion_factors: [1.0; 2],
            depth: Some(DEPTH_CHANNEL.to_owned()),
            ids: Some(ID_CHANNEL.to_owned()),
        };
        let paths = paths(&frames);
        for (index, path) in paths.iter().enumerate() {
            let previous_ns = index.checked_sub(1).map(|before| TIMES_NS[before]);
            let exact =
                render_cpu(&scene, TIMES_NS[index], previous_ns, HdrFormat::F16x4, MotionFormat::F32x2);
            let read = read_frame(path, &layout).unwrap();
            let bytes = |depth: &[f32]| depth.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
            assert!(read.hdr == exact.hdr && read.motion.as_ref() == Some(&exact.motion), "{kind:?}");
            assert!(bytes(read.depth.as_ref().unwrap()) == exact.depth, "{kind:?}");
            let ids: Vec<u8> = read.ids.unwrap().iter().flat_map(|id| id.to_le_bytes()).collect();
            assert!(ids == exact.ids, "{kind:?}");
        }

        let sequence = SequenceFile::read(frames.path()).unwrap();
        let keys = KeyFrames { paths: &paths, rate_hz: 30.0, size_px: SIZE_PX };
        let known = FolderScene::read(frames.path(), sequence.as_ref(), &keys).unwrap().unwrap().motion;
        let exact = scene.scene_motion(&pose_times_ns(3, 30.0, 960.0));
        assert_eq!(known.lens(), exact.lens());
        assert!(known.ids().eq(exact.ids()));
        for id in known.ids().chain([0]) {
            for to_ns in [0, 20_000_000, TIMES_NS[1], TIMES_NS[2]] {
                let path = |motion: &esaac_model::paths::SceneMotion| {
                    motion.path(DVec2::new(20.0, 17.0), 2.0, id, TIMES_NS[1], to_ns).unwrap().pixel_px
                };
                assert!((path(&known) - path(&exact)).length() < 1e-9, "{kind:?}, instance {id}");
            }
        }

        let truth = truth_file::read(&frames.file("truth.npz")).unwrap();
        assert_eq!((truth.sensor.width, truth.sensor.height, truth.end_ns), (48, 36, TIMES_NS[2]));
        let pixels: Vec<(u32, u32)> = all_pixels(&scene).collect();
        let mut events = exact_events(&scene, &truth.sensor, &pixels, 0, TIMES_NS[2]).concat();
        events.sort_unstable();
        assert!(truth.events == events && events.len() > 500, "{} events", events.len());
        assert_eq!(written["true_events"], events.len());
    }
}

#[test]
fn simulate_reads_the_folder_whatever_the_rate_of_its_poses() {
    // Poses faster and slower than frames, and at a rate that meets no key frame but the first.
    for (pose_rate, poses) in [("960", 65), ("120", 9), ("30", 3), ("47", 5), ("7", 2)] {
        let frames = Frames::empty();
        let written = render(&frames, SceneKind::Propeller, &["--pose-rate", pose_rate]);
        assert_eq!(written["poses"], poses, "{pose_rate} Hz");
        assert_eq!((&written["true_events"], frames.file("truth.npz").exists()), (&Value::Null, false));
        let out = frames.file_argument("events.npz");
        let (code, text, error) =
            run(&["simulate", frames.argument(), "--json", "--synthesis", "none", "--out", &out]);
        assert_eq!(code, 0, "{error}");
        let report: Value = serde_json::from_str(&text).unwrap();
        let found = &report["poses"];
        assert_eq!((&found["intervals_spanned"], &found["intervals"]), (&json!(2), &json!(2)));
        assert_eq!((&found["camera_poses"], &found["instances"]), (&json!(poses), &json!(1)));
        // A steady turn is exact however few poses there are.
        assert_eq!(found["agree"], true, "{pose_rate} Hz: {found}");
    }
}

#[test]
fn the_frames_of_a_run_that_was_stopped_have_their_rate_and_poses() {
    let frames = Frames::empty();
    let size = ["--width", "64", "--height", "48", "--frames", "3000", "--rate", "50", "--pose-rate", "100"];
    let scene = ["render", "--scene", "propeller", "--out", frames.argument()];
    let mut child = esaac(&[&scene[..], &size].concat()).stdout(Stdio::null()).spawn().unwrap();
    let until = Instant::now() + Duration::from_secs(120);
    while !frames.file("key_0002.exr").exists() {
        assert!(Instant::now() < until && child.try_wait().unwrap().is_none(), "nothing was rendered");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let out = frames.file_argument("events.npz");
    let first = ["--frames", "key_000?.exr", "--out", &out, "--json"];
    let (code, report, error) = run(&[&["simulate", frames.argument()][..], &first].concat());
    assert_eq!(code, 0, "{error}");
    let report: Value = serde_json::from_str(&report).unwrap();
    assert_eq!((&report["synthesis"]["used"], &report["key_rate"]["hz"]), (&json!("rigid"), &json!(50.0)));
}

#[test]
fn a_folder_that_holds_something_and_options_of_the_other_kind_are_refused() {
    let frames = Frames::new(1, true);
    assert_error(&["render", "--out", frames.argument()], &["key_0000.exr", "expected an empty folder"]);
    let (_, _, error) = run(&["render"]);
    assert!(error.contains("--socket <PATH>") && error.contains("--out <DIR>"), "{error}");
    for arguments in [
        &["render"][..],
        &["render", "--out", "/nonesuch/a", "--socket", "b"],
        &["render", "--out", "/nonesuch/a", "--camera", "0"],
        &["render", "--socket", "b", "--width", "8"],
        &["render", "--socket", "b", "--truth"],
        &["render", "--out", "/nonesuch/a", "--pose-rate", "0"],
    ] {
        assert_eq!(run(arguments).0, 2, "{arguments:?}");
    }
}
