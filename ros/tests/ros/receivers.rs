//! Every message type by the embedded transport.

use crate::{exchange, world};
use esaac_ros::{CameraPlan, EventFormat, RigOptions, Sinks, Split, Transport};

fn everyone_reads(format: EventFormat) {
    exchange::everyone_reads_the_same(format, |domain| {
        let transport = world::transport(domain);
        assert_eq!(transport.copies(), 0);
        Box::new(transport)
    });
}

#[test]
fn packed_packets_and_all_else_are_read_bit_for_bit_by_independent_subscribers() {
    everyone_reads(EventFormat::Packed);
}

#[test]
fn plain_packets_are_read_bit_for_bit() {
    everyone_reads(EventFormat::Plain);
}

#[test]
fn evt3_packets_are_read_bit_for_bit() {
    everyone_reads(EventFormat::Evt3);
}

#[test]
fn mono_packets_are_read_bit_for_bit() {
    everyone_reads(EventFormat::Mono);
}

#[test]
fn a_packet_in_slices_of_a_960th_second_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let split = Split { slice_ns: 1_041_667, max_bytes: 0 };
    let cameras = vec![CameraPlan { split, ..world::camera("left", 32, 24) }];
    let options = RigOptions { policy: esaac_ros::Policy::Lossless, ..RigOptions::default() };
    let rig = world::rig(&cameras, &options, Sinks { transport: None, bag: Some(world::bag(&path)) });
    let sent = exchange::run(rig, &cameras);
    let answer = world::check_bag(&path);
    let events = &answer["/esaac/left/events"];
    assert_eq!(events["recorded"], exchange::TICKS * 32);
    assert_eq!(events["last"]["sequence"], exchange::TICKS * 32 - 1);
    assert_eq!(events["last"]["watermark_ns"], sent[exchange::TICKS as usize - 1].watermark_ns);
}
