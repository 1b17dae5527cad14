//! Depth in which nothing is to be seen. A camera that takes depth gets it where its producer gives none: each pixel is
//! then simulated by its motion vector, or without.

use crate::error::InteropError;
use crate::images::Images;
use esaac_engine::ash::vk;
use esaac_engine::{Buffer, Device, GeometryConfig, InputBuffers, MemoryLocation};
use esaac_model::paths::{Pose, PoseTrack, SceneMotion};
use std::sync::Arc;

/// Images for the place of those that a producer does not give.
pub(crate) struct StandIn {
    geometry: GeometryConfig,
    depth: Buffer,
    ids: Option<Buffer>,
}

impl StandIn {
    /// For a camera of these images; `None` if it takes no depth.
    pub(crate) fn new(
        device: &Arc<Device>,
        camera: usize,
        images: &Images,
    ) -> Result<Option<Self>, InteropError> {
        let (Some(geometry), bytes) = (images.geometry, images.bytes()) else { return Ok(None) };
        let filled = |image: &str, bytes: u64, word: u32| {
            let name = format!("camera {camera} {image} that no producer gives");
            let mut buffer =
                device.allocate(&name, bytes, vk::BufferUsageFlags::empty(), MemoryLocation::CpuToGpu)?;
            buffer.write(0, &vec![word; bytes as usize / size_of::<u32>()]);
            Ok::<_, InteropError>(buffer)
        };
        let depth = filled("depth", bytes.depth.unwrap_or_default(), f32::NAN.to_bits())?;
        let ids = bytes.ids.map(|bytes| filled("ids", bytes, 0)).transpose()?;
        Ok(Some(StandIn { geometry, depth, ids }))
    }

    /// The images of a frame, and these in place of depth and ids.
    pub(crate) fn complete<'a>(&'a self, inputs: InputBuffers<'a>) -> InputBuffers<'a> {
        InputBuffers { depth: Some(&self.depth), ids: self.ids.as_ref(), ..inputs }
    }

    /// Poses of a world that stands still.
    pub(crate) fn scene(&self) -> SceneMotion {
        SceneMotion::new(self.geometry.lens, PoseTrack::still(Pose::IDENTITY))
    }
}
