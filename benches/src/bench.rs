//! `cargo bench -p esaac-benches`: the laboratory of `esaac bench`, with options for developers: `--only`,
//! `--statistics`.

use anyhow::Result;
use clap::Parser;
use esaac_benches::{Laboratory, Options, Part, Report, markdown, run, write};
use esaac_engine::{CameraConfig, Device, DeviceChoice, Rig, Validation};
use esaac_model::presets::preset;
use esaac_model::{HdrFormat, MotionFormat, PRESETS, Profile};
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Parser)]
#[command(about = "Speed, accuracy and memory of the engine")]
struct Arguments {
    /// Parts to run; all by default
    #[arg(long = "part", value_enum, value_name = "NAME")]
    parts: Vec<Part>,
    /// Only rows whose name contains this (parts `frontier`, `time`, `readout`, `encode`; sweeps of `scale`)
    #[arg(long, default_value = "")]
    only: String,
    /// Less of everything
    #[arg(long)]
    quick: bool,
    /// Folder for bench.json, bench.md and the plots; by default the text is printed
    #[arg(long)]
    out: Option<PathBuf>,
    /// Folder of a rendered sequence with its true events
    #[arg(long, value_name = "DIR")]
    sequence: Option<PathBuf>,
    /// Recording of a real sensor
    #[arg(long, value_name = "FILE.aedat4")]
    recording: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Print what the driver tells about each preset's kernels, and measure nothing
    #[arg(long)]
    statistics: bool,
    /// Device index
    #[arg(long)]
    device: Option<usize>,
    /// Set by `cargo bench`
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let choice = arguments.device.map_or(DeviceChoice::Best, DeviceChoice::Index);
    let device = Device::open(choice, Validation::Off)?;
    if arguments.statistics {
        return statistics(&device, &arguments.only);
    }
    let options = Options {
        quick: arguments.quick,
        parts: arguments.parts,
        only: arguments.only,
        sequence: arguments.sequence,
        recording: arguments.recording,
    };
    let laboratory = Laboratory::new(device, options)?;
    let keep = |report: &Report| arguments.out.as_ref().map_or(Ok(()), |out| write(report, out).map(|_| ()));
    let report = run(&laboratory, keep)?;
    if let Some(out) = &arguments.out {
        println!("{}", out.join("bench.md").display());
    } else if arguments.json {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        println!("{}", markdown(&report));
    }
    Ok(())
}

/// Registers, spills and sizes of the kernels.
fn statistics(device: &Arc<Device>, only: &str) -> Result<()> {
    for name in PRESETS.iter().map(|p| p.name).filter(|name| name.contains(only)) {
        for (profile_name, profile) in [("clean", Profile::Clean), ("noisy", Profile::Noisy)] {
            let mut sensor = preset(name).expect("a preset");
            profile.apply(&mut sensor);
            let (hdr, motion) = (HdrFormat::F16x4, Some(MotionFormat::F32x2));
            let mut rig =
                Rig::new(device, &[CameraConfig { sensor, camera: 0, hdr, motion, geometry: None }])?;
            rig.step(&[0])?;
            println!("{name} {profile_name}");
            for (stage, told) in rig.kernel_statistics()? {
                let told: Vec<String> = told.iter().map(|(name, value)| format!("{name} {value}")).collect();
                println!("  {stage:<8} {}", told.join(", "));
            }
        }
    }
    Ok(())
}
