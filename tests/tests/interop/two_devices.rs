//! Several devices. A device is chosen by its UUID. A producer on a device other than the engine's uses host memory, or
//! is refused with the names of both devices. Uses two devices of the machine if there are two, otherwise the software
//! driver twice.

use crate::connections::one_frame_goes_through;
use crate::drivers::few_frames_go_through;
use crate::faults::engine;
use esaac_engine::{Device, DeviceChoice, DeviceInfo, Validation, list_devices};
use esaac_interop::wire::{ErrorCode, MEMORY_EXPORTED, MEMORY_HOST, TIMELINE_CARRIED};
use esaac_interop::{InteropError, ProducerOptions};
use esaac_tests::device::DEVICE;
use esaac_tests::drivers::{OtherDriver, in_a_process_of_its_own};
use esaac_tests::interop::{Place, Uploader};

fn suitable() -> Vec<DeviceInfo> {
    list_devices().unwrap().into_iter().filter(|device| device.suitable).collect()
}

#[test]
fn a_producer_on_another_device_goes_by_the_host_or_is_told_both_names() {
    let name = "two_devices::a_producer_on_another_device_goes_by_the_host_or_is_told_both_names";
    let several = suitable().iter().any(|device| device.uuid != DEVICE.info().uuid);
    let twice = OtherDriver { twice: true, ..OtherDriver::default() };
    if !in_a_process_of_its_own(name, (!several).then_some(&twice)) {
        return;
    }
    let devices = suitable();
    let other = devices.iter().find(|device| device.uuid != DEVICE.info().uuid).expect("two devices");
    println!(
        "engine on {} {}, producer on {} {}",
        DEVICE.info().index,
        DEVICE.info().name,
        other.index,
        other.name
    );
    for info in [DEVICE.info(), other] {
        let opened = Device::open(DeviceChoice::Uuid(info.uuid), Validation::Off).unwrap();
        assert_eq!((opened.info().uuid, opened.info().index), (info.uuid, info.index));
    }
    let device = Device::open(DeviceChoice::Uuid(other.uuid), Validation::from_env()).unwrap();

    let place = Place::default();
    let server = engine(&place);
    let options = ProducerOptions { memories: MEMORY_EXPORTED, ..ProducerOptions::default() };
    let error = match Uploader::connect(&device, &place.path(), &options) {
        Ok(_) => panic!("memory of one device on another"),
        Err(error) => error,
    };
    assert!(matches!(&error, InteropError::Refused { code: ErrorCode::Device, .. }), "{error}");
    let text = error.to_string();
    for uuid in [DEVICE.info().uuid, other.uuid] {
        assert!(text.contains(&DeviceChoice::Uuid(uuid).to_string()), "{text}");
    }
    assert!(text.contains("start both on one device"), "{text}");
    one_frame_goes_through(&server, &place);

    let went = few_frames_go_through(&device, &ProducerOptions::default());
    assert_eq!(went, (MEMORY_HOST, TIMELINE_CARRIED));
}
