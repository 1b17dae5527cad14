//! The laboratory measures what the engine costs and how far its events are from the truth. `esaac bench` and `cargo
//! bench` run the same code.
//!
//! A [`Laboratory`] holds the device and the options of a run. Each [`Part`] measures one thing and returns an
//! [`Outcome`]: figures for `bench.json`, a document in Markdown, plots in SVG. [`run`] runs parts, [`write()`] writes
//! their results into a folder, and [`results`] keeps them in a page with a section for each device.

pub mod amount;
pub mod characterise;
pub mod clock;
pub mod document;
pub mod floor;
pub mod frontier;
pub mod laboratory;
pub mod measure;
pub mod paper;
mod parts;
pub mod plot;
pub mod report;
pub mod results;
pub mod scenes;
pub mod sequence;
pub mod statistics;
pub mod streams;
pub mod throw;
#[cfg(feature = "tracy")]
pub mod tracy_peer;
pub mod truth;

pub use document::Outcome;
pub use laboratory::{Laboratory, Options, Part};
pub use report::{Report, markdown, run, write};
