//! The program `esaac`.

use clap::Parser;
use esaac_cli::arguments::{Arguments, Command};
use esaac_cli::outcome::Outcome;
use esaac_cli::{bench, calibrate, demo, devices, doctor, render, replay, sensors, serve, simulate};
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments).and_then(|outcome| Ok(print(&outcome)?)) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
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
fn print(outcome: &Outcome) -> std::io::Result<ExitCode> {
    let mut out = std::io::stdout().lock();
    match out.write_all(outcome.text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error),
        _ => Ok(ExitCode::from(outcome.ending.exit_code())),
    }
}
