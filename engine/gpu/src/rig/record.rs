//! What a tick does, as commands.

use super::Rig;
use super::code::Code;
use super::parameters::{
    PERMUTATION_CROWDED, PERMUTATION_DELAY, Permutation, camera_row, channels_of, ingest_constants,
    lattice_of, permutation,
};
use crate::error::EngineError;
use crate::kernel::{BindingSet, Commands, Kernel, record_barrier, record_host_barrier, stages};
use ash::vk;
use esaac_model::layout;
use esaac_model::synthesis::TRANSFERS;
use std::collections::HashMap;
use std::sync::Arc;

/// Stages of a tick, in order; each ends with a time stamp.
pub(super) const STAGES: &[&str] = &["ingest", "enhance", "cross", "scatter", "sort", "readback"];

/// Workgroups a camera for kernels that stride over events: enough to fill a GPU, few for a processor.
fn striding_groups(rig: &Rig) -> u32 {
    if rig.device.info().kind == "software" { 4 } else { 128 }
}

/// Stamps of a whole tick; the two after them are those of what runs again.
pub(super) const STAMPS: u32 = STAGES.len() as u32 + 1;

/// Kernels that are the same for every sensor.
pub(super) struct Kernels {
    carry: Kernel,
    scatter: Kernel,
    sort: Kernel,
    readback: Kernel,
}

impl Kernels {
    pub(super) fn new(code: &Code, bindings: &Arc<BindingSet>) -> Result<Self, EngineError> {
        Ok(Kernels {
            carry: code.kernel(bindings, stages::CARRY, &[])?,
            scatter: code.kernel(bindings, stages::SCATTER, &[])?,
            sort: code.kernel(bindings, stages::SORT, &[])?,
            readback: code.kernel(bindings, stages::READBACK, &[])?,
        })
    }
}

/// Kernels that prepare a frame.
pub(super) struct Ingest {
    ingest: Kernel,
    /// One kernel a pass, where warps read a lattice.
    enhance: Option<[Kernel; 2]>,
}

/// Cameras that share a permutation: neighbours in the table.
struct Group {
    permutation: Permutation,
    first: u32,
    count: u32,
    strips: u32,
}

impl Rig {
    /// Fills the table for a tick, and records the commands if they are not those of the last tick.
    pub(super) fn prepare(&mut self, t_ns: &[Option<i64>]) -> Result<(), EngineError> {
        let permutations = self.permutations();
        if self.recorded.as_ref() != Some(&permutations) {
            self.record(&permutations)?;
        }
        let order = order(&permutations);
        for (row, &camera) in self.parameters.iter_mut().zip(&order) {
            *row = camera_row(&self.cameras[camera], t_ns[camera], self.arena.samples_pixels as u32);
        }
        self.arena.buffers[layout::CAMERAS].write(0, &self.parameters);
        Ok(())
    }

    /// Which code each camera needs.
    pub(super) fn permutations(&self) -> Vec<Permutation> {
        // The software driver runs both sides of a branch.
        let branches = self.device.info().kind != "software";
        self.cameras.iter().map(|c| permutation(c, self.options, branches)).collect()
    }

    pub(super) fn record(&mut self, permutations: &[Permutation]) -> Result<(), EngineError> {
        for p in permutations {
            self.need_crossing(p)?;
            let key = ingest_constants(p);
            if !self.ingests.contains_key(&key) {
                let ingest = self.code.kernel(&self.bindings, stages::INGEST, &key)?;
                let enhance = if lattice_of(p) {
                    Some([
                        self.code.kernel(&self.bindings, stages::ENHANCE, &[p[0], 0, p[12]])?,
                        self.code.kernel(&self.bindings, stages::ENHANCE, &[p[0], 1, p[12]])?,
                    ])
                } else {
                    None
                };
                self.ingests.insert(key, Ingest { ingest, enhance });
            }
        }
        let groups = self.groups(permutations, &order(permutations));
        record_tick(self, &self.commands, &groups, &self.crossings, &self.ingests, true)?;
        self.recorded = Some(permutations.to_vec());
        self.recorded_again = false;
        Ok(())
    }

    fn need_crossing(&mut self, permutation: &Permutation) -> Result<(), EngineError> {
        if !self.crossings.contains_key(permutation) {
            let crossing = self.code.kernel(&self.bindings, stages::CROSS, permutation)?;
            self.crossings.insert(*permutation, crossing);
        }
        Ok(())
    }

    /// Sees to it that `again` holds what a tick does once more when its events did not fit.
    pub(super) fn prepare_again(&mut self) -> Result<(), EngineError> {
        let Some(permutations) = self.recorded.clone().filter(|_| !self.recorded_again) else {
            return Ok(());
        };
        for p in &permutations {
            let mut crowded = *p;
            crowded[PERMUTATION_CROWDED] = 1;
            self.need_crossing(&crowded)?;
        }
        let groups = self.groups(&permutations, &order(&permutations));
        record_tick(self, &self.again, &groups, &self.crossings, &self.ingests, false)?;
        self.recorded_again = true;
        Ok(())
    }

    /// Records anew for the same permutations: the buffers have changed.
    pub(super) fn record_again(&mut self) -> Result<(), EngineError> {
        self.bindings.bind(self.arena.buffers());
        match self.recorded.take() {
            Some(permutations) => self.record(&permutations),
            None => Ok(()),
        }
    }

    fn groups(&self, permutations: &[Permutation], order: &[usize]) -> Vec<Group> {
        let mut groups: Vec<Group> = Vec::new();
        for (position, &camera) in order.iter().enumerate() {
            let strips = self.cameras[camera].place.strips;
            match groups.last_mut() {
                Some(last) if last.permutation == permutations[camera] => {
                    last.count += 1;
                    last.strips = last.strips.max(strips);
                }
                _ => groups.push(Group {
                    permutation: permutations[camera],
                    first: position as u32,
                    count: 1,
                    strips,
                }),
            }
        }
        groups
    }
}

/// Cameras sorted by permutation.
pub(super) fn order(permutations: &[Permutation]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..permutations.len()).collect();
    order.sort_by_key(|&camera| permutations[camera]);
    order
}

/// A whole tick, or (`whole` false) the part that runs again once events have room.
fn record_tick(
    rig: &Rig,
    target: &Commands,
    groups: &[Group],
    crossings: &HashMap<Permutation, Kernel>,
    ingests: &HashMap<[u32; 4], Ingest>,
    whole: bool,
) -> Result<(), EngineError> {
    let device = &rig.device;
    let cameras = rig.cameras.len() as u32;
    let bins = rig.cameras.iter().map(|c| c.place.bin_count).max().unwrap_or(0) + 1;
    let all = 0_u32.to_ne_bytes();
    target.record(|commands: vk::CommandBuffer| {
        let first_stamp = if whole { 0 } else { STAMPS };
        let stamp = std::cell::Cell::new(first_stamp);
        let write_stamp = || {
            rig.timer.record(commands, stamp.get());
            stamp.set(stamp.get() + 1);
        };
        let stage_done = || {
            if whole && rig.options.stage_times {
                write_stamp();
            }
        };
        rig.timer.record_reset(commands, first_stamp..if whole { STAMPS } else { STAMPS + 2 });
        write_stamp();
        if whole {
            for group in groups {
                let push = group.first.to_ne_bytes();
                let ingest = &ingests[&ingest_constants(&group.permutation)].ingest;
                ingest.record(commands, &push, [group.strips, group.count, 1]);
                if group.permutation[PERMUTATION_DELAY] != 0 {
                    rig.kernels.carry.record(commands, &push, [striding_groups(rig), group.count, 1]);
                }
            }
            record_barrier(device, commands);
        }
        stage_done();
        let lattices: Vec<_> = groups
            .iter()
            .filter(|_| whole)
            .filter_map(|g| Some((g, ingests[&ingest_constants(&g.permutation)].enhance.as_ref()?)))
            .collect();
        for pass in (0..2).cycle().take(TRANSFERS as usize) {
            for (group, enhance) in &lattices {
                let extent = [group.strips, group.count, channels_of(&group.permutation)];
                enhance[pass].record(commands, &group.first.to_ne_bytes(), extent);
            }
            if !lattices.is_empty() {
                record_barrier(device, commands);
            }
        }
        stage_done();
        for group in groups {
            let push = group.first.to_ne_bytes();
            let mut permutation = group.permutation;
            permutation[PERMUTATION_CROWDED] = u32::from(!whole);
            crossings[&permutation].record(commands, &push, [group.strips, group.count, 1]);
        }
        record_barrier(device, commands);
        stage_done();
        rig.kernels.scatter.record(commands, &all, [striding_groups(rig), cameras, 1]);
        record_barrier(device, commands);
        stage_done();
        rig.kernels.sort.record(commands, &all, [bins, cameras, 1]);
        stage_done();
        if !device.unified_memory() {
            record_barrier(device, commands);
            rig.kernels.readback.record(commands, &all, [striding_groups(rig), cameras, 1]);
        }
        record_host_barrier(device, commands);
        write_stamp();
    })
}
