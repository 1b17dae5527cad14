//! Limits: dispatches too large for the device, a device without a clock, more events than 32 bits count.

use crate::operations::{flashing, sequences};
use esaac_engine::{
    CameraConfig, Device, DeviceChoice, EngineError, FrameBytes, Restrictions, Rig, RigOptions, Validation,
};
use esaac_model::{HdrFormat, SensorModel};
use esaac_tests::device::{DEVICE, alone, assert_silent};
use esaac_tests::drivers::in_a_process_of_its_own;
use std::sync::Arc;

#[test]
fn a_camera_with_more_workgroups_than_the_device_takes_is_refused_with_numbers() {
    let restrictions = Restrictions { most_groups: 3, ..Restrictions::default() };
    let device =
        Device::open_restricted(DeviceChoice::Best, Validation::Off, restrictions).expect("a device");
    let config = |width| CameraConfig {
        sensor: SensorModel { width, height: 8, ..flashing() },
        camera: 0,
        hdr: HdrFormat::F32x4,
        motion: None,
        geometry: None,
    };
    Rig::new(&device, &[config(32)]).expect("one tile, which `cross` may take in two parts");
    let error = Rig::new(&device, &[config(32), config(64)]).map(|_| ()).unwrap_err();
    let words = error.to_string();
    for word in ["camera 1", "4 workgroups", "at most 3", &device.info().name] {
        assert!(words.contains(word), "{word} in: {words}");
    }
    assert!(matches!(error, EngineError::TooManyGroups { expected: 3, actual: 4, .. }));
}

#[test]
fn a_rig_with_larger_buffers_than_the_device_shows_is_refused_with_numbers() {
    let restrictions = Restrictions { most_storage_bytes: 1 << 20, ..Restrictions::default() };
    let device =
        Device::open_restricted(DeviceChoice::Best, Validation::Off, restrictions).expect("a device");
    let config = |width, height| CameraConfig {
        sensor: SensorModel { width, height, ..flashing() },
        camera: 0,
        hdr: HdrFormat::F32x4,
        motion: None,
        geometry: None,
    };
    Rig::new(&device, &[config(64, 48)]).expect("small buffers");
    let error = Rig::new(&device, &[config(640, 480)]).map(|_| ()).unwrap_err();
    let words = error.to_string();
    for word in ["at most 1048576", "rigs of their own"] {
        assert!(words.contains(word), "{word} in: {words}");
    }
}

#[test]
fn a_device_without_a_clock_gives_the_same_events_and_no_times() {
    let name = "limits::a_device_without_a_clock_gives_the_same_events_and_no_times";
    if !in_a_process_of_its_own(name, None) {
        return;
    }
    let restrictions = Restrictions { no_timestamps: true, ..Restrictions::default() };
    let device = Device::open_restricted(DeviceChoice::Best, Validation::from_env(), restrictions);
    let device = device.expect("a device");
    let steps = |device: &Arc<Device>, stage_times| {
        let sensor = flashing();
        let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: None };
        let options = RigOptions { stage_times, initial_events: 64, ..RigOptions::default() };
        let mut rig = Rig::with_options(device, &[config], options).expect("a rig");
        let frames = &sequences()[0].frames[..3];
        let step = |frame: &esaac_tests::frames::Frame| {
            rig.upload(0, &FrameBytes { hdr: &frame.hdr, motion: None, ..FrameBytes::default() })
                .expect("a frame");
            let tick = rig.step(&[frame.t_ns]).expect("a step");
            (tick.packets.to_vec(), tick.gpu_ns(), tick.stage_ns.len())
        };
        frames.iter().map(step).collect::<Vec<_>>()
    };
    let timed = steps(&DEVICE, true);
    for stage_times in [false, true] {
        let untimed = steps(&device, stage_times);
        for (timed, untimed) in timed.iter().zip(untimed) {
            assert_eq!((timed.0 == untimed.0, untimed.1, untimed.2), (true, None, 0));
            assert!(timed.1.is_some() && timed.2 > 1);
        }
    }
    assert_eq!(device.validation_messages(), [""; 0]);
}

#[test]
fn event_counts_do_not_wrap_at_32_bits() {
    let _alone = alone();
    // Five events per pixel, and twenty, with which the event queue of `cross` overflows. The count starts a little
    // below 2^32, so that the events of the last tiles would wrap it.
    for (contrast, before) in [(0.79, u32::MAX - 700), (0.2, u32::MAX - 3000)] {
        let sensor = SensorModel { contrast_on: contrast, contrast_off: contrast, ..flashing() };
        let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: None };
        let mut rig = Rig::new(&DEVICE, &[config]).expect("a rig");
        let frames = &sequences()[0].frames;
        rig.upload(0, &FrameBytes { hdr: &frames[0].hdr, motion: None, ..FrameBytes::default() })
            .expect("a frame");
        rig.step(&[frames[0].t_ns]).expect("a first frame");
        rig.count_events_from(0, before).expect("a rig at rest");
        rig.upload(0, &FrameBytes { hdr: &frames[1].hdr, motion: None, ..FrameBytes::default() })
            .expect("a frame");
        let error = rig.step(&[frames[1].t_ns]).map(|_| ()).expect_err("more events than there is room for");
        let words = error.to_string();
        assert!(words.contains("no device memory") && words.contains("4294967295"), "{words}");
        drop(rig);
    }
    assert_silent();
}
