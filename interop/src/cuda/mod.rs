//! A producer in CUDA, by the driver's interface, which is loaded when it is first used: a program with
//! this in it starts on machines without CUDA, and [`CudaProducer::connect`] says that there is none.
//!
//! Three ways into a slot: write it (the pointers are the engine's memory: no copy), have it copied from
//! where the frame lies (one copy on the device, rows of any stride), or bring memory of CUDA's own that
//! the engine imports (no copy either).
//!
//! The primary context is used, as the runtime does. No wait is ever left in a stream for the engine to
//! end: a slot is handed out once the engine has said that it is done, so `CUDA_DEVICE_MAX_CONNECTIONS`
//! need not be lowered for this.

mod context;
mod copy;
mod image;
mod in_process;
mod producer;
mod semaphore;
mod stream;

pub use context::{CudaDevice, cuda_devices};
pub use copy::{Strided, Texture};
pub use in_process::{CudaBuffer, CudaLink, Rows};
pub use producer::{CudaOptions, CudaProducer};
