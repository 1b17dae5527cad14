//! The producer.

#![expect(unsafe_code, reason = "CUDA's edge")]

use super::context::{Context, CudaDevice, check, cuda_devices};
use super::image::CudaImage;
use super::semaphore::CudaTimeline;
use crate::client::{Client, Copies, Descriptors, Greeting};
use crate::error::InteropError;
use crate::ring::Images;
use crate::wire::{self, ErrorCode, ImageMemory, NO_DRIVER};
use cudarc::driver::sys;
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
            timeout: Duration::from_secs(10),
        }
    }
}

/// An image on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strided {
    /// `CUdeviceptr` of the first row.
    pub pointer: u64,
    /// Bytes from row to row.
    pub stride_bytes: usize,
}

/// Where a slot's images are, rows tightly packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotPointers {
    /// `CUdeviceptr` of the colour.
    pub hdr: u64,
    /// Of the motion, if there is any.
    pub motion: Option<u64>,
}

struct CudaSlot {
    hdr: CudaImage,
    motion: Option<CudaImage>,
    timeline: Option<CudaTimeline>,
}

pub(super) struct Stream {
    context: Arc<Context>,
    pub(super) raw: sys::CUstream,
    owned: bool,
}

/// A connected camera.
pub struct CudaProducer {
    client: Client,
    slots: Vec<CudaSlot>,
    stream: Stream,
    context: Arc<Context>,
}

// SAFETY: the stream is a handle of a context that is entered for every use, on whichever thread.
unsafe impl Send for Stream {}

impl CudaProducer {
    /// Connects to the engine at `path`.
    pub fn connect(path: &Path, options: &CudaOptions) -> Result<Self, InteropError> {
        let devices: Vec<CudaDevice> = cuda_devices()?
            .into_iter()
            .filter(|device| options.device.is_none_or(|uuid| uuid == device.uuid))
            .collect();
        let wanted = options.device.map_or(String::new(), |uuid| format!(" {uuid:02x?}"));
        let mut last = InteropError::NoCudaDevice { wanted };
        for device in devices {
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

    /// Where to write a slot: no copy at all.
    #[must_use]
    pub fn pointers(&self, slot: u32) -> SlotPointers {
        let slot = &self.slots[slot as usize];
        SlotPointers { hdr: slot.hdr.pointer(), motion: slot.motion.as_ref().map(CudaImage::pointer) }
    }

    /// Has a frame copied into a slot, one copy on the device an image, in the stream's order.
    ///
    /// # Safety
    /// The images are memory of this device that stays valid until the copies are done, in the formats of
    /// [`Client::images`], with whole rows at their strides. (Strides shorter than a row, images that
    /// end outside their allocation and pointers that CUDA does not know are refused.)
    pub unsafe fn copy(
        &self,
        slot: u32,
        hdr: Strided,
        motion: Option<Strided>,
    ) -> Result<Copies, InteropError> {
        let (images, place) = (*self.client.images(), &self.slots[slot as usize]);
        let _entered = self.context.enter()?;
        let mut copies = Copies::default();
        let targets = [
            (Some(hdr), Some(&place.hdr), images.hdr.texel_bytes(), "hdr"),
            (motion, place.motion.as_ref(), images.motion.map_or(0, |m| m.texel_bytes()), "motion"),
        ];
        for (source, target, texel_bytes, name) in targets {
            let Some(target) = target else { continue };
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
        {
            let _entered = self.context.enter()?;
            match &self.slots[slot as usize].timeline {
                Some(timeline) => timeline.signal(self.stream.raw, self.client.value(slot) + 1)?,
                None => self.stream.finish()?,
            }
        }
        self.client.publish(slot, t_ns, copies)
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

impl Stream {
    pub(super) fn new(context: &Arc<Context>, given: Option<u64>) -> Result<Self, InteropError> {
        let owned = given.is_none();
        let mut raw = given.map_or(std::ptr::null_mut(), |given| given as sys::CUstream);
        if owned {
            let _entered = context.enter()?;
            let flags = sys::CUstream_flags::CU_STREAM_NON_BLOCKING as u32;
            // SAFETY: a context is current.
            check("cuStreamCreate", unsafe { sys::cuStreamCreate(&mut raw, flags) })?;
        }
        Ok(Stream { context: Arc::clone(context), raw, owned })
    }

    /// Waits for all that is in it. The context is current.
    pub(super) fn finish(&self) -> Result<(), InteropError> {
        // SAFETY: the stream is of the current context.
        check("cuStreamSynchronize", unsafe { sys::cuStreamSynchronize(self.raw) })
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        if !self.owned {
            return;
        }
        let destroyed = self.context.enter().and_then(|_entered| {
            // SAFETY: the stream was made here, and its work is waited for.
            check("cuStreamDestroy", unsafe { sys::cuStreamDestroy_v2(self.raw) })
        });
        if let Err(error) = destroyed {
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
    let mut image = |bytes: u64, told: &ImageMemory| match fds.next() {
        Some(fd) => CudaImage::import(context, fd, told),
        None => CudaImage::bring(context, bytes),
    };
    let mut slots = Vec::new();
    for _ in 0..offer.slots {
        let hdr = image(images.hdr_bytes(), &offer.hdr)?;
        let motion = match images.motion {
            Some(_) => Some(image(images.motion_bytes(), &offer.motion)?),
            None => None,
        };
        let timeline = timelines.next().map(|fd| CudaTimeline::import(context, fd)).transpose()?;
        slots.push(CudaSlot { hdr, motion, timeline });
    }
    if client.brings() {
        bring(client, &images, &slots)?;
    }
    Ok(slots)
}

/// Hands CUDA's memory to the engine.
fn bring(client: &Client, images: &Images, slots: &[CudaSlot]) -> Result<(), InteropError> {
    let mut fds: Vec<OwnedFd> = Vec::new();
    let mut told = [ImageMemory::default(); 2];
    for slot in slots {
        let (fd, memory) = slot.hdr.export(images.hdr_bytes())?;
        fds.push(fd);
        told[0] = memory;
        if let Some(motion) = &slot.motion {
            let (fd, memory) = motion.export(images.motion_bytes())?;
            fds.push(fd);
            told[1] = memory;
        }
    }
    client.bring(told, &fds)
}

/// Has rows copied on the device, in the stream's order. The context is current.
///
/// # Safety
/// Source and target have `rows` rows of `row_bytes` at their strides until the stream has copied them.
pub(super) unsafe fn copy_rows(
    stream: &Stream,
    source: Strided,
    row_bytes: usize,
    rows: usize,
    target: sys::CUdeviceptr,
    target_stride_bytes: usize,
) -> Result<(), InteropError> {
    let copy = sys::CUDA_MEMCPY2D {
        srcXInBytes: 0,
        srcY: 0,
        srcMemoryType: sys::CUmemorytype::CU_MEMORYTYPE_DEVICE,
        srcHost: std::ptr::null(),
        srcDevice: source.pointer,
        srcArray: std::ptr::null_mut(),
        srcPitch: source.stride_bytes,
        dstXInBytes: 0,
        dstY: 0,
        dstMemoryType: sys::CUmemorytype::CU_MEMORYTYPE_DEVICE,
        dstHost: std::ptr::null_mut(),
        dstDevice: target,
        dstArray: std::ptr::null_mut(),
        dstPitch: target_stride_bytes,
        WidthInBytes: row_bytes,
        Height: rows,
    };
    // SAFETY: as the caller guarantees.
    check("cuMemcpy2DAsync", unsafe { sys::cuMemcpy2DAsync_v2(&copy, stream.raw) })
}

/// Whether an image lies inside its allocation.
pub(super) fn check_source(
    name: &str,
    source: Strided,
    row_bytes: usize,
    rows: usize,
) -> Result<(), InteropError> {
    let (mut base, mut size) = (0, 0);
    // SAFETY: a context is current; both results outlive the call.
    let known = unsafe { sys::cuMemGetAddressRange_v2(&mut base, &mut size, source.pointer) };
    check("cuMemGetAddressRange", known)?;
    fits(name, source, row_bytes, rows, base + size as u64)
}

/// Whether rows at a stride end before `end`.
fn fits(
    name: &str,
    source: Strided,
    row_bytes: usize,
    rows: usize,
    end: sys::CUdeviceptr,
) -> Result<(), InteropError> {
    if source.stride_bytes < row_bytes {
        return Err(InteropError::Size {
            name: format!("{name} row"),
            expected: row_bytes as u64,
            actual: source.stride_bytes as u64,
        });
    }
    let expected = (rows.saturating_sub(1))
        .checked_mul(source.stride_bytes)
        .and_then(|bytes| bytes.checked_add(row_bytes))
        .unwrap_or(usize::MAX) as u64;
    let actual = end.saturating_sub(source.pointer);
    if expected <= actual {
        Ok(())
    } else {
        Err(InteropError::Size { name: name.to_owned(), expected, actual })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_end_where_their_allocation_does() {
        let at = |stride_bytes| Strided { pointer: 1000, stride_bytes };
        // Four rows of 16 bytes, the last without its padding.
        assert!(fits("hdr", at(16), 16, 4, 1064).is_ok());
        assert!(fits("hdr", at(32), 16, 4, 1112).is_ok());
        for (stride_bytes, end, words) in [
            (16, 1063, "`hdr` has 63 bytes, expected 64"),
            (32, 1111, "`hdr` has 111 bytes, expected 112"),
            (15, 2000, "`hdr row` has 15 bytes, expected 16"),
            (16, 900, "`hdr` has 0 bytes, expected 64"),
            (usize::MAX, u64::MAX - 1000, "expected 18446744073709551615"),
            (usize::MAX / 3, u64::MAX - 1000, "expected 18446744073709551615"),
        ] {
            let error = fits("hdr", at(stride_bytes), 16, 4, end).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
