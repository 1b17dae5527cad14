//! The engine: rendered frames in, time-ordered event packets out, on any Vulkan 1.3 device.
//!
//! A [`Rig`] holds cameras of different sensors and steps all of them with one submission. The kernels are in `glsl/`;
//! the model crate's documentation describes the model that they compute.

#[macro_use]
#[doc(hidden)]
pub mod profile;
mod calibration;
mod commands;
mod device;
mod devices;
mod error;
mod faults;
mod instance;
mod interface;
mod kernel;
mod kernel_folder;
mod loan;
mod memory;
mod pipeline;
mod policy;
mod retire;
mod rig;
mod sources;
mod threads;
mod timeline;
mod timing;

pub use ash;
pub use calibration::Calibration;
pub use commands::{Commands, SubmitHooks};
pub use device::Device;
#[doc(hidden)]
pub use device::Restrictions;
pub use devices::{Capability, DeviceChoice, DeviceInfo, find_device, list_devices};
pub use error::EngineError;
pub use esaac_layout::{MAX_CAMERAS, MOST_BINS};
#[doc(hidden)]
pub use faults::{FaultHook, FaultPoint};
pub use gpu_allocator::MemoryLocation;
pub use instance::Validation;
pub use kernel::{Kernel, KernelStatistics, stages};
pub use kernel_folder::KernelFolder;
pub use memory::{Buffer, MemoryUse};
pub use policy::{KernelPolicy, KernelSet, LevelsFirst, Resting};
pub use rig::{
    ApsFrame, CameraConfig, Diagnostics, FrameBytes, FrameInput, GeometryConfig, HeldPackets, InputBuffers,
    MOST_PACKET_SETS, PacketPlace, Representation, Rig, RigOptions, Share, StageSpan, Tick, places_in_rig,
};
pub use timeline::Timeline;
