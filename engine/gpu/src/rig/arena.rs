//! The rig's buffers: one for each purpose, in which every camera has its part.
//!
//! Buffers that hold packets come in a ring of sets. Each tick writes the next set, so that a program can hold the
//! packets of earlier ticks. A set that is still held when its turn comes is left to its holders, and a new one takes
//! its place.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::geometry::{Place, lay_out, shared_level_rows, total};
use super::poses::device_tracks;
use super::{CameraState, PacketPlace, RigOptions};
use crate::device::Device;
use crate::error::EngineError;
use crate::memory::{Buffer, MemoryUse};
use crate::policy::KernelPolicy;
use ash::vk;
use esaac_layout::{self as layout, BINDINGS, PoseSegment, TEXELS, Track};
use esaac_model::substeps::MAX_SUBSTEPS;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// Slots of the buffers that hold packets.
const PACKET_SLOTS: [usize; 5] =
    [layout::EVENT_T, layout::EVENT_X, layout::EVENT_Y, layout::EVENT_P, layout::APS];

/// Elements of each buffer of a packet set over all cameras, in the order of [`PACKET_SLOTS`].
type PacketElements = [u64; PACKET_SLOTS.len()];

fn packet_elements(places: &[Place]) -> PacketElements {
    PACKET_SLOTS.map(|slot| total(places, slot))
}

/// One set of packet buffers, in the order of [`PACKET_SLOTS`].
pub(super) struct PacketBuffers(Vec<Buffer>);

impl PacketBuffers {
    fn new(
        device: &Arc<Device>,
        elements: &PacketElements,
        packets: PacketPlace,
    ) -> Result<Self, EngineError> {
        let buffers = PACKET_SLOTS.iter().zip(elements).map(|(&slot, &n)| allocate(device, slot, n, packets));
        Ok(PacketBuffers(buffers.collect::<Result<_, _>>()?))
    }

    /// The buffer of a slot; `None` if the slot holds no packets.
    pub(super) fn get(&self, slot: usize) -> Option<&Buffer> {
        PACKET_SLOTS.iter().position(|&s| s == slot).map(|index| &self.0[index])
    }

    fn holds(&self, elements: &PacketElements) -> bool {
        let bytes = PACKET_SLOTS.iter().zip(elements).map(|(&slot, n)| n * u64::from(BINDINGS[slot].stride));
        self.0.iter().zip(bytes).all(|(buffer, needed)| buffer.bytes() >= needed)
    }
}

/// The rig's buffers.
pub(super) struct Arena {
    /// By binding slot; `None` for those of packets, which are in the ring.
    buffers: Vec<Option<Buffer>>,
    /// Packet sets; `None` for those that no tick has written yet.
    ring: Vec<Option<Arc<PacketBuffers>>>,
    /// Index of the set that the last or current tick writes.
    current: usize,
    /// What the cameras' places need of a packet set.
    packet_elements: PacketElements,
    pub samples_pixels: usize,
    packets: PacketPlace,
    policy: KernelPolicy,
}

/// New places for cameras and the buffers that they need, planned but not in use yet.
pub(super) struct Move {
    places: Vec<Place>,
    fresh: Vec<(usize, Buffer)>,
    packets: Option<PacketBuffers>,
}

impl Move {
    fn fresh(&self, slot: usize) -> Option<&Buffer> {
        let packets = || self.packets.as_ref().and_then(|packets| packets.get(slot));
        self.fresh.iter().find(|(s, _)| *s == slot).map(|(_, buffer)| buffer).or_else(packets)
    }
}

impl Arena {
    pub(super) fn new(
        device: &Arc<Device>,
        places: &[Place],
        options: RigOptions,
        policy: KernelPolicy,
    ) -> Result<Self, EngineError> {
        let cameras = places.len() / 2;
        let samples_pixels = places.iter().map(|p| p.pixels as usize).max().unwrap_or(0);
        let buffers = (0..BINDINGS.len())
            .map(|slot| {
                if PACKET_SLOTS.contains(&slot) {
                    return Ok(None);
                }
                let elements = match slot {
                    slot if layout::is_table(slot) => layout::MAX_CAMERAS as u64,
                    layout::REPORT => places.len() as u64,
                    layout::COUNTERS => 2 * places.len() as u64,
                    layout::SAMPLES if options.keep_substeps => {
                        (cameras * (MAX_SUBSTEPS as usize + 1) * samples_pixels) as u64
                    }
                    layout::SAMPLES => 0,
                    slot => elements_of(slot, places, policy),
                };
                allocate(device, slot, elements, options.packets).map(Some)
            })
            .collect::<Result<_, _>>()?;
        let packet_elements = packet_elements(places);
        let first = Arc::new(PacketBuffers::new(device, &packet_elements, options.packets)?);
        let mut ring = vec![Some(first)];
        ring.resize(options.ring(), None);
        let packets = options.packets;
        Ok(Arena { buffers, ring, current: 0, packet_elements, samples_pixels, packets, policy })
    }

    /// The buffer of a slot.
    pub(super) fn buffer(&self, slot: usize) -> &Buffer {
        let packets = || self.packet_set().get(slot);
        self.buffers[slot].as_ref().or_else(packets).expect("every slot has a buffer")
    }

    /// A buffer that the host fills or reads while no tick is under way: tables of parameters, the report, poses,
    /// instances.
    pub(super) fn table(&mut self, slot: usize) -> &mut Buffer {
        self.buffers[slot].as_mut().expect("tables are in no packet set")
    }

    /// Those of tracks and of their segments.
    pub(super) fn track_tables(&mut self) -> (&mut [Track], &mut [PoseSegment]) {
        let [tracks, segments] = self
            .buffers
            .get_disjoint_mut([layout::TRACKS, layout::SEGMENTS])
            .expect("two slots")
            .map(|buffer| buffer.as_mut().expect("tables are in no packet set"));
        (tracks.all_mut(), segments.all_mut())
    }

    /// Whether the device may work out the poses of the cameras.
    pub(super) fn has_room_for_tracks(&self) -> bool {
        self.buffer(layout::SEGMENTS).bytes()
            >= u64::from(layout::TRACK_SEGMENTS * BINDINGS[layout::SEGMENTS].stride)
    }

    /// The packet set of the last or current tick.
    pub(super) fn packet_set(&self) -> &Arc<PacketBuffers> {
        self.ring[self.current].as_ref().expect("the current set is there")
    }

    /// Index of that set in the ring.
    pub(super) fn current(&self) -> usize {
        self.current
    }

    /// Advances to the next packet set; allocates it if the present one is held, too small or missing. Returns whether
    /// it is a new one. On an error nothing has changed.
    pub(super) fn next_packet_set(&mut self, device: &Arc<Device>) -> Result<bool, EngineError> {
        let next = (self.current + 1) % self.ring.len();
        let elements = &self.packet_elements;
        let usable = self.ring[next]
            .as_mut()
            .is_some_and(|set| Arc::get_mut(set).is_some_and(|set| set.holds(elements)));
        if !usable {
            self.ring[next] = Some(Arc::new(PacketBuffers::new(device, elements, self.packets)?));
        }
        self.current = next;
        Ok(!usable)
    }

    /// Whether kernels reach all of `planes` and `motion` by texel fetch.
    pub(super) fn shows_all_texels(&self) -> bool {
        TEXELS.iter().all(|t| self.buffer(t.of).shows_all_texels())
    }

    /// The buffers of the kernels' slots, in their order.
    pub(super) fn shown(&self) -> impl Iterator<Item = &Buffer> {
        (0..BINDINGS.len()).chain(TEXELS.iter().map(|t| t.of)).map(|slot| self.buffer(slot))
    }

    /// Records commands that empty the passes of `synthesize`.
    pub(super) fn record_zero_passes(&self, device: &Device, commands: vk::CommandBuffer) {
        let heads = u64::from(layout::MOST_PASSES * layout::BINDINGS[layout::LEVEL_ENTRIES].stride);
        // SAFETY: `commands` is being recorded; the buffer is alive, was made for transfers and has so many bytes.
        unsafe {
            device.raw().cmd_fill_buffer(commands, self.buffer(layout::LEVEL_ENTRIES).raw(), 0, heads, 0);
        }
    }

    /// Records commands that zero buffers.
    pub(super) fn record_zero(&self, device: &Device, commands: vk::CommandBuffer, slots: &[usize]) {
        for &slot in slots {
            zero(device, commands, self.buffer(slot));
        }
    }

    /// Plans the move of cameras from `before` to `places`, and allocates its buffers. The arena does not change.
    pub(super) fn plan(
        &self,
        device: &Arc<Device>,
        before: &[Place],
        mut places: Vec<Place>,
    ) -> Result<Move, EngineError> {
        lay_out(&mut places);
        let changes = |slot: usize| {
            before.iter().zip(&places).any(|(a, b)| a.elements()[slot] != b.elements()[slot])
                || self.elements_of(slot, before) != self.elements_of(slot, &places)
        };
        let mut fresh = Vec::new();
        for slot in (0..BINDINGS.len()).filter(|slot| !PACKET_SLOTS.contains(slot) && changes(*slot)) {
            fresh.push((slot, allocate(device, slot, self.elements_of(slot, &places), self.packets)?));
        }
        let packets = if PACKET_SLOTS.iter().any(|&slot| changes(slot)) {
            Some(PacketBuffers::new(device, &packet_elements(&places), self.packets)?)
        } else {
            None
        };
        Ok(Move { places, fresh, packets })
    }

    /// Elements of a buffer that the cameras at `places` need.
    fn elements_of(&self, slot: usize, places: &[Place]) -> u64 {
        elements_of(slot, places, self.policy)
    }

    /// Records the copies of a move: each camera's part, as much of it as fits both places. Bins are empty after it, as
    /// they are between ticks.
    pub(super) fn record_move(
        &self,
        device: &Device,
        commands: vk::CommandBuffer,
        before: &[Place],
        planned: &Move,
    ) {
        for (slot, binding) in BINDINGS.iter().enumerate() {
            let Some(fresh) = planned.fresh(slot) else { continue };
            if slot == layout::BINS {
                zero(device, commands, fresh);
                continue;
            }
            let stride = u64::from(binding.stride);
            let (mut from, mut to) = (0, 0);
            let mut regions = Vec::new();
            for (old, new) in before.iter().zip(&planned.places) {
                let (had, has) = (old.elements()[slot].unwrap_or(0), new.elements()[slot].unwrap_or(0));
                let size = had.min(has) * stride;
                if size > 0 {
                    let (src_offset, dst_offset) = (from * stride, to * stride);
                    regions.push(vk::BufferCopy { src_offset, dst_offset, size });
                }
                from += had;
                to += has;
            }
            if regions.is_empty() {
                continue;
            }
            // SAFETY: `commands` is being recorded; both buffers live until the copy has finished.
            unsafe {
                device.raw().cmd_copy_buffer(commands, self.buffer(slot).raw(), fresh.raw(), &regions);
            }
        }
        // The host may read the packets in their new place.
        crate::kernel::record_host_barrier(device, commands);
    }

    /// Completes a move whose copies have finished.
    pub(super) fn commit(&mut self, cameras: &mut [CameraState], planned: Move) {
        for (slot, buffer) in planned.fresh {
            self.buffers[slot] = Some(buffer);
        }
        if let Some(packets) = planned.packets {
            self.ring[self.current] = Some(Arc::new(packets));
        }
        self.packet_elements = packet_elements(&planned.places);
        let (places, outlets) = planned.places.split_at(cameras.len());
        for ((camera, place), outlet) in cameras.iter_mut().zip(places).zip(outlets) {
            (camera.place, camera.outlet) = (*place, *outlet);
        }
    }

    /// Memory by camera and purpose.
    pub(super) fn memory(&self, cameras: &[CameraState]) -> Vec<MemoryUse> {
        let sets = self.ring.iter().flatten().count() as u64;
        let mut uses = Vec::new();
        for (slot, binding) in BINDINGS.iter().enumerate() {
            let buffer = self.buffer(slot);
            let times = if PACKET_SLOTS.contains(&slot) { sets } else { 1 };
            let mut shared = buffer.bytes() * times;
            for (number, camera) in cameras.iter().enumerate() {
                if buffer.bytes() <= 16 {
                    continue;
                }
                let of = |place: &Place| place.elements()[slot].unwrap_or(0);
                let elements = of(&camera.place) + of(&camera.outlet);
                if elements > 0 {
                    let bytes = elements * u64::from(binding.stride) * times;
                    shared = shared.saturating_sub(bytes);
                    uses.push(MemoryUse {
                        camera: Some(number),
                        purpose: binding.name.to_owned(),
                        bytes,
                        on_host: buffer.on_host(),
                    });
                }
            }
            if shared > 0 {
                uses.push(MemoryUse {
                    camera: None,
                    purpose: binding.name.to_owned(),
                    bytes: shared,
                    on_host: buffer.on_host(),
                });
            }
        }
        uses
    }
}

/// Records a command that zeroes a buffer, which lives until it has run.
fn zero(device: &Device, commands: vk::CommandBuffer, buffer: &Buffer) {
    // SAFETY: `commands` is being recorded; the buffer is alive and was made for transfers.
    unsafe { device.raw().cmd_fill_buffer(commands, buffer.raw(), 0, vk::WHOLE_SIZE, 0) };
}

/// Elements of a buffer that the cameras at `places` need. They share those of `levels`, which is as good as new in each
/// pass of a tick.
fn elements_of(slot: usize, places: &[Place], policy: KernelPolicy) -> u64 {
    let rows = shared_level_rows(places.iter(), policy);
    match slot {
        layout::LEVELS => rows * u64::from(layout::LEVEL_ROW_WORDS),
        // A block with entries takes three rows for each, at least.
        layout::LEVEL_ENTRIES => u64::from(layout::MOST_PASSES) + rows / 3,
        layout::SEGMENTS => u64::from(layout::TRACK_SEGMENTS) * device_tracks(places.iter(), policy),
        slot => total(places, slot),
    }
}

fn allocate(
    device: &Arc<Device>,
    slot: usize,
    elements: u64,
    packets: PacketPlace,
) -> Result<Buffer, EngineError> {
    let binding = &BINDINGS[slot];
    let (location, usage) = match slot {
        slot if layout::is_table(slot) => (MemoryLocation::CpuToGpu, vk::BufferUsageFlags::UNIFORM_BUFFER),
        layout::POSES => (MemoryLocation::CpuToGpu, vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER),
        layout::INSTANCES | layout::TRACKS | layout::SEGMENTS => {
            (MemoryLocation::CpuToGpu, vk::BufferUsageFlags::empty())
        }
        layout::EVENT_T | layout::EVENT_X | layout::EVENT_Y | layout::EVENT_P
            if packets == PacketPlace::OnDevice =>
        {
            (MemoryLocation::GpuOnly, vk::BufferUsageFlags::empty())
        }
        // Kernels write these straight into host memory, where the host reads them.
        layout::EVENT_T
        | layout::EVENT_X
        | layout::EVENT_Y
        | layout::EVENT_P
        | layout::APS
        | layout::REPORT
        | layout::SAMPLES => (MemoryLocation::GpuToCpu, vk::BufferUsageFlags::empty()),
        layout::PLANES | layout::MOTION | layout::SURFACES | layout::SLOPES | layout::PATHS => {
            (MemoryLocation::GpuOnly, vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER)
        }
        _ => (MemoryLocation::GpuOnly, vk::BufferUsageFlags::empty()),
    };
    let bytes = elements * u64::from(binding.stride);
    // Kernels address a buffer's bytes with 32 bits.
    let most = device.most_storage_bytes().min(u64::from(u32::MAX));
    if bytes > most {
        return Err(EngineError::OutOfMemory {
            name: binding.name.to_owned(),
            bytes,
            reason: format!(
                "on this device a rig's buffers have at most {most}; give cameras rigs of their own"
            ),
        });
    }
    let buffer = device.allocate(binding.name, bytes, usage, location)?;
    match slot {
        layout::PLANES => buffer.with_texels(vk::Format::R32_SFLOAT, u64::from(binding.stride)),
        layout::MOTION => buffer.with_texels(vk::Format::R32G32_SFLOAT, u64::from(binding.stride)),
        layout::SURFACES => buffer.with_texels(vk::Format::R32G32_UINT, u64::from(binding.stride)),
        layout::SLOPES => buffer.with_texels(vk::Format::R32_UINT, u64::from(binding.stride)),
        layout::POSES | layout::PATHS => {
            buffer.with_texels(vk::Format::R32G32B32A32_SFLOAT, u64::from(binding.stride))
        }
        _ => Ok(buffer),
    }
}
