//! Frames in CUDA's memory, for the suite that runs where CUDA is.

#![expect(unsafe_code, reason = "CUDA's edge")]

use cudarc::driver::sys::{self, CUresult};
use esaac_interop::cuda::Strided;

#[track_caller]
fn check(result: CUresult) {
    assert_eq!(result, CUresult::CUDA_SUCCESS);
}

/// Makes a device's primary context this thread's, for as long as the thread lives.
pub fn use_device(ordinal: i32) {
    let (mut device, mut context) = (0, std::ptr::null_mut());
    // SAFETY: `cuda_devices` has initialised the driver; the context is retained until the process ends.
    unsafe {
        check(sys::cuDeviceGet(&mut device, ordinal));
        check(sys::cuDevicePrimaryCtxRetain(&mut context, device));
        check(sys::cuCtxSetCurrent(context));
    }
}

/// An image on the device with room after each row.
pub struct CudaImage {
    pointer: u64,
    row_bytes: usize,
    rows: usize,
    stride_bytes: usize,
}

impl CudaImage {
    /// Uploads rows that are tightly packed.
    #[must_use]
    pub fn new(bytes: &[u8], rows: usize, padding_bytes: usize) -> Self {
        let row_bytes = bytes.len() / rows;
        let stride_bytes = row_bytes + padding_bytes;
        let mut padded = vec![0xa5_u8; stride_bytes * rows];
        for (to, from) in padded.chunks_exact_mut(stride_bytes).zip(bytes.chunks_exact(row_bytes)) {
            to[..row_bytes].copy_from_slice(from);
        }
        let mut pointer = 0;
        // SAFETY: a context is current; the copy is as long as both sides.
        unsafe {
            check(sys::cuMemAlloc_v2(&mut pointer, padded.len()));
            check(sys::cuMemcpyHtoD_v2(pointer, padded.as_ptr().cast(), padded.len()));
        }
        CudaImage { pointer, row_bytes, rows, stride_bytes }
    }

    /// For the producer.
    #[must_use]
    pub fn strided(&self) -> Strided {
        Strided { pointer: self.pointer, stride_bytes: self.stride_bytes }
    }

    /// Writes the image to `target` in the stream, as a renderer would that renders there.
    pub fn render_to(&self, target: u64, stream: u64) {
        let on_device = sys::CUmemorytype::CU_MEMORYTYPE_DEVICE;
        let copy = sys::CUDA_MEMCPY2D {
            srcXInBytes: 0,
            srcY: 0,
            srcMemoryType: on_device,
            srcHost: std::ptr::null(),
            srcDevice: self.pointer,
            srcArray: std::ptr::null_mut(),
            srcPitch: self.stride_bytes,
            dstXInBytes: 0,
            dstY: 0,
            dstMemoryType: on_device,
            dstHost: std::ptr::null_mut(),
            dstDevice: target,
            dstArray: std::ptr::null_mut(),
            dstPitch: self.row_bytes,
            WidthInBytes: self.row_bytes,
            Height: self.rows,
        };
        // SAFETY: both images have these rows; the source lives until the stream is done with it.
        check(unsafe { sys::cuMemcpy2DAsync_v2(&copy, stream as sys::CUstream) });
    }
}

impl Drop for CudaImage {
    fn drop(&mut self) {
        // SAFETY: the context is current still, and the stream's copies are done (cuMemFree waits).
        check(unsafe { sys::cuMemFree_v2(self.pointer) });
    }
}

/// Waits for a stream.
pub fn finish(stream: u64) {
    // SAFETY: the stream is a live producer's.
    check(unsafe { sys::cuStreamSynchronize(stream as sys::CUstream) });
}
