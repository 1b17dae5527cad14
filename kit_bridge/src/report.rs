//! Counts, times, memory and APS frames as Python's dictionaries and arrays.

use crate::bank::Copies;
use esaac_cli::device_choice::uuid_text;
use esaac_engine::{ApsFrame, DeviceInfo, Diagnostics, MemoryUse};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Time, bits, pixels.
pub type Aps = (i64, u32, Py<PyAny>);

/// Counts of a camera's last step.
pub fn counts<'py>(py: Python<'py>, counts: &Diagnostics) -> PyResult<Bound<'py, PyDict>> {
    let row = PyDict::new(py);
    let values = serde_json::to_value(counts).expect("a struct of numbers");
    for (name, value) in values.as_object().expect("a struct") {
        row.set_item(name, value.as_u64())?;
    }
    Ok(row)
}

/// Numbers that all cameras share: times of the last step, and copies so far.
pub fn shared(
    py: Python<'_>,
    [gpu_ns, submit_to_packet_ns, step_ns, frames_ns]: [u64; 4],
    Copies { host, device }: Copies,
) -> PyResult<Bound<'_, PyDict>> {
    let row = PyDict::new(py);
    row.set_item("gpu_ns", gpu_ns)?;
    row.set_item("submit_to_packet_ns", submit_to_packet_ns)?;
    row.set_item("step_ns", step_ns)?;
    row.set_item("frames_ns", frames_ns)?;
    row.set_item("host_copies", host)?;
    row.set_item("device_copies", device)?;
    Ok(row)
}

/// An APS frame.
pub fn aps(py: Python<'_>, frame: ApsFrame) -> PyResult<Aps> {
    let shape = (frame.height_px, frame.width_px);
    let pixels = frame.pixels.into_pyarray(py).call_method1("reshape", (shape,))?;
    Ok((frame.t_ns, frame.bits, pixels.unbind()))
}

/// Memory in use for one purpose.
pub fn memory<'py>(py: Python<'py>, entry: &MemoryUse) -> PyResult<Bound<'py, PyDict>> {
    let row = PyDict::new(py);
    row.set_item("camera", entry.camera)?;
    row.set_item("purpose", &entry.purpose)?;
    row.set_item("bytes", entry.bytes)?;
    row.set_item("on_host", entry.on_host)?;
    Ok(row)
}

/// The device of a camera.
pub fn device<'py>(py: Python<'py>, info: &DeviceInfo) -> PyResult<Bound<'py, PyDict>> {
    let row = PyDict::new(py);
    row.set_item("name", &info.name)?;
    row.set_item("kind", info.kind)?;
    row.set_item("uuid", uuid_text(&info.uuid))?;
    row.set_item("driver", &info.driver)?;
    Ok(row)
}
