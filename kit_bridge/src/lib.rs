//! The native part of the Python package `esaac`. Users import the classes of `python/esaac`; their types and
//! documentation are in `__init__.pyi`.

mod array_interface;
mod axes;
mod bank;
mod cuda;
mod device;
mod dlpack;
mod engine;
mod error;
mod flow;
mod form;
mod half_done;
mod image;
mod join;
mod later;
mod mapped;
mod pack;
mod packet;
mod poses;
mod process;
mod recordings;
mod report;
mod ros;
mod ros_tick;
mod runs;
mod saved;
mod sensor;
mod state;
mod tensor;
mod texture;
mod threads;
mod torch;
mod warp;

use esaac_formats::event_file::{EventColumns, write_npz};
use esaac_model::Polarity;
use esaac_model::evt3;
use esaac_model::packet::Event;
use esaac_model::paths::NEIGHBOURS;
use esaac_model::physical::light::{LENS_TRANSMISSION, Lens, SceneUnit};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs the command `esaac` and returns its exit code. The first of `arguments` is the program's name. `program` is a
/// command line that starts the command again: some of its parts run as processes of their own.
#[pyfunction]
fn run_command(py: Python<'_>, arguments: Vec<OsString>, program: Vec<String>) -> u8 {
    py.detach(|| esaac_cli::program::run(&arguments, &program))
}

/// Writes events to a file of the same format as `esaac simulate`.
#[pyfunction]
fn save_npz(
    path: std::path::PathBuf,
    x: PyReadonlyArray1<'_, u16>,
    y: PyReadonlyArray1<'_, u16>,
    t_ns: PyReadonlyArray1<'_, i64>,
    p: PyReadonlyArray1<'_, u8>,
    ids: Option<PyReadonlyArray1<'_, i64>>,
    sensor_toml: &str,
) -> PyResult<()> {
    let columns = EventColumns {
        x: x.as_slice()?.to_vec(),
        y: y.as_slice()?.to_vec(),
        t_ns: t_ns.as_slice()?.to_vec(),
        sign: p.as_slice()?.iter().map(|&p| if p == 1 { 1 } else { -1 }).collect(),
        ids: ids.map(|ids| ids.as_slice().map(<[i64]>::to_vec)).transpose()?,
    };
    esaac_cli::output_file::write(&path, |out| write_npz(out, &columns, sensor_toml))
        .map_err(|error| pyo3::exceptions::PyOSError::new_err(format!("{error:#}")))
}

/// Writes events as EVT3. `esaac/files.py` has checked that the format can hold them.
#[pyfunction]
fn save_evt3(
    path: std::path::PathBuf,
    size_px: [u32; 2],
    x: PyReadonlyArray1<'_, u16>,
    y: PyReadonlyArray1<'_, u16>,
    t_ns: PyReadonlyArray1<'_, i64>,
    p: PyReadonlyArray1<'_, u8>,
) -> PyResult<()> {
    let places = x.as_slice()?.iter().zip(y.as_slice()?);
    let events = places.zip(t_ns.as_slice()?).zip(p.as_slice()?).map(|(((&x, &y), &t_ns), &p)| {
        let polarity = if p == 1 { Polarity::On } else { Polarity::Off };
        Event { t_ns, x, y, polarity }
    });
    esaac_cli::output_file::write(&path, |mut out| Ok(evt3::write_file(&mut out, size_px, events)?))
        .map_err(|error| pyo3::exceptions::PyOSError::new_err(format!("{error:#}")))
}

/// Focal-plane lux of an intensity of 1 behind a lens: see `esaac/__init__.pyi`.
#[pyfunction]
#[pyo3(signature = (scene_unit, f_number, *, transmission = LENS_TRANSMISSION, efficacy_lm_per_w = None))]
fn lux_per_unit(
    scene_unit: &str,
    f_number: f64,
    transmission: f64,
    efficacy_lm_per_w: Option<f64>,
) -> PyResult<f64> {
    let lux = SceneUnit::named(scene_unit, efficacy_lm_per_w)
        .and_then(|unit| Lens { f_number, transmission }.lux_per_unit(unit));
    lux.map_err(|error| error::Fault::Argument(error.to_string()).into())
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("POSE_NEIGHBOURS", NEIGHBOURS)?;
    module.add("MOST_BINS", esaac_engine::MOST_BINS)?;
    module.add_class::<engine::Engine>()?;
    module.add_class::<packet::PyPacket>()?;
    module.add_class::<ros::RosPublisher>()?;
    module.add_class::<sensor::PySensor>()?;
    module.add_class::<tensor::Tensor>()?;
    module.add_class::<texture::CudaTexture>()?;
    module.add_function(wrap_pyfunction!(device::devices, module)?)?;
    module.add_function(wrap_pyfunction!(ros::check_ros_names, module)?)?;
    module.add_function(wrap_pyfunction!(flow::flow, module)?)?;
    module.add_function(wrap_pyfunction!(recordings::load_recording, module)?)?;
    module.add_function(wrap_pyfunction!(lux_per_unit, module)?)?;
    module.add_function(wrap_pyfunction!(run_command, module)?)?;
    module.add_function(wrap_pyfunction!(save_evt3, module)?)?;
    module.add_function(wrap_pyfunction!(save_npz, module)?)
}
