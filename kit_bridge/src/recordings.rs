//! Reads the recordings of cameras' makers, EVT3 and AEDAT 4, for `esaac/recordings.py`.

use crate::error::Fault;
use esaac_formats::recording::{RecordingError, aedat4, evt3};
use esaac_model::Polarity;
use esaac_model::packet::Event;
use numpy::PyArray1;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Columns and rows of the sensor.
type SizePx = (u32, u32);

/// Columns of events: x, y, times in nanoseconds, polarities (0 OFF, 1 ON).
type Columns<'py> = (
    Bound<'py, PyArray1<u16>>,
    Bound<'py, PyArray1<u16>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<u8>>,
);

/// The events of an EVT3 (`.raw`) or AEDAT 4 file from `from_ns` on and before `to_ns`; None is no limit.
#[pyfunction]
pub fn load_recording(
    py: Python<'_>,
    path: PathBuf,
    from_ns: Option<i64>,
    to_ns: Option<i64>,
) -> PyResult<(SizePx, Columns<'_>)> {
    let is_evt3 = path.extension().is_some_and(|suffix| suffix == "raw");
    let read = if is_evt3 { evt3::read } else { aedat4::read_events };
    let recording = py.detach(|| read(&path)).map_err(|error| exception(py, error))?;
    let events = part(&recording.events, from_ns, to_ns);
    let columns = (
        PyArray1::from_iter(py, events.iter().map(|event| event.x)),
        PyArray1::from_iter(py, events.iter().map(|event| event.y)),
        PyArray1::from_iter(py, events.iter().map(|event| event.t_ns)),
        PyArray1::from_iter(py, events.iter().map(|event| u8::from(event.polarity == Polarity::On))),
    );
    Ok(((recording.width_px, recording.height_px), columns))
}

/// Those of an interval, of events in order of time.
fn part(events: &[Event], from_ns: Option<i64>, to_ns: Option<i64>) -> &[Event] {
    let before = |t_ns: i64| events.partition_point(|event| event.t_ns < t_ns);
    let first = from_ns.map_or(0, before);
    let end = to_ns.map_or(events.len(), before);
    events.get(first..end).unwrap_or(&[])
}

/// An `OSError`, of the kind that Python has for its number, or an `ArgumentError` that names the file without its
/// folder, as those of the other formats do.
fn exception(py: Python<'_>, error: RecordingError) -> PyErr {
    match error {
        RecordingError::Io { path, source } => {
            let Some(number) = source.raw_os_error() else {
                return PyOSError::new_err(format!("{}: {source}", path.display()));
            };
            let why = py.import("os").and_then(|os| os.call_method1("strerror", (number,)));
            match why {
                // Python chooses the kind by the number: FileNotFoundError, PermissionError.
                Ok(why) => PyOSError::new_err((number, why.unbind(), path.into_os_string())),
                Err(error) => error,
            }
        }
        RecordingError::Format { path, reason } => {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            Fault::Argument(format!("{name}: {reason}")).into()
        }
    }
}
