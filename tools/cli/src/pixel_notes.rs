//! What is assumed of a physical pixel and its light, for the report.

use crate::sensor_flags::ResolvedSensor;
use esaac_model::Pixel;
use esaac_model::physical::assumed_note;

/// The notes on a sensor; none on a log-intensity pixel.
#[must_use]
pub fn of(resolved: &ResolvedSensor) -> Vec<String> {
    let sensor = &resolved.sensor;
    let of_light = (sensor.pixel == Pixel::Physical && !resolved.light_is_given).then(|| {
        format!(
            "Assumed: an intensity of 1 is {} focal-plane lux. Say what it is by --lux-per-unit, or by --scene-unit and \
             --f-number",
            sensor.lux_per_unit
        )
    });
    of_light.into_iter().chain(assumed_note(sensor)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::tests::simulate;
    use esaac_model::SensorModel;

    fn notes(flags: &[&str]) -> Vec<String> {
        of(&simulate(flags).sensor.resolve(SensorModel::default()).unwrap())
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
