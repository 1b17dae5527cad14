//! Recording of `detail_transfer`: the transfers of detail after the first one, which `ingest` does.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::Rig;
use super::record::Group;
use crate::kernel::record_barrier;
use ash::vk;
use bytemuck::bytes_of;
use esaac_layout::Push;

impl Rig {
    /// Records the transfers of all groups, each number of them behind a barrier but the first. Says whether there are any.
    ///
    /// # Safety
    /// As of [`crate::kernel::Kernel::record`].
    pub(super) unsafe fn record_detail_transfers(
        &self,
        commands: vk::CommandBuffer,
        groups: &[Group],
    ) -> bool {
        let most = groups.iter().map(|group| group.permutation.transfers).max().unwrap_or(0);
        for number in 1..most {
            if number > 1 {
                record_barrier(&self.device, commands);
            }
            let taking =
                groups.iter().filter_map(|group| Some((group, group.permutation.detail_transfer(number)?)));
            for (index, (group, kernel)) in taking.enumerate() {
                if index > 0 && self.pipelines.policy.serial {
                    record_barrier(&self.device, commands);
                }
                let push = Push { first_camera: group.first, level: number, ..Push::default() };
                let kernel = &self.pipelines.specialised.0[&kernel];
                // SAFETY: the caller's contract is the same.
                unsafe { kernel.record(commands, bytes_of(&push), [group.tiles, group.count, 1]) };
            }
        }
        most > 1
    }
}
