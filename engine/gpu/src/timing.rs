//! Fences that the host waits for, and GPU time stamps.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use crate::faults::FaultPoint;
use ash::vk;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest wait for a GPU: one that hangs must not hang the simulation for ever.
const TIMEOUT_S: u64 = 60;

/// Longest wait for the software driver, which shares its processor with others: slow is not hung.
const SOFTWARE_TIMEOUT_S: u64 = 600;

fn timeout_s(device: &Device) -> u64 {
    if device.is_software() { SOFTWARE_TIMEOUT_S } else { TIMEOUT_S }
}

/// How long the host spins before it sleeps: it is late to wake from a blocking wait.
const SPIN: Duration = Duration::from_micros(300);

/// Calls of [`wait_for`]. Where one of them fails, the submission may still run.
pub(crate) const CALLS_OF_A_WAIT: [&str; 3] = ["vkGetFenceStatus", "vkWaitForFences", "vkResetFences"];

/// A fence that the host waits for.
pub(crate) struct Fence {
    device: Arc<Device>,
    raw: vk::Fence,
}

/// A new fence; the caller destroys it.
pub(crate) fn new_fence(device: &Device) -> Result<vk::Fence, EngineError> {
    // SAFETY: the device is alive.
    unsafe { device.raw().create_fence(&vk::FenceCreateInfo::default(), None) }.call("vkCreateFence")
}

/// Waits for the fence's submission, and resets the fence for the next one. After an error the submission is abandoned
/// (see [`crate::retire`]) and the fence must not be used for another.
pub(crate) fn wait_for(device: &Device, fence: vk::Fence) -> Result<(), EngineError> {
    finish(device, fence).inspect_err(|_| device.abandon(fence))
}

/// Waits: on a GPU it spins first, then it sleeps.
fn finish(device: &Device, fence: vk::Fence) -> Result<(), EngineError> {
    let raw = device.raw();
    let limit_s = timeout_s(device);
    match device.fault(FaultPoint::Wait) {
        Err(vk::Result::TIMEOUT) => return Err(EngineError::Timeout(limit_s)),
        result => result.call("vkWaitForFences")?,
    }
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
    match unsafe { raw.wait_for_fences(&[fence], true, limit_s * 1_000_000_000) } {
        Err(vk::Result::TIMEOUT) => return Err(EngineError::Timeout(limit_s)),
        result => result.call("vkWaitForFences")?,
    }
    device.finished(fence);
    // SAFETY: the fence's submission has finished, so that nothing pending signals it, and nobody else waits for it.
    unsafe { raw.reset_fences(&[fence]) }.call("vkResetFences")
}

impl Fence {
    pub(crate) fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        Ok(Fence { raw: new_fence(device)?, device: Arc::clone(device) })
    }

    pub(crate) fn raw(&self) -> vk::Fence {
        self.raw
    }

    /// Whether a wait for it would return at once: with success, or because the device is lost.
    pub(crate) fn is_done(&self) -> bool {
        // SAFETY: the fence is alive.
        unsafe { self.device.raw().get_fence_status(self.raw) }.unwrap_or(true)
    }

    /// See [`wait_for`].
    pub(crate) fn wait(&self) -> Result<(), EngineError> {
        wait_for(&self.device, self.raw)
    }
}

impl Drop for Fence {
    fn drop(&mut self) {
        let raw = self.raw;
        // SAFETY: nothing pending signals it: its owner has waited, or `retire` does.
        self.device.retire(move |device| unsafe { device.raw().destroy_fence(raw, None) });
    }
}

/// GPU time stamps between stages. On a device whose queue has no clock it records nothing.
pub(crate) struct StageTimer {
    device: Arc<Device>,
    pool: Option<vk::QueryPool>,
    stamps: u32,
}

impl StageTimer {
    pub(crate) fn new(device: &Arc<Device>, stamps: u32) -> Result<Self, EngineError> {
        let pool = if device.has_timestamps() { Some(new_pool(device, stamps)?) } else { None };
        Ok(StageTimer { device: Arc::clone(device), pool, stamps })
    }

    pub(crate) fn record_reset(&self, commands: vk::CommandBuffer, stamps: std::ops::Range<u32>) {
        assert!(stamps.end <= self.stamps, "stamps {stamps:?} of {}", self.stamps);
        let count = stamps.end - stamps.start;
        if let Some(pool) = self.pool {
            // SAFETY: `commands` is being recorded on this device; the stamps lie in the pool, as asserted above.
            unsafe { self.device.raw().cmd_reset_query_pool(commands, pool, stamps.start, count) };
        }
    }

    pub(crate) fn record(&self, commands: vk::CommandBuffer, stamp: u32) {
        assert!(stamp < self.stamps, "stamp {stamp} of {}", self.stamps);
        let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
        if let Some(pool) = self.pool {
            // SAFETY: `commands` is being recorded on this device; `stamp` lies in the pool, as asserted above.
            unsafe { self.device.raw().cmd_write_timestamp2(commands, stage, pool, stamp) };
        }
    }

    /// `count` raw stamps from `first` on; `None` if the device has no clock. The work around them has finished.
    pub(crate) fn read_raw<const N: usize>(
        &self,
        first: u32,
        count: usize,
    ) -> Result<Option<[u64; N]>, EngineError> {
        assert!(
            count <= N && first as usize + count <= self.stamps as usize,
            "{count} stamps from {first} on"
        );
        let Some(pool) = self.pool else { return Ok(None) };
        let mut raw = [0_u64; N];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: the stamps lie in the pool, as asserted above; finished work has written them.
        unsafe { self.device.raw().get_query_pool_results(pool, first, &mut raw[..count], flags) }
            .call("vkGetQueryPoolResults")?;
        Ok(Some(raw))
    }

    /// Nanoseconds between stamp `first` and the next; `None` if the device has no clock. The work has finished.
    pub(crate) fn span_ns(&self, first: u32) -> Result<Option<u64>, EngineError> {
        let raw = self.read_raw::<2>(first, 2)?;
        Ok(raw.map(|raw| self.device.timestamp_span_ns(raw[0], raw[1])))
    }
}

fn new_pool(device: &Device, stamps: u32) -> Result<vk::QueryPool, EngineError> {
    let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(stamps);
    // SAFETY: the device is alive.
    unsafe { device.raw().create_query_pool(&info, None) }.call("vkCreateQueryPool")
}

impl Drop for StageTimer {
    fn drop(&mut self) {
        let Some(pool) = self.pool else { return };
        // SAFETY: nothing pending writes it: its owner has waited, or `retire` does.
        self.device.retire(move |device| unsafe { device.raw().destroy_query_pool(pool, None) });
    }
}
