//! Transfers between the host and the rig's buffers, outside the tick.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::arena::Arena;
use crate::commands::SubmitHooks;
use crate::device::Device;
use crate::error::EngineError;
use crate::memory::Buffer;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// Most bytes that a write puts into the command buffer itself; larger writes go through a staging buffer.
const CARRIED_BYTES: usize = 4096;

/// Bytes to write to the buffer of a slot, from byte `offset` on.
pub(super) struct Write {
    pub slot: usize,
    pub offset: u64,
    pub bytes: Vec<u8>,
}

/// Writes that are ready to be recorded: everything that can fail is done.
pub(super) struct Writes {
    writes: Vec<Write>,
    staging: Option<Buffer>,
}

impl Writes {
    pub(super) fn new(device: &Arc<Device>, writes: Vec<Write>) -> Result<Self, EngineError> {
        let staged: usize = writes.iter().filter(|w| is_staged(w)).map(|w| w.bytes.len()).sum();
        if staged == 0 {
            return Ok(Writes { writes, staging: None });
        }
        let usage = vk::BufferUsageFlags::empty();
        let mut staging = device.allocate("upload", staged as u64, usage, MemoryLocation::CpuToGpu)?;
        let mut first = 0;
        for write in writes.iter().filter(|w| is_staged(w)) {
            staging.write(first, &write.bytes);
            first += write.bytes.len();
        }
        Ok(Writes { writes, staging: Some(staging) })
    }

    /// Records the writes. `self` must live until the commands have finished.
    pub(super) fn record(&self, device: &Device, commands: vk::CommandBuffer, arena: &Arena) {
        let mut src_offset = 0;
        for write in self.writes.iter().filter(|w| !w.bytes.is_empty()) {
            let (target, size) = (arena.buffer(write.slot).raw(), write.bytes.len() as u64);
            match &self.staging {
                Some(staging) if is_staged(write) => {
                    let region = [vk::BufferCopy { src_offset, dst_offset: write.offset, size }];
                    // SAFETY: `commands` is being recorded; both buffers live until the copy has finished.
                    unsafe { device.raw().cmd_copy_buffer(commands, staging.raw(), target, &region) };
                    src_offset += size;
                }
                // SAFETY: `commands` is being recorded; the buffer lives until they have finished; `is_staged` leaves
                // only whole words, and fewer than an update may carry.
                _ => unsafe { device.raw().cmd_update_buffer(commands, target, write.offset, &write.bytes) },
            }
        }
    }

    /// Runs the writes, and waits.
    pub(super) fn run(&self, device: &Device, arena: &Arena) -> Result<(), EngineError> {
        device.run_once(|commands| self.record(device, commands, arena))
    }
}

fn is_staged(write: &Write) -> bool {
    write.bytes.len() > CARRIED_BYTES || !write.bytes.len().is_multiple_of(4)
}

/// Most bytes that are read back at once, through a staging buffer.
const BATCH_BYTES: u64 = 256 << 20;

/// A part of a buffer to read back.
pub(super) struct Part<'a> {
    pub buffer: &'a Buffer,
    pub offset: u64,
    pub bytes: u64,
}

/// Reads parts back, and waits; returns their bytes one after the other.
pub(super) fn read_back(device: &Arc<Device>, parts: &[Part<'_>]) -> Result<Vec<u8>, EngineError> {
    read_back_after(device, parts, &mut SubmitHooks::default())
}

/// As [`read_back`]. The first submission takes out what `hooks` have before a first one.
pub(super) fn read_back_after(
    device: &Arc<Device>,
    parts: &[Part<'_>],
    hooks: &mut SubmitHooks<'_>,
) -> Result<Vec<u8>, EngineError> {
    let mut bytes = Vec::new();
    let mut rest = parts;
    while !rest.is_empty() {
        let mut sum = 0;
        let mut fits = |part: &Part<'_>| {
            sum += part.bytes;
            sum <= BATCH_BYTES
        };
        // A part larger than a batch is read alone.
        let count = rest.iter().take_while(|part| fits(part)).count().max(1);
        let (batch, after) = rest.split_at(count);
        read_batch(device, batch, hooks, &mut bytes)?;
        rest = after;
    }
    Ok(bytes)
}

fn read_batch(
    device: &Arc<Device>,
    parts: &[Part<'_>],
    hooks: &mut SubmitHooks<'_>,
    bytes: &mut Vec<u8>,
) -> Result<(), EngineError> {
    let sum: u64 = parts.iter().map(|part| part.bytes).sum();
    if sum == 0 {
        return Ok(());
    }
    let usage = vk::BufferUsageFlags::empty();
    let staging = device.allocate("download", sum, usage, MemoryLocation::GpuToCpu)?;
    device.run_once_with(&hooks.take_first(), |commands| {
        let mut dst_offset = 0;
        for part in parts.iter().filter(|part| part.bytes > 0) {
            let region = [vk::BufferCopy { src_offset: part.offset, dst_offset, size: part.bytes }];
            // SAFETY: `commands` is being recorded; both buffers live until the copy has finished.
            unsafe { device.raw().cmd_copy_buffer(commands, part.buffer.raw(), staging.raw(), &region) };
            dst_offset += part.bytes;
        }
        crate::kernel::record_host_barrier(device, commands);
    })?;
    bytes.extend_from_slice(staging.read::<u8>(0, sum as usize));
    Ok(())
}
