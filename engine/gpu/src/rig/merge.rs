//! Sorting of heavy packets, which the first `sort` leaves unsorted, and the readout of those that have a bus before them.
//! The host learns of them after the tick, and submits `merge` for their cameras. The commands are recorded each time,
//! since the number of passes depends on the packets.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::Rig;
use super::machine::Merge;
use super::record::{MOST_GROUPS, STAMPS};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use crate::kernel::{record_barrier, record_host_barrier};
use ash::vk;
use bytemuck::bytes_of;
use esaac_layout::{Push, RUN_EVENTS, SORTABLE_EVENTS};

/// Passes of `merge` over a heavy packet of `events`, whose largest bin has `largest_bin` of them
/// (`glsl/merge_passes.glsl`). After a single one, `sort` can sort all bins.
pub(super) fn passes(events: u32, largest_bin: u32) -> u32 {
    if largest_bin <= SORTABLE_EVENTS {
        return 1;
    }
    let enough = events.min(largest_bin.saturating_mul(2));
    let doublings = enough.div_ceil(RUN_EVENTS).max(1).next_power_of_two().ilog2();
    let goes_across = u64::from(RUN_EVENTS) << doublings < u64::from(events);
    2 + doublings + u32::from(goes_across)
}

impl Rig {
    /// Sorts the packets of the cameras that have a time in `t_ns`, or of their outlets.
    pub(super) fn merge(&mut self, t_ns: &[Option<i64>], merge: &Merge) -> Result<(), EngineError> {
        self.prepare_rows(t_ns);
        let cameras = self.cameras.len() as u32;
        let (first_camera, count) = if merge.outlets { (cameras, self.outlets()) } else { (0, cameras) };
        let groups = merge.most_events.div_ceil(RUN_EVENTS).min(MOST_GROUPS);
        let outlets = u32::from(merge.outlets);
        self.submit_apart(|rig, commands| {
            for level in 0..merge.passes {
                record_barrier(&rig.device, commands);
                let push = Push { first_camera, level, outlets, ..Push::default() };
                // SAFETY: as for the commands in `submit_apart`; the kernel stays within what its camera's row gives it.
                unsafe {
                    rig.pipelines.kernels.merge.record(commands, bytes_of(&push), [groups, count, 1]);
                }
            }
            if merge.sorts_bins {
                record_barrier(&rig.device, commands);
                let push = Push { first_camera, outlets, merged: 1, ..Push::default() };
                // SAFETY: as above.
                unsafe { rig.record_sort(commands, push, count) };
            }
        })
    }

    /// Lets `readout` go on for the cameras that have a time in `t_ns`. Their packets are sorted, by `merge` if they are
    /// heavy. `is_first`: for the first time in a tick, in which all take part for which it has to go on.
    pub(super) fn continue_readout(
        &mut self,
        t_ns: &[Option<i64>],
        is_first: bool,
    ) -> Result<(), EngineError> {
        self.prepare_rows(t_ns);
        self.submit_apart(|rig, commands| {
            record_barrier(&rig.device, commands);
            // SAFETY: as for the commands in `submit_apart`; the kernels stay within what their cameras' rows give them.
            unsafe {
                // Else the tick's first submission has brought back what was deferred.
                if rig.pipelines.policy.readout_light && is_first {
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
    fn passes_leave_one_run_or_none_that_a_bin_could_cross_twice() {
        for events in [0, 1, 2047, 2048, 2049, 4097, 65_536, 65_537, 1 << 29] {
            for largest in [0, 1, 2047, 2049, 40_000, 1 << 28, events].map(|largest| events.min(largest)) {
                let after = |merges: u32| u64::from(RUN_EVENTS) << merges;
                let all = passes(events, largest);
                let whole =
                    (0..).find(|&merges| after(merges) >= u64::from(events)).expect("a number of passes");
                let across = (1..)
                    .find(|&merges| after(merges) >= 2 * u64::from(largest))
                    .expect("a number of passes");
                let expected = if largest > SORTABLE_EVENTS { 2 + whole.min(across + 1) } else { 1 };
                assert_eq!(all, expected, "{events} events, {largest} in a bin");
            }
        }
    }
}
