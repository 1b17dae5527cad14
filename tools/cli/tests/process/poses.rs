//! `esaac simulate` on folders with poses, depth and ids.

use crate::harness::{
    Frames, HEIGHT, WIDTH, Writer, assert_error, assert_lens, colour, recorded_messages, run,
};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, STATIC_WORLD, SceneMotion};
use exr::prelude::{AnyChannel, FlatSamples};
use glam::{DQuat, DVec2, DVec3};
use serde_json::{Value, json};

/// Key frames a second.
const KEY_HZ: f64 = 30.0;
/// Key frames.
const KEYS: usize = 4;
/// Poses from one key frame to the next.
const POSES_PER_KEY: usize = 8;
/// The instance that moves.
const BODY: u32 = 70_000;
/// The validation layer checks this kernel in seconds.
const QUICK: [&str; 2] = ["--synthesis", "none"];

/// A camera that speeds up and turns, `k` key frames after the first.
fn camera(k: f64) -> Pose {
    let turn = DVec3::new(1.2, 0.02 * k * k, 0.3 + 0.03 * k);
    Pose::new(DQuat::from_scaled_axis(turn), DVec3::new(0.1 * k * k, -1.0 + 0.2 * k, 0.4)).unwrap()
}

/// A body that falls and spins.
fn body(k: f64) -> Pose {
    let turn = DVec3::new(0.2 * k, 0.5, 0.1 * k);
    Pose::new(DQuat::from_scaled_axis(turn), DVec3::new(0.2, 3.0, 1.0 - 0.1 * k * k)).unwrap()
}

/// A turn about the camera's own vertical axis, radians.
fn turned(angle: f64) -> Pose {
    Pose::new(DQuat::from_rotation_y(angle), DVec3::ZERO).unwrap()
}

fn lens() -> Intrinsics {
    Intrinsics::pinhole(30.0, 32.0, 18.0, 11.0).unwrap()
}

/// A folder whose vectors follow from its poses; `factor` times them.
struct Posed {
    frames: Frames,
    sequence: Value,
}

impl Posed {
    fn new(factor: f32) -> Self {
        Posed::by(Writer::Esaac, factor)
    }

    fn by(writer: Writer, factor: f32) -> Self {
        let posed = Posed { frames: Frames::by(writer), sequence: sequence() };
        (0..KEYS).for_each(|k| posed.write_key(k, factor, Some(BODY)));
        posed.describe();
        posed
    }

    /// A surface of uneven depth, and `id` in the middle of it if there is one.
    fn write_key(&self, k: usize, factor: f32, id: Option<u32>) {
        let time_ns = |k: usize| (k as f64 * 1e9 / KEY_HZ).round() as i64;
        let track = |pose: fn(f64) -> Pose| {
            PoseTrack::new((0..KEYS).map(time_ns).collect(), (0..KEYS).map(|k| pose(k as f64)).collect())
                .unwrap()
        };
        let mut motion = SceneMotion::new(lens(), track(camera));
        motion.insert(BODY, track(body)).unwrap();
        let (mut x, mut y, mut depth, mut ids) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for i in 0..WIDTH * HEIGHT {
            let pixel_px = DVec2::new((i % WIDTH) as f64, (i / WIDTH) as f64);
            let here = id.filter(|_| (pixel_px - lens().centre_px()).length() < 6.0).unwrap_or(STATIC_WORLD);
            let depth_m = 4.0 + (0.4 * pixel_px.x).sin() + 0.03 * pixel_px.y;
            let end = motion.path(pixel_px, depth_m, here, time_ns(k), time_ns(k.saturating_sub(1))).unwrap();
            let vector = (end.pixel_px - pixel_px).as_vec2() * factor;
            x.push(vector.x);
            y.push(vector.y);
            depth.push(depth_m as f32);
            ids.push(here);
        }
        let mut list = colour(k, (WIDTH, HEIGHT));
        list.push(AnyChannel::new("motion.X", FlatSamples::F32(x)));
        list.push(AnyChannel::new("motion.Y", FlatSamples::F32(y)));
        list.push(AnyChannel::new("depth.Z", FlatSamples::F32(depth)));
        if id.is_some() {
            list.push(AnyChannel::new("id", FlatSamples::U32(ids)));
        }
        self.frames.write_channels(&format!("key_{k:04}.exr"), (WIDTH, HEIGHT), list);
    }

    fn describe(&self) {
        std::fs::write(self.frames.file("sequence.json"), self.sequence.to_string()).unwrap();
    }

    fn simulate(&self, arguments: &[&str]) -> (Value, String) {
        let out = self.frames.file_argument("events.npz");
        let all =
            [&["simulate", self.frames.argument(), "--json", "--out", &out], &QUICK[..], arguments].concat();
        let (code, text, error) = run(&all);
        assert_eq!(code, 0, "{error}");
        (serde_json::from_str(&text).unwrap(), error)
    }

    fn error(&self, arguments: &[&str], parts: &[&str]) {
        self.describe();
        let out = self.frames.file_argument("events.npz");
        assert_error(&[&["simulate", self.frames.argument(), "--out", &out], arguments].concat(), parts);
    }
}

fn sequence() -> Value {
    let poses = (KEYS - 1) * POSES_PER_KEY + 1;
    let rows = |pose: fn(f64) -> Pose| -> Vec<[[f64; 4]; 4]> {
        (0..poses).map(|j| pose(j as f64 / POSES_PER_KEY as f64).to_rows()).collect()
    };
    json!({
        "key_rate_hz": KEY_HZ,
        "intrinsics": { "fx": 30.0, "fy": 32.0, "cx": 18.0, "cy": 11.0 },
        "pose_rate_hz": KEY_HZ * POSES_PER_KEY as f64,
        "camera_to_world": rows(camera),
        "instances": { BODY.to_string(): rows(body) },
    })
}

/// The camera's poses at the key frames, as nerfstudio writes them: pixel centres at halves.
fn transforms() -> Value {
    let frames: Vec<Value> = (0..KEYS)
        .map(|k| json!({ "file_path": format!("images/key_{k:04}.png"), "transform_matrix": camera(k as f64).to_rows() }))
        .collect();
    json!({ "camera_model": "OPENCV", "fl_x": 30.0, "fl_y": 32.0, "cx": 18.5, "cy": 11.5, "w": WIDTH, "h": HEIGHT,
            "k1": 0.0, "p2": 0, "frames": frames })
}

/// A folder of a still scene with `transforms.json`.
fn still(transforms: &Value) -> Posed {
    let posed = Posed { frames: Frames::empty(), sequence: json!({ "key_rate_hz": KEY_HZ }) };
    (0..KEYS).for_each(|k| posed.write_key(k, 1.0, None));
    posed.describe();
    std::fs::write(posed.frames.file("transforms.json"), transforms.to_string()).unwrap();
    posed
}

#[test]
fn depth_and_poses_predict_the_motion_vectors() {
    let posed = Posed::new(1.0);
    let (report, error) = posed.simulate(&[]);
    let poses = &report["poses"];
    assert!(!error.contains("warning"), "{error}");
    assert_eq!(poses["agree"], true, "{poses}");
    assert_eq!((&poses["camera_poses"], &poses["instances"]), (&json!(25), &json!(1)));
    assert_eq!((&poses["intervals_spanned"], &poses["intervals"]), (&json!(3), &json!(3)));
    for found in [&poses["world"], &poses["by_instance"][BODY.to_string()]] {
        assert_eq!(found["verdict"], "agrees");
        assert!(found["median_error_px"].as_f64().unwrap() < 1e-4, "{found}");
        assert!(found["median_motion_px"].as_f64().unwrap() > 0.5, "{found}");
    }
    // Played at another rate, the poses go with the frames.
    let (report, _) = posed.simulate(&["--rate", "47"]);
    assert_eq!((&report["poses"]["agree"], &report["poses"]["intervals_spanned"]), (&json!(true), &json!(3)));

    let out = posed.frames.file_argument("events.npz");
    let (_, text, _) = run(&[&["simulate", posed.frames.argument(), "--out", &out], &QUICK[..]].concat());
    assert!(text.contains("25 poses of the camera, 1 moving instance, for 3 of 3 intervals"), "{text}");
    assert!(text.contains("depth and poses predict the motion vectors within"), "{text}");
}

#[test]
fn poses_too_far_apart_are_told_where_they_are_followed() {
    let mut posed = Posed::new(1.0);
    let (report, error) = posed.simulate(&[]);
    assert_eq!((&report["poses"]["coarse"], error.contains("too far apart")), (&json!([]), false), "{error}");
    // Two poses a frame, and the camera looks to and fro.
    let shaken = |j: usize| camera(j as f64 / 2.0) * turned(if j % 4 < 2 { 0.3 } else { -0.3 });
    let rows: Vec<_> = (0..2 * KEYS - 1).map(|j| shaken(j).to_rows()).collect();
    let still: Vec<_> = rows.iter().map(|_| body(0.0).to_rows()).collect();
    posed.sequence["pose_rate_hz"] = json!(2.0 * KEY_HZ);
    posed.sequence["camera_to_world"] = json!(rows);
    posed.sequence["instances"] = json!({ BODY.to_string(): still });
    posed.describe();
    let (report, error) = posed.simulate(&[]);
    let coarse = &report["poses"]["coarse"];
    assert_eq!(
        (coarse.as_array().unwrap().len(), &coarse[0]["instance"]),
        (1, &json!(STATIC_WORLD)),
        "{coarse}"
    );
    assert_eq!(coarse[0]["spacing_ns"], 16_666_667);
    assert!(coarse[0]["error_px"].as_f64().unwrap() > 1.0, "{coarse}");
    // Synthesis `none` follows no poses.
    assert!(!error.contains("too far apart"), "{error}");
    let out = posed.frames.file_argument("events.npz");
    let (code, _, error) = run(&["simulate", posed.frames.argument(), "--out", &out, "--synthesis", "rigid"]);
    assert_eq!(code, 0, "{error}");
    for part in ["poses are too far apart in time: the camera has a pose each 16.7 ms", "every physics step"]
    {
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn a_recording_has_the_lens_and_the_depth_of_the_folder() {
    let mut posed = Posed::new(1.0);
    let recorded = |posed: &Posed, lens: Intrinsics| {
        let file = posed.frames.file_argument("run.mcap");
        posed.simulate(&["--record", &file]);
        let size_px = (WIDTH as u32, HEIGHT as u32);
        for topic in ["camera_info", "depth/camera_info"] {
            assert_lens(file.as_ref(), topic, KEYS, size_px, Some(lens));
        }
        recorded_messages(file.as_ref(), "/esaac/camera_0/depth/image_raw")
    };
    let first_m = |x: usize, y: usize| (4.0 + (0.4 * x as f64).sin() + 0.03 * y as f64) as f32;
    let of_pinhole = recorded(&posed, lens());
    let pixels = (0..WIDTH * HEIGHT).map(|i| first_m(i % WIDTH, i / WIDTH));
    let bytes: Vec<u8> = pixels.flat_map(f32::to_le_bytes).collect();
    assert!(of_pinhole[0].ends_with(&bytes));

    posed.sequence["intrinsics"]["projection"] = json!("fisheye");
    posed.describe();
    let of_fisheye = recorded(&posed, Intrinsics::fisheye(30.0, 32.0, 18.0, 11.0).unwrap());
    // From the centre, in the last pixel, which is off the axis.
    let last_m = f32::from_le_bytes(*of_fisheye[0].last_chunk().unwrap());
    let angle = DVec2::new(18.0 / 30.0, 11.0 / 32.0).length();
    let expected_m = f64::from(first_m(WIDTH - 1, HEIGHT - 1)) * angle.cos();
    assert!((f64::from(last_m) / expected_m - 1.0).abs() < 1e-6, "{last_m} m, expected {expected_m}");
}

#[test]
fn a_wrong_sign_is_told_and_the_convention_undoes_it() {
    let posed = Posed::new(-1.0);
    let (report, error) = posed.simulate(&[]);
    assert_eq!(report["poses"]["agree"], false);
    let causes = &report["poses"]["world"]["causes"];
    assert!(causes[0][0].as_str().unwrap().contains("sign is flipped"), "{causes}");
    assert!(error.contains("warning: ") && error.contains("sign is flipped"), "{error}");
    let (report, error) = posed.simulate(&["--motion-convention", "negated"]);
    assert_eq!(report["poses"]["agree"], true, "{error}");
}

/// The report of `simulate` with `auto`, and what it warns of.
fn report_with_auto(posed: &Posed, arguments: &[&str]) -> (Value, String) {
    let out = posed.frames.file_argument("events.npz");
    let all =
        [&["simulate", posed.frames.argument(), "--json", "--out", &out, "--taps", "bilinear"], arguments];
    let (code, text, error) = run(&all.concat());
    assert_eq!(code, 0, "{error}");
    (serde_json::from_str(&text).unwrap(), error)
}

/// What `simulate` takes with `auto`, why, and what it warns of.
fn with_auto(posed: &Posed, arguments: &[&str]) -> (String, String, String) {
    let (report, error) = report_with_auto(posed, arguments);
    let word = |key: &str| report["synthesis"][key].as_str().unwrap_or("").to_owned();
    (word("used"), word("reason"), error)
}

#[test]
fn auto_does_not_follow_poses_that_disagree_with_the_vectors() {
    // Vectors alone are wrong: the poses predict them.
    let (used, _, error) = with_auto(&Posed::new(-1.0), &[]);
    assert_eq!(used, "rigid");
    assert!(error.contains("depth and poses are right by that and are followed"), "{error}");
    // The camera's poses are.
    let mut posed = Posed::new(1.0);
    for j in 0..=(KEYS - 1) * POSES_PER_KEY {
        let pose = camera(j as f64 / POSES_PER_KEY as f64).inverse();
        posed.sequence["camera_to_world"][j] = json!(pose.to_rows());
    }
    posed.describe();
    let (used, reason, error) = with_auto(&posed, &[]);
    assert_eq!(used, "motion");
    assert!(reason.contains("depth and poses do not predict them"), "{reason}");
    assert!(
        error.contains("warning: ") && error.contains("likely the camera's matrix is camera from world"),
        "{error}"
    );
    assert!(error.contains("synthesis auto: all poses are left out"), "{error}");
    let (used, _, error) = with_auto(&posed, &["--synthesis", "rigid"]);
    assert_eq!(used, "rigid");
    assert!(error.contains("the poses are followed, as synthesis rigid was asked for"), "{error}");
    // A body's poses are.
    let mut posed = Posed::new(1.0);
    for j in 0..=(KEYS - 1) * POSES_PER_KEY {
        let pose = body(j as f64 / POSES_PER_KEY as f64).inverse();
        posed.sequence["instances"][BODY.to_string()][j] = json!(pose.to_rows());
    }
    posed.describe();
    let (used, reason, error) = with_auto(&posed, &[]);
    assert_eq!(used, "rigid");
    let left_out = format!("instance {BODY}: its poses are left out, the pixels follow their vectors");
    assert!(reason.contains(&left_out) && error.contains(&left_out), "{reason}: {error}");
}

#[test]
fn a_still_scene_takes_its_poses_from_transforms_json() {
    let posed = still(&transforms());
    let (report, _) = posed.simulate(&[]);
    let poses = &report["poses"];
    assert_eq!(
        (&poses["agree"], &poses["camera_poses"], &poses["instances"]),
        (&json!(true), &json!(4), &json!(0))
    );
    assert!(poses["world"]["median_error_px"].as_f64().unwrap() < 1e-4, "{poses}");
    assert!(poses["file"].as_str().unwrap().ends_with("transforms.json"));
}

#[test]
fn poses_of_some_intervals_serve_those() {
    let mut posed = Posed::new(1.0);
    posed.sequence["camera_to_world"].as_array_mut().unwrap().truncate(POSES_PER_KEY + 1);
    let body = posed.sequence["instances"][BODY.to_string()].as_array_mut().unwrap();
    body.truncate(POSES_PER_KEY + 1);
    posed.describe();
    let (report, _) = posed.simulate(&[]);
    assert_eq!(report["poses"]["intervals_spanned"], 1);
    assert_eq!(report["poses"]["agree"], true);
    // `auto` does not follow them, and says so.
    let (used, _, error) = with_auto(&posed, &[]);
    assert_eq!(used, "motion");
    assert!(
        error.contains("warning: ") && error.contains("the poses are left out: no poses for all intervals"),
        "{error}"
    );
    assert!(!error.contains("give depth and poses"), "{error}");
}

#[test]
fn poses_without_a_lens_are_told_as_such() {
    let mut posed = Posed::new(1.0);
    for key in ["intrinsics", "instances"] {
        posed.sequence.as_object_mut().unwrap().remove(key).unwrap();
    }
    posed.describe();
    let (used, reason, error) = with_auto(&posed, &[]);
    assert_eq!(used, "motion");
    assert_eq!(reason, "there are motion vectors, but poses without `intrinsics`");
    assert!(error.contains("sequence.json: the poses are left out: poses without `intrinsics`"), "{error}");
    posed.error(&["--synthesis", "rigid"], &["there are poses without `intrinsics`"]);
}

#[test]
fn poses_whose_rate_has_few_digits_are_followed() {
    let mut posed = Posed::new(1.0);
    posed.sequence["pose_rate_hz"] = json!(KEY_HZ * POSES_PER_KEY as f64 + 0.0001);
    posed.describe();
    let (used, _, error) = with_auto(&posed, &[]);
    assert_eq!(used, "rigid", "{error}");
    assert!(!error.contains("left out"), "{error}");
}

#[test]
fn what_cannot_be_checked_is_said() {
    let mut posed = Posed::new(1.0);
    posed.sequence["instances"] = json!({});
    posed.describe();
    let (report, _) = posed.simulate(&[]);
    assert!(report["poses"]["pixels_without_poses"].as_u64().unwrap() > 0);
    assert_eq!(report["poses"]["agree"], true);
    let (report, _) =
        posed.simulate(&["--motion-channels", "motion.X,motion.Y", "--depth-channel", "motion.X"]);
    assert_eq!(report["poses"]["agree"], false, "motion is no depth");
    // Frames without depth.
    (0..KEYS).for_each(|k| {
        posed.frames.write_channels(&format!("key_{k:04}.exr"), (WIDTH, HEIGHT), colour(k, (WIDTH, HEIGHT)))
    });
    let (report, _) = posed.simulate(&[]);
    assert_eq!((&report["poses"]["missing"], &report["poses"]["agree"]), (&json!("depth"), &Value::Null));
}

#[test]
fn pixels_without_a_path_and_without_vectors_are_told() {
    let mut posed = Posed::new(1.0);
    posed.sequence["instances"] = json!({});
    posed.describe();
    let told = |posed: &Posed| {
        let (report, error) = report_with_auto(posed, &[]);
        assert_eq!(report["synthesis"]["used"], "rigid");
        let warning = report["cameras"][0]["path_warning"].as_str().unwrap_or_default().to_owned();
        assert_eq!(error.contains(" of the pixels have"), !warning.is_empty(), "{error}");
        warning
    };
    assert_eq!(told(&posed), "", "a body without poses follows its vectors");
    let write = |depth_m: f32, id: u32| {
        for k in 0..KEYS {
            let mut list = colour(k, (WIDTH, HEIGHT));
            let every_other = |i: usize| i.is_multiple_of(2);
            let depths = (0..WIDTH * HEIGHT).map(|i| if every_other(i) { depth_m } else { 4.0 });
            let ids = (0..WIDTH * HEIGHT).map(|i| if every_other(i) { id } else { STATIC_WORLD });
            list.push(AnyChannel::new("depth.Z", FlatSamples::F32(depths.collect())));
            list.push(AnyChannel::new("id", FlatSamples::U32(ids.collect())));
            posed.frames.write_channels(&format!("key_{k:04}.exr"), (WIDTH, HEIGHT), list);
        }
    };
    write(4.0, STATIC_WORLD);
    assert_eq!(told(&posed), "");
    write(4.0, BODY);
    assert!(told(&posed).starts_with("50% of the pixels have the id of a body without poses"));
    write(f32::NAN, STATIC_WORLD);
    assert!(
        told(&posed)
            .starts_with("50% of the pixels have a depth that is NaN, negative or too small to invert")
    );
}

#[test]
fn a_wrong_sequence_json_is_named() {
    let case = |change: &dyn Fn(&mut Value), parts: &[&str]| {
        let mut posed = Posed::new(1.0);
        change(&mut posed.sequence);
        posed.error(&[], &[&["sequence.json"], parts].concat());
    };
    let id = BODY.to_string();
    case(&|s| s["camera_to_world"][3][2] = json!([0, 0, 0, 0]), &["camera_to_world[3]", "singular"]);
    case(&|s| s["camera_to_world"][1][0][0] = json!(7.0), &["camera_to_world[1]", "scaled"]);
    case(&|s| s["camera_to_world"][2][1][1] = Value::Null, &["camera_to_world[2]", "null", "4x4"]);
    case(&|s| s["camera_to_world"][2][1] = json!([1, 2, 3]), &["camera_to_world[2]", "length 3"]);
    case(&|s| s["camera_to_world"] = json!("poses"), &["camera_to_world", "expected a sequence"]);
    case(&|s| s["camera_to_world"] = json!([]), &["camera_to_world", "0 poses"]);
    case(&|s| _ = s.as_object_mut().unwrap().remove("camera_to_world"), &["without `camera_to_world`"]);
    case(&|s| _ = s.as_object_mut().unwrap().remove("pose_rate_hz"), &["without `pose_rate_hz`"]);
    case(&|s| _ = s.as_object_mut().unwrap().remove("intrinsics"), &["without `intrinsics`"]);
    case(&|s| s["pose_rate_hz"] = json!(-960), &["`pose_rate_hz` is -960", "positive"]);
    case(&|s| s["intrinsics"]["k1"] = json!(0.1), &["unknown field `k1`"]);
    case(&|s| s["intrinsics"]["fx"] = json!(0), &["fx is 0 px", "positive"]);
    case(
        &|s| s["instances"][&id][4][3] = json!([0.5, 0, 0, 1]),
        &[&format!("instances.{id}[4]"), "last row"],
    );
    case(&|s| _ = s["instances"][&id].as_array_mut().unwrap().pop(), &[&id, "24 poses, expected 25"]);
    case(&|s| s["instances"]["0"] = s["instances"][&id].clone(), &["0 is the static world"]);
    case(&|s| s["instances"]["ball"] = s["instances"][&id].clone(), &["`ball`", "expected an id"]);
    case(&|s| s["pose_rate_hz"] = json!(9600), &["first interval", "expected them to span 0 to 33333333 ns"]);
}

#[test]
fn a_transposed_pose_is_told_from_other_faults() {
    let mut posed = Posed::new(1.0);
    let rows: [[f64; 4]; 4] = camera(0.0).to_rows();
    let transposed: Vec<Vec<f64>> = (0..4).map(|i| (0..4).map(|j| rows[j][i]).collect()).collect();
    posed.sequence["camera_to_world"][0] = json!(transposed);
    posed.error(&[], &["camera_to_world[0]", "transposed"]);
}

#[test]
fn channels_that_are_missing_or_of_a_wrong_type_are_named() {
    let posed = Posed::new(1.0);
    posed.error(&["--depth-channel", "th.Z"], &["key_0000.exr", "no depth channel `th.Z`", "depth.Z"]);
    posed.error(&["--id-channel", "IndexOB"], &["no id channel `IndexOB`", "depth.Z, id"]);
    posed.error(
        &[&["--id-channel", "depth.Z"], &QUICK[..]].concat(),
        &["key_000", "channel `depth.Z`", "is no id", "whole numbers"],
    );
    posed.write_key(2, 1.0, None);
    posed.error(&[], &["key_0002.exr", "no id channel `id`"]);
    (0..KEYS).for_each(|k| posed.write_key(k, 1.0, None));
    posed.error(&[], &["sequence.json has poses of instances", "no channel `id`"]);
}

#[test]
fn a_wrong_transforms_json_is_named() {
    let case = |change: &dyn Fn(&mut Value), parts: &[&str]| {
        let mut transforms = transforms();
        change(&mut transforms);
        still(&transforms).error(&[], &[&["transforms.json"], parts].concat());
    };
    case(&|t| t["k1"] = json!(-0.03), &["distortion (k1 is -0.03)", "expected none"]);
    case(
        &|t| t["camera_model"] = json!("EQUIRECTANGULAR"),
        &["`camera_model` is EQUIRECTANGULAR", "OPENCV_FISHEYE"],
    );
    case(&|t| t["w"] = json!(640), &["`w` is 640, expected 37"]);
    case(&|t| t["fl_x"] = json!(-1), &["fx is -1 px"]);
    case(&|t| t["frames"][2]["file_path"] = json!("images/other.png"), &["named like key_0002.exr"]);
    case(&|t| t["frames"][2]["file_path"] = json!("again/key_0001.jpg"), &["again/key_0001.jpg", "one name"]);
    case(&|t| t["frames"][1]["fl_x"] = json!(31), &["images/key_0001.png has its own `fl_x`"]);
    case(
        &|t| t["frames"][1]["transform_matrix"] = json!([[1, 0], [0, 1]]),
        &["rows of [2, 2] numbers", "4 rows of 4"],
    );
    case(&|t| t["frames"][1]["transform_matrix"][0][0] = json!(9), &["images/key_0001.png", "scaled"]);
    case(&|t| _ = t.as_object_mut().unwrap().remove("fl_x"), &["no `fl_x`", "`camera_angle_x`"]);
    let both = still(&transforms());
    let posed = Posed { sequence: sequence(), ..both };
    posed.error(&[], &["sequence.json", "transforms.json", "expected one of them"]);
}

/// What `esaac simulate` reports of poses, and the events it writes.
fn poses_and_events(posed: &Posed, arguments: &[&str]) -> (Value, Vec<u8>) {
    let (mut report, error) = posed.simulate(arguments);
    assert!(!error.contains("warning"), "{error}");
    report["poses"].as_object_mut().unwrap().remove("file");
    (report["poses"].clone(), std::fs::read(posed.frames.file("events.npz")).unwrap())
}

#[test]
fn files_of_blender_need_no_flags() {
    let expected = poses_and_events(&Posed::new(1.0), &[]);
    assert_eq!(expected.0["agree"], true);
    for writer in [Writer::Blender4, Writer::Blender5] {
        let posed = Posed::by(writer, 1.0);
        assert!(poses_and_events(&posed, &[]) == expected, "{writer:?}");
        let flags = ["--motion-channels", "Vector.X,Vector.Y", "--motion-convention", "blender"];
        assert!(poses_and_events(&posed, &flags) == expected, "{writer:?}");
        let (report, _) = posed.simulate(&["--motion-convention", "previous"]);
        assert_eq!(report["poses"]["agree"], false, "a convention that is asked for is followed");
    }
}

#[test]
fn ids_as_floats_are_whole_numbers() {
    for (id, told) in [(1.5, "1.5"), (-1.0, "-1"), (f32::NAN, "NaN"), (4_294_967_296.0, "4294967300")] {
        let posed = Posed::by(Writer::Blender5, 1.0);
        let mut list = colour(2, (WIDTH, HEIGHT));
        let mut ids = vec![7.0; WIDTH * HEIGHT];
        ids[40] = id;
        for name in ["motion.X", "motion.Y", "depth.Z"] {
            list.push(AnyChannel::new(name, FlatSamples::F32(vec![1.0; WIDTH * HEIGHT])));
        }
        list.push(AnyChannel::new("id", FlatSamples::F32(ids)));
        posed.frames.write_channels("key_0002.exr", (WIDTH, HEIGHT), list);
        let name = "channel `ViewLayer.Object Index.X`";
        posed.error(&QUICK, &["key_0002.exr", name, &format!(": {told} is no id, expected whole numbers")]);
    }
}

#[test]
fn of_several_view_layers_one_is_named() {
    let frames = Frames::empty();
    let size = (WIDTH, HEIGHT);
    for k in 0..2 {
        let named = |layer: &str| -> Vec<AnyChannel<FlatSamples>> {
            let name = |c: AnyChannel<FlatSamples>| {
                AnyChannel::new(&*format!("{layer}.Combined.{}", c.name), c.sample_data)
            };
            colour(k, size).into_iter().map(name).collect()
        };
        frames.write_parts(&format!("frame_{k:04}.exr"), size, vec![named("ViewLayer"), named("a.b")]);
    }
    let out = frames.file_argument("events.npz");
    let arguments = ["simulate", frames.argument(), "--out", &out, "--synthesis", "none"];
    let listed = "ViewLayer.Combined.R, a.b.Combined.R";
    assert_error(&arguments, &["frame_0000.exr", "2 channels", "`Combined.R`", listed, "in full"]);
    let channels = "a.b.Combined.R,a.b.Combined.G,a.b.Combined.B";
    let (code, _, error) = run(&[&arguments[..], &["--colour-channels", channels]].concat());
    assert_eq!(code, 0, "{error}");
}
