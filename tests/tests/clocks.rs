//! Device times on the host's clock: the stages of a tick must lie within the times that the host measured around it. A
//! driver without calibrated time stamps has no such times, and the engine reports that.

use esaac_engine::{CameraConfig, FrameBytes, Rig, RigOptions};
use esaac_model::{HdrFormat, SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::drivers::{OtherDriver, in_a_process_of_its_own};
use std::time::{Duration, Instant};

const EXTENSION: &str = "VK_EXT_calibrated_timestamps";

fn rig(stage_times: bool) -> Rig {
    let sensor =
        SensorModel { width: 64, height: 48, synthesis: Synthesis::Linear, ..SensorModel::default() };
    let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: None };
    Rig::with_options(&DEVICE, &[config], RigOptions { stage_times, ..RigOptions::default() }).unwrap()
}

fn frame(index: usize) -> Vec<u8> {
    (0..64 * 48).flat_map(|i| [((i + index) % 17) as f32; 4]).flat_map(f32::to_le_bytes).collect()
}

#[test]
fn stages_ran_within_the_tick_that_the_host_saw_and_one_after_the_other() {
    if !DEVICE.info().has(EXTENSION) {
        no_host_times();
        return;
    }
    for stage_times in [true, false] {
        let mut rig = rig(stage_times);
        for index in 0..4 {
            rig.upload(0, &FrameBytes { hdr: &frame(index), motion: None, ..FrameBytes::default() }).unwrap();
            let before = Instant::now();
            let told = rig.step(&[index as i64 * 1_000_000]).unwrap().stage_ns.to_vec();
            let after = Instant::now();
            let (spans, deviation) =
                rig.stage_host_times().unwrap().expect("the driver has calibrated time stamps");
            // `retry` is no stage of its own.
            let named = told.iter().map(|(stage, _)| *stage).filter(|stage| *stage != "retry");
            assert!(spans.iter().map(|span| span.stage).eq(named), "{spans:?}");
            assert!(deviation < Duration::from_millis(5), "{deviation:?}");
            assert!(spans[0].start + deviation >= before, "{spans:?} before {before:?}");
            assert!(spans[spans.len() - 1].end <= after + deviation, "{spans:?} after {after:?}");
            let in_order = |s: &esaac_engine::StageSpan| s.start <= s.end;
            assert!(spans.iter().all(in_order), "{spans:?}");
            assert!(spans.windows(2).all(|pair| pair[0].end == pair[1].start), "{spans:?}");
        }
    }
    assert_silent();
}

/// Asserts the behaviour on a driver without the extension.
fn no_host_times() {
    assert!(DEVICE.calibrate().unwrap().is_none());
    let mut rig = rig(true);
    for index in 0..3 {
        rig.upload(0, &FrameBytes { hdr: &frame(index), motion: None, ..FrameBytes::default() }).unwrap();
        let tick = rig.step(&[index as i64 * 1_000_000]).unwrap();
        assert_eq!(tick.packets[0].is_empty(), index == 0, "frame {index}");
        assert!(!tick.stage_ns.is_empty(), "durations need no calibration");
        assert!(rig.stage_host_times().unwrap().is_none());
    }
    assert_silent();
}

#[test]
fn without_calibrated_time_stamps_ticks_have_events_and_no_host_times() {
    let driver = OtherDriver { lacks: &[EXTENSION], ..OtherDriver::default() };
    let name = "without_calibrated_time_stamps_ticks_have_events_and_no_host_times";
    if !in_a_process_of_its_own(name, Some(&driver)) {
        return;
    }
    assert!(!DEVICE.info().has(EXTENSION));
    no_host_times();
}

#[test]
fn two_calibrations_agree_on_how_much_time_has_passed() {
    if !DEVICE.info().has(EXTENSION) {
        no_host_times();
        return;
    }
    let first = DEVICE.calibrate().unwrap().expect("a device with calibrated time stamps");
    std::thread::sleep(Duration::from_millis(50));
    let second = DEVICE.calibrate().unwrap().expect("a device with calibrated time stamps");
    let by_device = Duration::from_nanos(DEVICE.timestamp_span_ns(first.stamp, second.stamp));
    let by_host = second.host - first.host;
    let apart = by_device.abs_diff(by_host);
    let bound = first.deviation + second.deviation + Duration::from_micros(100);
    assert!(apart <= bound, "device {by_device:?}, host {by_host:?}, allowed {bound:?}");
    // An earlier device stamp maps to the host's time at that stamp.
    let then = DEVICE.host_time(&second, first.stamp).unwrap();
    let off = then.max(first.host) - then.min(first.host);
    assert!(off <= bound, "{off:?}");
}
