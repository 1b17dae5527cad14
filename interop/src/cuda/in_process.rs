//! CUDA and the engine in one process: arrays of a CUDA program become frames with one copy on the device,
//! and what the engine writes is read by CUDA where it lies.
//!
//! Copies are ordered by a stream of the link's own, and the host waits for them before the engine is asked to
//! read. A timeline that the engine's queue waits for takes as long in all, since the device turns from one context to
//! the other whoever waits, and leaves the host asleep, which costs it more afterwards. The other way nothing need be
//! waited for: the engine's calls return when its device is done.

#![expect(unsafe_code, reason = "CUDA's edge")]

use super::context::{Context, check, cuda_devices, missing};
use super::copy::{Strided, Texture, array_of, check_source, copy_array, copy_rows};
use super::image::CudaImage;
use super::stream::Stream;
use crate::error::InteropError;
use crate::memory::{SharedBuffer, buffer_bytes};
use crate::support::Support;
use cudarc::driver::sys;
use esaac_engine::{Buffer, Device};
use esaac_model::HdrFormat;
use std::sync::Arc;

/// The engine's device as CUDA sees it.
pub struct CudaLink {
    device: Arc<Device>,
    ordinal: i32,
    ordered: Event,
    stream: Stream,
    context: Arc<Context>,
}

// SAFETY: handles of a context that is entered for every use, on whichever thread.
unsafe impl Send for CudaLink {}

/// A buffer of the engine in CUDA's address space.
pub struct CudaBuffer {
    image: CudaImage,
    /// After what CUDA made of its memory, so that it goes last.
    buffer: SharedBuffer,
}

// SAFETY: what is shared is only asked for its handles.
unsafe impl Sync for CudaBuffer {}

/// Rows of an array on the device, and how they lie in the buffer that they are copied to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rows {
    /// `CUdeviceptr` of the first byte.
    pub pointer: u64,
    /// Bytes of a row.
    pub row_bytes: usize,
    /// Rows.
    pub rows: usize,
    /// Bytes from row to row in the array.
    pub stride_bytes: usize,
    /// Bytes from row to row in the buffer.
    pub target_stride_bytes: usize,
}

struct Event {
    context: Arc<Context>,
    raw: sys::CUevent,
}

impl CudaLink {
    /// Finds the engine's device among CUDA's, and takes its primary context, as the runtime does.
    pub fn open(device: &Arc<Device>) -> Result<Self, InteropError> {
        let (info, devices) = (device.info(), cuda_devices()?);
        let found = devices.iter().find(|d| d.uuid == info.uuid);
        let ordinal = found
            .ok_or_else(|| InteropError::NoCudaDevice {
                wanted: format!(
                    " of the same UUID as the engine's {}; {}",
                    info.name,
                    missing(info.uuid, &devices)
                ),
            })?
            .ordinal;
        if !Support::told(device).export_buffer {
            return Err(InteropError::Unsupported {
                device: info.name.clone(),
                reason: "it lacks VK_KHR_external_memory_fd; hand over arrays of the host".to_owned(),
            });
        }
        let context = Arc::new(Context::retain(ordinal)?);
        let stream = Stream::new(&context, None)?;
        let ordered = Event::new(&context)?;
        Ok(CudaLink { device: Arc::clone(device), ordinal, ordered, stream, context })
    }

    /// CUDA's number of the device.
    #[must_use]
    pub fn ordinal(&self) -> i32 {
        self.ordinal
    }

    /// The stream of its copies, as a `CUstream`.
    #[must_use]
    pub fn stream(&self) -> u64 {
        self.stream.raw as u64
    }

    /// A buffer that both sides see.
    pub fn buffer(&self, name: &str, bytes: u64) -> Result<CudaBuffer, InteropError> {
        let mut buffer = SharedBuffer::exportable(&self.device, name, buffer_bytes(bytes))?;
        let fd = buffer.export(&self.device)?;
        let image = CudaImage::import(&self.context, name, fd, &buffer.described())?;
        Ok(CudaBuffer { image, buffer })
    }

    /// The device whose memory a pointer is, by CUDA's number; an error if CUDA does not know it.
    pub fn device_of(&self, pointer: u64) -> Result<i32, InteropError> {
        let _entered = self.context.enter()?;
        let mut ordinal = -1_i32;
        let attribute = sys::CUpointer_attribute::CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL;
        // SAFETY: a context is current; for this attribute the driver writes an int.
        check("cuPointerGetAttribute", unsafe {
            sys::cuPointerGetAttribute((&raw mut ordinal).cast(), attribute, pointer)
        })?;
        Ok(ordinal)
    }

    /// Whatever is in `stream` now comes before the copies that follow. 1 is the legacy default stream, 2
    /// the thread's.
    ///
    /// # Safety
    /// The stream is one of this device's primary context.
    pub unsafe fn follow(&self, stream: u64) -> Result<(), InteropError> {
        let _entered = self.context.enter()?;
        let event = self.ordered.raw;
        // SAFETY: a context is current, event and streams are of it.
        check("cuEventRecord", unsafe { sys::cuEventRecord(event, stream as sys::CUstream) })?;
        // SAFETY: as above.
        check("cuStreamWaitEvent", unsafe { sys::cuStreamWaitEvent(self.stream.raw, event, 0) })
    }

    /// Whatever is put in `stream` from now on comes after the copies so far.
    ///
    /// # Safety
    /// The stream is one of this device's primary context.
    pub unsafe fn lead(&self, stream: u64) -> Result<(), InteropError> {
        let _entered = self.context.enter()?;
        let event = self.ordered.raw;
        // SAFETY: a context is current, event and streams are of it.
        check("cuEventRecord", unsafe { sys::cuEventRecord(event, self.stream.raw) })?;
        // SAFETY: as above.
        check("cuStreamWaitEvent", unsafe { sys::cuStreamWaitEvent(stream as sys::CUstream, event, 0) })
    }

    /// Has rows copied to `offset` of a buffer.
    ///
    /// # Safety
    /// The rows are memory of this device that stays valid until the engine has stepped.
    pub unsafe fn copy(
        &self,
        name: &str,
        source: Rows,
        target: &CudaBuffer,
        offset: u64,
    ) -> Result<(), InteropError> {
        let Rows { pointer, row_bytes, rows, stride_bytes, target_stride_bytes } = source;
        let needed = offset + ((rows.max(1) - 1) * target_stride_bytes + row_bytes) as u64;
        if needed > target.buffer.buffer().bytes() || target_stride_bytes < row_bytes {
            let actual = target.buffer.buffer().bytes();
            return Err(InteropError::Size { name: name.to_owned(), expected: needed, actual });
        }
        let from = Strided { pointer, stride_bytes };
        let _entered = self.context.enter()?;
        check_source(name, from, row_bytes, rows)?;
        let to = target.image.pointer() + offset;
        // SAFETY: the target has room, as was checked; the source is as the caller guarantees.
        unsafe { copy_rows(&self.stream, from, row_bytes, rows, to, target_stride_bytes) }
    }

    /// Has a texture copied to the beginning of a buffer, rows without gaps. One of another size or format is an
    /// error.
    ///
    /// # Safety
    /// The handle is what `source` says, of this device's primary context, and stays so until the engine has
    /// stepped.
    pub unsafe fn copy_texture(
        &self,
        name: &str,
        source: Texture,
        size_px: (u32, u32),
        format: HdrFormat,
        target: &CudaBuffer,
    ) -> Result<(), InteropError> {
        let row_bytes = size_px.0 as usize * format.texel_bytes();
        let rows = size_px.1 as usize;
        let (expected, actual) = ((row_bytes * rows) as u64, target.buffer.buffer().bytes());
        if expected > actual {
            return Err(InteropError::Size { name: name.to_owned(), expected, actual });
        }
        let _entered = self.context.enter()?;
        // SAFETY: as the caller guarantees.
        let array = unsafe { array_of(name, source, size_px, format) }?;
        // SAFETY: both have these rows, as was checked.
        unsafe { copy_array(&self.stream, array, row_bytes, rows, target.image.pointer()) }
    }

    /// Waits until what was copied so far is there: before the engine reads it.
    pub fn finish(&self) -> Result<(), InteropError> {
        let _entered = self.context.enter()?;
        self.stream.finish()
    }

    /// Waits for everything that the process has put on the device by CUDA: what read a buffer has read it.
    pub fn settle(&self) -> Result<(), InteropError> {
        let _entered = self.context.enter()?;
        // SAFETY: a context is current.
        check("cuCtxSynchronize", unsafe { sys::cuCtxSynchronize() })
    }

    /// Copies a part of a buffer to the host.
    pub fn read(&self, source: &CudaBuffer, offset: u64, bytes: &mut [u8]) -> Result<(), InteropError> {
        let actual = source.buffer.buffer().bytes();
        let expected = offset + bytes.len() as u64;
        if expected > actual {
            return Err(InteropError::Size { name: "read".to_owned(), expected, actual });
        }
        let _entered = self.context.enter()?;
        let from = source.image.pointer() + offset;
        // SAFETY: a context is current; both ranges are as long as is said.
        check("cuMemcpyDtoH", unsafe { sys::cuMemcpyDtoH_v2(bytes.as_mut_ptr().cast(), from, bytes.len()) })
    }
}

impl Drop for CudaLink {
    fn drop(&mut self) {
        // What the stream copies to must not be in use.
        let finished = self.context.enter().and_then(|_entered| self.stream.finish());
        if let Err(error) = finished {
            eprintln!("esaac: {error}");
        }
    }
}

impl CudaBuffer {
    /// The engine's side.
    #[must_use]
    pub fn buffer(&self) -> &Buffer {
        self.buffer.buffer()
    }

    /// CUDA's side, a `CUdeviceptr`.
    #[must_use]
    pub fn pointer(&self) -> u64 {
        self.image.pointer()
    }
}

impl Event {
    fn new(context: &Arc<Context>) -> Result<Self, InteropError> {
        let _entered = context.enter()?;
        let mut raw = std::ptr::null_mut();
        let flags = sys::CUevent_flags::CU_EVENT_DISABLE_TIMING as u32;
        // SAFETY: a context is current.
        check("cuEventCreate", unsafe { sys::cuEventCreate(&mut raw, flags) })?;
        Ok(Event { context: Arc::clone(context), raw })
    }
}

impl Drop for Event {
    fn drop(&mut self) {
        let destroyed = self.context.enter().and_then(|_entered| {
            // SAFETY: the event was made here; the driver keeps what pending work needs of it.
            check("cuEventDestroy", unsafe { sys::cuEventDestroy_v2(self.raw) })
        });
        if let Err(error) = destroyed {
            eprintln!("esaac: {error}");
        }
    }
}
