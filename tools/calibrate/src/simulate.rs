//! Runs a recording's frames through the engine.

use anyhow::{Context, Result};
use esaac_engine::{CameraConfig, Device, FrameBytes, Rig};
use esaac_formats::recording::Recording;
use esaac_model::packet::Event;
use esaac_model::{HdrFormat, MAX_INTERVAL_NS, SensorModel, Synthesis};
use std::sync::Arc;

/// Events that the sensor would send for the recording's frames. Each frame stands for the middle of its exposure.
/// Between frames brightness is blended, because a recording has no motion vectors.
pub fn simulate(device: &Arc<Device>, recording: &Recording, sensor: &SensorModel) -> Result<Vec<Event>> {
    let sensor = SensorModel { synthesis: Synthesis::Linear, aps_exposure_ns: 0, ..sensor.clone() };
    let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: None };
    let mut rig = Rig::new(device, &[config])?;
    let mut events = Vec::new();
    for (index, frame) in recording.frames.iter().enumerate() {
        let texels = frame.pixels.iter().flat_map(|&v| [v, v, v, 1.0]);
        let hdr: Vec<u8> = texels.flat_map(f32::to_le_bytes).collect();
        rig.upload(0, &FrameBytes { hdr: &hdr, motion: None, ..FrameBytes::default() })?;
        let tick = rig.step(&[frame.middle_ns()]).with_context(|| {
            format!("frame {index} of the recording (frames are at most {MAX_INTERVAL_NS} ns apart)")
        })?;
        events.extend(tick.packets[0].iter());
    }
    Ok(events)
}
