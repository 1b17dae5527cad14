//! Device memory: named buffers from gpu-allocator, freed when dropped.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use ash::vk;
use bytemuck::Pod;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::sync::Arc;

/// Bytes of device or host memory in use for one purpose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryUse {
    /// Camera in the rig, `None` for what all share.
    pub camera: Option<usize>,
    /// What for.
    pub purpose: String,
    /// How much.
    pub bytes: u64,
    /// Whether it lies in host memory, outside the device's own.
    pub on_host: bool,
}

/// A storage buffer with its memory.
pub struct Buffer {
    device: Arc<Device>,
    raw: vk::Buffer,
    allocation: Option<Allocation>,
    name: String,
    bytes: u64,
    address: u64,
    location: MemoryLocation,
}

impl Buffer {
    pub(crate) fn new(
        device: &Arc<Device>,
        name: &str,
        bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Self, EngineError> {
        let bytes = bytes.next_multiple_of(16).max(16);
        let info = vk::BufferCreateInfo::default()
            .size(bytes)
            .usage(usage | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS);
        // SAFETY: the device lives as long as this buffer does (it holds the Arc).
        let raw = unsafe { device.raw().create_buffer(&info, None) }.map_err(|result| {
            EngineError::OutOfMemory {
                name: name.to_owned(),
                bytes,
                reason: format!("vkCreateBuffer: {result}"),
            }
        })?;
        let mut buffer = Buffer {
            device: Arc::clone(device),
            raw,
            allocation: None,
            name: name.to_owned(),
            bytes,
            address: 0,
            location,
        };
        // SAFETY: `raw` was created above by this device.
        let requirements = unsafe { device.raw().get_buffer_memory_requirements(raw) };
        let allocation = device
            .allocator()
            .allocate(&AllocationCreateDesc {
                name,
                requirements,
                location,
                linear: true,
                allocation_scheme: AllocationScheme::GpuAllocatorManaged,
            })
            .map_err(|e| EngineError::OutOfMemory { name: name.to_owned(), bytes, reason: e.to_string() })?;
        // SAFETY: the memory was allocated for these requirements and is bound once.
        unsafe { device.raw().bind_buffer_memory(raw, allocation.memory(), allocation.offset()) }
            .call("vkBindBufferMemory")?;
        buffer.allocation = Some(allocation);
        // SAFETY: the buffer is bound and was created with the device-address usage.
        buffer.address = unsafe {
            device.raw().get_buffer_device_address(&vk::BufferDeviceAddressInfo::default().buffer(raw))
        };
        Ok(buffer)
    }

    /// Vulkan handle.
    #[must_use]
    pub fn raw(&self) -> vk::Buffer {
        self.raw
    }

    /// Device address of the first byte.
    #[must_use]
    pub fn address(&self) -> u64 {
        self.address
    }

    /// Bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether the host can read and write it through [`Buffer::mapped`].
    #[must_use]
    pub fn is_mapped(&self) -> bool {
        self.allocation.as_ref().is_some_and(|a| a.mapped_ptr().is_some())
    }

    /// Whether its memory is the host's rather than the device's own.
    #[must_use]
    pub fn on_host(&self) -> bool {
        self.location == MemoryLocation::GpuToCpu && !self.device.unified_memory()
    }

    /// The bytes, if the host can see them; the caller sees to it that the device is not at them.
    #[must_use]
    pub fn mapped(&self) -> Option<&[u8]> {
        self.allocation.as_ref()?.mapped_slice().map(|s| &s[..self.bytes as usize])
    }

    /// The bytes, writable.
    #[must_use]
    pub fn mapped_mut(&mut self) -> Option<&mut [u8]> {
        let bytes = self.bytes as usize;
        self.allocation.as_mut()?.mapped_slice_mut().map(|s| &mut s[..bytes])
    }

    /// Elements `first..first + count` as `T`; panics if they are not mapped or outside.
    #[must_use]
    pub fn read<T: Pod>(&self, first: usize, count: usize) -> &[T] {
        let bytes = self.mapped().expect("only buffers that the host can see are read");
        bytemuck::cast_slice(&bytes[first * size_of::<T>()..(first + count) * size_of::<T>()])
    }

    /// Writes elements from `first` on; panics if they are not mapped or outside.
    pub fn write<T: Pod>(&mut self, first: usize, elements: &[T]) {
        let bytes = self.mapped_mut().expect("only buffers that the host can see are written");
        let target = &mut bytes[first * size_of::<T>()..(first + elements.len()) * size_of::<T>()];
        target.copy_from_slice(bytemuck::cast_slice(elements));
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: whoever owns a buffer waits for the device before dropping it; the handle is ours.
        unsafe { self.device.raw().destroy_buffer(self.raw, None) };
        if let Some(allocation) = self.allocation.take()
            && let Err(error) = self.device.allocator().free(allocation)
        {
            eprintln!("esaac: freeing `{}`: {error}", self.name);
        }
    }
}
