//! What the suites share: a device that the validation layer watches, frames, runs through the engine
//! and the oracle, and how far the two may be apart.

pub mod agreement;
pub mod corpus;
pub mod cuda;
pub mod device;
pub mod drivers;
pub mod figures;
pub mod frames;
pub mod interop;
pub mod pairs;
pub mod peer;
pub mod run;
pub mod sequence;
