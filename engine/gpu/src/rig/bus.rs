//! Recording of `sort`, and of what cameras with a bus need: `readout`, and what comes back from earlier ticks.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::Rig;
use super::record::{MOST_GROUPS, striding_groups};
use super::sensor::has_bus;
use crate::kernel::record_barrier;
use ash::vk;
use bytemuck::bytes_of;
use esaac_layout::Push;

impl Rig {
    /// Cameras that have a bus.
    pub(super) fn outlets(&self) -> u32 {
        self.cameras.iter().filter(|camera| has_bus(&camera.config.sensor)).count() as u32
    }

    /// Workgroups of `sort` for each camera.
    pub(super) fn bin_groups(&self) -> u32 {
        let bins = self.cameras.iter().map(|c| c.place.bin_count).max().unwrap_or(0) + 1;
        bins.div_ceil(self.pipelines.kernels.sorting.group_bins)
    }

    /// Workgroups of `readout_apart` for each camera: one for each stretch of a packet that fills the event buffers.
    fn stretch_groups(&self) -> u32 {
        let events = self.cameras.iter().map(|c| c.place.event_capacity).max().unwrap_or(0);
        events.div_ceil(self.pipelines.policy.readout_threads / 2).clamp(1, MOST_GROUPS)
    }

    /// Records `sort` for `count` rows of the table from `push.first_camera` on.
    ///
    /// # Safety
    /// As of [`crate::kernel::Kernel::record`].
    pub(super) unsafe fn record_sort(&self, commands: vk::CommandBuffer, push: Push, count: u32) {
        let kernels = &self.pipelines.kernels;
        let kernel = match &kernels.bus {
            Some(bus) if self.outlets() > 0 => &bus.sort,
            _ => &kernels.sort,
        };
        // SAFETY: the caller's contract is the same.
        unsafe { kernel.record(commands, bytes_of(&push), [self.bin_groups(), count, 1]) };
    }

    /// Records `deferred` for outlets: what has left the buses in earlier ticks comes back.
    ///
    /// # Safety
    /// As of [`crate::kernel::Kernel::record`].
    pub(super) unsafe fn record_deferred_of_outlets(&self, commands: vk::CommandBuffer, outlets: u32) {
        let push = Push { first_camera: self.cameras.len() as u32, ..Push::default() };
        let groups = [striding_groups(self), outlets, 1];
        // SAFETY: the caller's contract is the same.
        unsafe { self.pipelines.kernels.deferred.record(commands, bytes_of(&push), groups) };
    }

    /// Records `readout`, and the sort of what has left the buses. `merged`: whether heavy packets are sorted.
    ///
    /// # Safety
    /// As of [`crate::kernel::Kernel::record`].
    pub(super) unsafe fn record_readout(&self, commands: vk::CommandBuffer, outlets: u32, merged: bool) {
        let cameras = self.cameras.len() as u32;
        let push = Push { merged: u32::from(merged), ..Push::default() };
        let kernels = self.pipelines.kernels.bus.as_ref().expect("compiled when a camera needs it");
        for level in [0, 1].iter().filter(|_| kernels.apart.is_some()) {
            let push = Push { level: *level, ..push };
            let groups = [self.stretch_groups(), cameras, 1];
            // SAFETY: the caller's contract is the same.
            unsafe { kernels.apart.iter().for_each(|apart| apart.record(commands, bytes_of(&push), groups)) };
            record_barrier(&self.device, commands);
        }
        let kernel = &kernels.readout;
        for _ in 0..self.pipelines.policy.readout_dispatches {
            // SAFETY: the caller's contract is the same.
            unsafe { kernel.record(commands, bytes_of(&push), [1, cameras, 1]) };
            record_barrier(&self.device, commands);
        }
        // SAFETY: the caller's contract is the same.
        unsafe {
            self.record_sort(commands, Push { first_camera: cameras, outlets: 1, ..Push::default() }, outlets)
        };
    }
}
