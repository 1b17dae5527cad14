//! What is particular to torch's tensors.

use crate::image;
use pyo3::exceptions::PyBufferError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::cell::Cell;

fn is_torch(array: &Bound<'_, PyAny>) -> PyResult<bool> {
    Ok(array.get_type().module()? == "torch")
}

/// The stream that torch puts work into now, for a tensor of torch's: to ask for it takes less time than to have
/// torch order the stream that DLPack's protocol names.
pub fn stream_of(array: &Bound<'_, PyAny>, known: &Cell<Option<u64>>) -> PyResult<Option<u64>> {
    if !is_torch(array)? {
        return Ok(None);
    }
    if known.get().is_some() {
        return Ok(known.get());
    }
    let cuda = array.py().import("torch")?.getattr("cuda")?;
    let stream: u64 = cuda
        .call_method1("current_stream", (array.getattr("device")?,))?
        .getattr("cuda_stream")?
        .extract()?;
    known.set(Some(stream.max(image::LEGACY_DEFAULT_STREAM)));
    Ok(known.get())
}

/// An array's capsule of DLPack. Torch lends tensors of its present device only, so it is asked once more there.
pub fn lend<'py>(array: &Bound<'py, PyAny>, arguments: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyAny>> {
    let py = array.py();
    match array.call_method("__dlpack__", (), Some(arguments)) {
        Err(error) if error.is_instance_of::<PyBufferError>(py) && is_torch(array)? => {
            let there = (array.getattr("device")?,);
            let device = py.import("torch")?.getattr("cuda")?.getattr("device")?.call1(there)?;
            device.call_method0("__enter__")?;
            let lent = array.call_method("__dlpack__", (), Some(arguments));
            device.call_method1("__exit__", (py.None(), py.None(), py.None()))?;
            lent
        }
        lent => lent,
    }
}
