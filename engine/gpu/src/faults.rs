//! Failures on demand: tests make a device fail at a chosen point. Without a hook, each point costs one branch.

use crate::device::Device;
use ash::vk;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Where a device can be made to fail.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultPoint {
    /// A buffer and its memory are made.
    Allocate,
    /// Descriptor sets are made.
    Descriptors,
    /// A command buffer is recorded.
    Record,
    /// Commands are given to the queue. After a fault the queue has not taken them.
    Submit,
    /// The host waits for a submission. After a fault the submission may still run.
    Wait,
}

/// The result with which a point fails; `None` if it does not fail.
#[doc(hidden)]
pub type FaultHook = dyn Fn(FaultPoint) -> Option<vk::Result> + Send + Sync;

/// The hook of a device, if a test has set one.
#[derive(Default)]
pub(crate) struct Faults {
    armed: AtomicBool,
    hook: Mutex<Option<Arc<FaultHook>>>,
}

impl Faults {
    fn hook(&self) -> Option<Arc<FaultHook>> {
        self.hook.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Device {
    /// Sets or removes the hook that makes the device fail: for tests.
    #[doc(hidden)]
    pub fn set_faults(&self, hook: Option<Arc<FaultHook>>) {
        let faults = self.faults();
        faults.armed.store(hook.is_some(), Ordering::Release);
        *faults.hook.lock().unwrap_or_else(PoisonError::into_inner) = hook;
    }

    /// Fails if a test's hook says so for this point.
    pub(crate) fn fault(&self, point: FaultPoint) -> Result<(), vk::Result> {
        let faults = self.faults();
        if !faults.armed.load(Ordering::Acquire) {
            return Ok(());
        }
        faults.hook().and_then(|hook| hook(point)).map_or(Ok(()), Err)
    }
}
