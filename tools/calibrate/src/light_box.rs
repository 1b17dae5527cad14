//! A sensor in a box whose light is stated, pixel by pixel: what a laboratory does with a real one, with the engine's.

use anyhow::Result;
use esaac_engine::{CameraConfig, Device, FrameBytes, Rig};
use esaac_model::packet::Event;
use esaac_model::{HdrFormat, Intensity, SensorModel, SubstepPolicy, Synthesis};
use std::sync::Arc;

/// A sensor before which the light is known.
pub struct LightBox {
    rig: Rig,
    pixels: usize,
}

impl LightBox {
    /// The sensor with another size, which is made to see light in lux. `substeps` of the light's course between two
    /// instants are walked.
    pub fn new(
        device: &Arc<Device>,
        sensor: &SensorModel,
        (width, height): (u32, u32),
        substeps: u32,
    ) -> Result<Self> {
        let sensor = SensorModel {
            width,
            height,
            substeps,
            substep_policy: SubstepPolicy::Fixed,
            intensity: Intensity::Gray,
            synthesis: Synthesis::Linear,
            lux_per_unit: 1.0,
            exposure_gain: 1.0,
            psf_sigma_px: 0.0,
            vignetting_fov_deg: 0.0,
            flicker_depth: 0.0,
            aps_exposure_ns: 0,
            ..sensor.clone()
        };
        let pixels = sensor.pixels();
        let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: None };
        Ok(LightBox { rig: Rig::new(device, &[config])?, pixels })
    }

    /// Brings the light to `lux` of each pixel (row by row) at this time, on a straight line from the light before.
    /// Returns the events since. Before the first time the light has always been what it is then.
    pub fn show(&mut self, t_ns: i64, lux: impl Fn(usize) -> f64) -> Result<Vec<Event>> {
        let texels = (0..self.pixels).flat_map(|pixel| {
            let value = lux(pixel) as f32;
            [value, value, value, 1.0]
        });
        let hdr: Vec<u8> = texels.flat_map(f32::to_le_bytes).collect();
        self.rig.upload(0, &FrameBytes { hdr: &hdr, motion: None, ..FrameBytes::default() })?;
        Ok(self.rig.step(&[t_ns])?.packets[0].iter().collect())
    }

    /// Forgets all light and events: the next light counts as the first.
    pub fn reset(&mut self) -> Result<()> {
        Ok(self.rig.reset(0)?)
    }
}
