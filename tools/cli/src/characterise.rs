//! `esaac characterise`: what a laboratory would measure of a sensor.

use crate::arguments::CommonArguments;
use crate::outcome::Outcome;
use crate::sensor_flags::sensor_file;
use crate::whole_argument::whole;
use crate::{device_choice, output_file};
use anyhow::Result;
use esaac_benches::characterise::{Characterisation, Lab, characterise, document};
use esaac_model::SensorModel;
use esaac_model::presets::preset_with_physical_pixel;
use std::path::{Path, PathBuf};

/// Arguments of `characterise`.
#[derive(clap::Args, Clone, Debug)]
pub struct CharacteriseArguments {
    /// Preset, taken with its physical pixel, or a sensor file
    #[arg(value_name = "NAME|FILE.toml")]
    pub sensor: String,
    /// Folder for characterisation.json, characterisation.md and the plots
    #[arg(long, value_name = "DIR", default_value = "characterisation")]
    pub out: PathBuf,
    /// Pixels for each level of light, of S-curves and noise
    #[arg(long, value_name = "COUNT", default_value_t = 128, value_parser = whole(8, 4096), allow_negative_numbers = true)]
    pub pixels: u32,
    /// Time after which noise is counted, whole seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 20, value_parser = whole(0, 3600), allow_negative_numbers = true)]
    pub burn_in: u32,
    /// Time for which noise is counted, whole seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 40, value_parser = whole(1, 3600), allow_negative_numbers = true)]
    pub seconds: u32,
}

/// Runs the command.
pub fn run(arguments: &CharacteriseArguments, common: &CommonArguments) -> Result<Outcome> {
    let sensor = sensor(&arguments.sensor)?;
    let out = &arguments.out;
    output_file::make_folder(out)?;
    let device = device_choice::open(common)?;
    let lab = Lab::new(&device, arguments.pixels, arguments.burn_in, arguments.seconds);
    let measured = characterise(&lab, &sensor)?;
    device_choice::check_validation(&device)?;
    write(&measured, out, common.json)
}

/// A preset with its physical pixel, or the sensor of a file.
pub(crate) fn sensor(named: &str) -> Result<SensorModel> {
    match preset_with_physical_pixel(named) {
        Some(sensor) => Ok(sensor),
        None => Ok(sensor_file(named, Path::new(""))?.0),
    }
}

fn write(measured: &Characterisation, out: &Path, json: bool) -> Result<Outcome> {
    let document = document(measured)?;
    let figures = serde_json::to_string_pretty(measured)? + "\n";
    let mut files = vec![
        ("characterisation.json".to_owned(), figures.clone()),
        ("characterisation.md".to_owned(), document.markdown()),
    ];
    files.extend(document.plots().cloned());
    let mut written = Vec::new();
    for (name, text) in files {
        let path = out.join(name);
        output_file::write(&path, |file| Ok(file.write_all(text.as_bytes())?))?;
        written.push(path.display().to_string());
    }
    if json {
        return Ok(Outcome::complete(figures));
    }
    Ok(Outcome::complete(format!("{}\nFiles: {}\n", document.markdown(), written.join(", "))))
}
