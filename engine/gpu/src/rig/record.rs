//! Records a tick's commands.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::kernels::SensorKernels;
use super::permutation::Permutation;
use super::recording::RecordedFor;
use super::synthesize::Part;
use super::{Pipelines, Rig};
use crate::error::EngineError;
use crate::kernel::{Kernel, record_barrier, record_barrier_from_transfer, record_host_barrier};
use ash::vk;
use bytemuck::bytes_of;
use esaac_layout::{self as layout, MOST_PASSES, Push, TICK_STAGES_WITH_BUS};

/// Most workgroups of a dispatch along one axis that every device allows.
pub(super) const MOST_GROUPS: u32 = 65_535;

/// Workgroups per camera for kernels that stride over events.
pub(super) fn striding_groups(rig: &Rig) -> u32 {
    let events = rig.cameras.iter().map(|c| c.place.event_capacity).max().unwrap_or(0);
    events.div_ceil(256 * rig.pipelines.policy.events_per_thread).clamp(4, MOST_GROUPS)
}

/// Workgroups per camera of `paths`, whose threads stride over instances and instants.
const PATHS_GROUPS: u32 = 16;

/// Most workgroups per camera of `poses`, which stride over instances.
const POSES_GROUPS: u32 = 64;

/// Time stamps of a whole tick. The two after them are for submissions that follow: retries and `merge`.
pub(super) const STAMPS: u32 = TICK_STAGES_WITH_BUS.len() as u32 + 1 + 2 * (MOST_PASSES - 1);

/// Cameras that share a permutation; they are neighbours in the table.
pub(super) struct Group {
    pub permutation: Permutation,
    pub first: u32,
    pub count: u32,
    pub tiles: u32,
}

impl Rig {
    /// Workgroups of `poses` for each camera: as many as there are instances of one at most.
    fn poses_groups(&self) -> u32 {
        self.cameras.iter().map(|camera| camera.place.instances).max().unwrap_or(1).min(POSES_GROUPS)
    }

    pub(super) fn groups(&self, permutations: &[Permutation], order: &[usize]) -> Vec<Group> {
        let mut groups: Vec<Group> = Vec::new();
        for (position, &camera) in order.iter().enumerate() {
            let tiles = self.cameras[camera].place.tiles;
            match groups.last_mut() {
                Some(last) if last.permutation == permutations[camera] => {
                    last.count += 1;
                    last.tiles = last.tiles.max(tiles);
                }
                _ => groups.push(Group {
                    permutation: permutations[camera],
                    first: position as u32,
                    count: 1,
                    tiles,
                }),
            }
        }
        groups
    }
}

/// Cameras in the order of the table: those with equal permutations are neighbours.
pub(super) fn order(permutations: &[Permutation]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..permutations.len()).collect();
    order.sort_by_key(|&camera| permutations.iter().position(|p| *p == permutations[camera]));
    order
}

/// Records `cross` for the cameras whose pixels rest, which have [`layout::FrameKind::CatchUp`] in their rows.
pub(super) fn record_catch_up(rig: &Rig, commands: vk::CommandBuffer, groups: &[Group]) {
    let Pipelines { policy, specialised: SensorKernels(specialised), .. } = &rig.pipelines;
    for group in groups.iter().filter(|group| group.permutation.cross.pixels_rest) {
        // The first kernel catches up all tiles.
        let cross = group.permutation.cross(*policy, false).swap_remove(0);
        let push = Push { first_camera: group.first, ..Push::default() };
        let extent = [group.tiles * policy.cross_groups(false), group.count, 1];
        // SAFETY: the commands are submitted and waited for before anything else uses the rig's handles. The kernel stays
        // within what the table gives each camera.
        unsafe { specialised[&cross].record(commands, bytes_of(&push), extent) };
    }
}

/// Records a whole tick, or (`whole` false) the part that runs again when events did not fit.
pub(super) fn record_tick(
    rig: &Rig,
    groups: &[Group],
    needed: &RecordedFor,
    whole: bool,
) -> Result<(), EngineError> {
    let (passes, second_run) = (needed.passes, needed.second_run);
    let Pipelines { policy, specialised: SensorKernels(specialised), .. } = &rig.pipelines;
    let (device, policy) = (&rig.device, *policy);
    let recording = &rig.recordings.ring[rig.arena.current()];
    let target = if whole { &recording.tick } else { &recording.retry };
    let outlets = groups.iter().filter(|g| g.permutation.has_bus).map(|g| g.count).sum::<u32>();
    let cameras = rig.cameras.len() as u32;
    let dispatch = |commands, kernel: &Kernel, first_camera: u32, groups: [u32; 3]| {
        let push = Push { first_camera, ..Push::default() };
        // SAFETY: as for the commands, below; kernels stay within what the table gives each camera.
        unsafe { kernel.record(commands, bytes_of(&push), groups) };
    };
    let record = |commands: vk::CommandBuffer| {
        let first_stamp = if whole { 0 } else { STAMPS };
        let stamp = std::cell::Cell::new(first_stamp);
        let write_stamp = || {
            rig.timing.timer.record(commands, stamp.get());
            stamp.set(stamp.get() + 1);
        };
        let stage_done = || {
            if whole && rig.options.stage_times {
                write_stamp();
            }
        };
        rig.timing.timer.record_reset(commands, first_stamp..if whole { STAMPS } else { STAMPS + 2 });
        write_stamp();
        let synthesizes = groups.iter().any(|group| group.permutation.synthesize(policy).is_some());
        if synthesizes {
            rig.arena.record_zero_passes(device, commands);
        }
        if let Some(poses) = rig.pipelines.kernels.poses.as_ref().filter(|_| needed.poses) {
            for group in groups.iter().filter(|group| group.permutation.rigid) {
                dispatch(commands, poses, group.first, [rig.poses_groups(), group.count, 1]);
            }
            record_barrier(device, commands);
        }
        stage_done();
        if whole {
            for (index, group) in groups.iter().enumerate() {
                if index > 0 && policy.serial {
                    record_barrier(device, commands);
                }
                if let Some(surfaces) = group.permutation.ingest_surfaces(policy) {
                    dispatch(commands, &specialised[&surfaces], group.first, [group.tiles, group.count, 1]);
                    if policy.serial {
                        record_barrier(device, commands);
                    }
                }
                let ingest = &specialised[&group.permutation.ingest(policy)];
                let extent = [group.tiles, group.count, group.permutation.ingest_groups(policy)];
                dispatch(commands, ingest, group.first, extent);
                if group.permutation.any_wait {
                    let extent = [striding_groups(rig), group.count, 1];
                    dispatch(commands, &rig.pipelines.kernels.deferred, group.first, extent);
                }
                if let Some(paths) = rig.pipelines.kernels.paths.as_ref().filter(|_| group.permutation.rigid)
                {
                    dispatch(commands, paths, group.first, [PATHS_GROUPS, group.count, 1]);
                }
            }
            if outlets > 0 && !policy.readout_light {
                if policy.serial {
                    record_barrier(device, commands);
                }
                // SAFETY: as for the commands, below.
                unsafe { rig.record_deferred_of_outlets(commands, outlets) };
            }
        }
        if synthesizes {
            record_barrier_from_transfer(device, commands);
        } else if whole {
            record_barrier(device, commands);
        }
        stage_done();
        // SAFETY: as for the commands, below; here and in what follows.
        let synthesize = |pass, part| unsafe { rig.record_synthesize(commands, groups, pass, part) };
        // Both are chains of reads that leave most of a device idle, so the lists are made beside the transfers.
        if synthesizes {
            synthesize(0, Part::Lists);
            if policy.serial {
                record_barrier(device, commands);
            }
        }
        // SAFETY: as above.
        let transfers = whole && unsafe { rig.record_detail_transfers(commands, groups) };
        if synthesizes || transfers {
            record_barrier(device, commands);
        }
        stage_done();
        let cross = |pass, reads_levels| {
            let kernels = groups.iter().flat_map(|group| {
                group.permutation.cross(policy, !whole).into_iter().map(move |cross| (group, cross))
            });
            let kernels = kernels.filter(|(_, cross)| cross.reads_levels() == reads_levels);
            for (index, (group, cross)) in kernels.enumerate() {
                if index > 0 && policy.serial {
                    record_barrier(device, commands);
                }
                let push = Push { first_camera: group.first, level: pass, passes, ..Push::default() };
                let extent = [group.tiles * policy.cross_groups(!whole), group.count, 1];
                // SAFETY: as above.
                unsafe { specialised[&cross].record(commands, bytes_of(&push), extent) };
            }
        };
        for pass in 0..passes {
            if synthesizes {
                if pass > 0 {
                    synthesize(pass, Part::Lists);
                    record_barrier(device, commands);
                }
                synthesize(pass, Part::Levels);
                if pass == 0 {
                    // What needs no levels goes on beside them.
                    if policy.serial {
                        record_barrier(device, commands);
                    }
                    cross(pass, false);
                }
                record_barrier(device, commands);
            }
            stage_done();
            if synthesizes {
                cross(pass, true);
            } else if pass == 0 {
                cross(pass, false);
            }
            record_barrier(device, commands);
            if second_run > 0 && pass + 1 == passes {
                for group in groups {
                    if let Some(kernel) = group.permutation.second_run(policy) {
                        let extent = [second_run, group.count, 1];
                        dispatch(commands, &specialised[&kernel], group.first, extent);
                    }
                }
                record_barrier(device, commands);
            }
            stage_done();
        }
        if let Some(sums) = rig.pipelines.kernels.bin_sums.as_ref().filter(|_| outlets == 0) {
            let most = rig.cameras.iter().map(|c| c.place.bin_count).max().unwrap_or(0);
            dispatch(commands, sums, 0, [most.div_ceil(layout::SUMMED_BINS), cameras, 1]);
            record_barrier(device, commands);
        }
        // SAFETY: as for the commands, below.
        unsafe { rig.record_sort(commands, Push::default(), cameras) };
        if outlets > 0 {
            if policy.readout_light {
                stage_done();
            } else {
                record_barrier(device, commands);
                stage_done();
                // SAFETY: as for the commands, below.
                unsafe { rig.record_readout(commands, outlets, false) };
            }
        }
        record_host_barrier(device, commands);
        write_stamp();
    };
    // SAFETY: no submission of the commands is pending, or the rig would be lost. The rig owns the handles that they
    // use; nothing else uses these within a tick, and `Device::retire` keeps them if a wait fails. The caller of the
    // step keeps the frames alive.
    unsafe { target.record(record) }
}
