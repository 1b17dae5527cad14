//! The engine's side of the protocol under every sequence of messages that a generator can think of.

use esaac_interop::Images;
use esaac_interop::session::{Action, Agreement, Session, Terms, agree, hello, is_written, may_release};
use esaac_interop::wire::{
    self, Brought, ErrorCode, FrameNotice, Header, Hello, ImageMemory, Message, Refusal, Released, RingOffer,
    Version,
};
use esaac_model::{HdrFormat, MAX_INTERVAL_NS, MotionFormat};
use proptest::prelude::*;

const IMAGES: Images = Images {
    width_px: 12,
    height_px: 9,
    hdr: HdrFormat::F16x4,
    motion: Some(MotionFormat::F16x2),
    geometry: None,
};

fn terms(slots: u32) -> Terms {
    Terms {
        camera: 0,
        images: IMAGES,
        requires_geometry: false,
        max_instances: 0,
        slots,
        backpressure: wire::LOSSLESS,
        device_uuid: [1; 16],
        driver_uuid: [2; 16],
        memories: wire::MEMORY_EXPORTED | wire::MEMORY_HOST | wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES,
        host_refused: None,
        timelines: wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED,
    }
}

fn motion_bytes(images: &Images) -> u64 {
    images.bytes().motion.expect("it has motion")
}

fn by(memory: u32, timeline: u32) -> Agreement {
    Agreement { version: Version::Two, memory, timeline, geometry: false }
}

/// Mostly what is likely to be right, sometimes anything.
fn likely<T: Copy + std::fmt::Debug + 'static>(
    right: impl Strategy<Value = T> + 'static,
    anything: impl Strategy<Value = T> + 'static,
) -> BoxedStrategy<T> {
    prop_oneof![8 => right, 1 => anything].boxed()
}

/// Bytes of the messages of each version, by kind; 0 where there is none of this size.
const SIZES: [[usize; 10]; 2] =
    [[0, 72, 144, 64, 16, 48, 32, 16, 280, 0], [0, 112, 248, 112, 16, 48, 32, 16, 280, 0]];

/// What may happen next to a session.
#[derive(Clone, Debug)]
enum Event {
    Message(Box<Message>, usize),
    /// The engine gives back the n-th slot that it holds.
    Release(usize),
}

fn frame() -> impl Strategy<Value = Event> {
    let slot = likely(0_u32..4, any::<u32>());
    let value = likely((0_u64..12).prop_map(|k| 2 * k + 1), any::<u64>());
    let t_ns = likely(0_i64..3_000_000_000, any::<i64>());
    let fds = likely(Just(0_usize), 0_usize..50);
    (slot, value, t_ns, any::<u32>(), fds).prop_map(|(slot, value, t_ns, device_copies, fds)| {
        let notice = FrameNotice { slot, value, t_ns, device_copies, ..FrameNotice::default() };
        Event::Message(Box::new(Message::Frame(notice)), fds)
    })
}

fn brought() -> impl Strategy<Value = Event> {
    let memory = |bytes: u64| {
        (likely(Just(bytes), any::<u64>()), likely(Just(4096_u64), any::<u64>())).prop_map(
            |(bytes, allocation_bytes)| ImageMemory { bytes, allocation_bytes, ..ImageMemory::default() },
        )
    };
    (memory(IMAGES.bytes().hdr), memory(motion_bytes(&IMAGES)), likely(Just(6_usize), 0_usize..50)).prop_map(
        |(hdr, motion, fds)| {
            Event::Message(Box::new(Message::Brought(Brought { hdr, motion, ..Brought::default() })), fds)
        },
    )
}

fn other() -> impl Strategy<Value = Event> {
    let messages = vec![
        Message::Hello(Hello::default()),
        Message::Ring(RingOffer::default()),
        Message::Accepted(Header::default()),
        Message::Released(Released::default()),
        Message::Bye(Header::default()),
        Message::Refusal(Refusal::new(ErrorCode::Memory, "no")),
    ];
    (proptest::sample::select(messages), likely(Just(0_usize), 0_usize..50))
        .prop_map(|(message, fds)| Event::Message(Box::new(message), fds))
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        12 => frame(),
        2 => brought(),
        1 => other(),
        8 => (0_usize..4).prop_map(Event::Release),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4096, failure_persistence: None, ..ProptestConfig::default() })]

    /// What is let through keeps every rule of the README, as a plain model of it sees it.
    #[test]
    fn only_frames_that_keep_the_rules_get_through(
        slots in 1_u32..4,
        memory in proptest::sample::select(vec![
            wire::MEMORY_EXPORTED,
            wire::MEMORY_BROUGHT,
            wire::MEMORY_IMAGES,
        ]),
        events in proptest::collection::vec(event(), 0..60),
    ) {
        let agreement = by(memory, wire::TIMELINE_CARRIED);
        let brings = agreement.brings();
        let mut session = Session::new(&terms(slots), agreement);
        let mut values = vec![0_u64; slots as usize];
        let (mut has_memory, mut ended, mut last_ns) = (!brings, false, None);
        for event in events {
            match event {
                Event::Release(n) => {
                    let held: Vec<usize> = (0..values.len()).filter(|&s| values[s] % 2 == 1).collect();
                    prop_assert_eq!(session.held(), held.len());
                    let Some(&slot) = held.get(n) else { continue };
                    values[slot] += 1;
                    prop_assert_eq!(session.release(slot as u32), values[slot]);
                }
                Event::Message(message, fds) => match session.receive(&message, fds) {
                    Ok(Action::Import(brought)) => {
                        prop_assert!(!has_memory && !ended && fds == 2 * slots as usize);
                        prop_assert_eq!(brought.hdr.bytes, IMAGES.bytes().hdr);
                        prop_assert_eq!(brought.motion.bytes, motion_bytes(&IMAGES));
                        // Nothing makes the engine take more than twice an image, or a small allocation.
                        prop_assert!(brought.hdr.allocation_bytes <= 4 << 20);
                        has_memory = true;
                    }
                    Ok(Action::Queue(notice, None)) => {
                        prop_assert!(has_memory && !ended && fds == 0 && notice.slot < slots);
                        let value = &mut values[notice.slot as usize];
                        prop_assert!(value.is_multiple_of(2) && notice.value == *value + 1);
                        *value = notice.value;
                        if let Some(last) = last_ns {
                            prop_assert!(notice.t_ns > last && notice.t_ns - last <= MAX_INTERVAL_NS);
                        }
                        last_ns = Some(notice.t_ns);
                    }
                    Ok(other @ (Action::Queue(..) | Action::Nothing)) => {
                        prop_assert!(false, "poses of a camera that takes none: {:?}", other);
                    }
                    Ok(Action::End) => {
                        prop_assert!(!ended && fds == 0);
                        ended = true;
                    }
                    // The connection is closed, and its session is gone.
                    Err(error) => {
                        prop_assert!(!error.to_string().is_empty());
                        break;
                    }
                },
            }
        }
    }

    /// Any bytes are a message that reads back as itself, or an error.
    #[test]
    fn any_bytes_parse_or_are_refused(
        mut bytes in proptest::collection::vec(any::<u8>(), 0..300),
        head in proptest::option::weighted(0.9, (0_u16..10, 0_u32..4)),
        version in proptest::sample::select(vec![Version::One, Version::Two]),
        whole in any::<bool>(),
        fds in 0_usize..4,
    ) {
        if let Some((kind, told)) = head {
            let size = SIZES[usize::from(version == Version::Two)][usize::from(kind)];
            if whole {
                bytes.resize(size, 7);
            }
            let header = Header {
                magic: wire::MAGIC,
                version: version as u16,
                kind,
                bytes: bytes.len() as u32,
                fds: told,
            };
            let count = bytes.len().min(16);
            bytes[..count].copy_from_slice(&bytemuck::bytes_of(&header)[..count]);
        }
        if let Ok(message) = Message::parse(version, &bytes, fds) {
            // What version 1 reserves is not kept.
            if let (Version::One, Some((kind @ (1 | 5), _))) = (version, head) {
                let at = if kind == 1 { 68 } else { 28 };
                bytes[at..at + 4].fill(0);
            }
            prop_assert_eq!(message.to_bytes(version, fds), bytes);
        } else if let Some((kind, told)) = head {
            prop_assert!(!whole || !(1..=8).contains(&kind) || told as usize != fds);
        }
    }

    /// Whatever is agreed, both sides have said.
    #[test]
    fn agreements_are_of_what_both_have(
        memories in any::<u32>(),
        timelines in any::<u32>(),
        same in any::<bool>(),
    ) {
        let terms = terms(3);
        let device_uuid = if same { terms.device_uuid } else { [9; 16] };
        let driver_uuid = terms.driver_uuid;
        let hello = Hello { device_uuid, driver_uuid, memories, timelines, ..Hello::default() };
        match agree(Version::Two, &hello, &terms) {
            Ok(Agreement { memory, timeline, .. }) => {
                prop_assert!(memory.is_power_of_two() && memory & memories & terms.memories != 0);
                prop_assert!(timeline.is_power_of_two() && timeline & timelines & terms.timelines != 0);
                prop_assert!(same || (memory == wire::MEMORY_HOST && timeline == wire::TIMELINE_CARRIED));
            }
            Err(error) => {
                let usable = if same { 15 } else { wire::MEMORY_HOST };
                let orders = if same { 3 } else { wire::TIMELINE_CARRIED };
                prop_assert!(memories & usable == 0 || timelines & orders == 0, "{}", error);
            }
        }
    }
}

#[test]
fn a_producer_on_another_device_shares_the_hosts_memory_or_is_told_both_names() {
    let other = Hello {
        device_uuid: [3; 16],
        driver_uuid: [2; 16],
        memories: wire::MEMORY_EXPORTED | wire::MEMORY_BROUGHT,
        timelines: wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED,
        ..Hello::default()
    };
    let error = agree(Version::Two, &other, &terms(3)).unwrap_err();
    assert_eq!(error.code(), ErrorCode::Device);
    let text = error.to_string();
    for uuid in ["03030303-0303-0303-0303-030303030303", "01010101-0101-0101-0101-010101010101"] {
        assert!(text.contains(uuid), "{text}");
    }
    // All of it is there for the producer to read.
    assert_eq!(Refusal::new(error.code(), &text).words(), text);
    let host = Hello { memories: other.memories | wire::MEMORY_HOST, ..other };
    let expected = by(wire::MEMORY_HOST, wire::TIMELINE_CARRIED);
    assert_eq!(agree(Version::Two, &host, &terms(3)).unwrap(), expected);
    let nothing = Hello { memories: 0, ..other };
    let text = agree(Version::Two, &nothing, &terms(3)).unwrap_err().to_string();
    assert!(text.contains("the producer has none, the engine EXPORTED, HOST, BROUGHT, IMAGES"), "{text}");
}

/// A producer that has everything, on the engine's device.
fn producer() -> Hello {
    let Terms { device_uuid, driver_uuid, memories, timelines, .. } = terms(3);
    Hello { device_uuid, driver_uuid, memories, timelines, ..Hello::default() }
}

/// CUDA knows its device, but no Vulkan driver.
#[test]
fn a_producer_without_a_vulkan_driver_is_on_the_device_that_it_names() {
    let cuda = Hello { driver_uuid: wire::NO_DRIVER, ..producer() };
    for memory in [wire::MEMORY_BROUGHT, wire::MEMORY_IMAGES, wire::MEMORY_EXPORTED] {
        let agreed = agree(Version::Two, &Hello { memories: memory, ..cuda }, &terms(3)).unwrap();
        assert_eq!(agreed, by(memory, wire::TIMELINE_EXPORTED));
    }
    let elsewhere = Hello { device_uuid: [3; 16], memories: wire::MEMORY_EXPORTED, ..cuda };
    let error = agree(Version::Two, &elsewhere, &terms(3)).unwrap_err();
    assert_eq!(error.code(), ErrorCode::Device);
    let text = error.to_string();
    assert!(text.contains("03030303-0303-0303-0303-030303030303, the engine on"), "{text}");
    assert!(text.contains("with driver 02020202-0202-0202-0202-020202020202"), "{text}");
}

#[test]
fn another_driver_of_the_same_device_shares_the_hosts_memory_alone() {
    let other = Hello { driver_uuid: [8; 16], ..producer() };
    let expected = by(wire::MEMORY_HOST, wire::TIMELINE_CARRIED);
    assert_eq!(agree(Version::Two, &other, &terms(3)).unwrap(), expected);
    let exported = Hello { memories: wire::MEMORY_EXPORTED, ..other };
    let error = agree(Version::Two, &exported, &terms(3)).unwrap_err();
    assert_eq!(error.code(), ErrorCode::Device);
    assert!(error.to_string().contains("with driver 08080808"), "{error}");
    // Timelines are a driver's own too.
    let exported = Hello { timelines: wire::TIMELINE_EXPORTED, ..other };
    assert_eq!(agree(Version::Two, &exported, &terms(3)).unwrap_err().code(), ErrorCode::Unsupported);
}

#[test]
fn the_best_memory_and_timeline_of_both_are_taken() {
    let order = [wire::MEMORY_BROUGHT, wire::MEMORY_IMAGES, wire::MEMORY_EXPORTED, wire::MEMORY_HOST];
    for first in 0..order.len() {
        let memories = order[first..].iter().sum();
        assert_eq!(
            agree(Version::Two, &Hello { memories, ..producer() }, &terms(3)).unwrap().memory,
            order[first]
        );
        // The engine's side limits it alike.
        let engine = Terms { memories, ..terms(3) };
        assert_eq!(agree(Version::Two, &producer(), &engine).unwrap().memory, order[first]);
    }
    assert_eq!(agree(Version::Two, &producer(), &terms(3)).unwrap().timeline, wire::TIMELINE_EXPORTED);
    let carried = Hello { timelines: wire::TIMELINE_CARRIED, ..producer() };
    assert_eq!(agree(Version::Two, &carried, &terms(3)).unwrap().timeline, wire::TIMELINE_CARRIED);
    let none = agree(Version::Two, &Hello { timelines: 4, ..producer() }, &terms(3)).unwrap_err();
    assert_eq!(none.code(), ErrorCode::Unsupported);
    assert!(none.to_string().contains("the producer has none, the engine CARRIED, EXPORTED"), "{none}");
    let none = agree(Version::Two, &Hello { memories: 16, ..producer() }, &terms(3)).unwrap_err();
    assert_eq!(none.code(), ErrorCode::Unsupported);
}

#[test]
fn a_producer_renders_the_rig_s_size_or_leaves_it_open() {
    for (width_px, height_px) in [(0, 0), (12, 9)] {
        agree(Version::Two, &Hello { width_px, height_px, ..producer() }, &terms(3)).unwrap();
    }
    for (width_px, height_px) in [(12, 0), (0, 9), (12, 8), (13, 9), (9, 12), (u32::MAX, u32::MAX)] {
        let error = agree(Version::Two, &Hello { width_px, height_px, ..producer() }, &terms(3)).unwrap_err();
        assert_eq!(error.code(), ErrorCode::Camera);
        assert!(error.to_string().contains(&format!("12x9 px in the rig, the producer renders {width_px}x")));
    }
}

#[test]
fn only_a_greeting_comes_first() {
    assert!(hello(&Message::Hello(producer())).is_ok());
    for message in [Message::Bye(Header::default()), Message::Accepted(Header::default())] {
        let error = hello(&message).unwrap_err();
        assert_eq!(error.code(), ErrorCode::Protocol);
        assert!(error.to_string().contains("came first, expected HELLO"), "{error}");
    }
}

fn session(memory: u32) -> Session {
    Session::new(&terms(3), by(memory, wire::TIMELINE_CARRIED))
}

fn notice(slot: u32, value: u64, t_ns: i64) -> Message {
    Message::Frame(FrameNotice { slot, value, t_ns, ..FrameNotice::default() })
}

#[test]
fn allocations_are_as_long_as_their_buffers_or_a_little_longer() {
    // Large enough that twice the image is more than the small allocation that is always allowed.
    let images = Images { width_px: 1024, height_px: 1024, ..IMAGES };
    let large = Terms { images, ..terms(1) };
    let agreement = by(wire::MEMORY_BROUGHT, wire::TIMELINE_CARRIED);
    let (hdr, motion) = (images.bytes().hdr, motion_bytes(&images));
    assert_eq!((hdr, motion), (8 << 20, 4 << 20));
    let brings = |bytes: [u64; 2], allocations: [u64; 2], fds: usize| {
        let memory = |i: usize| ImageMemory {
            bytes: bytes[i],
            allocation_bytes: allocations[i],
            ..ImageMemory::default()
        };
        let brought = Brought { hdr: memory(0), motion: memory(1), ..Brought::default() };
        Session::new(&large, agreement).receive(&Message::Brought(brought), fds)
    };
    let right = [hdr, motion];
    for allocations in [right, [2 * hdr, motion], [hdr, 2 * motion]] {
        brings(right, allocations, 2).unwrap();
    }
    for allocations in [[hdr - 1, motion], [2 * hdr + 1, motion], [hdr, motion - 1], [hdr, 2 * motion + 1]] {
        assert_eq!(brings(right, allocations, 2).unwrap_err().code(), ErrorCode::Memory, "{allocations:?}");
    }
    for bytes in [[hdr - 1, motion], [hdr + 1, motion], [hdr, motion - 1], [hdr, motion + 1]] {
        assert_eq!(
            brings(bytes, [2 * hdr, 2 * motion], 2).unwrap_err().code(),
            ErrorCode::Memory,
            "{bytes:?}"
        );
    }
    for fds in [0, 1, 3] {
        assert_eq!(brings(right, right, fds).unwrap_err().code(), ErrorCode::Protocol);
    }
    // A small image may lie in a page, or in what CUDA allocates at least.
    let small = |allocation_bytes| {
        let hdr = ImageMemory { bytes: IMAGES.bytes().hdr, allocation_bytes, ..ImageMemory::default() };
        let motion = ImageMemory { bytes: motion_bytes(&IMAGES), ..hdr };
        let brought = Brought { hdr, motion, ..Brought::default() };
        session(wire::MEMORY_BROUGHT).receive(&Message::Brought(brought), 6)
    };
    small(4 << 20).unwrap();
    assert_eq!(small((4 << 20) + 1).unwrap_err().code(), ErrorCode::Memory);
    // Without motion nothing is asked of it.
    let without = Terms { images: Images { motion: None, ..images }, ..large };
    let memory = ImageMemory { bytes: hdr, allocation_bytes: hdr, ..ImageMemory::default() };
    let brought = Brought { hdr: memory, ..Brought::default() };
    Session::new(&without, agreement).receive(&Message::Brought(brought), 1).unwrap();
}

#[test]
fn times_reach_to_their_bounds_and_no_further() {
    const MOST: i64 = 1 << 62;
    for t_ns in [-MOST, MOST] {
        session(wire::MEMORY_HOST).receive(&notice(0, 1, t_ns), 0).unwrap();
    }
    for t_ns in [-MOST - 1, MOST + 1, i64::MIN, i64::MAX] {
        let error = session(wire::MEMORY_HOST).receive(&notice(0, 1, t_ns), 0).unwrap_err();
        assert_eq!(error.code(), ErrorCode::Time);
    }
    for (t_ns, is_right) in
        [(1, true), (MAX_INTERVAL_NS, true), (MAX_INTERVAL_NS + 1, false), (0, false), (-1, false)]
    {
        let mut session = session(wire::MEMORY_HOST);
        session.receive(&notice(0, 1, 0), 0).unwrap();
        let second = session.receive(&notice(1, 1, t_ns), 0);
        assert_eq!(
            second.map_err(|error| error.code()).err(),
            (!is_right).then_some(ErrorCode::Time),
            "{t_ns}"
        );
    }
}

#[test]
fn slots_are_the_producer_s_and_the_engine_s_in_turn() {
    let mut session = session(wire::MEMORY_HOST);
    assert_eq!(session.held(), 0);
    for (slot, value, code) in [
        (3, 1, ErrorCode::Protocol),
        (0, 0, ErrorCode::Value),
        (0, 2, ErrorCode::Value),
        (0, 3, ErrorCode::Value),
    ] {
        assert_eq!(session.receive(&notice(slot, value, 0), 0).unwrap_err().code(), code);
    }
    session.receive(&notice(2, 1, 0), 0).unwrap();
    assert_eq!(session.held(), 1);
    // It has not been given back.
    assert_eq!(session.receive(&notice(2, 3, 1), 0).unwrap_err().code(), ErrorCode::Protocol);
    assert_eq!((session.release(2), session.held()), (2, 0));
    assert_eq!(session.receive(&notice(2, 1, 1), 0).unwrap_err().code(), ErrorCode::Value);
    session.receive(&notice(2, 3, 1), 0).unwrap();
    assert_eq!(session.release(2), 4);
}

#[test]
#[should_panic(expected = "slot 1 is the producer's")]
fn the_engine_gives_back_only_what_it_was_given() {
    session(wire::MEMORY_HOST).release(1);
}

#[test]
fn nothing_comes_after_a_goodbye_and_no_message_has_descriptors_that_nobody_asked_for() {
    let bye = Message::Bye(Header::default());
    for memory in [wire::MEMORY_HOST, wire::MEMORY_BROUGHT] {
        assert_eq!(session(memory).receive(&bye, 1).unwrap_err().code(), ErrorCode::Protocol);
        let mut session = session(memory);
        assert_eq!(session.receive(&bye, 0).unwrap(), Action::End);
        for message in [bye.clone(), notice(0, 1, 0), Message::Brought(Brought::default())] {
            let error = session.receive(&message, 0).unwrap_err();
            assert_eq!(error.code(), ErrorCode::Protocol);
            assert!(error.to_string().ends_with("came after BYE"), "{error}");
        }
    }
    assert_eq!(
        session(wire::MEMORY_HOST).receive(&notice(0, 1, 0), 1).unwrap_err().code(),
        ErrorCode::Protocol
    );
    let error = session(wire::MEMORY_BROUGHT).receive(&notice(0, 1, 0), 0).unwrap_err();
    assert!(error.to_string().ends_with("FRAME came while BROUGHT was awaited"), "{error}");
    let error = session(wire::MEMORY_HOST).receive(&Message::Brought(Brought::default()), 6).unwrap_err();
    assert!(error.to_string().ends_with("BROUGHT came between frames"), "{error}");
    let gone = Message::Refusal(Refusal::new(ErrorCode::Time, "no clock"));
    let error = session(wire::MEMORY_HOST).receive(&gone, 0).unwrap_err();
    assert_eq!((error.code(), error.words()), (ErrorCode::Time, "the producer says: no clock".to_owned()));
}

/// A shared timeline says what the peer lets it say.
#[test]
fn a_timeline_beyond_what_was_told_is_an_error() {
    assert!(!is_written(0, 3, 2).unwrap() && !is_written(0, 3, 0).unwrap());
    assert!(is_written(0, 3, 3).unwrap());
    for reached in [4, 5, u64::MAX] {
        let error = is_written(1, 3, reached).unwrap_err();
        assert_eq!(error.code(), ErrorCode::Value);
        assert_eq!(error.to_string(), format!("slot 1: timeline value {reached}, expected 3"));
    }
    may_release(1, 4, 3).unwrap();
    for reached in [0, 2, 4, 5, u64::MAX] {
        let error = may_release(1, 4, reached).unwrap_err();
        assert_eq!(error.to_string(), format!("slot 1: timeline value {reached}, expected 3"));
    }
}

/// The protocol's numbers, as producers in other languages have them.
#[test]
fn headers_are_those_of_their_version() {
    let messages = [
        (Message::Hello(Hello::default()), 1_u16, "HELLO"),
        (Message::Ring(RingOffer::default()), 2, "RING"),
        (Message::Brought(Brought::default()), 3, "BROUGHT"),
        (Message::Accepted(Header::default()), 4, "ACCEPTED"),
        (Message::Frame(FrameNotice::default()), 5, "FRAME"),
        (Message::Released(Released::default()), 6, "RELEASED"),
        (Message::Bye(Header::default()), 7, "BYE"),
        (Message::Refusal(Refusal::new(ErrorCode::Busy, "")), 8, "ERROR"),
    ];
    for (version, sizes) in [Version::One, Version::Two].into_iter().zip(SIZES) {
        for (message, kind, name) in &messages {
            let sent = message.to_bytes(version, 2);
            let bytes = sizes[usize::from(*kind)] as u32;
            let expected = [
                &b"ESIP"[..],
                &(version as u16).to_ne_bytes(),
                &kind.to_ne_bytes(),
                &bytes.to_ne_bytes(),
                &2_u32.to_ne_bytes(),
            ];
            assert_eq!(&sent[..16], expected.concat(), "{name}");
            assert_eq!((sent.len(), message.name()), (bytes as usize, *name));
            // A header that lies about its size.
            let mut lying = sent.clone();
            lying[8] ^= 1;
            let error = Message::parse(version, &lying, 2).unwrap_err();
            assert_eq!(error.to_string(), format!("{name} of {} bytes, expected {bytes}", bytes ^ 1));
            assert_eq!(error.code(), ErrorCode::Protocol);
            for fds in [1, 3] {
                let error = Message::parse(version, &sent, fds).unwrap_err().to_string();
                assert_eq!(error, format!("{name} with {fds} descriptors, expected 2"));
            }
        }
        let mut none = Message::Bye(Header::default()).to_bytes(version, 0);
        let last = if version == Version::One { 8 } else { 9 };
        for kind in [0, last + 1] {
            none[6] = kind;
            let error = Message::parse(version, &none, 0).unwrap_err().to_string();
            assert_eq!(error, format!("message kind {kind}, expected 1 to {last}"));
        }
        none[4] = 3;
        assert_eq!(Message::parse(version, &none, 0).unwrap_err().code(), ErrorCode::Version);
    }
    assert_eq!((wire::MAX_FDS, wire::MAX_BYTES), (80, 65_536));
    assert_eq!(wire::memory_names(15), "EXPORTED, HOST, BROUGHT, IMAGES");
    assert_eq!(wire::timeline_names(2), "EXPORTED");
}
