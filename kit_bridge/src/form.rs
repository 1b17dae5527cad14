//! Event frames and voxel grids as arrays: NumPy's on the host, tensors on a CUDA device.

use crate::state::Form;
use crate::tensor::{Kind, Tensor};
use esaac_engine::Representation;
use numpy::IntoPyArray;
use pyo3::prelude::*;

/// Arrays of these shapes from a form's memory, one after the other. Event frames are int32, voxel grids float32.
pub fn arrays(
    py: Python<'_>,
    form: &Form,
    what: Representation,
    shapes: Vec<Vec<usize>>,
) -> PyResult<Vec<Py<PyAny>>> {
    let counts = what == Representation::EventFrame;
    let mut end = 0;
    shapes
        .into_iter()
        .map(|shape| {
            let start = end;
            end += 4 * shape.iter().product::<usize>();
            match form {
                Form::Cuda(block) => {
                    let kind = if counts { Kind::I32 } else { Kind::F32 };
                    Ok(Py::new(py, Tensor::new(block, start as u64, kind, shape))?.into_any())
                }
                Form::Host(bytes) => {
                    let bytes = &bytes[start..end];
                    let flat = if counts {
                        bytemuck::pod_collect_to_vec::<u8, i32>(bytes).into_pyarray(py).into_any()
                    } else {
                        bytemuck::pod_collect_to_vec::<u8, f32>(bytes).into_pyarray(py).into_any()
                    };
                    Ok(flat.call_method1("reshape", (shape,))?.unbind())
                }
            }
        })
        .collect()
}
