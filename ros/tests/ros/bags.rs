//! Recordings: whole ones, those of a killed writer, and replay.

use crate::world::{self, Subscriber};
use esaac_model::Packet;
use esaac_ros::replay::{ReplayOptions, replay};
use esaac_ros::{
    BagReader, CameraPlan, CameraStatus, CycloneTransport, EventFormat, Payload, Policy, RigOptions,
    RigPublisher, Sinks, Topic, Transport, TransportError,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tempfile::TempDir;

const INTERVAL_NS: i64 = 33_333_333;

fn lossless() -> RigOptions {
    RigOptions { policy: Policy::Lossless, ..RigOptions::default() }
}

fn ticks(rig: &mut RigPublisher, cameras: &[CameraPlan], range: std::ops::Range<i64>) {
    for tick in range {
        let packets: Vec<Packet> = cameras
            .iter()
            .map(|plan| world::packet(plan, tick * INTERVAL_NS, (tick + 1) * INTERVAL_NS, 300, tick as u32))
            .collect();
        world::publish(rig, cameras, &packets, 2);
    }
}

/// Topic, time and bytes of every message, and whether the file is cut short.
fn read(path: &Path) -> (Vec<(usize, u64, Vec<u8>)>, bool) {
    let mut bag = BagReader::open(path).unwrap();
    let mut all = Vec::new();
    while let Some(message) = bag.next_message().unwrap() {
        all.push((message.topic, message.log_ns, message.bytes));
    }
    (all, bag.is_truncated())
}

/// A rig that records to a file in a folder of its own.
fn recording(cameras: &[CameraPlan], options: &RigOptions) -> (TempDir, PathBuf, RigPublisher) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let rig = world::rig(cameras, options, Sinks { transport: None, bag: Some(world::bag(&path)) });
    (folder, path, rig)
}

#[test]
fn what_a_killed_writer_leaves_reads_up_to_the_last_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let (path, left) = (folder.path().join("run.mcap"), folder.path().join("left.mcap"));
    let cameras = vec![world::camera("left", 346, 260)];
    let sinks = Sinks { transport: None, bag: Some(world::bag(&path)) };
    let mut rig = world::rig(&cameras, &lossless(), sinks);
    ticks(&mut rig, &cameras, 0..20);
    // The bytes that the system has while the writer is at work are those that a kill leaves.
    world::wait_until(|| rig.summary().recorded() >= 150, || format!("{:?}", rig.summary()));
    std::fs::copy(&path, &left).unwrap();
    let recorded = rig.summary().recorded() as usize;
    rig.finish().2.unwrap();

    let (whole, cut) = read(&path);
    assert!(!cut && whole.len() > recorded / 2);
    let (part, cut) = read(&left);
    assert!(cut, "a file without an end");
    // A chunk of 1 MiB holds some two ticks of ten messages.
    assert!(part.len() + 40 >= 150, "{} of {recorded} messages", part.len());
    assert_eq!(part[..], whole[..part.len()]);
}

#[test]
fn a_chunk_that_was_damaged_is_an_error_before_any_of_its_messages() {
    let cameras = vec![world::camera("left", 346, 260)];
    let (_folder, path, mut rig) = recording(&cameras, &lossless());
    ticks(&mut rig, &cameras, 0..12);
    rig.finish().2.unwrap();
    let (whole, _) = read(&path);
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    // Pixels of an image lie there.
    bytes[middle] ^= 0x10;
    std::fs::write(&path, &bytes).unwrap();
    let mut bag = BagReader::open(&path).unwrap();
    let mut before = 0;
    let error = loop {
        match bag.next_message() {
            Ok(Some(message)) => {
                assert_eq!(message.bytes, whole[before].2);
                before += 1;
            }
            Ok(None) => panic!("nothing was noticed"),
            Err(error) => break error.to_string(),
        }
    };
    assert!(before > 0 && before < whole.len(), "{before} messages");
    assert!(error.contains("run.mcap is damaged: a chunk has the checksum"), "{error}");
}

/// Sends nothing before every topic has a subscriber.
struct Meeting {
    transport: CycloneTransport,
    topics: usize,
    advertised: usize,
    /// When the last topic had one.
    met: Option<Instant>,
}

impl Transport for Meeting {
    fn name(&self) -> String {
        self.transport.name()
    }
    fn copies(&self) -> u32 {
        self.transport.copies()
    }
    fn advertise(&mut self, topic: &Topic) -> Result<(), TransportError> {
        self.transport.advertise(topic)?;
        self.advertised += 1;
        if self.advertised == self.topics {
            let found = || (0..self.topics).filter(|&topic| self.transport.subscribers(topic) > 0).count();
            world::wait_until(|| found() == self.topics, || format!("{} topics", found()));
            self.met = Some(Instant::now());
        }
        Ok(())
    }
    fn publish(&mut self, topic: usize, message: &Arc<Payload>) -> Result<(), TransportError> {
        self.transport.publish(topic, message)
    }
    fn flush(&mut self) {
        self.transport.flush();
    }
    fn subscribers(&self, topic: usize) -> usize {
        self.transport.subscribers(topic)
    }
    fn notices(&mut self) -> Vec<String> {
        self.transport.notices()
    }
    fn drain(&mut self, limit: Duration) {
        self.transport.drain(limit);
    }
}

/// Takes no message.
struct Refusing(Vec<String>);

impl Transport for Refusing {
    fn name(&self) -> String {
        "refusing".to_owned()
    }
    fn copies(&self) -> u32 {
        0
    }
    fn advertise(&mut self, topic: &Topic) -> Result<(), TransportError> {
        self.0.push(topic.name.clone());
        Ok(())
    }
    fn publish(&mut self, topic: usize, _: &Arc<Payload>) -> Result<(), TransportError> {
        Err(TransportError::Message { topic: self.0[topic].clone(), reason: "no buffers".to_owned() })
    }
    fn subscribers(&self, _: usize) -> usize {
        0
    }
    fn notices(&mut self) -> Vec<String> {
        Vec::new()
    }
    fn drain(&mut self, _: Duration) {}
}

#[test]
fn why_a_recording_cannot_be_sent_again_is_told_once_a_topic() {
    let cameras = vec![world::camera("left", 32, 24)];
    let (_folder, path, mut rig) = recording(&cameras, &lossless());
    ticks(&mut rig, &cameras, 0..3);
    rig.finish().2.unwrap();
    let options = ReplayOptions { rate: 1000.0, delay: Duration::ZERO };
    let (mut transport, mut told) = (Refusing(Vec::new()), Vec::new());
    let bag = BagReader::open(&path).unwrap();
    let replayed = replay(bag, &mut transport, options, || false, |notice| told.push(notice)).unwrap();
    assert!(replayed.sent == 0 && replayed.failed > replayed.topics.len() as u64, "{replayed:?}");
    assert_eq!(told.len(), replayed.topics.len(), "{told:?}");
    assert!(told.iter().all(|notice| notice.contains("was not sent: no buffers")), "{told:?}");
}

#[test]
fn a_recording_is_sent_again_byte_by_byte_with_its_timing() {
    let cameras = vec![world::camera("left", 32, 24)];
    let (_folder, path, mut rig) = recording(&cameras, &lossless());
    let topics = world::topics(&rig);
    ticks(&mut rig, &cameras, 0..30);
    rig.finish().2.unwrap();
    let (messages, _) = read(&path);

    let domain = world::domain();
    let subscriber = Subscriber::on(domain).start(&topics);
    let mut transport =
        Meeting { transport: world::transport(domain), topics: topics.len(), advertised: 0, met: None };
    let options = ReplayOptions { rate: 2.0, delay: Duration::ZERO };
    let bag = BagReader::open(&path).unwrap();
    let replayed = replay(bag, &mut transport, options, || false, |_| ()).unwrap();
    let took = transport.met.unwrap().elapsed();
    assert_eq!((replayed.sent, replayed.failed, replayed.truncated), (messages.len() as u64, 0, false));
    assert_eq!(replayed.out_of_order, 0);
    // The first IMU sample is half an interval before the first tick; the file is 29 and a half long.
    let recorded = Duration::from_nanos(replayed.recorded_ns);
    assert!(recorded > Duration::from_millis(960) && recorded < Duration::from_millis(1000), "{recorded:?}");
    assert!(took >= recorded / 2, "{took:?}, expected half of {recorded:?}");
    subscriber.wait_until_taken(messages.len());

    let taken = world::taken(&subscriber.finish());
    for (number, (name, _, _)) in topics.iter().enumerate() {
        let expected: Vec<u64> = messages
            .iter()
            .filter(|(topic, _, _)| *topic == number)
            .map(|(_, _, bytes)| world::wire_hash(&esaac_ros::Payload::new(bytes.clone())))
            .collect();
        let actual: Vec<u64> = taken.iter().filter(|t| t.topic == number).map(|t| t.hash).collect();
        assert_eq!(actual, expected, "{name}");
    }
}

#[test]
fn a_replay_can_be_stopped_before_its_first_message() {
    let cameras = vec![world::camera("left", 32, 24)];
    let (_folder, path, mut rig) = recording(&cameras, &lossless());
    ticks(&mut rig, &cameras, 0..1);
    rig.finish().2.unwrap();
    let options = ReplayOptions { delay: 2 * world::PATIENCE, ..ReplayOptions::default() };
    let (bag, mut transport) = (BagReader::open(&path).unwrap(), world::transport(world::domain()));
    let started = Instant::now();
    let stop = || started.elapsed() > Duration::from_millis(100);
    let replayed = replay(bag, &mut transport, options, stop, |_| ()).unwrap();
    assert_eq!(replayed.sent, 0);
    assert!(started.elapsed() < world::PATIENCE, "{:?}", started.elapsed());
}

#[test]
fn a_disk_that_is_full_at_the_start_is_an_error_at_the_start() {
    // A device that has no room, ever. One that fills up later is the command line's test.
    let sinks = Sinks { transport: None, bag: Some(world::bag(Path::new("/dev/full"))) };
    let started = RigPublisher::start(vec![world::camera("left", 32, 24)], lossless(), sinks);
    let error = started.err().expect("the definitions do not fit").to_string();
    assert!(error.contains("/dev/full") && error.contains("No space left"), "{error}");
}

#[test]
fn a_simulation_that_is_reset_goes_back_in_its_stamps_and_on_in_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let cameras = vec![world::camera("left", 32, 24)];
    let sinks = Sinks { transport: None, bag: Some(world::bag(&path)) };
    let mut rig = world::rig(&cameras, &lossless(), sinks);
    ticks(&mut rig, &cameras, 0..3);
    rig.restart();
    ticks(&mut rig, &cameras, 0..2);
    let (summary, _, recorded) = rig.finish();
    recorded.unwrap();
    assert_eq!(summary.time_resets, 1);
    let answer = world::check_bag(&path);
    assert_eq!(answer["/clock"]["recorded"], 5);
    assert_eq!(answer["/clock"]["last"]["clock"]["nanosec"], 2 * INTERVAL_NS);
    assert_eq!(answer["/esaac/left/events"]["last"]["sequence"], 4, "messages go on being numbered");
    let (messages, _) = read(&path);
    let clock = BagReader::open(&path).map(|mut bag| {
        bag.next_message().unwrap();
        bag.topics().iter().position(|topic| topic.name == "/clock").unwrap()
    });
    let clock = clock.unwrap();
    let times: Vec<u64> = messages.iter().filter(|(t, _, _)| *t == clock).map(|(_, at, _)| *at).collect();
    assert!(times.is_sorted(), "{times:?}");
}

/// Publishes a tick in which one camera alone has a packet, of the interval of that number.
fn publish_one(rig: &mut RigPublisher, cameras: &[CameraPlan], camera: usize, interval: i64) {
    let (t0_ns, t1_ns) = (interval * INTERVAL_NS, (interval + 1) * INTERVAL_NS);
    let packet = world::packet(&cameras[camera], t0_ns, t1_ns, 300, interval as u32);
    let mut tick = rig.tick(t1_ns);
    tick.events(camera, &packet.view());
    tick.send();
}

/// When the last message of a topic was recorded.
fn last_log_ns(path: &Path, name: &str) -> u64 {
    let mut bag = BagReader::open(path).unwrap();
    let mut last_ns = 0;
    while let Some(message) = bag.next_message().unwrap() {
        if bag.topics()[message.topic].name == name {
            last_ns = message.log_ns;
        }
    }
    last_ns
}

#[test]
fn stamps_that_messages_cannot_hold_are_told_once() {
    let cameras = vec![world::camera("left", 32, 24)];
    let (_folder, _, mut rig) = recording(&cameras, &lossless());
    rig.tick(((1 << 31) - 1) * 1_000_000_000).send();
    assert_eq!(rig.notices(), [""; 0]);
    for seconds in [1 << 31, 1 << 32] {
        rig.tick(seconds * 1_000_000_000).send();
    }
    let notices = rig.notices();
    assert_eq!(notices.len(), 1, "{notices:?}");
    assert!(notices[0].starts_with("a tick is at 2147483648000000000 ns"), "{notices:?}");
    rig.finish().2.unwrap();
}

/// Recorded stamps of `/clock`, in intervals.
fn clock_of(path: &Path) -> Vec<i64> {
    let mut bag = BagReader::open(path).unwrap();
    let mut stamps = Vec::new();
    while let Some(message) = bag.next_message().unwrap() {
        if bag.topics()[message.topic].name == "/clock" {
            // After the encapsulation's four bytes: seconds and nanoseconds.
            let word = |at: usize| i32::from_le_bytes(message.bytes[at..at + 4].try_into().unwrap());
            stamps.push((i64::from(word(4)) * 1_000_000_000 + i64::from(word(8))) / INTERVAL_NS);
        }
    }
    stamps
}

#[test]
fn the_clock_goes_back_only_where_no_camera_goes_on() {
    let cameras = ["left", "right"].map(|name| world::camera(name, 32, 24)).to_vec();
    let (_folder, path, mut rig) = recording(&cameras, &lossless());
    let begin = |rig: &mut RigPublisher, camera| {
        rig.begin_camera(camera, 0).unwrap();
        rig.tick(0).send();
    };
    begin(&mut rig, 0);
    (0..5).for_each(|interval| publish_one(&mut rig, &cameras, 0, interval));
    // One that joins late is behind, and so is one that begins anew while the other goes on.
    begin(&mut rig, 1);
    (0..5).for_each(|interval| publish_one(&mut rig, &cameras, 1, interval));
    begin(&mut rig, 0);
    publish_one(&mut rig, &cameras, 0, 0);
    publish_one(&mut rig, &cameras, 1, 5);
    // The other begins anew too: nobody is left at the clock's time.
    begin(&mut rig, 1);
    publish_one(&mut rig, &cameras, 0, 1);
    // One that has ended holds the clock no longer.
    rig.end_camera(0).unwrap();
    begin(&mut rig, 1);
    let (summary, notices, recorded) = rig.finish();
    recorded.unwrap();
    assert_eq!(clock_of(&path), [0, 1, 2, 3, 4, 5, 6, 0, 2, 0]);
    assert_eq!((summary.time_resets, summary.unannounced_resets, notices.len()), (2, 0, 0), "{notices:?}");
    let error = world::rig(&cameras, &lossless(), Sinks::default()).begin_camera(2, 0).unwrap_err();
    assert_eq!(error.to_string(), "camera 2, expected a number below 2");
}

#[test]
fn a_camera_that_goes_back_without_a_restart_is_told() {
    let cameras = vec![world::camera("left", 32, 24)];
    let (_folder, path, mut rig) = recording(&cameras, &lossless());
    ticks(&mut rig, &cameras, 0..3);
    assert_eq!(rig.notices(), [""; 0]);
    ticks(&mut rig, &cameras, 0..2);
    let notices = rig.notices();
    assert_eq!(notices.len(), 1, "once, though the camera stays behind: {notices:?}");
    let times = format!("`left` went back from {} to {INTERVAL_NS} ns", 3 * INTERVAL_NS);
    assert!(notices[0].contains(&times) && notices[0].contains("`restart`"), "{notices:?}");
    assert_eq!(rig.finish().0.unannounced_resets, 1);
    // The last tick was behind, and is no reason for the diagnostics to go back.
    let [clock_ns, diagnostics_ns] = ["/clock", "/diagnostics"].map(|name| last_log_ns(&path, name));
    assert!(diagnostics_ns >= clock_ns, "{diagnostics_ns} and {clock_ns} ns");
    let status = &world::check_bag(&path)["/diagnostics"]["last"]["status"][0];
    assert_eq!(
        (&status["level"], status["message"].as_str().unwrap().contains("went back")),
        (&1.into(), true)
    );
}

#[test]
fn what_is_known_of_a_camera_is_on_diagnostics() {
    let cameras = vec![world::camera("left", 32, 24), world::camera("right", 32, 24)];
    let (_folder, path, mut rig) = recording(&cameras, &lossless());
    let light = |lux: &str| CameraStatus {
        values: vec![("light".to_owned(), format!("median {lux} lux"))],
        warnings: Vec::new(),
    };
    rig.set_status(1, light("1")).unwrap();
    ticks(&mut rig, &cameras, 0..2);
    let dark = CameraStatus { warnings: vec!["too dark".to_owned(), "too fast".to_owned()], ..light("0.1") };
    rig.set_status(1, dark).unwrap();
    assert!(rig.set_status(2, CameraStatus::default()).is_err());
    rig.finish().2.unwrap();
    let statuses = &world::check_bag(&path)["/diagnostics"]["last"]["status"];
    // Of the other camera nobody has told anything.
    assert_eq!(statuses.as_array().unwrap().len(), 2, "{statuses}");
    let camera = &statuses[1];
    assert_eq!((&camera["level"], &camera["name"]), (&1.into(), &"esaac: camera right".into()));
    assert_eq!(camera["message"], "too dark; too fast");
    assert_eq!(
        (&camera["values"][0]["key"], &camera["values"][0]["value"]),
        (&"light".into(), &"median 0.1 lux".into())
    );
}

#[test]
fn a_simulation_that_begins_before_zero_is_recorded_in_order() {
    let cameras = vec![world::camera("left", 32, 24)];
    let (_folder, path, mut rig) = recording(&cameras, &lossless());
    ticks(&mut rig, &cameras, -6..2);
    rig.finish().2.unwrap();
    let answer = world::check_bag(&path);
    assert_eq!(answer["/clock"]["last"]["clock"]["nanosec"], 2 * INTERVAL_NS);
    let (messages, _) = read(&path);
    let mut times: Vec<u64> = messages.iter().map(|(_, log_ns, _)| *log_ns).collect();
    times.sort_unstable();
    times.dedup();
    // Two IMU samples an interval; those of the first interval end at 0.
    let half_ns = INTERVAL_NS / 2;
    assert_eq!(times[..3], [0, half_ns as u64, INTERVAL_NS as u64]);
    assert_eq!((times.len(), times[times.len() - 1]), (15, 7 * INTERVAL_NS as u64));
}

#[test]
fn mono_refuses_times_before_zero() {
    let cameras = vec![world::camera("left", 32, 24)];
    let options = RigOptions { events: EventFormat::Mono, ..lossless() };
    let (_folder, _, mut rig) = recording(&cameras, &options);
    let error = rig.check_base(0, -1).unwrap_err().to_string();
    assert!(error.contains("camera `left` count from -1 ns, expected 0 or later"), "{error}");
    ticks(&mut rig, &cameras, -2..1);
    let notices = rig.notices();
    assert_eq!(notices.len(), 1, "{notices:?}");
    assert!(notices[0].contains("`mono`") && notices[0].contains("not sent"), "{notices:?}");
    let (summary, _, recorded) = rig.finish();
    recorded.unwrap();
    let events = summary.topics.iter().find(|topic| topic.topic.ends_with("/events")).unwrap();
    assert_eq!((events.failed, events.recorded), (2, 1));
    let packed = RigPublisher::start(cameras, lossless(), Sinks::default()).unwrap();
    packed.check_base(0, -1).unwrap();
}

#[test]
fn an_old_recording_stays_until_a_chunk_of_messages_takes_its_place() {
    let cameras = vec![world::camera("left", 32, 24)];
    let (folder, path, rig) = recording(&cameras, &lossless());
    drop(rig);
    assert!(!path.exists(), "a new file without messages");
    std::fs::write(&path, "old").unwrap();
    let old = || std::fs::read(&path).unwrap() == b"old";
    let again = || world::rig(&cameras, &lossless(), Sinks { transport: None, bag: Some(world::bag(&path)) });
    drop(again());
    assert!(old());
    let (_, notices, recorded) = again().finish();
    recorded.unwrap();
    assert!(old() && notices.iter().any(|n| n.contains("run.mcap is not written")), "{notices:?}");

    // A writer that is killed: before a chunk of 1 MiB is whole, and after it.
    let topic = again().plan().topics[0].clone();
    for (messages, is_old) in [(1, true), (2, false)] {
        let mut bag = world::bag(&path);
        bag.add_topic(&topic).unwrap();
        (0..messages).for_each(|_| bag.write(0, 0, &[0; 2 << 20]).unwrap());
        std::mem::forget(bag);
        assert_eq!(old(), is_old, "{messages}");
    }
    let (messages, truncated) = read(&path);
    assert!(messages.len() == 1 && truncated);
    let mut rig = again();
    ticks(&mut rig, &cameras, 0..2);
    rig.finish().2.unwrap();
    assert!(!read(&path).1, "the longer file is gone");
    drop(folder);
}

#[test]
fn golden_messages_are_what_rosbags_writes() {
    world::check_golden_messages();
}
