//! The parts, one file each.

mod choices;
mod convergence;
mod effects;
mod encode;
mod frontier;
mod hard_cases;
mod memory;
mod real_sensor;
mod scale;
mod stability;
mod time;

use crate::document::short;
use crate::laboratory::{Laboratory, Outcome, Part};
use anyhow::Result;
use esaac_model::presets::preset;
use esaac_model::{Intensity, Profile, SensorModel};

/// Runs one part.
pub(crate) fn run(laboratory: &Laboratory, part: Part) -> Result<Outcome> {
    match part {
        Part::Frontier => frontier::run(laboratory),
        Part::Convergence => convergence::run(laboratory),
        Part::Memory => memory::run(laboratory),
        Part::Time => time::run(laboratory),
        Part::Scale => scale::run(laboratory),
        Part::Effects => effects::run(laboratory),
        Part::Encode => encode::run(laboratory),
        Part::HardCases => hard_cases::run(laboratory),
        Part::RealSensor => real_sensor::run(laboratory),
        Part::Stability => stability::run(laboratory),
    }
}

/// A preset without noise.
fn clean(name: &str) -> SensorModel {
    preset(name).expect("a preset")
}

/// A preset with every effect on.
fn noisy(name: &str) -> SensorModel {
    let mut sensor = clean(name);
    Profile::Noisy.apply(&mut sensor);
    sensor
}

/// Stages and their microseconds, for a cell.
fn stages(stages_us: &[(&'static str, f64)]) -> String {
    let each: Vec<String> = stages_us.iter().map(|(name, us)| format!("{name} {}", short(*us))).collect();
    each.join(", ")
}

/// Both modes of the paper.
const MODES: [(&str, Intensity); 2] = [("gray", Intensity::Gray), ("bayer", Intensity::BayerRggb)];
