//! The command line.

use crate::bench::BenchArguments;
use crate::calibrate::CalibrateArguments;
use crate::demo::DemoArguments;
use crate::device_choice::DeviceArgument;
use crate::render::RenderArguments;
use crate::replay::ReplayArguments;
use crate::sensors::SensorsArguments;
use crate::serve::ServeArguments;
use crate::simulate::SimulateArguments;
use clap::builder::FalseyValueParser;
use clap::{Parser, Subcommand};

/// Event camera simulator: rendered HDR frames in, time-ordered events out.
#[derive(Parser, Clone, Debug)]
#[command(name = "esaac", version, after_help = EXIT_CODES)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Options of every command.
    #[command(flatten)]
    pub common: CommonArguments,
}

const EXIT_CODES: &str = "Exit codes: 0 done, 1 error, 2 wrong usage, 3 done but events were dropped.";

/// Options of every command.
#[derive(clap::Args, Clone, Debug)]
pub struct CommonArguments {
    /// Print JSON on standard output
    #[arg(long, global = true)]
    pub json: bool,
    /// Device by number or UUID as `esaac devices` shows them; the best one by default
    #[arg(long, global = true, env = "ESAAC_DEVICE", value_name = "INDEX|UUID")]
    pub device: Option<DeviceArgument>,
    /// Turn Vulkan's validation layer on
    #[arg(long, global = true, env = "ESAAC_VALIDATION", value_parser = FalseyValueParser::new())]
    pub validation: bool,
}

/// The subcommands.
#[derive(Subcommand, Clone, Debug)]
pub enum Command {
    /// Render a built-in scene, simulate it and draw an overview
    Demo(Box<DemoArguments>),
    /// Turn a folder of OpenEXR frames into events
    Simulate(Box<SimulateArguments>),
    /// Run the engine as a service that renderers in other processes feed
    Serve(Box<ServeArguments>),
    /// Render a built-in scene into the memory of a running service
    Render(RenderArguments),
    /// Measure speed, accuracy and memory of the engine on this machine
    Bench(BenchArguments),
    /// Fit a sensor to a recording of a real one
    Calibrate(CalibrateArguments),
    /// Publish a recording again, with its timing
    Replay(ReplayArguments),
    /// List the sensor presets with every parameter
    Sensors(SensorsArguments),
    /// List the Vulkan devices and whether each is enough
    Devices,
    /// Say what is missing on this machine and what mends it
    Doctor,
}
