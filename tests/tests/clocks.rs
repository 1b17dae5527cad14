//! The device's time on the host's clock: what a tick's stages say must fit into what the host saw.

use esaac_engine::{CameraConfig, FrameBytes, Rig, RigOptions};
use esaac_model::{HdrFormat, SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};
use std::time::{Duration, Instant};

fn rig(stage_times: bool) -> Rig {
    let sensor =
        SensorModel { width: 64, height: 48, synthesis: Synthesis::Linear, ..SensorModel::default() };
    let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None };
    Rig::with_options(&DEVICE, &[config], RigOptions { stage_times, ..RigOptions::default() }).unwrap()
}

fn frame(index: usize) -> Vec<u8> {
    (0..64 * 48).flat_map(|i| [((i + index) % 17) as f32; 4]).flat_map(f32::to_le_bytes).collect()
}

#[test]
fn stages_ran_within_the_tick_that_the_host_saw_and_one_after_the_other() {
    for stage_times in [true, false] {
        let mut rig = rig(stage_times);
        for index in 0..4 {
            rig.upload(0, &FrameBytes { hdr: &frame(index), motion: None }).unwrap();
            let before = Instant::now();
            let told = rig.step(&[index as i64 * 1_000_000]).unwrap().stage_ns.to_vec();
            let after = Instant::now();
            let (spans, deviation) = rig
                .stage_host_times()
                .unwrap()
                .expect("drivers of today have VK_EXT_calibrated_timestamps; this one does not");
            // What ran again is no stage of the tick.
            let named = told.iter().map(|(stage, _)| *stage).filter(|stage| *stage != "again");
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

#[test]
fn two_calibrations_agree_on_how_much_time_has_passed() {
    let first = DEVICE.calibrate().unwrap().expect("a device with calibrated time stamps");
    std::thread::sleep(Duration::from_millis(50));
    let second = DEVICE.calibrate().unwrap().expect("a device with calibrated time stamps");
    let by_device = Duration::from_nanos(DEVICE.timestamp_span_ns(first.stamp, second.stamp));
    let by_host = second.host - first.host;
    let apart = by_device.abs_diff(by_host);
    let bound = first.deviation + second.deviation + Duration::from_micros(100);
    assert!(apart <= bound, "device {by_device:?}, host {by_host:?}, allowed {bound:?}");
    // A stamp of the past lies where the host was then.
    let then = DEVICE.host_time(&second, first.stamp).unwrap();
    let off = then.max(first.host) - then.min(first.host);
    assert!(off <= bound, "{off:?}");
}
