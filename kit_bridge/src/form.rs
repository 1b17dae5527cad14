//! Event frames, voxel grids and instances of events as arrays: NumPy's on the host, tensors on a CUDA device.

use crate::state::Form;
use crate::tensor::{Kind, Tensor};
use esaac_engine::Representation;
use numpy::IntoPyArray;
use pyo3::prelude::*;

/// Arrays of these shapes from a form's memory, one after the other. Event frames are int32, voxel grids float32, ids int64.
pub fn arrays(
    py: Python<'_>,
    form: &Form,
    what: Representation,
    shapes: Vec<Vec<usize>>,
) -> PyResult<Vec<Py<PyAny>>> {
    let kind = match what {
        Representation::EventIds => Kind::I64,
        Representation::VoxelGrid { .. } => Kind::F32,
        _ => Kind::I32,
    };
    let mut end = 0;
    shapes
        .into_iter()
        .map(|shape| {
            let start = end;
            end += what.element_bytes() as usize * shape.iter().product::<usize>();
            match form {
                Form::Cuda(block) => {
                    Ok(Py::new(py, Tensor::new(block, start as u64, kind, shape))?.into_any())
                }
                Form::Host(bytes) => {
                    let bytes = &bytes[start..end];
                    let flat = match kind {
                        Kind::I64 => {
                            bytemuck::pod_collect_to_vec::<u8, i64>(bytes).into_pyarray(py).into_any()
                        }
                        Kind::F32 => {
                            bytemuck::pod_collect_to_vec::<u8, f32>(bytes).into_pyarray(py).into_any()
                        }
                        _ => bytemuck::pod_collect_to_vec::<u8, i32>(bytes).into_pyarray(py).into_any(),
                    };
                    Ok(flat.call_method1("reshape", (shape,))?.unbind())
                }
            }
        })
        .collect()
}
