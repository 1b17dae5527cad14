//! Vulkan images with optimal tiling that two processes share, each with dedicated memory. Whenever ownership
//! changes, their layout is `GENERAL`.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::error::InteropError;
use crate::memory::{device_local_type, export_memory, import_memory};
use crate::wire::ImageMemory;
use esaac_engine::ash::vk;
use esaac_engine::{Device, EngineError};
use esaac_model::{DepthFormat, HdrFormat, IdFormat, MotionFormat};
use rustix::fd::OwnedFd;
use std::sync::Arc;

const HANDLE: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;

/// Properties of an image that must be the same on both sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ImageKind {
    pub format: vk::Format,
    pub width_px: u32,
    pub height_px: u32,
    /// Bytes of the buffer that holds its texels.
    pub bytes: u64,
}

/// Vulkan's format of colour.
pub(crate) fn hdr_format(format: HdrFormat) -> vk::Format {
    match format {
        HdrFormat::F16x4 => vk::Format::R16G16B16A16_SFLOAT,
        HdrFormat::F32x4 => vk::Format::R32G32B32A32_SFLOAT,
        HdrFormat::Srgb8x4 => vk::Format::R8G8B8A8_SRGB,
    }
}

/// Vulkan's format of motion.
pub(crate) fn motion_format(format: MotionFormat) -> vk::Format {
    match format {
        MotionFormat::F16x2 => vk::Format::R16G16_SFLOAT,
        MotionFormat::F32x2 => vk::Format::R32G32_SFLOAT,
        MotionFormat::F32x4 => vk::Format::R32G32B32A32_SFLOAT,
    }
}

/// Vulkan's format of depth.
pub(crate) fn depth_format(format: DepthFormat) -> vk::Format {
    match format {
        DepthFormat::F32 => vk::Format::R32_SFLOAT,
    }
}

/// Vulkan's format of instance ids.
pub(crate) fn id_format(format: IdFormat) -> vk::Format {
    match format {
        IdFormat::U16 => vk::Format::R16_UINT,
        IdFormat::U32 => vk::Format::R32_UINT,
    }
}

impl ImageKind {
    /// What renderers use a target for.
    pub(crate) fn usage(&self) -> vk::ImageUsageFlags {
        let always = vk::ImageUsageFlags::TRANSFER_SRC
            | vk::ImageUsageFlags::TRANSFER_DST
            | vk::ImageUsageFlags::SAMPLED
            | vk::ImageUsageFlags::COLOR_ATTACHMENT;
        if self.format == vk::Format::R8G8B8A8_SRGB { always } else { always | vk::ImageUsageFlags::STORAGE }
    }

    /// Whether the driver imports such images.
    pub(crate) fn is_importable(&self, device: &Device) -> bool {
        if !device.info().has("VK_KHR_external_memory_fd") {
            return false;
        }
        let mut external = vk::PhysicalDeviceExternalImageFormatInfo::default().handle_type(HANDLE);
        let query = vk::PhysicalDeviceImageFormatInfo2::default()
            .format(self.format)
            .ty(vk::ImageType::TYPE_2D)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(self.usage())
            .push_next(&mut external);
        let mut shared = vk::ExternalImageFormatProperties::default();
        let mut answer = vk::ImageFormatProperties2::default().push_next(&mut shared);
        // SAFETY: the physical device is this instance's; every struct outlives the call.
        let known = unsafe {
            device.instance().get_physical_device_image_format_properties2(
                device.physical(),
                &query,
                &mut answer,
            )
        };
        let most = answer.image_format_properties.max_extent;
        known.is_ok()
            && self.width_px <= most.width
            && self.height_px <= most.height
            && shared
                .external_memory_properties
                .external_memory_features
                .contains(vk::ExternalMemoryFeatureFlags::IMPORTABLE)
    }
}

/// An image in shared memory.
pub(crate) struct SharedImage {
    device: Arc<Device>,
    raw: vk::Image,
    memory: vk::DeviceMemory,
    kind: ImageKind,
    described: ImageMemory,
}

impl SharedImage {
    /// Makes the image, without memory.
    fn unbound(device: &Arc<Device>, kind: ImageKind) -> Result<Self, InteropError> {
        let mut external = vk::ExternalMemoryImageCreateInfo::default().handle_types(HANDLE);
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(kind.format)
            .extent(vk::Extent3D { width: kind.width_px, height: kind.height_px, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(kind.usage())
            .push_next(&mut external);
        // SAFETY: the device is alive; the chain outlives the call.
        let raw = unsafe { device.raw().create_image(&info, None) }
            .map_err(|result| InteropError::vulkan("vkCreateImage", result))?;
        Ok(SharedImage {
            device: Arc::clone(device),
            raw,
            memory: vk::DeviceMemory::null(),
            kind,
            described: ImageMemory {
                bytes: kind.bytes,
                image_usage: kind.usage().as_raw(),
                ..ImageMemory::default()
            },
        })
    }

    fn requirements(&self) -> vk::MemoryRequirements {
        // SAFETY: the image is this device's.
        unsafe { self.device.raw().get_image_memory_requirements(self.raw) }
    }

    fn bind(mut self, memory: vk::DeviceMemory) -> Result<Self, InteropError> {
        self.memory = memory;
        // SAFETY: the memory was made for the image's requirements and is bound once.
        unsafe { self.device.raw().bind_image_memory(self.raw, memory, 0) }
            .map_err(|result| InteropError::vulkan("vkBindImageMemory", result))?;
        Ok(self)
    }

    /// Makes an image in layout `GENERAL` whose memory can be exported.
    pub(crate) fn exportable(
        device: &Arc<Device>,
        name: &str,
        kind: ImageKind,
    ) -> Result<Self, InteropError> {
        let mut image = Self::unbound(device, kind)?;
        let requirements = image.requirements();
        let memory_type = device_local_type(device, requirements.memory_type_bits);
        image.described.allocation_bytes = requirements.size;
        image.described.memory_type = memory_type;
        let mut export = vk::ExportMemoryAllocateInfo::default().handle_types(HANDLE);
        let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().image(image.raw);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(requirements.size)
            .memory_type_index(memory_type)
            .push_next(&mut export)
            .push_next(&mut dedicated);
        // SAFETY: the chain outlives the call.
        let memory = unsafe { device.raw().allocate_memory(&info, None) }.map_err(|result| {
            EngineError::OutOfMemory {
                name: name.to_owned(),
                bytes: requirements.size,
                reason: format!("vkAllocateMemory: {result}"),
            }
        })?;
        let image = image.bind(memory)?;
        image.settle(&[image.barrier().old_layout(vk::ImageLayout::UNDEFINED)])?;
        Ok(image)
    }

    /// Imports the peer's image and hands it back at once. This moves it to layout `GENERAL` for this side's
    /// driver. Its content is lost, but before the first frame it has none.
    pub(crate) fn import(
        device: &Arc<Device>,
        name: &str,
        fd: OwnedFd,
        told: &ImageMemory,
        kind: ImageKind,
    ) -> Result<Self, InteropError> {
        let mut image = Self::unbound(device, kind)?;
        let requirements = image.requirements();
        if told.allocation_bytes != requirements.size {
            let (expected, actual) = (requirements.size, told.allocation_bytes);
            return Err(InteropError::Size { name: name.to_owned(), expected, actual });
        }
        image.described = *told;
        let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().image(image.raw);
        let info = vk::MemoryAllocateInfo::default().push_next(&mut dedicated);
        let memory = import_memory(device, name, fd, told, &requirements, info)?;
        let image = image.bind(memory)?;
        image.settle(&[image.barrier().old_layout(vk::ImageLayout::UNDEFINED)])?;
        image.settle(&[image
            .barrier()
            .src_queue_family_index(device.queue_family())
            .dst_queue_family_index(vk::QUEUE_FAMILY_EXTERNAL)])?;
        Ok(image)
    }

    fn settle(&self, barriers: &[vk::ImageMemoryBarrier2<'_>]) -> Result<(), InteropError> {
        let device = &self.device;
        let info = vk::DependencyInfo::default().image_memory_barriers(barriers);
        // SAFETY: the commands are being recorded on this device; the image outlives them.
        device.run_once(|commands| unsafe { device.raw().cmd_pipeline_barrier2(commands, &info) })?;
        Ok(())
    }

    /// A descriptor of its memory. This side keeps the memory too.
    pub(crate) fn export(&self) -> Result<OwnedFd, InteropError> {
        export_memory(&self.device, self.memory)
    }

    pub(crate) fn described(&self) -> ImageMemory {
        self.described
    }

    pub(crate) fn raw(&self) -> vk::Image {
        self.raw
    }

    pub(crate) fn kind(&self) -> ImageKind {
        self.kind
    }

    /// A barrier of the whole image between any work and any other, in layout `GENERAL`.
    pub(crate) fn barrier(&self) -> vk::ImageMemoryBarrier2<'static> {
        let any = vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE;
        vk::ImageMemoryBarrier2::default()
            .image(self.raw)
            .subresource_range(vk::ImageSubresourceRange {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                level_count: 1,
                layer_count: 1,
                ..vk::ImageSubresourceRange::default()
            })
            .old_layout(vk::ImageLayout::GENERAL)
            .new_layout(vk::ImageLayout::GENERAL)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .src_access_mask(any)
            .dst_access_mask(any)
    }
}

impl Drop for SharedImage {
    fn drop(&mut self) {
        let (raw, memory) = (self.raw, self.memory);
        // SAFETY: nothing pending uses the image: its owner has waited, or `retire` does. Both handles are ours.
        self.device.retire(move |device| unsafe {
            device.raw().destroy_image(raw, None);
            device.raw().free_memory(memory, None);
        });
    }
}
