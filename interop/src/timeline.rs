//! The order between two processes: each slot has a timeline that counts up. The producer sets odd values:
//! 2k + 1 means that frame k of this slot is written. The engine sets even ones: 2k + 2 means that it is read.
//!
//! Each side has a timeline semaphore. If the driver can share it, both have the same one. If not, each side
//! has its own: it finishes its work before it sends a message, and sets the value that the other side sends.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::error::InteropError;
use crate::lent::Lent;
use esaac_engine::ash::{khr, vk};
use esaac_engine::{Device, Timeline};
use rustix::fd::{FromRawFd, OwnedFd};
use std::sync::Arc;
use std::time::Duration;

/// The timeline of one slot.
pub trait SharedTimeline: Send + Sync {
    /// The semaphore of this side.
    fn timeline(&self) -> &Timeline;

    /// Waits for what must be done before the peer may be told of `value`, which this side has submitted.
    fn settle(&self, value: u64, timeout: Duration) -> Result<(), InteropError>;

    /// Takes note of a message: the peer has reached, or will reach, `value`.
    fn heard(&self, value: u64) -> Result<(), InteropError>;

    /// A descriptor for the peer, if the semaphore itself is shared.
    fn export(&self) -> Result<Option<OwnedFd>, InteropError>;
}

/// The semaphore is shared by both processes.
pub struct ExportedTimeline {
    device: Arc<Device>,
    timeline: Timeline,
}

impl ExportedTimeline {
    /// One to export.
    pub fn new(device: &Arc<Device>) -> Result<Self, InteropError> {
        let timeline = Timeline::new(device, vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_FD)?;
        Ok(ExportedTimeline { device: Arc::clone(device), timeline })
    }

    /// The peer's.
    pub fn import(device: &Arc<Device>, fd: OwnedFd) -> Result<Self, InteropError> {
        let timeline = Timeline::new(device, vk::ExternalSemaphoreHandleTypeFlags::empty())?;
        let loader = khr::external_semaphore_fd::Device::new(device.instance(), device.raw());
        let lent = Lent::new(fd)?;
        let info = vk::ImportSemaphoreFdInfoKHR::default()
            .semaphore(timeline.raw())
            .handle_type(vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_FD)
            .fd(lent.number());
        // SAFETY: the semaphore is a timeline, unused so far; the descriptor is open.
        unsafe { loader.import_semaphore_fd(&info) }.map_err(|result| InteropError::Import {
            name: "timeline".to_owned(),
            bytes: 0,
            call: "vkImportSemaphoreFdKHR",
            result: result.to_string(),
            hint: "the descriptor is no timeline semaphore of this driver",
        })?;
        lent.taken();
        Ok(ExportedTimeline { device: Arc::clone(device), timeline })
    }
}

impl SharedTimeline for ExportedTimeline {
    fn timeline(&self) -> &Timeline {
        &self.timeline
    }

    fn settle(&self, _value: u64, _timeout: Duration) -> Result<(), InteropError> {
        Ok(())
    }

    fn heard(&self, _value: u64) -> Result<(), InteropError> {
        Ok(())
    }

    fn export(&self) -> Result<Option<OwnedFd>, InteropError> {
        let loader = khr::external_semaphore_fd::Device::new(self.device.instance(), self.device.raw());
        let info = vk::SemaphoreGetFdInfoKHR::default()
            .semaphore(self.timeline.raw())
            .handle_type(vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_FD);
        // SAFETY: the semaphore was made for export by this handle type.
        let fd = unsafe { loader.get_semaphore_fd(&info) }
            .map_err(|result| InteropError::vulkan("vkGetSemaphoreFdKHR", result))?;
        // SAFETY: the call gave a new descriptor that is ours.
        Ok(Some(unsafe { OwnedFd::from_raw_fd(fd) }))
    }
}

/// A semaphore for each side; values travel over the socket.
pub struct CarriedTimeline {
    timeline: Timeline,
}

impl CarriedTimeline {
    /// This side's.
    pub fn new(device: &Arc<Device>) -> Result<Self, InteropError> {
        let timeline = Timeline::new(device, vk::ExternalSemaphoreHandleTypeFlags::empty())?;
        Ok(CarriedTimeline { timeline })
    }
}

impl SharedTimeline for CarriedTimeline {
    fn timeline(&self) -> &Timeline {
        &self.timeline
    }

    fn settle(&self, value: u64, timeout: Duration) -> Result<(), InteropError> {
        if self.timeline.wait(value, timeout)? {
            Ok(())
        } else {
            Err(InteropError::Timeout { what: "the device's work on a slot", limit: timeout })
        }
    }

    fn heard(&self, value: u64) -> Result<(), InteropError> {
        Ok(self.timeline.signal(value)?)
    }

    fn export(&self) -> Result<Option<OwnedFd>, InteropError> {
        Ok(None)
    }
}
