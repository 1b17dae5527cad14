//! The engine's side of the protocol under every sequence of messages that a generator can think of.

use esaac_interop::Images;
use esaac_interop::session::{Action, Agreement, Session, Terms, agree};
use esaac_interop::wire::{
    self, Brought, ErrorCode, FrameNotice, Header, Hello, ImageMemory, Message, Refusal, Released, RingOffer,
};
use esaac_model::{HdrFormat, MAX_INTERVAL_NS, MotionFormat};
use proptest::prelude::*;

const IMAGES: Images =
    Images { width_px: 12, height_px: 9, hdr: HdrFormat::F16x4, motion: Some(MotionFormat::F16x2) };

fn terms(slots: u32) -> Terms {
    Terms {
        camera: 0,
        images: IMAGES,
        slots,
        backpressure: wire::LOSSLESS,
        device_uuid: [1; 16],
        driver_uuid: [2; 16],
        memories: wire::MEMORY_EXPORTED | wire::MEMORY_HOST | wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES,
        timelines: wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED,
    }
}

/// Mostly what is likely to be right, sometimes anything.
fn likely<T: Copy + std::fmt::Debug + 'static>(
    right: impl Strategy<Value = T> + 'static,
    anything: impl Strategy<Value = T> + 'static,
) -> BoxedStrategy<T> {
    prop_oneof![8 => right, 1 => anything].boxed()
}

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
    (memory(IMAGES.hdr_bytes()), memory(IMAGES.motion_bytes()), likely(Just(6_usize), 0_usize..50)).prop_map(
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
        let agreement = Agreement { memory, timeline: wire::TIMELINE_CARRIED };
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
                        prop_assert_eq!(brought.hdr.bytes, IMAGES.hdr_bytes());
                        prop_assert_eq!(brought.motion.bytes, IMAGES.motion_bytes());
                        // Nothing makes the engine take more than twice an image, or a small allocation.
                        prop_assert!(brought.hdr.allocation_bytes <= 4 << 20);
                        has_memory = true;
                    }
                    Ok(Action::Queue(notice)) => {
                        prop_assert!(has_memory && !ended && fds == 0 && notice.slot < slots);
                        let value = &mut values[notice.slot as usize];
                        prop_assert!(value.is_multiple_of(2) && notice.value == *value + 1);
                        *value = notice.value;
                        if let Some(last) = last_ns {
                            prop_assert!(notice.t_ns > last && notice.t_ns - last <= MAX_INTERVAL_NS);
                        }
                        last_ns = Some(notice.t_ns);
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
        whole in any::<bool>(),
        fds in 0_usize..4,
    ) {
        if let Some((kind, told)) = head {
            let size = [0, 72, 144, 64, 16, 48, 32, 16, 280, 0][usize::from(kind)];
            if whole {
                bytes.resize(size, 7);
            }
            let header = Header {
                magic: wire::MAGIC,
                version: wire::VERSION,
                kind,
                bytes: bytes.len() as u32,
                fds: told,
            };
            let count = bytes.len().min(16);
            bytes[..count].copy_from_slice(&bytemuck::bytes_of(&header)[..count]);
        }
        if let Ok(message) = Message::parse(&bytes, fds) {
            prop_assert_eq!(message.to_bytes(fds), bytes);
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
        match agree(&hello, &terms) {
            Ok(Agreement { memory, timeline }) => {
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
    let error = agree(&other, &terms(3)).unwrap_err();
    assert_eq!(error.code(), ErrorCode::Device);
    let text = error.to_string();
    for uuid in ["03030303-0303-0303-0303-030303030303", "01010101-0101-0101-0101-010101010101"] {
        assert!(text.contains(uuid), "{text}");
    }
    // All of it is there for the producer to read.
    assert_eq!(Refusal::new(error.code(), &text).words(), text);
    let host = Hello { memories: other.memories | wire::MEMORY_HOST, ..other };
    let expected = Agreement { memory: wire::MEMORY_HOST, timeline: wire::TIMELINE_CARRIED };
    assert_eq!(agree(&host, &terms(3)).unwrap(), expected);
    let nothing = Hello { memories: 0, ..other };
    let text = agree(&nothing, &terms(3)).unwrap_err().to_string();
    assert!(text.contains("the producer has none, the engine EXPORTED, HOST, BROUGHT, IMAGES"), "{text}");
}
