//! Drivers without some features, and memory that runs short: which way of sharing is chosen, and the error where there
//! is none.

use crate::connections::one_frame_goes_through;
use crate::faults::{engine, sensor, sequence};
use esaac_engine::DeviceChoice;
use esaac_engine::{Device, RigOptions};
use esaac_interop::wire::{
    ErrorCode, Hello, MEMORY_BROUGHT, MEMORY_EXPORTED, MEMORY_HOST, Message, TIMELINE_CARRIED,
};
use esaac_interop::{Producer, ProducerOptions, ServerOptions, Support};
use esaac_model::{HdrFormat, MotionFormat, SensorModel, Synthesis};
use esaac_scene::SceneKind;
use esaac_tests::device::{DEVICE, assert_device_silent, assert_silent};
use esaac_tests::drivers::{OtherDriver, in_a_process_of_its_own};
use esaac_tests::frames::{Sequence, scene, times};
use esaac_tests::interop::{Place, Uploader, other_device, server, service, trusting, until};
use esaac_tests::peer::{Peer, bringing, greeting};
use esaac_tests::run::{camera, engine_with};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::cell::RefCell;
use std::sync::Arc;
use std::time::Duration;

const SECOND: Duration = Duration::from_secs(1);

/// Sends a few frames from a producer on `device` and asserts that their events are those of the same frames in one
/// process. Returns the kinds of memory and timeline that the link chose.
pub fn few_frames_go_through(device: &Arc<Device>, options: &ProducerOptions) -> (u32, u32) {
    let (sensor, sequence) = (sensor(), sequence());
    let expected = engine_with(&sensor, &sequence, RigOptions::default());
    let place = Place::default();
    let mut service = service(&place.path(), &[(sensor, &sequence)], false, ServerOptions::default());
    let mut uploader = Uploader::connect(device, &place.path(), options).unwrap();
    let offer = *uploader.producer.client().offer();
    let mut events = 0;
    for (frame, expected) in sequence.frames.iter().zip(&expected) {
        uploader.send(frame, frame.t_ns).unwrap();
        let tick = service.tick(30 * SECOND).unwrap().expect("a frame");
        assert!(tick.tick.packets[0] == expected.packet, "other events at {} ns", frame.t_ns);
        events += expected.packet.len();
    }
    assert!(events > 10, "{events} events");
    assert_eq!(uploader.producer.finish().unwrap(), (sequence.frames.len() as u64, 0));
    until("its goodbye", || service.counts()[0].finished == 1);
    drop(service);
    assert_device_silent(device);
    assert_silent();
    (offer.memory, offer.timeline)
}

#[test]
fn without_descriptors_memory_of_the_host_is_shared() {
    let driver = OtherDriver {
        lacks: &["VK_KHR_external_memory_fd", "VK_KHR_external_semaphore_fd"],
        ..OtherDriver::default()
    };
    let name = "drivers::without_descriptors_memory_of_the_host_is_shared";
    if !in_a_process_of_its_own(name, Some(&driver)) {
        return;
    }
    let support = Support::of(&DEVICE);
    assert!(
        !support.export_buffer && !support.import_buffer && support.host_alignment.is_some(),
        "{support:?}"
    );
    let device = other_device();
    let went = few_frames_go_through(&device, &ProducerOptions::default());
    assert_eq!(went, (MEMORY_HOST, TIMELINE_CARRIED));
    // A producer that accepts nothing else is refused, and told what the engine offers.
    let place = Place::default();
    let server = engine(&place);
    let peer = Peer::connect(&place.path());
    peer.send(Message::Hello(bringing()), &[]);
    let refusal = peer.refusal();
    assert_eq!(ErrorCode::from_number(refusal.code), ErrorCode::Unsupported);
    assert_eq!(refusal.words(), "memories: the producer has BROUGHT, the engine HOST, none in common");
    one_frame_goes_through(&server, &place);
}

#[test]
fn a_driver_that_refuses_pages_of_files_is_offered_no_memory_of_the_host() {
    let driver = OtherDriver { anonymous_only: true, ..OtherDriver::default() };
    let name = "drivers::a_driver_that_refuses_pages_of_files_is_offered_no_memory_of_the_host";
    if !in_a_process_of_its_own(name, Some(&driver)) {
        return;
    }
    let support = Support::of(&DEVICE);
    assert_eq!((support.host_alignment, support.engine_memories()), (None, MEMORY_EXPORTED | MEMORY_BROUGHT));
    let why = support.host_refused.expect("the driver's words");
    assert!(why.contains("refuses memory of the host") && why.contains("vkAllocateMemory: "), "{why}");
    // A producer of the same kind takes the other memory, and cannot ask for the host's.
    let (sensor, sequence) = (sensor(), sequence());
    let place = Place::default();
    let open = |place: &Place, options| server(&place.path(), &camera(&sensor, 0, &sequence), options);
    let server = open(&place, trusting()).unwrap();
    let device = other_device();
    let uploader = Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
    assert_eq!(uploader.producer.client().offer().memory, MEMORY_EXPORTED);
    drop(uploader);
    until("its end", || server.connected() == 0);
    let options = ProducerOptions { memories: MEMORY_HOST, ..ProducerOptions::default() };
    let Err(error) = Producer::connect(&device, &place.path(), &options) else {
        panic!("memory of the host")
    };
    let text = error.to_string();
    assert!(
        text.contains("EXPORTED, BROUGHT, IMAGES, and HOST is allowed; ") && text.ends_with(&why),
        "{text}"
    );
    // One that renders on the processor has nothing else, and is told why the engine has not.
    let peer = Peer::connect(&place.path());
    peer.send(Message::Hello(Hello { memories: MEMORY_HOST, ..greeting() }), &[]);
    let words = peer.refusal().words();
    assert!(
        words.starts_with("memories: the producer has HOST, the engine EXPORTED") && words.ends_with(&why),
        "{words}"
    );
    // A server that may offer nothing else, as on a software device by default, says so at once.
    let place = Place::default();
    let options = ServerOptions { memories: MEMORY_HOST, ..ServerOptions::default() };
    let Err(error) = open(&place, options) else { panic!("a server without memory") };
    assert!(error.to_string().ends_with(&why), "{error}");
    assert_device_silent(&device);
    drop(server);
    assert_silent();
}

#[test]
fn without_any_sharing_the_engine_says_what_the_driver_lacks() {
    let driver = OtherDriver {
        lacks: &["VK_KHR_external_memory_fd", "VK_EXT_external_memory_host"],
        ..OtherDriver::default()
    };
    let name = "drivers::without_any_sharing_the_engine_says_what_the_driver_lacks";
    if !in_a_process_of_its_own(name, Some(&driver)) {
        return;
    }
    assert_eq!(Support::of(&DEVICE).engine_memories(), 0);
    let place = Place::default();
    let Err(error) = server(&place.path(), &camera(&sensor(), 0, &sequence()), ServerOptions::default())
    else {
        panic!("a server on a device that shares nothing");
    };
    let text = error.to_string();
    assert!(text.contains(&DEVICE.info().name) && text.contains("VK_KHR_external_memory_fd"), "{text}");
    assert!(
        text.contains("VK_EXT_external_memory_host; update its driver or choose another device"),
        "{text}"
    );
    assert!(!place.path().exists(), "a socket that nobody answers");
    // Without a link the engine still works.
    assert!(engine_with(&sensor(), &sequence(), RigOptions::default()).len() == 4);
}

/// A camera whose images are large.
fn large() -> (SensorModel, Sequence) {
    let sensor =
        SensorModel { width: 2048, height: 1024, synthesis: Synthesis::None, ..SensorModel::default() };
    let sequence = scene(SceneKind::Edge, (2048, 1024), &times(0, 1), HdrFormat::F16x4, MotionFormat::F16x2);
    (sensor, sequence)
}

#[test]
fn a_device_that_is_full_refuses_the_import_and_goes_on() {
    let (sensor, sequence) = (sensor(), sequence());
    // Room for one slot, not for two.
    let one = 12 * 9 * 8;
    let driver = OtherDriver { import_bytes: Some(2 * one), ..OtherDriver::default() };
    let name = "drivers::a_device_that_is_full_refuses_the_import_and_goes_on";
    if !in_a_process_of_its_own(name, Some(&driver)) {
        return;
    }
    let place = Place::default();
    let server = server(&place.path(), &camera(&sensor, 0, &sequence), trusting()).unwrap();
    let device = other_device();
    for (memories, side) in
        [(MEMORY_BROUGHT, "the engine imports"), (MEMORY_EXPORTED, "the producer imports")]
    {
        let options = ProducerOptions { memories, ..ProducerOptions::default() };
        let Err(error) = Uploader::connect(&device, &place.path(), &options) else { panic!("{side}") };
        assert_eq!(error.code(), ErrorCode::Memory, "{side}: {error}");
        let text = error.to_string();
        for words in
            ["bytes for `camera 0 slot", "device memory", "fewer `slots` or a smaller size, or free memory"]
        {
            assert!(text.contains(words), "{side}: no `{words}` in: {text}");
        }
        // The producer may return with its error before the engine has read its message.
        let told = RefCell::new(Vec::new());
        until(side, || {
            told.borrow_mut().extend(server.notices());
            told.borrow().join("\n").contains("fewer `slots`")
        });
        until("its end", || server.connected() == 0);
    }
    // Sharing host memory imports no descriptor.
    let options = ProducerOptions { memories: MEMORY_HOST, ..ProducerOptions::default() };
    drop(Uploader::connect(&device, &place.path(), &options).unwrap());
    assert_device_silent(&device);
    drop(server);
    assert_silent();
}

/// Address space in use by this process, bytes.
fn address_space_bytes() -> u64 {
    let pages: u64 = std::fs::read_to_string("/proc/self/statm")
        .unwrap()
        .split(' ')
        .next()
        .and_then(|pages| pages.parse().ok())
        .expect("Linux counts pages");
    pages * rustix::param::page_size() as u64
}

/// The same shortage without the layer, on the software driver: memory that a peer brings does not fit into the
/// engine's address space.
#[test]
fn a_process_that_is_full_refuses_the_import_and_goes_on() {
    let name = "drivers::a_process_that_is_full_refuses_the_import_and_goes_on";
    if !in_a_process_of_its_own(name, None) {
        return;
    }
    if !DEVICE.is_software() {
        // Imported memory of a GPU takes no address space of the process. The test with the layer covers GPUs.
        return;
    }
    let (sensor, sequence) = large();
    let place = Place::default();
    let server = server(&place.path(), &camera(&sensor, 0, &sequence), trusting()).unwrap();
    let device = other_device();
    let options = ProducerOptions { memories: MEMORY_BROUGHT, ..ProducerOptions::default() };
    let slot_bytes = 2048 * 1024 * (8 + 4);
    let free = getrlimit(Resource::As);
    // The producer's three slots are in this process too. The other use of address space differs from run to run. So
    // the limit grows until the producer's slots fit and the engine's imports do not.
    let refused = (0..24).find_map(|quarters| {
        let current = Some(address_space_bytes() + (12 + quarters) * slot_bytes / 4);
        setrlimit(Resource::As, Rlimit { current, ..free }).unwrap();
        let refused = Producer::connect(&device, &place.path(), &options);
        setrlimit(Resource::As, free).unwrap();
        let Err(error) = refused else { panic!("there was room") };
        error.to_string().contains("bytes for `camera 0 slot").then_some(error)
    });
    let error = refused.expect("an import that the engine refuses");
    assert_eq!(error.code(), ErrorCode::Memory, "{error}");
    assert!(error.to_string().contains("fewer `slots`"), "{error}");
    let told = RefCell::new(Vec::new());
    until("the engine's own log", || {
        told.borrow_mut().extend(server.notices());
        told.borrow().join("\n").contains("camera 0 slot")
    });
    until("its end", || server.connected() == 0);
    drop(Producer::connect(&device, &place.path(), &options).expect("with room it is taken"));
    assert_device_silent(&device);
    drop(server);
    assert_silent();
}

#[test]
fn a_device_that_is_not_there_is_named_beside_those_that_are() {
    let wanted = DeviceChoice::Uuid([0xee; 16]);
    let Err(error) = Device::open(wanted, esaac_engine::Validation::Off) else { panic!("no such device") };
    let text = error.to_string();
    assert!(text.contains("eeeeeeee-eeee-eeee-eeee-eeeeeeeeeeee"), "{text}");
    assert!(text.contains(&DEVICE.info().name), "{text}");
}
