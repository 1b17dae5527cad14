//! Arrays on a CUDA device, which other libraries view by DLPack or CUDA's array interface.

use crate::axes::{self, NoPart};
use crate::cuda::Block;
use crate::dlpack::{self, DlDevice, DlType};
use crate::error::Fault;
use crate::image::numpy;
use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyIterator, PyList, PySlice, PyTuple};
use std::sync::Arc;

/// Type of a tensor's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    dlpack: DlType,
    typestr: &'static str,
    bytes: usize,
}

macro_rules! kinds {
    ($($name:ident = $code:expr, $bits:literal, $typestr:literal;)*) => {
        $(pub const $name: Kind = Kind {
            dlpack: DlType { code: $code, bits: $bits, lanes: 1 },
            typestr: $typestr,
            bytes: $bits / 8,
        };)*
    };
}

impl Kind {
    kinds! {
        I64 = dlpack::INT, 64, "<i8";
        I32 = dlpack::INT, 32, "<i4";
        I16 = dlpack::INT, 16, "<i2";
        U8 = dlpack::UINT, 8, "|u1";
        F32 = dlpack::FLOAT, 32, "<f4";
    }
}

/// An array on a CUDA device: see `esaac/__init__.pyi`.
#[pyclass(module = "esaac", frozen)]
pub struct Tensor {
    block: Arc<Block>,
    offset: u64,
    kind: Kind,
    shape: Vec<usize>,
}

impl Tensor {
    /// `shape` elements from byte `offset` on.
    pub fn new(block: &Arc<Block>, offset: u64, kind: Kind, shape: Vec<usize>) -> Self {
        Tensor { block: Arc::clone(block), offset, kind, shape }
    }

    fn pointer(&self) -> u64 {
        self.block.pointer() + self.offset
    }

    fn elements(&self) -> usize {
        axes::elements(&self.shape)
    }

    fn part(&self, (start, shape): axes::Part) -> Tensor {
        let offset = self.offset + (start * self.kind.bytes) as u64;
        Tensor::new(&self.block, offset, self.kind, shape)
    }

    fn refused(&self, refusal: NoPart) -> PyErr {
        match refusal {
            NoPart::Element => PyTypeError::new_err(format!(
                "{} is on a CUDA device: copy it to the host with .numpy(), or view it there with torch.from_dlpack, \
                 cupy.from_dlpack or jax.dlpack.from_dlpack",
                self.name()
            )),
            NoPart::Outside { index, length } => {
                PyIndexError::new_err(format!("index {index} into {}, expected below {length}", self.name()))
            }
            NoPart::Step(step) => {
                PyIndexError::new_err(format!("step {step}, expected 1: a slice of a tensor is contiguous"))
            }
        }
    }

    fn name(&self) -> String {
        format!("an esaac.Tensor of shape {:?}", self.shape)
    }
}

#[pymethods]
impl Tensor {
    #[getter]
    fn shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.shape)
    }

    #[getter]
    fn dtype<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        numpy(py)?.call_method1("dtype", (self.kind.typestr,))
    }

    #[getter]
    fn nbytes(&self) -> usize {
        self.elements() * self.kind.bytes
    }

    #[getter]
    fn device(&self) -> PyResult<String> {
        Ok(format!("cuda:{}", self.block.memory()?.1.ordinal))
    }

    /// The data are written before the call returns that gave the tensor, so no stream has to wait.
    #[pyo3(signature = (*, stream=None, max_version=None, dl_device=None, copy=None))]
    fn __dlpack__(
        &self,
        py: Python<'_>,
        stream: Option<&Bound<'_, PyAny>>,
        max_version: Option<&Bound<'_, PyAny>>,
        dl_device: Option<(i32, i32)>,
        copy: Option<bool>,
    ) -> PyResult<Py<PyAny>> {
        let _ = (stream, max_version);
        let here = self.__dlpack_device__()?;
        if dl_device.is_some_and(|wanted| wanted != here) || copy == Some(true) {
            let message =
                format!("the tensor is on DLPack device {here:?} and is lent there, without a copy");
            return Err(pyo3::exceptions::PyBufferError::new_err(message));
        }
        let device = DlDevice { kind: here.0, id: here.1 };
        let lent = (self.pointer(), device, self.kind.dlpack);
        dlpack::lend(py, lent, &self.shape, Arc::clone(&self.block))
    }

    fn __dlpack_device__(&self) -> PyResult<(i32, i32)> {
        Ok((dlpack::CUDA, self.block.memory()?.1.ordinal))
    }

    #[getter]
    fn __cuda_array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        // Fails in a forked process.
        self.block.memory()?;
        let interface = PyDict::new(py);
        interface.set_item("version", 3)?;
        interface.set_item("typestr", self.kind.typestr)?;
        interface.set_item("shape", self.shape(py)?)?;
        interface.set_item("strides", py.None())?;
        // An empty array has no address.
        let pointer = if self.elements() == 0 { 0 } else { self.pointer() };
        interface.set_item("data", (pointer, false))?;
        interface.set_item("stream", py.None())?;
        Ok(interface)
    }

    fn numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let array = numpy(py)?.call_method1("empty", (self.shape(py)?, self.kind.typestr))?;
        let mut bytes = vec![0; self.nbytes()];
        if !bytes.is_empty() {
            py.detach(|| {
                let (memory, side) = self.block.memory()?;
                side.link().read(memory, self.offset, &mut bytes).map_err(Fault::from)
            })?;
        }
        let read =
            numpy(py)?.call_method1("frombuffer", (pyo3::types::PyBytes::new(py, &bytes), self.kind.typestr));
        if !bytes.is_empty() {
            array.call_method1(
                "__setitem__",
                (pyo3::types::PyEllipsis::get(py), read?.call_method1("reshape", (self.shape(py)?,))?),
            )?;
        }
        Ok(array)
    }

    fn __len__(&self) -> usize {
        self.shape.first().copied().unwrap_or(0)
    }

    fn __getitem__(&self, key: &Bound<'_, PyAny>) -> PyResult<Tensor> {
        let part = match key.cast::<PySlice>() {
            Ok(slice) => {
                let indices = slice.indices(self.__len__() as isize)?;
                axes::slice(&self.shape, indices.start, indices.stop, indices.step)
            }
            Err(_) => axes::at(&self.shape, key.extract()?),
        };
        part.map(|part| self.part(part)).map_err(|refusal| self.refused(refusal))
    }

    /// Without this, Python would ask for elements by index, and take the first IndexError for the end.
    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        if self.shape.len() < 2 {
            return Err(self.refused(NoPart::Element));
        }
        let parts = (0..self.__len__() as isize)
            .map(|index| axes::at(&self.shape, index).map(|part| self.part(part)))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|refusal| self.refused(refusal))?;
        PyList::new(py, parts)?.try_iter()
    }

    /// `value in tensor`. Without this, Python would iterate and put its own message over that of `__iter__`.
    fn __contains__(&self, value: &Bound<'_, PyAny>) -> PyResult<bool> {
        let _ = value;
        Err(self.refused(NoPart::Element))
    }

    /// NumPy calls this. Copying from the device must be asked for, so this is an error.
    #[pyo3(signature = (dtype=None, copy=None))]
    fn __array__(&self, dtype: Option<&Bound<'_, PyAny>>, copy: Option<bool>) -> PyResult<Py<PyAny>> {
        let _ = (dtype, copy);
        Err(self.refused(NoPart::Element))
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!("<esaac.Tensor {} {:?} on {}>", self.kind.typestr, self.shape, self.device()?))
    }
}
