//! Hostile producers of the same user. All that they can harm is their own link.

use crate::connections::one_frame_goes_through;
use crate::faults::{frame, sensor, sequence};
use esaac_interop::wire::{
    ErrorCode, Hello, MEMORY_BROUGHT, MEMORY_EXPORTED, MEMORY_HOST, MEMORY_IMAGES, Message,
};
use esaac_interop::{ProducerOptions, ServerOptions};
use esaac_tests::device::{DEVICE, assert_device_silent, assert_silent};
use esaac_tests::drivers::in_a_process_of_its_own;
use esaac_tests::interop::{Place, Uploader, other_device, service, until};
use esaac_tests::peer::{Peer, greeting};
use rustix::fd::OwnedFd;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

const SECOND: Duration = Duration::from_secs(1);

/// Environment variable that holds the socket's path, in the process of the hostile peer.
const SOCKET: &str = "ESAAC_TEST_HOSTILE";

/// Overwrites a file that the engine shares. The software driver's own files begin with the length of their mapping.
/// The driver uses that length when it unmaps them, so that a wrong one does harm.
fn overwrite(fd: &OwnedFd) {
    let Ok(stat) = rustix::fs::fstat(fd) else { return };
    let length: u64 = 1 << 30;
    let mut bytes = length.to_ne_bytes().to_vec();
    bytes.resize(bytes.len().max(stat.st_size as usize), 0xff);
    // The result does not matter: the memory of a GPU is no file, has no size, and writing to it fails.
    let _ = rustix::io::pwrite(fd, &bytes, 0);
}

/// Greets with each kind of memory alone, overwrites the memory that it receives, sends a frame in it and disconnects.
fn attack(path: &Path) {
    for memories in [MEMORY_EXPORTED, MEMORY_BROUGHT, MEMORY_IMAGES, MEMORY_HOST] {
        let peer = Peer::connect(path);
        peer.send(Message::Hello(Hello { memories, ..greeting() }), &[]);
        match peer.receive() {
            Some((Message::Ring(_), fds)) if !fds.is_empty() => {
                fds.iter().for_each(overwrite);
                peer.send(Message::Frame(frame(0, 1, 0)), &[]);
                let back = peer.receive();
                assert!(matches!(back, Some((Message::Released(_), _))), "{back:?}");
                println!("memory {memories}: overwritten");
            }
            Some((Message::Refusal(refusal), _)) => {
                let code = ErrorCode::from_number(refusal.code);
                println!("memory {memories}: refused ({code:?}): {}", refusal.words());
            }
            other => println!("memory {memories}: {other:?}"),
        }
    }
}

#[test]
fn a_peer_that_overwrites_shared_memory_does_not_harm_the_engine() {
    let name = "hostile::a_peer_that_overwrites_shared_memory_does_not_harm_the_engine";
    if let Some(path) = std::env::var_os(SOCKET) {
        attack(path.as_ref());
        return;
    }
    // The engine runs in this process, and so would take it down when it dies.
    if !in_a_process_of_its_own(name, None) {
        return;
    }
    let (sensor, sequence) = (sensor(), sequence());
    let place = Place::default();
    let cameras = [(sensor, &sequence)];
    let mut service = service(&place.path(), &cameras, false, ServerOptions::default());
    let mut peer = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", name, "--nocapture"])
        .env(SOCKET, place.path())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    while peer.try_wait().unwrap().is_none() {
        service.tick(SECOND / 10).unwrap();
    }
    let output = peer.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    assert!(said.contains(&format!("memory {MEMORY_HOST}: overwritten")), "{said}");
    if DEVICE.is_software() {
        for memory in [MEMORY_EXPORTED, MEMORY_BROUGHT, MEMORY_IMAGES] {
            assert!(said.contains(&format!("memory {memory}: refused (Unsupported)")), "{said}");
        }
        assert!(said.contains("the engine HOST, none in common"), "{said}");
    }
    until("the peer's links to be gone", || service.server().connected() == 0);
    one_frame_goes_through(service.server(), &place);
    drop(service);
    assert_silent();
}

/// A peer that shares a timeline of the engine can set it to any value at any time, also while the engine steps. That
/// ends its own link and nothing else. A software driver shares no timelines; there the test sets the engine's own
/// timeline, which has the same effect.
#[test]
fn a_timeline_that_is_signalled_ahead_ends_its_link_alone() {
    let (sensor, sequence) = (sensor(), sequence());
    let place = Place::default();
    let cameras = [(sensor.clone(), &sequence), (sensor, &sequence)];
    let options = ServerOptions { gather: 10 * SECOND, ..ServerOptions::default() };
    let mut service = service(&place.path(), &cameras, false, options);
    let device = other_device();
    let connect = |camera| {
        let options = ProducerOptions { camera, ..ProducerOptions::default() };
        Uploader::connect(&device, &place.path(), &options).unwrap()
    };
    let (mut hostile, mut honest) = (connect(0), connect(1));
    for (index, (image, t_ns)) in sequence.frames.iter().zip([0, 10, 20]).enumerate() {
        honest.send(image, t_ns).unwrap();
        if index < 2 {
            hostile.send(image, t_ns).unwrap();
        }
        let mut stepped = 0;
        let tick = service
            .tick_checked(10 * SECOND, |ready| {
                stepped += 1;
                if ready.camera == 0 && index == 1 {
                    ready.slot().timeline().timeline().signal(ready.value() + 7).unwrap();
                }
            })
            .unwrap()
            .expect("frames");
        assert_eq!(tick.t_ns[1], Some(t_ns));
        assert_eq!(stepped, if index < 2 { 2 } else { 1 });
    }
    let counts = service.counts();
    assert_eq!((counts[0].lost, counts[1].lost, counts[1].stepped), (1, 0, 3));
    let notices = service.server().notices().join("\n");
    assert!(notices.contains("camera 0: slot 1: timeline value 8, expected 1"), "{notices}");
    let error = hostile.producer.finish().unwrap_err();
    assert_eq!(error.code(), ErrorCode::Value, "{error}");
    assert_eq!(honest.producer.finish().unwrap(), (3, 0));
    until("the goodbye", || service.counts()[1].finished == 1);
    drop(service);
    assert_device_silent(&device);
    assert_silent();
}
