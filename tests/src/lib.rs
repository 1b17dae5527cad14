//! What the suites share: a device that the validation layer watches, frames, runs through the engine
//! and the oracle, and how far the two may be apart.

pub mod agreement;
pub mod corpus;
pub mod device;
pub mod frames;
pub mod run;
pub mod sequence;
