//! The producer.

#![expect(unsafe_code, reason = "CUDA's edge")]

use super::context::{Context, CudaDevice, cuda_devices, missing};
use super::copy::{Strided, check_source, copy_rows};
use super::image::CudaImage;
use super::semaphore::CudaTimeline;
use super::stream::Stream;
use crate::client::{Client, Copies, Descriptors, Gives, Greeting};
use crate::error::InteropError;
use crate::images::{Images, Planes};
use crate::wire::{self, ErrorCode, ImageMemory, NO_DRIVER};
use esaac_model::paths::SceneMotion;
use rustix::fd::OwnedFd;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// How a CUDA producer connects.
#[derive(Clone, Copy, Debug)]
pub struct CudaOptions {
    /// Camera to feed.
    pub camera: u32,
    /// Size that it renders; `None` for the rig's.
    pub size_px: Option<(u32, u32)>,
    /// Device by UUID; `None` for the one that the engine is on.
    pub device: Option<[u8; 16]>,
    /// Whether the slots shall be memory of CUDA's own that the engine imports.
    pub brings_memory: bool,
    /// Timelines that it may use, as bits.
    pub timelines: u32,
    /// Stream for copies and signals, a `CUstream` of the primary context; `None` for one of its own.
    pub stream: Option<u64>,
    /// Whether it gives depth and poses.
    pub geometry: Gives,
    /// How long it waits for the engine's answers.
    pub timeout: Duration,
}

impl Default for CudaOptions {
    fn default() -> Self {
        CudaOptions {
            camera: 0,
            size_px: None,
            device: None,
            brings_memory: false,
            timelines: wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED,
            stream: None,
            geometry: Gives::Images,
            timeout: Duration::from_secs(10),
        }
    }
}

struct CudaSlot {
    planes: Planes<CudaImage>,
    timeline: Option<CudaTimeline>,
}

/// A connected camera.
pub struct CudaProducer {
    client: Client,
    slots: Vec<CudaSlot>,
    stream: Stream,
    context: Arc<Context>,
}

impl CudaProducer {
    /// Connects to the engine at `path`.
    pub fn connect(path: &Path, options: &CudaOptions) -> Result<Self, InteropError> {
        let devices = cuda_devices()?;
        let wanted = options.device.map_or(String::new(), |uuid| format!(": {}", missing(uuid, &devices)));
        let mut last = InteropError::NoCudaDevice { wanted };
        for device in devices.into_iter().filter(|d| options.device.is_none_or(|uuid| uuid == d.uuid)) {
            match Self::connect_on(device, path, options) {
                // The engine is on another one.
                Err(error @ InteropError::Refused { code: ErrorCode::Device, .. }) => last = error,
                other => return other,
            }
        }
        Err(last)
    }

    fn connect_on(device: CudaDevice, path: &Path, options: &CudaOptions) -> Result<Self, InteropError> {
        let greeting = Greeting {
            device_uuid: device.uuid,
            driver_uuid: NO_DRIVER,
            camera: options.camera,
            size_px: options.size_px,
            memories: if options.brings_memory { wire::MEMORY_BROUGHT } else { wire::MEMORY_EXPORTED },
            timelines: options.timelines,
            geometry: options.geometry,
            timeout: options.timeout,
        };
        let (client, descriptors) = Client::greet(path, &greeting)?;
        let prepare = || {
            let context = Arc::new(Context::retain(device.ordinal)?);
            let stream = Stream::new(&context, options.stream)?;
            let slots = slots(&context, &client, descriptors)?;
            Ok((context, stream, slots))
        };
        match prepare() {
            Ok((context, stream, slots)) => Ok(CudaProducer { client, slots, stream, context }),
            Err(error) => Err(client.give_up(error)),
        }
    }

    /// What was agreed with the engine; what is written or copied must be as its images are.
    #[must_use]
    pub fn client(&self) -> &Client {
        &self.client
    }

    /// Stream in which copies and signals are ordered, as a `CUstream`.
    #[must_use]
    pub fn stream(&self) -> u64 {
        self.stream.raw as u64
    }

    /// A slot to write; waits for the engine to give one back. What is put into the stream from now on
    /// comes after the engine's reading.
    pub fn slot(&mut self) -> Result<u32, InteropError> {
        // A message says that the engine's device is done; nothing need be set.
        let slot = self.client.slot(|_, _| Ok(()))?;
        let value = self.client.value(slot);
        if let Some(timeline) = &self.slots[slot as usize].timeline
            && value > 0
        {
            let _entered = self.context.enter()?;
            timeline.wait(self.stream.raw, value)?;
        }
        Ok(slot)
    }

    /// Where to write a slot, as `CUdeviceptr`s of images whose rows are tightly packed: no copy at all.
    #[must_use]
    pub fn pointers(&self, slot: u32) -> Planes<u64> {
        self.slots[slot as usize].planes.map(CudaImage::pointer)
    }

    /// Has a frame copied into a slot, one copy on the device an image, in the stream's order.
    ///
    /// # Safety
    /// The images are memory of this device that stays valid until the copies are done, in the formats of
    /// [`Client::images`], with whole rows at their strides. (Strides shorter than a row, images that
    /// end outside their allocation and pointers that CUDA does not know are refused.)
    pub unsafe fn copy(&self, slot: u32, frame: Planes<Strided>) -> Result<Copies, InteropError> {
        let (images, place) = (*self.client.images(), &self.slots[slot as usize]);
        let _entered = self.context.enter()?;
        let mut copies = Copies::default();
        let sources = [Some(frame.hdr), frame.motion, frame.depth, frame.ids];
        let targets = images.texel_bytes().paired(sources);
        for ((name, &(texel_bytes, source)), target) in targets.named().zip(place.planes.iter()) {
            let row_bytes = images.width_px as usize * texel_bytes;
            let rows = images.height_px as usize;
            let Some(source) = source else {
                let expected = (row_bytes * rows) as u64;
                return Err(InteropError::Size { name: name.to_owned(), expected, actual: 0 });
            };
            check_source(name, source, row_bytes, rows)?;
            // SAFETY: the slot has room for the image; the source is as the caller guarantees.
            unsafe { copy_rows(&self.stream, source, row_bytes, rows, target.pointer(), row_bytes) }?;
            copies.device += 1;
        }
        Ok(copies)
    }

    /// Tells the engine of the frame in a slot, whose writing is in the stream.
    pub fn publish(&mut self, slot: u32, t_ns: i64, copies: Copies) -> Result<(), InteropError> {
        self.publish_frame(slot, t_ns, copies, None)
    }

    /// As [`CudaProducer::publish`], with the poses from the last frame to this one. They are sent if the camera takes
    /// them ([`Images::geometry`](crate::Images::geometry)); then they must come with every frame.
    ///
    /// Poses that are wrong are [`InteropError::Scene`]. Then the slot is still the caller's, to be published with other poses.
    pub fn publish_scene(
        &mut self,
        slot: u32,
        t_ns: i64,
        copies: Copies,
        scene: &SceneMotion,
    ) -> Result<(), InteropError> {
        self.publish_frame(slot, t_ns, copies, Some(scene))
    }

    fn publish_frame(
        &mut self,
        slot: u32,
        t_ns: i64,
        copies: Copies,
        scene: Option<&SceneMotion>,
    ) -> Result<(), InteropError> {
        let (context, stream, timeline) = (&self.context, &self.stream, &self.slots[slot as usize].timeline);
        self.client.publish(slot, t_ns, copies, scene, |value| {
            let _entered = context.enter()?;
            match timeline {
                Some(timeline) => timeline.signal(stream.raw, value),
                None => stream.finish(),
            }
        })
    }

    /// Says that there are no more frames and waits until the engine has taken all; how many it has
    /// stepped and dropped.
    pub fn finish(mut self) -> Result<(u64, u64), InteropError> {
        self.client.finish(|_, _| Ok(()))
    }
}

impl Drop for CudaProducer {
    fn drop(&mut self) {
        // The images and timelines that follow must not be in use.
        let finished = self.context.enter().and_then(|_entered| self.stream.finish());
        if let Err(error) = finished {
            eprintln!("esaac: {error}");
        }
    }
}

/// The slots of an offer.
fn slots(
    context: &Arc<Context>,
    client: &Client,
    descriptors: Descriptors,
) -> Result<Vec<CudaSlot>, InteropError> {
    let (offer, images) = (*client.offer(), *client.images());
    let (mut fds, mut timelines) = (descriptors.memory.into_iter(), descriptors.timelines.into_iter());
    // The number of descriptors was checked with the offer.
    let mut image = |slot: u32, what: &str, bytes: u64, told: &ImageMemory| {
        let name = format!("camera {} slot {slot} {what}", offer.camera);
        match fds.next() {
            Some(fd) => CudaImage::import(context, &name, fd, told),
            None => CudaImage::bring(context, &name, bytes),
        }
    };
    let shapes = images.bytes().paired([offer.hdr, offer.motion, offer.depth, offer.ids]);
    let mut slots = Vec::new();
    for slot in 0..offer.slots {
        let planes = shapes.try_map(|what, (bytes, told)| image(slot, what, *bytes, told))?;
        let timeline = timelines.next().map(|fd| CudaTimeline::import(context, fd)).transpose()?;
        slots.push(CudaSlot { planes, timeline });
    }
    if client.brings() {
        bring(client, &images, &slots)?;
    }
    Ok(slots)
}

/// Hands CUDA's memory to the engine.
fn bring(client: &Client, images: &Images, slots: &[CudaSlot]) -> Result<(), InteropError> {
    let mut fds: Vec<OwnedFd> = Vec::new();
    let mut told = [ImageMemory::default(); 4];
    for slot in slots {
        let sized = slot.planes.as_ref().paired(images.bytes().all());
        let described = sized.try_map(|_, &(image, bytes)| {
            let (fd, memory) = image.export(bytes)?;
            fds.push(fd);
            Ok::<_, InteropError>(memory)
        });
        told = described?.all();
    }
    client.bring(told, &fds)
}
