//! The whole program, for `main` and for other programs that start it.

use crate::command_line::{Arguments, Command};
use crate::outcome::Outcome;
use crate::version::Build;
use crate::{
    bench, calibrate, characterise, compare, demo, devices, doctor, own_program, render, replay, sensors,
    serve, simulate, stderr,
};
use anyhow::{Context, Result};
use clap::Parser;
use clap::error::ErrorKind as UsageKind;
use std::ffi::OsStr;
use std::io::{ErrorKind, Write};

/// Runs the command line `arguments`, of which the first is the program's name, and returns the exit code.
/// `again` are the words that start the program a second time, if the file of this process is another program's.
/// Arguments need not be UTF-8: names of files are taken as they are.
#[must_use]
pub fn run<A: AsRef<OsStr>>(arguments: &[A], again: &[String]) -> u8 {
    own_program::set_start(again);
    let ran = match Arguments::try_parse_from(arguments.iter().map(A::as_ref)) {
        Ok(arguments) => command(&arguments),
        Err(error)
            if error.kind() == UsageKind::DisplayVersion
                && arguments.iter().any(|a| a.as_ref() == "--json") =>
        {
            version_as_json()
        }
        Err(error) => {
            // A closed standard output cannot be reported anywhere.
            let _ = error.print();
            return u8::try_from(error.exit_code()).unwrap_or(2);
        }
    };
    match ran.and_then(|outcome| print(&outcome).context("cannot write standard output")) {
        Ok(code) => code,
        Err(error) => {
            stderr::line(format_args!("error: {}", stderr::sentence(&error)));
            1
        }
    }
}

fn version_as_json() -> Result<Outcome> {
    Ok(Outcome::complete(serde_json::to_string_pretty(&Build::this())? + "\n"))
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
        Command::Characterise(characterise) => characterise::run(characterise, common),
        Command::Compare(compare) => compare::run(compare, common.json),
        Command::Replay(replay) => replay::run(replay, common.json),
        Command::Sensors(sensors) => sensors::run(sensors, common.json),
        Command::Devices => devices::run(common),
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
