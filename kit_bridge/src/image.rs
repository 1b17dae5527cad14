//! Reads address, shape and type of the arrays that callers give. Nothing is copied.
//!
//! On the host: whatever NumPy takes without a copy (the buffer protocol, `__array_interface__`, `__array__`). On a
//! CUDA device: DLPack, whose producer lets our stream wait for its own, or `__cuda_array_interface__`.

#![expect(unsafe_code, reason = "DLPack's edge")]

use crate::array_interface;
use crate::dlpack::{self, Borrowed, DlDevice};
use crate::error::Fault;
use crate::texture::CudaTexture;
use crate::torch::Torch;
use crate::warp;
use esaac_interop::cuda::Texture;
use numpy::PyUntypedArray;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;

/// Type of an array's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// IEEE half.
    F16,
    /// IEEE single.
    F32,
    /// Bytes, sRGB encoded.
    U8,
}

impl Element {
    /// Bytes of one element.
    pub fn bytes(self) -> usize {
        match self {
            Element::F16 => 2,
            Element::F32 => 4,
            Element::U8 => 1,
        }
    }
}

/// The memory that an array is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// In memory that the processor reads.
    Host,
    /// On a CUDA device.
    Cuda {
        /// Wait for the work in this stream before reading; `None` if there is none to wait for.
        after: Option<u64>,
    },
}

/// An array.
pub struct Image {
    /// For messages: `hdr`, `motion`.
    pub name: &'static str,
    /// Address of the first element.
    pub pointer: usize,
    /// Memory that the address is in.
    pub place: Place,
    /// Type of its elements.
    pub element: Element,
    /// Elements along each axis.
    pub shape: Vec<usize>,
    /// Bytes from one element to the next along each axis.
    pub strides: Vec<isize>,
    /// A texture in CUDA's own layout. It has no address, so `pointer` means nothing then.
    pub texture: Option<Texture>,
    /// Keeps the memory alive.
    _owner: Owner,
}

enum Owner {
    Object(#[expect(dead_code, reason = "kept, not read")] Py<PyAny>),
    Dlpack(#[expect(dead_code, reason = "kept, not read")] Borrowed),
}

/// The engine's device and the streams that matter to a call.
pub struct Streams<'a> {
    /// CUDA's number of the engine's device.
    pub ordinal: i32,
    /// Its name.
    pub device: &'a str,
    /// Our stream, which must wait for the producers' work.
    pub ours: u64,
    /// The stream that the caller says the arrays are written in.
    pub callers: Option<u64>,
}

impl Streams<'_> {
    /// Fails for an array that DLPack says is on another GPU.
    fn check(&self, name: &str, device: DlDevice) -> Result<(), Fault> {
        if device.kind == dlpack::CUDA && device.id != self.ordinal {
            return Err(elsewhere(name, device.id, self.ordinal, self.device));
        }
        Ok(())
    }
}

impl Image {
    /// Reads an array. `streams` is called if it is on a CUDA device.
    pub fn of<'a>(
        array: &Bound<'_, PyAny>,
        name: &'static str,
        streams: &dyn Fn() -> PyResult<Streams<'a>>,
    ) -> PyResult<Self> {
        let py = array.py();
        if array.is_instance_of::<PyUntypedArray>() {
            return Self::on_host(array.clone(), name);
        }
        if let Ok(texture) = array.cast::<CudaTexture>() {
            return Self::of_texture(texture, name, streams()?);
        }
        if let Some(torch) = Torch::of(array)?
            && let Some(capsule) = torch.lend(array)?
        {
            return Self::in_capsule(&capsule, name, |device| match device.kind {
                dlpack::CUDA | dlpack::CUDA_MANAGED => {
                    let streams = streams()?;
                    streams.check(name, device)?;
                    let after = match streams.callers {
                        Some(stream) => stream,
                        None => torch.stream(py, device.id)?,
                    };
                    Ok(Place::Cuda { after: Some(after) })
                }
                dlpack::CPU | dlpack::CUDA_HOST => Ok(Place::Host),
                kind => Err(nowhere(name, kind).into()),
            });
        }
        if let Some(stream) = warp::stream_of(array)? {
            let interface = array.getattr(intern!(py, "__cuda_array_interface__"))?;
            return Self::by_cuda_array_interface(array, &interface, name, &streams()?, Some(stream));
        }
        if let Ok(device) = array.call_method0(intern!(py, "__dlpack_device__")) {
            let (kind, id): (i32, i32) = device.extract()?;
            return match kind {
                dlpack::CUDA | dlpack::CUDA_MANAGED => {
                    let streams = streams()?;
                    streams.check(name, DlDevice { kind, id })?;
                    Self::by_dlpack(array, name, &streams)
                }
                dlpack::CPU | dlpack::CUDA_HOST => Self::through_numpy(array, name),
                kind => Err(nowhere(name, kind).into()),
            };
        }
        if let Some(interface) = array.getattr_opt(intern!(py, "__cuda_array_interface__"))? {
            return Self::by_cuda_array_interface(array, &interface, name, &streams()?, None);
        }
        Self::through_numpy(array, name)
    }

    fn of_texture(texture: &Bound<'_, CudaTexture>, name: &'static str, streams: Streams) -> PyResult<Self> {
        if name != "hdr" {
            return Err(Fault::Frame(format!("{name} is a texture, expected an array")).into());
        }
        let CudaTexture { texture: of, shape, element, stream } = *texture.get();
        let after = streams.callers.or(stream).unwrap_or(LEGACY_DEFAULT_STREAM);
        Ok(Image {
            name,
            pointer: 0,
            place: Place::Cuda { after: Some(after) },
            element,
            shape: shape.to_vec(),
            strides: compact(&shape, element.bytes()),
            texture: Some(of),
            _owner: Owner::Object(texture.clone().into_any().unbind()),
        })
    }

    fn through_numpy(array: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Self> {
        let py = array.py();
        let seen = numpy(py)?.call_method1("asarray", (array,))?;
        Self::on_host(seen, name)
    }

    fn on_host(array: Bound<'_, PyAny>, name: &'static str) -> PyResult<Self> {
        let interface = array.getattr(intern!(array.py(), "__array_interface__"))?.cast_into::<PyDict>()?;
        let (pointer, element, shape, strides) = array_interface::parse(&interface, name)?;
        Ok(Image {
            name,
            pointer,
            place: Place::Host,
            element,
            shape,
            strides,
            texture: None,
            _owner: Owner::Object(array.unbind()),
        })
    }

    /// `written` is the stream that the array's library uses, if that is known.
    fn by_cuda_array_interface(
        array: &Bound<'_, PyAny>,
        interface: &Bound<'_, PyAny>,
        name: &'static str,
        streams: &Streams<'_>,
        written: Option<u64>,
    ) -> PyResult<Self> {
        let py = array.py();
        let interface = interface.cast::<PyDict>()?;
        let (pointer, element, shape, strides) = array_interface::parse(interface, name)?;
        let stated: Option<u64> = match interface.get_item(intern!(py, "stream"))? {
            Some(stream) if !stream.is_none() => Some(stream.extract()?),
            _ => None,
        };
        // Version 2 of the interface names no stream. In version 3 None says that there is none to wait for. The
        // legacy default stream waits for all others that were not made to be independent.
        let after = streams.callers.or(written).or(stated).unwrap_or(LEGACY_DEFAULT_STREAM);
        Ok(Image {
            name,
            pointer,
            place: Place::Cuda { after: Some(after) },
            element,
            shape,
            strides,
            texture: None,
            _owner: Owner::Object(array.clone().unbind()),
        })
    }

    fn by_dlpack(array: &Bound<'_, PyAny>, name: &'static str, streams: &Streams) -> PyResult<Self> {
        let py = array.py();
        let arguments = PyDict::new(py);
        // If the stream is known, the producer need not synchronise.
        match streams.callers {
            Some(_) => arguments.set_item(intern!(py, "stream"), -1)?,
            None => arguments.set_item(intern!(py, "stream"), streams.ours)?,
        }
        let capsule = array.call_method(intern!(py, "__dlpack__"), (), Some(&arguments))?;
        Self::in_capsule(&capsule, name, |_| Ok(Place::Cuda { after: streams.callers }))
    }

    fn in_capsule(
        capsule: &Bound<'_, PyAny>,
        name: &'static str,
        place: impl FnOnce(DlDevice) -> PyResult<Place>,
    ) -> PyResult<Self> {
        let borrowed = Borrowed::take(capsule)?;
        let tensor = borrowed.tensor();
        let place = place(tensor.device)?;
        let element = match (tensor.dtype.code, tensor.dtype.bits, tensor.dtype.lanes) {
            (dlpack::FLOAT, 16, 1) => Element::F16,
            (dlpack::FLOAT, 32, 1) => Element::F32,
            (dlpack::UINT, 8, 1) => Element::U8,
            (code, bits, lanes) => {
                let kind = match code {
                    dlpack::INT => "int",
                    dlpack::UINT => "uint",
                    dlpack::FLOAT => "float",
                    dlpack::BFLOAT => "bfloat",
                    _ => "type",
                };
                return Err(wrong_dtype(name, &format!("{kind}{bits} x{lanes}")).into());
            }
        };
        let axes = tensor.ndim as usize;
        // SAFETY: DLPack's arrays of `ndim` elements; strides may be null for a compact tensor.
        let (shape, strides) = unsafe {
            let shape: Vec<usize> =
                (0..axes).map(|axis| usize::try_from(*tensor.shape.add(axis)).unwrap_or(0)).collect();
            let strides = if tensor.strides.is_null() {
                compact(&shape, element.bytes())
            } else {
                let bytes = element.bytes() as isize;
                (0..axes).map(|axis| *tensor.strides.add(axis) as isize * bytes).collect()
            };
            (shape, strides)
        };
        Ok(Image {
            name,
            pointer: tensor.data as usize + tensor.byte_offset as usize,
            place,
            element,
            shape,
            strides,
            texture: None,
            _owner: Owner::Dlpack(borrowed),
        })
    }
}

/// The error for an array on another GPU than the engine's.
pub fn elsewhere(name: &str, actual: i32, expected: i32, device: &str) -> Fault {
    Fault::Frame(format!(
        "{name} lies on cuda:{actual}, expected cuda:{expected}, the engine's device {device}; make the camera \
         with device=\"cuda:{actual}\""
    ))
}

/// The error for memory that neither the host nor CUDA reads.
fn nowhere(name: &str, kind: i32) -> Fault {
    Fault::Frame(format!("{name} lies on a device of DLPack type {kind}, expected the host or a CUDA device"))
}

/// CUDA's handle of the legacy default stream where 0 would mean "no stream".
pub const LEGACY_DEFAULT_STREAM: u64 = 1;

/// The module `numpy`.
pub fn numpy(py: Python<'_>) -> PyResult<&Bound<'_, PyModule>> {
    static NUMPY: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    Ok(NUMPY.get_or_try_init(py, || py.import("numpy").map(Bound::unbind))?.bind(py))
}

/// The error for a type of elements that is not supported.
pub fn wrong_dtype(name: &str, actual: &str) -> Fault {
    let expected = if name == "motion" { "float16 or float32" } else { "float16, float32 or uint8 (sRGB)" };
    Fault::Frame(format!("{name} has dtype {actual}, expected {expected}"))
}

/// Strides of a row-major array without gaps.
pub fn compact(shape: &[usize], element_bytes: usize) -> Vec<isize> {
    let mut strides = vec![0; shape.len()];
    let mut next = element_bytes as isize;
    for (stride, &length) in strides.iter_mut().zip(shape).rev() {
        *stride = next;
        next *= length as isize;
    }
    strides
}
