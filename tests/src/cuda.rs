//! Frames in CUDA memory, for the suite that needs CUDA.

#![expect(unsafe_code, reason = "CUDA's edge")]

use cudarc::driver::sys::{self, CUresult};
use esaac_interop::cuda::Strided;
use rustix::fd::{IntoRawFd, OwnedFd};
use std::ffi::CStr;
use std::time::Duration;

#[track_caller]
fn check(result: CUresult) {
    assert_eq!(result, CUresult::CUDA_SUCCESS);
}

/// Makes a device's primary context current on this thread, for as long as the thread lives.
pub fn use_device(ordinal: i32) {
    let (mut device, mut context) = (0, std::ptr::null_mut());
    // SAFETY: `cuda_devices` has initialised the driver; the context is retained until the process ends.
    unsafe {
        check(sys::cuDeviceGet(&mut device, ordinal));
        check(sys::cuDevicePrimaryCtxRetain(&mut context, device));
        check(sys::cuCtxSetCurrent(context));
    }
}

/// An image in CUDA memory, with padding after each row.
pub struct CudaImage {
    pointer: u64,
    row_bytes: usize,
    rows: usize,
    stride_bytes: usize,
}

impl CudaImage {
    /// Uploads tightly packed rows.
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

    /// The image as the producer takes it.
    #[must_use]
    pub fn strided(&self) -> Strided {
        Strided { pointer: self.pointer, stride_bytes: self.stride_bytes }
    }

    /// Copies the image to `target` in the stream, in place of a renderer that writes there.
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

/// A timeline of the engine that a CUDA stream signals.
pub struct CudaSignal {
    raw: sys::CUexternalSemaphore,
    stream: sys::CUstream,
}

impl CudaSignal {
    /// Imports a timeline that the engine exported.
    #[must_use]
    pub fn import(fd: OwnedFd) -> Self {
        let description = sys::CUDA_EXTERNAL_SEMAPHORE_HANDLE_DESC {
            type_:
                sys::CUexternalSemaphoreHandleType::CU_EXTERNAL_SEMAPHORE_HANDLE_TYPE_TIMELINE_SEMAPHORE_FD,
            // If the import succeeds, the driver owns the descriptor. If it fails, the test fails.
            handle: sys::CUDA_EXTERNAL_SEMAPHORE_HANDLE_DESC_st__bindgen_ty_1 { fd: fd.into_raw_fd() },
            flags: 0,
            reserved: [0; 16],
        };
        let (mut raw, mut stream) = (std::ptr::null_mut(), std::ptr::null_mut());
        let flags = sys::CUstream_flags::CU_STREAM_NON_BLOCKING as u32;
        // SAFETY: a context is current; the description names an open descriptor and outlives the call.
        unsafe {
            check(sys::cuImportExternalSemaphore(&mut raw, &description));
            check(sys::cuStreamCreate(&mut stream, flags));
        }
        CudaSignal { raw, stream }
    }

    /// Enqueues a signal of `value` in the stream.
    pub fn signal(&self, value: u64) {
        // SAFETY: all zero is a valid value of this plain struct.
        let mut parameters: sys::CUDA_EXTERNAL_SEMAPHORE_SIGNAL_PARAMS = unsafe { std::mem::zeroed() };
        parameters.params.fence.value = value;
        // SAFETY: stream and semaphore are alive; one parameter for one semaphore.
        check(unsafe { sys::cuSignalExternalSemaphoresAsync(&self.raw, &parameters, 1, self.stream) });
    }

    /// Enqueues writing an image, and then a signal of `value` if there is one.
    pub fn write(&self, image: &CudaImage, value: Option<u64>) {
        let words = image.stride_bytes * image.rows / 4;
        // SAFETY: the stream is alive, the image as long as said, and it lives until the stream is done.
        check(unsafe { sys::cuMemsetD32Async(image.pointer, 7, words, self.stream) });
        value.inspect(|value| self.signal(*value));
    }

    /// Waits for the stream.
    pub fn finish(&self) {
        finish(self.stream as u64);
    }
}

impl Drop for CudaSignal {
    fn drop(&mut self) {
        // SAFETY: the stream is waited for before both go.
        unsafe {
            check(sys::cuStreamSynchronize(self.stream));
            check(sys::cuStreamDestroy_v2(self.stream));
            check(sys::cuDestroyExternalSemaphore(self.raw));
        }
    }
}

/// A kernel of one thread that waits until a time has passed.
const SPIN: &CStr = c"
.version 6.0
.target sm_60
.address_size 64
.visible .entry spin(.param .u64 wanted_ns)
{
    .reg .pred %waits;
    .reg .u64 %begin, %now, %passed, %wanted;
    ld.param.u64 %wanted, [wanted_ns];
    mov.u64 %begin, %globaltimer;
again:
    mov.u64 %now, %globaltimer;
    sub.u64 %passed, %now, %begin;
    setp.lt.u64 %waits, %passed, %wanted;
    @%waits bra again;
    ret;
}
";

/// Work of CUDA that takes a given time and hardly anything else of the device.
pub struct CudaSpin {
    module: sys::CUmodule,
    kernel: sys::CUfunction,
    stream: sys::CUstream,
}

impl CudaSpin {
    /// Compiles it for the device whose context is current.
    #[must_use]
    pub fn new() -> Self {
        let (mut module, mut kernel, mut stream) =
            (std::ptr::null_mut(), std::ptr::null_mut(), std::ptr::null_mut());
        let flags = sys::CUstream_flags::CU_STREAM_NON_BLOCKING as u32;
        // SAFETY: a context is current; both texts end in 0, and the module has the kernel.
        unsafe {
            check(sys::cuModuleLoadData(&mut module, SPIN.as_ptr().cast()));
            check(sys::cuModuleGetFunction(&mut kernel, module, c"spin".as_ptr()));
            check(sys::cuStreamCreate(&mut stream, flags));
        }
        CudaSpin { module, kernel, stream }
    }

    /// Enqueues it.
    pub fn start(&self, time: Duration) {
        let mut wanted_ns = time.as_nanos() as u64;
        let mut parameters = [std::ptr::from_mut(&mut wanted_ns).cast()];
        let (one, none) = (1, std::ptr::null_mut());
        // SAFETY: the kernel is alive and has this one parameter, which is read before the call returns.
        check(unsafe {
            sys::cuLaunchKernel(
                self.kernel,
                one,
                one,
                one,
                one,
                one,
                one,
                0,
                self.stream,
                parameters.as_mut_ptr(),
                none,
            )
        });
    }

    /// Waits for it.
    pub fn finish(&self) {
        finish(self.stream as u64);
    }
}

impl Default for CudaSpin {
    fn default() -> Self {
        Self::new()
    }
}

impl Drop for CudaSpin {
    fn drop(&mut self) {
        // SAFETY: the stream is waited for before both go.
        unsafe {
            check(sys::cuStreamSynchronize(self.stream));
            check(sys::cuStreamDestroy_v2(self.stream));
            check(sys::cuModuleUnload(self.module));
        }
    }
}
