//! Recording of a tick's commands.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::code::Code;
use super::parameters::{
    Permutation, Specialised, camera_row, has_bus, has_optics, is_physical, is_rigid, optics_row, outlet_row,
    permutation, physical_row, readout, readout_apart, readout_row, sort,
};
use super::rest::rest_row;
use super::{CameraState, Pipelines, Recordings, Rig};
use crate::commands::Commands;
use crate::device::Device;
use crate::error::EngineError;
use crate::instance::Validation;
use crate::kernel::{
    BindingSet, Kernel, record_barrier, record_barrier_from_transfer, record_host_barrier, stages,
};
use crate::policy::KernelPolicy;
use ash::vk;
use bytemuck::bytes_of;
use esaac_layout::{
    self as layout, Counters, KERNELS, KernelInfo, MOST_PASSES, Push, ReadoutProgress, TICK_STAGES_WITH_BUS,
};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

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

/// Bins that a workgroup of `sort` takes.
pub(super) fn group_bins(policy: KernelPolicy, cameras: &[CameraState]) -> u32 {
    policy.group_bins_of(cameras.iter().map(|c| c.place.bin_count).sum(), cameras.len() as u32)
}

/// Whether `bin_sums` runs before `sort` in a rig without a bus.
pub(super) fn sums_bins(policy: KernelPolicy, cameras: &[CameraState]) -> bool {
    let group_bins = u64::from(group_bins(policy, cameras));
    let bins = cameras.iter().map(|c| u64::from(c.place.bin_count));
    bins.map(|bins| bins * bins / group_bins).sum::<u64>() >= policy.summed_reads
}

/// Time stamps of a whole tick. The two after them are for submissions that follow: retries and `merge`.
pub(super) const STAMPS: u32 = TICK_STAGES_WITH_BUS.len() as u32 + 1 + 2 * (MOST_PASSES - 1);

/// Kernels that are the same for every sensor.
pub(super) struct Kernels {
    pub deferred: Kernel,
    /// Compiled when a camera needs it first.
    paths: Option<Kernel>,
    /// If bins are summed before they are sorted.
    bin_sums: Option<Kernel>,
    /// Compiled when the device works out poses first.
    pub poses: Option<Kernel>,
    sort: Kernel,
    pub merge: Kernel,
    /// Compiled when a camera needs it first.
    pub bus: Option<BusKernels>,
    /// Kernels that make representations of packets, by stage; compiled at their first use.
    pub forms: HashMap<&'static str, Kernel>,
}

/// Kernels of rigs in which a camera has a bus.
pub(super) struct BusKernels {
    pub readout: Kernel,
    /// `None` if chunks are not served side by side.
    pub apart: Option<Kernel>,
    pub sort: Kernel,
}

impl Kernels {
    pub(super) fn new(
        policy: KernelPolicy,
        cameras: &[CameraState],
        code: &Code,
        bindings: &Arc<BindingSet>,
    ) -> Result<Self, EngineError> {
        let summed = sums_bins(policy, cameras);
        Ok(Kernels {
            deferred: code.plain_kernel(bindings, stages::DEFERRED)?,
            paths: None,
            poses: None,
            bin_sums: match summed {
                true => Some(code.plain_kernel(bindings, stages::BIN_SUMS)?),
                false => None,
            },
            sort: code.kernel(bindings, &sort(policy, group_bins(policy, cameras), false, summed))?,
            merge: code.plain_kernel(bindings, stages::MERGE)?,
            bus: None,
            forms: HashMap::new(),
        })
    }

    /// Compiles the kernels that the permutations of `cameras`, and poses from the device if it works them out, need and
    /// that are missing.
    pub(super) fn need(
        &mut self,
        policy: KernelPolicy,
        cameras: &[CameraState],
        code: &Code,
        bindings: &Arc<BindingSet>,
        permutations: &[Permutation],
        poses: bool,
    ) -> Result<(), EngineError> {
        if self.poses.is_none() && poses {
            self.poses = Some(code.plain_kernel(bindings, stages::POSES)?);
        }
        if self.paths.is_none() && permutations.iter().any(|p| p.rigid) {
            self.paths = Some(code.plain_kernel(bindings, stages::PATHS)?);
        }
        if self.bus.is_none() && permutations.iter().any(|p| p.has_bus) {
            self.bus = Some(BusKernels {
                readout: code.kernel(bindings, &readout(policy))?,
                apart: match policy.readout_apart {
                    true => Some(code.kernel(bindings, &readout_apart(policy))?),
                    false => None,
                },
                sort: code.kernel(bindings, &sort(policy, group_bins(policy, cameras), true, false))?,
            });
        }
        Ok(())
    }
}

/// Kernels that differ from sensor to sensor, by their specialisation constants. Sensors with equal constants share
/// them.
#[derive(Default)]
pub(super) struct SensorKernels(pub HashMap<Specialised, Kernel>);

impl SensorKernels {
    /// Compiles the kernels of a permutation that are missing.
    pub(super) fn need(
        &mut self,
        code: &Code,
        bindings: &Arc<BindingSet>,
        policy: KernelPolicy,
        permutation: &Permutation,
        queue_overflowed: bool,
    ) -> Result<(), EngineError> {
        let needed = [
            Some(permutation.ingest(policy)),
            permutation.ingest_surfaces(policy),
            permutation.backward_transfer(),
        ];
        let needed = needed.into_iter().flatten().chain(permutation.synthesize(policy));
        for specialised in needed.chain(permutation.cross(policy, queue_overflowed)) {
            self.need_one(code, bindings, specialised)?;
        }
        Ok(())
    }

    /// Compiles a kernel if it is missing.
    fn need_one(
        &mut self,
        code: &Code,
        bindings: &Arc<BindingSet>,
        specialised: Specialised,
    ) -> Result<(), EngineError> {
        if let Entry::Vacant(missing) = self.0.entry(specialised) {
            let kernel = code.kernel(bindings, missing.key())?;
            missing.insert(kernel);
        }
        Ok(())
    }
}

/// Cameras that share a permutation; they are neighbours in the table.
pub(super) struct Group {
    pub permutation: Permutation,
    pub first: u32,
    pub count: u32,
    pub tiles: u32,
}

/// The commands of a tick that writes one set of packet buffers.
pub(super) struct Recording {
    /// The whole tick.
    pub tick: Commands,
    /// The part of the tick that runs again when events did not fit.
    pub retry: Commands,
    /// Whether the set's descriptors name the current buffers.
    bound: bool,
    /// What each was recorded for; `None` if it must be recorded.
    tick_for: Option<RecordedFor>,
    retry_for: Option<RecordedFor>,
}

/// The second run of `cross` in a tick.
#[derive(Clone, Copy, Default, PartialEq)]
struct Second {
    /// Workgroups for each camera; 0 if there is no such run.
    groups: u32,
    without_queue: bool,
}

/// What recorded commands are good for.
#[derive(PartialEq)]
struct RecordedFor {
    permutations: Vec<Permutation>,
    /// Passes of `synthesize` and `cross`.
    passes: u32,
    /// The second run of `cross`.
    second_run: Second,
    /// Whether they work out poses.
    poses: bool,
    /// Number of addresses that the device had told; 0 where the validation layer does not look at shaders.
    addresses: u64,
}

impl Recording {
    pub(super) fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        Ok(Recording {
            tick: Commands::new(device)?,
            retry: Commands::new(device)?,
            bound: false,
            tick_for: None,
            retry_for: None,
        })
    }

    /// Marks descriptors and commands as out of date, after buffers have changed.
    pub(super) fn unbind(&mut self) {
        self.bound = false;
        self.forget();
    }

    fn forget(&mut self) {
        self.tick_for = None;
        self.retry_for = None;
    }
}

impl Recordings {
    /// Marks all descriptors and commands as out of date, after buffers have changed.
    pub(super) fn unbind(&mut self) {
        self.ring.iter_mut().for_each(Recording::unbind);
    }

    /// Marks all commands as out of date, after pipelines have changed.
    #[cfg(feature = "shaderc")]
    pub(super) fn forget(&mut self) {
        self.ring.iter_mut().for_each(Recording::forget);
    }
}

impl Rig {
    /// Fills the table for a tick, and records the commands unless those of an earlier tick will do. The cameras' state
    /// on the device does not change.
    pub(super) fn prepare(&mut self, t_ns: &[Option<i64>]) -> Result<(), EngineError> {
        let _zone = zone!("record");
        let room = self.arena.has_room_for_tracks();
        self.poses_by.choose(&self.cameras, t_ns, self.pipelines.policy, room);
        let needed = self.needed_recording(true);
        self.timing.with_bus = self.outlets() > 0;
        self.timing.passes = needed.passes;
        self.bind_current();
        if self.recording().tick_for.as_ref() != Some(&needed) {
            self.record(needed, true)?;
        }
        self.prepare_rows(t_ns);
        self.prepare_reports(t_ns);
        self.prepare_poses(t_ns);
        Ok(())
    }

    /// Fills the tables of instances and of poses, or of tracks, for a tick.
    fn prepare_poses(&mut self, t_ns: &[Option<i64>]) {
        for (camera, t_ns) in self.cameras.iter().zip(t_ns) {
            if t_ns.is_some() && is_rigid(&camera.config.sensor) {
                let known = camera.instances.known();
                self.arena.table(layout::INSTANCES).write(camera.place.instance_base as usize, known);
            }
        }
        let by = self.poses_by;
        if by.device {
            by.write_tracks(&self.cameras, t_ns, self.arena.track_tables());
        } else {
            by.write_poses(&self.cameras, t_ns, self.arena.table(layout::POSES).all_mut());
        }
    }

    /// As `prepare`, for the part of a tick that runs again when events did not fit.
    pub(super) fn prepare_retry(&mut self, t_ns: &[Option<i64>]) -> Result<(), EngineError> {
        let needed = self.needed_recording(false);
        self.bind_current();
        if self.recording().retry_for.as_ref() != Some(&needed) {
            self.record(needed, false)?;
        }
        self.prepare_rows(t_ns);
        self.prepare_reports(t_ns);
        Ok(())
    }

    /// Fills the table of cameras for the next submission.
    pub(super) fn prepare_rows(&mut self, t_ns: &[Option<i64>]) {
        if self.cameras.iter().any(|camera| is_rigid(&camera.config.sensor)) {
            let geometries: Vec<_> = self.cameras.iter().map(CameraState::geometry_row).collect();
            self.arena.table(layout::GEOMETRIES).write(0, &geometries);
        }
        if self.cameras.iter().any(|camera| is_physical(&camera.config.sensor)) {
            let physicals: Vec<_> = self.cameras.iter().map(|c| physical_row(&c.config.sensor)).collect();
            self.arena.table(layout::PHYSICALS).write(0, &physicals);
        }
        if self.cameras.iter().any(|camera| has_optics(&camera.config.sensor)) {
            let rows: Vec<_> = self.cameras.iter().zip(t_ns).map(|(c, t_ns)| optics_row(c, *t_ns)).collect();
            self.arena.table(layout::OPTICS).write(0, &rows);
        }
        let permutations = self.permutations();
        if permutations.iter().any(|permutation| permutation.cross.pixels_rest) {
            let rows: Vec<_> = self.cameras.iter().zip(t_ns).map(|(c, t_ns)| rest_row(c, *t_ns)).collect();
            self.arena.table(layout::RESTS).write(0, &rows);
        }
        let order = order(&permutations);
        self.parameters.clear();
        self.parameters
            .extend(order.iter().map(|&camera| camera_row(&self.cameras[camera], t_ns[camera], &self.arena)));
        if self.cameras.iter().any(|camera| camera.place.has_bus) {
            self.prepare_readouts(&order);
        }
        self.arena.table(layout::CAMERAS).write(0, &self.parameters);
    }

    /// Resets the reports of outlets. Where `sort` serves, it says in them what it has served, and where it could not.
    fn prepare_reports(&mut self, t_ns: &[Option<i64>]) {
        let fresh = Counters { progress: ReadoutProgress::Done as u32, ..Counters::default() };
        for (camera, _) in self.cameras.iter().zip(t_ns).filter(|(_, t_ns)| t_ns.is_some()) {
            if has_bus(&camera.config.sensor) {
                self.arena.table(layout::REPORT).write(camera.outlet.slot as usize, &[fresh]);
            }
        }
    }

    /// Adds the rows of outlets to the table of cameras, in the order of their cameras, and fills the table of readouts.
    fn prepare_readouts(&mut self, order: &[usize]) {
        let mut readouts = vec![layout::Readout::default(); self.cameras.len()];
        for (position, &camera) in order.iter().enumerate() {
            let state = &self.cameras[camera];
            let outlet = has_bus(&state.config.sensor).then_some(self.parameters.len() as u32);
            readouts[state.place.slot as usize] = readout_row(state, &self.parameters[position], outlet);
            if outlet.is_some() {
                let row = outlet_row(state, &self.parameters[position]);
                self.parameters.push(row);
            }
        }
        self.arena.table(layout::READOUTS).write(0, &readouts);
    }

    /// Makes the descriptors of the current set name the current buffers.
    pub(super) fn bind_current(&mut self) {
        if !self.recording().bound {
            // SAFETY: no submission that uses the set is pending, or the rig would be lost. Commands recorded with it
            // are forgotten (`Recording::unbind`), or were recorded for one submission. Whoever replaces buffers
            // unbinds every set that names them.
            unsafe { self.pipelines.bindings.bind(self.arena.shown()) };
            self.recording().bound = true;
        }
    }

    /// Workgroups of `poses` for each camera: as many as there are instances of one at most.
    fn poses_groups(&self) -> u32 {
        self.cameras.iter().map(|camera| camera.place.instances).max().unwrap_or(1).min(POSES_GROUPS)
    }

    fn recording(&mut self) -> &mut Recording {
        &mut self.recordings.ring[self.arena.current()]
    }

    /// What commands must be recorded for now. For its checks in shaders the validation layer notes which addresses are
    /// valid when commands are recorded, not when they are submitted. So such commands serve only until another buffer
    /// is made.
    fn needed_recording(&self, whole: bool) -> RecordedFor {
        let addresses = if self.device.validation() == Validation::On { self.device.addresses() } else { 0 };
        let permutations = self.permutations();
        let policy = self.pipelines.policy;
        let (groups, without_queue) = (self.second_run.groups(), self.second_run.without_queue());
        let runs_twice = whole && permutations.iter().any(|p| p.second_run(policy, without_queue).is_some());
        let second_run =
            if runs_twice && groups > 0 { Second { groups, without_queue } } else { Second::default() };
        let poses = whole && self.poses_by.device;
        RecordedFor { permutations, passes: self.passes(whole), second_run, poses, addresses }
    }

    /// The permutation of each camera.
    pub(super) fn permutations(&self) -> Vec<Permutation> {
        let (policy, texels) = (self.pipelines.policy, self.arena.shows_all_texels());
        let queue_per_px = self.queue.per_px();
        let rests = self.rest.rests();
        self.cameras
            .iter()
            .map(|c| permutation(c, self.options, policy, texels, queue_per_px, rests))
            .collect()
    }

    /// Every kernel that the rig has compiled, by stage.
    pub(super) fn kernels_by_stage(&self) -> impl Iterator<Item = (&'static str, &Kernel)> {
        let stage_of = |name| KERNELS.iter().find(|k| k.name == name).map_or(name, |k: &KernelInfo| k.stage);
        let of_sensors =
            self.pipelines.specialised.0.iter().map(move |(s, kernel)| (stage_of(s.kernel.0), kernel));
        let k = &self.pipelines.kernels;
        let events = [("deferred", &k.deferred), ("sort", &k.sort), ("merge", &k.merge)];
        let paths = k.paths.iter().map(|kernel| ("paths", kernel));
        let sums = k.bin_sums.iter().map(|kernel| ("sort", kernel));
        let paths = paths.chain(k.poses.iter().map(|kernel| ("poses", kernel)));
        let bus = k.bus.iter().flat_map(|bus| {
            [("sort", &bus.sort), ("readout", &bus.readout)]
                .into_iter()
                .chain(bus.apart.iter().map(|apart| ("readout", apart)))
        });
        let forms = k.forms.iter().map(|(stage, kernel)| (*stage, kernel));
        of_sensors.chain(events).chain(sums).chain(paths).chain(bus).chain(forms)
    }

    /// Names of the compiled kernels and their specialisation constants, for tests: which permutations ran.
    #[doc(hidden)]
    #[must_use]
    pub fn permutations_compiled(&self) -> Vec<(&'static str, Vec<u32>)> {
        let mut all: Vec<_> =
            self.pipelines.specialised.0.keys().map(|s| (s.kernel.0, s.constants.clone())).collect();
        let bus = &self.pipelines.kernels.bus;
        for has_bus in [false, true].iter().take(1 + usize::from(bus.is_some())) {
            let policy = self.pipelines.policy;
            let summed = !has_bus && sums_bins(policy, &self.cameras);
            let sort = sort(policy, group_bins(policy, &self.cameras), *has_bus, summed);
            all.push((sort.kernel.0, sort.constants));
        }
        all.extend(self.pipelines.kernels.poses.iter().map(|_| (stages::POSES.0, Vec::new())));
        all.sort();
        all
    }

    /// Records the whole tick, or (`whole` false) the part that runs again when events did not fit.
    fn record(&mut self, needed: RecordedFor, whole: bool) -> Result<(), EngineError> {
        let permutations = &needed.permutations;
        self.need_kernels(permutations, whole, needed.poses)?;
        if needed.second_run.groups > 0 {
            self.need_second_run(permutations, needed.second_run.without_queue)?;
        }
        // If recording fails, the commands must not be taken for recorded.
        *self.recorded_for(whole) = None;
        let groups = self.groups(permutations, &order(permutations));
        record_tick(self, &groups, &needed, whole)?;
        *self.recorded_for(whole) = Some(needed);
        Ok(())
    }

    /// Compiles the kernels of these permutations that are missing, for a whole tick (with `poses` or without) or (`whole`
    /// false) the part that runs again.
    pub(super) fn need_kernels(
        &mut self,
        permutations: &[Permutation],
        whole: bool,
        poses: bool,
    ) -> Result<(), EngineError> {
        let Pipelines { bindings, code, kernels, specialised, policy } = &mut self.pipelines;
        for p in permutations {
            specialised.need(code, bindings, *policy, p, !whole)?;
        }
        kernels.need(*policy, &self.cameras, code, bindings, permutations, poses)
    }

    /// Compiles the kernels of the second run of `cross` that are missing.
    fn need_second_run(
        &mut self,
        permutations: &[Permutation],
        without_queue: bool,
    ) -> Result<(), EngineError> {
        let Pipelines { bindings, code, specialised, policy, .. } = &mut self.pipelines;
        for second_run in permutations.iter().filter_map(|p| p.second_run(*policy, without_queue)) {
            specialised.need_one(code, bindings, second_run)?;
        }
        Ok(())
    }

    fn recorded_for(&mut self, whole: bool) -> &mut Option<RecordedFor> {
        let recording = self.recording();
        if whole { &mut recording.tick_for } else { &mut recording.retry_for }
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
fn record_tick(rig: &Rig, groups: &[Group], needed: &RecordedFor, whole: bool) -> Result<(), EngineError> {
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
        let synthesizes = groups.iter().any(|group| !group.permutation.synthesize(policy).is_empty());
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
                if group.permutation.cross.effect_delay {
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
        let mut backward_transfers = false;
        for group in groups.iter().filter(|_| whole) {
            if let Some(kernel) = group.permutation.backward_transfer() {
                if backward_transfers && policy.serial {
                    record_barrier(device, commands);
                }
                let extent = [group.tiles, group.count, 1];
                dispatch(commands, &specialised[&kernel], group.first, extent);
                backward_transfers = true;
            }
        }
        if backward_transfers {
            record_barrier(device, commands);
        }
        stage_done();
        for pass in 0..passes {
            // SAFETY: as for the commands, below.
            unsafe { rig.record_synthesize(commands, groups, pass) };
            stage_done();
            for group in groups {
                let push = Push { first_camera: group.first, level: pass, passes, ..Push::default() };
                let extent = [group.tiles * policy.cross_groups(!whole), group.count, 1];
                for cross in group.permutation.cross(policy, !whole) {
                    if pass == 0 || cross.reads_levels() {
                        // SAFETY: as for the commands, below.
                        unsafe { specialised[&cross].record(commands, bytes_of(&push), extent) };
                    }
                }
            }
            record_barrier(device, commands);
            if second_run.groups > 0 && pass + 1 == passes {
                for group in groups {
                    if let Some(kernel) = group.permutation.second_run(policy, second_run.without_queue) {
                        let extent = [second_run.groups, group.count, 1];
                        dispatch(commands, &specialised[&kernel], group.first, extent);
                    }
                }
                record_barrier(device, commands);
            }
            stage_done();
        }
        if outlets > 0 {
            // SAFETY: as for the commands, below.
            unsafe { rig.record_sort(commands, 0, cameras, false) };
            if !policy.readout_light {
                record_barrier(device, commands);
                stage_done();
                // SAFETY: as for the commands, below.
                unsafe { rig.record_readout(commands, outlets, false) };
            } else {
                stage_done();
            }
        } else {
            if let Some(sums) = &rig.pipelines.kernels.bin_sums {
                let most = rig.cameras.iter().map(|c| c.place.bin_count).max().unwrap_or(0);
                dispatch(commands, sums, 0, [most.div_ceil(layout::SUMMED_BINS), cameras, 1]);
                record_barrier(device, commands);
            }
            let extent = [rig.bin_groups(), cameras, 1];
            dispatch(commands, &rig.pipelines.kernels.sort, 0, extent);
        }
        record_host_barrier(device, commands);
        write_stamp();
    };
    // SAFETY: no submission of the commands is pending, or the rig would be lost. The rig owns the handles that they
    // use; nothing else uses these within a tick, and `Device::retire` keeps them if a wait fails. The caller of the
    // step keeps the frames alive.
    unsafe { target.record(record) }
}
