//! The laboratory: what the engine costs and how far it is from the truth, measured by one body of code for
//! `esaac bench` and `cargo bench`.
//!
//! A [`Laboratory`] holds the device and what is asked for; each [`Part`] measures one thing and gives an
//! [`Outcome`]: plain structs for `bench.json`, a document in Markdown, plots in SVG. [`run`] runs parts,
//! [`write()`] writes what they gave. [`calibrate`] fits a sensor to a recording.

pub mod calibrate;
pub mod clock;
pub mod document;
pub mod floor;
pub mod frontier;
pub mod laboratory;
pub mod measure;
pub mod paper;
mod parts;
pub mod plot;
pub mod recording;
pub mod scenes;
pub mod statistics;
pub mod streams;
#[cfg(feature = "tracy")]
pub mod tracy_peer;
pub mod truth;
pub mod tumble;

pub use laboratory::{Laboratory, Options, Outcome, Part, Report, run, write};
