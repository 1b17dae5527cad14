//! Connections that end in various ways, sockets that cannot be created, and leaks.

use crate::faults::{engine, sensor, sequence};
use esaac_interop::wire::{ErrorCode, Message};
use esaac_interop::{InteropError, Outcome, Producer, ProducerOptions, Server, ServerOptions};
use esaac_tests::device::{assert_device_silent, assert_silent};
use esaac_tests::drivers::in_a_process_of_its_own;
use esaac_tests::interop::{Place, Uploader, other_device, server, service, until};
use esaac_tests::peer::{Peer, greeting};
use esaac_tests::run::camera;
use std::os::unix::fs::PermissionsExt;
use std::time::{Duration, Instant};

const SECOND: Duration = Duration::from_secs(1);

/// Asserts that the engine serves: a producer connects, and its frame arrives.
pub fn one_frame_goes_through(server: &Server, place: &Place) {
    let device = other_device();
    let mut uploader = Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
    uploader.send(&sequence().frames[0], 0).unwrap();
    let ready = server.wait(10 * SECOND).unwrap();
    assert_eq!((ready.len(), ready[0].first), (1, true));
    server.release(&ready[0], Outcome::Stepped);
    assert_eq!(uploader.producer.finish().unwrap(), (1, 0));
    assert_device_silent(&device);
}

/// A goodbye and the next HELLO come by different sockets, so the engine may read the HELLO first.
#[test]
fn a_producer_that_has_left_is_not_in_the_way_of_the_next() {
    let place = Place::default();
    let server = engine(&place);
    let device = other_device();
    let connect = || Producer::connect(&device, &place.path(), &ProducerOptions::default());
    let rounds = 60;
    for round in 0..rounds {
        let producer = connect().unwrap_or_else(|error| panic!("round {round}: {error}"));
        if round % 2 == 0 {
            producer.finish().unwrap();
        }
        // The others close without a goodbye.
    }
    let holder = connect().unwrap();
    let Err(error) = connect() else { panic!("camera 0 was given twice") };
    assert_eq!(error.code(), ErrorCode::Taken);
    holder.finish().unwrap();
    until("the last goodbye", || server.connected() == 0);
    let counts = server.counts()[0];
    assert_eq!((counts.connections, counts.finished, counts.lost), (rounds + 1, rounds / 2 + 1, rounds / 2));
    assert_eq!(server.connections().refused, 1);
    drop(server);
    assert_device_silent(&device);
    assert_silent();
}

#[test]
fn a_producer_that_dies_in_mid_frame_frees_its_camera_and_others_go_on() {
    let (sensor, sequence) = (sensor(), sequence());
    let place = Place::default();
    let cameras = [(sensor.clone(), &sequence), (sensor, &sequence)];
    let mut service = service(&place.path(), &cameras, false, ServerOptions::default());
    let device = other_device();
    let connect = |camera| {
        let options = ProducerOptions { camera, ..ProducerOptions::default() };
        Uploader::connect(&device, &place.path(), &options).unwrap()
    };
    let (mut dies, mut lives) = (connect(0), connect(1));
    dies.send(&sequence.frames[0], 0).unwrap();
    lives.send(&sequence.frames[0], 0).unwrap();
    let mut stepped = [0_u32; 2];
    let mut step = |service: &mut esaac_interop::Service| {
        let tick = service.tick(10 * SECOND).unwrap().expect("a frame");
        for (count, t_ns) in stepped.iter_mut().zip(&tick.t_ns) {
            *count += u32::from(t_ns.is_some());
        }
        stepped
    };
    while step(&mut service) != [1, 1] {}
    // The producer leaves while one frame is announced and not yet stepped, and while it writes another slot.
    dies.send(&sequence.frames[1], 33_000_000).unwrap();
    dies.producer.slot().unwrap();
    drop(dies);
    for (frame, t_ns) in sequence.frames[1..].iter().zip([33_000_000, 66_000_000, 99_000_000]) {
        lives.send(frame, t_ns).unwrap();
        step(&mut service);
    }
    while service.counts()[0].lost == 0 {
        assert!(service.tick(SECOND).unwrap().is_some() || service.counts()[0].lost == 1);
    }
    let again = connect(0);
    drop(again);
    lives.producer.finish().unwrap();
    until("the goodbye and the loss", || service.counts()[1].finished == 1 && service.counts()[0].lost == 2);
    let counts = service.counts();
    assert_eq!((counts[1].stepped, counts[1].finished, counts[1].lost), (4, 1, 0));
    assert_eq!(counts[0].frames, counts[0].stepped + counts[0].abandoned);
    drop(service);
    assert_device_silent(&device);
    assert_silent();
}

#[test]
fn an_engine_that_dies_is_an_error_at_once() {
    let place = Place::default();
    let server = engine(&place);
    let device = other_device();
    let mut uploader = Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
    for (frame, t_ns) in sequence().frames.iter().zip([0, 10, 20]) {
        uploader.send(frame, t_ns).unwrap();
    }
    drop(server);
    let started = Instant::now();
    let error = uploader.send(&sequence().frames[3], 30).unwrap_err();
    assert!(matches!(error, InteropError::PeerGone), "{error}");
    assert!(started.elapsed() < SECOND, "{:?}", started.elapsed());
    assert!(!place.path().exists(), "the socket's file goes with the engine");
    let Err(error) = Uploader::connect(&device, &place.path(), &ProducerOptions::default()) else {
        panic!("nobody is there");
    };
    assert!(error.to_string().contains("esaac serve"), "{error}");
}

#[test]
fn a_slow_engine_makes_the_producer_wait_and_then_say_so() {
    let place = Place::default();
    let server = engine(&place);
    let device = other_device();
    let options = ProducerOptions { timeout: Duration::from_secs(2), ..ProducerOptions::default() };
    let mut uploader = Uploader::connect(&device, &place.path(), &options).unwrap();
    for (frame, t_ns) in sequence().frames.iter().zip([0, 10, 20]) {
        uploader.send(frame, t_ns).unwrap();
    }
    let error = uploader.send(&sequence().frames[3], 30).unwrap_err();
    assert_eq!(error.to_string(), "a free slot did not come within 2s");
    assert_eq!((server.counts()[0].frames, server.counts()[0].dropped), (3, 0));
}

/// Open descriptors and memory mappings of this process. Waits first, until the engine's thread has closed its last
/// connection.
fn descriptors_and_mappings() -> (usize, usize) {
    std::thread::sleep(Duration::from_millis(50));
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let shared = maps.lines().filter(|line| line.contains("(deleted)")).count();
    (std::fs::read_dir("/proc/self/fd").unwrap().count(), shared)
}

#[test]
fn a_thousand_connections_leave_nothing_behind() {
    // Needs a process of its own: other tests open descriptors too.
    if !in_a_process_of_its_own("connections::a_thousand_connections_leave_nothing_behind", None) {
        return;
    }
    let place = Place::default();
    let server = engine(&place);
    let settle = |connections: u64| {
        until("its end", || server.counts()[0].lost == connections && server.connected() == 0);
    };
    let mut before = (0, 0);
    for connection in 1..=1000 {
        let peer = Peer::connect(&place.path());
        peer.send(Message::Hello(greeting()), &[]);
        let Some((Message::Ring(_), fds)) = peer.receive() else { panic!("no ring") };
        assert_eq!(fds.len(), 6);
        drop((peer, fds));
        settle(connection);
        if connection == 10 {
            before = descriptors_and_mappings();
        }
    }
    assert_eq!(descriptors_and_mappings(), before, "descriptors and shared mappings");
    // These connections also have a full producer on their other side.
    let device = other_device();
    for connection in 1001..=1020 {
        drop(Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap());
        settle(connection);
        if connection == 1005 {
            before = descriptors_and_mappings();
        }
    }
    assert_eq!(descriptors_and_mappings(), before, "those of a producer");
    assert_device_silent(&device);
    drop(server);
    assert_silent();
}

/// The error of opening a server at `path`.
fn error_at(path: &std::path::Path) -> String {
    match server(path, &camera(&sensor(), 0, &sequence()), ServerOptions::default()) {
        Ok(_) => panic!("a server at {}", path.display()),
        Err(error) => error.to_string(),
    }
}

#[test]
fn sockets_that_cannot_be_made() {
    let place = Place::default();
    let folder = place.path().parent().unwrap().to_owned();
    let long = folder.join("x".repeat(120));
    assert!(error_at(&long).contains("107 bytes"), "{}", error_at(&long));
    assert!(error_at(&folder.join("none/engine.sock")).contains("none"));
    std::fs::write(folder.join("file"), "").unwrap();
    assert!(error_at(&folder.join("file")).contains("no socket"));
    let open = folder.join("open");
    std::fs::create_dir(&open).unwrap();
    std::fs::set_permissions(&open, PermissionsExt::from_mode(0o777)).unwrap();
    assert!(error_at(&open.join("engine.sock")).contains("mkdir -m 700"));

    let first = engine(&place);
    assert!(error_at(&place.path()).contains("another engine serves there"));
    let mode = std::fs::metadata(place.path()).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600, "{mode:o}");
    one_frame_goes_through(&first, &place);
    drop(first);
    // The socket file of a killed engine is replaced.
    let left = std::os::unix::net::UnixListener::bind(place.path()).unwrap();
    drop(left);
    assert!(place.path().exists());
    let third = engine(&place);
    one_frame_goes_through(&third, &place);
}

#[test]
fn another_user_is_turned_away() {
    use std::os::unix::process::CommandExt;
    if let Some(path) = std::env::var_os("ESAAC_TEST_PEER") {
        let peer = Peer::connect(path.as_ref());
        peer.send(Message::Hello(greeting_without_device()), &[]);
        let refusal = peer.refusal();
        println!("{:?}: {}", ErrorCode::from_number(refusal.code), refusal.words());
        return;
    }
    if std::env::var_os("ESAAC_SKIP_OTHER_USER").is_some() {
        println!("left out by ESAAC_SKIP_OTHER_USER");
        return;
    }
    assert!(
        rustix::process::geteuid().is_root(),
        "this test connects as another user, which only root can do: run it as root, or leave it out by \
         ESAAC_SKIP_OTHER_USER=1"
    );
    let place = Place::default();
    let server = engine(&place);
    // The modes of folder and socket keep other users away. This opens both, to test the next line of defence.
    std::fs::set_permissions(place.path().parent().unwrap(), PermissionsExt::from_mode(0o755)).unwrap();
    std::fs::set_permissions(place.path(), PermissionsExt::from_mode(0o777)).unwrap();
    let binary = place.path().with_file_name("peer");
    std::fs::copy(std::env::current_exe().unwrap(), &binary).unwrap();
    let output = std::process::Command::new(&binary)
        .args(["--exact", "connections::another_user_is_turned_away", "--nocapture"])
        .env("ESAAC_TEST_PEER", place.path())
        .uid(65_534)
        .gid(65_534)
        .current_dir("/")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("User: ") && said.contains("user 65534, expected 0"), "{said}");
    assert!(server.notices().join("\n").contains("user 65534"));
    one_frame_goes_through(&server, &place);
}

fn greeting_without_device() -> esaac_interop::wire::Hello {
    esaac_interop::wire::Hello::default()
}
