//! The frontier on a small case: the part's statement on the default agrees with its own figures.

use esaac_benches::{Laboratory, Options, Part, run};
use esaac_formats::event_file::{EventColumns, write_npz};
use esaac_formats::exr_frame::{ChannelNames, FrameImages, FrameLayout};
use esaac_formats::exr_writer::write_frame;
use esaac_formats::frame_time::frame_time_ns;
use esaac_model::{HdrFormat, MotionFormat, Polarity, SensorModel};
use esaac_scene::{SceneKind, all_pixels, exact_events, render_cpu};
use esaac_tests::device::{DEVICE, assert_silent};
use serde_json::Value;
use std::sync::Arc;

/// Bands of the part: differences below them are noise.
const TIME_BAND: f64 = 0.03;
const ERROR_BAND: f64 = 0.005;

#[test]
fn a_sequence_of_floats_is_judged_and_a_broken_one_is_told_before_the_scenes() {
    let folder = float_sequence();
    let run_on = |only: &str| {
        let options = Options {
            quick: true,
            parts: vec![Part::Frontier],
            only: only.to_owned(),
            sequence: Some(folder.path().to_owned()),
            ..Options::default()
        };
        run(&Laboratory::new(Arc::clone(&DEVICE), options).unwrap(), |_| Ok(()))
    };
    let report = run_on("linear, fixed 8").unwrap();
    let scenes = report.parts["frontier"].as_array().unwrap();
    assert_eq!(scenes.len(), 2);
    let points = scenes[1]["points"].as_array().unwrap();
    assert!(points.len() >= 2, "{points:?}");
    for point in points {
        assert!(point["events_per_truth"].as_f64().unwrap() > 0.5, "{point}");
        assert_ne!(point["family"], "f32 input", "{point}");
    }
    std::fs::write(folder.path().join("key_0001.exr"), "no frame").unwrap();
    let began = std::time::Instant::now();
    let error = format!("{:#}", run_on("").err().expect("a broken frame"));
    assert!(error.contains("key_0001.exr (8 bytes) is no OpenEXR file"), "{error}");
    assert!(began.elapsed().as_secs() < 20, "all choices of a scene take longer than {:?}", began.elapsed());
    assert_silent();
}

/// A scene of four frames whose colour is of f32, with its exact events as columns.
fn float_sequence() -> tempfile::TempDir {
    let (width_px, height_px) = (48, 36);
    let folder = tempfile::tempdir().unwrap();
    let create = |name: &str| std::fs::File::create(folder.path().join(name)).unwrap();
    let scene = SceneKind::Flight.scene(width_px, height_px);
    let layout = FrameLayout {
        width_px,
        height_px,
        names: ChannelNames::default(),
        hdr: HdrFormat::F32x4,
        motion: Some(MotionFormat::F32x2),
        motion_factors: [1.0; 2],
        depth: None,
        ids: None,
    };
    for k in 0..4 {
        let t_ns = frame_time_ns(k, 30.0);
        let frame = render_cpu(&scene, t_ns, Some(t_ns - 33_333_333), layout.hdr, MotionFormat::F32x2);
        let images = FrameImages { hdr: frame.hdr, motion: Some(frame.motion), ..FrameImages::default() };
        write_frame(create(&format!("key_{k:04}.exr")), &layout, &images).unwrap();
    }
    std::fs::write(folder.path().join("sequence.json"), "{\"key_rate_hz\": 30}").unwrap();
    let sensor = SensorModel { width: width_px, height: height_px, ..SensorModel::default() };
    let pixels: Vec<(u32, u32)> = all_pixels(&scene).collect();
    let mut events = exact_events(&scene, &sensor, &pixels, 0, frame_time_ns(3, 30.0)).concat();
    events.sort_unstable();
    let columns = EventColumns {
        x: events.iter().map(|event| event.x).collect(),
        y: events.iter().map(|event| event.y).collect(),
        t_ns: events.iter().map(|event| event.t_ns).collect(),
        sign: events.iter().map(|event| if event.polarity == Polarity::On { 1 } else { -1 }).collect(),
        ids: None,
    };
    write_npz(create("truth.npz"), &columns, &sensor.to_toml()).unwrap();
    folder
}

#[test]
fn the_default_is_reported_as_its_figures_are() {
    let options = Options {
        quick: true,
        parts: vec![Part::Frontier],
        only: "adaptive 32".to_owned(),
        ..Options::default()
    };
    let laboratory = Laboratory::new(Arc::clone(&DEVICE), options).unwrap();
    let report = run(&laboratory, |_| Ok(())).unwrap();
    let text = report.documents[0].1.markdown();
    assert!(text.contains("**A rendered sequence is left out:**"), "{text}");
    let scenes = report.parts["frontier"].as_array().unwrap();
    assert_eq!(scenes.len(), 1);
    let mut on_frontier = 0;
    for scene in scenes {
        assert!(scene["true_events"].as_u64().unwrap() > 100, "{scene}");
        let points = scene["points"].as_array().unwrap();
        let of = |point: &Value| {
            [&point["gpu_us"], &point["victor_purpura"]].map(|figure| figure.as_f64().unwrap())
        };
        let beats = |a: [f64; 2], b: [f64; 2]| {
            let (cheaper, as_cheap) = (a[0] < b[0] * (1.0 - TIME_BAND), a[0] * (1.0 - TIME_BAND) <= b[0]);
            let (better, as_good) = (a[1] < b[1] - ERROR_BAND, a[1] <= b[1] + ERROR_BAND);
            cheaper && as_good || better && as_cheap
        };
        for point in points {
            let beaten = points.iter().any(|other| beats(of(other), of(point)));
            assert_eq!(point["on_frontier"], !beaten, "{point} among {points:?}");
        }
        let defaults: Vec<&Value> = points.iter().filter(|p| p["is_default"] == true).collect();
        let [default] = defaults[..] else { panic!("{} defaults in {points:?}", defaults.len()) };
        assert_eq!(scene["default_on_frontier"], default["on_frontier"]);
        let better = scene["better_than_default"].as_array().unwrap();
        assert_eq!(better.is_empty(), default["on_frontier"] == true, "{scene}");
        on_frontier += usize::from(default["on_frontier"] == true);
        // This holds on every machine: the default is nearer to the truth than blending.
        let linear = points.iter().find(|p| p["family"] == "linear").unwrap();
        assert!(of(default)[1] < of(linear)[1], "{default} {linear}");
    }
    assert_eq!(text.matches("The default lies on the frontier.").count(), on_frontier);
    assert_eq!(text.matches("The default does not lie on the frontier.").count(), 1 - on_frontier);
    assert_silent();
}
