//! Subscribers that stall, come late or die, full queues and full disks.

use crate::world::{self, Subscriber, Taken};
use esaac_model::Packet;
use esaac_ros::{
    CameraPlan, Payload, Policy, RigOptions, RigPublisher, Sinks, Topic, Transport, TransportError, host,
};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

const INTERVAL_NS: i64 = 33_333_333;

type Topics = Vec<(String, String, &'static str)>;

/// A camera, its rig on loopback, and its topics whose names end so.
fn rig(domain: u32, ends: &[&str]) -> (Vec<CameraPlan>, RigPublisher, Topics) {
    let cameras = vec![world::camera("left", 346, 260)];
    let transport: Option<Box<dyn Transport>> = Some(Box::new(world::transport(domain)));
    let rig = world::rig(&cameras, &RigOptions::default(), Sinks { transport, bag: None });
    let wanted = |name: &str| ends.iter().any(|end| name.ends_with(end));
    let topics = world::topics(&rig).into_iter().filter(|(name, _, _)| wanted(name)).collect();
    (cameras, rig, topics)
}

/// Packets of 30 000 events, 270 kB each, at the pace of a camera.
fn packets(rig: &mut RigPublisher, cameras: &[CameraPlan], range: std::ops::Range<i64>) {
    for tick in range {
        let began = Instant::now();
        let (start, end) = (tick * INTERVAL_NS, (tick + 1) * INTERVAL_NS);
        let packet: Packet = world::packet(&cameras[0], start, end, 30_000, tick as u32);
        let mut messages = rig.tick(end);
        messages.events(0, &packet.view());
        messages.send();
        std::thread::sleep(Duration::from_millis(20).saturating_sub(began.elapsed()));
    }
}

fn signal(name: &str, process: u32) {
    let status = Command::new("kill").args([name, &process.to_string()]).status().expect("kill runs");
    assert!(status.success());
}

#[test]
fn a_subscriber_that_stalls_holds_back_neither_publisher_nor_others() {
    let domain = world::domain();
    let (cameras, mut rig, topics) = rig(domain, &["/events"]);
    let healthy = Subscriber::on(domain).start(&topics);
    let stalled = Subscriber::on(domain).start(&topics);
    healthy.wait_until_matched(1);
    stalled.wait_until_matched(1);
    world::wait_for_subscribers(&rig, &topics, 2);
    packets(&mut rig, &cameras, 0..5);
    signal("-STOP", stalled.id());
    packets(&mut rig, &cameras, 5..65);
    signal("-CONT", stalled.id());
    assert_eq!(rig.finish().0.lost(), 0);
    // The publisher kept what the stalled subscriber had not fetched, and sent it when that one went on.
    for subscriber in [healthy, stalled] {
        subscriber.wait_until_taken(65);
        assert_eq!(world::taken(&subscriber.finish()).len(), 65);
    }
}

#[test]
fn a_subscriber_that_comes_late_gets_what_is_latched_and_all_from_then_on() {
    let domain = world::domain();
    let (cameras, mut rig, topics) = rig(domain, &["/events", "/sensor", "/tf_static"]);
    packets(&mut rig, &cameras, 0..10);
    let late = Subscriber::on(domain).start(&topics);
    late.wait_until_matched(3);
    world::wait_for_subscribers(&rig, &topics, 1);
    // The sensor and the frames.
    late.wait_until_taken(2);
    packets(&mut rig, &cameras, 10..20);
    assert_eq!(rig.finish().0.lost(), 0);
    late.wait_until_taken(12);
    let taken = world::taken(&late.finish());
    let count = |end: &str| {
        let number = topics.iter().position(|(name, _, _)| name.ends_with(end)).unwrap();
        taken.iter().filter(|t: &&Taken| t.topic == number).count()
    };
    assert_eq!((count("/events"), count("/sensor"), count("/tf_static")), (10, 1, 1));
}

#[test]
fn a_subscriber_that_dies_is_forgotten() {
    let domain = world::domain();
    let (cameras, mut rig, topics) = rig(domain, &["/events"]);
    let healthy = Subscriber::on(domain).start(&topics);
    let mut dying = Subscriber::on(domain).start(&topics);
    healthy.wait_until_matched(1);
    dying.wait_until_matched(1);
    world::wait_for_subscribers(&rig, &topics, 2);
    packets(&mut rig, &cameras, 0..10);
    dying.kill();
    packets(&mut rig, &cameras, 10..40);
    assert_eq!(rig.finish().0.lost(), 0);
    healthy.wait_until_taken(40);
    assert_eq!(world::taken(&healthy.finish()).len(), 40);
}

#[test]
fn a_subscriber_that_dies_holds_up_a_lossless_rig_for_a_while_only() {
    let domain = world::domain();
    let cameras = vec![world::camera("left", 346, 260)];
    let transport: Option<Box<dyn Transport>> = Some(Box::new(world::transport(domain)));
    let options = RigOptions { policy: Policy::Lossless, ..RigOptions::default() };
    let mut rig = world::rig(&cameras, &options, Sinks { transport, bag: None });
    let topics: Topics =
        world::topics(&rig).into_iter().filter(|(name, _, _)| name.ends_with("/events")).collect();
    let mut dying = Subscriber::on(domain).start(&topics);
    dying.wait_until_matched(1);
    world::wait_for_subscribers(&rig, &topics, 1);
    packets(&mut rig, &cameras, 0..5);
    dying.kill();
    let began = Instant::now();
    packets(&mut rig, &cameras, 5..40);
    let (summary, _, _) = rig.finish();
    assert_eq!((summary.lost(), summary.dropped_ticks), (0, 0));
    // DDS forgets a participant ten seconds after its last word.
    assert!(began.elapsed() < Duration::from_secs(45), "{:?}", began.elapsed());
}

#[test]
fn a_recording_that_outgrows_its_disk_stops_and_the_topics_go_on() {
    const LIMITED: &str = "ESAAC_ROS_LIMITED";
    if std::env::var_os(LIMITED).is_none() {
        // A limit on files stands for a disk, in a process of its own and without the signal that would end
        // it.
        let test = "faults::a_recording_that_outgrows_its_disk_stops_and_the_topics_go_on";
        let script = "trap '' XFSZ; ulimit -f 2048; exec \"$@\"";
        let mut limited = Command::new("bash");
        limited.args(["-c", script, "bash"]).arg(std::env::current_exe().unwrap()).args(["--exact", test]);
        let output = limited.env(LIMITED, "1").output().expect("bash runs");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && text.contains("1 passed"), "{text}");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let cameras = vec![world::camera("left", 346, 260)];
    let transport: Option<Box<dyn Transport>> = Some(Box::new(world::transport(world::domain())));
    let sinks = Sinks { transport, bag: Some(world::bag(&folder.path().join("run.mcap"))) };
    let mut rig = world::rig(&cameras, &RigOptions::default(), sinks);
    packets(&mut rig, &cameras, 0..30);
    let (summary, notices, recorded) = rig.finish();
    let error = recorded.unwrap_err().to_string();
    assert!(error.contains("run.mcap") && error.contains("File too large"), "{error}");
    assert!(notices.iter().any(|notice| notice.starts_with("recording stopped")), "{notices:?}");
    let events = summary.topics.iter().find(|topic| topic.topic.ends_with("/events")).unwrap();
    assert!(events.recorded > 0 && events.recorded < 30, "{events:?}");
    assert_eq!((events.sent, summary.lost()), (30, 0));
}

#[test]
fn a_receive_buffer_that_is_too_small_loses_packets_which_are_counted() {
    let domain = world::domain();
    let (cameras, mut rig, topics) = rig(domain, &["/events"]);
    let topics: Topics = topics.into_iter().map(|(name, kind, _)| (name, kind, "best_effort")).collect();
    let small = Subscriber { receive_buffer: 64 << 10, ..Subscriber::on(domain) }.start(&topics);
    small.wait_until_matched(1);
    world::wait_for_subscribers(&rig, &topics, 1);
    let before = host::datagrams_lost().expect("/proc/net/snmp");
    packets(&mut rig, &cameras, 0..5);
    signal("-STOP", small.id());
    packets(&mut rig, &cameras, 5..25);
    signal("-CONT", small.id());
    packets(&mut rig, &cameras, 25..30);
    assert_eq!(rig.finish().0.lost(), 0, "nothing is lost on this side");
    let taken = world::taken(&small.finish()).len();
    assert!(taken < 30, "{taken} of 30 packets came through a buffer of 64 KiB");
    let lost = host::datagrams_lost().expect("/proc/net/snmp") - before;
    assert!(lost > 0, "the system counts what `esaac doctor` shows");
}

/// A slow transport.
struct Slow(Arc<AtomicUsize>);

impl Transport for Slow {
    fn name(&self) -> String {
        "slow".to_owned()
    }
    fn copies(&self) -> u32 {
        0
    }
    fn advertise(&mut self, _: &Topic) -> Result<(), TransportError> {
        Ok(())
    }
    fn publish(&mut self, _: usize, _: &Arc<Payload>) -> Result<(), TransportError> {
        std::thread::sleep(Duration::from_millis(10));
        self.0.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }
    fn subscribers(&self, _: usize) -> usize {
        0
    }
    fn notices(&mut self) -> Vec<String> {
        Vec::new()
    }
    fn drain(&mut self, _: Duration) {}
}

/// Ticks of a clock and a packet each, into a queue of two; the longest that one took to hand over.
fn overwhelm(policy: Policy, folder: &std::path::Path) -> (esaac_ros::Summary, usize, Duration) {
    let cameras = vec![world::camera("left", 32, 24)];
    let options = RigOptions { policy, queue_ticks: 2, ..RigOptions::default() };
    let published = Arc::new(AtomicUsize::new(0));
    let transport: Option<Box<dyn Transport>> = Some(Box::new(Slow(Arc::clone(&published))));
    let bag = Some(world::bag(&folder.join("run.mcap")));
    let mut rig = world::rig(&cameras, &options, Sinks { transport, bag });
    let mut longest = Duration::ZERO;
    for tick in 0..30 {
        let packet = world::packet(&cameras[0], tick * INTERVAL_NS, (tick + 1) * INTERVAL_NS, 10, 0);
        let began = Instant::now();
        let mut messages = rig.tick(packet.watermark_ns);
        messages.events(0, &packet.view());
        messages.send();
        longest = longest.max(began.elapsed());
    }
    let (summary, _, recorded) = rig.finish();
    recorded.unwrap();
    (summary, published.load(Ordering::Relaxed), longest)
}

#[test]
fn a_full_queue_drops_the_oldest_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (summary, published, _) = overwhelm(Policy::Latest, folder.path());
    assert!(summary.dropped_ticks >= 20, "{summary:?}");
    // 30 clocks, 30 packets, a sensor and the frames; diagnostics come on top of what is accounted for.
    let diagnostics = summary.topics.iter().find(|t| t.topic == "/diagnostics").unwrap().sent;
    assert_eq!(summary.sent() + summary.lost(), 62 + diagnostics);
    assert_eq!(summary.sent() as usize, published);
    let answer = world::check_bag(&folder.path().join("run.mcap"));
    let status = &answer["/diagnostics"]["last"]["status"];
    assert_eq!(status[0]["level"], 1, "a warning");
    let (lost, ticks) = (summary.lost(), summary.dropped_ticks);
    assert_eq!(
        status[0]["message"],
        format!("{lost} messages lost: {lost} dropped in {ticks} ticks, 0 failed")
    );
    // The last tick is there, and a gap in the sequence shows what is not.
    assert_eq!(answer["/esaac/left/events"]["last"]["sequence"], 29);
}

#[test]
fn a_lossless_queue_waits_and_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (summary, _, longest) = overwhelm(Policy::Lossless, folder.path());
    assert_eq!((summary.lost(), summary.dropped_ticks), (0, 0));
    assert!(longest >= Duration::from_millis(10), "{longest:?}");
    assert_eq!(world::check_bag(&folder.path().join("run.mcap"))["/esaac/left/events"]["recorded"], 30);
}
