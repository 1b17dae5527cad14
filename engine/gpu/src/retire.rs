//! Deferred destruction of objects that the device may still use.
//!
//! An object that is dropped is idle, but for two kinds of submissions. A rig's step that was submitted runs until somebody
//! waits for it. And a wait can fail: it times out, or the device is lost. Its submission is then *abandoned*. While such
//! submissions run, objects of the device that are dropped (buffers, command buffers, fences and the like) are parked. They
//! are destroyed when all those have finished that were running when they were dropped. If an abandoned one never
//! finishes, the device stays open too.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use ash::vk;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

type Destroy = Box<dyn FnOnce(&Device) + Send>;

/// A submission that may still run.
struct Running {
    /// Number of submissions registered before it.
    number: u64,
    fence: vk::Fence,
    /// Whether a wait for it has failed.
    abandoned: bool,
}

#[derive(Default)]
struct Parked {
    running: Vec<Running>,
    /// Number of submissions that were ever registered.
    registered: u64,
    /// Destructors, each with the number of submissions registered before it.
    waiting: Vec<(u64, Destroy)>,
}

impl Parked {
    fn register(&mut self, fence: vk::Fence, abandoned: bool) {
        match self.running.iter_mut().find(|running| running.fence == fence) {
            Some(running) => running.abandoned = abandoned,
            None => {
                self.running.push(Running { number: self.registered, fence, abandoned });
                self.registered += 1;
            }
        }
    }

    fn park(&mut self, destroy: Destroy) {
        self.waiting.push((self.registered, destroy));
    }

    /// Takes the destructors out whose submissions have all finished.
    fn take_idle(&mut self) -> Vec<Destroy> {
        let oldest = self.running.iter().map(|running| running.number).min().unwrap_or(u64::MAX);
        let (idle, waiting) = self.waiting.drain(..).partition(|(before, _)| *before <= oldest);
        self.waiting = waiting;
        idle.into_iter().map(|(_, destroy)| destroy).collect()
    }
}

/// Submissions of a device that may still run, and the destructors that wait for them.
#[derive(Default)]
pub(crate) struct Retired {
    /// Whether any submission is registered. As long as none is, this flag is all that is read.
    any: AtomicBool,
    parked: Mutex<Parked>,
}

impl Retired {
    fn parked(&self) -> MutexGuard<'_, Parked> {
        self.parked.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Device {
    /// Registers a submission that runs on while its submitter does something else.
    pub(crate) fn leave_running(&self, fence: vk::Fence) {
        self.register(fence, false);
    }

    /// Registers a submission whose wait has failed. Its fence must not be used for another.
    pub(crate) fn abandon(&self, fence: vk::Fence) {
        self.register(fence, true);
    }

    fn register(&self, fence: vk::Fence, abandoned: bool) {
        let retired = self.retired();
        retired.parked().register(fence, abandoned);
        retired.any.store(true, Ordering::Release);
    }

    /// Notes that a submission has finished, before its fence is used for another. Runs the destructors that waited for it.
    pub(crate) fn finished(&self, fence: vk::Fence) {
        if self.retired().any.load(Ordering::Acquire) {
            self.retired().parked().running.retain(|running| running.fence != fence);
            self.settle(Duration::ZERO);
        }
    }

    /// Runs a destructor of an object of this device: at once, or when the registered submissions, which may use the
    /// object, have finished.
    pub fn retire(&self, destroy: impl FnOnce(&Device) + Send + 'static) {
        let retired = self.retired();
        if !retired.any.load(Ordering::Acquire) {
            return destroy(self);
        }
        retired.parked().park(Box::new(destroy));
        self.settle(Duration::ZERO);
    }

    /// Waits up to `patience` for abandoned submissions, and runs the destructors that need not wait any longer. Returns
    /// whether no abandoned submission is left.
    pub fn settle(&self, patience: Duration) -> bool {
        let retired = self.retired();
        let deadline = Instant::now() + patience;
        let mut parked = retired.parked();
        parked.running.retain(|running| {
            let left = if running.abandoned {
                deadline.saturating_duration_since(Instant::now())
            } else {
                Duration::ZERO
            };
            let left_ns = u64::try_from(left.as_nanos()).unwrap_or(u64::MAX);
            // SAFETY: the fence is alive: `Device::retire` parks its destruction as long as it is registered.
            let waited = unsafe { self.raw().wait_for_fences(&[running.fence], true, left_ns) };
            // A lost device runs nothing.
            !matches!(waited, Ok(()) | Err(vk::Result::ERROR_DEVICE_LOST))
        });
        let idle = parked.take_idle();
        let settled = parked.running.iter().all(|running| !running.abandoned);
        retired.any.store(!parked.running.is_empty(), Ordering::Release);
        drop(parked);
        for destroy in idle {
            destroy(self);
        }
        settled
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ash::vk::Handle;

    #[test]
    fn an_object_waits_for_what_ran_when_it_was_dropped_and_for_nothing_later() {
        let fence = |number| vk::Fence::from_raw(number);
        let mut parked = Parked::default();
        let finish = |parked: &mut Parked, number| {
            parked.running.retain(|running| running.fence != fence(number));
            parked.take_idle().len()
        };
        parked.register(fence(1), false);
        parked.park(Box::new(|_| ()));
        parked.register(fence(2), false);
        parked.park(Box::new(|_| ()));
        // A wait has failed: it is the same submission.
        parked.register(fence(1), true);
        parked.register(fence(3), false);
        assert_eq!(
            parked.running.iter().map(|running| running.abandoned).collect::<Vec<_>>(),
            [true, false, false]
        );
        assert_eq!([3, 1, 2].map(|number| finish(&mut parked, number)), [0, 1, 1]);
        parked.register(fence(1), false);
        parked.park(Box::new(|_| ()));
        assert_eq!(finish(&mut parked, 1), 1);
    }
}
