//! Turns Rust's errors into the exceptions of `esaac.errors`.

use esaac_engine::EngineError;
use esaac_interop::InteropError;
use esaac_model::{FrameError, SensorError};
use esaac_ros::PublishError;
use pyo3::PyErr;
use pyo3::prelude::*;

/// An error in Rust, before it becomes an exception.
#[derive(Debug)]
pub enum Fault {
    /// A sensor's parameter.
    Sensor(SensorError),
    /// A frame's arrays or time.
    Frame(String),
    /// The device or its driver.
    Device(String),
    /// Use after `close`.
    Closed(&'static str),
    /// Use in a process that was forked.
    Forked { owner: u32, here: u32 },
    /// An argument that is out of range.
    Argument(String),
    /// ROS 2: there is no network, or a recording cannot be written.
    Ros(String),
}

impl From<SensorError> for Fault {
    fn from(error: SensorError) -> Self {
        Fault::Sensor(error)
    }
}

impl From<FrameError> for Fault {
    fn from(error: FrameError) -> Self {
        Fault::Frame(error.to_string())
    }
}

impl From<EngineError> for Fault {
    fn from(error: EngineError) -> Self {
        match error {
            EngineError::Sensor { source, .. } => Fault::Sensor(source),
            EngineError::Frame(source) => source.into(),
            EngineError::NoScene { .. }
            | EngineError::Poses { .. }
            | EngineError::TooManyInstances { .. } => Fault::Frame(error.to_string()),
            EngineError::SizeChange { .. }
            | EngineError::NoSuchCamera { .. }
            | EngineError::NoEventIds(_)
            | EngineError::Bins { .. }
            | EngineError::Snapshot(_) => Fault::Argument(error.to_string()),
            other => Fault::Device(other.to_string()),
        }
    }
}

impl From<InteropError> for Fault {
    fn from(error: InteropError) -> Self {
        match error {
            InteropError::Engine(error) => error.into(),
            InteropError::Size { .. } | InteropError::Texture { .. } => Fault::Frame(error.to_string()),
            other => Fault::Device(other.to_string()),
        }
    }
}

impl From<PublishError> for Fault {
    fn from(error: PublishError) -> Self {
        match error {
            PublishError::Plan(_)
            | PublishError::NoCamera { .. }
            | PublishError::BaseBeforeZero { .. }
            | PublishError::NoEventIds { .. }
            | PublishError::IdCount { .. } => Fault::Argument(error.to_string()),
            other => Fault::Ros(other.to_string()),
        }
    }
}

impl From<Fault> for PyErr {
    fn from(fault: Fault) -> Self {
        Python::attach(|py| exception(py, fault).unwrap_or_else(|error| error))
    }
}

fn exception(py: Python<'_>, fault: Fault) -> PyResult<PyErr> {
    let of = |name: &str| py.import("esaac.errors")?.getattr(name);
    let value = match fault {
        Fault::Sensor(SensorError::Range { parameter, expected, actual }) => {
            let message = SensorError::Range { parameter, expected: expected.clone(), actual: actual.clone() };
            of("SensorError")?.call1((message.to_string(), parameter, expected, actual))?
        }
        Fault::Sensor(SensorError::Value { parameter, value, reason }) => {
            let message = SensorError::Value {
                parameter: parameter.clone(),
                value: value.clone(),
                reason: reason.clone(),
            };
            of("SensorError")?.call1((message.to_string(), parameter, reason, value))?
        }
        Fault::Sensor(error) => of("SensorError")?.call1((error.to_string(),))?,
        Fault::Frame(message) => of("FrameError")?.call1((message,))?,
        Fault::Device(message) => of("DeviceError")?.call1((message,))?,
        Fault::Closed(what) => of("ClosedError")?.call1((format!("{what} is closed"),))?,
        Fault::Forked { owner, here } => of("ForkError")?.call1((format!(
            "made in process {owner} and used in {here}: a GPU's state does not survive fork(); make it after \
             the fork, or start processes by `spawn`"
        ),))?,
        Fault::Argument(message) => of("ArgumentError")?.call1((message,))?,
        Fault::Ros(message) => of("RosError")?.call1((message,))?,
    };
    Ok(PyErr::from_value(value))
}
