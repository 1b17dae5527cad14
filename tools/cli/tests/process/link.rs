//! Renderer and engine as two processes, to their natural end and to a violent one.

use crate::harness::{assert_error, assert_lens, esaac, finish, heeding_hangups, ignoring, run};
use esaac_interop::ProducerOptions;
use esaac_model::paths::Intrinsics;
use esaac_tests::frames::Frame;
use esaac_tests::interop::{Uploader, other_device};
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Kernels that the validation layer takes apart quickly.
const RIG: &str = r#"
[[camera]]
sensor = "dvs128"
motion = "f32x2"
[camera.parameters]
synthesis = "linear"
[[camera]]
sensor = "dvs128"
hdr = "f32x4"
[camera.parameters]
synthesis = "linear"
"#;

/// A service and its folder.
struct Engine {
    folder: TempDir,
    child: Child,
    /// Its log so far.
    log: Arc<Mutex<String>>,
    reader: JoinHandle<()>,
}

impl Engine {
    fn start(arguments: &[&str]) -> Self {
        Engine::of(RIG, arguments)
    }

    /// A service of two cameras.
    fn of(rig: &str, arguments: &[&str]) -> Self {
        Engine::by(esaac(&[]), rig, arguments)
    }

    /// The same, by a command that is to be completed.
    fn by(mut command: Command, rig: &str, arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("rig.toml"), rig).unwrap();
        let (socket, rig) = (folder.path().join("e.sock"), folder.path().join("rig.toml"));
        let mut child = command
            .args(["serve", "--json", "--socket", text(&socket), "--rig", text(&rig)])
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let log = Arc::new(Mutex::new(String::new()));
        let (lines, kept) = (BufReader::new(child.stderr.take().unwrap()).lines(), Arc::clone(&log));
        let reader = std::thread::spawn(move || {
            for line in lines {
                *kept.lock().unwrap() += &(line.unwrap() + "\n");
            }
        });
        let engine = Engine { folder, child, log, reader };
        engine.wait_until_it_says("2 cameras at ");
        engine
    }

    /// Waits for a line of its log.
    #[track_caller]
    fn wait_until_it_says(&self, words: &str) {
        let says = || self.log.lock().unwrap().lines().any(|line| line.contains(words));
        wait_for(words, || says() || self.reader.is_finished());
        assert!(says(), "the engine ended without `{words}`: {}", self.log.lock().unwrap());
    }

    fn socket(&self) -> PathBuf {
        self.folder.path().join("e.sock")
    }

    fn renderer(&self, arguments: &[&str]) -> Child {
        self.renderer_of("edge", arguments)
    }

    fn renderer_of(&self, scene: &str, arguments: &[&str]) -> Child {
        esaac(&["render", "--socket", text(&self.socket()), "--scene", scene])
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    /// Its exit code, output and log once it has ended.
    fn ends_with(self) -> (i32, String, String) {
        let (code, out, _) = finish(self.child.wait_with_output().unwrap());
        self.reader.join().unwrap();
        let log = self.log.lock().unwrap().clone();
        (code, out, log)
    }

    /// Its report once it has ended.
    fn end(self) -> (serde_json::Value, String) {
        let (code, out, error) = self.ends_with();
        assert_eq!(code, 0, "{error}");
        (serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out}{error}")), error)
    }
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

#[track_caller]
fn wait_for(what: &str, is_so: impl Fn() -> bool) {
    let started = Instant::now();
    while !is_so() {
        assert!(started.elapsed() < Duration::from_secs(60), "{what} does not come");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn signal(child: &Child, signal: &str) {
    let id = child.id().to_string();
    let status = std::process::Command::new("kill").args([signal, &id]).status().unwrap();
    assert!(status.success());
}

#[test]
fn a_camera_that_never_had_a_frame_leaves_the_old_file() {
    let out = tempfile::tempdir().unwrap();
    let files = ["camera_0.npz", "camera_1.npz"].map(|name| out.path().join(name));
    files.iter().for_each(|file| std::fs::write(file, "old").unwrap());
    let engine = Engine::start(&["--out", text(out.path())]);
    let render = engine.renderer(&["--camera", "0", "--frames", "5"]);
    let (code, _, error) = finish(render.wait_with_output().unwrap());
    assert_eq!(code, 0, "{error}");
    signal(&engine.child, "-INT");
    let (report, log) = engine.end();
    // The first frame ends no interval.
    assert_eq!((&report["files"], &report["intervals"]), (&serde_json::json!([files[0]]), &4.into()));
    assert!(files[0].metadata().unwrap().len() > 300 && std::fs::read(&files[1]).unwrap() == b"old");
    assert!(log.contains("camera 1: no frame was stepped: ") && !log.contains("camera 0: no frame"), "{log}");
}

#[test]
fn two_processes_give_the_events_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let demo = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let small = ["--width", "48", "--height", "40", "--frames", "6", "--synthesis", "linear"];
        let arguments = [&["demo", "--json", "--out", text(&out)][..], &small, more].concat();
        let (code, report, error) = run(&arguments);
        assert_eq!(code, 0, "{error}");
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        (std::fs::read(out.join("events.npz")).unwrap(), report)
    };
    let (two, report) = demo("two", &[]);
    assert_eq!((&report["link"]["processes"], &report["link"]["frames"]), (&2.into(), &12.into()));
    assert_eq!(
        (&report["link"]["host_copies"], &report["link"]["device_copies"]),
        (&0.0.into(), &0.0.into())
    );
    assert!(report["link"]["memory"].is_string() && report["link"]["timeline"].is_string());
    let (one, report) = demo("one", &["--in-process"]);
    assert_eq!(
        (&report["link"]["processes"], &report["link"]["memory"]),
        (&1.into(), &serde_json::Value::Null)
    );
    assert!(one.len() > 1000 && one == two, "events differ: {} and {} bytes", one.len(), two.len());
}

#[test]
fn a_service_ends_by_itself_once_all_is_done() {
    let out = tempfile::tempdir().unwrap();
    let engine = Engine::start(&["--once", "--out", text(out.path())]);
    let (code, said, error) = finish(engine.renderer(&["--frames", "5"]).wait_with_output().unwrap());
    assert_eq!(code, 0, "{error}");
    assert!(said.contains("camera 1  5 frames stepped, 0 dropped"), "{said}");
    let (report, _) = engine.end();
    assert_eq!(report["link"]["frames"], 10);
    for camera in [0, 1] {
        assert!(out.path().join(format!("camera_{camera}.npz")).metadata().unwrap().len() > 1000);
        assert!(report["cameras"][camera]["events"].as_u64().unwrap() > 100, "{report}");
    }
}

#[test]
fn a_service_tells_what_it_assumes_and_what_of_its_rig_does_nothing() {
    let rig = "[[camera]]\nsensor = \"vga\"\n[camera.parameters]\npixel = \"physical\"\nsynthesis = \"linear\"\n\
               [[camera]]\nsensor = \"dvs128\"\n[camera.parameters]\ndark_lux = 0.1\nsynthesis = \"linear\"\n\
               aps_exposure_ns = 1000000\n";
    let engine = Engine::of(rig, &[]);
    signal(&engine.child, "-INT");
    let (report, log) = engine.end();
    let notes = |camera: usize| report["cameras"][camera]["notes"].as_array().unwrap().clone();
    assert!(notes(0)[0].as_str().unwrap().contains("by `lux_per_unit`") && notes(0).len() == 2, "{report}");
    let warnings: Vec<&str> =
        report["warnings"].as_array().unwrap().iter().map(|text| text.as_str().unwrap()).collect();
    let expected = [
        "camera 1: `dark_lux` does nothing",
        "events are counted and not kept: expected --out, --record or --ros on",
        "camera 1: `aps_exposure_ns` does nothing: APS frames leave by --ros on or --record alone",
    ];
    assert_eq!((notes(1).len(), warnings.len()), (0, expected.len()), "{warnings:?}");
    for (warning, expected) in warnings.iter().zip(expected) {
        assert!(warning.starts_with(expected), "{warning}");
        assert!(log.contains(&format!("warning: {warning}")), "{log}");
    }
}

#[test]
fn a_producer_that_begins_again_has_a_file_of_its_own() {
    let out = tempfile::tempdir().unwrap();
    let file = |name: &str| out.path().join(name);
    std::fs::write(file("camera_1_run_2.npz"), "old").unwrap();
    let engine = Engine::start(&["--out", text(out.path())]);
    for camera in ["0", "0", "1"] {
        let render = engine.renderer(&["--camera", camera, "--frames", "4"]);
        let (code, _, error) = finish(render.wait_with_output().unwrap());
        assert_eq!(code, 0, "{error}");
    }
    signal(&engine.child, "-TERM");
    let (report, log) = engine.end();
    let files = ["camera_0.npz", "camera_0_run_2.npz", "camera_1.npz"].map(file);
    assert_eq!(report["files"], serde_json::json!(files));
    // Both runs are of the same frames at the same times.
    let [first, second, other] = files.map(|file| std::fs::read(file).unwrap());
    assert!(first.len() > 1000 && first == second, "{} and {} bytes", first.len(), second.len());
    assert!(other.len() > 1000 && std::fs::read(file("camera_1_run_2.npz")).unwrap() == b"old");
    // Two runs of three intervals at 30 Hz, and another camera's.
    assert_eq!((&report["simulated_ns"], &report["intervals"]), (&200_000_000.into(), &9.into()));
    assert_eq!(report["link"]["processes"], 4, "{}", report["link"]);
    let warnings = report["warnings"].as_array().unwrap();
    let left_over = file("camera_1_run_2.npz");
    let starts = ["camera 0: its time goes back, to 0 ns", text(&left_over)];
    assert_eq!(warnings.len(), starts.len(), "{warnings:?}");
    for (warning, start) in warnings.iter().zip(starts) {
        assert!(warning.as_str().unwrap().starts_with(start), "{warning}");
        assert!(log.contains(warning.as_str().unwrap()), "{log}");
    }
}

#[test]
fn what_is_wrong_with_frames_is_in_the_report() {
    let out = tempfile::tempdir().unwrap();
    let engine = Engine::start(&["--out", text(out.path())]);
    let camera = ProducerOptions { camera: 1, ..ProducerOptions::default() };
    let mut producer = Uploader::connect(&other_device(), &engine.socket(), &camera).unwrap();
    // 32-bit floats of ones alone are NaN.
    let frame = Frame { t_ns: 0, hdr: vec![0xff; 128 * 128 * 16], motion: None };
    for t_ns in [0, 10_000_000] {
        producer.send(&frame, t_ns).unwrap();
    }
    producer.producer.finish().unwrap();
    signal(&engine.child, "-INT");
    let (report, log) = engine.end();
    let warning = report["cameras"][1]["frame_warning"].as_str().unwrap_or_else(|| panic!("{report}"));
    assert!(log.contains(&format!("camera 1: warning: {warning}")), "{log}");
    assert_eq!(report["warnings"], serde_json::json!([format!("camera 1: {warning}")]));
    let of_other = &report["cameras"][0];
    assert!(of_other["frame_warning"].is_null() && of_other["path_warning"].is_null(), "{of_other}");
}

#[test]
fn frames_of_a_producer_that_dies_are_counted() {
    let out = tempfile::tempdir().unwrap();
    let engine = Engine::start(&["--out", text(out.path())]);
    let camera = ProducerOptions { camera: 1, ..ProducerOptions::default() };
    let mut producer = Uploader::connect(&other_device(), &engine.socket(), &camera).unwrap();
    // So it reads the frames and their end at once.
    signal(&engine.child, "-STOP");
    let frame = Frame { t_ns: 0, hdr: vec![0; 128 * 128 * 16], motion: None };
    for t_ns in [0, 10_000_000, 20_000_000] {
        producer.send(&frame, t_ns).unwrap();
    }
    drop(producer);
    signal(&engine.child, "-CONT");
    engine.wait_until_it_says("camera 1: the peer closed the connection");
    signal(&engine.child, "-INT");
    let (report, log) = engine.end();
    let link = &report["link"];
    assert_eq!((&link["frames"], &link["abandoned_frames"]), (&0.into(), &3.into()), "{link}");
    let warning = report["warnings"][0].as_str().unwrap_or_else(|| panic!("{report}"));
    assert!(warning.starts_with("camera 1: 3 frames came and were not stepped"), "{warning}");
    assert!(log.contains(warning) && log.contains("camera 1: no frame was stepped: "), "{log}");
}

#[test]
fn a_hangup_ends_a_service_in_order_unless_it_is_ignored() {
    let out = tempfile::tempdir().unwrap();
    let engine = Engine::by(heeding_hangups(), RIG, &["--out", text(out.path())]);
    let render = engine.renderer(&["--frames", "3"]);
    let (code, _, error) = finish(render.wait_with_output().unwrap());
    assert_eq!(code, 0, "{error}");
    signal(&engine.child, "-HUP");
    let (report, _) = engine.end();
    assert_eq!(report["files"].as_array().unwrap().len(), 2, "{report}");

    let mut outlives = Engine::by(ignoring("HUP"), RIG, &[]);
    signal(&outlives.child, "-HUP");
    // It looks for a signal many times in this.
    std::thread::sleep(Duration::from_millis(500));
    assert!(outlives.child.try_wait().unwrap().is_none(), "it goes on, as with nohup");
    signal(&outlives.child, "-TERM");
    outlives.end();
}

#[test]
fn a_look_at_a_service_is_no_refusal() {
    let engine = Engine::start(&[]);
    let (socket, rig) = (engine.socket(), engine.folder.path().join("rig.toml"));
    assert_error(&["serve", "--socket", text(&socket), "--rig", text(&rig)], &["e.sock"]);
    signal(&engine.child, "-INT");
    let (report, log) = engine.end();
    let link = &report["link"];
    assert_eq!((&link["refused_connections"], &link["processes"]), (&0.into(), &1.into()), "{link}");
    assert!(!log.contains("connection:") && !log.contains("refused"), "{log}");
}

#[test]
fn a_second_file_that_cannot_be_written_is_told_once() {
    let out = tempfile::tempdir().unwrap();
    let engine = Engine::by(ignoring("XFSZ"), RIG, &["--out", text(out.path())]);
    let render = engine.renderer(&["--frames", "3"]);
    let (code, _, error) = finish(render.wait_with_output().unwrap());
    assert_eq!(code, 0, "{error}");
    // As a full disk.
    let most = Rlimit { current: Some(100), maximum: Some(100) };
    prlimit(Pid::from_raw(engine.child.id() as i32), Resource::Fsize, most).unwrap();
    signal(&engine.child, "-INT");
    let (code, _, log) = engine.ends_with();
    assert_eq!(code, 1, "{log}");
    for (start, file) in
        [("error: cannot write", "camera_0.npz"), ("another error: cannot write", "camera_1.npz")]
    {
        let line = log.lines().find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("{log}"));
        assert!(line.contains(file) && line.matches("File too large").count() == 1, "{line}");
    }
}

#[test]
fn a_file_that_cannot_be_written_keeps_no_other_from_being_written() {
    let out = tempfile::tempdir().unwrap();
    let engine = Engine::start(&["--once", "--out", text(out.path())]);
    // It could be written when the service looked.
    let files = ["camera_0.npz", "camera_1.npz"].map(|name| out.path().join(name));
    std::fs::create_dir(&files[0]).unwrap();
    let (code, _, error) = finish(engine.renderer(&["--frames", "5"]).wait_with_output().unwrap());
    assert_eq!(code, 0, "{error}");
    let (code, _, log) = engine.ends_with();
    assert_eq!(code, 1, "{log}");
    assert!(log.contains("error: cannot write") && log.contains("camera_0.npz"), "{log}");
    assert!(files[1].metadata().unwrap().len() > 1000);
}

#[test]
fn a_service_whose_log_cannot_be_written_keeps_its_events() {
    let folder = tempfile::tempdir().unwrap();
    let (rig, socket) = (folder.path().join("rig.toml"), folder.path().join("e.sock"));
    std::fs::write(&rig, RIG).unwrap();
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let service = ["serve", "--once", "--socket", text(&socket), "--rig", text(&rig)];
    let mut service = esaac(&[&service[..], &["--out", text(folder.path())]].concat())
        .stdout(Stdio::piped())
        .stderr(full)
        .spawn()
        .unwrap();
    wait_for("the socket", || socket.exists());
    let render = ["render", "--socket", text(&socket), "--scene", "edge", "--frames", "3"];
    let (code, _, error) = run(&render);
    assert_eq!(code, 0, "{error}");
    assert!(service.wait().unwrap().success());
    assert!(folder.path().join("camera_0.npz").metadata().unwrap().len() > 1000);
}

/// A camera that takes depth, through another lens than the scene's.
const EXACT_RIG: &str = r#"
[[camera]]
sensor = "dvs128"
depth = "f32"
ids = "u32"
lens = { fx = 100.0 }
[camera.parameters]
synthesis = "auto"
aps_exposure_ns = 1000000
[[camera]]
sensor = "dvs128"
motion = "f32x2"
[camera.parameters]
synthesis = "linear"
"#;

#[test]
fn depth_and_poses_go_over_the_link_and_the_report_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("run.mcap");
    let rig = EXACT_RIG.replace("100.0", "170.667");
    let engine = Engine::of(&rig, &["--once", "--record", text(&recording)]);
    let renderer = engine.renderer_of("propeller", &["--frames", "3", "--pose-rate", "500"]);
    let (code, said, error) = finish(renderer.wait_with_output().unwrap());
    assert_eq!(code, 0, "{error}");
    assert!(said.contains("camera 0  3 frames stepped, 0 dropped; with depth and poses"), "{said}");
    assert!(said.contains("camera 1  3 frames stepped, 0 dropped; without poses"), "{said}");
    let (report, _) = engine.end();
    assert_eq!(report["link"]["synthesis"], serde_json::json!(["rigid", "linear"]));
    assert_eq!(report["link"]["protocol"], "2");
    assert_eq!(report["cameras"][0]["sensor"]["synthesis"], "rigid");
    assert!(report["cameras"][0]["events"].as_u64().unwrap() > 100, "{report}");
    let lens = Intrinsics::pinhole(170.667, 170.667, 63.5, 63.5).unwrap();
    assert_lens(&recording, "aps/camera_info", 2, (128, 128), Some(lens));
}

#[test]
fn a_scene_with_another_lens_than_the_rig_s_is_not_rendered() {
    let engine = Engine::of(EXACT_RIG, &[]);
    let renderer = engine.renderer_of("propeller", &["--frames", "3"]);
    let (code, _, error) = finish(renderer.wait_with_output().unwrap());
    assert_eq!(code, 1);
    assert!(error.contains("write in the rig file: lens = { fx = 170.66"), "{error}");
    signal(&engine.child, "-TERM");
    engine.end();
}

#[test]
fn a_killed_renderer_leaves_the_engine_and_other_cameras_as_they_were() {
    let engine = Engine::start(&[]);
    let mut dies = engine.renderer(&["--camera", "0", "--frames", "1000000"]);
    let mut lives = engine.renderer(&["--camera", "1", "--frames", "1000000"]);
    engine.wait_until_it_says("camera 0: first frame");
    engine.wait_until_it_says("camera 1: first frame");
    signal(&dies, "-KILL");
    dies.wait().unwrap();
    // Its camera is free again, whatever it was in the middle of.
    let started = Instant::now();
    loop {
        let again = engine.renderer(&["--camera", "0", "--frames", "4"]);
        let (code, said, error) = finish(again.wait_with_output().unwrap());
        if code == 0 {
            assert!(said.contains("camera 0  4 frames stepped"), "{said}");
            break;
        }
        assert!(error.contains("has a producer already"), "{error}");
        assert!(started.elapsed() < Duration::from_secs(30), "camera 0 is not freed");
    }
    assert!(lives.try_wait().unwrap().is_none(), "camera 1 goes on");
    signal(&engine.child, "-TERM");
    let (report, error) = engine.end();
    assert!(error.contains("camera 0: the peer closed the connection"), "{error}");
    assert!(report["link"]["frames"].as_u64().unwrap() > 8, "{report}");
    // And with the engine gone the other renderer says so.
    let (code, _, error) = finish(lives.wait_with_output().unwrap());
    assert_eq!(code, 1);
    assert!(error.contains("the peer closed the connection"), "{error}");
}

#[test]
fn a_camera_that_joins_late_leaves_the_clock_to_the_other() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("run.mcap");
    let engine = Engine::start(&["--record", text(&recording)]);
    let mut first = engine.renderer(&["--camera", "0", "--frames", "1000000"]);
    engine.wait_until_it_says("camera 0: first frame");
    for _ in 0..2 {
        let late = engine.renderer(&["--camera", "1", "--frames", "4"]);
        let (code, _, error) = finish(late.wait_with_output().unwrap());
        assert_eq!(code, 0, "{error}");
    }
    assert!(first.try_wait().unwrap().is_none(), "camera 0 goes on");
    signal(&engine.child, "-TERM");
    let (report, log) = engine.end();
    first.wait().unwrap();
    assert_eq!(log.matches("camera 1: first frame").count(), 2, "{log}");
    assert_eq!(report["ros"]["time_resets"], 0, "{report}");
    let mut bag = esaac_ros::BagReader::open(&recording).unwrap();
    let mut clock = Vec::new();
    while let Some(message) = bag.next_message().unwrap() {
        if bag.topics()[message.topic].name == "/clock" {
            // After the encapsulation's four bytes: seconds and nanoseconds.
            clock.push([4, 8].map(|at| u32::from_le_bytes(message.bytes[at..at + 4].try_into().unwrap())));
        }
    }
    assert!(clock.len() > 2 && clock.is_sorted(), "{clock:?}");
}

#[test]
fn a_killed_engine_ends_the_renderer_with_an_error() {
    let mut engine = Engine::start(&[]);
    let renderer = engine.renderer(&["--frames", "1000000"]);
    engine.wait_until_it_says("camera 1: first frame");
    signal(&engine.child, "-KILL");
    engine.child.wait().unwrap();
    let started = Instant::now();
    let (code, _, error) = finish(renderer.wait_with_output().unwrap());
    assert_eq!(code, 1);
    assert!(error.contains("the peer closed the connection"), "{error}");
    // Under the validation layer it may still be busy with its kernel.
    assert!(started.elapsed() < Duration::from_secs(100), "{:?}", started.elapsed());
    assert!(engine.socket().exists(), "a killed engine leaves its socket");
}

#[test]
fn mistakes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("e.sock");
    assert_error(&["render", "--socket", text(&socket)], &["e.sock", "start `esaac serve` first"]);
    let rig = folder.path().join("rig.toml");
    let serve = ["serve", "--socket", text(&socket), "--rig", text(&rig)];
    assert_error(&serve, &["cannot read rig file", "rig.toml"]);
    std::fs::write(&rig, "[[camera]]\nsensor = \"davis\"\n").unwrap();
    assert_error(&serve, &["camera 0", "davis346"]);
    std::fs::write(&rig, RIG).unwrap();
    assert_error(&["serve", "--socket", "/tmp/e.sock", "--rig", text(&rig)], &["others may write", "700"]);
}
