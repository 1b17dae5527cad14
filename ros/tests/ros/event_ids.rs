//! Labels of events: the ids of each message of events, and the table that says what they are.

use crate::world;
use esaac_model::Packet;
use esaac_ros::{
    BagReader, CameraPlan, EventFormat, Instance, Policy, RigOptions, RigPublisher, Sinks, Split, Summary,
};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const INTERVAL_NS: i64 = 33_333_333;

fn camera(split: Split) -> CameraPlan {
    CameraPlan { split, event_ids: true, ..world::camera("left", 32, 24) }
}

/// A rig of one camera that records to a file in a folder of its own.
fn recording(camera: CameraPlan, events: EventFormat) -> (TempDir, PathBuf, RigPublisher) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let options = RigOptions { events, policy: Policy::Lossless, ..RigOptions::default() };
    let rig = world::rig(&[camera], &options, Sinks { transport: None, bag: Some(world::bag(&path)) });
    (folder, path, rig)
}

/// Messages of a recording in the order in which they were sent: end of the topic's name, and bytes.
fn recorded(path: &Path) -> Vec<(String, Vec<u8>)> {
    let mut bag = BagReader::open(path).unwrap();
    let mut all = Vec::new();
    while let Some(message) = bag.next_message().unwrap() {
        let name = bag.topics()[message.topic].name.rsplit('/').next().unwrap().to_owned();
        all.push((name, message.bytes));
    }
    all
}

fn number(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// Bytes up to the end of the camera's header: 4 of the encoding, 12 of the stamp and of a length, the frame, padding.
const HEADER_BYTES: usize = 4 + (12 + "esaac_left_optical_frame\0".len()).next_multiple_of(8);

/// Header, sequence and ids of an `EventIds`.
fn ids_of(bytes: &[u8]) -> (&[u8], u64, Vec<i64>) {
    let at = HEADER_BYTES;
    let count = u32::from_le_bytes(bytes[at + 8..at + 12].try_into().unwrap()) as usize;
    let ids = (0..count).map(|i| number(bytes, at + 16 + 8 * i) as i64).collect();
    (&bytes[4..at], number(bytes, at), ids)
}

fn failed(summary: &Summary, topic: &str) -> u64 {
    summary.topics.iter().find(|t| t.topic.ends_with(topic)).unwrap().failed
}

#[test]
fn each_message_of_events_is_followed_by_the_ids_of_its_events() {
    let slices = Split { slice_ns: 1_041_667, max_bytes: 0 };
    let splits =
        [Split::default(), slices, Split { max_bytes: 100, ..slices }, Split { max_bytes: 1, ..slices }];
    for (format, split) in
        EventFormat::NAMES.iter().flat_map(|(_, format)| splits.map(|split| (*format, split)))
    {
        let plan = camera(split);
        let (_folder, path, mut rig) = recording(plan.clone(), format);
        let events = [300, 0, 40];
        let packets: Vec<Packet> = (0..)
            .zip(events)
            .map(|(tick, count)| {
                world::packet(&plan, tick * INTERVAL_NS, (tick + 1) * INTERVAL_NS, count, tick as u32)
            })
            .collect();
        for packet in &packets {
            world::publish(&mut rig, std::slice::from_ref(&plan), std::slice::from_ref(packet), 1);
        }
        let (summary, notices, recording) = rig.finish();
        recording.unwrap();
        assert_eq!((summary.lost(), notices), (0, vec![]), "{format:?}, {split:?}");
        // What each message of events holds.
        let expected: Vec<Vec<i64>> = packets
            .iter()
            .flat_map(|packet| {
                let mut ids = world::ids(packet).into_iter();
                let parts = split.parts(&packet.view(), format);
                parts.iter().map(|part| ids.by_ref().take(part.len()).collect()).collect::<Vec<_>>()
            })
            .collect();
        let mut sent = recorded(&path).into_iter().filter(|(topic, _)| topic.starts_with("event"));
        for (number_of_message, expected) in (0..).zip(expected) {
            let [(first, events), (second, ids)] = [sent.next().unwrap(), sent.next().unwrap()];
            assert_eq!((&*first, &*second), ("events", "event_ids"));
            let (header, sequence, ids) = ids_of(&ids);
            assert_eq!(ids, expected, "{format:?}, {split:?}");
            assert_eq!(header[..], events[4..HEADER_BYTES]);
            // Height and width are between an event message's header and its sequence.
            assert_eq!([sequence, number(&events, HEADER_BYTES + 8)], [number_of_message; 2]);
        }
        assert_eq!(sent.next(), None);
    }
}

#[test]
fn ids_that_are_missing_or_do_not_fit_are_told_once_and_events_are_sent() {
    let plan = camera(Split::default());
    let packet = world::packet(&plan, 0, INTERVAL_NS, 10, 0);
    let wrong: [(Option<usize>, &str); 3] = [
        (
            None,
            "a packet of camera `left` came without ids, expected one for each event; its events are sent",
        ),
        (
            Some(9),
            "camera `left` has 9 ids, expected 10, one for each event; its events are sent without ids",
        ),
        (
            Some(11),
            "camera `left` has 11 ids, expected 10, one for each event; its events are sent without ids",
        ),
    ];
    for (count, message) in wrong {
        let (_folder, path, mut rig) = recording(plan.clone(), EventFormat::Packed);
        if count.is_some() {
            let error = rig.check_ids(0, packet.len(), count).unwrap_err().to_string();
            assert!(message.starts_with(&error), "{error}");
        }
        rig.check_ids(0, packet.len(), None).unwrap();
        rig.check_ids(0, packet.len(), Some(packet.len())).unwrap();
        for end_ns in [1, 2] {
            let mut tick = rig.tick(INTERVAL_NS * end_ns);
            match count {
                Some(count) => tick.events_with_ids(0, &packet.view(), &vec![7; count]),
                None => tick.events(0, &packet.view()),
            };
            tick.send();
        }
        let notices = rig.notices();
        assert!(notices.len() == 1 && notices[0].starts_with(message), "{notices:?}");
        let (summary, _, recording) = rig.finish();
        recording.unwrap();
        assert_eq!([failed(&summary, "/event_ids"), failed(&summary, "/events")], [2, 0]);
        let topics = recorded(&path).into_iter().map(|(topic, _)| topic);
        assert_eq!(topics.filter(|topic| topic.starts_with("event")).collect::<Vec<_>>(), ["events"; 2]);
    }
}

#[test]
fn a_packet_that_is_refused_has_no_ids_either() {
    let plan = camera(Split::default());
    let (_folder, path, mut rig) = recording(plan.clone(), EventFormat::Mono);
    let packet = world::packet(&plan, -INTERVAL_NS, 0, 10, 0);
    let mut tick = rig.tick(0);
    tick.events_with_ids(0, &packet.view(), &world::ids(&packet));
    tick.send();
    let (summary, _, recording) = rig.finish();
    recording.unwrap();
    assert_eq!([failed(&summary, "/event_ids"), failed(&summary, "/events")], [1, 1]);
    assert!(recorded(&path).iter().all(|(topic, _)| !topic.starts_with("event")));
}

#[test]
fn a_camera_without_ids_has_no_topics_for_them() {
    let plan = CameraPlan { event_ids: false, ..camera(Split::default()) };
    let packet = world::packet(&plan, 0, INTERVAL_NS, 10, 0);
    let (_folder, path, mut rig) = recording(plan, EventFormat::Packed);
    let expected = "camera `left` has ids or instances, expected none: it was announced without event_ids";
    assert_eq!(rig.check_ids(0, 10, Some(10)).unwrap_err().to_string(), expected);
    assert_eq!(rig.set_instances(0, vec![]).unwrap_err().to_string(), expected);
    rig.check_ids(0, 10, None).unwrap();
    assert!(rig.check_ids(1, 10, None).is_err() && rig.set_instances(1, vec![]).is_err(), "no such camera");
    let mut tick = rig.tick(INTERVAL_NS);
    tick.events_with_ids(0, &packet.view(), &world::ids(&packet));
    tick.send();
    let notices = rig.notices();
    assert!(notices.len() == 1 && notices[0].starts_with(expected), "{notices:?}");
    rig.finish().2.unwrap();
    let topics: Vec<String> = recorded(&path).into_iter().map(|(topic, _)| topic).collect();
    assert!(topics.contains(&"events".to_owned()) && !topics.contains(&"event_ids".to_owned()), "{topics:?}");
}

#[test]
fn instances_are_sent_when_they_change() {
    let instance = |id: i64| Instance { id, name: format!("/body_{id}"), ..Instance::default() };
    let plan = camera(Split::default());
    let (_folder, path, mut rig) = recording(plan, EventFormat::Packed);
    let instances = rig.plan().topics.iter().find(|topic| topic.name.ends_with("/instances")).unwrap();
    assert_eq!(instances.qos, esaac_ros::Qos::latched());
    let tables: [&[i64]; 5] = [&[], &[8, 7], &[7, 8], &[7, 8, 9], &[]];
    for (tick, table) in (0..).zip(tables) {
        rig.set_instances(0, table.iter().map(|&id| instance(id)).collect()).unwrap();
        rig.tick(tick * INTERVAL_NS).send();
    }
    rig.tick(5 * INTERVAL_NS).send();
    rig.finish().2.unwrap();
    // Little-endian numbers of seconds and nanoseconds, and how many instances there are.
    let sent: Vec<(u32, u32)> = recorded(&path)
        .iter()
        .filter(|(topic, _)| topic == "instances")
        .map(|(_, bytes)| {
            let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
            (number(8), number(HEADER_BYTES))
        })
        .collect();
    let at = |tick: i64| (tick * INTERVAL_NS) as u32;
    assert_eq!(sent, [(at(1), 2), (at(3), 3), (at(4), 0)], "an empty table is what there was");
}
