//! Device memory: named buffers from gpu-allocator, freed when dropped.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use crate::faults::FaultPoint;
use crate::loan::{Lent, Loan};
use ash::vk;
use bytemuck::Pod;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::sync::Arc;

/// Bytes of device or host memory in use for one purpose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryUse {
    /// Camera in the rig; `None` for memory that all cameras share.
    pub camera: Option<usize>,
    /// Name of the buffer.
    pub purpose: String,
    /// Size.
    pub bytes: u64,
    /// Whether it lies in host memory rather than the device's own.
    pub on_host: bool,
}

/// Where the memory of a buffer comes from.
enum Memory {
    None,
    Managed(Allocation),
    /// Allocated elsewhere and owned by the buffer alone.
    Adopted(vk::DeviceMemory),
}

/// A storage buffer with its memory.
pub struct Buffer {
    device: Arc<Device>,
    raw: vk::Buffer,
    memory: Memory,
    name: String,
    bytes: u64,
    address: u64,
    on_host: bool,
    texels: Option<Texels>,
    lent: Lent,
}

/// A buffer as kernels see it by texel fetch.
struct Texels {
    view: vk::BufferView,
    /// Whether the view covers the whole buffer: devices limit the number of texels.
    whole: bool,
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
        device.fault(FaultPoint::Allocate).map_err(|result| EngineError::OutOfMemory {
            name: name.to_owned(),
            bytes,
            reason: result.to_string(),
        })?;
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
            memory: Memory::None,
            name: name.to_owned(),
            bytes,
            address: 0,
            on_host: false,
            texels: None,
            lent: Lent::default(),
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
        // SAFETY: the allocation is this buffer's and freed after it.
        let (memory, offset) = (unsafe { allocation.memory() }, allocation.offset());
        buffer.on_host = !allocation.memory_properties().contains(vk::MemoryPropertyFlags::DEVICE_LOCAL);
        // From here on the buffer's `drop` frees the allocation.
        buffer.memory = Memory::Managed(allocation);
        // SAFETY: the memory was allocated for these requirements and is bound once.
        unsafe { device.raw().bind_buffer_memory(raw, memory, offset) }.call("vkBindBufferMemory")?;
        // SAFETY: the buffer is bound and was created with the device-address usage.
        buffer.address = unsafe { device.buffer_address(raw) };
        Ok(buffer)
    }

    /// Takes over a buffer whose memory was allocated elsewhere, such as exported or imported memory. `on_host`: whether
    /// that is memory of the host.
    ///
    /// # Safety
    /// `raw` and `memory` were made by `device`, are bound to each other and have no other owner; the buffer has at
    /// least `bytes` bytes and was made for storage and device addresses.
    #[must_use]
    pub unsafe fn adopt(
        device: &Arc<Device>,
        name: &str,
        raw: vk::Buffer,
        memory: vk::DeviceMemory,
        bytes: u64,
        on_host: bool,
    ) -> Self {
        Buffer {
            device: Arc::clone(device),
            raw,
            memory: Memory::Adopted(memory),
            name: name.to_owned(),
            bytes,
            // SAFETY: the buffer is bound and was made for addresses, as the caller guarantees.
            address: unsafe { device.buffer_address(raw) },
            on_host,
            texels: None,
            lent: Lent::default(),
        }
    }

    /// Lends the buffer to a step that was submitted.
    pub(crate) fn lend(&self) -> Loan {
        self.lent.lend()
    }

    /// Adds a view of the buffer as texels of `texel_bytes` each. The buffer was made with `UNIFORM_TEXEL_BUFFER`.
    pub(crate) fn with_texels(mut self, format: vk::Format, texel_bytes: u64) -> Result<Self, EngineError> {
        let shown = self.bytes.min(self.device.most_texels() * texel_bytes);
        let info = vk::BufferViewCreateInfo::default().buffer(self.raw).format(format).range(shown);
        // SAFETY: the buffer is bound and was made for texels; the view is destroyed with it.
        let view = unsafe { self.device.raw().create_buffer_view(&info, None) }.call("vkCreateBufferView")?;
        self.texels = Some(Texels { view, whole: shown == self.bytes });
        Ok(self)
    }

    /// View of the buffer's texels; null if it has none.
    pub(crate) fn texels(&self) -> vk::BufferView {
        self.texels.as_ref().map_or(vk::BufferView::null(), |t| t.view)
    }

    /// Whether every byte can be read as a texel.
    pub(crate) fn shows_all_texels(&self) -> bool {
        self.texels.as_ref().is_some_and(|t| t.whole)
    }

    /// The device that it was made by.
    pub(crate) fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Vulkan handle.
    #[must_use]
    pub fn raw(&self) -> vk::Buffer {
        self.raw
    }

    /// Its memory, if that was allocated elsewhere (see [`Buffer::adopt`]).
    #[must_use]
    pub fn adopted_memory(&self) -> Option<vk::DeviceMemory> {
        match self.memory {
            Memory::Adopted(memory) => Some(memory),
            Memory::None | Memory::Managed(_) => None,
        }
    }

    /// Device address of the first byte.
    #[must_use]
    pub fn address(&self) -> u64 {
        self.address
    }

    /// Size in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether it lies in host memory rather than the device's own.
    #[must_use]
    pub fn on_host(&self) -> bool {
        self.on_host
    }

    /// The bytes, if the host can access them. That the device does not access them at the same time is part of the
    /// contract of recording commands that use the buffer ([`crate::Commands::record`], [`crate::Kernel::record`]).
    fn mapped(&self) -> Option<&[u8]> {
        let Memory::Managed(allocation) = &self.memory else { return None };
        allocation.mapped_slice().map(|s| &s[..self.bytes as usize])
    }

    /// The bytes for writing, if the host can access them. Panics if a submitted step reads them.
    fn mapped_mut(&mut self) -> Option<&mut [u8]> {
        assert!(
            !self.lent.is_lent(),
            "a step that was submitted reads `{}`: expected Rig::wait first",
            self.name
        );
        let bytes = self.bytes as usize;
        let Memory::Managed(allocation) = &mut self.memory else { return None };
        allocation.mapped_slice_mut().map(|s| &mut s[..bytes])
    }

    /// Elements `first..first + count` as `T`. Panics if the buffer is not mapped or the elements lie outside.
    #[must_use]
    pub fn read<T: Pod>(&self, first: usize, count: usize) -> &[T] {
        let bytes = self.mapped().expect("only buffers that the host can see are read");
        bytemuck::cast_slice(&bytes[first * size_of::<T>()..(first + count) * size_of::<T>()])
    }

    /// Writes elements from `first` on. Panics if the buffer is not mapped, if the elements lie outside, or if a step that
    /// was [submitted](crate::Rig::submit_frames) reads the buffer.
    pub fn write<T: Pod>(&mut self, first: usize, elements: &[T]) {
        let bytes = self.mapped_mut().expect("only buffers that the host can see are written");
        let target = &mut bytes[first * size_of::<T>()..(first + elements.len()) * size_of::<T>()];
        target.copy_from_slice(bytemuck::cast_slice(elements));
    }

    /// All elements, for writing: reading from memory of the device is slow. Panics if the buffer is not mapped, or if a
    /// step that was submitted reads it.
    pub fn all_mut<T: Pod>(&mut self) -> &mut [T] {
        let bytes = self.mapped_mut().expect("only buffers that the host can see are written");
        let whole = bytes.len() / size_of::<T>() * size_of::<T>();
        bytemuck::cast_slice_mut(&mut bytes[..whole])
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let (raw, view) = (self.raw, self.texels());
        let memory = std::mem::replace(&mut self.memory, Memory::None);
        let name = std::mem::take(&mut self.name);
        self.device.retire(move |device| {
            // SAFETY: nothing pending uses the buffer: its owner has waited, or `retire` does. The buffer owned the
            // handles alone.
            unsafe {
                device.raw().destroy_buffer_view(view, None);
                device.raw().destroy_buffer(raw, None);
            }
            match memory {
                Memory::None => {}
                Memory::Managed(allocation) => {
                    if let Err(error) = device.allocator().free(allocation) {
                        eprintln!("esaac: freeing `{name}`: {error}");
                    }
                }
                // SAFETY: the buffer owned the memory alone, and is destroyed.
                Memory::Adopted(memory) => unsafe { device.raw().free_memory(memory, None) },
            }
        });
    }
}
