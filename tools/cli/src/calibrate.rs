//! `esaac calibrate`: a sensor file from a recording of a real sensor.

use crate::arguments::CommonArguments;
use crate::outcome::Outcome;
use crate::{device_choice, output_file};
use anyhow::{Result, ensure};
use esaac_calibrate::{Fit, fit};
use esaac_formats::recording::aedat4;
use esaac_model::presets::LOG_OFFSET_HDR;
use std::path::PathBuf;

/// Arguments of `calibrate`.
#[derive(clap::Args, Clone, Debug)]
pub struct CalibrateArguments {
    /// Recording with events and APS frames
    #[arg(value_name = "FILE.aedat4")]
    pub recording: PathBuf,
    /// Sensor file to write; `--sensor` takes it
    #[arg(long, value_name = "FILE.toml", default_value = "calibrated.toml")]
    pub out: PathBuf,
    /// Dark level, as a share of the frames' full scale
    #[arg(long, value_name = "SHARE", default_value_t = LOG_OFFSET_HDR)]
    pub log_offset: f64,
}

/// Runs the command.
pub fn run(arguments: &CalibrateArguments, common: &CommonArguments) -> Result<Outcome> {
    ensure!(
        (1e-6..=1.0).contains(&arguments.log_offset),
        "--log-offset is {}, expected 1e-6 to 1",
        arguments.log_offset
    );
    output_file::check(&arguments.out)?;
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
    output_file::write(&arguments.out, |out| Ok(out.write_all((head + &fit.sensor.to_toml()).as_bytes())?))?;
    if common.json {
        return Ok(Outcome::complete(serde_json::to_string_pretty(&fit)? + "\n"));
    }
    Ok(Outcome::complete(text(&fit) + &format!("written to {}\n", arguments.out.display())))
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
