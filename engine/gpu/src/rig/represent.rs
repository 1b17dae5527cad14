//! Representations of the last tick's packets for machine learning, made on the device: all events in one array,
//! images of event counts, voxel grids.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::record::MOST_GROUPS;
use super::transfer::{Part, read_back};
use super::{Pipelines, Rig};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use crate::kernel::{record_barrier, record_barrier_from_transfer, record_host_barrier, stages};
use crate::memory::Buffer;
use ash::vk;
use bytemuck::bytes_of;
use esaac_layout::{MOST_BINS, Push, Slice};
use gpu_allocator::MemoryLocation;

/// A representation of packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Representation {
    /// The packets of all cameras, one camera after the other: all times (i64 nanoseconds), all columns (i16),
    /// all rows (i16), all polarities (u8; 0 OFF, 1 ON). 13 bytes an event.
    Gathered,
    /// OFF events and ON events of each pixel, i32, `[camera][2][row][column]`.
    EventFrame,
    /// The id of the instance that each event's pixel shows at the event's time, i64, camera after camera in the order of
    /// [`Representation::Gathered`]; -1 where no path tells it. What counts is in
    /// [`esaac_model::synthesis::rigid`], "The instance of an event". All cameras must have synthesis `rigid`. It is -1 also
    /// for the events of a camera that has been reset since, or has other poses, another sensor or state: see
    /// [`Rig::knows_event_ids`].
    EventIds,
    /// Votes of +1 (ON) or -1 (OFF), split between the two nearest time bins, f32, `[camera][bin][row][column]` (Zhu et
    /// al., CVPR 2019); see `voxel_grid.comp`.
    VoxelGrid {
        /// Number of time bins, from one to [`MOST_BINS`].
        bins: u32,
    },
}

/// A rig's part of a buffer that several rigs write; the default is the whole buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Share {
    /// Elements (events, where each event has one) before those of this rig.
    pub before: u64,
    /// Elements of all rigs; 0 if this rig is the only one.
    pub all: u64,
}

impl Representation {
    /// Bytes per element.
    #[must_use]
    pub fn element_bytes(self) -> u64 {
        match self {
            Representation::Gathered => 13,
            Representation::EventIds => 8,
            Representation::EventFrame | Representation::VoxelGrid { .. } => 4,
        }
    }

    /// The kernel that makes it.
    fn kernel(self) -> (&'static str, &'static [u8]) {
        match self {
            Representation::Gathered => stages::GATHER,
            Representation::EventFrame => stages::EVENT_FRAME,
            Representation::VoxelGrid { .. } => stages::VOXEL_GRID,
            Representation::EventIds => stages::EVENT_IDS,
        }
    }

    /// Whether it has an element for each event; else it has planes, which hold sums.
    fn is_of_events(self) -> bool {
        matches!(self, Representation::Gathered | Representation::EventIds)
    }

    /// Planes per camera, each with one element per pixel.
    fn planes(self) -> u64 {
        match self {
            Representation::Gathered | Representation::EventIds => 0,
            Representation::EventFrame => 2,
            Representation::VoxelGrid { bins } => u64::from(bins),
        }
    }
}

impl Rig {
    /// Elements that a representation of the last tick has: events, counts or voxels.
    #[must_use]
    pub fn elements(&self, what: Representation) -> u64 {
        if what.is_of_events() {
            return self.results.events.iter().map(|&events| u64::from(events)).sum();
        }
        self.cameras.iter().map(|c| what.planes() * u64::from(c.place.pixels)).sum()
    }

    /// Writes a representation of the last tick's packets into `target`, and waits. Cameras without an interval in that
    /// tick have no events. [`EngineError::OutOfMemory`] if `target` is too small, or for 2^32 elements and more;
    /// [`EngineError::NoEventIds`] for [`Representation::EventIds`] if a camera's synthesis is not `rigid`;
    /// [`EngineError::Bins`] for a number of bins that no voxel grid has;
    /// [`EngineError::OtherDevice`] if `target` is not of the rig's device.
    pub fn represent(
        &mut self,
        what: Representation,
        target: &Buffer,
        share: Share,
    ) -> Result<(), EngineError> {
        self.check_ready()?;
        self.check_form(what)?;
        let elements = self.elements(what);
        self.device.check_own(target.device(), || format!("`{}`, to represent in", target.name()))?;
        let all = share.all.max(share.before.saturating_add(elements));
        let bytes = all.saturating_mul(what.element_bytes());
        if bytes > target.bytes() || all > u64::from(u32::MAX) {
            return Err(EngineError::OutOfMemory {
                name: target.name().to_owned(),
                bytes,
                reason: format!("{what:?} of this tick does not fit {} bytes", target.bytes()),
            });
        }
        if elements == 0 {
            return Ok(());
        }
        let mut slices = self.slices(what, share.before);
        let ids = match what {
            Representation::EventIds => Some(self.place_event_ids(&mut slices)?),
            _ => None,
        };
        let most_events = slices.iter().map(|slice| slice.events).max().unwrap_or(0);
        let most_pixels = slices.iter().map(|slice| slice.pixels).max().unwrap_or(0);
        let bytes: &[u8] = bytemuck::cast_slice(&slices);
        if self.slices.is_none() {
            // The table is in the device's own memory, because every thread reads a row of it.
            let usage = vk::BufferUsageFlags::empty();
            let table = self.device.allocate("slices", bytes.len() as u64, usage, MemoryLocation::GpuOnly)?;
            self.slices = Some(table);
        }
        let bins = if let Representation::VoxelGrid { bins } = what { bins } else { 0 };
        let push = Push { target: target.address(), events: all as u32, bins, ..Push::default() };
        let per_thread = self.pipelines.policy.events_per_thread;
        let cameras = self.cameras.len() as u32;
        let groups = |items: u32| items.div_ceil(256 * per_thread).clamp(1, MOST_GROUPS);
        let Pipelines { bindings, code, kernels, .. } = &mut self.pipelines;
        let first = ids.is_some().then_some(stages::EVENT_IDS_LISTS);
        for embedded in first.into_iter().chain([what.kernel()]) {
            if !kernels.forms.contains_key(embedded.0) {
                kernels.forms.insert(embedded.0, code.plain_kernel(bindings, embedded)?);
            }
        }
        self.bind_current();
        let table = self.slices.as_ref().expect("made above");
        let push = Push { slices: table.address(), ..push };
        let forms = &self.pipelines.kernels.forms;
        let kernel = &forms[what.kernel().0];
        let record = |commands| {
            // SAFETY: `commands` is being recorded; both buffers are alive and large enough. At most 256 rows of 64
            // bytes are less than the 65536 bytes that an update may carry.
            unsafe {
                self.device.raw().cmd_update_buffer(commands, table.raw(), 0, bytes);
                if !what.is_of_events() {
                    let (first, size) = (share.before * 4, elements * 4);
                    self.device.raw().cmd_fill_buffer(commands, target.raw(), first, size, 0);
                }
            }
            if let Some(ids) = &ids {
                self.record_update(commands, ids, target);
            }
            record_barrier_from_transfer(&self.device, commands);
            if let Some(ids) = &ids {
                let lists = &forms[stages::EVENT_IDS_LISTS.0];
                // SAFETY: as for the commands, below; the kernel stays within what `slices` says.
                unsafe { lists.record(commands, bytes_of(&push), [ids.tiles, cameras, 1]) };
                record_barrier(&self.device, commands);
            }
            let dispatch = |level: u32, items: u32| {
                // SAFETY: as for the commands, below; the kernel stays within what `slices` and the push constants say.
                unsafe {
                    kernel.record(commands, bytes_of(&Push { level, ..push }), [groups(items), cameras, 1]);
                }
            };
            dispatch(0, most_events);
            if let Representation::VoxelGrid { bins } = what {
                record_barrier_from_transfer(&self.device, commands);
                dispatch(1, bins.saturating_mul(most_pixels));
            }
            record_host_barrier(&self.device, commands);
        };
        // SAFETY: no submission of the commands is pending, or the rig would be lost. The handles that they use belong
        // to the rig or the caller, and live until the wait below is over. If it fails, `Device::retire` keeps them.
        unsafe { self.recordings.representing.record(record) }?;
        self.timing.submit(&self.device, &self.recordings.representing, &SubmitHooks::default())?;
        self.timing.wait().map_err(|error| self.lose(error))
    }

    /// A representation of the last tick's packets in host memory, as bytes; empty if it has no elements.
    pub fn represent_to_host(&mut self, what: Representation) -> Result<Vec<u8>, EngineError> {
        self.check_ready()?;
        self.check_form(what)?;
        let bytes = self.elements(what) * what.element_bytes();
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let (none, device) = (vk::BufferUsageFlags::empty(), self.device.clone());
        // The sums are in the device's own memory, because atomics over the bus are slow.
        let sums = device.allocate("representation", bytes, none, MemoryLocation::GpuOnly)?;
        self.represent(what, &sums, Share::default())?;
        read_back(&device, &[Part { buffer: &sums, offset: 0, bytes }])
    }

    /// Whether a representation can be had.
    fn check_form(&self, what: Representation) -> Result<(), EngineError> {
        match what {
            Representation::EventIds => self.check_event_ids(),
            Representation::VoxelGrid { bins } if !(1..=MOST_BINS).contains(&bins) => {
                Err(EngineError::Bins { expected: MOST_BINS, actual: bins })
            }
            _ => Ok(()),
        }
    }

    fn slices(&self, what: Representation, before: u64) -> Vec<Slice> {
        let (mut first, mut events_before) = (before, if what.is_of_events() { before as u32 } else { 0 });
        self.cameras
            .iter()
            .zip(&self.results.packets)
            .zip(&self.results.events)
            .map(|((camera, packet), &events)| {
                let slice = Slice {
                    base_ns: packet.base_ns,
                    event_base: camera.packet_base(),
                    events,
                    width: camera.config.sensor.width,
                    pixels: camera.place.pixels,
                    base_to_start_ns: u32::try_from(camera.last_start_ns - packet.base_ns)
                        .expect("the base is the start rounded down to a quantum, which has 32 bits"),
                    interval_ns: camera.last_interval_ns.max(1),
                    first: first as u32,
                    events_before,
                    ..Slice::default()
                };
                first += what.planes() * u64::from(camera.place.pixels);
                events_before += events;
                slice
            })
            .collect()
    }
}
