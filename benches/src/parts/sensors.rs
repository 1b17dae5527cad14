//! Sensors and formatting that several parts share.

use crate::document::short;
use esaac_model::presets::preset;
use esaac_model::{Intensity, Profile, SensorModel};

/// A preset without noise.
pub(super) fn clean(name: &str) -> SensorModel {
    preset(name).expect("a preset")
}

/// A preset with every effect on.
pub(super) fn noisy(name: &str) -> SensorModel {
    let mut sensor = clean(name);
    Profile::Noisy.apply(&mut sensor);
    sensor
}

/// Formats stages and their microseconds for a cell.
pub(super) fn stages(stages_us: &[(&'static str, f64)]) -> String {
    let each: Vec<String> = stages_us.iter().map(|(name, us)| format!("{name} {}", short(*us))).collect();
    each.join(", ")
}

/// The paper's two modes.
pub(super) const MODES: [(&str, Intensity); 2] = [("gray", Intensity::Gray), ("bayer", Intensity::BayerRggb)];

/// The same with synthesis `rigid`.
pub(super) const RIGID_MODES: [(&str, Intensity); 2] =
    [("gray, rigid", Intensity::Gray), ("bayer, rigid", Intensity::BayerRggb)];
