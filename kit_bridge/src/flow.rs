//! Optical flow by the poses, for `esaac.flow`.

use crate::error::Fault;
use crate::poses::{GivenLens, GivenPoses, Wanted, lens};
use crate::threads::Threads;
use esaac_model::paths::MotionError;
use numpy::ndarray::Array4;
use numpy::{IntoPyArray, PyArray4, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// The displacement of what each pixel shows, `[cameras][row][column][2]`, as `SceneMotion::flow` has it. Images are
/// `[cameras][row][column]`, without gaps.
#[pyfunction]
#[pyo3(signature = (given_lens, poses, depth, ids, from_ns, to_ns))]
pub fn flow<'py>(
    py: Python<'py>,
    given_lens: GivenLens,
    poses: GivenPoses<'py>,
    depth: PyReadonlyArray3<'py, f32>,
    ids: Option<PyReadonlyArray3<'py, u32>>,
    from_ns: i64,
    to_ns: i64,
) -> PyResult<Bound<'py, PyArray4<f32>>> {
    let &[cameras, height, width] = depth.shape() else { unreachable!("it has three axes") };
    let lens = lens(&given_lens)?;
    let poses = poses.read(cameras)?;
    let (first_ns, last_ns) = (from_ns.min(to_ns), from_ns.max(to_ns));
    poses.check_span(first_ns, last_ns)?;
    let (depth, ids) = (depth.as_slice()?, ids.as_ref().map(|ids| ids.as_slice()).transpose()?);
    let vectors = py.detach(|| -> Result<Vec<f32>, Fault> {
        let wanted: Vec<Wanted> =
            (0..cameras).map(|index| Wanted { index, lens, first_ns: i64::MIN, follows: true }).collect();
        let scenes = poses.scenes(&wanted, &mut Vec::new(), &Threads::of(1, cameras)?)?;
        let pixels = height * width;
        let mut vectors = Vec::with_capacity(2 * depth.len());
        for (camera, scene) in scenes.into_iter().flatten().enumerate() {
            let part = camera * pixels..(camera + 1) * pixels;
            scene
                .check_span(first_ns, last_ns)
                .map_err(|error: MotionError| Fault::Frame(error.to_string()))?;
            let flow = scene.flow(&depth[part.clone()], ids.map(|ids| &ids[part]), width, from_ns, to_ns);
            vectors.extend(flow.into_iter().flatten());
        }
        Ok(vectors)
    })?;
    let vectors = Array4::from_shape_vec((cameras, height, width, 2), vectors).expect("two numbers a pixel");
    Ok(vectors.into_pyarray(py))
}
