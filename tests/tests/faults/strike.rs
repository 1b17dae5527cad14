//! Faults of the device under test.

use esaac_engine::FaultPoint;
use esaac_engine::ash::vk;
use esaac_tests::device::DEVICE;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Kinds of failures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Allocations, descriptors and submissions fail, and waits time out.
    Refusals,
    /// Submissions and waits report that the device is lost.
    Losses,
}

/// A fault at the n-th of the points at which one may strike.
pub struct Faults {
    kind: Kind,
    left: Arc<AtomicUsize>,
}

impl Faults {
    pub fn at(kind: Kind, point: usize) -> Self {
        Faults { kind, left: Arc::new(AtomicUsize::new(point + 1)) }
    }

    /// Runs `something`, during which the fault may strike.
    pub fn strike<T>(&self, something: impl FnOnce() -> T) -> T {
        let (kind, left) = (self.kind, Arc::clone(&self.left));
        let hook = move |point: FaultPoint| {
            let result = match (kind, point) {
                (Kind::Refusals, FaultPoint::Allocate) => vk::Result::ERROR_OUT_OF_DEVICE_MEMORY,
                (Kind::Refusals, FaultPoint::Descriptors) => vk::Result::ERROR_OUT_OF_POOL_MEMORY,
                (Kind::Refusals, FaultPoint::Record | FaultPoint::Submit) => {
                    vk::Result::ERROR_OUT_OF_HOST_MEMORY
                }
                (Kind::Refusals, FaultPoint::Wait) => vk::Result::TIMEOUT,
                (Kind::Losses, FaultPoint::Submit | FaultPoint::Wait) => vk::Result::ERROR_DEVICE_LOST,
                (Kind::Losses, _) => return None,
            };
            let before = left.load(Ordering::Relaxed);
            left.store(before.saturating_sub(1), Ordering::Relaxed);
            (before == 1).then_some(result)
        };
        DEVICE.set_faults(Some(Arc::new(hook)));
        let given = something();
        DEVICE.set_faults(None);
        given
    }

    pub fn has_struck(&self) -> bool {
        self.left.load(Ordering::Relaxed) == 0
    }
}
