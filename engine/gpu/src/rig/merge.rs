//! Packets with bins that `sort` leaves alone: the host, which learns of them after the tick, submits
//! `merge` for their cameras. It is recorded each time, since the number of passes follows from the packets.

use super::Rig;
use super::record::{MOST_GROUPS, STAMPS};
use crate::commands::Around;
use crate::error::EngineError;
use crate::kernel::{record_barrier, record_host_barrier};
use bytemuck::bytes_of;
use esaac_model::layout::{Push, RUN_EVENTS};

/// Passes over a packet: one that ranks runs, and those that merge them two by two until one is left.
fn levels(packet_events: u32) -> u32 {
    1 + packet_events.div_ceil(RUN_EVENTS).max(1).next_power_of_two().ilog2()
}

impl Rig {
    /// Sorts the packets of the cameras that have a time in `t_ns`, the largest of `most_events`.
    pub(super) fn merge(&mut self, t_ns: &[Option<i64>], most_events: u32) -> Result<(), EngineError> {
        self.prepare(t_ns)?;
        let cameras = self.cameras.len() as u32;
        let groups = most_events.div_ceil(RUN_EVENTS).min(MOST_GROUPS);
        self.merging.record(|commands| {
            self.timer.record_reset(commands, STAMPS..STAMPS + 2);
            self.timer.record(commands, STAMPS);
            for level in 0..levels(most_events) {
                record_barrier(&self.device, commands);
                let push = Push { level, ..Push::default() };
                self.kernels.merge.record(commands, bytes_of(&push), [groups, cameras, 1]);
            }
            record_host_barrier(&self.device, commands);
            self.timer.record(commands, STAMPS + 1);
        })?;
        self.submit(&self.merging, &Around::default())?;
        self.count_again()
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
