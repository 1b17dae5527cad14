//! What can go wrong in the engine.

use ash::vk;
use esaac_model::{FrameError, SensorError};
use thiserror::Error;

/// Every error of this crate.
#[derive(Debug, Error)]
pub enum EngineError {
    /// No Vulkan loader.
    #[error("the Vulkan loader cannot be opened ({0}); install it with: apt-get install libvulkan1")]
    NoLoader(ash::LoadingError),
    /// No driver at all.
    #[error(
        "no Vulkan driver is installed; the software one comes with: apt-get install mesa-vulkan-drivers"
    )]
    NoDriver,
    /// Drivers, but no device that is enough.
    #[error("no Vulkan device is sufficient: {0}")]
    NoSuitableDevice(String),
    /// The device asked for does not exist.
    #[error("no Vulkan device {wanted}; there are: {present}")]
    NoSuchDevice {
        /// What was asked for.
        wanted: String,
        /// What there is.
        present: String,
    },
    /// A device lacks something.
    #[error("device {device} lacks {missing}, which the engine needs")]
    MissingCapability {
        /// Device name.
        device: String,
        /// What it lacks.
        missing: String,
    },
    /// The validation layer was asked for and is not installed.
    #[error(
        "the Vulkan validation layer is not installed; install it with: apt-get install vulkan-validationlayers"
    )]
    NoValidationLayer,
    /// A Vulkan call failed.
    #[error("{call} failed: {result}")]
    Vulkan {
        /// The call.
        call: &'static str,
        /// Its result.
        result: vk::Result,
    },
    /// Memory could not be had.
    #[error("no device memory for {bytes} bytes of `{name}`: {reason}")]
    OutOfMemory {
        /// Allocation.
        name: String,
        /// Size asked for.
        bytes: u64,
        /// The allocator's words.
        reason: String,
    },
    /// A bad sensor.
    #[error("camera {camera}: {source}")]
    Sensor {
        /// Camera number in the rig.
        camera: usize,
        /// What is wrong.
        source: SensorError,
    },
    /// A bad frame.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// More cameras than a rig holds.
    #[error("{actual} cameras, expected at most {expected} in one rig")]
    TooManyCameras {
        /// Limit.
        expected: usize,
        /// Asked for.
        actual: usize,
    },
    /// A sensor's size cannot change while it runs.
    #[error(
        "camera {camera} is {expected_width}x{expected_height} px and cannot become {actual_width}x{actual_height} px; build a new rig"
    )]
    SizeChange {
        /// Camera number in the rig.
        camera: usize,
        /// Columns it has.
        expected_width: u32,
        /// Rows it has.
        expected_height: u32,
        /// Columns asked for.
        actual_width: u32,
        /// Rows asked for.
        actual_height: u32,
    },
    /// No camera of that number.
    #[error("the rig has {expected} cameras and no camera {actual}")]
    NoSuchCamera {
        /// Cameras in the rig.
        expected: usize,
        /// Camera asked for.
        actual: usize,
    },
    /// Saved state that does not fit.
    #[error("saved state: {0}")]
    Snapshot(String),
    /// Kernels under development that cannot take the place of those that run: the compiler's words, or
    /// in what they differ from the Rust layouts.
    #[cfg(feature = "shaderc")]
    #[error("{0}")]
    Kernels(String),
    /// The device did not finish.
    #[error("the device did not finish within {0} s")]
    Timeout(u64),
}

/// Names the call whose result it was.
pub(crate) trait Call<T> {
    fn call(self, call: &'static str) -> Result<T, EngineError>;
}

impl<T> Call<T> for Result<T, vk::Result> {
    fn call(self, call: &'static str) -> Result<T, EngineError> {
        self.map_err(|result| EngineError::Vulkan { call, result })
    }
}
