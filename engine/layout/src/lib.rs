//! Layout of GPU memory and interface of the kernels: structs, bindings, workgroup sizes, specialisation constants. The
//! GLSL declarations are generated from it ([`generated_files`]), and every compiled kernel's reflection is checked
//! against it.

pub mod bindings;
pub mod constants;
mod glsl;
pub mod kernels;
pub mod sizes;
pub mod state;
pub mod structs;

pub use bindings::*;
pub use constants::{
    ConstantList, CrossConstants, CrossCpuConstants, DetailTransferConstants, IngestConstants,
    IngestCpuConstants, ReadoutConstants, SortConstants, SpecConstant, SpecType, SynthesizeConstants,
};
pub use glsl::generated_files;
pub use kernels::{KERNELS, KernelInfo, TICK_STAGES, TICK_STAGES_WITH_BUS, stages};
pub use sizes::*;
pub use state::*;
pub use structs::*;
