//! The whole program, for `main` and for whoever else starts it.

use crate::arguments::{Arguments, Command};
use crate::outcome::Outcome;
use crate::{bench, calibrate, demo, devices, doctor, render, replay, sensors, serve, simulate};
use anyhow::Result;
use clap::Parser;
use std::io::{ErrorKind, Write};
use std::sync::OnceLock;

/// What starts this program once more; nothing for its own file.
static AGAIN: OnceLock<Vec<String>> = OnceLock::new();

/// Runs the command line `arguments`, of which the first is the program's name, and returns the exit code.
/// `again` is what starts the program once more, where it is not the file of this process.
#[must_use]
pub fn run(arguments: &[String], again: &[String]) -> u8 {
    if !again.is_empty() {
        // The first word stands: a process is started in one way.
        let _ = AGAIN.set(again.to_vec());
    }
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Where standard output is gone there is nobody to tell.
            let _ = error.print();
            return u8::try_from(error.exit_code()).unwrap_or(2);
        }
    };
    match command(&arguments).and_then(|outcome| Ok(print(&outcome)?)) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            1
        }
    }
}

/// What starts this program once more: a file and its first arguments.
pub fn again() -> std::io::Result<(String, Vec<String>)> {
    match AGAIN.get().and_then(|words| words.split_first()) {
        Some((program, arguments)) => Ok((program.clone(), arguments.to_vec())),
        None => Ok((std::env::current_exe()?.to_string_lossy().into_owned(), Vec::new())),
    }
}

fn command(arguments: &Arguments) -> Result<Outcome> {
    let common = &arguments.common;
    match &arguments.command {
        Command::Demo(demo) => demo::run(demo, common),
        Command::Simulate(simulate) => simulate::run(simulate, common),
        Command::Serve(serve) => serve::run(serve, common),
        Command::Render(render) => render::run(render, common),
        Command::Bench(bench) => bench::run(bench, common),
        Command::Calibrate(calibrate) => calibrate::run(calibrate, common),
        Command::Replay(replay) => replay::run(replay, common.json),
        Command::Sensors(sensors) => sensors::run(sensors, common.json),
        Command::Devices => devices::run(common.json),
        Command::Doctor => doctor::run(common),
    }
}

/// A reader that stops early, as `head` does, is not an error.
fn print(outcome: &Outcome) -> std::io::Result<u8> {
    let mut out = std::io::stdout().lock();
    match out.write_all(outcome.text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error),
        _ => Ok(outcome.ending.exit_code()),
    }
}
