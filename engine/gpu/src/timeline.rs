//! A timeline semaphore: a counter that only grows, which submissions and the host can wait for and signal.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use ash::vk;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long the host spins before it sleeps between readings.
const SPIN: Duration = Duration::from_micros(200);

/// How long it sleeps between two readings.
const NAP: Duration = Duration::from_micros(50);

/// A timeline semaphore.
pub struct Timeline {
    device: Arc<Device>,
    raw: vk::Semaphore,
}

impl Timeline {
    /// A timeline at 0, exportable by these handle types. An error if the device has no timeline semaphores.
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

    /// The device that it is of.
    pub(crate) fn device(&self) -> &Device {
        &self.device
    }

    /// The current value.
    pub fn value(&self) -> Result<u64, EngineError> {
        // SAFETY: the semaphore is alive.
        unsafe { self.device.raw().get_semaphore_counter_value(self.raw) }.call("vkGetSemaphoreCounterValue")
    }

    /// Sets the value from the host. An error if it is not above the current one. It must also be below any that a
    /// submission will signal, and nobody else may signal meanwhile.
    pub fn signal(&self, value: u64) -> Result<(), EngineError> {
        self.check_next(value)?;
        let info = vk::SemaphoreSignalInfo::default().semaphore(self.raw).value(value);
        // SAFETY: the semaphore is alive, and the value was above its own a moment ago. That no submission signals a lower
        // value, and that nobody signals in between, is the caller's part. Vulkan does not promise that a driver notices. A
        // process that shares the semaphore can break that part, and no check here can prevent it: the window is the time
        // between the two calls.
        unsafe { self.device.raw().signal_semaphore(&info) }.call("vkSignalSemaphore")
    }

    /// An error if the value is not above the current one.
    pub(crate) fn check_next(&self, value: u64) -> Result<(), EngineError> {
        let current = self.value()?;
        if value > current {
            return Ok(());
        }
        Err(EngineError::TimelineValue { expected_above: current, actual: value })
    }

    /// Waits for `value`; returns whether it is reached within `timeout`. Polls the counter, because the driver's own
    /// wait on a shared timeline wakes late.
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
        let raw = self.raw;
        // SAFETY: nothing pending uses it: its owner has waited for the submissions that do, or `retire` does.
        self.device.retire(move |device| unsafe { device.raw().destroy_semaphore(raw, None) });
    }
}
