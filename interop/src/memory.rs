//! Buffers that two processes share: exported, imported, or in memory of the host. Each has an allocation of
//! its own, since drivers want shared memory dedicated to one buffer.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::error::InteropError;
use crate::host_memory::HostMemory;
use crate::lent::Lent;
use crate::support::{BUFFER_USAGE, Support};
use crate::wire::{ANY_MEMORY_TYPE, ImageMemory};
use esaac_engine::ash::{ext, khr, vk};
use esaac_engine::{Buffer, Device};
use rustix::fd::{AsFd, BorrowedFd, FromRawFd, OwnedFd};
use rustix::fs::{FileType, SealFlags, fcntl_add_seals, fcntl_get_seals, fstat};
use std::sync::Arc;

/// A buffer in shared memory.
pub(crate) struct SharedBuffer {
    /// Declared before `host`, so that it is dropped before the memory that it uses.
    buffer: Buffer,
    host: Option<LentMemory>,
    /// What the peer must know of its memory.
    described: ImageMemory,
}

/// Memory of the host that a buffer uses. It is unmapped when no submission can use it any more, after the buffer is destroyed.
struct LentMemory {
    device: Arc<Device>,
    memory: Option<HostMemory>,
}

impl Drop for LentMemory {
    fn drop(&mut self) {
        let memory = self.memory.take();
        self.device.retire(move |_| drop(memory));
    }
}

/// A raw buffer without memory. It is destroyed unless `bind` succeeds.
struct Raw<'a> {
    device: &'a Arc<Device>,
    raw: vk::Buffer,
}

impl Raw<'_> {
    fn new(
        device: &Arc<Device>,
        bytes: u64,
        handle: vk::ExternalMemoryHandleTypeFlags,
    ) -> Result<Raw<'_>, InteropError> {
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(handle);
        let info = vk::BufferCreateInfo::default().size(bytes).usage(BUFFER_USAGE).push_next(&mut external);
        // SAFETY: the device is alive; the chain outlives the call.
        let raw = unsafe { device.raw().create_buffer(&info, None) }
            .map_err(|result| InteropError::vulkan("vkCreateBuffer", result))?;
        Ok(Raw { device, raw })
    }

    fn requirements(&self) -> vk::MemoryRequirements {
        // SAFETY: the buffer is this device's.
        unsafe { self.device.raw().get_buffer_memory_requirements(self.raw) }
    }

    /// Binds the memory and makes an engine's buffer of both.
    fn bind(
        self,
        name: &str,
        memory: vk::DeviceMemory,
        bytes: u64,
        on_host: bool,
    ) -> Result<Buffer, InteropError> {
        let device = self.device;
        // SAFETY: the memory is big enough for the buffer's requirements and bound once.
        if let Err(result) = unsafe { device.raw().bind_buffer_memory(self.raw, memory, 0) } {
            // SAFETY: the memory is not used.
            unsafe { device.raw().free_memory(memory, None) };
            return Err(InteropError::vulkan("vkBindBufferMemory", result));
        }
        let raw = self.raw;
        std::mem::forget(self);
        // SAFETY: both handles are this device's, bound to each other, and given away here.
        Ok(unsafe { Buffer::adopt(device, name, raw, memory, bytes, on_host) })
    }
}

impl Drop for Raw<'_> {
    fn drop(&mut self) {
        // SAFETY: the buffer was made here and is bound to nothing.
        unsafe { self.device.raw().destroy_buffer(self.raw, None) };
    }
}

/// Bytes of a shared buffer for an image: as the engine rounds its own.
pub(crate) fn buffer_bytes(image_bytes: u64) -> u64 {
    image_bytes.next_multiple_of(16).max(16)
}

impl SharedBuffer {
    /// A buffer whose memory leaves as a file descriptor.
    pub(crate) fn exportable(device: &Arc<Device>, name: &str, bytes: u64) -> Result<Self, InteropError> {
        let raw = Raw::new(device, bytes, vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD)?;
        let requirements = raw.requirements();
        let memory_type = device_local_type(device, requirements.memory_type_bits);
        let mut export = vk::ExportMemoryAllocateInfo::default()
            .handle_types(vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD);
        let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().buffer(raw.raw);
        let mut flags = vk::MemoryAllocateFlagsInfo::default().flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(requirements.size)
            .memory_type_index(memory_type)
            .push_next(&mut export)
            .push_next(&mut dedicated)
            .push_next(&mut flags);
        // SAFETY: the chain outlives the call; the driver said that it exports such buffers.
        let memory = unsafe { device.raw().allocate_memory(&info, None) }.map_err(|result| {
            esaac_engine::EngineError::OutOfMemory {
                name: name.to_owned(),
                bytes: requirements.size,
                reason: format!("vkAllocateMemory: {result}"),
            }
        })?;
        let buffer = raw.bind(name, memory, bytes, false)?;
        let described =
            ImageMemory { bytes, allocation_bytes: requirements.size, memory_type, image_usage: 0 };
        Ok(SharedBuffer { buffer, host: None, described })
    }

    /// A file descriptor of this buffer's memory for the peer. The memory stays ours too. Memory of the host
    /// gives its descriptor away, so it is exported once.
    pub(crate) fn export(&mut self, device: &Device) -> Result<OwnedFd, InteropError> {
        let exported = match &mut self.host {
            Some(LentMemory { memory, .. }) => memory.as_mut().and_then(HostMemory::take_fd),
            None => self.buffer.adopted_memory().map(|memory| export_memory(device, memory)).transpose()?,
        };
        exported.ok_or_else(|| InteropError::Unsupported {
            device: device.info().name.clone(),
            reason: format!("`{}` has no descriptor to give away", self.buffer.name()),
        })
    }

    /// The peer's exported memory as a buffer here.
    pub(crate) fn import(
        device: &Arc<Device>,
        name: &str,
        fd: OwnedFd,
        told: &ImageMemory,
        bytes: u64,
    ) -> Result<Self, InteropError> {
        let handle = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
        let raw = Raw::new(device, bytes, handle)?;
        let requirements = raw.requirements();
        // Either the allocation is exactly as long as the buffer and dedicated to it; or it is longer, since
        // CUDA allocates in large pieces, and the buffer lies at its beginning.
        let dedicates = told.allocation_bytes == requirements.size;
        let fits =
            dedicates || (told.allocation_bytes > requirements.size && !Support::told(device).dedicated_only);
        if !fits || told.bytes != bytes {
            let expected = if told.bytes == bytes { requirements.size } else { bytes };
            let actual = if told.bytes == bytes { told.allocation_bytes } else { told.bytes };
            return Err(InteropError::Size { name: name.to_owned(), expected, actual });
        }
        let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().buffer(raw.raw);
        let mut flags = vk::MemoryAllocateFlagsInfo::default().flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
        let mut info = vk::MemoryAllocateInfo::default().push_next(&mut flags);
        if dedicates {
            info = info.push_next(&mut dedicated);
        }
        let memory = import_memory(device, name, fd, told, &requirements, info)?;
        let buffer = raw.bind(name, memory, bytes, false)?;
        Ok(SharedBuffer { buffer, host: None, described: *told })
    }

    /// A buffer in memory of the host that both processes map.
    pub(crate) fn on_host(
        device: &Arc<Device>,
        name: &str,
        bytes: u64,
        peers: Option<(OwnedFd, ImageMemory)>,
    ) -> Result<Self, InteropError> {
        let Some(alignment) = Support::told(device).host_alignment else {
            return Err(InteropError::Unsupported {
                device: device.info().name.clone(),
                reason: "it lacks VK_EXT_external_memory_host".to_owned(),
            });
        };
        let granule = alignment.max(rustix::param::page_size() as u64);
        let host = match peers {
            Some((fd, told)) => {
                // The other driver may round up to more than this one does.
                let expected = bytes.next_multiple_of(granule);
                if told.bytes != bytes || told.allocation_bytes % granule != 0 {
                    let actual = if told.bytes == bytes { told.allocation_bytes } else { told.bytes };
                    return Err(InteropError::Size { name: name.to_owned(), expected, actual });
                }
                HostMemory::open(name, fd, told.allocation_bytes)?
            }
            None => HostMemory::new(bytes.next_multiple_of(granule))?,
        };
        let handle = vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT;
        let raw = Raw::new(device, bytes, handle)?;
        let requirements = raw.requirements();
        if requirements.size > host.bytes() {
            return Err(InteropError::Size {
                name: name.to_owned(),
                expected: requirements.size,
                actual: host.bytes(),
            });
        }
        let loader = ext::external_memory_host::Device::new(device.instance(), device.raw());
        let mut properties = vk::MemoryHostPointerPropertiesEXT::default();
        // SAFETY: the address is mapped, and aligned to a page, which the driver's alignment is a part of.
        unsafe {
            (loader.fp().get_memory_host_pointer_properties_ext)(
                device.raw().handle(),
                handle,
                host.address(),
                &mut properties,
            )
        }
        .result()
        .map_err(|result| InteropError::vulkan("vkGetMemoryHostPointerPropertiesEXT", result))?;
        let types = requirements.memory_type_bits & properties.memory_type_bits;
        if types == 0 {
            return Err(InteropError::Unsupported {
                device: device.info().name.clone(),
                reason: "no memory type takes the host's memory".to_owned(),
            });
        }
        let mut import =
            vk::ImportMemoryHostPointerInfoEXT::default().handle_type(handle).host_pointer(host.address());
        let mut flags = vk::MemoryAllocateFlagsInfo::default().flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(host.bytes())
            .memory_type_index(types.trailing_zeros())
            .push_next(&mut import)
            .push_next(&mut flags);
        // SAFETY: the mapping is as long as said and outlives the memory: `host` goes after `buffer`.
        let memory =
            unsafe { device.raw().allocate_memory(&info, None) }.map_err(|result| InteropError::Import {
                name: name.to_owned(),
                bytes: host.bytes(),
                call: "vkAllocateMemory",
                result: result.to_string(),
                hint: "the driver does not take this memory of the host",
            })?;
        let buffer = raw.bind(name, memory, bytes, true)?;
        let described = ImageMemory {
            bytes,
            allocation_bytes: host.bytes(),
            memory_type: types.trailing_zeros(),
            image_usage: 0,
        };
        let host = LentMemory { device: Arc::clone(device), memory: Some(host) };
        Ok(SharedBuffer { buffer, host: Some(host), described })
    }

    pub(crate) fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    pub(crate) fn described(&self) -> ImageMemory {
        self.described
    }
}

/// A file descriptor of memory that was made for export.
pub(crate) fn export_memory(device: &Device, memory: vk::DeviceMemory) -> Result<OwnedFd, InteropError> {
    let loader = khr::external_memory_fd::Device::new(device.instance(), device.raw());
    let info = vk::MemoryGetFdInfoKHR::default()
        .memory(memory)
        .handle_type(vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD);
    // SAFETY: the memory was allocated for export by this handle type.
    let fd = unsafe { loader.get_memory_fd(&info) }
        .map_err(|result| InteropError::vulkan("vkGetMemoryFdKHR", result))?;
    // SAFETY: the call gave a new descriptor that is ours.
    let fd = unsafe { OwnedFd::from_raw_fd(fd) };
    seal(fd.as_fd());
    Ok(fd)
}

/// Hint for errors when memory is short.
pub(crate) const NO_ROOM: &str =
    "memory is short: give the camera fewer `slots` or a smaller size, or free memory";

/// The peer's memory, for a buffer or an image of these requirements; `info` says the rest.
pub(crate) fn import_memory(
    device: &Device,
    name: &str,
    fd: OwnedFd,
    told: &ImageMemory,
    requirements: &vk::MemoryRequirements,
    info: vk::MemoryAllocateInfo<'_>,
) -> Result<vk::DeviceMemory, InteropError> {
    let memory_type = match told.memory_type {
        ANY_MEMORY_TYPE => device_local_type(device, requirements.memory_type_bits),
        told if told < 32 && requirements.memory_type_bits & (1 << told) != 0 => told,
        told => {
            return Err(InteropError::Unsupported {
                device: device.info().name.clone(),
                reason: format!("memory type {told} does not fit `{name}`"),
            });
        }
    };
    check_file(name, fd.as_fd(), told.allocation_bytes)?;
    let lent = Lent::new(fd)?;
    let mut import = vk::ImportMemoryFdInfoKHR::default()
        .handle_type(vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD)
        .fd(lent.number());
    let info =
        info.allocation_size(told.allocation_bytes).memory_type_index(memory_type).push_next(&mut import);
    // SAFETY: the chain outlives the call; the descriptor is open. What it is of is the driver's to check;
    // size and type were.
    let memory =
        unsafe { device.raw().allocate_memory(&info, None) }.map_err(|result| InteropError::Import {
            name: name.to_owned(),
            bytes: told.allocation_bytes,
            call: "vkAllocateMemory",
            result: result.to_string(),
            hint: match result {
                // The software driver returns this too if it has no address space to map the memory.
                vk::Result::ERROR_INVALID_EXTERNAL_HANDLE => {
                    "it is no memory of this driver, or there is no room for it (fewer `slots`, a smaller camera)"
                }
                vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => NO_ROOM,
                _ => "see the result",
            },
        })?;
    lent.taken();
    Ok(memory)
}

/// The first memory type of `allowed` that is local to the device; if there is none, the first of `allowed`.
pub(crate) fn device_local_type(device: &Device, allowed: u32) -> u32 {
    // SAFETY: the physical device is this instance's.
    let memory = unsafe { device.instance().get_physical_device_memory_properties(device.physical()) };
    let types = &memory.memory_types[..memory.memory_type_count as usize];
    (0..)
        .zip(types)
        .filter(|(index, _)| allowed & (1 << index) != 0)
        .find(|(_, t)| t.property_flags.contains(vk::MemoryPropertyFlags::DEVICE_LOCAL))
        .map_or(allowed.trailing_zeros(), |(index, _)| index)
}

/// Forbids a file to shrink. The software driver's exported memory is a file: if the peer made it shorter, the
/// next access would kill this process. Other drivers' memory is no file, and then this does nothing.
fn seal(fd: BorrowedFd<'_>) {
    let _ = fcntl_add_seals(fd, SealFlags::SHRINK);
}

/// Checks that a file that is given for memory is long enough and cannot shrink.
fn check_file(name: &str, fd: BorrowedFd<'_>, bytes: u64) -> Result<(), InteropError> {
    let stat = fstat(fd).map_err(InteropError::system("fstat"))?;
    if FileType::from_raw_mode(stat.st_mode) != FileType::RegularFile {
        return Ok(());
    }
    let actual = stat.st_size as u64;
    if actual < bytes {
        return Err(InteropError::Size { name: name.to_owned(), expected: bytes, actual });
    }
    seal(fd);
    match fcntl_get_seals(fd) {
        Ok(seals) if seals.contains(SealFlags::SHRINK) => Ok(()),
        _ => Err(InteropError::Refused {
            code: crate::wire::ErrorCode::Memory,
            text: format!("the file given for `{name}` can shrink; seal it with F_SEAL_SHRINK"),
        }),
    }
}
