//! From the connection to the first frame: one producer per camera, and none that holds a camera without sending
//! frames.

use crate::connections::one_frame_goes_through;
use crate::faults::{engine, engine_with, frame, linked, refused_by};
use esaac_interop::ServerOptions;
use esaac_interop::wire::{ErrorCode, Header, Message};
use esaac_tests::device::assert_silent;
use esaac_tests::interop::{Place, trusting, until};
use esaac_tests::peer::{Peer, bringing, greeting};
use std::time::{Duration, Instant};

const SECOND: Duration = Duration::from_secs(1);

/// Time limit for each message: long enough for a working producer on a GPU that other tests use too, short enough to wait
/// for in a test.
const HANDSHAKE: Duration = Duration::from_secs(2);

fn impatient() -> ServerOptions {
    ServerOptions { handshake_timeout: HANDSHAKE, first_frame_timeout: HANDSHAKE, ..trusting() }
}

/// Two producers that bring their memory greet at the same time. The one whose greeting arrives first gets the camera,
/// regardless of the order in which they connected.
#[test]
fn two_producers_never_hold_one_camera() {
    for later_greets_first in [true, false] {
        let place = Place::default();
        let server = engine(&place);
        let mut peers = [Peer::connect(&place.path()), Peer::connect(&place.path())];
        if later_greets_first {
            peers.reverse();
        }
        let [first, second] = peers;
        first.send(Message::Hello(bringing()), &[]);
        assert!(matches!(first.receive(), Some((Message::Ring(_), _))));
        second.send(Message::Hello(bringing()), &[]);
        let refusal = second.refusal();
        assert_eq!(ErrorCode::from_number(refusal.code), ErrorCode::Taken, "{}", refusal.words());
        let holder = format!("camera 0 has a producer already: process {} by connection", std::process::id());
        assert!(refusal.words().contains(&holder), "{}", refusal.words());
        // When a producer leaves after its greeting, the camera is free again.
        first.send(Message::Bye(Header::default()), &[]);
        assert!(first.receive().is_none());
        one_frame_goes_through(&server, &place);
        assert_eq!(server.counts()[0].connections, 1);
    }
    assert_silent();
}

#[test]
fn a_producer_that_comes_between_another_s_greeting_and_its_memory_is_turned_away() {
    let place = Place::default();
    let server = engine(&place);
    let first = Peer::connect(&place.path());
    first.send(Message::Hello(bringing()), &[]);
    assert!(matches!(first.receive(), Some((Message::Ring(_), _))));
    // A producer that uses the engine's memory sends no BROUGHT, and so could get its ring at once.
    let second = Peer::connect(&place.path());
    second.send(Message::Hello(greeting()), &[]);
    assert_eq!(ErrorCode::from_number(second.refusal().code), ErrorCode::Taken);
    drop(first);
    until("the camera to be free", || {
        let third = Peer::connect(&place.path());
        third.send(Message::Hello(greeting()), &[]);
        matches!(third.receive(), Some((Message::Ring(_), _)))
    });
    drop(server);
    assert_silent();
}

/// A tick waits for the frames of those that are connected. A producer that may send is one of them from then on, not
/// some time later.
#[test]
fn a_producer_that_has_its_ring_is_connected() {
    let place = Place::default();
    let server = engine(&place);
    for round in 0..500 {
        let peer = Peer::connect(&place.path());
        peer.send(Message::Hello(greeting()), &[]);
        assert!(matches!(peer.receive(), Some((Message::Ring(_), _))));
        assert_eq!(server.connected(), 1, "round {round}");
        peer.send(Message::Bye(Header::default()), &[]);
        until("the goodbye", || server.connected() == 0);
    }
    assert_silent();
}

/// Runs `act`, whose peer stops sending at some point, and expects a refusal within the time limit.
fn ends_in_time(act: impl FnOnce(&Place) -> Peer, missing: &str) {
    let timed = |place: &Place| {
        let started = Instant::now();
        let refusal = act(place).refusal();
        let waited = started.elapsed();
        assert!(waited >= HANDSHAKE * 9 / 10 && waited < 10 * SECOND, "{waited:?}");
        refusal
    };
    refused_by(impatient(), timed, ErrorCode::Timeout, &[missing, "did not come within 2s"]);
}

#[test]
fn a_peer_that_does_not_greet_is_not_waited_for() {
    ends_in_time(|place| Peer::connect(&place.path()), "the producer's HELLO");
}

#[test]
fn a_producer_that_does_not_bring_its_memory_is_not_waited_for() {
    let act = |place: &Place| {
        let peer = Peer::connect(&place.path());
        peer.send(Message::Hello(bringing()), &[]);
        assert!(matches!(peer.receive(), Some((Message::Ring(_), _))));
        peer
    };
    ends_in_time(act, "the producer's memory, BROUGHT,");
}

#[test]
fn a_producer_that_sends_no_frame_is_not_waited_for() {
    ends_in_time(|place| linked(place).0, "the producer's first FRAME");
}

/// A handshake must also time out while the stepping thread waits for frames.
#[test]
fn a_handshake_ends_in_time_while_the_engine_waits_for_frames() {
    let place = Place::default();
    let server = engine_with(&place, impatient());
    std::thread::scope(|scope| {
        let waits = scope.spawn(|| server.wait(2 * HANDSHAKE).unwrap().len());
        let (peer, _) = linked(&place);
        let started = Instant::now();
        assert_eq!(ErrorCode::from_number(peer.refusal().code), ErrorCode::Timeout);
        assert!(started.elapsed() < HANDSHAKE * 9 / 5, "{:?}", started.elapsed());
        assert_eq!(waits.join().unwrap(), 0);
    });
    assert_eq!((server.counts()[0].lost, server.connected()), (1, 0));
}

#[test]
fn a_producer_that_has_sent_a_frame_may_be_slow() {
    let place = Place::default();
    let server = engine_with(&place, impatient());
    let (peer, _) = linked(&place);
    peer.send(Message::Frame(frame(0, 1, 0)), &[]);
    until("its frame", || server.counts()[0].frames == 1);
    std::thread::sleep(HANDSHAKE * 3 / 2);
    assert_eq!((server.connected(), server.counts()[0].lost), (1, 0));
    assert_eq!(server.wait(SECOND).unwrap().len(), 1);
}
