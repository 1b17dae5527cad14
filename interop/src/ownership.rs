//! Shared buffers belong to one side at a time: commands that take them from the other side and give
//! them back.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::error::InteropError;
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

/// Which way buffers change hands.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Way {
    /// From the other side to this device's queue.
    Acquire,
    /// Back.
    Release,
}

/// Recorded commands that hand `buffers` over; they may be submitted again and again.
pub(crate) fn hand_over<'a>(
    device: &Arc<Device>,
    buffers: impl IntoIterator<Item = &'a Buffer>,
    way: Way,
) -> Result<Commands, InteropError> {
    let barriers: Vec<_> = buffers
        .into_iter()
        .map(|buffer| {
            let barrier = vk::BufferMemoryBarrier2::default().buffer(buffer.raw()).size(vk::WHOLE_SIZE);
            match way {
                Way::Acquire => barrier
                    .src_queue_family_index(vk::QUEUE_FAMILY_EXTERNAL)
                    .dst_queue_family_index(device.queue_family())
                    .dst_stage_mask(STAGES)
                    .dst_access_mask(ACCESSES),
                Way::Release => barrier
                    .src_queue_family_index(device.queue_family())
                    .dst_queue_family_index(vk::QUEUE_FAMILY_EXTERNAL)
                    .src_stage_mask(STAGES)
                    .src_access_mask(ACCESSES),
            }
        })
        .collect();
    let commands = Commands::new(device)?;
    commands.record(|commands| {
        let info = vk::DependencyInfo::default().buffer_memory_barriers(&barriers);
        // SAFETY: `commands` is being recorded on this device; the buffers outlive it (both are a slot's).
        unsafe { device.raw().cmd_pipeline_barrier2(commands, &info) };
    })?;
    Ok(commands)
}
