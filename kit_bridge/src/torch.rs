//! A faster way for torch's tensors: it calls torch's functions in C. Torch's DLPack protocol is Python code that
//! takes microseconds for each tensor.

use crate::image;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// Functions of torch, loaded with the first tensor.
pub struct Torch {
    tensor: Py<PyType>,
    to_dlpack: Py<PyAny>,
    current_stream: Py<PyAny>,
    /// Whether `current_stream` gives the handle itself, not an object.
    raw: bool,
}

impl Torch {
    /// Torch, if the array is its tensor. Subclasses may lend themselves in another way, so they do not count.
    pub fn of(array: &Bound<'_, PyAny>) -> PyResult<Option<&'static Self>> {
        static TORCH: PyOnceLock<Torch> = PyOnceLock::new();
        let (py, kind) = (array.py(), array.get_type());
        let named = || kind.name().is_ok_and(|n| n == "Tensor") && kind.module().is_ok_and(|m| m == "torch");
        if TORCH.get(py).is_none() && !named() {
            return Ok(None);
        }
        let torch = TORCH.get_or_try_init(py, || Self::load(kind.clone()))?;
        Ok(kind.is(&torch.tensor).then_some(torch))
    }

    fn load(tensor: Bound<'_, PyType>) -> PyResult<Self> {
        let py = tensor.py();
        let to_dlpack = py.import("torch.utils.dlpack")?.getattr("to_dlpack")?.unbind();
        // Torch's compiled kernels and Triton use this function. Without it a stream object is made for each call.
        let raw = py.import("torch")?.getattr("_C")?.getattr_opt("_cuda_getCurrentRawStream")?;
        let (raw, current_stream) = match raw {
            Some(function) => (true, function),
            None => (false, py.import("torch.cuda")?.getattr("current_stream")?),
        };
        Ok(Torch { tensor: tensor.unbind(), to_dlpack, current_stream: current_stream.unbind(), raw })
    }

    /// A tensor's DLPack capsule, without synchronising streams. None for a tensor that needs a gradient: the
    /// protocol refuses it with an error of its own.
    pub fn lend<'py>(&self, tensor: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let py = tensor.py();
        if tensor.getattr(intern!(py, "requires_grad"))?.is_truthy()? {
            return Ok(None);
        }
        Ok(Some(self.to_dlpack.bind(py).call1((tensor,))?))
    }

    /// Torch's current stream of a device.
    pub fn stream(&self, py: Python<'_>, ordinal: i32) -> PyResult<u64> {
        let current = self.current_stream.bind(py).call1((ordinal,))?;
        let current = if self.raw { current } else { current.getattr("cuda_stream")? };
        Ok(current.extract::<u64>()?.max(image::LEGACY_DEFAULT_STREAM))
    }
}
