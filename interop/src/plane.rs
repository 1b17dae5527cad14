//! One image of a slot: a buffer that the engine reads where it lies, or an image of optimal tiling, of
//! which the engine makes a buffer.

use crate::error::InteropError;
use crate::image::{ImageKind, SharedImage};
use crate::memory::SharedBuffer;
use crate::wire::{self, ImageMemory};
use esaac_engine::ash::vk;
use esaac_engine::{Buffer, Device, MemoryLocation};
use rustix::fd::OwnedFd;
use std::sync::Arc;

/// Colour or motion of a slot.
pub(crate) enum Plane {
    Buffer(SharedBuffer),
    Image {
        image: SharedImage,
        /// Its texels row by row, on the side that reads.
        texels: Option<Buffer>,
    },
}

impl Plane {
    /// Memory of this side's: `kind` is one of the memory bits.
    pub(crate) fn own(
        device: &Arc<Device>,
        name: &str,
        kind: u32,
        image: ImageKind,
    ) -> Result<Self, InteropError> {
        Ok(match kind {
            wire::MEMORY_HOST => Plane::Buffer(SharedBuffer::on_host(device, name, image.bytes, None)?),
            wire::MEMORY_IMAGES => {
                Plane::Image { image: SharedImage::exportable(device, name, image)?, texels: None }
            }
            _ => Plane::Buffer(SharedBuffer::exportable(device, name, image.bytes)?),
        })
    }

    /// The peer's memory.
    pub(crate) fn peers(
        device: &Arc<Device>,
        name: &str,
        kind: u32,
        image: ImageKind,
        fd: OwnedFd,
        told: ImageMemory,
    ) -> Result<Self, InteropError> {
        let bytes = image.bytes;
        Ok(match kind {
            wire::MEMORY_HOST => Plane::Buffer(SharedBuffer::on_host(device, name, bytes, Some((fd, told)))?),
            wire::MEMORY_IMAGES => Plane::Image {
                image: SharedImage::import(device, name, fd, &told, image)?,
                texels: Some(device.allocate(
                    name,
                    bytes,
                    vk::BufferUsageFlags::empty(),
                    MemoryLocation::GpuOnly,
                )?),
            },
            _ => Plane::Buffer(SharedBuffer::import(device, name, fd, &told, bytes)?),
        })
    }

    /// Where its texels lie row by row, if they do on this side.
    pub(crate) fn texels(&self) -> Option<&Buffer> {
        match self {
            Plane::Buffer(buffer) => Some(buffer.buffer()),
            Plane::Image { texels, .. } => texels.as_ref(),
        }
    }

    pub(crate) fn image(&self) -> Option<vk::Image> {
        match self {
            Plane::Buffer(_) => None,
            Plane::Image { image, .. } => Some(image.raw()),
        }
    }

    pub(crate) fn described(&self) -> ImageMemory {
        match self {
            Plane::Buffer(buffer) => buffer.described(),
            Plane::Image { image, .. } => image.described(),
        }
    }

    pub(crate) fn export(&self, device: &Device) -> Result<OwnedFd, InteropError> {
        match self {
            Plane::Buffer(buffer) => buffer.export(device),
            Plane::Image { image, .. } => image.export(),
        }
    }
}
