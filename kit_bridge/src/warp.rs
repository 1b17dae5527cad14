//! A faster way for the arrays of Warp, which Isaac Sim uses. Warp's DLPack is slow Python code. Its array interface is
//! quick but names no stream, so the stream is found here.

use crate::image;
use pyo3::intern;
use pyo3::prelude::*;

/// Warp's current stream of an array's device, if it is an array of Warp's on a CUDA device.
pub fn stream_of(array: &Bound<'_, PyAny>) -> PyResult<Option<u64>> {
    let (py, kind) = (array.py(), array.get_type());
    // The module before Warp 1.10, and since.
    let ours = |module: Bound<'_, _>| module == "warp.types" || module == "warp._src.types";
    if !kind.name().is_ok_and(|name| name == "array") || !kind.module().is_ok_and(ours) {
        return Ok(None);
    }
    let device = array.getattr(intern!(py, "device"))?;
    if device.is_none() || !device.getattr(intern!(py, "is_cuda"))?.is_truthy()? {
        return Ok(None);
    }
    let stream = device.getattr(intern!(py, "stream"))?.getattr(intern!(py, "cuda_stream"))?;
    Ok(Some(stream.extract::<Option<u64>>()?.unwrap_or(0).max(image::LEGACY_DEFAULT_STREAM)))
}
