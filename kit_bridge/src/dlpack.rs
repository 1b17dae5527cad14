//! The structures of DLPack's header, and the Python capsules that hold them.

#![expect(unsafe_code, reason = "DLPack's edge")]

use crate::error::Fault;
use pyo3::ffi;
use pyo3::prelude::*;
use std::ffi::{CStr, c_void};

/// Device types.
pub const CPU: i32 = 1;
/// See [`CPU`].
pub const CUDA: i32 = 2;
/// See [`CPU`].
pub const CUDA_HOST: i32 = 3;
/// See [`CPU`].
pub const CUDA_MANAGED: i32 = 13;

/// Type codes.
pub const INT: u8 = 0;
/// See [`INT`].
pub const UINT: u8 = 1;
/// See [`INT`].
pub const FLOAT: u8 = 2;
/// See [`INT`].
pub const BFLOAT: u8 = 4;

/// `DLDevice`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DlDevice {
    /// One of the device types.
    pub kind: i32,
    /// Its number.
    pub id: i32,
}

/// `DLDataType`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DlType {
    /// One of the type codes.
    pub code: u8,
    /// Bits of a lane.
    pub bits: u8,
    /// Lanes.
    pub lanes: u16,
}

/// `DLTensor`.
#[repr(C)]
pub struct DlTensor {
    /// Memory.
    pub data: *mut c_void,
    /// Device of that memory.
    pub device: DlDevice,
    /// Axes.
    pub ndim: i32,
    /// Type of an element.
    pub dtype: DlType,
    /// Elements along each axis.
    pub shape: *mut i64,
    /// Elements from one to the next along each axis, or null.
    pub strides: *mut i64,
    /// From `data` to the first element.
    pub byte_offset: u64,
}

/// `DLManagedTensor`.
#[repr(C)]
pub struct DlManaged {
    /// The tensor.
    pub tensor: DlTensor,
    /// Private to the tensor's producer.
    pub context: *mut c_void,
    /// The consumer calls this once.
    pub deleter: Option<unsafe extern "C" fn(*mut DlManaged)>,
}

const NAME: &CStr = c"dltensor";
const USED: &CStr = c"used_dltensor";

/// A tensor borrowed from its producer.
pub struct Borrowed(*mut DlManaged);

// SAFETY: the tensor may be given back on any thread that holds the interpreter's lock, and `drop` takes it.
unsafe impl Send for Borrowed {}
// SAFETY: it is only read while it is shared.
unsafe impl Sync for Borrowed {}

impl Borrowed {
    /// Takes a tensor out of its capsule.
    pub fn take(capsule: &Bound<'_, PyAny>) -> PyResult<Self> {
        // SAFETY: the check takes any object, and a capsule of this name holds a DLManagedTensor.
        unsafe {
            if ffi::PyCapsule_IsValid(capsule.as_ptr(), NAME.as_ptr()) == 0 {
                let message = "__dlpack__ gave no capsule named `dltensor`".to_owned();
                return Err(Fault::Frame(message).into());
            }
            let managed = ffi::PyCapsule_GetPointer(capsule.as_ptr(), NAME.as_ptr()).cast::<DlManaged>();
            // From here on we must call the deleter.
            if ffi::PyCapsule_SetName(capsule.as_ptr(), USED.as_ptr()) != 0 {
                return Err(PyErr::fetch(capsule.py()));
            }
            Ok(Borrowed(managed))
        }
    }

    /// The tensor.
    pub fn tensor(&self) -> &DlTensor {
        // SAFETY: it lives until its deleter is called.
        unsafe { &(*self.0).tensor }
    }
}

impl Drop for Borrowed {
    fn drop(&mut self) {
        Python::attach(|_| {
            // SAFETY: the tensor was taken, so we call its deleter, once.
            unsafe {
                if let Some(deleter) = (*self.0).deleter {
                    deleter(self.0);
                }
            }
        });
    }
}

/// Memory that a lent tensor points at.
struct Lent<T> {
    shape: Vec<i64>,
    strides: Vec<i64>,
    #[expect(dead_code, reason = "kept, not read")]
    owner: T,
}

/// Lends memory that `owner` keeps.
pub fn lend<T: Send + 'static>(
    py: Python<'_>,
    (data, device, dtype): (u64, DlDevice, DlType),
    shape: &[usize],
    owner: T,
) -> PyResult<Py<PyAny>> {
    let shape: Vec<i64> = shape.iter().map(|&n| n as i64).collect();
    let mut strides = vec![1; shape.len()];
    for axis in (1..shape.len()).rev() {
        strides[axis - 1] = strides[axis] * shape[axis];
    }
    let lent = Box::into_raw(Box::new(Lent { shape, strides, owner }));
    // SAFETY: `lent` was made above and lives until `give_back`.
    let tensor = unsafe {
        DlTensor {
            data: data as *mut c_void,
            device,
            ndim: (*lent).shape.len() as i32,
            dtype,
            shape: (*lent).shape.as_mut_ptr(),
            strides: (*lent).strides.as_mut_ptr(),
            byte_offset: 0,
        }
    };
    let managed =
        Box::into_raw(Box::new(DlManaged { tensor, context: lent.cast(), deleter: Some(give_back::<T>) }));
    // SAFETY: the pointer is not null, and valid until the capsule or its consumer gives it back.
    unsafe {
        let capsule = ffi::PyCapsule_New(managed.cast(), NAME.as_ptr(), Some(drop_capsule));
        if capsule.is_null() {
            give_back::<T>(managed);
            return Err(PyErr::fetch(py));
        }
        Ok(Bound::from_owned_ptr(py, capsule).unbind())
    }
}

/// # Safety
/// Called once with what [`lend`] made.
unsafe extern "C" fn give_back<T>(managed: *mut DlManaged) {
    // SAFETY: both boxes were leaked by `lend`, for the same `T`.
    unsafe {
        let managed = Box::from_raw(managed);
        drop(Box::from_raw(managed.context.cast::<Lent<T>>()));
    }
}

/// # Safety
/// Called by Python with a capsule of [`lend`]'s.
unsafe extern "C" fn drop_capsule(capsule: *mut ffi::PyObject) {
    // SAFETY: a capsule with its first name was not taken, so we give its tensor back.
    unsafe {
        if ffi::PyCapsule_IsValid(capsule, NAME.as_ptr()) != 0 {
            let managed = ffi::PyCapsule_GetPointer(capsule, NAME.as_ptr()).cast::<DlManaged>();
            if let Some(deleter) = (*managed).deleter {
                deleter(managed);
            }
        }
    }
}
