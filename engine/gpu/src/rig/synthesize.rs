//! Recording of `synthesize`, the stage that makes levels for `cross`.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::Rig;
use super::geometry::level_passes;
use super::record::Group;
use crate::kernel::record_barrier;
use ash::vk;
use bytemuck::bytes_of;
use esaac_layout::{self as layout, Push};

/// Most workgroups that stride over the entries of `synthesize`.
const ENTRY_GROUPS: u64 = 4096;

/// The parts of `synthesize`. Each waits for the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// What the pixels of each tile may show. It needs no half-pel frames.
    Lists,
    /// Levels of these pixels.
    Levels,
}

impl Rig {
    /// Passes of `synthesize` and `cross`, in a whole tick or (`whole` false) in the part that runs again.
    pub(super) fn passes(&self, whole: bool) -> u32 {
        let most = level_passes(self.cameras.iter().map(|c| &c.place), self.pipelines.policy);
        if whole { self.passes.count(most) } else { most }
    }

    /// Records a part of a pass of `synthesize`.
    ///
    /// # Safety
    /// As of [`crate::kernel::Kernel::record`].
    pub(super) unsafe fn record_synthesize(
        &self,
        commands: vk::CommandBuffer,
        groups: &[Group],
        pass: u32,
        part: Part,
    ) {
        let policy = self.pipelines.policy;
        let of_part = groups.iter().filter_map(|group| Some((group, group.permutation.synthesize(policy)?)));
        for (index, (group, [lists, levels])) in of_part.enumerate() {
            if index > 0 && policy.serial {
                record_barrier(&self.device, commands);
            }
            let (kernel, extent) = match part {
                Part::Lists => (lists, [group.tiles, group.count, 1]),
                Part::Levels => (levels, [self.entry_groups(), 1, 1]),
            };
            let push =
                Push { first_camera: group.first, cameras: group.count, level: pass, ..Push::default() };
            let kernel = &self.pipelines.specialised.0[&kernel];
            // SAFETY: the caller's contract is the same.
            unsafe { kernel.record(commands, bytes_of(&push), extent) };
        }
    }

    /// Workgroups of `synthesize` that stride over the entries of all cameras: as many as fill a device some times over, or
    /// as there may be entries.
    fn entry_groups(&self) -> u32 {
        let entries = self.arena.buffer(layout::LEVEL_ENTRIES).bytes() / size_of::<[u32; 4]>() as u64;
        entries.min(ENTRY_GROUPS) as u32
    }
}
