//! A connection as a hostile producer fills it: packets of any bytes with any number of descriptors,
//! while the engine gives slots back. `cargo fuzz run session` in `interop`.
#![no_main]

use esaac_interop::Images;
use esaac_interop::session::{Action, Session, Terms, agree, hello};
use esaac_interop::wire::{self, Message};
use esaac_model::{HdrFormat, MotionFormat};
use libfuzzer_sys::fuzz_target;

const TERMS: Terms = Terms {
    camera: 0,
    images: Images { width_px: 12, height_px: 9, hdr: HdrFormat::F16x4, motion: Some(MotionFormat::F16x2) },
    slots: 3,
    backpressure: wire::LOSSLESS,
    device_uuid: [1; 16],
    driver_uuid: [2; 16],
    memories: wire::MEMORY_EXPORTED | wire::MEMORY_HOST | wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES,
    timelines: wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED,
};

/// The next packet of the input: its length, its descriptors, a slot to give back after it, its bytes.
fn packet<'a>(input: &mut &'a [u8]) -> Option<(usize, u32, &'a [u8])> {
    let (&[length, fds, slot], rest) = input.split_first_chunk()?;
    let (bytes, rest) = rest.split_at(usize::from(length).min(rest.len()));
    *input = rest;
    Some((usize::from(fds), u32::from(slot), bytes))
}

fuzz_target!(|input: &[u8]| {
    let mut input = input;
    let Some((fds, _, bytes)) = packet(&mut input) else { return };
    let Ok(first) = Message::parse(bytes, fds) else { return };
    let Ok(greeting) = hello(&first) else { return };
    let Ok(agreement) = agree(greeting, &TERMS) else { return };
    let mut session = Session::new(&TERMS, agreement);
    let mut values = [0_u64; 3];
    while let Some((fds, slot, bytes)) = packet(&mut input) {
        let Ok(message) = Message::parse(bytes, fds) else { return };
        match session.receive(&message, fds) {
            Ok(Action::Queue(notice)) => {
                let value = &mut values[notice.slot as usize];
                assert!(value.is_multiple_of(2) && notice.value == *value + 1 && notice.t_ns.abs() <= 1 << 62);
                *value = notice.value;
            }
            Ok(Action::Import(brought)) => assert!(brought.hdr.allocation_bytes <= 4 << 20),
            Ok(Action::End) => {}
            Err(_) => return,
        }
        if let Some(value) = values.get_mut(slot as usize).filter(|value| !value.is_multiple_of(2)) {
            *value += 1;
            assert_eq!(session.release(slot), *value);
        }
    }
});
