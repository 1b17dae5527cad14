//! The event camera of [`esaac_model`] in float64 and plain loops: one pixel after the other, no
//! tiling, no fixed point, nothing shared with a kernel but the model's equations and random draws.
//!
//! One module per stage, named as on the GPU:
//! [`ingest`] → [`plan`] → [`synthesize`] → [`cross`] → [`stamp`] → [`sort`]. [`Oracle`] runs them;
//! each can be run alone and compared with the kernel of its name.
//!
//! [`truth`] turns densely rendered frames into the events that they imply, and [`metrics`] says how
//! far one stream of events is from another.

pub mod cross;
pub mod ingest;
pub mod metrics;
pub mod oracle;
pub mod plan;
pub mod represent;
pub mod sort;
pub mod split;
pub mod stamp;
pub mod synthesize;
pub mod truth;

pub use ingest::Frame;
pub use oracle::{Diagnostics, Interval, Oracle, Samples};
