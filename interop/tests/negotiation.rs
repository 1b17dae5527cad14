//! What a producer and the engine agree on, case by case: which memory and which timeline, and why not.

use esaac_interop::session::{Action, Agreement, Session, Terms, agree, hello};
use esaac_interop::wire::{
    self, Brought, ErrorCode, FrameNotice, Header, Hello, ImageMemory, Message, Refusal, Version,
};
use esaac_interop::{Images, InteropError};
use esaac_model::{HdrFormat, MotionFormat};

const IMAGES: Images = Images {
    width_px: 12,
    height_px: 9,
    hdr: HdrFormat::F16x4,
    motion: Some(MotionFormat::F16x2),
    geometry: None,
};

const ALL_MEMORIES: u32 =
    wire::MEMORY_EXPORTED | wire::MEMORY_HOST | wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES;

const BOTH_TIMELINES: u32 = wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED;

const SLOTS: u32 = 3;

fn terms() -> Terms {
    Terms {
        camera: 4,
        images: IMAGES,
        requires_geometry: false,
        max_instances: 0,
        slots: SLOTS,
        backpressure: wire::LOSSLESS,
        device_uuid: [1; 16],
        driver_uuid: [2; 16],
        memories: ALL_MEMORIES,
        host_refused: None,
        timelines: BOTH_TIMELINES,
    }
}

/// A producer on the engine's device and driver that has everything.
fn producer() -> Hello {
    Hello {
        camera: 4,
        width_px: 12,
        height_px: 9,
        device_uuid: [1; 16],
        driver_uuid: [2; 16],
        memories: ALL_MEMORIES,
        timelines: BOTH_TIMELINES,
        ..Hello::default()
    }
}

fn by(memory: u32, timeline: u32) -> Agreement {
    Agreement { version: Version::Two, memory, timeline, geometry: false }
}

fn agreed(hello: &Hello) -> Agreement {
    agree(Version::Two, hello, &terms()).unwrap_or_else(|error| panic!("{hello:?}: {error}"))
}

fn code_of<T: std::fmt::Debug>(result: Result<T, InteropError>) -> ErrorCode {
    result.expect_err("a refusal").code()
}

#[test]
fn a_producer_without_a_vulkan_driver_shares_the_engines_device() {
    // As CUDA does: it names the device, and has no driver of Vulkan's to name.
    let cuda = Hello { driver_uuid: wire::NO_DRIVER, ..producer() };
    let expected = by(wire::MEMORY_BROUGHT, wire::TIMELINE_EXPORTED);
    assert_eq!(agreed(&cuda), expected);
    // On another device it does not, driver or none.
    let elsewhere = Hello { device_uuid: [9; 16], memories: wire::MEMORY_BROUGHT, ..cuda };
    let error = agree(Version::Two, &elsewhere, &terms()).expect_err("another device");
    assert_eq!(error.code(), ErrorCode::Device);
    assert!(!error.to_string().contains("09090909-0909-0909-0909-090909090909 with driver"), "{error}");
}

#[test]
fn another_driver_of_the_same_device_shares_host_memory_alone() {
    let other = Hello { driver_uuid: [7; 16], ..producer() };
    let expected = by(wire::MEMORY_HOST, wire::TIMELINE_CARRIED);
    assert_eq!(agreed(&other), expected);
    let without_host = Hello { memories: ALL_MEMORIES & !wire::MEMORY_HOST, ..other };
    let error = agree(Version::Two, &without_host, &terms()).expect_err("no memory");
    assert_eq!(error.code(), ErrorCode::Device);
    assert!(error.to_string().contains("with driver 07070707-0707-0707-0707-070707070707"), "{error}");
}

#[test]
fn what_takes_the_fewest_copies_is_chosen() {
    let order = [wire::MEMORY_BROUGHT, wire::MEMORY_IMAGES, wire::MEMORY_EXPORTED, wire::MEMORY_HOST];
    for first in 0..order.len() {
        let memories = order[first..].iter().fold(0, |all, kind| all | kind);
        assert_eq!(agreed(&Hello { memories, ..producer() }).memory, order[first]);
    }
    for (timelines, expected) in [
        (BOTH_TIMELINES, wire::TIMELINE_EXPORTED),
        (wire::TIMELINE_EXPORTED, wire::TIMELINE_EXPORTED),
        (wire::TIMELINE_CARRIED, wire::TIMELINE_CARRIED),
    ] {
        assert_eq!(agreed(&Hello { timelines, ..producer() }).timeline, expected);
    }
}

#[test]
fn nothing_in_common_is_refused_as_such() {
    assert_eq!(
        code_of(agree(Version::Two, &Hello { memories: 0, ..producer() }, &terms())),
        ErrorCode::Unsupported
    );
    assert_eq!(
        code_of(agree(Version::Two, &Hello { timelines: 0, ..producer() }, &terms())),
        ErrorCode::Unsupported
    );
    // An exported timeline is of no use to another device.
    let other = Hello { device_uuid: [9; 16], timelines: wire::TIMELINE_EXPORTED, ..producer() };
    assert_eq!(code_of(agree(Version::Two, &other, &terms())), ErrorCode::Unsupported);
    // Why the engine lacks memory of the host matters to those who have that.
    let refuses =
        Terms { memories: wire::MEMORY_EXPORTED, host_refused: Some("it does not".to_owned()), ..terms() };
    for (memories, end) in [
        (wire::MEMORY_HOST, "none in common; on the engine's device it does not"),
        (wire::MEMORY_BROUGHT, "none in common"),
    ] {
        let error =
            agree(Version::Two, &Hello { memories, ..producer() }, &refuses).expect_err("nothing in common");
        assert!(error.words().ends_with(end), "{error}");
    }
}

#[test]
fn images_of_another_size_are_refused_and_no_size_is_any() {
    for (width_px, height_px) in [(13, 9), (12, 8), (0, 9), (12, 0)] {
        let hello = Hello { width_px, height_px, ..producer() };
        assert_eq!(
            code_of(agree(Version::Two, &hello, &terms())),
            ErrorCode::Camera,
            "{width_px}x{height_px}"
        );
    }
    agreed(&Hello { width_px: 0, height_px: 0, ..producer() });
}

#[test]
fn hello_comes_first() {
    assert!(hello(&Message::Hello(producer())).is_ok());
    assert_eq!(code_of(hello(&Message::Bye(Header::default()))), ErrorCode::Protocol);
}

fn streaming() -> Session {
    Session::new(&terms(), by(wire::MEMORY_EXPORTED, wire::TIMELINE_CARRIED))
}

fn frame(slot: u32, value: u64, t_ns: i64) -> Message {
    Message::Frame(FrameNotice { slot, value, t_ns, ..FrameNotice::default() })
}

#[test]
fn the_last_slot_takes_a_frame_and_the_one_after_it_is_refused() {
    let mut session = streaming();
    assert!(matches!(session.receive(&frame(SLOTS - 1, 1, 0), 0), Ok(Action::Queue(_, None))));
    assert_eq!(session.held(), 1);
    assert_eq!(code_of(session.receive(&frame(SLOTS, 1, 1), 0)), ErrorCode::Protocol);
}

#[test]
fn a_slot_that_is_not_given_back_takes_no_frame() {
    let mut session = streaming();
    session.receive(&frame(0, 1, 0), 0).expect("a frame");
    for value in [1, 2, 3] {
        assert_eq!(code_of(session.receive(&frame(0, value, 1), 0)), ErrorCode::Protocol, "value {value}");
    }
    assert_eq!(session.release(0), 2);
    assert_eq!(session.held(), 0);
    // Its value goes on from there, by one.
    for value in [1, 2, 4] {
        let error = session.receive(&frame(0, value, 1), 0).expect_err("a wrong value");
        assert!(matches!(error, InteropError::Value { slot: 0, expected: 3, .. }), "{error}");
    }
    session.receive(&frame(0, 3, 1), 0).expect("the next frame");
}

#[test]
fn frame_times_ascend_and_lie_within_their_range() {
    const MOST_NS: i64 = 1 << 62;
    for (t_ns, holds) in
        [(MOST_NS, true), (-MOST_NS, true), (MOST_NS + 1, false), (-MOST_NS - 1, false), (i64::MIN, false)]
    {
        let got = streaming().receive(&frame(0, 1, t_ns), 0);
        assert_eq!(got.is_ok(), holds, "{t_ns}");
        if !holds {
            assert_eq!(code_of(got), ErrorCode::Time);
        }
    }
    let mut session = streaming();
    session.receive(&frame(0, 1, 5), 0).expect("a frame");
    assert_eq!(code_of(session.receive(&frame(1, 1, 5), 0)), ErrorCode::Time);
    session.receive(&frame(1, 1, 6), 0).expect("a later frame");
    // Later than the latest, not only than the first.
    assert_eq!(code_of(session.receive(&frame(2, 1, 6), 0)), ErrorCode::Time);
}

#[test]
fn descriptors_come_with_brought_alone_one_an_image() {
    let brings = by(wire::MEMORY_BROUGHT, wire::TIMELINE_CARRIED);
    let memory = |bytes| ImageMemory { bytes, allocation_bytes: bytes, ..ImageMemory::default() };
    let brought = Brought {
        hdr: memory(IMAGES.bytes().hdr),
        motion: memory(IMAGES.bytes().motion.expect("it has motion")),
        ..Brought::default()
    };
    let images = 2 * SLOTS as usize;
    for (fds, holds) in [(images, true), (images - 1, false), (images + 1, false), (0, false)] {
        let mut session = Session::new(&terms(), brings);
        let got = session.receive(&Message::Brought(brought), fds);
        assert_eq!(got.is_ok(), holds, "{fds} descriptors");
        if holds {
            // Once.
            assert_eq!(code_of(session.receive(&Message::Brought(brought), fds)), ErrorCode::Protocol);
        }
    }
    assert_eq!(code_of(streaming().receive(&frame(0, 1, 0), 1)), ErrorCode::Protocol);
    assert_eq!(code_of(streaming().receive(&Message::Bye(Header::default()), 1)), ErrorCode::Protocol);
    // Before the memory there are no frames, and the end may come at any time.
    let mut session = Session::new(&terms(), brings);
    assert_eq!(code_of(session.receive(&frame(0, 1, 0), 0)), ErrorCode::Protocol);
    assert!(matches!(session.receive(&Message::Bye(Header::default()), 0), Ok(Action::End)));
    assert_eq!(code_of(session.receive(&frame(0, 1, 0), 0)), ErrorCode::Protocol);
}

#[test]
fn brought_memory_is_of_the_images_size_and_not_much_more() {
    let brings = by(wire::MEMORY_IMAGES, wire::TIMELINE_CARRIED);
    const SMALL_ALLOCATION: u64 = 4 << 20;
    let (hdr, motion) = (IMAGES.bytes().hdr, IMAGES.bytes().motion.expect("it has motion"));
    for (hdr_memory, motion_memory, holds) in [
        ((hdr, hdr), (motion, motion), true),
        ((hdr, SMALL_ALLOCATION), (motion, SMALL_ALLOCATION), true),
        ((hdr, SMALL_ALLOCATION + 1), (motion, motion), false),
        ((hdr, hdr), (motion, SMALL_ALLOCATION + 1), false),
        ((hdr, hdr - 1), (motion, motion), false),
        ((hdr, hdr), (motion, motion - 1), false),
        ((hdr + 1, hdr + 1), (motion, motion), false),
        ((hdr, hdr), (motion + 1, motion + 1), false),
    ] {
        let memory =
            |(bytes, allocation_bytes)| ImageMemory { bytes, allocation_bytes, ..Default::default() };
        let brought =
            Brought { hdr: memory(hdr_memory), motion: memory(motion_memory), ..Brought::default() };
        let got = Session::new(&terms(), brings).receive(&Message::Brought(brought), 2 * SLOTS as usize);
        assert_eq!(got.is_ok(), holds, "{hdr_memory:?} {motion_memory:?}");
        if !holds {
            assert_eq!(code_of(got), ErrorCode::Memory);
        }
    }
}

#[test]
fn a_producers_own_error_is_handed_on_with_its_code() {
    let refusal = Message::Refusal(Refusal::new(ErrorCode::Memory, "no room"));
    let error = streaming().receive(&refusal, 0).expect_err("the producer's error");
    assert_eq!(error.code(), ErrorCode::Memory);
    assert!(error.to_string().contains("the producer says: no room"), "{error}");
}
