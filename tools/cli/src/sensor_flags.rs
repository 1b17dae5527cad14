//! Command-line flags for sensor parameters, generated from the model's list.

use crate::scene_light::{SCENE_LIGHT, SceneLight};
use crate::sensor_base::with_changes;
use anyhow::{Context, Result, bail};
use clap::builder::PossibleValue;
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, ValueEnum};
use esaac_model::presets::preset;
use esaac_model::{PARAMETERS, PRESETS, Profile, SensorModel};
use std::path::Path;

/// The flags `--sensor`, `--profile` and one for each parameter, as given.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SensorFlags {
    /// Preset name or TOML file.
    pub sensor: Option<String>,
    /// Profile that overrides parts of the sensor.
    pub profile: Option<ProfileName>,
    /// Parameters given as flags, in the model's order.
    pub explicit: Vec<(&'static str, String)>,
    /// What the frames' unit and the lens are, from which `lux_per_unit` follows.
    pub light: SceneLight,
}

/// [`Profile`] as a flag's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProfileName(pub Profile);

/// A sensor, and what its size follows from.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedSensor {
    /// The sensor. It is not validated yet, because its size may follow from the frames.
    pub sensor: SensorModel,
    /// What fixed width and height, if anything did.
    pub size_from: Option<String>,
    /// Whether flags or a file say what `lux_per_unit` is. Else it is an assumption.
    pub light_is_given: bool,
    /// The keys of the sensor file, if there is one.
    pub file_keys: toml::Table,
}

impl SensorFlags {
    /// Applies preset or file, then the profile, then the parameters' flags. Without `--sensor` it starts
    /// with `default`, whose size counts as no choice. `--pixel` takes that pixel's numbers of the preset that the
    /// sensor is named after ([`SensorModel::with_pixel`]).
    pub fn resolve(&self, default: SensorModel) -> Result<ResolvedSensor> {
        let (base, size_from, file_keys) = match &self.sensor {
            None => (default, None, toml::Table::new()),
            Some(given) => named_sensor(given)?,
        };
        let profile = self.profile.map(|ProfileName(profile)| profile);
        let mut sensor = with_changes(base, profile, &self.explicit)?;
        let given = |name: &str| self.explicit.iter().any(|(parameter, _)| *parameter == name);
        let size_from = match (given("width"), given("height")) {
            (false, false) => size_from,
            (true, true) => Some("a sensor with --width and --height".to_owned()),
            (true, false) => Some("a sensor with --width but its own height".to_owned()),
            (false, true) => Some("a sensor with --height but its own width".to_owned()),
        };
        let has_unit = self.light.apply(&mut sensor, given("lux_per_unit"))?;
        let light_is_given = has_unit || given("lux_per_unit") || file_keys.contains_key("lux_per_unit");
        Ok(ResolvedSensor { sensor, size_from, light_is_given, file_keys })
    }
}

/// A preset or the sensor of a file, what fixes its size, and the file's keys.
fn named_sensor(given: &str) -> Result<(SensorModel, Option<String>, toml::Table)> {
    if let Some(sensor) = preset(given) {
        let size_from = Some(format!("--sensor {given}"));
        return Ok((sensor, size_from, toml::Table::new()));
    }
    let (sensor, keys) = sensor_file(given, Path::new(""))?;
    let sized = keys.contains_key("width") || keys.contains_key("height");
    let size_from = sized.then(|| format!("sensor file {given}"));
    Ok((sensor, size_from, keys))
}

/// The sensor of a file beside others in `folder`, and the keys that the file has. `given` is no preset.
pub(crate) fn sensor_file(given: &str, folder: &Path) -> Result<(SensorModel, toml::Table)> {
    let path = &folder.join(given);
    if !path.exists() && path.extension().is_none_or(|e| e != "toml") {
        let names: Vec<&str> = PRESETS.iter().map(|p| p.name).collect();
        bail!("unknown sensor `{given}`, expected one of {} or a TOML file", names.join(", "));
    }
    let name = path.display();
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read sensor file {name}"))?;
    let sensor = SensorModel::from_toml(&text).with_context(|| name.to_string())?;
    let keys: toml::Table = text.parse().with_context(|| format!("sensor file {name}"))?;
    Ok((sensor, keys))
}

/// The flag of a parameter, without its hyphens in front.
pub(crate) fn flag(parameter: &str) -> String {
    parameter.replace('_', "-")
}

impl Args for SensorFlags {
    fn augment_args(command: Command) -> Command {
        let profile = Arg::new("profile")
            .long("profile")
            .value_name("PROFILE")
            .value_parser(clap::builder::EnumValueParser::<ProfileName>::new())
            .help("Effects of the sensor");
        let sensor =
            Arg::new("sensor").long("sensor").value_name("NAME|FILE.toml").help("Preset or sensor file");
        let parameters = PARAMETERS.iter().map(|parameter| {
            Arg::new(parameter.name)
                .long(flag(parameter.name))
                .value_name(if parameter.unit.is_empty() { "VALUE" } else { parameter.unit })
                .allow_negative_numbers(true)
                .help(parameter.about.trim_end_matches('.'))
        });
        let light = SCENE_LIGHT.map(|(name, value, help)| {
            Arg::new(name).long(flag(name)).value_name(value).allow_negative_numbers(true).help(help)
        });
        let mut command = command;
        for arg in [sensor, profile].into_iter().chain(light).chain(parameters) {
            command = command.arg(arg.help_heading("Sensor"));
        }
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for SensorFlags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let explicit = PARAMETERS
            .iter()
            .filter_map(|p| matches.get_one::<String>(p.name).map(|value| (p.name, value.clone())))
            .collect();
        Ok(SensorFlags {
            sensor: matches.get_one::<String>("sensor").cloned(),
            profile: matches.get_one::<ProfileName>("profile").copied(),
            explicit,
            light: SceneLight {
                values: SCENE_LIGHT.map(|(name, ..)| matches.get_one::<String>(name).cloned()),
                are_flags: true,
            },
        })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl ValueEnum for ProfileName {
    fn value_variants<'a>() -> &'a [Self] {
        &[ProfileName(Profile::Clean), ProfileName(Profile::Noisy), ProfileName(Profile::Paper)]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(match self.0 {
            Profile::Clean => PossibleValue::new("clean").help("no noise, no refractory period, no latency"),
            Profile::Noisy => PossibleValue::new("noisy").help("every effect of the pixels on"),
            Profile::Paper => PossibleValue::new("paper").help("the paper's event model"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Pixel;

    fn parse(arguments: &[&str]) -> SensorFlags {
        let command = SensorFlags::augment_args(Command::new("test").no_binary_name(true));
        SensorFlags::from_arg_matches(&command.get_matches_from(arguments)).unwrap()
    }

    #[test]
    fn flags_override_the_profile_and_the_profile_the_preset() {
        let flags = parse(&["--sensor", "davis240", "--profile", "noisy", "--latency-ns", "7"]);
        let resolved = flags.resolve(SensorModel::default()).unwrap();
        assert_eq!((resolved.sensor.width, resolved.sensor.height), (240, 180));
        assert_eq!((resolved.sensor.latency_ns, resolved.sensor.refractory_ns), (7, 500_000));
        assert_eq!(resolved.size_from.as_deref(), Some("--sensor davis240"));
    }

    #[test]
    fn the_physical_pixel_takes_the_numbers_of_the_preset() {
        let resolve = |arguments: &[&str]| parse(arguments).resolve(SensorModel::default()).map(|r| r.sensor);
        let hd = resolve(&["--sensor", "hd", "--pixel", "physical", "--dark-lux", "0.5"]).unwrap();
        assert_eq!((hd.pixel, hd.refractory_ns, hd.dark_lux), (Pixel::Physical, 79_000, 0.5));
        assert_eq!((hd.noise_gain, hd.response_e_per_lux_s), (1.0, 1.34e5));
        let quiet = resolve(&["--sensor", "hd", "--pixel", "physical", "--profile", "clean"]).unwrap();
        assert_eq!((quiet.pixel, quiet.refractory_ns, quiet.noise_gain), (Pixel::Physical, 0, 0.0));
        let plain = resolve(&["--pixel", "physical", "--leak-rate-hz", "-0.5"]).unwrap();
        assert_eq!((plain.pixel, plain.leak_rate_hz), (Pixel::Physical, -0.5));
        assert_eq!(plain.contrast_on, 0.337, "the default is a preset, too");
        assert!(plain.validate().is_ok());
        assert!(resolve(&["--pixel", "quantum"]).unwrap_err().to_string().contains("pixel"));
    }

    #[test]
    fn a_unit_and_a_lens_give_the_light() {
        let resolve = |arguments: &[&str]| parse(arguments).resolve(SensorModel::default()).map(|r| r.sensor);
        let nits = resolve(&["--scene-unit", "luminance", "--f-number", "2"]).unwrap().lux_per_unit;
        assert!((nits - 0.9 * std::f64::consts::PI / 16.0).abs() < 1e-12, "{nits}");
        let gained = resolve(&["--scene-unit", "luminance", "--f-number", "2", "--exposure-gain", "4"]);
        assert!((gained.unwrap().lux_per_unit - nits / 4.0).abs() < 1e-12, "lux of an intensity");
        let white = resolve(&["--scene-unit", "radiance", "--f-number", "2"]).unwrap().lux_per_unit;
        assert!((white / nits - 270.0).abs() < 1e-9);
        let dim = [
            "--scene-unit",
            "radiance",
            "--f-number",
            "4",
            "--lens-transmission",
            "0.45",
            "--luminous-efficacy",
            "100",
        ];
        assert!((resolve(&dim).unwrap().lux_per_unit / nits - 12.5).abs() < 1e-9);
        for (arguments, parts) in [
            (&["--scene-unit", "luminance"][..], ["without --f-number", "expected both"]),
            (&["--f-number", "2"], ["--f-number is given without --scene-unit", "expected both"]),
            (&["--scene-unit", "nits", "--f-number", "2"], ["`nits`", "radiance"]),
            (&["--scene-unit", "luminance", "--f-number", "-2"], ["F-number is -2", "0.5 to 100"]),
            (&["--scene-unit", "luminance", "--f-number", "wide"], ["--f-number is `wide`", "number"]),
            (
                &["--scene-unit", "radiance", "--f-number", "2", "--luminous-efficacy", "0"],
                ["efficacy is 0", "683"],
            ),
            (
                &["--scene-unit", "luminance", "--f-number", "2", "--luminous-efficacy", "90"],
                ["90 lm/W", "none"],
            ),
            (
                &["--scene-unit", "luminance", "--f-number", "2", "--lux-per-unit", "3"],
                ["expected one", "former"],
            ),
        ] {
            let error = format!("{:#}", resolve(arguments).unwrap_err());
            assert!(parts.iter().all(|part| error.contains(part)), "{arguments:?}: {error}");
        }
    }

    #[test]
    fn every_parameter_has_a_flag() {
        let command = SensorFlags::augment_args(Command::new("test"));
        for parameter in PARAMETERS {
            let long = flag(parameter.name);
            assert!(command.get_arguments().any(|a| a.get_long() == Some(&long)), "{long}");
        }
        command.debug_assert();
    }

    #[test]
    fn a_file_names_its_faults() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.toml");
        let resolve = |text: &str| {
            std::fs::write(&path, text).unwrap();
            parse(&["--sensor", path.to_str().unwrap()]).resolve(SensorModel::default())
        };
        let resolved = resolve("contrast_on = 0.3\n").unwrap();
        assert_eq!((resolved.sensor.contrast_on, resolved.size_from), (0.3, None));
        assert!(resolve("width = 64\nheight = 48\n").unwrap().size_from.unwrap().contains("s.toml"));
        let error = format!("{:#}", resolve("contrast_one = 0.3\n").unwrap_err());
        assert!(error.contains("s.toml") && error.contains("contrast_one"), "{error}");
        let error =
            format!("{:#}", parse(&["--sensor", "davis"]).resolve(SensorModel::default()).unwrap_err());
        assert!(error.contains("davis346"), "{error}");
    }
}
