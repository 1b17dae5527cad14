//! When things happen: a fence that the host waits on, and GPU time stamps.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use ash::vk;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A wait gives up after this long: a device that hangs must not hang the simulation for ever.
const TIMEOUT_S: u64 = 60;

/// The host spins this long before it sleeps; a blocking wait costs about 20 us more.
const SPIN: Duration = Duration::from_micros(300);

/// What the host waits on.
pub(crate) struct Fence {
    device: Arc<Device>,
    raw: vk::Fence,
}

/// A fence that is its maker's to destroy.
pub(crate) fn new_fence(device: &Device) -> Result<vk::Fence, EngineError> {
    // SAFETY: the device is alive.
    unsafe { device.raw().create_fence(&vk::FenceCreateInfo::default(), None) }.call("vkCreateFence")
}

/// Waits for the submission that was given the fence, and makes it ready for the next one: spins a little
/// on a real GPU, then sleeps.
pub(crate) fn wait_for(device: &Device, fence: vk::Fence) -> Result<(), EngineError> {
    let raw = device.raw();
    if !device.is_software() {
        let started = Instant::now();
        while started.elapsed() < SPIN {
            // SAFETY: the fence is alive.
            if unsafe { raw.get_fence_status(fence) }.call("vkGetFenceStatus")? {
                break;
            }
            std::hint::spin_loop();
        }
    }
    // SAFETY: the fence is alive.
    match unsafe { raw.wait_for_fences(&[fence], true, TIMEOUT_S * 1_000_000_000) } {
        Err(vk::Result::TIMEOUT) => return Err(EngineError::Timeout(TIMEOUT_S)),
        result => result.call("vkWaitForFences")?,
    }
    // SAFETY: its submission is done.
    unsafe { raw.reset_fences(&[fence]) }.call("vkResetFences")
}

impl Fence {
    pub(crate) fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        Ok(Fence { raw: new_fence(device)?, device: Arc::clone(device) })
    }

    pub(crate) fn raw(&self) -> vk::Fence {
        self.raw
    }

    /// See [`wait_for`].
    pub(crate) fn wait(&self) -> Result<(), EngineError> {
        wait_for(&self.device, self.raw)
    }
}

impl Drop for Fence {
    fn drop(&mut self) {
        // SAFETY: its owner has waited for every submission that was given it.
        unsafe { self.device.raw().destroy_fence(self.raw, None) };
    }
}

/// GPU time stamps between stages.
pub(crate) struct StageTimer {
    device: Arc<Device>,
    pool: vk::QueryPool,
    stamps: u32,
}

impl StageTimer {
    pub(crate) fn new(device: &Arc<Device>, stamps: u32) -> Result<Self, EngineError> {
        let info =
            vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(stamps);
        // SAFETY: the device is alive.
        let pool = unsafe { device.raw().create_query_pool(&info, None) }.call("vkCreateQueryPool")?;
        Ok(StageTimer { device: Arc::clone(device), pool, stamps })
    }

    pub(crate) fn record_reset(&self, commands: vk::CommandBuffer, stamps: std::ops::Range<u32>) {
        debug_assert!(stamps.end <= self.stamps);
        let count = stamps.end - stamps.start;
        // SAFETY: `commands` is being recorded on this device; the stamps are the pool's.
        unsafe { self.device.raw().cmd_reset_query_pool(commands, self.pool, stamps.start, count) };
    }

    pub(crate) fn record(&self, commands: vk::CommandBuffer, stamp: u32) {
        // SAFETY: `commands` is being recorded on this device and `stamp` is below the pool's size.
        unsafe {
            self.device.raw().cmd_write_timestamp2(
                commands,
                vk::PipelineStageFlags2::ALL_COMMANDS,
                self.pool,
                stamp,
            );
        }
    }

    /// Span between stamp `first` and the next, nanoseconds; the work is done.
    pub(crate) fn span_ns(&self, first: u32) -> Result<u64, EngineError> {
        let mut raw = [0_u64; 2];
        self.read_raw(first, &mut raw)?;
        Ok(self.device.timestamp_span_ns(raw[0], raw[1]))
    }

    /// Raw stamps from `first` on; the work is done.
    pub(crate) fn read_raw(&self, first: u32, raw: &mut [u64]) -> Result<(), EngineError> {
        // SAFETY: callers ask for stamps of the pool that finished work has written.
        unsafe {
            self.device.raw().get_query_pool_results(
                self.pool,
                first,
                raw,
                vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT,
            )
        }
        .call("vkGetQueryPoolResults")
    }

    /// Spans between consecutive stamps, nanoseconds, into `spans`; the work is done.
    pub(crate) fn read(&self, spans: &mut [(&'static str, u64)]) -> Result<(), EngineError> {
        let mut raw = [0_u64; 16];
        self.read_raw(0, &mut raw[..spans.len() + 1])?;
        for (span, pair) in spans.iter_mut().zip(raw.windows(2)) {
            span.1 = self.device.timestamp_span_ns(pair[0], pair[1]);
        }
        Ok(())
    }
}

impl Drop for StageTimer {
    fn drop(&mut self) {
        // SAFETY: its owner has waited for every submission that writes it.
        unsafe { self.device.raw().destroy_query_pool(self.pool, None) };
    }
}
