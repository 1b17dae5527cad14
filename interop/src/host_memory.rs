//! Memory of the host that two processes map and their drivers import. It is an anonymous file that is sealed
//! against shrinking, since a process that touches a page that is gone is killed.

#![expect(unsafe_code, reason = "mmap's edge")]

use crate::error::InteropError;
use rustix::fd::OwnedFd;
use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, fcntl_get_seals, fstat, ftruncate, memfd_create};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::ffi::c_void;

/// A mapped anonymous file. The mapping does not need the descriptor. The side that made the file keeps it only
/// until the peer has it; the other side closes it at once. If they kept them, a ring of 16 slots with motion
/// would hold 32 descriptors, and a rig of 32 cameras would reach the usual limit of 1024.
pub(crate) struct HostMemory {
    fd: Option<OwnedFd>,
    address: *mut c_void,
    bytes: usize,
}

// SAFETY: the mapping is plain memory; only its address is handed out, and only to the driver.
unsafe impl Send for HostMemory {}
// SAFETY: as above.
unsafe impl Sync for HostMemory {}

impl HostMemory {
    /// New memory of zeroes; `bytes` is a multiple of the page size.
    pub(crate) fn new(bytes: u64) -> Result<Self, InteropError> {
        let fd = memfd_create(c"esaac-slot", MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING)
            .map_err(InteropError::system("memfd_create"))?;
        ftruncate(&fd, bytes).map_err(InteropError::system("ftruncate"))?;
        fcntl_add_seals(&fd, SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL)
            .map_err(InteropError::system("fcntl F_ADD_SEALS"))?;
        let mut memory = HostMemory::map(&fd, bytes)?;
        memory.fd = Some(fd);
        Ok(memory)
    }

    /// The peer's memory, if it has this size and cannot shrink.
    pub(crate) fn open(name: &str, fd: OwnedFd, bytes: u64) -> Result<Self, InteropError> {
        let actual = fstat(&fd).map_err(InteropError::system("fstat"))?.st_size as u64;
        if actual != bytes {
            return Err(InteropError::Size { name: name.to_owned(), expected: bytes, actual });
        }
        let seals = fcntl_get_seals(&fd).map_err(InteropError::system("fcntl F_GET_SEALS"))?;
        if !seals.contains(SealFlags::SHRINK) {
            // Every process that may write to the file may seal it.
            fcntl_add_seals(&fd, SealFlags::SHRINK).map_err(InteropError::system("fcntl F_ADD_SEALS"))?;
        }
        HostMemory::map(&fd, bytes)
    }

    fn map(fd: &OwnedFd, bytes: u64) -> Result<Self, InteropError> {
        let bytes = bytes as usize;
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping at an address of the kernel's choice, of a file that cannot shrink.
        let address = unsafe { mmap(std::ptr::null_mut(), bytes, access, MapFlags::SHARED, fd, 0) }
            .map_err(InteropError::system("mmap"))?;
        Ok(HostMemory { fd: None, address, bytes })
    }

    /// The descriptor for the peer; there is one, of memory that was made here.
    pub(crate) fn take_fd(&mut self) -> Option<OwnedFd> {
        self.fd.take()
    }

    pub(crate) fn address(&self) -> *mut c_void {
        self.address
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.bytes as u64
    }
}

impl Drop for HostMemory {
    fn drop(&mut self) {
        // SAFETY: the mapping is this value's, and the device memory made of it is gone (see `LentMemory`).
        if let Err(error) = unsafe { munmap(self.address, self.bytes) } {
            eprintln!("esaac: munmap: {error}");
        }
    }
}
