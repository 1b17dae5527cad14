//! Shared memory belongs to one side at a time. These commands take it from the other side and give it back.
//! If it is an image, taking it also copies it to the buffer that the engine reads.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::error::InteropError;
use crate::image::SharedImage;
use crate::plane::Plane;
use esaac_engine::ash::vk;
use esaac_engine::{Buffer, Commands, Device};
use std::sync::Arc;

const STAGES: vk::PipelineStageFlags2 = vk::PipelineStageFlags2::from_raw(
    vk::PipelineStageFlags2::COMPUTE_SHADER.as_raw() | vk::PipelineStageFlags2::TRANSFER.as_raw(),
);

const ACCESSES: vk::AccessFlags2 = vk::AccessFlags2::from_raw(
    vk::AccessFlags2::SHADER_STORAGE_READ.as_raw()
        | vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw()
        | vk::AccessFlags2::TRANSFER_READ.as_raw()
        | vk::AccessFlags2::TRANSFER_WRITE.as_raw(),
);

/// Direction of a change of ownership.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Way {
    /// From the other side to this device's queue.
    Acquire,
    /// Back.
    Release,
}

impl Way {
    /// Queue families from and to.
    fn families(self, device: &Device) -> (u32, u32) {
        match self {
            Way::Acquire => (vk::QUEUE_FAMILY_EXTERNAL, device.queue_family()),
            Way::Release => (device.queue_family(), vk::QUEUE_FAMILY_EXTERNAL),
        }
    }

    fn of_buffer(self, device: &Device, buffer: &Buffer) -> vk::BufferMemoryBarrier2<'static> {
        let (from, to) = self.families(device);
        let barrier = vk::BufferMemoryBarrier2::default()
            .buffer(buffer.raw())
            .size(vk::WHOLE_SIZE)
            .src_queue_family_index(from)
            .dst_queue_family_index(to);
        match self {
            Way::Acquire => barrier.dst_stage_mask(STAGES).dst_access_mask(ACCESSES),
            Way::Release => barrier.src_stage_mask(STAGES).src_access_mask(ACCESSES),
        }
    }

    fn of_image(self, device: &Device, image: &SharedImage) -> vk::ImageMemoryBarrier2<'static> {
        let (from, to) = self.families(device);
        let barrier = image.barrier().src_queue_family_index(from).dst_queue_family_index(to);
        let (stage, access) = (vk::PipelineStageFlags2::NONE, vk::AccessFlags2::NONE);
        match self {
            Way::Acquire => barrier.src_stage_mask(stage).src_access_mask(access),
            Way::Release => barrier.dst_stage_mask(stage).dst_access_mask(access),
        }
    }
}

/// Records commands that hand `planes` over. They can be submitted any number of times.
pub(crate) fn hand_over(device: &Arc<Device>, planes: &[&Plane], way: Way) -> Result<Commands, InteropError> {
    let (mut buffers, mut images) = (Vec::new(), Vec::new());
    for plane in planes {
        match plane {
            Plane::Buffer(buffer) => buffers.push(way.of_buffer(device, buffer.buffer())),
            Plane::Image { image, .. } => images.push(way.of_image(device, image)),
        }
    }
    let commands = Commands::new(device)?;
    let record = |commands| {
        let info =
            vk::DependencyInfo::default().buffer_memory_barriers(&buffers).image_memory_barriers(&images);
        // SAFETY: `commands` is being recorded on this device; buffers and images outlive it (all are a
        // slot's).
        unsafe { device.raw().cmd_pipeline_barrier2(commands, &info) };
        if way == Way::Acquire {
            for plane in planes {
                if let Plane::Image { image, texels: Some(texels) } = plane {
                    record_copy(device, commands, image, texels);
                }
            }
        }
    };
    // SAFETY: the buffer was just made, so nothing is pending. What it names is the slot's, as it is itself, and a slot
    // is nobody else's while its commands run.
    unsafe { commands.record(record) }?;
    Ok(commands)
}

/// Copies an image to a buffer, rows tightly packed, for kernels that follow.
fn record_copy(device: &Device, commands: vk::CommandBuffer, image: &SharedImage, texels: &Buffer) {
    let kind = image.kind();
    let region = [vk::BufferImageCopy::default()
        .image_subresource(vk::ImageSubresourceLayers {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            layer_count: 1,
            ..vk::ImageSubresourceLayers::default()
        })
        .image_extent(vk::Extent3D { width: kind.width_px, height: kind.height_px, depth: 1 })];
    let copied = [vk::BufferMemoryBarrier2::default()
        .buffer(texels.raw())
        .size(vk::WHOLE_SIZE)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .src_stage_mask(vk::PipelineStageFlags2::TRANSFER)
        .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
        .dst_stage_mask(STAGES)
        .dst_access_mask(ACCESSES)];
    let info = vk::DependencyInfo::default().buffer_memory_barriers(&copied);
    // SAFETY: as above; the buffer has room for the image's texels.
    unsafe {
        device.raw().cmd_copy_image_to_buffer(
            commands,
            image.raw(),
            vk::ImageLayout::GENERAL,
            texels.raw(),
            &region,
        );
        device.raw().cmd_pipeline_barrier2(commands, &info);
    }
}
