//! Files of poses beside a folder's frames.

use esaac_formats::scene_file::{FolderScene, KeyFrames, SequenceFile};
use esaac_model::paths::Intrinsics;
use serde_json::{Value, json};
use std::path::PathBuf;

const SIZE_PX: (u32, u32) = (40, 30);

/// What a folder of two frames with this `transforms.json` gives.
fn scene(text: &str) -> anyhow::Result<Option<FolderScene>> {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("transforms.json"), text).expect("a file");
    let paths = ["r_0.exr", "r_1.exr"].map(PathBuf::from);
    FolderScene::read(folder.path(), None, &KeyFrames { paths: &paths, rate_hz: 30.0, size_px: SIZE_PX })
}

fn transforms(lens: &Value) -> String {
    let upright = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
    let frame = |name| json!({ "file_path": name, "transform_matrix": upright });
    let mut file = json!({ "frames": [frame("./train/r_0"), frame("./train/r_1")] });
    file.as_object_mut().expect("an object").extend(lens.as_object().expect("an object").clone());
    file.to_string()
}

#[test]
fn a_lens_may_be_an_angle_of_view_with_square_pixels_around_the_middle() {
    let angle = 2.0 * (20.0_f64 / 50.0).atan();
    let pinhole = |fx, fy, cx, cy| Intrinsics::pinhole(fx, fy, cx, cy).expect("a lens");
    for (lens, expected) in [
        (json!({ "camera_angle_x": angle }), pinhole(50.0, 50.0, 19.5, 14.5)),
        (json!({ "fl_x": 60, "camera_angle_x": angle }), pinhole(60.0, 60.0, 19.5, 14.5)),
        (json!({ "fl_x": 60, "fl_y": 61, "cx": 21, "cy": 16 }), pinhole(60.0, 61.0, 20.5, 15.5)),
    ] {
        let found = scene(&transforms(&lens)).expect("a lens").expect("poses");
        let found = found.motion.lens();
        assert!(found.focal_px().abs_diff_eq(expected.focal_px(), 1e-9), "{lens}: {found:?}");
        assert_eq!(found.centre_px(), expected.centre_px(), "{lens}");
    }
    let fisheye = json!({ "camera_model": "OPENCV_FISHEYE", "camera_angle_x": angle });
    let error = format!("{:#}", scene(&transforms(&fisheye)).expect_err("no lens"));
    assert!(error.contains("no `fl_x`"), "{error}");
}

#[test]
fn a_fisheye_of_instant_ngp_needs_its_model() {
    let lens = json!({ "fl_x": 60, "is_fisheye": true, "camera_model": "OPENCV_FISHEYE", "k1": 0.0 });
    let found = scene(&transforms(&lens)).expect("a lens").expect("poses");
    assert_eq!(*found.motion.lens(), Intrinsics::fisheye(60.0, 60.0, 19.5, 14.5).expect("a lens"));
    let plain =
        scene(&transforms(&json!({ "fl_x": 60, "is_fisheye": false }))).expect("a lens").expect("poses");
    assert_eq!(*plain.motion.lens(), Intrinsics::pinhole(60.0, 60.0, 19.5, 14.5).expect("a lens"));
    let error = |lens: Value| format!("{:#}", scene(&transforms(&lens)).expect_err("no lens"));
    let both = error(json!({ "fl_x": 60, "is_fisheye": true, "camera_model": "PINHOLE" }));
    assert!(both.contains("`is_fisheye` is true and `camera_model` is PINHOLE"), "{both}");
    let alone = error(json!({ "fl_x": 60, "is_fisheye": true }));
    assert!(alone.contains("`is_fisheye` is true and `camera_model` is missing"), "{alone}");
    let bent = error(json!({ "fl_x": 60, "camera_model": "OPENCV_FISHEYE", "k2": 0.01 }));
    assert!(bent.contains("distortion (k2 is 0.01)"), "{bent}");
}

#[test]
fn a_frame_has_no_lens_of_its_own() {
    let with = |key: &str, value: Value| {
        let mut file: Value = serde_json::from_str(&transforms(&json!({ "fl_x": 60 }))).expect("JSON");
        file["frames"][1][key] = value;
        scene(&file.to_string())
    };
    with("k1", json!(0)).expect("no distortion");
    let error = format!("{:#}", with("k1", json!(0.1)).expect_err("distortion"));
    assert!(error.contains("frame ./train/r_1: the lens has distortion (k1 is 0.1)"), "{error}");
    for key in ["camera_angle_x", "is_fisheye"] {
        let error = format!("{:#}", with(key, json!(true)).expect_err("another lens"));
        assert!(error.contains(&format!("r_1 has its own `{key}`, expected one lens")), "{error}");
    }
}

#[test]
fn what_is_no_object_is_told() {
    for text in ["[]", " [1, 2, 3, 4, 5]", "7", "\"poses\""] {
        let error = format!("{:#}", scene(text).expect_err("no object"));
        assert!(
            error.contains("transforms.json: the file begins with") && error.contains("a JSON object"),
            "{error}"
        );
    }
}

#[test]
fn poses_that_end_a_little_early_end_with_the_last_frame() {
    let upright = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
    let of = |pose_rate_hz: f64| {
        let folder = tempfile::tempdir().expect("a folder");
        let file = json!({
            "key_rate_hz": 125,
            "intrinsics": { "fx": 50, "fy": 50, "cx": 19.5, "cy": 14.5 },
            "pose_rate_hz": pose_rate_hz,
            "camera_to_world": [upright, upright, upright],
            "instances": { "1": [upright, upright, upright] },
        });
        std::fs::write(folder.path().join("sequence.json"), file.to_string()).expect("a file");
        let sequence = SequenceFile::read(folder.path()).expect("a sequence");
        let paths = ["key_0.exr", "key_1.exr"].map(PathBuf::from);
        let keys = KeyFrames { paths: &paths, rate_hz: 125.0, size_px: SIZE_PX };
        FolderScene::read(folder.path(), sequence.as_ref(), &keys).map(|scene| scene.expect("poses").motion)
    };
    // 83 ns early.
    let ended = of(2e9 / (8_000_000.0 - 83.0)).expect("poses to the last frame");
    ended.check_span(0, 8_000_000).expect("a whole interval");
    for track in [ended.camera(), ended.instance(1).expect("an instance")] {
        assert_eq!((track.times_ns()[0], track.times_ns()[2]), (0, 8_000_000));
    }
    // More than a hundredth of a step is no rounding.
    assert!(of(2e9 / (8_000_000.0 - 50_000.0)).is_err());
    assert_eq!(of(2e9 / 9_000_000.0).expect("poses").camera().times_ns()[2], 9_000_000);
}

#[test]
fn what_python_writes_for_no_number_is_named() {
    for word in ["NaN", "Infinity", "-Infinity"] {
        let text = transforms(&json!({ "fl_x": 60 })).replace("60", word);
        let error = format!("{:#}", scene(&text).expect_err("no JSON"));
        assert!(error.contains("transforms.json") && error.contains("is no JSON"), "{word}: {error}");
    }
    let error = format!("{:#}", scene("{\"frames\": [}").expect_err("no JSON"));
    assert!(!error.contains("is no JSON"), "{error}");
}

#[test]
fn a_projection_beside_the_lens_is_no_silent_pinhole() {
    let read = |beside: &Value, inside: &Value| {
        let folder = tempfile::tempdir().expect("a folder");
        let mut file =
            json!({ "key_rate_hz": 30, "intrinsics": { "fx": 50, "fy": 50, "cx": 19.5, "cy": 14.5 } });
        let add = |to: &mut Value, more: &Value| {
            to.as_object_mut().expect("an object").extend(more.as_object().expect("an object").clone());
        };
        add(&mut file, beside);
        add(&mut file["intrinsics"], inside);
        std::fs::write(folder.path().join("sequence.json"), file.to_string()).expect("a file");
        SequenceFile::read(folder.path())
    };
    let fisheye = json!({ "projection": "fisheye" });
    let error = format!("{:#}", read(&fisheye, &json!({})).expect_err("misplaced"));
    assert!(
        error.contains("sequence.json: `projection` stands beside `intrinsics`")
            && error.contains("expected"),
        "{error}"
    );
    read(&json!({}), &fisheye).expect("in its place");
    read(&fisheye, &fisheye).expect("both say the same");
    read(&json!({ "projector": "none" }), &json!({})).expect("another's key");
}
