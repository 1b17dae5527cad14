//! `esaac sensors`: lists the presets and every parameter, or those of a sensor file.

use crate::outcome::Outcome;
use crate::sensor_flags::{flag, sensor_file};
use crate::table;
use crate::unread_flags::{is_changed, why_unread};
use anyhow::{Context, Result, ensure};
use esaac_model::physical::{PhysicalPreset, Sourced, assumed_note, physical_preset};
use esaac_model::presets::{preset, preset_with_physical_pixel};
use esaac_model::{PARAMETERS, PRESETS, Pixel, SensorModel};
use serde::Serialize;
use std::path::Path;

/// Arguments of `sensors`.
#[derive(clap::Args, Clone, Debug)]
pub struct SensorsArguments {
    /// Show this preset or sensor file only
    #[arg(value_name = "NAME|FILE.toml")]
    pub name: Option<String>,
    /// Print it as a sensor file that you can edit, with every parameter
    #[arg(long, requires = "name")]
    pub toml: bool,
    /// Show the presets with this pixel [default: log; of a file, its own]
    #[arg(long, value_parser = pixel_named, value_name = "log|physical")]
    pub pixel: Option<Pixel>,
}

pub(crate) fn pixel_named(name: &str) -> Result<Pixel, String> {
    match name {
        "log" => Ok(Pixel::Log),
        "physical" => Ok(Pixel::Physical),
        _ => Err("expected log or physical".to_owned()),
    }
}

/// Where a number of a physical pixel comes from.
#[derive(Serialize)]
struct SourceRow {
    parameter: &'static str,
    value: f64,
    assumed: bool,
    source: &'static str,
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
    name: String,
    about: String,
    parameters: SensorModel,
    /// What a user of a file should know of it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    notes: Vec<String>,
    /// Sources of the physical pixel's numbers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    sources: Vec<SourceRow>,
}

#[derive(Serialize)]
struct Listing {
    presets: Vec<PresetRow>,
    parameters: Vec<ParameterRow>,
}

/// Runs the command.
pub fn run(arguments: &SensorsArguments, json: bool) -> Result<Outcome> {
    let listing = listing(arguments.name.as_deref(), arguments.pixel)?;
    ensure!(!(arguments.toml && json), "--toml and --json are given, expected one of them");
    if arguments.toml {
        return Ok(Outcome::complete(annotated_toml(&listing)));
    }
    if json {
        return Ok(Outcome::complete(serde_json::to_string_pretty(&listing)? + "\n"));
    }
    Ok(Outcome::complete(text(&listing)))
}

fn listing(name: Option<&str>, pixel: Option<Pixel>) -> Result<Listing> {
    let row = |name: &str, about: &str| {
        let (parameters, sources) = match pixel {
            None | Some(Pixel::Log) => (preset(name), Vec::new()),
            Some(Pixel::Physical) => {
                (preset_with_physical_pixel(name), sources(physical_preset(name).expect("listed")))
            }
        };
        PresetRow {
            name: name.to_owned(),
            about: about.to_owned(),
            parameters: parameters.expect("listed"),
            notes: Vec::new(),
            sources,
        }
    };
    let mut presets: Vec<PresetRow> = PRESETS
        .iter()
        .filter(|p| name.is_none_or(|name| name == p.name))
        .map(|p| row(p.name, p.about))
        .collect();
    if let (Some(name), true) = (name, presets.is_empty()) {
        presets.push(of_file(name, pixel)?);
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

/// The sensor of a file, with the pixel that is named if there is one, and what of the file does nothing or is assumed.
fn of_file(name: &str, pixel: Option<Pixel>) -> Result<PresetRow> {
    let (sensor, keys) = sensor_file(name, Path::new(""))?;
    let pixel = pixel.unwrap_or(sensor.pixel);
    let sensor = sensor.with_pixel(pixel);
    // What the other pixel was given may not do for this one.
    sensor.validate().with_context(|| name.to_owned())?;
    // A file that `--toml` has printed has every key.
    let changed = keys.keys().filter(|key| is_changed(key, &sensor));
    let unread =
        changed.filter_map(|key| Some(format!("`{key}` does nothing: {}", why_unread(key, &sensor)?)));
    let notes = unread.chain(assumed_note(&sensor)).collect();
    let about = format!("sensor file {name}");
    Ok(PresetRow { name: sensor.name.clone(), about, parameters: sensor, notes, sources: Vec::new() })
}

/// The numbers of a physical pixel and its bus, and where they come from.
fn sources(preset: &PhysicalPreset) -> Vec<SourceRow> {
    let row =
        |(parameter, Sourced { value, assumed, source })| SourceRow { parameter, value, assumed, source };
    preset.numbers().map(row).into()
}

fn sources_text(preset: &PresetRow) -> String {
    let mut rows = vec![["parameter", "value", "", "source"].map(str::to_owned).to_vec()];
    rows.extend(preset.sources.iter().map(|row| {
        let assumed = if row.assumed { "assumed" } else { "" };
        vec![row.parameter.to_owned(), row.value.to_string(), assumed.to_owned(), row.source.to_owned()]
    }));
    let fit = physical_preset(&preset.name).expect("it has sources").fit();
    format!("\nThe physical pixel of {}:\n\n{}\n{fit}\n", preset.name, table::render(&rows))
}

fn text(listing: &Listing) -> String {
    let mut presets = vec![["sensor", "width px", "height px", "about"].map(str::to_owned).to_vec()];
    presets.extend(listing.presets.iter().map(|p| {
        let size = [p.parameters.width.to_string(), p.parameters.height.to_string()];
        [vec![p.name.clone()], size.to_vec(), vec![p.about.clone()]].concat()
    }));
    let mut parameters = vec![["flag", "default", "unit", "meaning"].map(str::to_owned).to_vec()];
    parameters.extend(listing.parameters.iter().map(|p| {
        vec![format!("--{}", flag(p.name)), plain(&p.default), p.unit.to_owned(), p.about.to_owned()]
    }));
    let with_sources = listing.presets.iter().filter(|preset| !preset.sources.is_empty());
    let sources: String = with_sources.map(sources_text).collect();
    let notes = listing.presets.iter().flat_map(|preset| &preset.notes);
    let notes: String = notes.map(|note| format!("\nnote: {note}\n")).collect();
    format!(
        "{}\nEvery parameter is a flag and a key of a sensor file (`esaac sensors NAME --toml`).\n\n{}{sources}{notes}",
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
            let text = annotated_toml(&listing(Some(p.name), Some(Pixel::Log)).unwrap());
            assert_eq!(SensorModel::from_toml(&text), Ok(preset(p.name).unwrap()), "{text}");
            let text = annotated_toml(&listing(Some(p.name), Some(Pixel::Physical)).unwrap());
            let expected = preset_with_physical_pixel(p.name).unwrap();
            assert_eq!(SensorModel::from_toml(&text), Ok(expected), "{text}");
        }
    }

    #[test]
    fn every_number_of_a_physical_pixel_has_a_source() {
        for preset in listing(None, Some(Pixel::Physical)).unwrap().presets {
            let values = toml::Table::try_from(&preset.parameters).unwrap();
            for row in &preset.sources {
                let value = &values[row.parameter];
                let value = value.as_float().or(value.as_integer().map(|value| value as f64));
                assert!((value.unwrap() - row.value).abs() < 1e-9, "{} {}", preset.name, row.parameter);
            }
            let text = sources_text(&preset);
            assert!(text.contains("assumed"), "{}", preset.name);
            let fit = if preset.name == "hd" { "at 0.15 to 20 focal-plane lux" } else { "to no measurement" };
            assert!(
                text.contains(&format!("The noise of `{}` is fitted", preset.name)) && text.contains(fit),
                "{text}"
            );
        }
    }

    #[test]
    fn the_table_shows_every_preset_and_parameter() {
        let text = text(&listing(None, None).unwrap());
        for name in PRESETS.iter().map(|p| p.name) {
            assert!(text.contains(name), "{name}");
        }
        for parameter in PARAMETERS {
            assert!(text.contains(parameter.about), "{}", parameter.name);
        }
    }
}
