//! Command buffers: recorded once and submitted often, or recorded, run and waited for.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use crate::timing;
use ash::vk;
use std::sync::Arc;

/// A command buffer, the only one of its pool.
#[derive(Clone, Copy)]
struct Pooled {
    pool: vk::CommandPool,
    raw: vk::CommandBuffer,
}

impl Pooled {
    fn new(device: &Device) -> Result<Self, EngineError> {
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(device.queue_family());
        // SAFETY: the device is alive.
        let pool = unsafe { device.raw().create_command_pool(&info, None) }.call("vkCreateCommandPool")?;
        let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
        // SAFETY: the pool was just made.
        let raw = unsafe { device.raw().allocate_command_buffers(&info) }.call("vkAllocateCommandBuffers");
        match raw {
            Ok(raw) => Ok(Pooled { pool, raw: raw[0] }),
            Err(error) => {
                // SAFETY: the pool has no buffer.
                unsafe { device.raw().destroy_command_pool(pool, None) };
                Err(error)
            }
        }
    }

    fn record(self, device: &Device, record: impl FnOnce(vk::CommandBuffer)) -> Result<(), EngineError> {
        let raw = device.raw();
        // SAFETY: the pool's only buffer is not pending: its owner has waited.
        unsafe { raw.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()) }
            .call("vkResetCommandPool")?;
        // SAFETY: as above.
        unsafe { raw.begin_command_buffer(self.raw, &vk::CommandBufferBeginInfo::default()) }
            .call("vkBeginCommandBuffer")?;
        record(self.raw);
        // SAFETY: recording was begun above.
        unsafe { raw.end_command_buffer(self.raw) }.call("vkEndCommandBuffer")
    }

    fn destroy(self, device: &ash::Device) {
        // SAFETY: its owner has waited for the buffer's last submission.
        unsafe { device.destroy_command_pool(self.pool, None) };
    }
}

/// A command buffer with a pool of its own.
pub struct Commands {
    device: Arc<Device>,
    pooled: Pooled,
}

impl Commands {
    /// None recorded yet.
    pub fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        Ok(Commands { pooled: Pooled::new(device)?, device: Arc::clone(device) })
    }

    /// Vulkan handle.
    #[must_use]
    pub fn raw(&self) -> vk::CommandBuffer {
        self.pooled.raw
    }

    /// Records anew what `record` says; the buffer is not pending.
    pub fn record(&self, record: impl FnOnce(vk::CommandBuffer)) -> Result<(), EngineError> {
        self.pooled.record(&self.device, record)
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        self.pooled.destroy(self.device.raw());
    }
}

/// What a submission needs that is waited for at once. A device keeps some: making a fence alone takes
/// half a millisecond of some drivers.
pub(crate) struct Errand {
    pooled: Pooled,
    fence: vk::Fence,
}

impl Errand {
    fn new(device: &Device) -> Result<Self, EngineError> {
        let pooled = Pooled::new(device)?;
        match timing::new_fence(device) {
            Ok(fence) => Ok(Errand { pooled, fence }),
            Err(error) => {
                pooled.destroy(device.raw());
                Err(error)
            }
        }
    }

    pub(crate) fn destroy(self, device: &ash::Device) {
        self.pooled.destroy(device);
        // SAFETY: what was given it is waited for.
        unsafe { device.destroy_fence(self.fence, None) };
    }
}

/// What goes around a submission: commands before and after, and values of timelines that it waits for
/// and signals. Commands are not pending anywhere else.
#[derive(Clone, Copy, Default)]
pub struct Around<'a> {
    /// Run first.
    pub before: &'a [&'a Commands],
    /// Run last.
    pub after: &'a [&'a Commands],
    /// Reached before anything runs.
    pub waits: &'a [(&'a crate::timeline::Timeline, u64)],
    /// Reached once all has run.
    pub signals: &'a [(&'a crate::timeline::Timeline, u64)],
}

impl Device {
    /// Records with `record`, submits and waits: for set-up and producers, not for the hot path.
    pub fn run_once(&self, record: impl FnOnce(vk::CommandBuffer)) -> Result<(), EngineError> {
        self.errand(|errand| {
            errand.pooled.record(self, record)?;
            self.submit(errand.pooled.raw, &Around::default(), errand.fence)
        })
    }

    /// Submits commands with what goes around them, and waits.
    pub fn run_around(&self, commands: &Commands, around: &Around<'_>) -> Result<(), EngineError> {
        self.errand(|errand| self.submit(commands.raw(), around, errand.fence))
    }

    fn errand(&self, submit: impl FnOnce(&Errand) -> Result<(), EngineError>) -> Result<(), EngineError> {
        let kept = self.errands().pop();
        let errand = match kept {
            Some(errand) => errand,
            None => Errand::new(self)?,
        };
        let submitted = submit(&errand);
        if submitted.is_ok() {
            // A fence that does not come is the device's yet, and stays.
            timing::wait_for(self, errand.fence)?;
        }
        self.errands().push(errand);
        submitted
    }
}
