//! ROS 2 from the command line: publishing, recording, replaying, and recordings that are cut short. All
//! traffic stays on loopback.

use crate::harness::{assert_error, assert_lens, esaac, finish, heeding_hangups, ignoring, run};
use esaac_ros::BagReader;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A small and quick scene.
const SMALL: &[&str] = &["--in-process", "--scene", "edge", "--width", "64", "--height", "48"];

/// `esaac` on loopback, in a domain of its own.
fn local(domain: u32, arguments: &[&str]) -> Command {
    let mut command = esaac(arguments);
    command.env("ROS_LOCALHOST_ONLY", "1").env("ROS_DOMAIN_ID", (90 + domain).to_string());
    command.env_remove("CYCLONEDDS_URI");
    command
}

fn demo(domain: u32, folder: &Path, more: &[&str]) -> Command {
    let mut command = local(domain, &["demo", "--out", folder.to_str().expect("UTF-8")]);
    command.args(SMALL).args(more);
    command
}

/// The number of messages of each topic, and whether the recording's end is missing.
fn recorded(path: &Path) -> (Vec<(String, usize)>, bool) {
    let mut bag = BagReader::open(path).expect("a recording");
    let mut counts: Vec<usize> = Vec::new();
    while let Some(message) = bag.next_message().expect("readable") {
        counts.resize(bag.topics().len(), 0);
        counts[message.topic] += 1;
    }
    let names = bag.topics().iter().map(|topic| topic.name.clone());
    (names.zip(counts).collect(), bag.is_truncated())
}

#[test]
fn the_demo_publishes_says_how_to_look_and_records_what_replay_sends_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let name = file.to_str().unwrap();
    let more = ["--frames", "4", "--record", name, "--json"];
    let (code, out, error) = finish(demo(0, folder.path(), &more).output().unwrap());
    assert_eq!(code, 0, "{error}");
    for line in ["ros2 topic echo /esaac/gray/events", "rviz2 -d ", "ros2 bag record -s mcap"] {
        assert!(error.contains(line), "{error}");
    }
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    let ros = &report["ros"];
    // One copy from the device's readback to the socket.
    let copies = serde_json::json!({ "packet": 0, "encode": 1, "wire": 0, "bag": 1 });
    assert_eq!(ros["copies"], copies);
    assert_eq!(ros["dropped_ticks"], 0);
    assert!(report["files"].as_array().unwrap().iter().any(|file| file == name), "{report}");
    let (topics, truncated) = recorded(&file);
    let count = |name: &str| topics.iter().find(|(topic, _)| topic == name).unwrap().1;
    assert!(!truncated);
    assert_eq!((count("/clock"), count("/esaac/gray/events"), count("/esaac/bayer/image_raw")), (4, 3, 4));
    // 34 samples an interval.
    assert_eq!((count("/esaac/gray/imu"), count("/esaac/bayer/aps/image_raw")), (3 * 34, 3));

    let replay = ["replay", name, "--json", "--delay", "0", "--rate", "10"];
    let (code, out, error) = finish(local(0, &replay).output().unwrap());
    assert_eq!(code, 0, "{error}");
    let replayed: serde_json::Value = serde_json::from_str(&out).unwrap();
    let sum: usize = topics.iter().map(|(_, count)| count).sum();
    assert_eq!((&replayed["sent"], &replayed["truncated"]), (&sum.into(), &false.into()));
}

#[test]
fn a_demo_without_a_network_goes_on_with_a_warning_and_one_that_was_asked_for_it_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let configuration = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='nonesuch0'/>\
         </Interfaces></General></Domain></CycloneDDS>";
    let without = |more: &[&str]| {
        let mut command = demo(1, folder.path(), more);
        command.env("CYCLONEDDS_URI", configuration).env_remove("ROS_LOCALHOST_ONLY");
        finish(command.output().unwrap())
    };
    let (code, _, error) = without(&["--frames", "2"]);
    assert_eq!(code, 0, "{error}");
    assert!(error.contains("warning: not publishing to ROS 2") && error.contains("nonesuch0"), "{error}");
    assert!(!error.contains("ros2 topic echo"), "{error}");
    let (code, _, error) = without(&["--frames", "2", "--ros", "on"]);
    assert_eq!(code, 1);
    assert!(error.contains("nonesuch0") && error.contains("--ros off"), "{error}");
}

/// Waits until a process has recorded 3 MiB.
fn until_recorded(child: &mut Child, file: &Path) {
    until_grown(child, file, 3 << 20);
}

/// Waits until a process has recorded so many bytes.
fn until_grown(child: &mut Child, file: &Path, bytes: u64) {
    let until = Instant::now() + Duration::from_secs(120);
    while std::fs::metadata(file).map_or(0, |file| file.len()) < bytes {
        assert!(Instant::now() < until && child.try_wait().unwrap().is_none(), "nothing was recorded");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_recording_that_outgrows_its_disk_is_an_error_and_readable() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    // A limit on the size of files stands for a full disk. The signal that would end the process is ignored. The limit
    // comes once the recording grows: the software driver's memory is in files too.
    let mut limited = ignoring("XFSZ");
    // Few events, so that their file is small enough.
    limited
        .args(["demo", "--json", "--frames", "300", "--contrast-on", "1", "--contrast-off", "1", "--out"])
        .arg(folder.path())
        .arg("--record")
        .arg(&file);
    limited.args(SMALL).args(["--ros", "off"]);
    let mut child = limited.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    until_recorded(&mut child, &file);
    let most = Rlimit { current: Some(4 << 20), maximum: Some(4 << 20) };
    prlimit(Pid::from_raw(child.id() as i32), Resource::Fsize, most).unwrap();
    let (code, out, error) = finish(child.wait_with_output().unwrap());
    assert_eq!(code, 1, "{error}");
    assert!(
        error.contains("error: the recording is incomplete") && out.contains("events.npz"),
        "{out} {error}"
    );
    assert!(error.contains("recording stopped") && error.contains("File too large"), "{error}");
    let (topics, truncated) = recorded(&file);
    assert!(truncated && topics.iter().map(|(_, count)| count).sum::<usize>() > 100, "{topics:?}");
    // All other results are there, and the report does not count what the recording lacks.
    for name in ["overview.png", "events.npz"] {
        assert!(folder.path().join(name).metadata().unwrap().len() > 1000, "{name}");
    }
    let text = std::fs::read_to_string(folder.path().join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    let recorded = report["ros"]["topics"].as_array().unwrap().iter().map(|topic| topic["recorded"].as_u64());
    assert!(recorded.flatten().sum::<u64>() >= 100, "{}", report["ros"]);
}

/// As above; its limit is what the first second takes.
#[test]
fn frames_are_simulated_to_the_end_though_the_disk_of_the_recording_is_full() {
    let (frames, folder) = (crate::harness::Frames::new(60, true), tempfile::tempdir().unwrap());
    let [file, events] = ["run.mcap", "events.npz"].map(|name| folder.path().join(name));
    let mut limited = ignoring("XFSZ");
    limited.args(["simulate", frames.argument(), "--rate", "20", "--real-time", "--json", "--ros", "off"]);
    limited.args(["--contrast-on", "1", "--contrast-off", "1", "--out"]).arg(&events);
    let mut child =
        limited.arg("--record").arg(&file).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    until_grown(&mut child, &file, 1);
    let most = Some(file.metadata().unwrap().len());
    let most = Rlimit { current: most, maximum: most };
    prlimit(Pid::from_raw(child.id() as i32), Resource::Fsize, most).unwrap();
    let (code, out, error) = finish(child.wait_with_output().unwrap());
    assert_eq!(code, 1, "{error}");
    assert!(error.contains("error: the recording is incomplete"), "{error}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&report["interrupted"], &report["intervals"]), (&false.into(), &59.into()));
    let files = [&events, &file].map(|path| path.to_str().unwrap());
    assert_eq!(report["files"], serde_json::json!(files));
    assert!(events.metadata().unwrap().len() > 300 && recorded(&file).1);
}

#[test]
fn a_run_that_fails_before_its_first_message_leaves_the_old_recording() {
    let (frames, folder) = (crate::harness::Frames::new(2, true), tempfile::tempdir().unwrap());
    let (file, events) = (folder.path().join("old.mcap"), folder.path().join("events.npz"));
    let run = |more: &[&str]| {
        std::fs::write(&file, "old").unwrap();
        let mut command = local(4, &["simulate", frames.argument()]);
        command.arg("--out").arg(&events).arg("--record").arg(&file).args(more);
        let (code, _, error) = finish(command.output().unwrap());
        assert_eq!((code, std::fs::read(&file).unwrap()), (1, b"old".to_vec()), "{more:?}: {error}");
        error
    };
    run(&["--device", "99"]);
    let error = run(&["--ros", "on", "--ros-interface", "wlan9"]);
    assert!(error.starts_with("error: no ROS 2 network: ") && error.contains("wlan9"), "{error}");
    run(&["--colour-channels", "a,b,c"]);
}

#[test]
fn a_run_that_is_interrupted_keeps_what_it_has_simulated() {
    let (frames, folder) = (crate::harness::Frames::new(200, true), tempfile::tempdir().unwrap());
    let demo = ["demo", "--frames", "2000", "--width", "48", "--height", "40", "--synthesis", "linear"];
    let out = folder.path().to_str().unwrap();
    let events = folder.path().join("events.npz");
    let name = events.to_str().unwrap();
    for (command, signal) in [
        ([&demo[..], &["--ros", "off", "--out", out]].concat(), "-INT"),
        (vec!["simulate", frames.argument(), "--rate", "10", "--out", name], "-TERM"),
        (vec!["simulate", frames.argument(), "--rate", "10", "--out", name], "-HUP"),
    ] {
        let file = folder.path().join(format!("{}{signal}.mcap", command[0]));
        let mut child = heeding_hangups();
        child.args(&command).args(["--real-time", "--json", "--record"]).arg(&file);
        let mut child = child.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        // The first second of messages is on the disk.
        until_grown(&mut child, &file, 1);
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        let (code, out, error) = finish(child.wait_with_output().unwrap());
        assert_eq!(code, 130, "{error}");
        assert!(error.contains("interrupted after "), "{error}");
        let report: serde_json::Value = serde_json::from_str(&out).unwrap();
        let intervals = report["intervals"].as_u64().unwrap();
        assert!(intervals > 0 && intervals < 1999, "{report}");
        let expected = if command[0] == "demo" { 1999 } else { 199 };
        assert_eq!((&report["interrupted"], &report["intervals_expected"]), (&true.into(), &expected.into()));
        assert!(events.metadata().unwrap().len() > 300, "{error}");
        std::fs::remove_file(&events).unwrap();
        let (topics, truncated) = recorded(&file);
        let of_events = topics.iter().find(|(topic, _)| topic.ends_with("/events")).unwrap().1;
        assert_eq!((of_events as u64, truncated), (intervals, false));
    }
    assert!(folder.path().join("report.json").exists());
}

#[test]
fn a_recording_whose_writer_was_killed_replays_up_to_its_last_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let name = file.to_str().unwrap();
    let more = ["--frames", "100000", "--ros", "off", "--record", name];
    let mut child =
        demo(2, folder.path(), &more).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    until_recorded(&mut child, &file);
    child.kill().unwrap();
    child.wait().unwrap();
    let replay = ["replay", name, "--json", "--delay", "0", "--rate", "1000"];
    let (code, out, error) = finish(local(2, &replay).output().unwrap());
    assert_eq!(code, 0, "{error}");
    assert!(error.contains("has no end"), "{error}");
    let replayed: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(replayed["truncated"], true);
    assert!(replayed["sent"].as_u64() > Some(100), "{replayed}");
    std::fs::File::options().write(true).open(&file).unwrap().set_len(3000).unwrap();
    let (code, _, error) = finish(local(2, &replay).output().unwrap());
    assert!(code == 1 && error.contains("is cut off within its first chunk"), "{error}");
}

#[test]
fn a_damaged_recording_is_one_line_of_plain_text() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let name = file.to_str().unwrap();
    let more = ["--frames", "2", "--ros", "off", "--record", name];
    let (code, _, error) = finish(demo(3, folder.path(), &more).output().unwrap());
    assert_eq!(code, 0, "{error}");
    let mut bytes = std::fs::read(&file).unwrap();
    let key = b"offered_qos_profiles";
    let places: Vec<usize> = (0..bytes.len() - key.len()).filter(|&i| bytes[i..].starts_with(key)).collect();
    assert!(!places.is_empty());
    places.iter().for_each(|&place| bytes[place] = 0xff);
    std::fs::write(&file, bytes).unwrap();
    let (code, _, error) = finish(local(3, &["replay", name, "--delay", "0"]).output().unwrap());
    assert_eq!((code, error.lines().count()), (1, 1), "{error}");
    assert!(error.contains("damaged") && !error.contains('\u{1b}'), "{error}");
}

#[test]
fn simulate_records_events_aps_frames_and_images() {
    let (frames, folder) = (crate::harness::Frames::new(4, true), tempfile::tempdir().unwrap());
    let (file, events) = (folder.path().join("run.mcap"), folder.path().join("events.npz"));
    let mut command =
        esaac(&["simulate", frames.argument(), "--aps-exposure-ns", "1000000", "--ros-events", "evt3"]);
    command.arg("--out").arg(&events).arg("--record").arg(&file);
    let (code, _, error) = finish(command.output().unwrap());
    assert_eq!(code, 0, "{error}");
    let (topics, truncated) = recorded(&file);
    assert!(!truncated);
    for (topic, expected) in [("events", 3), ("aps/image_raw", 3), ("image_raw", 4), ("sensor", 1)] {
        let name = format!("/esaac/camera_0/{topic}");
        assert_eq!(topics.iter().find(|(topic, _)| *topic == name).unwrap().1, expected, "{topic}");
    }
    // Nobody told the lens: the frames' depth is not read without poses.
    let size_px = (crate::harness::WIDTH as u32, crate::harness::HEIGHT as u32);
    assert_lens(&file, "camera_info", 4, size_px, None);
    assert_lens(&file, "aps/camera_info", 3, size_px, None);
    assert!(!topics.iter().any(|(topic, _)| topic.contains("/depth/")), "{topics:?}");
}

#[test]
fn flags_of_what_is_not_published_are_told() {
    let (frames, folder) = (crate::harness::Frames::new(2, true), tempfile::tempdir().unwrap());
    let told = |more: &[&str]| -> Vec<String> {
        let mut command = esaac(&["simulate", frames.argument(), "--device", "99"]);
        command.arg("--out").arg(folder.path().join("e.npz")).args(more);
        let (_, _, error) = finish(command.output().unwrap());
        let flag = |line: &str| line.strip_prefix("warning: --")?.split(' ').next().map(str::to_owned);
        error.lines().filter(|line| line.contains("does nothing")).filter_map(flag).collect()
    };
    let flags = ["--ros-domain", "3", "--ros-events", "evt3", "--ros-namespace", "/robot"];
    assert_eq!(told(&flags), ["ros-domain", "ros-namespace", "ros-events"]);
    let record = folder.path().join("r.mcap");
    assert_eq!(told(&[&flags[..], &["--record", record.to_str().unwrap()]].concat()), ["ros-domain"]);
    assert!(told(&[]).is_empty());
}

#[test]
fn bad_ros_arguments_name_what_was_expected() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let fails = |more: &[&str], parts: &[&str]| {
        let arguments: Vec<&str> = [&["demo", "--out", out][..], SMALL, more].concat();
        assert_error(&arguments, parts);
    };
    fails(&["--ros-namespace", "esaac"], &["namespace `esaac`", "slash"]);
    fails(&["--ros-qos", "event=reliable"], &["`event`", "events"]);
    fails(&["--ros", "off", "--record", "none/such/run.mcap"], &["none/such/run.mcap"]);
    let unusable = |more: &[&str], part: &str| {
        let (code, _, error) = run(&[&["demo", "--out", out][..], SMALL, more].concat());
        assert!(code == 2 && error.contains(part), "{more:?}: {error}");
    };
    for ns in ["1", "999", "-1", "4294967296"] {
        unusable(&["--ros-slice-ns", ns], "expected 0, or 1000 to 4294967295");
    }
    unusable(&["--ros-domain", "233"], "233 is not in 0..=232");
    unusable(&["--record", "run.npz"], "expected a name that ends in .mcap");
    assert_error(&["replay", "missing.mcap"], &["missing.mcap"]);
}
