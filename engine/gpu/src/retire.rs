//! Deferred destruction of objects that the device may still use.
//!
//! The host waits for every submission, so that a dropped object is idle. A wait can fail, though: it times out, or the
//! device is lost. Its submission is then *abandoned*. As long as there is an abandoned submission, no object of this
//! device is destroyed: dropped buffers, command buffers, fences and the like are parked until every abandoned
//! submission has finished. If one never finishes, the device stays open too.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use ash::vk;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

type Destroy = Box<dyn FnOnce(&Device) + Send>;

#[derive(Default)]
struct Parked {
    /// Fences of submissions that may still run.
    abandoned: Vec<vk::Fence>,
    /// Destructors that run when they have finished.
    waiting: Vec<Destroy>,
}

/// Abandoned submissions of a device, and the destructors that wait for them.
#[derive(Default)]
pub(crate) struct Retired {
    /// Whether any submission is abandoned. As long as none is, this flag is all that is read.
    any: AtomicBool,
    parked: Mutex<Parked>,
}

impl Retired {
    fn parked(&self) -> MutexGuard<'_, Parked> {
        self.parked.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Device {
    /// Registers a submission whose wait has failed. Its fence must not be used for another.
    pub(crate) fn abandon(&self, fence: vk::Fence) {
        let retired = self.retired();
        retired.parked().abandoned.push(fence);
        retired.any.store(true, Ordering::Release);
    }

    /// Runs a destructor of an object of this device: at once, or when abandoned submissions, which may use the object,
    /// have finished.
    pub fn retire(&self, destroy: impl FnOnce(&Device) + Send + 'static) {
        let retired = self.retired();
        if !retired.any.load(Ordering::Acquire) {
            return destroy(self);
        }
        retired.parked().waiting.push(Box::new(destroy));
        self.settle(Duration::ZERO);
    }

    /// Waits up to `patience` for each abandoned submission, and runs the destructors that wait for them. Returns
    /// whether no abandoned submission is left.
    pub fn settle(&self, patience: Duration) -> bool {
        let retired = self.retired();
        let waiting = {
            let mut parked = retired.parked();
            let finished = |fence: &vk::Fence| {
                let patience_ns = u64::try_from(patience.as_nanos()).unwrap_or(u64::MAX);
                // SAFETY: an abandoned fence is alive: `Device::retire` parks its destruction.
                let waited = unsafe { self.raw().wait_for_fences(&[*fence], true, patience_ns) };
                // A lost device runs nothing.
                matches!(waited, Ok(()) | Err(vk::Result::ERROR_DEVICE_LOST))
            };
            if !parked.abandoned.iter().all(finished) {
                return false;
            }
            parked.abandoned.clear();
            retired.any.store(false, Ordering::Release);
            std::mem::take(&mut parked.waiting)
        };
        for destroy in waiting {
            destroy(self);
        }
        true
    }
}
