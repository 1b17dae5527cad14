//! Shared by the test suites: a device watched by the validation layer, frames, runs through the engine and the oracle,
//! and the comparison of the two.

pub mod agreement;
pub mod corpus;
pub mod cuda;
pub mod device;
pub mod drivers;
pub mod exact;
pub mod figures;
pub mod frames;
pub mod geometry;
pub mod interop;
pub mod pairs;
pub mod peer;
pub mod recording;
pub mod run;
pub mod saved;
pub mod sequence;

/// The Rust example of the guide.
#[cfg(doctest)]
#[doc = include_str!("../../docs/guide/rust.md")]
pub struct RustGuide;
