//! The Zenoh transport, as an independent session sees it that finds the transport's session through a
//! router.

use crate::world::{self, Peer};
use esaac_model::Packet;
use esaac_ros::qos::{Durability, Reliability};
use esaac_ros::{
    BagReader, CameraPlan, NetworkOptions, Payload, Policy, Qos, RigOptions, Sinks, Topic, Transport,
    ZenohTransport,
};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

const INTERVAL_NS: i64 = 33_333_333;

/// A port of this machine that was free a moment ago.
fn port() -> u16 {
    std::net::TcpListener::bind("127.0.0.1:0")
        .and_then(|listener| listener.local_addr())
        .expect("loopback")
        .port()
}

fn transport(domain: u32, port: u16) -> ZenohTransport {
    let options = NetworkOptions { node: "event_cameras".to_owned(), ..world::network(domain) };
    let connect =
        format!("connect/endpoints=[\"tcp/127.0.0.1:{port}\"];listen/endpoints=[\"tcp/127.0.0.1:0\"]");
    let get = |name: &str| (name == "ZENOH_CONFIG_OVERRIDE").then(|| connect.clone());
    ZenohTransport::open(options, get).expect("a session on loopback")
}

/// What the other side saw once it has ended.
fn answer(subscriber: Peer) -> Value {
    let lines = subscriber.finish();
    serde_json::from_str(lines.last().expect("an answer")).expect("JSON")
}

fn key(domain: u32, topic: &Topic) -> String {
    let [package, _, name] = topic.type_name.split('/').collect::<Vec<_>>()[..] else { panic!("{topic:?}") };
    let hash = topic.type_hash.as_ref().expect("a known type");
    format!("{domain}{}/{package}::msg::dds_::{name}_/{hash}", topic.name)
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn an_independent_session_sees_the_node_and_gets_every_byte() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let (domain, port) = (world::domain(), port());
    let cameras: Vec<CameraPlan> = vec![world::camera("left", 32, 24), world::camera("wide", 37, 23)];
    let options = RigOptions {
        policy: Policy::Lossless,
        qos: vec![("imu".to_owned(), "best_effort,depth:42".parse().unwrap())],
        ..RigOptions::default()
    };
    let sinks = Sinks { transport: Some(Box::new(transport(domain, port))), bag: Some(world::bag(&path)) };
    let mut rig = world::rig(&cameras, &options, sinks);
    let topics = rig.plan().topics.clone();
    // What is latched is sent before anyone listens.
    let tick = |rig: &mut esaac_ros::RigPublisher, tick: i64| {
        let packets: Vec<Packet> = cameras
            .iter()
            .map(|plan| world::packet(plan, tick * INTERVAL_NS, (tick + 1) * INTERVAL_NS, 400, tick as u32))
            .collect();
        world::publish(rig, &cameras, &packets, 3);
    };
    let late = |name: &str| name.ends_with("/sensor") || name == "/tf_static";
    rig.tick(0).send();
    let subscriber = world::zenoh_subscriber(port, domain, &[]);
    subscriber.wait_for_lines(topics.len() + 1, "token");
    // What is latched has come: from here on the two sessions have found each other.
    subscriber.wait_for_lines(topics.iter().filter(|topic| late(&topic.name)).count(), "message");
    (1..5).for_each(|number| tick(&mut rig, number));
    let (summary, _, recorded) = rig.finish();
    recorded.unwrap();
    assert_eq!((summary.lost(), summary.copies.wire), (0, 1));
    let answer = answer(subscriber);

    let mut bag = BagReader::open(&path).unwrap();
    let mut expected: BTreeMap<String, Vec<String>> = BTreeMap::new();
    while let Some(message) = bag.next_message().unwrap() {
        let name = bag.topics()[message.topic].name.clone();
        expected.entry(name).or_default().push(sha256(&message.bytes));
    }
    for topic in &topics {
        let came =
            answer["messages"][key(domain, topic)].as_array().unwrap_or_else(|| panic!("{}", topic.name));
        let mut expected = expected[&topic.name].clone();
        // /clock of the tick that nobody listened to yet; what is latched came afterwards.
        let missed = usize::from(topic.name == "/clock");
        expected.drain(..missed);
        let actual: Vec<&str> = came.iter().map(|message| message["sha256"].as_str().unwrap()).collect();
        assert_eq!(actual, expected, "{}", topic.name);
        let numbers: Vec<u64> = came.iter().map(|message| message["number"].as_u64().unwrap()).collect();
        let first = 1 + missed as u64;
        assert_eq!(numbers, (first..first + expected.len() as u64).collect::<Vec<_>>(), "{}", topic.name);
        assert!(came.iter().all(|message| message["sent_ns"].as_i64() > Some(1_600_000_000_000_000_000)));
        assert!(!late(&topic.name) || came.len() == 1, "{}", topic.name);
    }
}

#[test]
fn tokens_say_what_ros_topic_info_shows_and_identities_follow_from_them() {
    let (domain, port) = (world::domain(), port());
    let mut publisher = transport(domain, port);
    let plan = esaac_ros::Plan::new(&[world::camera("left", 32, 24)], &RigOptions::default()).unwrap();
    for topic in &plan.topics {
        publisher.advertise(topic).unwrap();
    }
    let topic = plan.topics.iter().position(|topic| topic.name.ends_with("/events")).unwrap();
    let subscription = |end: &str| format!("@ros2_lv/{domain}/SESSION/0/9/MS/%/%/rviz/{end}/::,10:,:,:,,");
    let events_key = key(domain, &plan.topics[topic]);
    let (_, rest) = events_key.split_once("PackedEventPacket_").unwrap();
    let right = format!("%esaac%left%events/esaac_msgs::msg::dds_::PackedEventPacket_{rest}");
    let wrong = "%esaac%left%events/esaac_msgs::msg::dds_::PackedEventPacket_/RIHS01_0".to_owned();
    let tokens = [subscription(&right), subscription(&wrong).replace("/9/", "/10/")];
    let subscriber = world::zenoh_subscriber(port, domain, &tokens);
    subscriber.wait_for_lines(plan.topics.len() + 1 + tokens.len(), "token");
    world::wait_until(|| publisher.subscribers(topic) > 0, || "no subscriber".to_owned());
    assert_eq!(publisher.subscribers(topic), 1, "the one of the right type");
    let notices = publisher.notices().join("\n");
    assert!(
        notices.contains("'/esaac/left/events' with another type") && notices.contains("RIHS01_0"),
        "{notices}"
    );
    publisher.publish(topic, &Arc::new(Payload::new(vec![0, 1, 0, 0, 7]))).unwrap();
    subscriber.wait_for_lines(1, "message");
    let seen = answer(subscriber);

    let mine = |token: &&String| token.contains("/event_cameras");
    let tokens: Vec<&String> = seen["tokens"].as_object().unwrap().keys().filter(mine).collect();
    let session = tokens[0].split('/').nth(2).unwrap();
    let start = format!("@ros2_lv/{domain}/{session}/0");
    assert!(tokens.contains(&&format!("{start}/0/NN/%/%/event_cameras")));
    for (number, topic) in plan.topics.iter().enumerate() {
        let topic_key = key(domain, topic);
        let (_, kind_and_hash) = topic_key.split_once(&format!("{}/", topic.name)).unwrap();
        let (name, Qos { reliability, durability, depth }) = (topic.name.replace('/', "%"), topic.qos);
        let reliability = if reliability == Reliability::BestEffort { "2" } else { "" };
        let durability = if durability == Durability::TransientLocal { "1" } else { "" };
        let quality = format!("{reliability}:{durability}:,{depth}:,:,:,,");
        let token = format!("{start}/{}/MP/%/%/event_cameras/{name}/{kind_and_hash}/{quality}", number + 1);
        assert!(tokens.contains(&&token), "{token} is none of {tokens:#?}");
    }
    let [message] = &seen["messages"][&events_key].as_array().unwrap()[..] else { panic!() };
    let token = tokens.iter().find(|token| token.contains("%esaac%left%events")).unwrap();
    assert_eq!(message["gid"], seen["tokens"][token.as_str()]);
    assert_eq!(message["sha256"], sha256(&[0, 1, 0, 0, 7]), "without the padding of DDS");
}

#[test]
fn what_was_sent_last_arrives_though_the_session_is_closed_at_once() {
    let (domain, port) = (world::domain(), port());
    let mut publisher = transport(domain, port);
    let plan = esaac_ros::Plan::new(&[world::camera("left", 32, 24)], &RigOptions::default()).unwrap();
    let of = |end: &str| plan.topics.iter().find(|topic| topic.name.ends_with(end)).unwrap();
    let topic = of("/events");
    publisher.advertise(topic).unwrap();
    publisher.advertise(of("/sensor")).unwrap();
    let subscriber = world::zenoh_subscriber(port, domain, &[]);
    // A latched message comes when the two sessions have found each other.
    publisher.publish(1, &Arc::new(Payload::new(vec![0, 1, 0, 0]))).unwrap();
    subscriber.wait_for_lines(3, "token");
    subscriber.wait_for_lines(1, "message");
    for number in 0..50 {
        publisher.publish(0, &Arc::new(Payload::new(vec![number; 300_000]))).unwrap();
    }
    publisher.drain(Duration::from_secs(10));
    drop(publisher);
    subscriber.wait_for("gone");
    let came = answer(subscriber)["messages"][key(domain, topic)].as_array().unwrap().len();
    assert_eq!(came, 50);
}

#[test]
fn what_a_session_cannot_be_opened_with_is_named() {
    let open = |name: &'static str, value: &'static str, interface: Option<&str>| {
        let options = NetworkOptions { interface: interface.map(str::to_owned), ..world::network(1) };
        let get = |asked: &str| (asked == name).then(|| value.to_owned());
        ZenohTransport::open(options, get).err().expect("no session").to_string()
    };
    let error = open("", "", Some("eth0"));
    assert!(error.contains("`eth0`") && error.contains("ZENOH_CONFIG_OVERRIDE"), "{error}");
    let error = open("ZENOH_CONFIG_OVERRIDE", "listen/endpoints=[\"tcp/203.0.113.1:1\"]", None);
    assert!(error.contains("no ROS 2 network") && error.contains("203.0.113.1"), "{error}");
    let mut alone = transport(1, port());
    let told = || alone.notices().join("\n").contains("rmw_zenohd");
    world::wait_until(told, || "no notice of a router that is missing".to_owned());
    assert_eq!(alone.notices(), Vec::<String>::new(), "once");
}
