//! One image of a slot: either a buffer that the engine reads in place, or a Vulkan image with optimal tiling
//! that the engine copies to a buffer first.

use crate::error::InteropError;
use crate::image::{ImageKind, SharedImage};
use crate::memory::SharedBuffer;
use crate::wire::{self, ImageMemory};
use esaac_engine::ash::vk;
use esaac_engine::{Buffer, Device, MemoryLocation};
use rustix::fd::OwnedFd;
use std::sync::Arc;

/// An image of a slot.
pub(crate) enum Plane {
    Buffer(SharedBuffer),
    Image {
        image: SharedImage,
        /// Its texels row by row, on the side that reads.
        texels: Option<Buffer>,
    },
}

impl Plane {
    /// Makes memory on this side. `kind` is one of the memory bits.
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

    /// Imports the peer's memory.
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

    /// The buffer with its texels row by row, if this side has one.
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

    pub(crate) fn export(&mut self, device: &Device) -> Result<OwnedFd, InteropError> {
        match self {
            Plane::Buffer(buffer) => buffer.export(device),
            Plane::Image { image, .. } => image.export(),
        }
    }
}
