//! A connection as a hostile producer fills it: packets of any bytes with any number of descriptors,
//! while the engine gives slots back. `cargo fuzz run session` in `interop`.
#![no_main]

use esaac_engine::GeometryConfig;
use esaac_interop::Images;
use esaac_interop::session::{Action, Session, Terms, agree, hello};
use esaac_interop::wire::{self, Message, Version};
use esaac_model::paths::Intrinsics;
use esaac_model::{DepthFormat, HdrFormat, IdFormat, MotionFormat};
use libfuzzer_sys::fuzz_target;

/// A camera that takes depth and poses from those that give them.
fn terms() -> Terms {
    let lens = Intrinsics::pinhole(20.0, 20.0, 5.5, 4.0).expect("a lens");
    let geometry = GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U32), lens };
    Terms {
        camera: 0,
        images: Images {
            width_px: 12,
            height_px: 9,
            hdr: HdrFormat::F16x4,
            motion: Some(MotionFormat::F16x2),
            geometry: Some(geometry),
        },
        requires_geometry: false,
        max_instances: 4,
        slots: 3,
        backpressure: wire::LOSSLESS,
        device_uuid: [1; 16],
        driver_uuid: [2; 16],
        memories: wire::MEMORY_EXPORTED | wire::MEMORY_HOST | wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES,
        host_refused: None,
        timelines: wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED,
    }
}

/// The next packet of the input: its length in two bytes, its descriptors, a slot to give back after it, its bytes.
fn packet<'a>(input: &mut &'a [u8]) -> Option<(usize, u32, &'a [u8])> {
    let (&[low, high, fds, slot], rest) = input.split_first_chunk()?;
    let length = u16::from_le_bytes([low, high]);
    let (bytes, rest) = rest.split_at(usize::from(length).min(rest.len()));
    *input = rest;
    Some((usize::from(fds), u32::from(slot), bytes))
}

fuzz_target!(|input: &[u8]| {
    let mut input = input;
    let Some((fds, _, bytes)) = packet(&mut input) else { return };
    let Ok(version) = Version::of(bytes) else { return };
    let Ok(first) = Message::parse(version, bytes, fds) else { return };
    let Ok(greeting) = hello(&first) else { return };
    let Ok(agreement) = agree(version, greeting, &terms()) else { return };
    let mut session = Session::new(&terms(), agreement);
    let mut values = [0_u64; 3];
    while let Some((fds, slot, bytes)) = packet(&mut input) {
        let Ok(message) = Message::parse(version, bytes, fds) else { return };
        match session.receive(&message, fds) {
            Ok(Action::Queue(notice, scene)) => {
                assert_eq!(scene.is_some(), agreement.geometry);
                if let Some(scene) = scene {
                    assert!(scene.from_ns <= scene.to_ns && scene.to_ns == notice.t_ns);
                    assert!(scene.motion.ids().count() <= 4);
                    for t_ns in [scene.from_ns, scene.from_ns.midpoint(scene.to_ns), scene.to_ns] {
                        let pose = scene.motion.camera().at(t_ns).expect("poses that span the interval");
                        assert!(pose.translation_m().is_finite() && pose.rotation().is_finite());
                    }
                }
                let value = &mut values[notice.slot as usize];
                assert!(value.is_multiple_of(2) && notice.value == *value + 1 && notice.t_ns.abs() <= 1 << 62);
                *value = notice.value;
            }
            Ok(Action::Import(brought)) => assert!(brought.hdr.allocation_bytes <= 4 << 20),
            Ok(Action::Nothing | Action::End) => {}
            Err(_) => return,
        }
        if let Some(value) = values.get_mut(slot as usize).filter(|value| !value.is_multiple_of(2)) {
            *value += 1;
            assert_eq!(session.release(slot), *value);
        }
    }
});
