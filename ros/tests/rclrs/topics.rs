//! What the node publishes, and how it stands in the graph.

use crate::node::{self, Observer};
use crate::world;
use esaac_ros::qos::Qos;
use esaac_ros::{MessageType, Payload, RigOptions, Sinks, Topic, Transport};
use rclrs::{QoSDurabilityPolicy, QoSReliabilityPolicy};
use std::sync::Arc;
use std::time::Duration;

#[test]
fn names_types_and_qualities_are_in_the_graph() {
    let domain = world::domain();
    let cameras = [world::camera("left", 32, 24)];
    let sinks = Sinks { transport: Some(Box::new(node::open(domain, &[]).unwrap())), bag: None };
    let rig = world::rig(&cameras, &RigOptions::default(), sinks);
    let mut observer = Observer::on(domain);
    for topic in &rig.plan().topics {
        let (asking, name) = (Arc::clone(&observer.node), topic.name.clone());
        observer.wait_until(move || asking.count_publishers(&name).is_ok_and(|count| count == 1));
        let found = observer.node.get_publishers_info_by_topic(&topic.name).unwrap();
        let offered = found[0].qos_profile;
        assert_eq!((found[0].node_name.as_str(), found[0].node_namespace.as_str()), ("esaac", "/"));
        assert_eq!(found[0].topic_type, topic.type_name);
        assert_eq!(offered.reliability, QoSReliabilityPolicy::Reliable, "{}", topic.name);
        let latched = offered.durability == QoSDurabilityPolicy::TransientLocal;
        assert_eq!(latched, topic.qos == Qos::latched(), "{}", topic.name);
    }
    let nodes = observer.node.get_node_names().unwrap();
    assert!(nodes.iter().any(|node| node.name == "esaac" && node.namespace == "/"), "{nodes:?}");
}

#[test]
fn topics_and_node_are_renamed_as_ros_does_it() {
    let domain = world::domain();
    let arguments =
        ["--ros-args", "-r", "/esaac/left/events:=/dvs/events", "-r", "__node:=camera", "-r", "__ns:=/robot"];
    let transport = node::open(domain, &arguments).unwrap();
    assert!(transport.name().ends_with("node /robot/camera"), "{}", transport.name());
    let sinks = Sinks { transport: Some(Box::new(transport)), bag: None };
    let rig = world::rig(&[world::camera("left", 32, 24)], &RigOptions::default(), sinks);
    let mut observer = Observer::on(domain);
    let asking = Arc::clone(&observer.node);
    observer.wait_until(move || asking.count_publishers("/dvs/events").is_ok_and(|count| count == 1));
    drop(rig);
}

#[test]
fn a_subscriber_that_cannot_be_served_is_named() {
    let domain = world::domain();
    let mut transport = node::open(domain, &[]).unwrap();
    let topic = topic("/clock", MessageType::Clock);
    let qos = Qos { reliability: esaac_ros::qos::Reliability::BestEffort, ..topic.qos };
    transport.advertise(&Topic { qos, ..topic }).unwrap();
    assert_eq!(transport.notices(), [""; 0]);
    let reader = world::Subscriber::on(domain);
    let reader = reader.start(&[("/clock".to_owned(), MessageType::Clock.name().to_owned(), "reliable")]);
    let until = std::time::Instant::now() + world::PATIENCE;
    let notice = loop {
        if let Some(notice) = transport.notices().pop() {
            break notice;
        }
        assert!(std::time::Instant::now() < until, "no notice");
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(notice.contains("'/clock'") && notice.ends_with("RELIABILITY"), "{notice}");
    assert_eq!(transport.notices(), [""; 0], "it is told once");
    reader.finish();
}

fn topic(name: &str, kind: MessageType) -> Topic {
    Topic {
        name: name.to_owned(),
        type_name: kind.name().to_owned(),
        type_hash: None,
        schema: kind.schema(),
        qos: Qos::sensor_data(1),
        patience: Duration::ZERO,
    }
}

#[test]
fn what_the_sourced_ros_does_not_have_is_refused() {
    let mut transport = node::open(world::domain(), &[]).unwrap();
    let mut refuse = |change: fn(&mut Topic)| {
        let mut topic = topic("/a", MessageType::Image);
        change(&mut topic);
        transport.advertise(&topic).unwrap_err().to_string()
    };
    let error = refuse(|topic| topic.type_name = "nonesuch_msgs/msg/Image".to_owned());
    assert!(error.contains("`/a`: package `nonesuch_msgs` is not in the sourced ROS 2"), "{error}");
    let error = refuse(|topic| topic.type_name = "sensor_msgs/msg/Picture".to_owned());
    assert!(error.contains("has no message `sensor_msgs/msg/Picture`"), "{error}");
    assert!(refuse(|topic| topic.type_name = "Image".to_owned()).contains("'Image'"));
    assert!(refuse(|topic| topic.name = "/a b".to_owned()).contains("`/a b`"));
    let error = refuse(|topic| topic.schema = topic.schema.replacen("uint32 step", "uint64 step", 1));
    assert!(error.contains("another definition") && error.contains("type for `step`"), "{error}");
    let error = refuse(|topic| topic.schema = topic.schema.replacen("uint32 step", "uint32 stride", 1));
    assert!(error.contains("stride"), "{error}");
}

#[test]
fn bytes_that_are_no_message_are_refused_and_the_next_ones_sent() {
    let mut transport = node::open(world::domain(), &[]).unwrap();
    transport.advertise(&topic("/a", MessageType::Clock)).unwrap();
    let mut publish = |bytes: &[u8]| transport.publish(0, &Arc::new(Payload::new(bytes.to_vec())));
    let error = publish(&[0, 1, 0, 0, 9]).unwrap_err().to_string();
    assert!(error.contains("`/a`") && error.contains("ends at byte 5"), "{error}");
    assert!(publish(b"").unwrap_err().to_string().contains("encoding"));
    assert_eq!(publish(&[0, 1, 0, 0, 9, 0, 0, 0, 1, 0, 0, 0]), Ok(()));
}

#[test]
fn a_node_that_cannot_be_is_an_error() {
    let open = |arguments: &[&str]| node::open(world::domain(), arguments).err().unwrap();
    let error = open(&["--ros-args", "-p", "no value"]);
    assert!(error.contains("no ROS 2 network"), "{error}");
    let options = esaac_ros::NodeOptions { node: "my node".to_owned(), ..esaac_ros::NodeOptions::default() };
    let error = esaac_ros::RclrsTransport::open(&options).err().unwrap().to_string();
    assert!(error.contains("node `my node`"), "{error}");
}

#[cfg(feature = "embedded")]
#[test]
fn both_transports_live_in_one_process() {
    let domain = world::domain();
    let mut embedded = world::transport(domain);
    let mut node = node::open(domain, &[]).unwrap();
    let reader = world::Subscriber::on(domain);
    let kind = MessageType::Clock.name().to_owned();
    let reader = reader
        .start(&[("/embedded".to_owned(), kind.clone(), "reliable"), ("/node".to_owned(), kind, "reliable")]);
    embedded.advertise(&topic("/embedded", MessageType::Clock)).unwrap();
    node.advertise(&topic("/node", MessageType::Clock)).unwrap();
    reader.wait_until_matched(2);
    let message = Arc::new(Payload::new(vec![0, 1, 0, 0, 9, 0, 0, 0, 1, 0, 0, 0]));
    embedded.publish(0, &message).unwrap();
    node.publish(0, &message).unwrap();
    embedded.drain(world::PATIENCE);
    node.drain(world::PATIENCE);
    reader.wait_until_taken(2);
    let mut taken: Vec<_> =
        world::taken(&reader.finish()).iter().map(|taken| (taken.topic, taken.hash)).collect();
    taken.sort_unstable();
    let hash = world::wire_hash(&message);
    assert_eq!(taken, [(0, hash), (1, hash)]);
}
