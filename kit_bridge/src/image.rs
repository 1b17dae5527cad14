//! Reads address, shape and type of the arrays that callers give. Nothing is copied.
//!
//! On the host: whatever NumPy takes without a copy (the buffer protocol, `__array_interface__`, `__array__`), or
//! DLPack. On a CUDA device: DLPack, whose producer lets our stream wait for its own, or `__cuda_array_interface__`.

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
use pyo3::types::{PyDict, PyMemoryView};

/// Type of an array's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// IEEE half.
    F16,
    /// IEEE single.
    F32,
    /// Bytes, sRGB encoded.
    U8,
    /// Ids of 16 bits, signed or not.
    U16,
    /// Ids of 32 bits, signed or not.
    U32,
}

impl Element {
    /// Bytes of one element.
    pub fn bytes(self) -> usize {
        match self {
            Element::F16 | Element::U16 => 2,
            Element::F32 | Element::U32 => 4,
            Element::U8 => 1,
        }
    }
}

/// What an array of a frame holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plane {
    /// Colour.
    Hdr,
    /// Motion vectors.
    Motion,
    /// Depth.
    Depth,
    /// Instance ids.
    Ids,
}

impl Plane {
    /// Its name in Python.
    pub fn name(self) -> &'static str {
        match self {
            Plane::Hdr => "hdr",
            Plane::Motion => "motion",
            Plane::Depth => "depth",
            Plane::Ids => "ids",
        }
    }

    /// Numbers of channels that it may have.
    pub fn channels(self) -> &'static [usize] {
        match self {
            Plane::Hdr => &[1, 3, 4],
            Plane::Motion => &[2, 3, 4],
            Plane::Depth | Plane::Ids => &[1],
        }
    }

    /// The element, if such arrays may have it.
    pub fn allow(self, element: Option<Element>, actual: &str) -> Result<Element, Fault> {
        let (allowed, expected): (&[Element], _) = match self {
            Plane::Hdr => (&[Element::F16, Element::F32, Element::U8], "float16, float32 or uint8 (sRGB)"),
            Plane::Motion => (&[Element::F16, Element::F32], "float16 or float32"),
            Plane::Depth => (&[Element::F32], "float32"),
            Plane::Ids => (&[Element::U16, Element::U32], "uint16, uint32, int16 or int32"),
        };
        element
            .filter(|element| allowed.contains(element))
            .ok_or_else(|| Fault::Frame(format!("{} has dtype {actual}, expected {expected}", self.name())))
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
    /// What it holds.
    pub plane: Plane,
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
    fn check(&self, plane: Plane, device: DlDevice) -> Result<(), Fault> {
        if device.kind == dlpack::CUDA && device.id != self.ordinal {
            return Err(elsewhere(plane, device.id, self.ordinal, self.device));
        }
        Ok(())
    }
}

impl Image {
    /// Reads an array. `streams` is called if it is on a CUDA device.
    pub fn of<'a>(
        array: &Bound<'_, PyAny>,
        plane: Plane,
        streams: &dyn Fn() -> PyResult<Streams<'a>>,
    ) -> PyResult<Self> {
        let py = array.py();
        if array.is_instance_of::<PyUntypedArray>() {
            return Self::on_host(array.clone(), plane);
        }
        if let Ok(texture) = array.cast::<CudaTexture>() {
            return Self::of_texture(texture, plane, streams()?);
        }
        if let Some(torch) = Torch::of(array)?
            && let Some(capsule) = torch.lend(array)?
        {
            return Self::in_capsule(&capsule, plane, |device| match device.kind {
                dlpack::CUDA | dlpack::CUDA_MANAGED => {
                    let streams = streams()?;
                    streams.check(plane, device)?;
                    let after = match streams.callers {
                        Some(stream) => stream,
                        None => torch.stream(py, device.id)?,
                    };
                    Ok(Place::Cuda { after: Some(after) })
                }
                dlpack::CPU | dlpack::CUDA_HOST => Ok(Place::Host),
                kind => Err(nowhere(plane, kind).into()),
            });
        }
        if let Some(stream) = warp::stream_of(array)? {
            let interface = array.getattr(intern!(py, "__cuda_array_interface__"))?;
            return Self::by_cuda_array_interface(array, &interface, plane, &streams()?, Some(stream));
        }
        if let Ok(device) = array.call_method0(intern!(py, "__dlpack_device__")) {
            let (kind, id): (i32, i32) = device.extract()?;
            return match kind {
                dlpack::CUDA | dlpack::CUDA_MANAGED => {
                    let streams = streams()?;
                    streams.check(plane, DlDevice { kind, id })?;
                    Self::by_dlpack(array, plane, &streams)
                }
                dlpack::CPU | dlpack::CUDA_HOST if is_numpys(array)? => Self::through_numpy(array, plane),
                dlpack::CPU | dlpack::CUDA_HOST => {
                    let capsule = array.call_method0(intern!(py, "__dlpack__"))?;
                    Self::in_capsule(&capsule, plane, |_| Ok(Place::Host))
                }
                kind => Err(nowhere(plane, kind).into()),
            };
        }
        if let Some(interface) = array.getattr_opt(intern!(py, "__cuda_array_interface__"))? {
            return Self::by_cuda_array_interface(array, &interface, plane, &streams()?, None);
        }
        Self::through_numpy(array, plane)
    }

    fn of_texture(texture: &Bound<'_, CudaTexture>, plane: Plane, streams: Streams) -> PyResult<Self> {
        if plane != Plane::Hdr {
            return Err(Fault::Frame(format!("{} is a texture, expected an array", plane.name())).into());
        }
        let CudaTexture { texture: of, shape, element, stream } = *texture.get();
        let after = streams.callers.or(stream).unwrap_or(LEGACY_DEFAULT_STREAM);
        Ok(Image {
            plane,
            pointer: 0,
            place: Place::Cuda { after: Some(after) },
            element,
            shape: shape.to_vec(),
            strides: compact(&shape, element.bytes()),
            texture: Some(of),
            _owner: Owner::Object(texture.clone().into_any().unbind()),
        })
    }

    fn through_numpy(array: &Bound<'_, PyAny>, plane: Plane) -> PyResult<Self> {
        let py = array.py();
        let seen = numpy(py)?.call_method1("asarray", (array,))?;
        Self::on_host(seen, plane)
    }

    fn on_host(array: Bound<'_, PyAny>, plane: Plane) -> PyResult<Self> {
        let interface = array.getattr(intern!(array.py(), "__array_interface__"))?.cast_into::<PyDict>()?;
        let (pointer, element, shape, strides) = array_interface::parse(&interface, plane)?;
        Ok(Image {
            plane,
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
        plane: Plane,
        streams: &Streams<'_>,
        written: Option<u64>,
    ) -> PyResult<Self> {
        let py = array.py();
        let interface = interface.cast::<PyDict>()?;
        let (pointer, element, shape, strides) = array_interface::parse(interface, plane)?;
        let stated: Option<u64> = match interface.get_item(intern!(py, "stream"))? {
            Some(stream) if !stream.is_none() => Some(stream.extract()?),
            _ => None,
        };
        // Version 2 of the interface names no stream. In version 3 None says that there is none to wait for. The
        // legacy default stream waits for all others that were not made to be independent.
        let after = streams.callers.or(written).or(stated).unwrap_or(LEGACY_DEFAULT_STREAM);
        Ok(Image {
            plane,
            pointer,
            place: Place::Cuda { after: Some(after) },
            element,
            shape,
            strides,
            texture: None,
            _owner: Owner::Object(array.clone().unbind()),
        })
    }

    fn by_dlpack(array: &Bound<'_, PyAny>, plane: Plane, streams: &Streams) -> PyResult<Self> {
        let py = array.py();
        let arguments = PyDict::new(py);
        // If the stream is known, the producer need not synchronise.
        match streams.callers {
            Some(_) => arguments.set_item(intern!(py, "stream"), -1)?,
            None => arguments.set_item(intern!(py, "stream"), streams.ours)?,
        }
        let capsule = array.call_method(intern!(py, "__dlpack__"), (), Some(&arguments))?;
        Self::in_capsule(&capsule, plane, |_| Ok(Place::Cuda { after: streams.callers }))
    }

    fn in_capsule(
        capsule: &Bound<'_, PyAny>,
        plane: Plane,
        place: impl FnOnce(DlDevice) -> PyResult<Place>,
    ) -> PyResult<Self> {
        let borrowed = Borrowed::take(capsule)?;
        let tensor = borrowed.tensor();
        let place = place(tensor.device)?;
        let (code, bits, lanes) = (tensor.dtype.code, tensor.dtype.bits, tensor.dtype.lanes);
        let element = match (code, bits, lanes) {
            (dlpack::FLOAT, 16, 1) => Some(Element::F16),
            (dlpack::FLOAT, 32, 1) => Some(Element::F32),
            (dlpack::UINT, 8, 1) => Some(Element::U8),
            (dlpack::UINT | dlpack::INT, 16, 1) => Some(Element::U16),
            (dlpack::UINT | dlpack::INT, 32, 1) => Some(Element::U32),
            _ => None,
        };
        let kind = match code {
            dlpack::INT => "int",
            dlpack::UINT => "uint",
            dlpack::FLOAT => "float",
            dlpack::BFLOAT => "bfloat",
            _ => "type",
        };
        let element = plane.allow(element, &format!("{kind}{bits} x{lanes}"))?;
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
            plane,
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

/// Whether NumPy takes an array in another way than by DLPack.
fn is_numpys(array: &Bound<'_, PyAny>) -> PyResult<bool> {
    let py = array.py();
    Ok(array.hasattr(intern!(py, "__array__"))?
        || array.hasattr(intern!(py, "__array_interface__"))?
        || PyMemoryView::from(array).is_ok())
}

/// The error for an array on another GPU than the engine's.
pub fn elsewhere(plane: Plane, actual: i32, expected: i32, device: &str) -> Fault {
    let name = plane.name();
    Fault::Frame(format!(
        "{name} lies on cuda:{actual}, expected cuda:{expected}, the engine's device {device}; make the camera \
         with device=\"cuda:{actual}\""
    ))
}

/// The error for memory that neither the host nor CUDA reads.
fn nowhere(plane: Plane, kind: i32) -> Fault {
    let name = plane.name();
    Fault::Frame(format!("{name} lies on a device of DLPack type {kind}, expected the host or a CUDA device"))
}

/// CUDA's handle of the legacy default stream where 0 would mean "no stream".
pub const LEGACY_DEFAULT_STREAM: u64 = 1;

/// The module `numpy`.
pub fn numpy(py: Python<'_>) -> PyResult<&Bound<'_, PyModule>> {
    static NUMPY: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    Ok(NUMPY.get_or_try_init(py, || py.import("numpy").map(Bound::unbind))?.bind(py))
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
