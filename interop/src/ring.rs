//! The buffers that one camera's producer and the engine share, slot by slot.

use crate::error::InteropError;
use crate::memory::{SharedBuffer, buffer_bytes};
use crate::ownership::{Way, hand_over};
use crate::timeline::{CarriedTimeline, ExportedTimeline, SharedTimeline};
use crate::wire::{self, ImageMemory};
use esaac_engine::{Commands, Device, InputBuffers};
use esaac_model::{HdrFormat, MotionFormat};
use rustix::fd::OwnedFd;
use std::sync::Arc;

/// What a camera's images are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Images {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Colour.
    pub hdr: HdrFormat,
    /// Motion, if there is any.
    pub motion: Option<MotionFormat>,
}

impl Images {
    /// Bytes of the colour buffer.
    #[must_use]
    pub fn hdr_bytes(&self) -> u64 {
        self.bytes(self.hdr.texel_bytes())
    }

    /// Bytes of the motion buffer; 0 without.
    #[must_use]
    pub fn motion_bytes(&self) -> u64 {
        self.motion.map_or(0, |motion| self.bytes(motion.texel_bytes()))
    }

    /// Images a slot.
    #[must_use]
    pub fn count(&self) -> usize {
        1 + usize::from(self.motion.is_some())
    }

    fn bytes(&self, texel_bytes: usize) -> u64 {
        buffer_bytes(u64::from(self.width_px) * u64::from(self.height_px) * texel_bytes as u64)
    }
}

/// One frame's place.
pub struct Slot {
    hdr: SharedBuffer,
    motion: Option<SharedBuffer>,
    timeline: Box<dyn SharedTimeline>,
    acquire: Commands,
    release: Commands,
}

/// A camera's slots.
pub struct Ring {
    slots: Vec<Slot>,
}

/// Where a ring's memory comes from.
pub(crate) enum Source {
    /// Made here, by `wire::MEMORY_EXPORTED` or `wire::MEMORY_HOST`.
    Own(u32),
    /// The peer's descriptors, images of each slot in turn.
    Peer { kind: u32, fds: Vec<OwnedFd>, hdr: ImageMemory, motion: ImageMemory },
}

/// A count for each slot, made here.
pub(crate) fn make_timelines(
    device: &Arc<Device>,
    slots: u32,
    exported: bool,
) -> Result<Vec<Box<dyn SharedTimeline>>, InteropError> {
    (0..slots)
        .map(|_| {
            let timeline: Box<dyn SharedTimeline> = if exported {
                Box::new(ExportedTimeline::new(device)?)
            } else {
                Box::new(CarriedTimeline::new(device)?)
            };
            Ok(timeline)
        })
        .collect()
}

/// A count for each slot, the peer's.
pub(crate) fn import_timelines(
    device: &Arc<Device>,
    fds: Vec<OwnedFd>,
) -> Result<Vec<Box<dyn SharedTimeline>>, InteropError> {
    fds.into_iter()
        .map(|fd| Ok(Box::new(ExportedTimeline::import(device, fd)?) as Box<dyn SharedTimeline>))
        .collect()
}

/// Descriptors of timelines, where they are shared.
pub(crate) fn export_timelines(timelines: &[Box<dyn SharedTimeline>]) -> Result<Vec<OwnedFd>, InteropError> {
    let fds: Result<Vec<_>, _> = timelines.iter().map(|timeline| timeline.export()).collect();
    Ok(fds?.into_iter().flatten().collect())
}

impl Slot {
    /// Buffers of the frame.
    #[must_use]
    pub fn inputs(&self) -> InputBuffers<'_> {
        InputBuffers { hdr: self.hdr.buffer(), motion: self.motion.as_ref().map(SharedBuffer::buffer) }
    }

    /// The slot's count.
    #[must_use]
    pub fn timeline(&self) -> &dyn SharedTimeline {
        &*self.timeline
    }

    /// Takes the buffers from the other side.
    #[must_use]
    pub fn acquire(&self) -> &Commands {
        &self.acquire
    }

    /// Gives the buffers to the other side.
    #[must_use]
    pub fn release(&self) -> &Commands {
        &self.release
    }
}

impl Ring {
    /// A slot for each timeline.
    pub(crate) fn new(
        device: &Arc<Device>,
        camera: u32,
        images: &Images,
        memory: Source,
        timelines: Vec<Box<dyn SharedTimeline>>,
    ) -> Result<Self, InteropError> {
        let mut memory_fds = Vec::new().into_iter();
        let (kind, told) = match memory {
            Source::Own(kind) => (kind, None),
            Source::Peer { kind, fds, hdr, motion } => {
                memory_fds = fds.into_iter();
                (kind, Some((hdr, motion)))
            }
        };
        let mut buffer = |slot: u32, image: &str, bytes: u64, told: Option<ImageMemory>| {
            let name = format!("camera {camera} slot {slot} {image}");
            // The number of descriptors was checked with the message that they came with.
            let fd = told.and_then(|_| memory_fds.next());
            match (kind, fd, told) {
                (wire::MEMORY_HOST, fd, told) => SharedBuffer::on_host(device, &name, bytes, fd.zip(told)),
                (_, Some(fd), Some(told)) => SharedBuffer::import(device, &name, fd, &told, bytes),
                _ => SharedBuffer::exportable(device, &name, bytes),
            }
        };
        let mut all = Vec::new();
        for (slot, timeline) in (0..).zip(timelines) {
            let hdr = buffer(slot, "hdr", images.hdr_bytes(), told.map(|told| told.0))?;
            let motion = match images.motion {
                Some(_) => Some(buffer(slot, "motion", images.motion_bytes(), told.map(|told| told.1))?),
                None => None,
            };
            let buffers = || [Some(&hdr), motion.as_ref()].into_iter().flatten().map(SharedBuffer::buffer);
            let acquire = hand_over(device, buffers(), Way::Acquire)?;
            let release = hand_over(device, buffers(), Way::Release)?;
            all.push(Slot { hdr, motion, timeline, acquire, release });
        }
        Ok(Ring { slots: all })
    }

    /// A slot; panics if there is none of this number, which messages are checked for.
    #[must_use]
    pub fn slot(&self, slot: u32) -> &Slot {
        &self.slots[slot as usize]
    }

    /// Slots.
    #[must_use]
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Whether it has none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// What the peer must know of the images' memory: colour, motion.
    pub(crate) fn described(&self) -> [ImageMemory; 2] {
        let first = &self.slots[0];
        let motion = first.motion.as_ref().map_or(ImageMemory::default(), SharedBuffer::described);
        [first.hdr.described(), motion]
    }

    /// Descriptors of all images' memory, slot by slot.
    pub(crate) fn export_memory(&self, device: &Device) -> Result<Vec<OwnedFd>, InteropError> {
        let buffers = self.slots.iter().flat_map(|slot| [Some(&slot.hdr), slot.motion.as_ref()]);
        buffers.flatten().map(|buffer| buffer.export(device)).collect()
    }
}
