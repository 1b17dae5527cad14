//! CUDA's driver: whether it is there, its devices, their primary contexts.

#![expect(unsafe_code, reason = "CUDA's edge")]

use crate::error::InteropError;
use cudarc::driver::sys::{self, CUresult};
use esaac_engine::DeviceChoice;
use std::ffi::CStr;

/// A CUDA device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CudaDevice {
    /// CUDA's number of it.
    pub ordinal: i32,
    /// The same UUID that Vulkan gives.
    pub uuid: [u8; 16],
}

/// Names the call whose result it was.
pub(super) fn check(call: &'static str, result: CUresult) -> Result<(), InteropError> {
    if result == CUresult::CUDA_SUCCESS {
        return Ok(());
    }
    let mut name = std::ptr::null();
    // SAFETY: the driver is loaded, since it gave a result; the pointer is to a static string or stays null.
    let known =
        unsafe { sys::cuGetErrorName(result, &mut name) } == CUresult::CUDA_SUCCESS && !name.is_null();
    let result = if known {
        // SAFETY: the driver's names are static strings.
        unsafe { CStr::from_ptr(name) }.to_string_lossy().into_owned()
    } else {
        format!("{result:?}")
    };
    Err(InteropError::Cuda { call, result })
}

/// Loads the driver, if it is there.
fn load() -> Result<(), InteropError> {
    // SAFETY: opening the driver's library runs its initialisers, which are trusted.
    if !unsafe { sys::is_culib_present() } {
        return Err(InteropError::NoCuda);
    }
    // SAFETY: the library is there; this may be called any number of times.
    match unsafe { sys::cuInit(0) } {
        CUresult::CUDA_ERROR_NO_DEVICE => Err(InteropError::NoCudaDevice { wanted: String::new() }),
        result => check("cuInit", result),
    }
}

/// CUDA's devices, in its order.
pub fn cuda_devices() -> Result<Vec<CudaDevice>, InteropError> {
    load()?;
    let mut count = 0;
    // SAFETY: the driver is initialised; `count` outlives the call.
    check("cuDeviceGetCount", unsafe { sys::cuDeviceGetCount(&mut count) })?;
    (0..count)
        .map(|ordinal| {
            let (mut device, mut uuid) = (0, sys::CUuuid { bytes: [0; 16] });
            // SAFETY: as above; the ordinal is below the count.
            check("cuDeviceGet", unsafe { sys::cuDeviceGet(&mut device, ordinal) })?;
            // SAFETY: the device was just given.
            check("cuDeviceGetUuid_v2", unsafe { sys::cuDeviceGetUuid_v2(&mut uuid, device) })?;
            Ok(CudaDevice { ordinal, uuid: uuid.bytes.map(|byte| byte as u8) })
        })
        .collect()
}

/// A device that was wanted, and those that are there.
pub(super) fn missing(wanted: [u8; 16], devices: &[CudaDevice]) -> String {
    let name = |device: &CudaDevice| format!("{} {}", device.ordinal, DeviceChoice::Uuid(device.uuid));
    let present: Vec<String> = devices.iter().map(name).collect();
    format!("wanted {}, there are: {}", DeviceChoice::Uuid(wanted), present.join(", "))
}

/// A device's primary context.
pub(super) struct Context {
    device: sys::CUdevice,
    raw: sys::CUcontext,
}

// SAFETY: contexts may be made current on any thread; this one is only ever entered.
unsafe impl Send for Context {}
// SAFETY: as above.
unsafe impl Sync for Context {}

/// While this lives the context is the thread's.
pub(super) struct Entered<'a> {
    _context: &'a Context,
}

impl Context {
    pub(super) fn retain(ordinal: i32) -> Result<Self, InteropError> {
        let (mut device, mut raw) = (0, std::ptr::null_mut());
        // SAFETY: the driver is initialised (the ordinal is from `cuda_devices`).
        check("cuDeviceGet", unsafe { sys::cuDeviceGet(&mut device, ordinal) })?;
        // SAFETY: the device was just given.
        check("cuDevicePrimaryCtxRetain", unsafe { sys::cuDevicePrimaryCtxRetain(&mut raw, device) })?;
        Ok(Context { device, raw })
    }

    pub(super) fn device(&self) -> sys::CUdevice {
        self.device
    }

    pub(super) fn enter(&self) -> Result<Entered<'_>, InteropError> {
        // SAFETY: the context is retained.
        check("cuCtxPushCurrent", unsafe { sys::cuCtxPushCurrent_v2(self.raw) })?;
        Ok(Entered { _context: self })
    }
}

impl Drop for Entered<'_> {
    fn drop(&mut self) {
        let mut popped = std::ptr::null_mut();
        // SAFETY: it was pushed on this thread (this type does not leave it: it borrows for one call).
        if let Err(error) = check("cuCtxPopCurrent", unsafe { sys::cuCtxPopCurrent_v2(&mut popped) }) {
            eprintln!("esaac: {error}");
        }
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: it was retained once, and what was made in it is gone (its owners hold an Arc).
        let released = unsafe { sys::cuDevicePrimaryCtxRelease_v2(self.device) };
        if let Err(error) = check("cuDevicePrimaryCtxRelease", released) {
            eprintln!("esaac: {error}");
        }
    }
}
