//! A system that is short of descriptors: connected producers go on, waiting ones are served later.

use crate::faults::{engine, sensor, sequence};
use esaac_engine::FaultPoint;
use esaac_engine::ash::vk;
use esaac_interop::wire::{ErrorCode, Hello, MAX_SLOTS, MEMORY_HOST, Message};
use esaac_interop::{
    CameraTerms, DEFAULT_SLOTS, InteropError, Outcome, Producer, ProducerOptions, Server, ServerOptions,
    Service,
};
use esaac_tests::device::{DEVICE, assert_device_silent, assert_silent};
use esaac_tests::drivers::in_a_process_of_its_own;
use esaac_tests::interop::{Place, Uploader, other_device, service, until};
use esaac_tests::peer::{Peer, greeting};
use esaac_tests::run::camera;
use rustix::fd::AsRawFd;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::sync::Arc;
use std::time::Duration;

const SECOND: Duration = Duration::from_secs(1);

/// Prevents this process from opening descriptors. Returns the previous limit, with which `setrlimit` ends that.
fn forbid_descriptors() -> Rlimit {
    let before = getrlimit(Resource::Nofile);
    let lowest_free = std::fs::File::open("/dev/null").unwrap().as_raw_fd();
    setrlimit(Resource::Nofile, Rlimit { current: Some(lowest_free as u64), ..before }).unwrap();
    assert!(std::fs::File::open("/dev/null").is_err());
    before
}

#[test]
fn without_descriptors_connected_producers_go_on_and_others_are_served_later() {
    let name = "shortage::without_descriptors_connected_producers_go_on_and_others_are_served_later";
    if !in_a_process_of_its_own(name, None) {
        return;
    }
    let place = Place::default();
    let server = engine(&place);
    let device = other_device();
    let mut producer = Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
    let mut frames = sequence().frames.into_iter().zip([0, 10, 20, 30]);
    let mut one_frame = |server: &Server| {
        let (frame, t_ns) = frames.next().unwrap();
        producer.send(&frame, t_ns).unwrap();
        let ready = server.wait(10 * SECOND).unwrap();
        assert_eq!(ready.len(), 1);
        server.release(&ready[0], Outcome::Stepped);
    };
    one_frame(&server);

    let late: Vec<Peer> = (0..3).map(|_| Peer::unconnected()).collect();
    let before = forbid_descriptors();
    late.iter().for_each(|peer| peer.connect_to(&place.path()));
    until("several looks", || server.connections().not_accepted >= 3);
    one_frame(&server);
    one_frame(&server);
    let failures = server.connections().not_accepted;
    setrlimit(Resource::Nofile, before).unwrap();

    for peer in late {
        peer.send(Message::Hello(greeting()), &[]);
        assert_eq!(ErrorCode::from_number(peer.refusal().code), ErrorCode::Taken);
    }
    one_frame(&server);
    producer.producer.finish().unwrap();
    // The server retries at intervals; it does not spin.
    assert!(failures < 100, "{failures} failures");
    let connections = server.connections();
    assert_eq!((connections.accepted, connections.refused), (4, 3));
    let notices = server.notices().join("\n");
    assert!(notices.contains("accept4: Too many open files"), "{notices}");
    assert_device_silent(&device);
    drop(server);
    assert_silent();
}

/// Open descriptors but those of devices: a GPU's driver opens its device again for memory that it imports.
fn open_descriptors() -> usize {
    let links = std::fs::read_dir("/proc/self/fd").unwrap().map(|entry| entry.unwrap().path());
    // A link that cannot be read is the one of the folder itself.
    links.filter(|link| std::fs::read_link(link).is_ok_and(|target| !target.starts_with("/dev"))).count()
}

/// The usual limit is 1024 descriptors per process.
#[test]
fn a_rig_of_32_cameras_with_16_slots_needs_few_descriptors() {
    let name = "shortage::a_rig_of_32_cameras_with_16_slots_needs_few_descriptors";
    if !in_a_process_of_its_own(name, None) {
        return;
    }
    const CAMERAS: u32 = 32;
    let usual = Rlimit { current: Some(1024), ..getrlimit(Resource::Nofile) };
    setrlimit(Resource::Nofile, usual).unwrap();
    let place = Place::default();
    let config = camera(&sensor(), 0, &sequence());
    let terms = CameraTerms { slots: MAX_SLOTS, ..(&config).into() };
    let cameras = vec![terms; CAMERAS as usize];
    let server = Server::open(&DEVICE, &place.path(), &cameras, ServerOptions::default()).unwrap();
    let before = open_descriptors();
    let mut peers = Vec::new();
    for camera in 0..CAMERAS {
        let peer = Peer::connect(&place.path());
        peer.send(Message::Hello(Hello { camera, memories: MEMORY_HOST, ..greeting() }), &[]);
        match peer.receive() {
            Some((Message::Ring(offer), fds)) => {
                assert_eq!((offer.memory, fds.len()), (MEMORY_HOST, 2 * MAX_SLOTS as usize));
            }
            other => panic!("camera {camera}: {other:?}"),
        }
        peers.push(peer);
    }
    until("all rings", || server.connected() == CAMERAS as usize);
    // Both ends of each connection are in this process.
    let more = open_descriptors() - before;
    assert!(more <= 2 * CAMERAS as usize + 8, "{more} descriptors for {CAMERAS} cameras");

    // A producer maps the memory and needs as few descriptors.
    drop(peers);
    // Connections are closed after they stop counting.
    until("their end", || server.connected() == 0 && open_descriptors() <= before);
    let device = other_device();
    let before = open_descriptors();
    let options = ProducerOptions { memories: MEMORY_HOST, ..ProducerOptions::default() };
    let producer = Producer::connect(&device, &place.path(), &options).unwrap();
    until("its ring", || server.connected() == 1);
    let more = open_descriptors().saturating_sub(before);
    assert!(more <= 4, "{more} descriptors for one producer");
    drop(producer);
    assert_device_silent(&device);
    drop(server);
    assert_silent();
}

/// A tick whose submission the queue does not take.
pub fn fails(service: &mut Service) {
    let hook = |point| (point == FaultPoint::Submit).then_some(vk::Result::ERROR_OUT_OF_HOST_MEMORY);
    DEVICE.set_faults(Some(Arc::new(hook)));
    assert!(matches!(service.tick(10 * SECOND), Err(InteropError::Engine(_))));
    DEVICE.set_faults(None);
}

/// A step that the device refuses gives the producer its slots back, and its camera starts anew with the next frame.
#[test]
fn a_step_that_fails_keeps_no_slot() {
    let name = "shortage::a_step_that_fails_keeps_no_slot";
    if !in_a_process_of_its_own(name, None) {
        return;
    }
    let (place, sensor, sequence) = (Place::default(), sensor(), sequence());
    let mut service = service(&place.path(), &[(sensor, &sequence)], false, ServerOptions::default());
    let device = other_device();
    let mut producer = Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
    let slots = i64::from(DEFAULT_SLOTS);
    for round in 0..2 * slots {
        // Each of these fails. If one kept its slot, the last could not be sent.
        producer.send(&sequence.frames[1], 10 * round).unwrap();
        fails(&mut service);
    }
    let mut firsts = Vec::new();
    for index in 0..3 {
        producer.send(&sequence.frames[index], 1000 + 10 * index as i64).unwrap();
        firsts.extend(service.tick(10 * SECOND).unwrap().expect("a frame").first);
        if index == 1 {
            producer.send(&sequence.frames[index], 1015).unwrap();
            fails(&mut service);
        }
    }
    assert_eq!(firsts, [true, false, true], "the frame after one that was lost is a first");
    // The first frame of the next producer begins anew, and no later one does because of the step that failed before.
    producer.send(&sequence.frames[3], 1030).unwrap();
    fails(&mut service);
    producer.producer.finish().unwrap();
    let mut producer = Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
    let mut firsts = Vec::new();
    for (frame, t_ns) in sequence.frames.iter().zip([0, 10]) {
        producer.send(frame, t_ns).unwrap();
        firsts.extend(service.tick(10 * SECOND).unwrap().expect("a frame").first);
    }
    assert_eq!(firsts, [true, false]);
    let counts = service.counts()[0];
    assert_eq!((counts.stepped, counts.dropped), (5, 2 * slots as u64 + 2));
    producer.producer.finish().unwrap();
    drop(service);
    assert_device_silent(&device);
    assert_silent();
}
