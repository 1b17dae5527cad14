//! A profiler connects to the linked client and reads zones, plots and messages.
#![cfg(feature = "tracy")]

use esaac_benches::tracy_peer::Peer;
use esaac_engine::{CameraConfig, FrameBytes, Rig, RigOptions};
use esaac_model::{HdrFormat, SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};

#[test]
fn a_profiler_is_welcomed_and_gets_stages_messages_and_the_devices_name() {
    let sensor = SensorModel {
        width: 32,
        height: 16,
        synthesis: Synthesis::Linear,
        max_events_per_interval: 5,
        ..SensorModel::default()
    };
    let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: None };
    let options = RigOptions { stage_times: true, ..RigOptions::default() };
    let mut rig = Rig::with_options(&DEVICE, &[config], options).unwrap();
    let peer = Peer::connect().unwrap();
    assert!(peer.program.starts_with("tracy"), "the test's binary is `tracy-...`, not {}", peer.program);
    let mut stages = Vec::new();
    for index in 0..5_u32 {
        let texel = [1.0 + (index % 2) as f32; 4];
        let hdr: Vec<u8> = (0..32 * 16).flat_map(|_| texel).flat_map(f32::to_le_bytes).collect();
        rig.upload(0, &FrameBytes { hdr: &hdr, motion: None, ..FrameBytes::default() }).unwrap();
        let tick = rig.step(&[i64::from(index) * 1_000_000]).unwrap();
        stages = tick.stage_ns.iter().map(|(stage, _)| *stage).filter(|stage| *stage != "retry").collect();
    }
    let came = peer.read().unwrap();
    let holds = |text: &str| came.windows(text.len()).any(|bytes| bytes == text.as_bytes());
    assert!(stages.len() > 2, "{stages:?}");
    for stage in stages {
        assert!(holds(stage), "no GPU zone `{stage}` in {} bytes", came.len());
    }
    assert!(holds("events dropped"), "no message of dropped events in {} bytes", came.len());
    assert!(holds(&DEVICE.info().name), "no context of the device in {} bytes", came.len());
    drop(rig);
    assert_silent();
}
