//! The engine: rendered frames in, time-ordered event packets out, on any Vulkan 1.3 device.
//!
//! A [`Rig`] holds cameras of different sensors and steps all of them with one submission. What the
//! kernels do is in `glsl/`; what they mean is in the model crate's documentation.

#[macro_use]
#[doc(hidden)]
pub mod profile;
mod calibration;
mod commands;
mod device;
mod devices;
mod error;
mod instance;
#[cfg(feature = "shaderc")]
mod interface;
mod kernel;
#[cfg(feature = "shaderc")]
mod kernel_folder;
mod memory;
mod pipeline;
mod rig;
mod timeline;
mod timing;

pub use ash;
pub use calibration::Calibration;
pub use commands::{Around, Commands};
pub use device::Device;
pub use devices::{Capability, DeviceChoice, DeviceInfo, list_devices};
pub use error::EngineError;
pub use gpu_allocator::MemoryLocation;
pub use instance::Validation;
pub use kernel::{BindingSet, Kernel, KernelStatistics, stages};
#[cfg(feature = "shaderc")]
pub use kernel_folder::KernelFolder;
pub use memory::{Buffer, MemoryUse};
pub use rig::{
    ApsFrame, CameraConfig, Diagnostics, FrameBytes, FrameInput, InputBuffers, PacketPlace, Representation,
    Rig, RigOptions, Share, StageSpan, Tick,
};
pub use timeline::Timeline;
