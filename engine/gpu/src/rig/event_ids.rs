//! What the kernels of `event_ids` need besides packets: the ids of each camera's rows of instances, and room for the lists
//! of its blocks.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::Rig;
use super::represent::Representation;
use super::sensor::is_rigid;
use crate::error::EngineError;
use crate::memory::Buffer;
use ash::vk;
use bytemuck::cast_slice;
use esaac_layout::{EVENT_IDS_LIST_WORDS, Slice};
use esaac_model::paths::Projection;
use gpu_allocator::MemoryLocation;

/// Most bytes that an update of a buffer may carry.
const MOST_UPDATED: usize = 65_536;

/// What a dispatch of `event_ids` is told.
pub(super) struct EventIds {
    /// The ids of the rows of all cameras, one camera after the other: the beginning of the rig's `event_ids`.
    rows: Vec<u32>,
    /// Tiles of the camera that has most.
    pub tiles: u32,
    /// Parts of the target for cameras whose paths are not known any more: offsets and sizes in bytes.
    unknown: Vec<[u64; 2]>,
}

impl Rig {
    /// Whether [`Representation::EventIds`] can tell instances of the last tick's events:
    /// not before the first tick, nor once every camera was reset or has other poses, another sensor or state.
    #[must_use]
    pub fn knows_event_ids(&self) -> bool {
        self.cameras.iter().any(|camera| camera.has_paths)
    }

    /// Notes that what the last tick knew of paths is being replaced, for all cameras.
    pub(super) fn forget_paths(&mut self) {
        self.cameras.iter_mut().for_each(|camera| camera.has_paths = false);
    }

    /// [`EngineError::NoEventIds`] if a camera does not follow instances.
    pub(super) fn check_event_ids(&self) -> Result<(), EngineError> {
        for (number, camera) in self.cameras.iter().enumerate() {
            if !is_rigid(&camera.config.sensor) {
                let synthesis = camera.config.sensor.synthesis.name();
                let why = format!("camera {number} has synthesis `{synthesis}`, expected `rigid`");
                return Err(EngineError::NoEventIds(why));
            }
        }
        Ok(())
    }

    /// Makes room for `event_ids`, and tells each camera's slice where its part is. The kernels leave out cameras whose
    /// paths are not known.
    pub(super) fn place_event_ids(&mut self, slices: &mut [Slice]) -> Result<EventIds, EngineError> {
        let rows: Vec<u32> = self.cameras.iter().flat_map(|camera| camera.instances.ids()).collect();
        let list_words = |blocks: u32| u64::from(blocks) * u64::from(EVENT_IDS_LIST_WORDS);
        let words = rows.len() as u64 + self.cameras.iter().map(|c| list_words(c.place.blocks)).sum::<u64>();
        if self.event_ids.as_ref().is_none_or(|buffer| buffer.bytes() < 4 * words) {
            // A quarter more, so that a few more instances need no new one.
            let bytes = (4 * words + words).next_multiple_of(4);
            let usage = vk::BufferUsageFlags::empty();
            self.event_ids =
                Some(self.device.allocate("event_ids", bytes, usage, MemoryLocation::GpuOnly)?);
        }
        let base = self.event_ids.as_ref().expect("made above").address();
        let (mut ids, mut lists) = (base, base + 4 * rows.len() as u64);
        let mut unknown = Vec::new();
        for (camera, slice) in self.cameras.iter().zip(slices) {
            if !camera.has_paths {
                let events = std::mem::take(&mut slice.events);
                if events > 0 {
                    let bytes_of_id = Representation::EventIds.element_bytes();
                    unknown.push([slice.events_before, events].map(|count| bytes_of_id * u64::from(count)));
                }
            }
            let row = self.parameters.iter().position(|row| row.slot == camera.place.slot);
            slice.row = row.expect("every camera has a row") as u32;
            let lens = camera.config.geometry.map(|geometry| geometry.lens.projection());
            slice.fisheye = u32::from(lens == Some(Projection::Fisheye));
            (slice.ids, slice.lists) = (ids, lists);
            ids += 4 * camera.instances.len() as u64;
            lists += 4 * list_words(camera.place.blocks);
        }
        let tiles = self.cameras.iter().map(|camera| camera.place.tiles).max().unwrap_or(0);
        Ok(EventIds { rows, tiles, unknown })
    }

    /// Records that the ids of rows are written, and -1 into the parts of `target` that are not known.
    pub(super) fn record_update(&self, commands: vk::CommandBuffer, ids: &EventIds, target: &Buffer) {
        let buffer = self.event_ids.as_ref().expect("`place_event_ids` has made it");
        let bytes: &[u8] = cast_slice(&ids.rows);
        for (number, part) in bytes.chunks(MOST_UPDATED).enumerate() {
            let offset = (number * MOST_UPDATED) as u64;
            // SAFETY: `commands` is being recorded; the buffer is alive and has room for all rows. Parts are of whole words
            // and as large as an update may be at most.
            unsafe { self.device.raw().cmd_update_buffer(commands, buffer.raw(), offset, part) };
        }
        for &[offset, bytes] in &ids.unknown {
            // SAFETY: `commands` is being recorded; the target is alive and has room for the ids of all events, whole words.
            unsafe { self.device.raw().cmd_fill_buffer(commands, target.raw(), offset, bytes, u32::MAX) };
        }
    }
}
