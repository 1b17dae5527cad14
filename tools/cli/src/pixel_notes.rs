//! What is assumed of a physical pixel and its light, for the report.

use esaac_model::physical::assumed_note;
use esaac_model::{Pixel, SensorModel};

/// How to say what the light is, on the command line.
pub const BY_FLAGS: &str = "--lux-per-unit, or by --scene-unit and --f-number";

/// How to say what the light is, in a rig file.
pub const BY_KEYS: &str = "`lux_per_unit`, or by `scene_unit` and `f_number`";

/// The notes on a sensor; none on a log-intensity pixel. `light_is_given`: somebody says what its `lux_per_unit` is;
/// else that is told to be done `by` something.
#[must_use]
pub fn of(sensor: &SensorModel, light_is_given: bool, by: &str) -> Vec<String> {
    let of_light = (sensor.pixel == Pixel::Physical && !light_is_given).then(|| {
        format!(
            "Assumed: an intensity of 1 is {} focal-plane lux. Say what it is by {by}",
            sensor.lux_per_unit
        )
    });
    of_light.into_iter().chain(assumed_note(sensor)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::tests::simulate;

    fn notes(flags: &[&str]) -> Vec<String> {
        let resolved = simulate(flags).sensor.resolve(SensorModel::default()).unwrap();
        of(&resolved.sensor, resolved.light_is_given, BY_FLAGS)
    }

    #[test]
    fn light_that_nobody_has_stated_is_told() {
        assert!(notes(&["--sensor", "hd"]).is_empty(), "a log pixel");
        let hd = ["--sensor", "hd", "--pixel", "physical"];
        let assumed = notes(&hd);
        assert_eq!(assumed.len(), 1, "{assumed:?}");
        assert!(assumed[0].contains("an intensity of 1 is 100 focal-plane lux"), "{assumed:?}");
        assert!(assumed[0].contains("--lux-per-unit") && assumed[0].contains("--f-number"), "{assumed:?}");
        for given in [&["--lux-per-unit", "100"][..], &["--scene-unit", "luminance", "--f-number", "2"]] {
            assert!(notes(&[&hd[..], given].concat()).is_empty(), "{given:?}");
        }
    }

    #[test]
    fn a_sensor_file_states_the_light_or_does_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        for (light, expected) in [("", 1), ("lux_per_unit = 100.0\n", 0)] {
            std::fs::write(&path, format!("name = \"mine\"\npixel = \"physical\"\n{light}")).unwrap();
            assert_eq!(notes(&["--sensor", path.to_str().unwrap()]).len(), expected, "{light}");
        }
    }

    #[test]
    fn numbers_that_were_fitted_to_nothing_are_told() {
        let vga = notes(&["--sensor", "vga", "--pixel", "physical", "--lux-per-unit", "10"]);
        assert_eq!(vga.len(), 1, "{vga:?}");
        assert!(
            vga[0].contains("`vga` is fitted to no measurement") && vga[0].contains("dark_lux"),
            "{vga:?}"
        );
    }
}
