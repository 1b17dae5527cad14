//! Wrong input: errors that say what was expected.

use crate::world;
use esaac_ros::replay::{ReplayOptions, replay};
use esaac_ros::{
    BagReader, BagWriter, CycloneTransport, MessageType, NetworkOptions, Qos, RigOptions, RigPublisher,
    Sinks, Topic, Transport,
};
use std::path::Path;

fn open_error(change: impl FnOnce(&mut NetworkOptions)) -> String {
    let mut options = world::network(world::domain());
    change(&mut options);
    CycloneTransport::open(options).err().expect("it cannot be opened").to_string()
}

#[test]
fn a_network_that_is_not_there_is_named() {
    let error = open_error(|o| o.interface = Some("nonesuch0".to_owned()));
    assert!(error.contains("no ROS 2 network") && error.contains("nonesuch0"), "{error}");
    let error = open_error(|o| o.domain = 233);
    assert!(error.contains("domain id 233, expected 0 to 232"), "{error}");
    let error = open_error(|o| o.node = "my node".to_owned());
    assert!(error.contains("node `my node`"), "{error}");
}

#[test]
fn a_domain_that_is_open_already_is_an_error_and_free_again_afterwards() {
    let domain = world::domain();
    let first = world::transport(domain);
    let error = open_error(|o| o.domain = domain);
    assert!(error.contains(&format!("domain {domain} is open in this process already")), "{error}");
    drop(first);
    drop(world::transport(domain));
}

#[test]
fn a_topic_of_no_type_or_of_no_name_is_refused() {
    let mut transport = world::transport(world::domain());
    let topic = |name: &str, kind: &str| Topic {
        name: name.to_owned(),
        type_name: kind.to_owned(),
        type_hash: None,
        schema: String::new(),
        qos: Qos::sensor_data(1),
        patience: std::time::Duration::ZERO,
    };
    let error = transport.advertise(&topic("/a", "Image")).unwrap_err().to_string();
    assert!(error.contains("`Image` is not a message type, expected pkg/msg/Name"), "{error}");
    let error = transport.advertise(&topic("/a b", MessageType::Image.name())).unwrap_err().to_string();
    assert!(error.contains("`/a b`"), "{error}");
}

#[test]
fn a_recording_that_cannot_be_made_or_read_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let text = |path: &Path| BagWriter::create(path).err().expect("no file there").to_string();
    let error = text(&folder.path().join("none/run.mcap"));
    assert!(error.contains("none/run.mcap") && error.contains("No such file"), "{error}");
    assert!(text(folder.path()).contains("directory"));

    let missing = BagReader::open(&folder.path().join("missing.mcap")).err().unwrap().to_string();
    assert!(missing.contains("missing.mcap"), "{missing}");
    let read = |bytes: &[u8]| {
        let path = folder.path().join("bad.mcap");
        std::fs::write(&path, bytes).unwrap();
        BagReader::open(&path).unwrap().next_message().unwrap_err().to_string()
    };
    assert!(read(b"this is no recording at all").contains("Bad magic"));
    assert!(read(b"").contains("bad.mcap"));
    // A record longer than the file, and one longer than memory.
    let magic = [0x89, b'M', b'C', b'A', b'P', 0x30, b'\r', b'\n'];
    for length in [100_u64, u64::MAX] {
        assert!(read(&[&magic[..], &[1], &length.to_le_bytes()].concat()).contains("bad.mcap"));
    }
}

#[test]
fn a_recording_without_messages_of_ros_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("json.mcap");
    let mut writer =
        mcap::Writer::new(std::io::BufWriter::new(std::fs::File::create(&path).unwrap())).unwrap();
    let channel = writer.add_channel(0, "/numbers", "json", &Default::default()).unwrap();
    let header =
        mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    drop(writer);
    let mut transport = world::transport(world::domain());
    let bag = BagReader::open(&path).unwrap();
    let error =
        replay(bag, &mut transport, ReplayOptions::default(), || false, |_| ()).unwrap_err().to_string();
    assert!(error.contains("no message of ROS 2") && error.contains("`json` on /numbers"), "{error}");
    for rate in [0.0, -1.0, 1e-30, f64::NAN, f64::INFINITY] {
        let options = ReplayOptions { rate, ..ReplayOptions::default() };
        let bag = BagReader::open(&path).unwrap();
        let error = replay(bag, &mut transport, options, || false, |_| ()).unwrap_err().to_string();
        assert_eq!(error, format!("rate {rate}, expected a number of 0.000001 or more"));
    }
}

#[test]
fn quality_that_a_subscriber_cannot_accept_is_told_as_ros_tells_it() {
    let domain = world::domain();
    let options = RigOptions {
        qos: vec![("events".to_owned(), "best_effort".parse().unwrap())],
        ..RigOptions::default()
    };
    let transport: Option<Box<dyn Transport>> = Some(Box::new(world::transport(domain)));
    let cameras = vec![world::camera("left", 32, 24)];
    let mut rig = RigPublisher::start(cameras.clone(), options, Sinks { transport, bag: None }).unwrap();
    let topics: Vec<_> =
        world::topics(&rig).into_iter().filter(|(name, _, _)| name.ends_with("/events")).collect();
    let _subscriber = world::Subscriber::on(domain).start(&topics);
    let mut notices = Vec::new();
    let some = || {
        notices = rig.notices();
        !notices.is_empty()
    };
    world::wait_until(some, || "no notice".to_owned());
    let notice = notices.join("\n");
    assert!(notice.contains("'/esaac/left/events', requesting incompatible QoS"), "{notice}");
    assert!(notice.ends_with("RELIABILITY"), "{notice}");
    rig.tick(0).send();
}
