//! Renders frames of the demo into memory that the host can read, for the overview and for ROS 2.

use super::HDR;
use anyhow::Result;
use esaac_engine::ash::vk;
use esaac_engine::{Buffer, Device, MemoryLocation};
use esaac_model::DepthFormat;
use esaac_scene::Scene;
use esaac_scene::renderer::{Renderer, Targets};
use std::sync::Arc;

/// Colour and depth of a frame, in memory that the host can read.
pub(super) struct Picture {
    pub pixels: usize,
    pub hdr: Buffer,
    pub depth: Buffer,
}

impl Picture {
    pub fn new(device: &Arc<Device>, scene: &Scene) -> Result<Self> {
        let pixels = scene.width_px as usize * scene.height_px as usize;
        let allocate = |name: &str, texel_bytes: usize| {
            let bytes = (pixels * texel_bytes) as u64;
            device.allocate(name, bytes, vk::BufferUsageFlags::empty(), MemoryLocation::GpuToCpu)
        };
        Ok(Picture {
            pixels,
            hdr: allocate("overview colour", HDR.texel_bytes())?,
            depth: allocate("overview depth", DepthFormat::F32.texel_bytes())?,
        })
    }

    pub fn render(&mut self, renderer: &mut Renderer, t_ns: i64) -> Result<()> {
        let targets = Targets { hdr: &self.hdr, motion: None, depth: Some(&self.depth), ids: None };
        Ok(renderer.render(t_ns, None, targets)?)
    }
}

/// The linear colours of a rendered image.
pub(super) fn colours(hdr: &[u8]) -> impl Iterator<Item = [f32; 3]> + '_ {
    let pixels = hdr.len() / HDR.texel_bytes();
    (0..pixels).map(|i| HDR.decode(hdr, i).map(|v| v as f32))
}
