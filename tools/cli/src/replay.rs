//! `esaac replay`: publishes a recording again.

use crate::interrupt::Interrupt;
use crate::outcome::Outcome;
use crate::ros::NetworkArguments;
use crate::{stderr, table};
use anyhow::Result;
use esaac_ros::BagReader;
use esaac_ros::replay::{ReplayOptions, replay};
use std::path::PathBuf;
use std::time::Duration;

/// Arguments of `replay`.
#[derive(clap::Args, Clone, Debug)]
pub struct ReplayArguments {
    /// Recording, by `--record` or by rosbag2
    #[arg(value_name = "FILE.mcap")]
    pub file: PathBuf,
    /// Speed; 2 is twice as fast
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
    pub rate: f64,
    /// Time that subscribers have to find the topics before the first message, seconds
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = seconds, allow_negative_numbers = true)]
    pub delay: f64,
    /// Network.
    #[command(flatten)]
    pub network: NetworkArguments,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds @ 0.0..=3600.0) => Ok(seconds),
        _ => Err("expected 0 to 3600 seconds".to_owned()),
    }
}

/// Runs the command.
pub fn run(arguments: &ReplayArguments, json: bool) -> Result<Outcome> {
    let bag = BagReader::open(&arguments.file)?;
    let interrupt = Interrupt::watch()?;
    let mut transport = arguments.network.open(&[])?.transport;
    let options = ReplayOptions { rate: arguments.rate, delay: Duration::from_secs_f64(arguments.delay) };
    let replayed = replay(bag, &mut *transport, options, || interrupt.came(), stderr::line)?;
    if replayed.truncated {
        stderr::line(format_args!(
            "warning: {} has no end; everything up to its last complete chunk was sent",
            arguments.file.display()
        ));
    }
    if replayed.out_of_order > 0 {
        stderr::line(format_args!(
            "warning: {} of the messages in {} were recorded before others that come first in the file; they were sent late",
            replayed.out_of_order,
            arguments.file.display()
        ));
    }
    for foreign in &replayed.foreign {
        stderr::line(format_args!("warning: skipped, not a ROS 2 message: {foreign}"));
    }
    if json {
        return Ok(Outcome::complete(serde_json::to_string_pretty(&replayed)? + "\n"));
    }
    let mut rows: Vec<Vec<String>> = replayed
        .topics
        .iter()
        .map(|(topic, kind, count)| vec![topic.clone(), kind.clone(), count.to_string()])
        .collect();
    rows.push(vec![
        format!("{:.3} s", replayed.recorded_ns as f64 * 1e-9),
        format!("{} not sent", replayed.failed),
        replayed.sent.to_string(),
    ]);
    Ok(Outcome::complete(table::render(&rows)))
}
