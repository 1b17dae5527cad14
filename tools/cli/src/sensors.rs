//! `esaac sensors`: lists the presets and every parameter.

use crate::outcome::Outcome;
use crate::table;
use anyhow::{Result, bail};
use esaac_model::presets::preset;
use esaac_model::{PARAMETERS, PRESETS, SensorModel};
use serde::Serialize;

/// Arguments of `sensors`.
#[derive(clap::Args, Clone, Debug)]
pub struct SensorsArguments {
    /// Show this preset only
    pub name: Option<String>,
    /// Print the preset as a sensor file that you can edit
    #[arg(long, requires = "name")]
    pub toml: bool,
}

#[derive(Serialize)]
struct ParameterRow {
    name: &'static str,
    unit: &'static str,
    default: toml::Value,
    about: &'static str,
}

#[derive(Serialize)]
struct PresetRow {
    name: &'static str,
    about: &'static str,
    parameters: SensorModel,
}

#[derive(Serialize)]
struct Listing {
    presets: Vec<PresetRow>,
    parameters: Vec<ParameterRow>,
}

/// Runs the command.
pub fn run(arguments: &SensorsArguments, json: bool) -> Result<Outcome> {
    let listing = listing(arguments.name.as_deref())?;
    if arguments.toml {
        return Ok(Outcome::complete(annotated_toml(&listing)));
    }
    if json {
        return Ok(Outcome::complete(serde_json::to_string_pretty(&listing)? + "\n"));
    }
    Ok(Outcome::complete(text(&listing)))
}

fn listing(name: Option<&str>) -> Result<Listing> {
    let presets: Vec<PresetRow> = PRESETS
        .iter()
        .filter(|p| name.is_none_or(|name| name == p.name))
        .map(|p| PresetRow { name: p.name, about: p.about, parameters: preset(p.name).expect("listed") })
        .collect();
    if presets.is_empty() {
        let names: Vec<&str> = PRESETS.iter().map(|p| p.name).collect();
        bail!("unknown sensor `{}`, expected one of {}", name.unwrap_or_default(), names.join(", "));
    }
    let base = match (name, presets.as_slice()) {
        (Some(_), [only]) => only.parameters.clone(),
        _ => SensorModel::default(),
    };
    let defaults = toml::Table::try_from(&base)?;
    let parameters = PARAMETERS
        .iter()
        .map(|p| ParameterRow {
            name: p.name,
            unit: p.unit,
            default: defaults[p.name].clone(),
            about: p.about,
        })
        .collect();
    Ok(Listing { presets, parameters })
}

fn text(listing: &Listing) -> String {
    let mut presets = vec![["sensor", "width px", "height px", "about"].map(str::to_owned).to_vec()];
    presets.extend(listing.presets.iter().map(|p| {
        let size = [p.parameters.width.to_string(), p.parameters.height.to_string()];
        [vec![p.name.to_owned()], size.to_vec(), vec![p.about.to_owned()]].concat()
    }));
    let mut parameters = vec![["flag", "default", "unit", "meaning"].map(str::to_owned).to_vec()];
    parameters.extend(listing.parameters.iter().map(|p| {
        let flag = format!("--{}", p.name.replace('_', "-"));
        vec![flag, plain(&p.default), p.unit.to_owned(), p.about.to_owned()]
    }));
    format!(
        "{}\nEvery parameter is a flag and a key of a sensor file (`esaac sensors NAME --toml`).\n\n{}",
        table::render(&presets),
        table::render(&parameters)
    )
}

fn plain(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

fn annotated_toml(listing: &Listing) -> String {
    let preset = &listing.presets[0];
    let mut text = format!("# {}\n", preset.about);
    for parameter in &listing.parameters {
        let unit = if parameter.unit.is_empty() { String::new() } else { format!(" [{}]", parameter.unit) };
        text.push_str(&format!(
            "\n# {}{unit}\n{} = {}\n",
            parameter.about, parameter.name, parameter.default
        ));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_printed_file_is_the_preset() {
        for p in PRESETS {
            let text = annotated_toml(&listing(Some(p.name)).unwrap());
            assert_eq!(SensorModel::from_toml(&text), Ok(preset(p.name).unwrap()), "{text}");
        }
    }

    #[test]
    fn the_table_shows_every_preset_and_parameter() {
        let text = text(&listing(None).unwrap());
        for name in PRESETS.iter().map(|p| p.name) {
            assert!(text.contains(name), "{name}");
        }
        for parameter in PARAMETERS {
            assert!(text.contains(parameter.about), "{}", parameter.name);
        }
    }
}
