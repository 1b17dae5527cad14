//! The parts, one file each.

mod choices;
mod convergence;
mod day;
mod effects;
mod encode;
mod frontier;
mod host;
mod light;
mod memory;
mod readout;
mod real_sensor;
mod representations;
mod scale;
mod sensors;
mod stability;
mod time;

use crate::document::Outcome;
use crate::laboratory::{Laboratory, Part};
use anyhow::Result;

/// Runs one part.
pub(crate) fn run(laboratory: &Laboratory, part: Part) -> Result<Outcome> {
    match part {
        Part::Frontier => frontier::run(laboratory),
        Part::Convergence => convergence::run(laboratory),
        Part::Memory => memory::run(laboratory),
        Part::Time => time::run(laboratory),
        Part::Scale => scale::run(laboratory),
        Part::Host => host::run(laboratory),
        Part::Effects => effects::run(laboratory),
        Part::Readout => readout::run(laboratory),
        Part::Light => light::run(laboratory),
        Part::Encode => encode::run(laboratory),
        Part::Day => day::run(laboratory),
        Part::RealSensor => real_sensor::run(laboratory),
        Part::Stability => stability::run(laboratory),
    }
}
