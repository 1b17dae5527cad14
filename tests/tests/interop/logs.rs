//! Limits on the log lines that peers can cause, and on the memory that their connections cost.

use crate::faults::{engine, linked};
use esaac_interop::wire::{ErrorCode, Message, Refusal};
use esaac_tests::drivers::in_a_process_without_the_layer;
use esaac_tests::interop::{Place, until};
use esaac_tests::peer::{Peer, greeting};

#[test]
fn a_peer_s_words_are_one_printable_line() {
    let place = Place::default();
    let server = engine(&place);
    let (peer, _) = linked(&place);
    let words = "no\x1b[2J room\ncamera 1: the peer closed the connection\r\u{202e}";
    peer.send(Message::Refusal(Refusal::new(ErrorCode::Memory, words)), &[]);
    let _ = peer.refusal();
    let notices = server.notices();
    assert_eq!(notices.len(), 1, "{notices:?}");
    let expected = r"the producer says: no\u{1b}[2J room\ncamera 1: the peer closed the connection\r\u{202e}";
    assert!(notices[0].ends_with(expected), "{notices:?}");
    assert!(!notices[0].chars().any(char::is_control), "{notices:?}");
}

#[test]
fn refused_connections_are_counted_and_do_not_write_a_line_each() {
    const CONNECTIONS: u64 = 1000;
    let place = Place::default();
    let server = engine(&place);
    for _ in 0..CONNECTIONS {
        let peer = Peer::connect(&place.path());
        peer.send_bytes(b"no message of this protocol", &[]);
        assert_eq!(ErrorCode::from_number(peer.refusal().code), ErrorCode::Protocol);
    }
    until("the last", || server.connections().refused == CONNECTIONS);
    assert_eq!(server.connections().accepted, CONNECTIONS);
    let first = server.notices();
    assert!(first.len() < 100, "{} lines", first.len());
    // Within a second the engine logs how many lines it left out, so that all are accounted for.
    let lines = std::cell::RefCell::new(first);
    until("the sum", || {
        lines.borrow_mut().extend(server.notices());
        let left_out = |line: &String| line.split_once(" more lines were left out")?.0.parse::<u64>().ok();
        let lines = lines.borrow();
        let (sums, single): (Vec<_>, Vec<_>) = lines.iter().partition(|line| left_out(line).is_some());
        single.len() as u64 + sums.into_iter().filter_map(left_out).sum::<u64>() == CONNECTIONS
    });
}

fn resident_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("Linux says it");
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

#[test]
fn connections_cost_no_memory_once_they_are_gone() {
    if !in_a_process_without_the_layer("logs::connections_cost_no_memory_once_they_are_gone") {
        return;
    }
    let place = Place::default();
    let server = engine(&place);
    let rounds: u64 = std::env::var("ESAAC_LINK_ROUNDS").map_or(4, |n| n.parse().expect("a number"));
    let mut connections = 0;
    let mut measured = Vec::new();
    for _ in 0..rounds {
        for _ in 0..250 {
            // A peer that gets a ring and leaves, and one that sends no valid message.
            let peer = Peer::connect(&place.path());
            peer.send(Message::Hello(greeting()), &[]);
            assert!(matches!(peer.receive(), Some((Message::Ring(_), _))));
            drop(peer);
            Peer::connect(&place.path()).send_bytes(b"junk", &[]);
            connections += 1;
            until("its end", || server.counts()[0].lost == connections && server.connected() == 0);
        }
        measured.push(resident_kib());
    }
    println!("resident after each 250 rings and 250 refusals, KiB: {measured:?}");
    let (second, last) = (measured[1], measured[measured.len() - 1]);
    assert!(last < second + 2048, "resident memory grows: {measured:?} KiB");
}
