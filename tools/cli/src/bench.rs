//! `esaac bench`: the laboratory.

use crate::arguments::CommonArguments;
use crate::device_choice;
use crate::outcome::Outcome;
use anyhow::{Context, Result};
use esaac_benches::{Laboratory, Options, Part, laboratory};
use std::path::PathBuf;

/// Arguments of `bench`.
#[derive(clap::Args, Clone, Debug)]
pub struct BenchArguments {
    /// Part to run; may be given several times [default: all]
    #[arg(long = "part", value_enum, value_name = "NAME")]
    pub parts: Vec<Part>,
    /// Less of everything: ends in five minutes on a software driver
    #[arg(long)]
    pub quick: bool,
    /// Only rows whose name contains this (parts `time`, `frontier`; sweeps of `scale`)
    #[arg(long, value_name = "TEXT", default_value = "")]
    pub only: String,
    /// Folder for bench.json, bench.md and the plots
    #[arg(long, value_name = "DIR", default_value = "bench")]
    pub out: PathBuf,
    /// Folder of the path-traced sequence
    #[arg(long, value_name = "DIR", default_value_os_t = Options::default().tumble)]
    pub tumble: PathBuf,
    /// Recording of a real sensor
    #[arg(long, value_name = "FILE.aedat4", default_value_os_t = Options::default().recording)]
    pub recording: PathBuf,
}

/// Runs the command.
pub fn run(arguments: &BenchArguments, common: &CommonArguments) -> Result<Outcome> {
    let out = &arguments.out;
    std::fs::create_dir_all(out).with_context(|| format!("cannot make folder {}", out.display()))?;
    let options = Options {
        quick: arguments.quick,
        parts: arguments.parts.clone(),
        only: arguments.only.clone(),
        tumble: arguments.tumble.clone(),
        recording: arguments.recording.clone(),
    };
    let laboratory = Laboratory::new(device_choice::open(common)?, options)?;
    let mut files = Vec::new();
    let report = esaac_benches::run(&laboratory, |report| {
        files = esaac_benches::write(report, out)?;
        Ok(())
    })?;
    if common.json {
        return Ok(Outcome::complete(serde_json::to_string_pretty(&report)? + "\n"));
    }
    let list: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
    Ok(Outcome::complete(format!("{}\nFiles: {}\n", laboratory::markdown(&report), list.join(", "))))
}
