//! What a tick does, as commands.

use super::code::Code;
use super::parameters::{
    CrossConstants, EnhanceConstants, IngestConstants, PERMUTATION_DELAY, Permutation, camera_row,
    cross_constants, cross_parts, enhance_constants, ingest_constants, ingest_parts, permutation,
};
use super::{CameraState, Rig};
use crate::commands::Commands;
use crate::device::Device;
use crate::error::EngineError;
use crate::kernel::{BindingSet, Kernel, record_barrier, record_host_barrier, stages};
use ash::vk;
use bytemuck::bytes_of;
use esaac_model::layout::{self, GROUP_BINS, GROUP_BINS_OF_MANY, MANY_BINS, Push, SOFTWARE_GROUP_BINS};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

/// Stages of a tick, in order; each ends with a time stamp. (`carry` runs beside the first, `merge` only
/// when the host asks for it.)
pub(super) const STAGES: &[&str] = &["ingest", "enhance", "cross", "sort"];

/// Workgroups of a dispatch at the most, on any device.
pub(super) const MOST_GROUPS: u32 = 65_535;

/// Events a thread at the most, on the software driver, where a workgroup costs more than an event. (It ends every
/// loop of a thread that has made 65 535 iterations in all of its loops, and says nothing.)
const SOFTWARE_EVENTS_PER_THREAD: u32 = 64;

/// The same on a GPU, of as many events as there is room for: what comes is usually less than one.
const GPU_EVENTS_PER_THREAD: u32 = 2;

/// Workgroups a camera for kernels that stride over events: few for a processor, which pays for each.
fn striding_groups(rig: &Rig) -> u32 {
    let events = rig.cameras.iter().map(|c| c.place.event_capacity).max().unwrap_or(0);
    events.div_ceil(256 * events_per_thread(&rig.device)).clamp(4, MOST_GROUPS)
}

/// Events that a thread strides over at the most.
pub(super) fn events_per_thread(device: &Device) -> u32 {
    if device.is_software() { SOFTWARE_EVENTS_PER_THREAD } else { GPU_EVENTS_PER_THREAD }
}

/// Bins that a workgroup of `sort` takes.
fn group_bins(device: &Device, cameras: &[CameraState]) -> u32 {
    let bins: u32 = cameras.iter().map(|c| c.place.bin_count).sum();
    match (device.is_software(), bins) {
        (true, _) => SOFTWARE_GROUP_BINS,
        (false, MANY_BINS..) => GROUP_BINS_OF_MANY,
        (false, _) => GROUP_BINS,
    }
}

/// Specialisation constants of `sort`, by id.
fn sort_constants(device: &Device, cameras: &[CameraState]) -> [u32; 3] {
    let software = device.is_software();
    let threads = if software { layout::SOFTWARE_SORT_THREADS } else { layout::SORT_THREADS };
    [group_bins(device, cameras), threads, u32::from(!software)]
}

/// Stamps of a whole tick; the two after them are those of what runs again, and of `merge`.
pub(super) const STAMPS: u32 = STAGES.len() as u32 + 1;

/// Kernels that are the same for every sensor.
pub(super) struct Kernels {
    carry: Kernel,
    sort: Kernel,
    pub merge: Kernel,
    /// Those that make forms of packets, by stage; compiled when they are first asked for.
    pub forms: HashMap<&'static str, Kernel>,
}

impl Kernels {
    pub(super) fn new(
        device: &Device,
        cameras: &[CameraState],
        code: &Code,
        bindings: &Arc<BindingSet>,
    ) -> Result<Self, EngineError> {
        Ok(Kernels {
            carry: code.kernel(bindings, stages::CARRY, &[])?,
            sort: code.kernel(bindings, stages::SORT, &sort_constants(device, cameras))?,
            merge: code.kernel(bindings, stages::MERGE, &[])?,
            forms: HashMap::new(),
        })
    }
}

/// Kernels that differ from sensor to sensor, by their specialisation constants: what sensors have in
/// common is compiled once.
#[derive(Default)]
pub(super) struct Specialised {
    ingests: HashMap<IngestConstants, Kernel>,
    enhances: HashMap<EnhanceConstants, Kernel>,
    crossings: HashMap<CrossConstants, Kernel>,
}

impl Specialised {
    /// Compiles what a permutation needs and is not there yet.
    fn need(
        &mut self,
        code: &Code,
        bindings: &Arc<BindingSet>,
        permutation: &Permutation,
        crowded: bool,
    ) -> Result<(), EngineError> {
        let ingest = ingest_constants(permutation);
        need(&mut self.ingests, ingest, |key| code.kernel(bindings, stages::INGEST, key))?;
        if let Some(enhance) = enhance_constants(permutation) {
            need(&mut self.enhances, enhance, |key| code.kernel(bindings, stages::ENHANCE, key))?;
        }
        let cross = cross_constants(permutation, crowded);
        need(&mut self.crossings, cross, |key| code.kernel(bindings, stages::CROSS, key))
    }
}

fn need<const N: usize>(
    kernels: &mut HashMap<[u32; N], Kernel>,
    constants: [u32; N],
    compile: impl FnOnce(&[u32]) -> Result<Kernel, EngineError>,
) -> Result<(), EngineError> {
    if let Entry::Vacant(missing) = kernels.entry(constants) {
        missing.insert(compile(&constants)?);
    }
    Ok(())
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
        let _zone = zone!("record");
        let permutations = self.permutations();
        let reads_anew = self.reads_what_the_layer_does_not_know();
        if self.recorded.as_ref() != Some(&permutations) || reads_anew {
            self.record(&permutations)?;
        }
        let order = order(&permutations);
        for (row, &camera) in self.parameters.iter_mut().zip(&order) {
            *row = camera_row(&self.cameras[camera], t_ns[camera], &self.arena);
        }
        self.arena.buffers[layout::CAMERAS].write(0, &self.parameters);
        Ok(())
    }

    /// Whether an input buffer is a new one, if the validation layer watches: it takes down which addresses
    /// are good when commands are recorded, not when they are submitted.
    fn reads_what_the_layer_does_not_know(&mut self) -> bool {
        let known = &mut self.addresses_known_to_the_layer;
        self.device.is_validated()
            && self.cameras.iter().flat_map(|c| c.inputs).filter(|&address| known.insert(address)).count() > 0
    }

    /// Which code each camera needs.
    pub(super) fn permutations(&self) -> Vec<Permutation> {
        // Beyond what texels show there are only addresses.
        let branches = !self.device.is_software();
        let by_address = branches || !self.arena.shows_all_texels();
        // What the validation layer makes of a kernel takes the software driver long to compile: there one has to do.
        let leaves_out = !branches && !self.device.is_validated();
        let of = |c| permutation(c, self.options, by_address, branches, leaves_out);
        self.cameras.iter().map(of).collect()
    }

    /// Every kernel that the rig has compiled.
    pub(super) fn kernels_by_stage(&self) -> impl Iterator<Item = (&'static str, &Kernel)> {
        let (k, s) = (&self.kernels, &self.specialised);
        let ingests = s.ingests.values().map(|ingest| ("ingest", ingest));
        let enhances = s.enhances.values().map(|enhance| ("enhance", enhance));
        let crossings = s.crossings.values().map(|crossing| ("cross", crossing));
        let events = [("carry", &k.carry), ("sort", &k.sort), ("merge", &k.merge)];
        let forms = k.forms.iter().map(|(stage, kernel)| (*stage, kernel));
        ingests.chain(enhances).chain(crossings).chain(events).chain(forms)
    }

    pub(super) fn record(&mut self, permutations: &[Permutation]) -> Result<(), EngineError> {
        for p in permutations {
            self.specialised.need(&self.code, &self.bindings, p, false)?;
        }
        let groups = self.groups(permutations, &order(permutations));
        record_tick(self, &self.commands, &groups, true)?;
        self.recorded = Some(permutations.to_vec());
        self.recorded_again = false;
        Ok(())
    }

    /// Sees to it that `again` holds what a tick does once more when its events did not fit.
    pub(super) fn prepare_again(&mut self) -> Result<(), EngineError> {
        let Some(permutations) = self.recorded.clone().filter(|_| !self.recorded_again) else {
            return Ok(());
        };
        for p in &permutations {
            self.specialised.need(&self.code, &self.bindings, p, true)?;
        }
        let groups = self.groups(&permutations, &order(&permutations));
        record_tick(self, &self.again, &groups, false)?;
        self.recorded_again = true;
        Ok(())
    }

    /// Records anew for the same permutations: the buffers have changed.
    pub(super) fn record_again(&mut self) -> Result<(), EngineError> {
        self.bindings.bind(self.arena.shown());
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
fn record_tick(rig: &Rig, target: &Commands, groups: &[Group], whole: bool) -> Result<(), EngineError> {
    let (device, specialised) = (&rig.device, &rig.specialised);
    let cameras = rig.cameras.len() as u32;
    let bins = rig.cameras.iter().map(|c| c.place.bin_count).max().unwrap_or(0) + 1;
    let first = |first_camera: u32| Push { first_camera, ..Push::default() };
    let all = first(0);
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
        // Kernels that read texels and write words of one buffer, each those of its own cameras: the layer sees the
        // buffer. The software driver runs them one after the other in any case.
        let apart = device.is_validated() || device.is_software();
        rig.timer.record_reset(commands, first_stamp..if whole { STAMPS } else { STAMPS + 2 });
        write_stamp();
        if whole {
            for (index, group) in groups.iter().enumerate() {
                if index > 0 && apart {
                    record_barrier(device, commands);
                }
                let push = first(group.first);
                let ingest = &specialised.ingests[&ingest_constants(&group.permutation)];
                let extent = [group.strips, group.count, ingest_parts(&group.permutation)];
                ingest.record(commands, bytes_of(&push), extent);
                if group.permutation[PERMUTATION_DELAY] != 0 {
                    let extent = [striding_groups(rig), group.count, 1];
                    rig.kernels.carry.record(commands, bytes_of(&push), extent);
                }
            }
            record_barrier(device, commands);
        }
        stage_done();
        let mut enhances = false;
        for group in groups.iter().filter(|_| whole) {
            if let Some(constants) = enhance_constants(&group.permutation) {
                if enhances && apart {
                    record_barrier(device, commands);
                }
                let extent = [group.strips, group.count, 1];
                specialised.enhances[&constants].record(commands, bytes_of(&first(group.first)), extent);
                enhances = true;
            }
        }
        if enhances {
            record_barrier(device, commands);
        }
        stage_done();
        for group in groups {
            let cross = &specialised.crossings[&cross_constants(&group.permutation, !whole)];
            let extent = [group.strips * cross_parts(&group.permutation, !whole), group.count, 1];
            cross.record(commands, bytes_of(&first(group.first)), extent);
        }
        record_barrier(device, commands);
        stage_done();
        let bin_groups = bins.div_ceil(group_bins(device, &rig.cameras));
        rig.kernels.sort.record(commands, bytes_of(&all), [bin_groups, cameras, 1]);
        record_host_barrier(device, commands);
        write_stamp();
    })
}
