//! Publishes every message type with the transport under test, and compares what subscribers get with the
//! recording.

use crate::{WIRE_COPIES, open, world};
use esaac_model::Packet;
use esaac_ros::{
    BagReader, CameraPlan, EventFormat, Instance, Payload, Policy, RigOptions, RigPublisher, Sinks, Split,
};
use std::path::Path;

const TICKS: i64 = 4;
const INTERVAL_NS: i64 = 33_333_333;

fn cameras() -> Vec<CameraPlan> {
    let mut wide = world::camera("wide", 37, 23);
    wide.sensor.aps_bits = 10;
    vec![CameraPlan { event_ids: true, ..world::camera("left", 32, 24) }, wide]
}

/// An instance with two labels of a kind and one of another.
fn instance(id: i64) -> Instance {
    let labels = [("class", "box"), ("class", "toy"), ("room", "")];
    let labels = labels.map(|(kind, label)| (kind.to_owned(), label.to_owned())).to_vec();
    Instance { id, name: format!("/World/{id}"), labels }
}

/// Publishes `TICKS` ticks of `cameras`; returns the packets, and copies of a message on its way to the wire.
fn run(mut rig: RigPublisher, cameras: &[CameraPlan]) -> (Vec<Packet>, u32) {
    let mut sent = Vec::new();
    rig.set_instances(0, vec![instance(7), instance(0)]).expect("a camera with ids");
    for tick in 0..TICKS {
        let (start, end) = (tick * INTERVAL_NS, (tick + 1) * INTERVAL_NS);
        // The second packet is empty.
        let events = if tick == 1 { 0 } else { 500 };
        let packets: Vec<Packet> = (0..)
            .zip(cameras)
            .map(|(camera, plan)| world::packet(plan, start, end, events, tick as u32 * 2 + camera))
            .collect();
        world::publish(&mut rig, cameras, &packets, 3);
        sent.extend(packets);
    }
    let (summary, _, recorded) = rig.finish();
    recorded.expect("the recording is written");
    assert_eq!(summary.lost(), 0, "{summary:?}");
    assert_eq!(summary.copies.encode, 1);
    (sent, summary.copies.wire)
}

/// Messages of a recording by topic.
fn recorded(path: &Path) -> Vec<(String, Vec<Vec<u8>>)> {
    let mut bag = BagReader::open(path).expect("it is there");
    let mut topics: Vec<Vec<Vec<u8>>> = Vec::new();
    while let Some(message) = bag.next_message().expect("it is whole") {
        topics.resize(bag.topics().len(), Vec::new());
        topics[message.topic].push(message.bytes);
    }
    assert!(!bag.is_truncated());
    bag.topics().iter().map(|topic| topic.name.clone()).zip(topics).collect()
}

/// Publishes in `format` to both subscribers and a recording, and compares all that can be.
fn everyone_reads_the_same(format: EventFormat) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let domain = world::domain();
    let cameras = cameras();
    let options = RigOptions { events: format, policy: Policy::Lossless, ..RigOptions::default() };
    let sinks = Sinks { transport: Some(open(domain)), bag: Some(world::bag(&path)) };
    let rig = world::rig(&cameras, &options, sinks);
    let topics = world::topics(&rig);
    let fast = world::Subscriber::on(domain).start(&topics);
    let cyclone = world::cyclone_subscriber(domain, &path, &topics);
    fast.wait_until_matched(topics.len());
    cyclone.wait_until_matched(topics.len());
    world::wait_for_subscribers(&rig, &topics, 2);
    let (sent, copies) = run(rig, &cameras);
    assert_eq!(copies, WIRE_COPIES);

    // Fast DDS took the bytes that are in the recording, in that order.
    let recorded = recorded(&path);
    fast.wait_until_taken(recorded.iter().map(|(_, messages)| messages.len()).sum());
    let taken = world::taken(&fast.finish());
    for (number, (name, messages)) in recorded.iter().enumerate() {
        let expected: Vec<u64> =
            messages.iter().map(|bytes| world::wire_hash(&Payload::new(bytes.clone()))).collect();
        let actual: Vec<u64> = taken.iter().filter(|t| t.topic == number).map(|t| t.hash).collect();
        assert!(!expected.is_empty(), "{name}");
        assert_eq!(actual, expected, "{name}");
    }

    // cyclonedds decoded what rosbags decoded, and that is what was published.
    let lines = cyclone.finish();
    let answer: serde_json::Value = serde_json::from_str(lines.last().expect("an answer")).unwrap();
    for (topic, _, _) in &topics {
        let line = &answer[topic];
        assert!(line["recorded"].as_u64() >= Some(1), "{topic}: {line}");
        assert_eq!((&line["listened"], &line["equal"]), (&line["recorded"], &line["recorded"]), "{topic}");
    }
    contents(&answer, format, &sent);
}

/// The first messages hold what was given.
fn contents(answer: &serde_json::Value, format: EventFormat, sent: &[Packet]) {
    let first = |topic: &str| answer[topic]["first"].clone();
    let events = first("/esaac/left/events");
    let packet = &sent[0];
    assert_eq!(events["header"]["frame_id"], "esaac_left_optical_frame");
    assert_eq!(events["header"]["stamp"]["nanosec"], INTERVAL_NS);
    assert_eq!((&events["width"], &events["height"]), (&32.into(), &24.into()));
    match format {
        EventFormat::Packed => {
            assert_eq!(events["x"], serde_json::json!(packet.x));
            assert_eq!(events["y"], serde_json::json!(packet.y));
            assert_eq!(events["t_offset_ns"], serde_json::json!(packet.t_offset_ns));
            assert_eq!(events["polarity"], serde_json::json!(packet.polarity));
            assert_eq!(events["watermark_ns"], packet.watermark_ns);
            assert_eq!(answer["/esaac/wide/events"]["last"]["dropped"], sent[sent.len() - 1].dropped);
            assert_eq!(answer["/esaac/left/events"]["last"]["sequence"], TICKS - 1);
        }
        EventFormat::Plain => {
            let event = packet.event(499);
            let last = &events["events"][499];
            assert_eq!((&last["t_ns"], &last["x"]), (&event.t_ns.into(), &event.x.into()));
        }
        EventFormat::Mono => {
            assert_eq!(
                (&events["encoding"], events["events"].as_array().unwrap().len()),
                (&"mono".into(), 4000)
            );
        }
        EventFormat::Evt3 => assert_eq!(events["encoding"], "evt3"),
    }
    let ids = first("/esaac/left/event_ids");
    assert_eq!((&ids["header"], &ids["ids"]), (&events["header"], &serde_json::json!(world::ids(packet))));
    assert_eq!(answer["/esaac/left/event_ids"]["last"]["sequence"], TICKS - 1);
    let instance = &first("/esaac/left/instances")["instances"][1];
    assert_eq!((&instance["id"], &instance["name"]), (&7.into(), &"/World/7".into()));
    assert_eq!(instance["kinds"], serde_json::json!(["class", "class", "room"]));
    assert_eq!(instance["labels"], serde_json::json!(["box", "toy", ""]));
    assert_eq!(answer["/esaac/wide/event_ids"], serde_json::Value::Null, "only where it is asked for");
    let image = first("/esaac/left/image_raw");
    assert_eq!((&image["encoding"], &image["step"]), (&"rgb8".into(), &(32 * 3).into()));
    assert_eq!(first("/esaac/left/aps/image_raw")["encoding"], "mono8");
    assert_eq!(first("/esaac/wide/aps/image_raw")["encoding"], "bayer_rggb16");
    let depth = first("/esaac/left/depth/image_raw");
    assert_eq!(depth["encoding"], "32FC1");
    let nan_then_one: Vec<u8> = [f32::NAN, 1.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    assert_eq!(
        depth["data"].as_array().unwrap()[..8],
        serde_json::json!(nan_then_one).as_array().unwrap()[..]
    );
    assert_eq!(first("/esaac/left/camera_info")["k"][0], 300.0);
    let imu = answer["/esaac/left/imu"]["last"].clone();
    assert_eq!(imu["angular_velocity"]["z"], 3.0);
    assert_eq!(imu["orientation_covariance"][0], -1.0);
    // One clock: a frame, its depth, its last IMU sample, its packet and /clock have one stamp.
    let stamp = &events["header"]["stamp"];
    for topic in ["image_raw", "aps/image_raw", "depth/image_raw", "depth/camera_info"] {
        assert_eq!(first(&format!("/esaac/left/{topic}"))["header"]["stamp"], *stamp, "{topic}");
    }
    assert_eq!(first("/clock")["clock"], *stamp);
    assert_eq!(imu["header"]["stamp"], answer["/esaac/left/events"]["last"]["header"]["stamp"]);
    assert_eq!(first("/esaac/left/sensor")["contrast_on"], 0.2);
    assert_eq!(first("/tf_static")["transforms"][1]["child_frame_id"], "esaac_wide_optical_frame");
    assert_eq!(first("/diagnostics")["status"][0]["message"], "nothing lost");
}

#[test]
fn packed_packets_and_all_else_are_read_bit_for_bit_by_independent_subscribers() {
    everyone_reads_the_same(EventFormat::Packed);
}

#[test]
fn plain_packets_are_read_bit_for_bit() {
    everyone_reads_the_same(EventFormat::Plain);
}

#[test]
fn evt3_packets_are_read_bit_for_bit() {
    everyone_reads_the_same(EventFormat::Evt3);
}

#[test]
fn mono_packets_are_read_bit_for_bit() {
    everyone_reads_the_same(EventFormat::Mono);
}

#[test]
fn a_packet_in_slices_of_a_960th_second_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let split = Split { slice_ns: 1_041_667, max_bytes: 0 };
    let cameras = vec![CameraPlan { split, event_ids: true, ..world::camera("left", 32, 24) }];
    let options = RigOptions { policy: Policy::Lossless, ..RigOptions::default() };
    let sinks = Sinks { transport: Some(open(world::domain())), bag: Some(world::bag(&path)) };
    let (sent, _) = run(world::rig(&cameras, &options, sinks), &cameras);
    let answer = world::check_bag(&path);
    let events = &answer["/esaac/left/events"];
    assert_eq!(events["recorded"], TICKS * 32);
    assert_eq!(events["last"]["sequence"], TICKS * 32 - 1);
    let ids = &answer["/esaac/left/event_ids"];
    assert_eq!((&ids["recorded"], &ids["last"]["header"]), (&events["recorded"], &events["last"]["header"]));
    assert_eq!(events["last"]["watermark_ns"], sent[TICKS as usize - 1].watermark_ns);
}
