//! To every wrong message of a peer, the engine answers with the reason, closes the connection and goes on.

use crate::connections::one_frame_goes_through;
use esaac_interop::wire::{
    Brought, ErrorCode, FrameNotice, Header, Hello, ImageMemory, MEMORY_EXPORTED, MEMORY_HOST, MEMORY_IMAGES,
    Message, Refusal, RingOffer, Version,
};
use esaac_interop::{Copies, Outcome, Producer, ProducerOptions, Server, ServerOptions, Support};
use esaac_model::{HdrFormat, MotionFormat, SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{Sequence, scene, times};
use esaac_tests::interop::{Checksum, Place, other_device, server, trusting, until};
use esaac_tests::peer::{Peer, bringing, greeting};
use esaac_tests::run::camera;
use rustix::fd::{AsFd, OwnedFd};
use rustix::fs::{MemfdFlags, ftruncate, memfd_create};
use std::time::{Duration, Instant};

const SECOND: Duration = Duration::from_secs(1);

pub fn sensor() -> SensorModel {
    SensorModel { width: 12, height: 9, synthesis: Synthesis::None, ..SensorModel::default() }
}

pub fn sequence() -> Sequence {
    scene(esaac_scene::SceneKind::Edge, (12, 9), &times(0, 4), HdrFormat::F16x4, MotionFormat::F16x2)
}

/// An engine of one camera that allows every means of sharing memory.
pub fn engine(place: &Place) -> Server {
    engine_with(place, trusting())
}

pub fn engine_with(place: &Place, options: ServerOptions) -> Server {
    server(&place.path(), &camera(&sensor(), 0, &sequence()), options).unwrap()
}

/// A peer that has got its ring.
pub fn linked(place: &Place) -> (Peer, RingOffer) {
    let peer = Peer::connect(&place.path());
    peer.send(Message::Hello(greeting()), &[]);
    match peer.receive() {
        Some((Message::Ring(offer), fds)) => {
            assert_eq!(fds.len(), 6, "colour and motion of three slots");
            (peer, offer)
        }
        other => panic!("expected RING, got {other:?}"),
    }
}

pub fn frame(slot: u32, value: u64, t_ns: i64) -> FrameNotice {
    FrameNotice { slot, value, t_ns, ..FrameNotice::default() }
}

/// Runs `act` and asserts that it is refused with this code and these words, and that the engine still serves.
#[track_caller]
fn refused(act: impl FnOnce(&Place) -> Refusal, code: ErrorCode, words: &[&str]) {
    refused_by(trusting(), act, code, words);
}

/// As [`refused`], for an engine with these options.
#[track_caller]
pub fn refused_by(
    options: ServerOptions,
    act: impl FnOnce(&Place) -> Refusal,
    code: ErrorCode,
    words: &[&str],
) {
    let place = Place::default();
    let server = engine_with(&place, options);
    let refusal = act(&place);
    assert_eq!(ErrorCode::from_number(refusal.code), code, "{}", refusal.words());
    for word in words {
        assert!(refusal.words().contains(word), "no `{word}` in: {}", refusal.words());
    }
    let notices = server.notices().join("\n");
    assert!(words.iter().all(|word| notices.contains(word)), "the engine's own log: {notices}");
    one_frame_goes_through(&server, &place);
    drop(server);
    assert_silent();
}

/// A peer that sends these bytes first.
fn first_bytes(bytes: Vec<u8>) -> impl FnOnce(&Place) -> Refusal {
    move |place| {
        let peer = Peer::connect(&place.path());
        peer.send_bytes(&bytes, &[]);
        peer.refusal()
    }
}

fn first(hello: Hello) -> impl FnOnce(&Place) -> Refusal {
    first_bytes(Message::Hello(hello).to_bytes(Version::Two, 0))
}

/// A linked peer that sends these messages.
fn then(messages: Vec<Message>) -> impl FnOnce(&Place) -> Refusal {
    move |place| {
        let (peer, _) = linked(place);
        for message in messages {
            peer.send(message, &[]);
        }
        peer.refusal()
    }
}

#[test]
fn wrong_version() {
    let mut bytes = Message::Hello(greeting()).to_bytes(Version::Two, 0);
    bytes[4] = 9;
    refused(first_bytes(bytes), ErrorCode::Version, &["version 9", "expected 1 or 2"]);
}

#[test]
fn another_protocol_and_truncated_messages() {
    refused(first_bytes(Vec::new()), ErrorCode::Protocol, &["header of 0 bytes"]);
    let empty_between_frames = |place: &Place| {
        let (peer, _) = linked(place);
        peer.send_bytes(&[], &[]);
        peer.refusal()
    };
    refused(empty_between_frames, ErrorCode::Protocol, &["header of 0 bytes"]);
    refused(first_bytes(b"GET / HTTP/1.1\r\n".to_vec()), ErrorCode::Protocol, &["0x20544547"]);
    refused(first_bytes(vec![1, 2, 3]), ErrorCode::Protocol, &["header of 3 bytes", "expected 16"]);
    let hello = Message::Hello(greeting()).to_bytes(Version::Two, 0);
    refused(first_bytes(hello[..40].to_vec()), ErrorCode::Protocol, &["HELLO of 40 bytes", "expected 112"]);
    let long = [hello, vec![0; 4000]].concat();
    refused(first_bytes(long), ErrorCode::Protocol, &["HELLO of 4112 bytes", "expected 112"]);
    let mut unknown = Message::Bye(Header::default()).to_bytes(Version::Two, 0);
    unknown[6] = 77;
    refused(first_bytes(unknown), ErrorCode::Protocol, &["kind 77"]);
}

#[test]
fn wrong_device() {
    let mut hello = greeting();
    hello.device_uuid[0] ^= 0x5a;
    refused(first(hello), ErrorCode::Device, &["start both on one device"]);
    let mut hello = greeting();
    hello.driver_uuid[3] ^= 1;
    refused(first(hello), ErrorCode::Device, &["driver"]);
}

#[test]
fn nothing_in_common() {
    refused(first(Hello { memories: 0, ..greeting() }), ErrorCode::Unsupported, &["memories"]);
    refused(first(Hello { timelines: 0, ..greeting() }), ErrorCode::Unsupported, &["timelines"]);
}

#[test]
fn cameras_and_sizes_that_the_rig_has_not() {
    refused(first(Hello { camera: 7, ..greeting() }), ErrorCode::Camera, &["camera 7", "the rig has 1"]);
    let hello = Hello { width_px: 4_000_000_000, height_px: 1, ..greeting() };
    refused(first(hello), ErrorCode::Camera, &["12x9", "4000000000x1"]);
}

#[test]
fn a_second_producer_for_a_camera() {
    let act = |place: &Place| {
        let (_first, _) = linked(place);
        first(greeting())(place)
    };
    refused(act, ErrorCode::Taken, &["camera 0 has a producer already"]);
}

#[test]
fn messages_out_of_turn() {
    refused(
        first_bytes(Message::Frame(frame(0, 1, 0)).to_bytes(Version::Two, 0)),
        ErrorCode::Protocol,
        &["FRAME came first"],
    );
    refused(then(vec![Message::Hello(greeting())]), ErrorCode::Protocol, &["HELLO came between frames"]);
    refused(then(vec![Message::Brought(Brought::default())]), ErrorCode::Protocol, &["BROUGHT"]);
    let act = |place: &Place| {
        let peer = Peer::connect(&place.path());
        peer.send(Message::Hello(bringing()), &[]);
        assert!(matches!(peer.receive(), Some((Message::Ring(_), _))));
        peer.send(Message::Frame(frame(0, 1, 0)), &[]);
        peer.refusal()
    };
    refused(act, ErrorCode::Protocol, &["FRAME came while BROUGHT was awaited"]);
}

#[test]
fn timeline_values_out_of_turn() {
    for value in [0, 2, 3, u64::MAX] {
        let words = [&*format!("timeline value {value}"), "expected 1"];
        refused(then(vec![Message::Frame(frame(0, value, 0))]), ErrorCode::Value, &words);
    }
    let twice = vec![Message::Frame(frame(1, 1, 0)), Message::Frame(frame(1, 3, 1))];
    refused(then(twice), ErrorCode::Protocol, &["slot 1 holds a frame"]);
}

#[test]
fn slots_and_times_that_cannot_be() {
    refused(then(vec![Message::Frame(frame(3, 1, 0))]), ErrorCode::Protocol, &["slot 3", "less than 3"]);
    refused(then(vec![Message::Frame(frame(u32::MAX, 1, 0))]), ErrorCode::Protocol, &["slot 4294967295"]);
    for t_ns in [i64::MIN, i64::MAX] {
        refused(then(vec![Message::Frame(frame(0, 1, t_ns))]), ErrorCode::Time, &[&*t_ns.to_string()]);
    }
    let back = vec![Message::Frame(frame(0, 1, 500)), Message::Frame(frame(1, 1, 500))];
    refused(then(back), ErrorCode::Time, &["500 ns is not after"]);
    let gap = vec![Message::Frame(frame(0, 1, 0)), Message::Frame(frame(1, 1, 5_000_000_000))];
    refused(then(gap), ErrorCode::Time, &["gap of 5000000000 ns", "connect again"]);
}

#[test]
fn descriptors_that_nobody_asked_for() {
    let act = |place: &Place| {
        let (peer, _) = linked(place);
        let file = std::fs::File::open("/dev/null").unwrap();
        peer.send(Message::Frame(frame(0, 1, 0)), &[file.as_fd()]);
        peer.refusal()
    };
    refused(act, ErrorCode::Protocol, &["FRAME with 1 descriptors, expected 0"]);
    let act = |place: &Place| {
        let peer = Peer::connect(&place.path());
        let file = std::fs::File::open("/dev/null").unwrap();
        peer.send(Message::Hello(greeting()), &[file.as_fd(); 96]);
        peer.refusal()
    };
    refused(act, ErrorCode::Protocol, &["descriptors"]);
}

/// A peer that brings these descriptors and describes them by `hdr`.
fn brings(hdr: ImageMemory, make: impl FnOnce() -> Vec<OwnedFd>) -> impl FnOnce(&Place) -> Refusal {
    brings_as(bringing(), hdr, make)
}

fn brings_as(
    hello: Hello,
    hdr: ImageMemory,
    make: impl FnOnce() -> Vec<OwnedFd>,
) -> impl FnOnce(&Place) -> Refusal {
    move |place| {
        let peer = Peer::connect(&place.path());
        peer.send(Message::Hello(hello), &[]);
        let Some((Message::Ring(_), _)) = peer.receive() else { panic!("no ring") };
        let motion = ImageMemory { bytes: 12 * 9 * 4, allocation_bytes: 4096, ..ImageMemory::default() };
        let fds = make();
        let borrowed: Vec<_> = fds.iter().map(AsFd::as_fd).collect();
        peer.send(Message::Brought(Brought { hdr, motion, ..Brought::default() }), &borrowed);
        peer.refusal()
    }
}

const HDR: ImageMemory =
    ImageMemory { bytes: 12 * 9 * 8, allocation_bytes: 4096, memory_type: 0, image_usage: 0 };

fn memory_files(bytes: u64, flags: MemfdFlags) -> Vec<OwnedFd> {
    let file = || {
        let fd = memfd_create(c"junk", flags | MemfdFlags::CLOEXEC).unwrap();
        ftruncate(&fd, bytes).unwrap();
        fd
    };
    (0..6).map(|_| file()).collect()
}

#[test]
fn descriptors_that_are_no_memory() {
    let files = || (0..6).map(|_| std::fs::File::open("/dev/null").unwrap().into()).collect();
    refused(brings(HDR, files), ErrorCode::Memory, &["camera 0 slot 0 hdr"]);
    let junk = || memory_files(8192, MemfdFlags::ALLOW_SEALING);
    refused(brings(HDR, junk), ErrorCode::Memory, &["camera 0 slot 0 hdr"]);
    let few = || memory_files(8192, MemfdFlags::ALLOW_SEALING).into_iter().take(2).collect();
    refused(brings(HDR, few), ErrorCode::Protocol, &["BROUGHT with 2 descriptors, expected 6"]);
    if DEVICE.is_software() {
        let unsealed = || memory_files(8192, MemfdFlags::empty());
        refused(brings(HDR, unsealed), ErrorCode::Memory, &["can shrink"]);
    }
}

#[test]
fn sizes_that_lie() {
    let junk = || memory_files(8192, MemfdFlags::ALLOW_SEALING);
    for (bytes, allocation_bytes) in [(864, 10), (860, 4096), (1 << 40, 1 << 40), (864, u64::MAX), (0, 0)] {
        let hdr = ImageMemory { bytes, allocation_bytes, ..HDR };
        refused(brings(hdr, junk), ErrorCode::Memory, &["hdr", &bytes.to_string()]);
    }
    let short = || memory_files(100, MemfdFlags::ALLOW_SEALING);
    refused(brings(HDR, short), ErrorCode::Memory, &["100 bytes, expected 4096"]);
    let other_type = ImageMemory { memory_type: 31, ..HDR };
    refused(brings(other_type, junk), ErrorCode::Unsupported, &["memory type 31"]);
    let absurd_type = ImageMemory { memory_type: u32::MAX - 1, ..HDR };
    refused(brings(absurd_type, junk), ErrorCode::Unsupported, &["memory type 4294967294"]);
}

#[test]
fn images_that_are_none() {
    let images = |hdr, make: fn() -> Vec<OwnedFd>| {
        brings_as(Hello { memories: MEMORY_IMAGES, ..greeting() }, hdr, make)
    };
    let junk = || memory_files(1 << 16, MemfdFlags::ALLOW_SEALING);
    // The size must be exactly the driver's own size of the image.
    let short = ImageMemory { allocation_bytes: 866, ..HDR };
    refused(images(short, junk), ErrorCode::Memory, &["camera 0 slot 0 hdr", "866"]);
    for bytes in [0, 860, 1 << 40] {
        refused(images(ImageMemory { bytes, ..HDR }, junk), ErrorCode::Memory, &["hdr", &bytes.to_string()]);
    }
    let nothing = || (0..6).map(|_| std::fs::File::open("/dev/null").unwrap().into()).collect();
    refused(images(HDR, nothing), ErrorCode::Memory, &["camera 0 slot 0 hdr"]);
    let few = || memory_files(1 << 16, MemfdFlags::ALLOW_SEALING).into_iter().take(5).collect();
    refused(images(HDR, few), ErrorCode::Protocol, &["BROUGHT with 5 descriptors, expected 6"]);
}

/// On a device that shares timelines the engine waits for the frame's timeline value. Without shared timelines, a
/// producer waits itself until a frame is written before it announces it, and it is that wait that times out.
#[test]
fn a_frame_that_is_told_of_and_never_written_ends_its_connection() {
    let place = Place::default();
    let limit = Duration::from_secs(2);
    let options = ServerOptions { frame_timeout: limit, ..ServerOptions::default() };
    let server = server(&place.path(), &camera(&sensor(), 0, &sequence()), options).unwrap();
    let options = ProducerOptions { timeout: limit, ..ProducerOptions::default() };
    let mut producer = Producer::connect(&other_device(), &place.path(), &options).unwrap();
    let slot = producer.slot().unwrap();
    let started = Instant::now();
    let told = producer.publish(slot, 0, Copies::default());
    if Support::of(&DEVICE).share_timeline {
        told.unwrap();
        assert!(server.wait(SECOND).unwrap().is_empty() || server.counts()[0].lost == 1);
        until("its end", || server.counts()[0].lost == 1);
        assert!(server.notices().join("\n").contains("a frame that was told of did not come within 2s"));
    } else {
        let error = told.unwrap_err().to_string();
        assert!(error.contains("the device's work on a slot did not come within 2s"), "{error}");
        drop(producer);
        until("its end", || server.counts()[0].lost == 1);
    }
    assert!(started.elapsed() < 10 * SECOND, "{:?}", started.elapsed());
    one_frame_goes_through(&server, &place);
}

#[test]
fn memory_that_a_peer_would_pull_away() {
    for memories in [MEMORY_EXPORTED, MEMORY_HOST] {
        let place = Place::default();
        let server = engine(&place);
        let peer = Peer::connect(&place.path());
        peer.send(Message::Hello(Hello { memories, ..greeting() }), &[]);
        let Some((Message::Ring(offer), fds)) = peer.receive() else { panic!("no ring") };
        assert_eq!(offer.memory, memories);
        for fd in &fds {
            // On a GPU the descriptor is no file. Where it is one, no peer can truncate it while the engine uses it.
            assert!(ftruncate(fd, 0).is_err(), "memory {memories} shrinks");
        }
        peer.send(Message::Frame(frame(0, 1, 0)), &[]);
        let ready = server.wait(10 * SECOND).unwrap();
        let bytes = (12 * 9 * 8) as usize;
        // The device can read all of the memory without failing.
        let sum = Checksum::default().of(ready[0].slot().inputs().hdr, bytes);
        assert_ne!(sum, [0; 2]);
    }
    assert_silent();
}

#[test]
fn a_peer_s_own_refusal_is_reported() {
    let place = Place::default();
    let server = engine(&place);
    let (peer, _) = linked(&place);
    peer.send(Message::Refusal(Refusal::new(ErrorCode::Memory, "no room here")), &[]);
    assert_eq!(ErrorCode::from_number(peer.refusal().code), ErrorCode::Memory);
    assert!(server.notices().join("\n").contains("the producer says: no room here"));
}

#[test]
fn a_peer_that_reads_nothing_is_closed_when_its_queue_is_full() {
    let place = Place::default();
    let server = engine(&place);
    let (peer, _) = linked(&place);
    for index in 0_i64..100_000 {
        let (slot, value) = ((index % 3) as u32, (index / 3) as u64 * 2 + 1);
        peer.send(Message::Frame(frame(slot, value, index)), &[]);
        let ready = server.wait(10 * SECOND).unwrap();
        if ready.is_empty() {
            break;
        }
        server.release(&ready[0], Outcome::Stepped);
        if server.counts()[0].lost == 1 {
            break;
        }
    }
    assert_eq!((server.counts()[0].lost, server.connected()), (1, 0));
    assert!(server.notices().join("\n").contains("the peer reads no messages"));
    drop(peer);
    one_frame_goes_through(&server, &place);
}
