//! What is particular to torch's tensors: asked of torch's own functions in C. DLPack's protocol is Python there,
//! and takes microseconds a tensor.

use crate::image;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// Torch, once somebody has handed over a tensor of it.
pub struct Torch {
    tensor: Py<PyType>,
    to_dlpack: Py<PyAny>,
    current_stream: Py<PyAny>,
    /// Whether that is the function which gives a handle at once.
    raw: bool,
}

impl Torch {
    /// Torch, if an array is its tensor. Of subclasses only themselves know how they are lent.
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
        // Compiled kernels of torch and Triton ask the same; without it a stream's object is made to be asked.
        let raw = py.import("torch")?.getattr("_C")?.getattr_opt("_cuda_getCurrentRawStream")?;
        let (raw, current_stream) = match raw {
            Some(function) => (true, function),
            None => (false, py.import("torch.cuda")?.getattr("current_stream")?),
        };
        Ok(Torch { tensor: tensor.unbind(), to_dlpack, current_stream: current_stream.unbind(), raw })
    }

    /// A tensor's capsule of DLPack, on whatever stream it is written. None is given for one that needs a
    /// gradient: it is the protocol's to refuse.
    pub fn lend<'py>(&self, tensor: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let py = tensor.py();
        if tensor.getattr(intern!(py, "requires_grad"))?.is_truthy()? {
            return Ok(None);
        }
        Ok(Some(self.to_dlpack.bind(py).call1((tensor,))?))
    }

    /// The stream that torch puts a device's work into now.
    pub fn stream(&self, py: Python<'_>, ordinal: i32) -> PyResult<u64> {
        let current = self.current_stream.bind(py).call1((ordinal,))?;
        let current = if self.raw { current } else { current.getattr("cuda_stream")? };
        Ok(current.extract::<u64>()?.max(image::LEGACY_DEFAULT_STREAM))
    }
}
