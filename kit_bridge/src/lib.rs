//! The native half of the Python package `esaac`. What users see is in `python/esaac`, with its types and its
//! documentation in `__init__.pyi`.

mod array_interface;
mod bank;
mod cuda;
mod device;
mod dlpack;
mod engine;
mod error;
mod form;
mod image;
mod pack;
mod packet;
mod process;
mod report;
mod ros;
mod ros_tick;
mod saved;
mod sensor;
mod state;
mod tensor;
mod texture;
mod torch;
mod warp;

use esaac_cli::event_file::{EventColumns, write_npz};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

/// Runs the command `esaac` with these arguments, the first of them the program's name, and returns its exit
/// code. `program` starts this command once more, for processes that it needs.
#[pyfunction]
fn run_command(py: Python<'_>, arguments: Vec<String>, program: Vec<String>) -> u8 {
    py.detach(|| esaac_cli::program::run(&arguments, &program))
}

/// Writes events as `esaac simulate` does.
#[pyfunction]
fn save_npz(
    path: std::path::PathBuf,
    x: PyReadonlyArray1<'_, u16>,
    y: PyReadonlyArray1<'_, u16>,
    t_ns: PyReadonlyArray1<'_, i64>,
    p: PyReadonlyArray1<'_, u8>,
    sensor_toml: &str,
) -> PyResult<()> {
    let columns = EventColumns {
        x: x.as_slice()?.to_vec(),
        y: y.as_slice()?.to_vec(),
        t_ns: t_ns.as_slice()?.to_vec(),
        sign: p.as_slice()?.iter().map(|&p| if p == 1 { 1 } else { -1 }).collect(),
    };
    esaac_cli::output_file::write(&path, |out| write_npz(out, &columns, sensor_toml))
        .map_err(|error| pyo3::exceptions::PyOSError::new_err(format!("{error:#}")))
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<engine::Engine>()?;
    module.add_class::<packet::PyPacket>()?;
    module.add_class::<ros::RosPublisher>()?;
    module.add_class::<sensor::PySensor>()?;
    module.add_class::<tensor::Tensor>()?;
    module.add_class::<texture::CudaTexture>()?;
    module.add_function(wrap_pyfunction!(device::devices, module)?)?;
    module.add_function(wrap_pyfunction!(ros::check_ros_names, module)?)?;
    module.add_function(wrap_pyfunction!(run_command, module)?)?;
    module.add_function(wrap_pyfunction!(save_npz, module)?)
}
