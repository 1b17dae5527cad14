//! `CudaTexture`: a renderer's image in CUDA's own layout.

use crate::error::Fault;
use crate::image::Element;
use esaac_interop::cuda::Texture;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// See `esaac/__init__.pyi`.
#[pyclass(module = "esaac", frozen)]
#[derive(Clone, Copy)]
pub struct CudaTexture {
    /// CUDA's handle.
    pub texture: Texture,
    /// Rows, columns, channels.
    pub shape: [usize; 3],
    /// Type of a channel.
    pub element: Element,
    /// Stream that the renderer writes it in.
    pub stream: Option<u64>,
}

#[pymethods]
impl CudaTexture {
    #[new]
    #[pyo3(signature = (handle, width, height, *, dtype="float16", mipmapped=true, stream=None))]
    fn new(
        handle: u64,
        width: usize,
        height: usize,
        dtype: &str,
        mipmapped: bool,
        stream: Option<u64>,
    ) -> PyResult<Self> {
        if handle == 0 {
            return Err(Fault::Argument("handle is 0, expected an array of CUDA".to_owned()).into());
        }
        let element = match dtype {
            "float16" => Element::F16,
            "float32" => Element::F32,
            "uint8" => Element::U8,
            other => {
                let message = format!("dtype is `{other}`, expected float16, float32 or uint8");
                return Err(Fault::Argument(message).into());
            }
        };
        Ok(CudaTexture { texture: Texture { handle, mipmapped }, shape: [height, width, 4], element, stream })
    }

    #[getter]
    fn shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.shape)
    }
}
