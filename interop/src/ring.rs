//! The ring: the slots that one camera's producer and the engine share, each with buffers for one frame.

use crate::error::InteropError;
use crate::images::{Images, Planes};
use crate::ownership::{Way, hand_over};
use crate::plane::Plane;
use crate::timeline::{CarriedTimeline, ExportedTimeline, SharedTimeline};
use crate::wire::ImageMemory;
use esaac_engine::ash::vk;
use esaac_engine::{Commands, Device, InputBuffers};
use rustix::fd::OwnedFd;
use std::sync::Arc;

/// Memory for one frame, and the timeline that orders its use.
pub struct Slot {
    planes: Planes<Plane>,
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
    Peer { kind: u32, fds: Vec<OwnedFd>, told: [ImageMemory; 4] },
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
        let Planes { hdr, motion, depth, ids } = &self.planes;
        InputBuffers {
            hdr: hdr.texels().expect("a slot of images has no buffers on the producer's side"),
            motion: motion.as_ref().and_then(Plane::texels),
            depth: depth.as_ref().and_then(Plane::texels),
            ids: ids.as_ref().and_then(Plane::texels),
        }
    }

    /// Images of the frame, if the producer brings images; their layout is `GENERAL`.
    #[must_use]
    pub fn images(&self) -> Option<Planes<vk::Image>> {
        self.planes.try_map(|_, plane| plane.image().ok_or(())).ok()
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
            Source::Own(kind) => (kind, [None; 4]),
            Source::Peer { kind, fds, told } => {
                memory_fds = fds.into_iter();
                (kind, told.map(Some))
            }
        };
        let shapes = images.kinds().paired(told);
        let mut all = Vec::new();
        for (slot, timeline) in (0..).zip(timelines) {
            let planes = shapes.try_map(|image, &(shape, told)| {
                let name = format!("camera {camera} slot {slot} {image}");
                // The number of descriptors was checked with the message that they came with.
                match told.zip(memory_fds.next()) {
                    Some((told, fd)) => Plane::peers(device, &name, kind, shape, fd, told),
                    None => Plane::own(device, &name, kind, shape),
                }
            })?;
            let handed: Vec<&Plane> = planes.iter().collect();
            let acquire = hand_over(device, &handed, Way::Acquire)?;
            let release = hand_over(device, &handed, Way::Release)?;
            all.push(Slot { planes, timeline, acquire, release });
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
        let planes = self.slots[0].planes.iter();
        planes.filter(|plane| matches!(plane, Plane::Image { texels: Some(_), .. })).count() as u64
    }

    /// What the peer must know of the images' memory: colour, motion, depth, ids; zeroes of those that are not there.
    pub(crate) fn described(&self) -> [ImageMemory; 4] {
        self.slots[0].planes.map(Plane::described).all()
    }

    /// Descriptors of all images' memory, slot by slot, for the peer; once.
    pub(crate) fn export_memory(&mut self, device: &Device) -> Result<Vec<OwnedFd>, InteropError> {
        let planes = self.slots.iter_mut().flat_map(|slot| slot.planes.iter_mut());
        planes.map(|plane| plane.export(device)).collect()
    }
}
