//! The command line: the options of every command, and the commands with theirs.

use crate::arguments::CommonArguments;
use crate::bench::BenchArguments;
use crate::calibrate::CalibrateArguments;
use crate::characterise::CharacteriseArguments;
use crate::compare::CompareArguments;
use crate::demo::DemoArguments;
use crate::render::RenderArguments;
use crate::replay::ReplayArguments;
use crate::sensors::SensorsArguments;
use crate::serve::ServeArguments;
use crate::simulate::SimulateArguments;
use crate::version;
use clap::{Parser, Subcommand};

/// Event camera simulator: rendered HDR frames in, time-ordered events out.
// A script may add options to a default line: of an option that is given twice, the last one counts.
#[derive(Parser, Clone, Debug)]
#[command(name = "esaac", version = version::text(), args_override_self = true, after_help = EXIT_CODES)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Options of every command.
    #[command(flatten)]
    pub common: CommonArguments,
}

const EXIT_CODES: &str = "If an option is given twice, the last one counts.\n\
                          Exit codes: 0 done, 1 error, 2 wrong usage, 3 done but events were dropped,\n\
                          130 interrupted: what was simulated until then is written.";

/// The subcommands.
#[derive(Subcommand, Clone, Debug)]
pub enum Command {
    /// Render a built-in scene, simulate it and draw an overview
    Demo(Box<DemoArguments>),
    /// Turn a folder of OpenEXR frames into events
    Simulate(Box<SimulateArguments>),
    /// Run the engine as a service that renderers in other processes feed
    Serve(Box<ServeArguments>),
    /// Render a built-in scene into the memory of a running service, or into a folder for `simulate`
    Render(RenderArguments),
    /// Measure speed, accuracy and memory of the engine on this machine
    Bench(BenchArguments),
    /// Fit a sensor to recordings of a real one
    Calibrate(CalibrateArguments),
    /// Measure a sensor with a physical pixel as a laboratory would
    Characterise(CharacteriseArguments),
    /// Compare the events of two files
    Compare(CompareArguments),
    /// Publish a recording again, with its timing
    Replay(ReplayArguments),
    /// List the sensor presets with every parameter
    Sensors(SensorsArguments),
    /// List the Vulkan devices and whether each one is suitable
    Devices,
    /// Check what this machine lacks, and how to install it
    Doctor,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{ArgAction, CommandFactory};

    #[test]
    fn options_override_themselves_in_every_command_and_only_lists_collect() {
        let mut program = Arguments::command();
        program.build();
        let mut collecting = Vec::new();
        for command in program.get_subcommands() {
            assert!(command.is_args_override_self(), "{}", command.get_name());
            let lists = command.get_arguments().filter(|a| matches!(a.get_action(), ArgAction::Append));
            collecting.extend(lists.filter_map(|list| list.get_long()).map(str::to_owned));
        }
        collecting.sort_unstable();
        collecting.dedup();
        assert_eq!(collecting, ["camera", "part", "ros-args", "ros-qos"]);
    }
}
