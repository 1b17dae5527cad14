//! A timeline semaphore: a count that only goes up, which submissions and the host wait for and signal.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use ash::vk;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The host spins this long before it sleeps between looks.
const SPIN: Duration = Duration::from_micros(200);

/// Between two looks once it sleeps.
const NAP: Duration = Duration::from_micros(50);

/// A timeline semaphore.
pub struct Timeline {
    device: Arc<Device>,
    raw: vk::Semaphore,
}

impl Timeline {
    /// A timeline at 0, exportable by these handle types.
    pub fn new(
        device: &Arc<Device>,
        exported: vk::ExternalSemaphoreHandleTypeFlags,
    ) -> Result<Self, EngineError> {
        if !device.info().has("timelineSemaphore") {
            return Err(EngineError::MissingCapability {
                device: device.info().name.clone(),
                missing: "timelineSemaphore".to_owned(),
            });
        }
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let mut export = vk::ExportSemaphoreCreateInfo::default().handle_types(exported);
        let mut info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        if !exported.is_empty() {
            info = info.push_next(&mut export);
        }
        // SAFETY: the device is alive and has the feature; the chain outlives the call.
        let raw = unsafe { device.raw().create_semaphore(&info, None) }.call("vkCreateSemaphore")?;
        Ok(Timeline { device: Arc::clone(device), raw })
    }

    /// Vulkan handle.
    #[must_use]
    pub fn raw(&self) -> vk::Semaphore {
        self.raw
    }

    /// Value reached.
    pub fn value(&self) -> Result<u64, EngineError> {
        // SAFETY: the semaphore is alive.
        unsafe { self.device.raw().get_semaphore_counter_value(self.raw) }.call("vkGetSemaphoreCounterValue")
    }

    /// Sets the value from the host: above the present one and below any that a submission will signal.
    pub fn signal(&self, value: u64) -> Result<(), EngineError> {
        let info = vk::SemaphoreSignalInfo::default().semaphore(self.raw).value(value);
        // SAFETY: the semaphore is alive; a value that breaks the rule is the driver's to refuse.
        unsafe { self.device.raw().signal_semaphore(&info) }.call("vkSignalSemaphore")
    }

    /// Whether `value` is reached within `timeout`. It looks at the counter rather than block in the
    /// driver, whose wait on a shared timeline wakes late.
    pub fn wait(&self, value: u64, timeout: Duration) -> Result<bool, EngineError> {
        let started = Instant::now();
        loop {
            if self.value()? >= value {
                return Ok(true);
            }
            let waited = started.elapsed();
            if waited >= timeout {
                return Ok(false);
            }
            if waited < SPIN && !self.device.is_software() {
                std::hint::spin_loop();
            } else {
                std::thread::sleep(NAP);
            }
        }
    }
}

impl Drop for Timeline {
    fn drop(&mut self) {
        // SAFETY: whoever owns a timeline waits for the submissions that use it.
        unsafe { self.device.raw().destroy_semaphore(self.raw, None) };
    }
}
