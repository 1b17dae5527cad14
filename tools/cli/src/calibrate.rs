//! `esaac calibrate`: a sensor file from recordings of a real sensor.

use crate::arguments::CommonArguments;
use crate::outcome::Outcome;
use crate::sensors::pixel_named;
use crate::{characterise, device_choice, output_file, stderr};
use anyhow::{Result, bail, ensure};
use esaac_calibrate::physical::{PhysicalFit, SecondPole, fit_physical, fit_scene, read_exposures};
use esaac_calibrate::{Fit, fit};
use esaac_formats::recording::aedat4;
use esaac_model::presets::LOG_OFFSET_HDR;
use esaac_model::{Pixel, SensorModel};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::{Path, PathBuf};

/// Arguments of `calibrate`.
#[derive(clap::Args, Clone, Debug)]
pub struct CalibrateArguments {
    /// Recording with events and APS frames, for a log-intensity pixel; or a list of recordings (.aedat4, .npz, .raw) under
    /// known light, for a physical one
    #[arg(value_name = "FILE.aedat4|LIST.toml")]
    pub recording: PathBuf,
    /// Sensor file to write; `--sensor` takes it
    #[arg(long, value_name = "FILE.toml", default_value = "calibrated.toml")]
    pub out: PathBuf,
    /// Dark level, as a share of the frames' full scale (log-intensity pixel)
    #[arg(long, value_name = "SHARE", default_value_t = LOG_OFFSET_HDR, allow_negative_numbers = true)]
    pub log_offset: f64,
    /// Pixel to fit [default: what the file is for]
    #[arg(long, value_parser = pixel_named, value_name = "log|physical")]
    pub pixel: Option<Pixel>,
    /// Focal-plane light of the frames' full scale, lux, for a physical pixel from a recording with APS frames
    #[arg(long, value_name = "LUX", allow_negative_numbers = true)]
    pub white_lux: Option<f64>,
    /// First guess of a physical pixel, at which the search begins
    #[arg(long, value_name = "NAME|FILE.toml", default_value = "hd")]
    pub guess: String,
}

/// Runs the command.
pub fn run(arguments: &CalibrateArguments, common: &CommonArguments) -> Result<Outcome> {
    ensure!(
        (1e-6..=1.0).contains(&arguments.log_offset),
        "--log-offset is {}, expected 1e-6 to 1",
        arguments.log_offset
    );
    let what = what(arguments)?;
    output_file::check_sensor(&arguments.out)?;
    output_file::check_apart(&[&arguments.out], &[&arguments.recording, Path::new(&arguments.guess)])?;
    if arguments.white_lux.is_some() && !matches!(what, What::PhysicalScene { .. }) {
        stderr::line(
            "warning: --white-lux does nothing: it is for a physical pixel from a recording with APS frames",
        );
    }
    match what {
        What::Scene => log(arguments, common),
        What::PhysicalScene { white_lux } => scene(arguments, common, white_lux),
        What::Exposures => physical(arguments, common),
    }
}

/// What is fitted to what.
#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    /// A log-intensity pixel to a scene with APS frames.
    Scene,
    /// A physical pixel to the same.
    PhysicalScene { white_lux: f64 },
    /// A physical pixel to recordings under known light.
    Exposures,
}

fn what(arguments: &CalibrateArguments) -> Result<What> {
    let file = arguments.recording.display();
    let ends_in = |ending| arguments.recording.extension().is_some_and(|extension| extension == ending);
    let is_list = ends_in("toml");
    ensure!(
        !["raw", "npz"].iter().any(|&ending| ends_in(ending)),
        "{file} has no APS frames; expected a recording with them (.aedat4), or a list (.toml) that says under which light \
         such recordings were made"
    );
    match (is_list, arguments.pixel) {
        (true, Some(Pixel::Log)) => {
            bail!(
                "{file} is a list of known light; a log-intensity pixel needs a scene with APS frames (.aedat4)"
            )
        }
        (true, _) => Ok(What::Exposures),
        (false, Some(Pixel::Physical)) => match arguments.white_lux {
            Some(white_lux) if (1e-6..=1e6).contains(&white_lux) => Ok(What::PhysicalScene { white_lux }),
            Some(white_lux) => bail!("--white-lux is {white_lux}, expected 1e-6 to 1e6"),
            None => bail!(
                "{file} states no light; a physical pixel needs --white-lux, or a list of recordings under known light \
                 (.toml)"
            ),
        },
        (false, _) => Ok(What::Scene),
    }
}

fn scene(arguments: &CalibrateArguments, common: &CommonArguments, white_lux: f64) -> Result<Outcome> {
    let recording = aedat4::read(&arguments.recording)?;
    let guess = SensorModel { lux_per_unit: white_lux, ..characterise::sensor(&arguments.guess)? };
    let device = device_choice::open(common)?;
    let sensor = fit_scene(&device, &recording, arguments.log_offset, &guess)?;
    device_choice::check_validation(&device)?;
    let head = format!(
        "# Fitted by `esaac calibrate` to {} ({}), full scale taken as {white_lux} lux.\n",
        arguments.recording.file_name().unwrap_or_default().display(),
        recording.name
    );
    let text = format!(
        "contrast_on         {:.3} log\ncontrast_off        {:.3} log\ncontrast_mismatch   {:.3} log\n\
         refractory_ns       {}\nthe rest is that of {}\n",
        sensor.contrast_on,
        sensor.contrast_off,
        sensor.contrast_mismatch,
        sensor.refractory_ns,
        arguments.guess
    );
    let json = serde_json::to_string_pretty(&sensor)?;
    written(arguments, common, (head, &sensor), (json, text))
}

fn log(arguments: &CalibrateArguments, common: &CommonArguments) -> Result<Outcome> {
    let recording = aedat4::read(&arguments.recording)?;
    let device = device_choice::open(common)?;
    let fit = fit(&device, &recording, arguments.log_offset)?;
    device_choice::check_validation(&device)?;
    let head = format!(
        "# Fitted by `esaac calibrate` to {} ({}): {} events, {} APS frames.\n",
        arguments.recording.file_name().unwrap_or_default().display(),
        recording.name,
        recording.events.len(),
        recording.frames.len()
    );
    let json = serde_json::to_string_pretty(&fit)?;
    written(arguments, common, (head, &fit.sensor), (json, text(&fit)))
}

fn physical(arguments: &CalibrateArguments, common: &CommonArguments) -> Result<Outcome> {
    let exposures = read_exposures(&arguments.recording)?;
    let guess = characterise::sensor(&arguments.guess)?;
    let device = device_choice::open(common)?;
    let style = ProgressStyle::with_template("fit {bar:40} {pos}/{len} rounds, {eta} left")?;
    let progress = ProgressBar::no_length().with_style(style);
    let mut fit = fit_physical(&device, &exposures, &guess, |round, rounds| {
        progress.set_length(rounds as u64);
        progress.set_position(round as u64);
    })?;
    progress.finish_and_clear();
    device_choice::check_validation(&device)?;
    fit.sensor.name = "calibrated".to_owned();
    let head = format!(
        "# Fitted by `esaac calibrate` to the {} recordings of {}.\n",
        exposures.all.len(),
        arguments.recording.file_name().unwrap_or_default().display()
    );
    let json = serde_json::to_string_pretty(&fit)?;
    written(arguments, common, (head, &fit.sensor), (json, physical_text(&fit)))
}

fn written(
    arguments: &CalibrateArguments,
    common: &CommonArguments,
    (head, sensor): (String, &SensorModel),
    (json, text): (String, String),
) -> Result<Outcome> {
    output_file::write(&arguments.out, |out| Ok(out.write_all((head + &sensor.to_toml()).as_bytes())?))?;
    if common.json {
        return Ok(Outcome::complete(json + "\n"));
    }
    Ok(Outcome::complete(text + &format!("written to {}\n", arguments.out.display())))
}

fn physical_text(fit: &PhysicalFit) -> String {
    let s = &fit.sensor;
    let mut text = String::new();
    for (name, value, unit) in [
        ("contrast_on", s.contrast_on, "log"),
        ("contrast_off", s.contrast_off, "log"),
        ("contrast_mismatch", s.contrast_mismatch, "log"),
        ("refractory_ns", f64::from(s.refractory_ns), "ns"),
        ("response_e_per_lux_s", s.response_e_per_lux_s, "e/s/lux"),
        ("photoreceptor_charge_e", s.photoreceptor_charge_e, "e"),
        ("second_pole_hz", s.second_pole_hz, "Hz"),
        ("dark_lux", s.dark_lux, "lux"),
        ("leak_rate_hz", s.leak_rate_hz, "Hz"),
    ] {
        let range = if name == "second_pole_hz" { second_pole_range(fit.second_pole) } else { String::new() };
        text.push_str(&format!("{name:24} {value:.4} {unit}{range}\n"));
    }
    text.push_str("\nevents of a pixel and second (of a period, if it flickers), recorded and simulated:\n");
    for of in &fit.exposures {
        let light = match of.flicker {
            Some(flicker) => format!("{} lux, {} Hz", of.lux, flicker.hz),
            None => format!("{} lux", of.lux),
        };
        text.push_str(&format!(
            "{:24} {light:20} ON {:.3} and {:.3}, OFF {:.3} and {:.3}\n",
            of.name, of.recorded.on, of.simulated.on, of.recorded.off, of.simulated.off
        ));
    }
    text.push_str(&format!("differences over their errors: {:.2}\n", fit.misfit));
    for remark in &fit.remarks {
        text.push_str(&format!("note: {remark}\n"));
    }
    text
}

/// How well the recordings tell the second pole, after its value.
fn second_pole_range(pole: SecondPole) -> String {
    match (pole.least_hz, pole.most_hz) {
        (Some(least_hz), Some(most_hz)) => format!(" (95%: {least_hz:.0} to {most_hz:.0} Hz)"),
        (Some(least_hz), None) => format!(" (not determined: at least {least_hz:.0} Hz)"),
        (None, Some(most_hz)) => format!(" (not determined: at most {most_hz:.0} Hz)"),
        (None, None) => " (not determined)".to_owned(),
    }
}

fn text(fit: &Fit) -> String {
    let s = &fit.sensor;
    let mut text = format!(
        "contrast_on         {:.3} log\ncontrast_off        {:.3} log\ncontrast_mismatch   {:.3} log\n\
         leak_rate_hz        {:.3} Hz\nshot_noise_rate_hz  {:.3} Hz\n",
        s.contrast_on, s.contrast_off, s.contrast_mismatch, s.leak_rate_hz, s.shot_noise_rate_hz
    );
    text.push_str(&format!(
        "from {} changes of pixels from frame to frame (correlation {:.3}) and {:.0} pixel-seconds that stand \
         still\n",
        fit.uncorrected.samples, fit.uncorrected.correlation, fit.still.pixel_s
    ));
    for remark in &fit.remarks {
        text.push_str(&format!("note: {remark}\n"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arguments(file: &str, pixel: Option<Pixel>, white_lux: Option<f64>) -> CalibrateArguments {
        let (recording, out) = (file.into(), "a.toml".into());
        CalibrateArguments { recording, out, log_offset: 0.01, pixel, white_lux, guess: "hd".into() }
    }

    #[test]
    fn a_second_pole_that_is_not_determined_is_not_shown_as_if_it_were() {
        let range = |least_hz, most_hz| second_pole_range(SecondPole { least_hz, most_hz });
        assert_eq!(range(Some(450.0), Some(560.0)), " (95%: 450 to 560 Hz)");
        assert_eq!(range(Some(450.0), None), " (not determined: at least 450 Hz)");
        assert_eq!(range(None, Some(560.0)), " (not determined: at most 560 Hz)");
        assert_eq!(range(None, None), " (not determined)");
    }

    #[test]
    fn the_file_says_what_is_fitted_and_a_pixel_that_does_not_fit_it_is_refused() {
        let choice = |file, pixel, white_lux| what(&arguments(file, pixel, white_lux));
        assert_eq!(choice("a.aedat4", None, None).unwrap(), What::Scene);
        assert_eq!(choice("a.toml", None, None).unwrap(), What::Exposures);
        let lit = choice("a.aedat4", Some(Pixel::Physical), Some(100.0)).unwrap();
        assert_eq!(lit, What::PhysicalScene { white_lux: 100.0 });
        let refused = |file, pixel, white_lux| choice(file, Some(pixel), white_lux).unwrap_err().to_string();
        assert!(refused("a.aedat4", Pixel::Physical, None).contains("a.aedat4 states no light"));
        assert!(refused("a.aedat4", Pixel::Physical, Some(-1.0)).contains("--white-lux is -1"));
        assert!(refused("a.toml", Pixel::Log, None).contains("needs a scene"));
        for file in ["a.raw", "a.npz"] {
            assert!(
                choice(file, None, None).unwrap_err().to_string().contains("has no APS frames; expected")
            );
        }
    }
}
