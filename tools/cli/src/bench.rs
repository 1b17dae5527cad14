//! `esaac bench`: the laboratory.

use crate::arguments::CommonArguments;
use crate::outcome::Outcome;
use crate::version::Build;
use crate::{device_choice, output_file};
use anyhow::Result;
use clap::builder::{PathBufValueParser, TypedValueParser};
use esaac_benches::results::{self, Provenance};
use esaac_benches::{Laboratory, Options, Part, markdown};
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
    /// Only rows whose name contains this (parts `frontier`, `time`, `readout`, `encode`; sweeps of `scale`)
    #[arg(long, value_name = "TEXT", default_value = "")]
    pub only: String,
    /// Folder for bench.json, bench.md and the plots
    #[arg(long, value_name = "DIR", default_value = "bench")]
    pub out: PathBuf,
    /// Results file that takes the figures too, into the section of this device; other sections stay
    #[arg(long, value_name = "FILE.md", value_parser = PathBufValueParser::new().try_map(page))]
    pub write_results: Option<PathBuf>,
    /// Folder of a rendered sequence with its true events, like tests/data/tumble
    #[arg(long, value_name = "DIR")]
    pub sequence: Option<PathBuf>,
    /// Recording of a real sensor, for part `real-sensor`
    #[arg(long, value_name = "FILE.aedat4")]
    pub recording: Option<PathBuf>,
}

/// Figures go into a file that is there already: another ending could be that of anything.
fn page(path: PathBuf) -> Result<PathBuf, String> {
    match path.extension().is_some_and(|ending| ending == "md") {
        true => Ok(path),
        false => Err("expected a name that ends in .md".to_owned()),
    }
}

/// Runs the command.
pub fn run(arguments: &BenchArguments, common: &CommonArguments) -> Result<Outcome> {
    let out = &arguments.out;
    output_file::make_folder(out)?;
    let options = Options {
        quick: arguments.quick,
        parts: arguments.parts.clone(),
        only: arguments.only.clone(),
        sequence: arguments.sequence.clone(),
        recording: arguments.recording.clone(),
    };
    let laboratory = Laboratory::new(device_choice::open(common)?, options)?;
    let provenance = Provenance::now(&command(arguments), Build::this().commit);
    let mut files = Vec::new();
    let report = esaac_benches::run(&laboratory, |report| {
        files = esaac_benches::write(report, out)?;
        if let Some(path) = &arguments.write_results {
            files.extend(results::write(report, path, &provenance)?);
        }
        Ok(())
    })?;
    if common.json {
        return Ok(Outcome::complete(serde_json::to_string_pretty(&report)? + "\n"));
    }
    let list: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
    Ok(Outcome::complete(format!("{}\nFiles: {}\n", markdown(&report), list.join(", "))))
}

/// The command that measures the same again, on the device that the results name.
fn command(arguments: &BenchArguments) -> String {
    let mut words = vec!["esaac bench".to_owned()];
    let parts = arguments.parts.iter().map(|part| format!("--part {}", part.name()));
    words.extend(parts);
    words.extend(arguments.quick.then(|| "--quick".to_owned()));
    words.extend((!arguments.only.is_empty()).then(|| format!("--only {}", arguments.only)));
    let path = |flag: &str, path: &Option<PathBuf>| path.as_ref().map(|p| format!("{flag} {}", p.display()));
    words.extend(path("--sequence", &arguments.sequence));
    words.extend(path("--recording", &arguments.recording));
    words.join(" ")
}
