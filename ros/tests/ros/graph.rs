//! The ROS graph that `ros2 node list` and `ros2 topic info -v` need: the node and its writers.

use crate::world;
use esaac_ros::qos::{Durability, Reliability};
use esaac_ros::{CycloneTransport, NetworkOptions, Plan, RigOptions, Topic, Transport};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

fn texts(list: &Value) -> BTreeSet<String> {
    list.as_array().expect("a list").iter().map(|text| text.as_str().expect("a text").to_owned()).collect()
}

/// A writer as DDS tells of it.
fn told(topic: &Topic) -> Value {
    let [package, _, name] = topic.type_name.split('/').collect::<Vec<_>>()[..] else { panic!("{topic:?}") };
    serde_json::json!({
        "topic": format!("rt{}", topic.name),
        "type": format!("{package}::msg::dds_::{name}_"),
        "user_data": format!("typehash={};", topic.type_hash.as_ref().expect("a known type")),
        "reliable": topic.qos.reliability == Reliability::Reliable,
        "latched": topic.qos.durability == Durability::TransientLocal,
    })
}

fn a_node_and_its_writers_are_told(distribution: &str, gid_bytes: usize) {
    let domain = world::domain();
    let network = NetworkOptions {
        node: "event_cameras".to_owned(),
        distribution: distribution.to_owned(),
        ..world::network(domain)
    };
    let options =
        RigOptions { qos: vec![("imu".to_owned(), "best_effort".parse().unwrap())], ..RigOptions::default() };
    let topics = Plan::new(&[world::camera("left", 32, 24)], &options).unwrap().topics;
    let mut transport = CycloneTransport::open(network).unwrap();
    // The last one comes when the graph has been told already.
    let (last, first) = topics.split_last().unwrap();
    first.iter().for_each(|topic| transport.advertise(topic).unwrap());
    transport.notices();
    transport.advertise(last).unwrap();
    transport.notices();

    let answer = world::graph(domain, gid_bytes, topics.len());
    let graph = answer["graph"].as_object().unwrap();
    let [(participant, nodes)] = graph.iter().collect::<Vec<_>>()[..] else { panic!("{graph:?}") };
    // On the graph identities are filled up with zeros to the distribution's length.
    let (guid, filling) = participant.split_at(32);
    assert_eq!((participant.len(), filling.trim_matches('0')), (2 * gid_bytes, ""));
    assert_eq!(answer["participants"][guid], "enclave=/;");
    let [node] = &nodes.as_array().unwrap()[..] else { panic!("{nodes}") };
    assert_eq!((&node["namespace"], &node["name"]), (&"/".into(), &"event_cameras".into()));
    assert_eq!(texts(&node["readers"]), BTreeSet::new());

    // Each writer that DDS has found of the participant is the node's, and has topic, type, hash and quality.
    let mut writers: BTreeMap<String, Value> = BTreeMap::new();
    for (key, writer) in answer["writers"].as_object().unwrap() {
        let mut writer = writer.clone();
        let owner = writer.as_object_mut().unwrap().remove("participant").unwrap();
        if owner == guid && writer["topic"] != "ros_discovery_info" {
            writers.insert(format!("{key}{filling}"), writer);
        }
    }
    assert_eq!(texts(&node["writers"]), writers.keys().cloned().collect());
    let by_topic = |writer: &Value| writer["topic"].as_str().unwrap().to_owned();
    let actual: BTreeMap<String, Value> = writers.into_values().map(|w| (by_topic(&w), w)).collect();
    let expected: BTreeMap<String, Value> = topics.iter().map(told).map(|w| (by_topic(&w), w)).collect();
    assert_eq!(actual, expected);
}

#[test]
fn a_node_its_writers_and_their_types_are_told_as_jazzy_and_later_read_them() {
    a_node_and_its_writers_are_told("jazzy", 16);
}

#[test]
fn a_node_its_writers_and_their_types_are_told_as_humble_reads_them() {
    a_node_and_its_writers_are_told("humble", 24);
}
