//! Where each camera's data lie in the rig's buffers.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::parameters::plane_words;
use super::{CameraConfig, CameraState, PacketPlace, RigOptions};
use crate::device::Device;
use crate::error::EngineError;
use crate::memory::{Buffer, MemoryUse};
use ash::vk;
use esaac_model::layout::{self, BINDINGS, Counters, STATE_WORDS, STRIP_BLOCKS, TEXELS};
use esaac_model::substeps::{BLOCK_PX, MAX_SUBSTEPS};
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// A camera's parts, in elements of each buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub slot: u32,
    pub pixels: u32,
    /// Words of `planes` that a frame takes, all colour components.
    pub plane_words: u32,
    pub blocks_x: u32,
    pub blocks: u32,
    /// Strips of four blocks.
    pub strips: u32,
    pub bin_count: u32,
    pub bin_room: u32,
    pub event_capacity: u32,
    pub plane_base: u32,
    pub motion_base: u32,
    pub state_base: u32,
    pub block_base: u32,
    pub bin_base: u32,
    pub rooms_base: u32,
    pub event_base: u32,
    pub aps_base: u32,
    pub strip_base: u32,
    has_motion: bool,
}

impl Place {
    /// Elements of each buffer that this camera takes, in the order of the slots; `None` for what is
    /// shared.
    fn elements(&self) -> [Option<u64>; BINDINGS.len()] {
        let mut elements = [None; BINDINGS.len()];
        let pixels = u64::from(self.pixels);
        elements[layout::PLANES] = Some(2 * u64::from(self.plane_words));
        elements[layout::MOTION] = Some(if self.has_motion { 2 * pixels } else { 0 });
        elements[layout::STATE] = Some(u64::from(STATE_WORDS) * pixels);
        elements[layout::BLOCKS] = Some(2 * u64::from(self.blocks));
        elements[layout::BINS] = Some(2 * (u64::from(self.bin_count) + 1));
        elements[layout::ROOMS] = Some(u64::from(self.bin_count) * u64::from(self.bin_room));
        for slot in [
            layout::SPILLED,
            layout::GATHERED,
            layout::EVENT_T,
            layout::EVENT_X,
            layout::EVENT_Y,
            layout::EVENT_P,
        ] {
            elements[slot] = Some(u64::from(self.event_capacity));
        }
        elements[layout::STRIP_ORDER] = Some(u64::from(self.strips));
        elements[layout::APS] = Some(pixels.next_multiple_of(8));
        elements
    }
}

/// Bins of a camera at the most: each workgroup of `sort` adds them all up.
const MOST_BINS: u32 = 16_384;

/// And at the least: a bin takes memory, and of small cameras there are many.
const LEAST_BINS: u32 = 128;

/// Pixels a bin: of what usually comes, a few dozen events, so that ranking them is cheap.
const BIN_PX: u32 = 64;

/// Events that a bin has room for at first: what [`BIN_PX`] pixels send, one and a half each.
const BIN_ROOM: u32 = BIN_PX + BIN_PX / 2;

/// Rooms are multiples of this: whole lines of memory.
const ROOM_STEP: u32 = 16;

/// Places for cameras that start.
pub(super) fn place(configs: &[CameraConfig], options: RigOptions) -> Vec<Place> {
    let mut places: Vec<Place> = configs
        .iter()
        .enumerate()
        .map(|(slot, config)| {
            let sensor = &config.sensor;
            let pixels = sensor.width * sensor.height;
            let blocks_x = sensor.width.div_ceil(BLOCK_PX);
            let events =
                if options.initial_events == 0 { pixels + pixels / 2 } else { options.initial_events };
            Place {
                slot: slot as u32,
                pixels,
                plane_words: plane_words(sensor),
                blocks_x,
                blocks: blocks_x * sensor.height.div_ceil(BLOCK_PX),
                strips: blocks_x.div_ceil(STRIP_BLOCKS) * sensor.height.div_ceil(BLOCK_PX),
                bin_count: (pixels / BIN_PX).next_power_of_two().clamp(LEAST_BINS, MOST_BINS),
                bin_room: BIN_ROOM,
                event_capacity: round_events(events),
                has_motion: config.motion.is_some(),
                ..Place::default()
            }
        })
        .collect();
    lay_out(&mut places);
    places
}

/// Capacities are multiples of this, so that arrays of bytes and words begin on whole words.
fn round_events(events: u32) -> u32 {
    events.max(64).next_multiple_of(64)
}

/// Gives every place its bases, one after the other.
fn lay_out(places: &mut [Place]) {
    let mut next = [0_u64; BINDINGS.len()];
    for place in places {
        let elements = place.elements();
        let mut take = |slot: usize| {
            let base = next[slot];
            next[slot] += elements[slot].unwrap_or(0);
            // Buffers of so many elements are refused by `allocate`.
            u32::try_from(base).unwrap_or(u32::MAX)
        };
        place.plane_base = take(layout::PLANES);
        place.motion_base = take(layout::MOTION);
        place.state_base = take(layout::STATE);
        place.block_base = take(layout::BLOCKS);
        place.bin_base = take(layout::BINS);
        place.rooms_base = take(layout::ROOMS);
        place.event_base = take(layout::SPILLED);
        place.aps_base = take(layout::APS);
        place.strip_base = take(layout::STRIP_ORDER);
    }
}

/// The rig's buffers, by binding slot.
pub(super) struct Arena {
    pub buffers: Vec<Buffer>,
    pub samples_pixels: usize,
    packets: PacketPlace,
}

impl Arena {
    pub(super) fn new(
        device: &Arc<Device>,
        places: &[Place],
        options: RigOptions,
    ) -> Result<Self, EngineError> {
        let samples_pixels = places.iter().map(|p| p.pixels as usize).max().unwrap_or(0);
        let buffers = (0..BINDINGS.len())
            .map(|slot| {
                let elements = match slot {
                    layout::CAMERAS => layout::MAX_CAMERAS as u64,
                    layout::REPORT => places.len() as u64,
                    layout::COUNTERS => 2 * places.len() as u64,
                    layout::SAMPLES if options.keep_substeps => {
                        (places.len() * (MAX_SUBSTEPS as usize + 1) * samples_pixels) as u64
                    }
                    layout::SAMPLES => 0,
                    slot => total(places, slot),
                };
                allocate(device, slot, elements, options.packets)
            })
            .collect::<Result<_, _>>()?;
        Ok(Arena { buffers, samples_pixels, packets: options.packets })
    }

    /// Whether kernels reach all of `planes` and `motion` by texel fetch.
    pub(super) fn shows_all_texels(&self) -> bool {
        TEXELS.iter().all(|t| self.buffers[t.of].shows_all_texels())
    }

    /// What the kernels' slots show, in their order.
    pub(super) fn shown(&self) -> impl Iterator<Item = &Buffer> {
        self.buffers.iter().chain(TEXELS.iter().map(|t| &self.buffers[t.of]))
    }

    /// Zeroes what kernels expect to find zero.
    pub(super) fn clear(&self, device: &Arc<Device>) -> Result<(), EngineError> {
        self.zero(device, &[layout::BINS, layout::STATE, layout::BLOCKS, layout::COUNTERS])?;
        let cameras = self.buffers[layout::COUNTERS].bytes() as usize / (2 * size_of::<Counters>());
        (0..cameras as u32).try_for_each(|slot| self.clear_counters(device, slot))
    }

    /// Makes both sets of a camera's counters as they are before its first tick.
    pub(super) fn clear_counters(&self, device: &Arc<Device>, slot: u32) -> Result<(), EngineError> {
        let fresh = [Counters { staged_fit: u32::MAX, ..Counters::default() }; 2];
        let offset = u64::from(slot) * size_of_val(&fresh) as u64;
        self.upload(device, layout::COUNTERS, offset, bytemuck::cast_slice(&fresh))
    }

    /// Copies bytes into a buffer through a staging buffer, and waits.
    pub(super) fn upload(
        &self,
        device: &Arc<Device>,
        slot: usize,
        offset: u64,
        bytes: &[u8],
    ) -> Result<(), EngineError> {
        let mut staging = device.allocate(
            "upload",
            bytes.len() as u64,
            vk::BufferUsageFlags::empty(),
            MemoryLocation::CpuToGpu,
        )?;
        staging.write(0, bytes);
        let region = [vk::BufferCopy { src_offset: 0, dst_offset: offset, size: bytes.len() as u64 }];
        device.run_once(|commands| {
            // SAFETY: `commands` is being recorded; both buffers are alive until the copy is done.
            unsafe {
                device.raw().cmd_copy_buffer(commands, staging.raw(), self.buffers[slot].raw(), &region);
            }
        })
    }

    /// Reads a part of a buffer back through a staging buffer, and waits.
    pub(super) fn download(
        &self,
        device: &Arc<Device>,
        slot: usize,
        offset: u64,
        bytes: u64,
    ) -> Result<Vec<u8>, EngineError> {
        read_back(device, &self.buffers[slot], offset, bytes)
    }

    /// Zeroes the bins, after a tick whose set of them is not the one before the next.
    pub(super) fn clear_bins(&self, device: &Arc<Device>) -> Result<(), EngineError> {
        self.zero(device, &[layout::BINS])
    }

    fn zero(&self, device: &Arc<Device>, slots: &[usize]) -> Result<(), EngineError> {
        device.run_once(|commands| {
            for &slot in slots {
                // SAFETY: `commands` is being recorded; the buffer is alive and was made for transfers.
                unsafe {
                    device.raw().cmd_fill_buffer(commands, self.buffers[slot].raw(), 0, vk::WHOLE_SIZE, 0);
                }
            }
        })
    }

    /// Gives the bins of cameras whose last packet spilled much of its events room for the largest
    /// (`largest_bins[slot]`, 0 for as it was), as far as memory for that is in proportion to the events.
    pub(super) fn grow_rooms(
        &mut self,
        device: &Arc<Device>,
        cameras: &mut [CameraState],
        largest_bins: &[u32],
    ) -> Result<bool, EngineError> {
        let mut places: Vec<Place> = cameras.iter().map(|c| c.place).collect();
        let mut grows = false;
        for (place, &largest) in places.iter_mut().zip(largest_bins) {
            let most = (2 * place.event_capacity / place.bin_count).max(BIN_ROOM);
            let room = largest.saturating_add(largest / 4).min(most).next_multiple_of(ROOM_STEP);
            if room > place.bin_room {
                place.bin_room = room;
                grows = true;
            }
        }
        if grows {
            self.move_to(device, cameras, places)?;
        }
        Ok(grows)
    }

    /// Gives cameras more room for events (`wanted[slot]`, 0 for as it was), keeping what is staged and
    /// what waits in `gathered`.
    pub(super) fn grow_events(
        &mut self,
        device: &Arc<Device>,
        cameras: &mut [CameraState],
        wanted: &[u32],
    ) -> Result<(), EngineError> {
        let mut places: Vec<Place> = cameras.iter().map(|c| c.place).collect();
        for (place, &wanted) in places.iter_mut().zip(wanted) {
            if wanted > place.event_capacity {
                place.event_capacity = round_events(wanted.saturating_add(wanted / 4));
            }
        }
        self.move_to(device, cameras, places)
    }

    /// Gives a camera the planes that its sensor needs now; what they held is lost.
    pub(super) fn fit_planes(
        &mut self,
        device: &Arc<Device>,
        cameras: &mut [CameraState],
        camera: usize,
    ) -> Result<bool, EngineError> {
        let plane_words = plane_words(&cameras[camera].config.sensor);
        if plane_words <= cameras[camera].place.plane_words {
            return Ok(false);
        }
        let mut places: Vec<Place> = cameras.iter().map(|c| c.place).collect();
        places[camera].plane_words = plane_words;
        self.move_to(device, cameras, places)?;
        Ok(true)
    }

    /// Moves cameras to new places: buffers whose layout differs are made anew, and each camera's part
    /// is copied as far as both have it.
    fn move_to(
        &mut self,
        device: &Arc<Device>,
        cameras: &mut [CameraState],
        mut places: Vec<Place>,
    ) -> Result<(), EngineError> {
        let before: Vec<Place> = cameras.iter().map(|c| c.place).collect();
        lay_out(&mut places);
        let mut fresh = Vec::new();
        for slot in 0..BINDINGS.len() {
            let same = before.iter().zip(&places).all(|(a, b)| a.elements()[slot] == b.elements()[slot]);
            if !same {
                let buffer = allocate(device, slot, total(&places, slot), self.packets)?;
                fresh.push((slot, buffer));
            }
        }
        device.run_once(|commands| {
            for (slot, buffer) in &fresh {
                let stride = u64::from(BINDINGS[*slot].stride);
                let (mut from, mut to) = (0, 0);
                let mut regions = Vec::new();
                for (old, new) in before.iter().zip(&places) {
                    let (had, has) = (old.elements()[*slot].unwrap_or(0), new.elements()[*slot].unwrap_or(0));
                    let size = had.min(has) * stride;
                    if size > 0 {
                        regions.push(vk::BufferCopy {
                            src_offset: from * stride,
                            dst_offset: to * stride,
                            size,
                        });
                    }
                    from += had;
                    to += has;
                }
                // SAFETY: `commands` is being recorded; both buffers live until the copy is done.
                unsafe {
                    device.raw().cmd_copy_buffer(commands, self.buffers[*slot].raw(), buffer.raw(), &regions);
                }
            }
            // The host may read packets that were there before, where they now are.
            crate::kernel::record_host_barrier(device, commands);
        })?;
        for (slot, buffer) in fresh {
            self.buffers[slot] = buffer;
        }
        for (camera, place) in cameras.iter_mut().zip(places) {
            camera.place = place;
        }
        Ok(())
    }

    /// Memory by camera and purpose.
    pub(super) fn memory(&self, cameras: &[CameraState]) -> Vec<MemoryUse> {
        let mut uses = Vec::new();
        for (slot, binding) in BINDINGS.iter().enumerate() {
            let buffer = &self.buffers[slot];
            let mut shared = buffer.bytes();
            for (number, camera) in cameras.iter().enumerate() {
                if buffer.bytes() <= 16 {
                    continue;
                }
                if let Some(elements) = camera.place.elements()[slot].filter(|&e| e > 0) {
                    let bytes = elements * u64::from(binding.stride);
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

/// Reads a part of a buffer back through a staging buffer, and waits.
pub(super) fn read_back(
    device: &Arc<Device>,
    buffer: &Buffer,
    offset: u64,
    bytes: u64,
) -> Result<Vec<u8>, EngineError> {
    if bytes == 0 {
        return Ok(Vec::new());
    }
    let staging =
        device.allocate("download", bytes, vk::BufferUsageFlags::empty(), MemoryLocation::GpuToCpu)?;
    let region = [vk::BufferCopy { src_offset: offset, dst_offset: 0, size: bytes }];
    device.run_once(|commands| {
        // SAFETY: `commands` is being recorded; both buffers are alive until the copy is done.
        unsafe {
            device.raw().cmd_copy_buffer(commands, buffer.raw(), staging.raw(), &region);
        }
        crate::kernel::record_host_barrier(device, commands);
    })?;
    Ok(staging.read::<u8>(0, bytes as usize).to_vec())
}

fn total(places: &[Place], slot: usize) -> u64 {
    places.iter().filter_map(|p| p.elements()[slot]).sum::<u64>()
}

fn allocate(
    device: &Arc<Device>,
    slot: usize,
    elements: u64,
    packets: PacketPlace,
) -> Result<Buffer, EngineError> {
    let binding = &BINDINGS[slot];
    let (location, usage) = match slot {
        layout::CAMERAS => (MemoryLocation::CpuToGpu, vk::BufferUsageFlags::UNIFORM_BUFFER),
        layout::EVENT_T | layout::EVENT_X | layout::EVENT_Y | layout::EVENT_P
            if packets == PacketPlace::OnDevice =>
        {
            (MemoryLocation::GpuOnly, vk::BufferUsageFlags::empty())
        }
        // Kernels write what the host reads straight into its memory.
        layout::EVENT_T
        | layout::EVENT_X
        | layout::EVENT_Y
        | layout::EVENT_P
        | layout::APS
        | layout::REPORT
        | layout::SAMPLES => (MemoryLocation::GpuToCpu, vk::BufferUsageFlags::empty()),
        layout::PLANES | layout::MOTION => {
            (MemoryLocation::GpuOnly, vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER)
        }
        _ => (MemoryLocation::GpuOnly, vk::BufferUsageFlags::empty()),
    };
    let bytes = elements * u64::from(binding.stride);
    // Kernels count them in 32 bits.
    if bytes > u64::from(u32::MAX) {
        return Err(EngineError::OutOfMemory {
            name: binding.name.to_owned(),
            bytes,
            reason: "a rig's buffers have at most 4294967295; give cameras rigs of their own".to_owned(),
        });
    }
    let buffer = device.allocate(binding.name, bytes, usage, location)?;
    match slot {
        layout::PLANES => buffer.with_texels(vk::Format::R32_SFLOAT, u64::from(binding.stride)),
        layout::MOTION => buffer.with_texels(vk::Format::R32G32_SFLOAT, u64::from(binding.stride)),
        _ => Ok(buffer),
    }
}
