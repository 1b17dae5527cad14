//! Errors of the engine.

use ash::vk;
use esaac_model::paths::{Intrinsics, MotionError};
use esaac_model::{FrameError, SensorError};
use std::sync::Arc;
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
    /// Drivers, but no device with every required capability.
    #[error("no Vulkan device is sufficient: {0}")]
    NoSuitableDevice(String),
    /// The device asked for does not exist.
    #[error("no Vulkan device {wanted}; there are: {present}")]
    NoSuchDevice {
        /// The choice, in words.
        wanted: String,
        /// The devices that exist.
        present: String,
    },
    /// A device lacks a capability.
    #[error("device {device} lacks {missing}, which the engine needs")]
    MissingCapability {
        /// Device name.
        device: String,
        /// Names of the missing capabilities.
        missing: String,
    },
    /// Validation is on and the layer is not installed.
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
    /// An allocation failed, or is larger than a rig's buffers may be.
    #[error("no device memory for {bytes} bytes of `{name}`: {reason}")]
    OutOfMemory {
        /// Name of the allocation.
        name: String,
        /// Size asked for.
        bytes: u64,
        /// The allocator's message.
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
    #[error("{actual} cameras, expected at most {expected} in one rig; one with a readout counts twice")]
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
    /// A buffer, a timeline or commands of another [`Device`](crate::Device), which may be the same hardware.
    #[error("{what}: made by another open device ({actual}), expected the one that shall use it, {expected}")]
    OtherDevice {
        /// What it is.
        what: String,
        /// The device that shall use it.
        expected: String,
        /// The one that it is of.
        actual: String,
    },
    /// An option of a rig, or a part of its kernel policy, that no rig can have.
    #[error("`{name}` is {actual}, expected {expected}")]
    Option {
        /// Its name.
        name: &'static str,
        /// What it may be.
        expected: String,
        /// What it is.
        actual: u32,
    },
    /// Poses for a camera that gets no depth.
    #[error(
        "camera {camera} has no geometry, expected depth and a lens in its configuration before its poses"
    )]
    NoGeometry {
        /// Camera number in the rig.
        camera: usize,
    },
    /// Instances of events that cannot be told: why.
    #[error("the instances that events show are not known: {0}")]
    NoEventIds(String),
    /// A voxel grid of no bins, or of too many.
    #[error("{actual} bins, expected 1 to {expected}")]
    Bins {
        /// Most bins.
        expected: u32,
        /// Asked for.
        actual: u32,
    },
    /// A camera with synthesis `rigid` without poses.
    #[error("camera {camera}: synthesis `rigid` needs poses; set them before the step")]
    NoScene {
        /// Camera number in the rig.
        camera: usize,
    },
    /// Poses of a camera with another lens.
    #[error("camera {camera}: the poses are those of a camera with {actual:?}, expected {expected:?}")]
    Lens {
        /// Camera number in the rig.
        camera: usize,
        /// The camera's lens.
        expected: Box<Intrinsics>,
        /// That of the poses.
        actual: Box<Intrinsics>,
    },
    /// Poses that do not span an interval.
    #[error("camera {camera}: {source}")]
    Poses {
        /// Camera number in the rig.
        camera: usize,
        /// What they lack.
        source: Box<MotionError>,
    },
    /// More instances than surfaces can name.
    #[error("camera {camera}: {actual} instances with poses, expected at most {expected}")]
    TooManyInstances {
        /// Camera number in the rig.
        camera: usize,
        /// Limit.
        expected: usize,
        /// Given.
        actual: usize,
    },
    /// Saved state that is damaged or belongs to other cameras.
    #[error("saved state: {0}")]
    Snapshot(String),
    /// Kernels under development that cannot replace the running ones: the compiler's message, or how they differ
    /// from the Rust layouts.
    #[error("{0}")]
    Kernels(String),
    /// The device did not finish in time; the number is the limit in seconds.
    #[error("the device did not finish within {0} s")]
    Timeout(u64),
    /// Commands that may still run, because a wait for them has failed.
    #[error("these commands may still run, since a wait for them has failed; make new ones")]
    Abandoned,
    /// Commands that a submitted step uses.
    #[error("a step that was submitted uses these commands, expected `Rig::wait` before they serve again")]
    InUse,
    /// A rig with a step that was submitted and not waited for.
    #[error("a step was submitted and its packets were not taken, expected `Rig::wait` first")]
    Submitted,
    /// A wait without a step.
    #[error("no step was submitted, expected `Rig::submit_frames` or `Rig::submit_tiles` before `Rig::wait`")]
    NotSubmitted,
    /// A timeline cannot go back or stay.
    #[error("a timeline can be set to a value above {expected_above}, not to {actual}")]
    TimelineValue {
        /// Its current value.
        expected_above: u64,
        /// The value asked for.
        actual: u64,
    },
    /// A camera's dispatches are larger than the device allows.
    #[error(
        "camera {camera} needs {actual} workgroups side by side, and {device} takes at most {expected}; make the camera smaller"
    )]
    TooManyGroups {
        /// Camera number in the rig.
        camera: usize,
        /// Device name.
        device: String,
        /// `maxComputeWorkGroupCount[0]`.
        expected: u32,
        /// What the camera needs.
        actual: u32,
    },
    /// The events of a tick did not fit, however often the buffers grew; the number counts the retries.
    #[error("a tick did not end after {0} retries, which grow the event buffers to what it asks for")]
    Endless(u32),
    /// A tick failed after the device had begun it, so that the cameras' state on the device is half updated.
    #[error(
        "this rig has failed within a tick and takes no more steps ({why}); close it, make a new one and restore the state saved last, or start afresh"
    )]
    Lost {
        /// What failed.
        why: Arc<EngineError>,
    },
}

impl EngineError {
    /// Whether a submission may still run, because the wait for it has failed. (The error of a failed wait is a time-out, or
    /// names one of [`CALLS_OF_A_WAIT`](crate::timing::CALLS_OF_A_WAIT).)
    pub(crate) fn leaves_work(&self) -> bool {
        let in_a_wait = |call| crate::timing::CALLS_OF_A_WAIT.contains(&call);
        self.is_device_lost()
            || matches!(self, EngineError::Timeout(_))
            || matches!(self, EngineError::Vulkan { call, .. } if in_a_wait(*call))
    }

    /// Whether the device itself is gone.
    pub(crate) fn is_device_lost(&self) -> bool {
        matches!(self, EngineError::Vulkan { result: vk::Result::ERROR_DEVICE_LOST, .. })
    }
}

/// Names the Vulkan call that a result comes from.
pub(crate) trait Call<T> {
    fn call(self, call: &'static str) -> Result<T, EngineError>;
}

impl<T> Call<T> for Result<T, vk::Result> {
    fn call(self, call: &'static str) -> Result<T, EngineError> {
        self.map_err(|result| EngineError::Vulkan { call, result })
    }
}
