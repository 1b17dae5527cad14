//! Command buffers: recorded once and submitted often, or recorded, run and waited for.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::devices::TIMESTAMPS;
use crate::error::{Call, EngineError};
use crate::faults::FaultPoint;
use crate::loan::{Lent, Loan};
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

    /// # Safety
    /// As of [`Commands::record`].
    unsafe fn record(
        self,
        device: &Device,
        record: impl FnOnce(vk::CommandBuffer),
    ) -> Result<(), EngineError> {
        device.fault(FaultPoint::Record).call("vkBeginCommandBuffer")?;
        let raw = device.raw();
        // SAFETY: the pool's only buffer is not pending, as the caller guarantees.
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
        // SAFETY: the buffer is not pending: its owner has waited for its last submission, or has left this to
        // `Device::retire`.
        unsafe { device.destroy_command_pool(self.pool, None) };
    }
}

/// A command buffer with a pool of its own.
pub struct Commands {
    device: Arc<Device>,
    pooled: Pooled,
    /// Whether a submitted step uses them, or a submission of them is abandoned (see [`crate::retire`]).
    lent: Lent,
}

impl Commands {
    /// A command buffer in which nothing is recorded yet.
    pub fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        Ok(Commands { pooled: Pooled::new(device)?, device: Arc::clone(device), lent: Lent::default() })
    }

    /// Vulkan handle.
    #[must_use]
    pub fn raw(&self) -> vk::CommandBuffer {
        self.pooled.raw
    }

    /// Whether the commands may be recorded and submitted. After a failed wait they may still run: the error is
    /// [`EngineError::Abandoned`]. So may those of a step that was submitted: the error is [`EngineError::InUse`].
    pub fn check(&self) -> Result<(), EngineError> {
        if self.lent.is_abandoned() {
            Err(EngineError::Abandoned)
        } else if self.lent.is_lent() {
            Err(EngineError::InUse)
        } else {
            Ok(())
        }
    }

    /// As [`Commands::check`], and an error if they are of another device.
    fn check_for(&self, device: &Device) -> Result<(), EngineError> {
        device.check_own(&self.device, || "commands of a submission".to_owned())?;
        self.check()
    }

    /// Discards what is recorded and records with `record`.
    ///
    /// # Safety
    /// The buffer is not pending: the caller has waited for every submission of it. (After a failed wait, recording is
    /// refused; see [`Commands::check`].) The handles that `record` uses live until the last submission has finished,
    /// and nothing else uses them while one runs.
    pub unsafe fn record(&self, record: impl FnOnce(vk::CommandBuffer)) -> Result<(), EngineError> {
        self.check()?;
        // SAFETY: the caller's contract is the same.
        unsafe { self.pooled.record(&self.device, record) }
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        let pooled = self.pooled;
        self.device.retire(move |device| pooled.destroy(device.raw()));
    }
}

/// Command buffer and fence of a one-shot submission, for which the host waits at once. A device keeps them for the
/// next one: some drivers take long to make a fence.
pub(crate) struct OneShot {
    pooled: Pooled,
    fence: vk::Fence,
}

impl OneShot {
    fn new(device: &Device) -> Result<Self, EngineError> {
        let pooled = Pooled::new(device)?;
        match timing::new_fence(device) {
            Ok(fence) => Ok(OneShot { pooled, fence }),
            Err(error) => {
                pooled.destroy(device.raw());
                Err(error)
            }
        }
    }

    pub(crate) fn destroy(self, device: &ash::Device) {
        self.pooled.destroy(device);
        // SAFETY: nothing pending signals it, as for the commands.
        unsafe { device.destroy_fence(self.fence, None) };
    }
}

/// Additions to a submission: commands before and after its own, and timeline values that it waits for and signals.
/// The commands must not be pending anywhere else.
#[derive(Clone, Copy, Default)]
pub struct SubmitHooks<'a> {
    /// Commands that run before the submission's own. In a step that looks at its frames first (see
    /// [`Rig::submit_frames`](crate::Rig::submit_frames)), before the first look, and no more after.
    pub before: &'a [&'a Commands],
    /// Commands that run after the submission's own: of a step, when nothing of it reads the frames any more.
    pub after: &'a [&'a Commands],
    /// Timelines and the values that they must reach before anything runs.
    pub waits: &'a [(&'a crate::timeline::Timeline, u64)],
    /// Timelines and the values that they are set to once everything has run: above their current values
    /// ([`EngineError::TimelineValue`]), and above any that an earlier submission will still set.
    pub signals: &'a [(&'a crate::timeline::Timeline, u64)],
}

impl<'a> SubmitHooks<'a> {
    /// Takes out what comes before the first of several submissions. The rest is for the last.
    pub(crate) fn take_first(&mut self) -> SubmitHooks<'a> {
        let SubmitHooks { before, waits, .. } = *self;
        (self.before, self.waits) = (&[], &[]);
        SubmitHooks { before, waits, ..SubmitHooks::default() }
    }

    /// The commands of the hooks, in the order in which they run.
    fn commands(&self) -> impl Iterator<Item = &Commands> {
        self.before.iter().chain(self.after).copied()
    }

    /// An error if these cannot go with a submission to `device`: of another device, commands in use, or a timeline that
    /// would not grow.
    pub(crate) fn check(&self, device: &Device) -> Result<(), EngineError> {
        self.commands().try_for_each(|commands| commands.check_for(device))?;
        for (timeline, _) in self.waits.iter().chain(self.signals) {
            device.check_own(timeline.device(), || "a timeline of a submission".to_owned())?;
        }
        self.signals.iter().try_for_each(|(timeline, value)| timeline.check_next(*value))
    }

    /// Marks the commands as abandoned: the wait for a submission with these hooks has failed.
    fn abandon(&self) {
        self.commands().for_each(|commands| commands.lent.abandon());
    }

    /// Lends the commands to a step that was submitted.
    pub(crate) fn lend(&self) -> impl Iterator<Item = Loan> {
        self.commands().map(|commands| commands.lent.lend())
    }
}

impl Device {
    /// Records with `record`, submits and waits. For set-up and producers, not for the hot path.
    pub fn run_once(&self, record: impl FnOnce(vk::CommandBuffer)) -> Result<(), EngineError> {
        self.run_once_with(&SubmitHooks::default(), record)
    }

    /// As [`Device::run_once`], with hooks.
    pub(crate) fn run_once_with(
        &self,
        hooks: &SubmitHooks<'_>,
        record: impl FnOnce(vk::CommandBuffer),
    ) -> Result<(), EngineError> {
        let ran = self.one_shot(|one_shot| {
            // SAFETY: this call alone has the buffer, whose last submission has finished. `one_shot` waits for this
            // submission; if the wait fails, it is abandoned and `Device::retire` destroys nothing that it may use.
            unsafe { one_shot.pooled.record(self, record) }?;
            self.submit(one_shot.pooled.raw, hooks, one_shot.fence)
        });
        ran.inspect_err(|error| {
            if error.leaves_work() {
                hooks.abandon();
            }
        })
    }

    /// As [`Device::run_once`], with GPU time stamps: returns the nanoseconds from the start of the first command to
    /// the end of the last. For measurements of the device itself; an error if its queue has no clock.
    pub fn time_once(self: &Arc<Self>, record: impl FnOnce(vk::CommandBuffer)) -> Result<u64, EngineError> {
        let timer = timing::StageTimer::new(self, 2)?;
        self.run_once(|commands| {
            timer.record_reset(commands, 0..2);
            timer.record(commands, 0);
            record(commands);
            timer.record(commands, 1);
        })?;
        timer.span_ns(0)?.ok_or_else(|| EngineError::MissingCapability {
            device: self.info().name.clone(),
            missing: TIMESTAMPS.to_owned(),
        })
    }

    /// Submits commands with hooks, and waits.
    pub fn run_with_hooks(&self, commands: &Commands, hooks: &SubmitHooks<'_>) -> Result<(), EngineError> {
        commands.check_for(self)?;
        self.one_shot(|one_shot| self.submit(commands.raw(), hooks, one_shot.fence)).inspect_err(|error| {
            if error.leaves_work() {
                commands.lent.abandon();
                hooks.abandon();
            }
        })
    }

    fn one_shot(&self, submit: impl FnOnce(&OneShot) -> Result<(), EngineError>) -> Result<(), EngineError> {
        let kept = self.one_shots().pop();
        let one_shot = match kept {
            Some(one_shot) => one_shot,
            None => OneShot::new(self)?,
        };
        if let Err(error) = submit(&one_shot) {
            // The queue has not taken the submission, so that its fence and commands are free.
            self.one_shots().push(one_shot);
            return Err(error);
        }
        match timing::wait_for(self, one_shot.fence) {
            Ok(()) => {
                self.one_shots().push(one_shot);
                Ok(())
            }
            Err(error) => {
                self.retire(move |device| one_shot.destroy(device.raw()));
                Err(error)
            }
        }
    }
}
