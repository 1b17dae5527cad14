//! The light of a camera from its frames' unit and its lens, for the command line and rig files.

use anyhow::{Context, Result, bail, ensure};
use esaac_model::SensorModel;
use esaac_model::physical::light::{LENS_TRANSMISSION, Lens, SceneUnit};

/// What gives `lux_per_unit`, named as in rig files: name, name of the flag's value, help.
pub const SCENE_LIGHT: [(&str, &str, &str); 4] = [
    (
        "scene_unit",
        "UNIT",
        "Unit of the frames: luminance (cd/m2) or radiance (W/m2/sr); sets --lux-per-unit",
    ),
    ("f_number", "F", "With --scene-unit: F-number of the lens"),
    (
        "lens_transmission",
        "SHARE",
        "With --scene-unit: share of the light that the lens lets through [default: 0.9]",
    ),
    (
        "luminous_efficacy",
        "lm/W",
        "With --scene-unit radiance: of the scene's light [default: 270, white light]",
    ),
];

/// The values of [`SCENE_LIGHT`], as given.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SceneLight {
    /// In the order of the list.
    pub values: [Option<String>; 4],
    /// Whether they are flags, for messages.
    pub are_flags: bool,
}

impl SceneLight {
    /// Names of those that are given, as in rig files.
    pub fn given(&self) -> impl Iterator<Item = &'static str> {
        SCENE_LIGHT.iter().zip(&self.values).filter_map(|((name, ..), value)| value.as_ref().map(|_| *name))
    }

    /// Sets the sensor's `lux_per_unit`, if a unit is named, and returns whether one is. `has_lux`: whether the user has given
    /// that as well, which is an error.
    pub fn apply(&self, sensor: &mut SensorModel, has_lux: bool) -> Result<bool> {
        let Some(lux) = self.lux()? else { return Ok(false) };
        let [unit, lux_per_unit] = ["scene_unit", "lux_per_unit"].map(|name| self.spelled(name));
        ensure!(!has_lux, "{unit} and {lux_per_unit} are given, expected one: the former sets the latter");
        // An intensity is the frames' value times the gain.
        sensor.lux_per_unit = lux / sensor.exposure_gain;
        Ok(true)
    }

    /// Focal-plane lux of the frames' unit; `None` if no unit is named.
    fn lux(&self) -> Result<Option<f64>> {
        let name = |index: usize| self.spelled(SCENE_LIGHT[index].0);
        let number = |index: usize| -> Result<Option<f64>> {
            let parse = |text: &String| {
                text.parse().with_context(|| format!("{} is `{text}`, expected a number", name(index)))
            };
            self.values[index].as_ref().map(parse).transpose()
        };
        let Some(unit) = &self.values[0] else {
            if let Some(index) = (1..4).find(|&index| self.values[index].is_some()) {
                bail!("{} is given without {}, expected both", name(index), name(0));
            }
            return Ok(None);
        };
        let unit = SceneUnit::named(unit, number(3)?)?;
        let Some(f_number) = number(1)? else {
            bail!(
                "{} is given without {}, expected both: the light behind a lens depends on it",
                name(0),
                name(1)
            );
        };
        let lens = Lens { f_number, transmission: number(2)?.unwrap_or(LENS_TRANSMISSION) };
        Ok(Some(lens.lux_per_unit(unit)?))
    }

    fn spelled(&self, name: &str) -> String {
        if self.are_flags { format!("--{}", name.replace('_', "-")) } else { format!("`{name}`") }
    }
}
