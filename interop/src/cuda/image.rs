//! An image of a slot in CUDA's address space: the engine's memory imported, or CUDA's own exported.

#![expect(unsafe_code, reason = "CUDA's edge")]

use super::context::{Context, check};
use crate::error::InteropError;
use crate::lent::Lent;
use crate::memory::NO_ROOM;
use crate::wire::{ANY_MEMORY_TYPE, ImageMemory};
use cudarc::driver::sys;
use rustix::fd::{FromRawFd, OwnedFd, RawFd};
use std::ffi::c_void;
use std::sync::Arc;

/// Memory of one image.
pub(super) struct CudaImage {
    context: Arc<Context>,
    pointer: sys::CUdeviceptr,
    from: From,
}

enum From {
    Engine(sys::CUexternalMemory),
    Cuda { handle: sys::CUmemGenericAllocationHandle, bytes: usize, mapped: bool },
}

// SAFETY: handles of a context that is entered for every use, on whichever thread.
unsafe impl Send for CudaImage {}

impl CudaImage {
    /// The engine's memory.
    pub(super) fn import(
        context: &Arc<Context>,
        name: &str,
        fd: OwnedFd,
        told: &ImageMemory,
    ) -> Result<Self, InteropError> {
        let _entered = context.enter()?;
        let lent = Lent::new(fd)?;
        let description = sys::CUDA_EXTERNAL_MEMORY_HANDLE_DESC {
            type_: sys::CUexternalMemoryHandleType::CU_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD,
            handle: sys::CUDA_EXTERNAL_MEMORY_HANDLE_DESC_st__bindgen_ty_1 { fd: lent.number() },
            size: told.allocation_bytes,
            // The engine dedicates each memory to one buffer.
            flags: sys::CUDA_EXTERNAL_MEMORY_DEDICATED,
            reserved: [0; 16],
        };
        let mut external = std::ptr::null_mut();
        // SAFETY: a context is current; the description names an open descriptor and outlives the call.
        check("cuImportExternalMemory", unsafe { sys::cuImportExternalMemory(&mut external, &description) })
            .map_err(refused(name, told.allocation_bytes))?;
        lent.taken();
        let mut image = CudaImage { context: Arc::clone(context), pointer: 0, from: From::Engine(external) };
        let whole = sys::CUDA_EXTERNAL_MEMORY_BUFFER_DESC {
            offset: 0,
            size: told.bytes,
            flags: 0,
            reserved: [0; 16],
        };
        // SAFETY: the memory was just imported and is at least as long as its buffer.
        check("cuExternalMemoryGetMappedBuffer", unsafe {
            sys::cuExternalMemoryGetMappedBuffer(&mut image.pointer, external, &whole)
        })
        .map_err(refused(name, told.bytes))?;
        Ok(image)
    }

    /// CUDA's own memory for a buffer of `bytes`, to be exported.
    pub(super) fn bring(context: &Arc<Context>, name: &str, bytes: u64) -> Result<Self, InteropError> {
        let _entered = context.enter()?;
        let location = sys::CUmemLocation {
            type_: sys::CUmemLocationType::CU_MEM_LOCATION_TYPE_DEVICE,
            id: context.device(),
        };
        let properties = sys::CUmemAllocationProp {
            type_: sys::CUmemAllocationType::CU_MEM_ALLOCATION_TYPE_PINNED,
            requestedHandleTypes: HANDLE,
            location,
            win32HandleMetaData: std::ptr::null_mut(),
            // SAFETY: all zero is "no compression, no special usage".
            allocFlags: unsafe { std::mem::zeroed() },
        };
        let mut granule = 0;
        let smallest = sys::CUmemAllocationGranularity_flags::CU_MEM_ALLOC_GRANULARITY_MINIMUM;
        // SAFETY: a context is current; both structs outlive the calls.
        check("cuMemGetAllocationGranularity", unsafe {
            sys::cuMemGetAllocationGranularity(&mut granule, &properties, smallest)
        })?;
        let bytes = (bytes as usize).next_multiple_of(granule.max(1));
        let mut handle = 0;
        // SAFETY: the size is a multiple of the granularity.
        check("cuMemCreate", unsafe { sys::cuMemCreate(&mut handle, bytes, &properties, 0) })
            .map_err(refused(name, bytes as u64))?;
        let from = From::Cuda { handle, bytes, mapped: false };
        let mut image = CudaImage { context: Arc::clone(context), pointer: 0, from };
        // SAFETY: an address of the driver's choice.
        check("cuMemAddressReserve", unsafe {
            sys::cuMemAddressReserve(&mut image.pointer, bytes, 0, 0, 0)
        })?;
        // SAFETY: range and allocation have the same size.
        check("cuMemMap", unsafe { sys::cuMemMap(image.pointer, bytes, 0, handle, 0) })?;
        image.from = From::Cuda { handle, bytes, mapped: true };
        let access = sys::CUmemAccessDesc {
            location,
            flags: sys::CUmemAccess_flags::CU_MEM_ACCESS_FLAGS_PROT_READWRITE,
        };
        // SAFETY: the range is mapped.
        check("cuMemSetAccess", unsafe { sys::cuMemSetAccess(image.pointer, bytes, &access, 1) })?;
        Ok(image)
    }

    /// A descriptor of memory that CUDA brings, and what the engine must know of it.
    pub(super) fn export(&self, buffer_bytes: u64) -> Result<(OwnedFd, ImageMemory), InteropError> {
        let From::Cuda { handle, bytes, .. } = self.from else {
            return Err(InteropError::Cuda {
                call: "cuMemExportToShareableHandle",
                result: "the memory is the engine's".to_owned(),
            });
        };
        let _entered = self.context.enter()?;
        let mut fd: RawFd = -1;
        // SAFETY: for this handle type the driver writes an int.
        check("cuMemExportToShareableHandle", unsafe {
            sys::cuMemExportToShareableHandle((&raw mut fd).cast::<c_void>(), handle, HANDLE, 0)
        })?;
        // SAFETY: the call gave a new descriptor that is ours.
        let fd = unsafe { OwnedFd::from_raw_fd(fd) };
        let memory = ImageMemory {
            bytes: buffer_bytes,
            allocation_bytes: bytes as u64,
            memory_type: ANY_MEMORY_TYPE,
            image_usage: 0,
        };
        Ok((fd, memory))
    }

    pub(super) fn pointer(&self) -> sys::CUdeviceptr {
        self.pointer
    }
}

/// Says what memory was asked for when CUDA does not give or take it.
fn refused(name: &str, bytes: u64) -> impl Fn(InteropError) -> InteropError {
    move |error| match error {
        InteropError::Cuda { call, result } => {
            let short = result == "CUDA_ERROR_OUT_OF_MEMORY";
            let hint = if short { NO_ROOM } else { "CUDA does not take it for memory of this device" };
            InteropError::Import { name: name.to_owned(), bytes, call, result, hint }
        }
        other => other,
    }
}

const HANDLE: sys::CUmemAllocationHandleType =
    sys::CUmemAllocationHandleType::CU_MEM_HANDLE_TYPE_POSIX_FILE_DESCRIPTOR;

impl Drop for CudaImage {
    fn drop(&mut self) {
        let freed = self.context.enter().and_then(|_entered| {
            // SAFETY: whoever owns the image has waited for its stream; every handle is this value's, and
            // what was not made yet is skipped.
            unsafe {
                match self.from {
                    From::Engine(external) => {
                        if self.pointer != 0 {
                            check("cuMemFree", sys::cuMemFree_v2(self.pointer))?;
                        }
                        check("cuDestroyExternalMemory", sys::cuDestroyExternalMemory(external))
                    }
                    From::Cuda { handle, bytes, mapped } => {
                        if mapped {
                            check("cuMemUnmap", sys::cuMemUnmap(self.pointer, bytes))?;
                        }
                        if self.pointer != 0 {
                            check("cuMemAddressFree", sys::cuMemAddressFree(self.pointer, bytes))?;
                        }
                        check("cuMemRelease", sys::cuMemRelease(handle))
                    }
                }
            }
        });
        if let Err(error) = freed {
            eprintln!("esaac: {error}");
        }
    }
}
