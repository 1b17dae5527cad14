//! Peers of both versions understand each other. What a peer of version 1 sends is written down here byte by byte.

use crate::faults::{engine, engine_with, sensor, sequence};
use esaac_engine::RigOptions;
use esaac_interop::wire::{
    Header, ImageMemory, MEMORY_HOST, Message, Refusal, Released, RingOffer, TIMELINE_CARRIED, Version,
};
use esaac_interop::{Copies, Gives, Planes, Producer, ProducerOptions, ServerOptions, wire};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_tests::device::{assert_device_silent, assert_silent};
use esaac_tests::interop::{Place, Uploader, other_device, service, until};
use esaac_tests::peer::{Peer, listen};
use esaac_tests::run::engine_with as alone;
use rustix::fd::{AsFd, OwnedFd};
use rustix::fs::{MemfdFlags, ftruncate, memfd_create};
use std::time::Duration;

const SECOND: Duration = Duration::from_secs(1);

/// A message from 32-bit words. The first four are its header.
fn message(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_ne_bytes()).collect()
}

const MAGIC: u32 = 0x5049_5345;

/// HELLO of version 1: for camera 0, of any size, with memory of the host and carried timelines. Version 1 does not say
/// what is in its last word.
fn hello() -> Vec<u8> {
    let uuids = [7; 8];
    let head = [MAGIC, 1 << 16 | 1, 72, 0];
    message(&[&head[..], &uuids, &[0, 0, 0, 2, 1, 0xdead_beef]].concat())
}

/// FRAME of version 1, at 5 ns in slot 1.
fn frame() -> Vec<u8> {
    message(&[MAGIC, 5 << 16 | 1, 48, 0, 1, 0, 0, 0xdead_beef, 1, 0, 5, 0])
}

fn bye() -> Vec<u8> {
    message(&[MAGIC, 7 << 16 | 1, 16, 0])
}

#[test]
fn a_producer_of_version_1_is_served_in_version_1() {
    let (sensor, sequence) = (sensor(), sequence());
    let place = Place::default();
    let mut service = service(&place.path(), &[(sensor, &sequence)], false, ServerOptions::default());
    let peer = Peer::connect(&place.path());
    peer.send_bytes(&hello(), &[]);
    let (ring, fds) = peer.receive_bytes().expect("RING");
    assert_eq!((ring.len(), fds.len()), (144, 6), "colour and motion of three slots");
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(&ring);
    assert_eq!(words[..4], [MAGIC, 2 << 16 | 1, 144, 6]);
    // Camera, cameras, size, formats, memory, timeline, slots, no drops.
    assert_eq!(words[12..22], [0, 1, 12, 9, 0, 0, 2, 1, 3, 0]);
    // Bytes of colour and of motion.
    assert_eq!((words[24], words[25], words[30]), (864, 0, 432));
    peer.send_bytes(&frame(), &[]);
    let tick = service.tick(10 * SECOND).unwrap().expect("its frame");
    assert_eq!(tick.t_ns[0], Some(5));
    let (released, _) = peer.receive_bytes().expect("RELEASED");
    assert_eq!(released, message(&[MAGIC, 6 << 16 | 1, 32, 0, 1, 0, 2, 0]));
    peer.send_bytes(&bye(), &[]);
    until("its goodbye", || service.counts()[0].finished == 1);
    assert_eq!(service.server().agreements()[0].unwrap().version, Version::One);
    drop(service);
    assert_silent();
}

#[test]
fn a_producer_of_version_1_is_told_of_its_faults_in_version_1() {
    let place = Place::default();
    let server = engine(&place);
    let refused = |bytes: &[Vec<u8>], words: &str| {
        let peer = Peer::connect(&place.path()).speaking(Version::One);
        bytes.iter().for_each(|bytes| peer.send_bytes(bytes, &[]));
        let mut last = Vec::new();
        while let Some((bytes, _)) = peer.receive_bytes() {
            last = bytes;
        }
        assert_eq!(last.len(), 280);
        match Message::parse(Version::One, &last, 0) {
            Ok(Message::Refusal(refusal)) => assert!(refusal.words().contains(words), "{}", refusal.words()),
            other => panic!("{other:?}"),
        }
        until("its end", || server.connected() == 0);
    };
    let mut camera = hello();
    camera[48] = 9;
    refused(&[camera], "camera 9, the rig has 1");
    refused(&[hello(), hello()], "HELLO came between frames");
    // Version 2 has no place in a connection of version 1.
    let poses = Message::Poses(Vec::new()).to_bytes(Version::One, 0);
    refused(&[hello(), poses], "message kind 9, expected 1 to 8");
    let second = Message::Bye(Header::default()).to_bytes(Version::Two, 0);
    refused(&[hello(), second], "protocol version 2, expected 1");
    let mut third = hello();
    third[4] = 3;
    refused(&[third], "protocol version 3, expected 1 or 2");
    drop(server);
    assert_silent();
}

#[test]
fn a_producer_of_version_2_is_served_in_version_2() {
    let place = Place::default();
    let server = engine_with(&place, ServerOptions { memories: MEMORY_HOST, ..ServerOptions::default() });
    let device = other_device();
    let producer = Producer::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
    assert_eq!(producer.client().version(), Version::Two);
    // The camera takes no depth.
    assert_eq!(producer.client().images().geometry, None);
    // The producer has its ring a moment before the server notes it.
    until("its ring", || server.connected() == 1);
    assert_eq!(
        server.agreements()[0].map(|agreed| (agreed.version, agreed.geometry)),
        Some((Version::Two, false))
    );
    let peer = Peer::connect(&place.path());
    peer.send_bytes(&message(&[MAGIC, 9 << 16 | 2, 24, 0, 0, 0]), &[]);
    assert!(peer.refusal().words().contains("POSES came first, expected HELLO"));
    drop((producer, server));
    assert_device_silent(&device);
    assert_silent();
}

/// An engine that knows version 1 alone: it refuses the first greeting, and serves the second by fixed bytes.
fn old_engine(listener: &OwnedFd) -> Vec<Vec<u8>> {
    let refused = Peer::accept(listener);
    let (greeting, _) = refused.receive_bytes().expect("a greeting");
    assert_eq!(greeting[4..6], 2_u16.to_ne_bytes());
    let refusal = Refusal::new(wire::ErrorCode::Version, "protocol version 2, expected 1");
    refused.send_bytes(&Message::Refusal(refusal).to_bytes(Version::One, 0), &[]);
    drop(refused);

    let peer = Peer::accept(listener).speaking(Version::One);
    let mut heard = vec![peer.receive_bytes().expect("a greeting").0];
    let file = || {
        let fd = memfd_create(c"slot", MemfdFlags::ALLOW_SEALING | MemfdFlags::CLOEXEC).unwrap();
        ftruncate(&fd, 4096).unwrap();
        fd
    };
    let memory = ImageMemory { bytes: 864, allocation_bytes: 4096, ..ImageMemory::default() };
    let offer = RingOffer {
        cameras: 1,
        width_px: 12,
        height_px: 9,
        motion_format: wire::NO_MOTION,
        memory: MEMORY_HOST,
        timeline: TIMELINE_CARRIED,
        slots: 1,
        hdr: memory,
        // What version 1 does not know is not sent.
        depth_format: 1,
        max_instances: 5,
        ..RingOffer::default()
    };
    let fd = file();
    peer.send(Message::Ring(offer), &[fd.as_fd()]);
    heard.push(peer.receive_bytes().expect("a frame").0);
    peer.send(Message::Released(Released { value: 2, ..Released::default() }), &[]);
    heard.push(peer.receive_bytes().expect("a goodbye").0);
    heard
}

#[test]
fn an_engine_of_version_1_is_served_in_version_1() {
    let place = Place::default();
    let listener = listen(&place.path());
    let device = other_device();
    let heard = std::thread::scope(|scope| {
        let old = scope.spawn(|| old_engine(&listener));
        let options = ProducerOptions {
            memories: MEMORY_HOST,
            geometry: Gives::Geometry,
            timeout: 10 * SECOND,
            ..ProducerOptions::default()
        };
        let mut uploader = Uploader::connect(&device, &place.path(), &options).unwrap();
        assert_eq!(uploader.producer.client().version(), Version::One);
        assert_eq!(uploader.producer.client().images().geometry, None);
        // Its poses are not sent: nobody takes them.
        let lens = Intrinsics::pinhole(1.0, 1.0, 0.0, 0.0).unwrap();
        let still = SceneMotion::new(lens, PoseTrack::still(Pose::IDENTITY));
        let images = Planes { hdr: &[1; 864][..], motion: None, depth: Some(&[2; 432][..]), ids: None };
        uploader.send_scene(images, 5, &still).unwrap();
        assert_eq!(uploader.producer.finish().unwrap(), (1, 0));
        old.join().unwrap()
    });
    let [hello, frame, bye] = heard.try_into().unwrap();
    assert_eq!((hello.len(), &hello[4..6]), (72, &1_u16.to_ne_bytes()[..]));
    assert_eq!(hello[68..], [0; 4], "what version 1 reserves");
    let copies = Copies { device: 1, host: 1 };
    assert_eq!(frame, message(&[MAGIC, 5 << 16 | 1, 48, 0, 0, copies.device, copies.host, 0, 1, 0, 5, 0]));
    assert_eq!(bye, self::bye());
    assert_device_silent(&device);
}

/// The Rust producer, which speaks version 2, sends frames of colour and motion as before.
#[test]
fn frames_without_poses_give_the_same_events_in_either_version() {
    let (sensor, sequence) = (sensor(), sequence());
    let expected = alone(&sensor, &sequence, RigOptions::default());
    let place = Place::default();
    let mut service = service(&place.path(), &[(sensor, &sequence)], false, ServerOptions::default());
    let device = other_device();
    let options = ProducerOptions { geometry: Gives::Geometry, ..ProducerOptions::default() };
    let mut uploader = Uploader::connect(&device, &place.path(), &options).unwrap();
    for (frame, expected) in sequence.frames.iter().zip(&expected) {
        uploader.send(frame, frame.t_ns).unwrap();
        let tick = service.tick(30 * SECOND).unwrap().expect("a frame");
        assert!(tick.tick.packets[0] == expected.packet, "other events at {} ns", frame.t_ns);
    }
    drop((uploader, service));
    assert_device_silent(&device);
    assert_silent();
}
