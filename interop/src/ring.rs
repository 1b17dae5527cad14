//! The ring: the slots that one camera's producer and the engine share, each with buffers for one frame.

use crate::error::InteropError;
use crate::image::{ImageKind, hdr_format, motion_format};
use crate::memory::buffer_bytes;
use crate::ownership::{Way, hand_over};
use crate::plane::Plane;
use crate::timeline::{CarriedTimeline, ExportedTimeline, SharedTimeline};
use crate::wire::ImageMemory;
use esaac_engine::ash::vk;
use esaac_engine::{Commands, Device, InputBuffers};
use esaac_model::{HdrFormat, MotionFormat};
use rustix::fd::OwnedFd;
use std::sync::Arc;

/// Size and formats of a camera's images.
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

    /// Number of images in a slot.
    #[must_use]
    pub fn count(&self) -> usize {
        1 + usize::from(self.motion.is_some())
    }

    /// Whether the engine can take them as images of optimal tiling on this device.
    pub(crate) fn are_importable(&self, device: &Device) -> bool {
        self.hdr_kind().is_importable(device)
            && self.motion_kind().is_none_or(|motion| motion.is_importable(device))
    }

    /// The colour as an image of optimal tiling.
    pub(crate) fn hdr_kind(&self) -> ImageKind {
        self.kind(hdr_format(self.hdr), self.hdr_bytes())
    }

    /// The motion.
    pub(crate) fn motion_kind(&self) -> Option<ImageKind> {
        self.motion.map(|motion| self.kind(motion_format(motion), self.motion_bytes()))
    }

    fn kind(&self, format: vk::Format, bytes: u64) -> ImageKind {
        ImageKind { format, width_px: self.width_px, height_px: self.height_px, bytes }
    }

    fn bytes(&self, texel_bytes: usize) -> u64 {
        buffer_bytes(u64::from(self.width_px) * u64::from(self.height_px) * texel_bytes as u64)
    }
}

/// Memory for one frame, and the timeline that orders its use.
pub struct Slot {
    hdr: Plane,
    motion: Option<Plane>,
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
    /// Made here: buffers by `wire::MEMORY_EXPORTED` or `wire::MEMORY_HOST`, images by
    /// `wire::MEMORY_IMAGES`.
    Own(u32),
    /// The peer's descriptors, images of each slot in turn.
    Peer { kind: u32, fds: Vec<OwnedFd>, hdr: ImageMemory, motion: ImageMemory },
}

/// Makes a timeline for each slot.
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

/// Imports the peer's timelines, one for each slot.
pub(crate) fn import_timelines(
    device: &Arc<Device>,
    fds: Vec<OwnedFd>,
) -> Result<Vec<Box<dyn SharedTimeline>>, InteropError> {
    fds.into_iter()
        .map(|fd| Ok(Box::new(ExportedTimeline::import(device, fd)?) as Box<dyn SharedTimeline>))
        .collect()
}

/// Descriptors of the timelines that can be shared.
pub(crate) fn export_timelines(timelines: &[Box<dyn SharedTimeline>]) -> Result<Vec<OwnedFd>, InteropError> {
    let fds: Result<Vec<_>, _> = timelines.iter().map(|timeline| timeline.export()).collect();
    Ok(fds?.into_iter().flatten().collect())
}

impl Slot {
    /// Buffers of the frame.
    ///
    /// # Panics
    /// On the side of a producer that brings images: those are [`Slot::images`].
    #[must_use]
    pub fn inputs(&self) -> InputBuffers<'_> {
        InputBuffers {
            hdr: self.hdr.texels().expect("a slot of images has no buffers on the producer's side"),
            motion: self.motion.as_ref().and_then(Plane::texels),
        }
    }

    /// Images of the frame, colour and motion, if the producer brings images; their layout is `GENERAL`.
    #[must_use]
    pub fn images(&self) -> Option<(vk::Image, Option<vk::Image>)> {
        Some((self.hdr.image()?, self.motion.as_ref().and_then(Plane::image)))
    }

    /// The slot's timeline.
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
    /// Makes a ring with a slot for each timeline.
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
        let mut plane = |slot: u32, image: &str, shape: ImageKind, told: Option<ImageMemory>| {
            let name = format!("camera {camera} slot {slot} {image}");
            // The number of descriptors was checked with the message that they came with.
            match told.zip(memory_fds.next()) {
                Some((told, fd)) => Plane::peers(device, &name, kind, shape, fd, told),
                None => Plane::own(device, &name, kind, shape),
            }
        };
        let mut all = Vec::new();
        for (slot, timeline) in (0..).zip(timelines) {
            let hdr = plane(slot, "hdr", images.hdr_kind(), told.map(|told| told.0))?;
            let motion = match images.motion_kind() {
                Some(shape) => Some(plane(slot, "motion", shape, told.map(|told| told.1))?),
                None => None,
            };
            let planes: Vec<&Plane> = [Some(&hdr), motion.as_ref()].into_iter().flatten().collect();
            let acquire = hand_over(device, &planes, Way::Acquire)?;
            let release = hand_over(device, &planes, Way::Release)?;
            all.push(Slot { hdr, motion, timeline, acquire, release });
        }
        Ok(Ring { slots: all })
    }

    /// The slot of this number.
    ///
    /// # Panics
    /// If there is none. Messages are checked for it before they come here.
    #[must_use]
    pub fn slot(&self, slot: u32) -> &Slot {
        &self.slots[slot as usize]
    }

    /// Slots.
    #[must_use]
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Whether it has no slots.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Copies on the device that the engine makes of each frame.
    pub(crate) fn copies(&self) -> u64 {
        let slot = &self.slots[0];
        let planes = [Some(&slot.hdr), slot.motion.as_ref()].into_iter().flatten();
        planes.filter(|plane| matches!(plane, Plane::Image { texels: Some(_), .. })).count() as u64
    }

    /// What the peer must know of the images' memory: colour, motion.
    pub(crate) fn described(&self) -> [ImageMemory; 2] {
        let first = &self.slots[0];
        let motion = first.motion.as_ref().map_or(ImageMemory::default(), Plane::described);
        [first.hdr.described(), motion]
    }

    /// Descriptors of all images' memory, slot by slot, for the peer; once.
    pub(crate) fn export_memory(&mut self, device: &Device) -> Result<Vec<OwnedFd>, InteropError> {
        let planes = self.slots.iter_mut().flat_map(|slot| [Some(&mut slot.hdr), slot.motion.as_mut()]);
        planes.flatten().map(|plane| plane.export(device)).collect()
    }
}
