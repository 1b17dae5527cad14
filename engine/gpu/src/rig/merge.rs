//! Sorting of heavy packets, which `sort` leaves unsorted, and the readout of those that have a bus before them. The host
//! learns of them after the tick, and submits `merge` for their cameras. The commands are recorded each time, since the
//! number of passes depends on the packets.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::Rig;
use super::record::{MOST_GROUPS, STAMPS};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use crate::kernel::{record_barrier, record_host_barrier};
use ash::vk;
use bytemuck::bytes_of;
use esaac_layout::{Push, RUN_EVENTS};

/// Passes over a packet: one that sorts runs, and those that merge them two by two until one is left.
fn levels(packet_events: u32) -> u32 {
    1 + packet_events.div_ceil(RUN_EVENTS).max(1).next_power_of_two().ilog2()
}

impl Rig {
    /// Sorts the packets of the cameras that have a time in `t_ns`, or (`outlets`) of their outlets. The largest packet
    /// has `most_events` events.
    pub(super) fn merge(
        &mut self,
        t_ns: &[Option<i64>],
        most_events: u32,
        outlets: bool,
    ) -> Result<(), EngineError> {
        self.prepare_rows(t_ns);
        let cameras = self.cameras.len() as u32;
        let (first_camera, count) = if outlets { (cameras, self.outlets()) } else { (0, cameras) };
        let groups = most_events.div_ceil(RUN_EVENTS).min(MOST_GROUPS);
        self.submit_apart(|rig, commands| {
            for level in 0..levels(most_events) {
                record_barrier(&rig.device, commands);
                let push = Push { first_camera, level, outlets: u32::from(outlets), ..Push::default() };
                // SAFETY: as for the commands in `submit_apart`; the kernel stays within what its camera's row gives it.
                unsafe {
                    rig.pipelines.kernels.merge.record(commands, bytes_of(&push), [groups, count, 1]);
                }
            }
        })
    }

    /// Lets `readout` go on for the cameras that have a time in `t_ns`. Their packets are sorted, by `merge` if they are
    /// heavy.
    pub(super) fn continue_readout(&mut self, t_ns: &[Option<i64>]) -> Result<(), EngineError> {
        self.prepare_rows(t_ns);
        self.submit_apart(|rig, commands| {
            record_barrier(&rig.device, commands);
            // SAFETY: as for the commands in `submit_apart`; the kernels stay within what their cameras' rows give them.
            unsafe {
                if rig.pipelines.policy.readout_light {
                    rig.record_deferred_of_outlets(commands, rig.outlets());
                    record_barrier(&rig.device, commands);
                }
                rig.record_readout(commands, rig.outlets(), true);
            }
        })
    }

    /// Submits commands of their own within a tick and waits for them. Their time counts as that of a retry.
    fn submit_apart(&mut self, body: impl FnOnce(&Rig, vk::CommandBuffer)) -> Result<(), EngineError> {
        let timer = &self.timing.timer;
        let record = |commands| {
            timer.record_reset(commands, STAMPS..STAMPS + 2);
            timer.record(commands, STAMPS);
            body(self, commands);
            record_host_barrier(&self.device, commands);
            timer.record(commands, STAMPS + 1);
        };
        // SAFETY: no submission of the commands is pending, or the rig would be lost. The rig owns the handles that
        // they use; nothing else uses these within a tick, and `Device::retire` keeps them if the wait fails.
        unsafe { self.recordings.merging.record(record) }?;
        self.timing.submit(&self.device, &self.recordings.merging, &SubmitHooks::default())?;
        self.timing.wait()?;
        self.timing.add_retry(&mut self.results);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_leave_one_run() {
        for events in [0, 1, 255, 256, 257, 512, 513, 4097, 65_536, 65_537, 1 << 29] {
            let last = levels(events) - 1;
            assert!(u64::from(RUN_EVENTS) << last >= u64::from(events), "{events}");
            assert!(last == 0 || u64::from(RUN_EVENTS) << (last - 1) < u64::from(events), "{events}");
        }
    }
}
