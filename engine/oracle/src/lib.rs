//! The reference implementation of [`esaac_model`]'s event camera: float64, plain loops, one pixel after the other. It
//! has no tiles and no fixed point. With the kernels it shares the model's equations and random draws alone.
//!
//! Each stage is a module, named as on the GPU: [`ingest`] → [`plan`] → [`synthesize`] → [`cross`] → [`stamp`] →
//! [`sort`]. [`Oracle`] runs them all. Each can also run alone, to be compared with the kernel of its name.
//!
//! The kernels save loads by approximations when they read frames. [`Sampling`] selects whether the oracle makes the
//! same approximations, to be compared with the kernels, or none.
//!
//! [`physical`] is stage `cross` of the physical pixel, and the readout of both. [`Oracle::step`] runs them.
//!
//! [`truth`] computes the events that densely rendered frames imply. [`metrics`] measures how far one stream of events
//! is from another.

pub mod cross;
pub mod ingest;
pub mod metrics;
pub mod oracle;
pub mod physical;
pub mod plan;
pub mod represent;
pub mod sort;
pub mod split;
pub mod stamp;
pub mod synthesize;
pub mod truth;

pub use ingest::Frame;
pub use oracle::{Diagnostics, Interval, Oracle, Samples};
pub use synthesize::sampling::Sampling;
