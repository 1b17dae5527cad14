//! `esaac render`: renders a built-in scene into the memory of a running service, or into a folder.

mod folder;
mod service;

use crate::arguments::CommonArguments;
use crate::outcome::Outcome;
use crate::rate_argument::rate;
use crate::scene_argument::scene_parser;
use crate::whole_argument::whole;
use anyhow::Result;
use esaac_scene::SceneKind;
use std::path::PathBuf;

/// Arguments of `render`.
#[derive(clap::Args, Clone, Debug)]
pub struct RenderArguments {
    /// Where the frames go.
    #[command(flatten)]
    pub place: Place,
    /// Scene to render
    #[arg(long, value_name = "NAME", default_value = "flight", value_parser = scene_parser())]
    pub scene: SceneKind,
    /// Frames to render
    #[arg(long, default_value_t = 21, value_parser = whole(1, 10_000_000))]
    pub frames: u32,
    /// Frames per second of simulated time
    #[arg(long, value_name = "HZ", default_value_t = 30.0, value_parser = rate, allow_negative_numbers = true)]
    pub rate: f64,
    /// Camera to render for; may be given several times [default: all cameras of the rig]
    #[arg(long, value_name = "N", conflicts_with = "out")]
    pub camera: Vec<u32>,
    /// How long to wait for the engine's answers, and for a free slot
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u64).range(1..=86_400), conflicts_with = "out")]
    pub patience: u64,
    /// Width of the frames in a folder
    #[arg(long, value_name = "PX", default_value_t = 346, value_parser = whole(1, 4096), conflicts_with = "socket")]
    pub width: u32,
    /// Height of the frames in a folder
    #[arg(long, value_name = "PX", default_value_t = 260, value_parser = whole(1, 4096), conflicts_with = "socket")]
    pub height: u32,
    /// Poses per second of simulated time
    #[arg(long, value_name = "HZ", default_value_t = 960.0, value_parser = rate, allow_negative_numbers = true)]
    pub pose_rate: f64,
    /// Also write truth.npz, the scene's exact events for the default pixel, for `esaac bench --sequence`
    #[arg(long, conflicts_with = "socket")]
    pub truth: bool,
}

/// Where the frames go: one of both.
#[derive(clap::Args, Clone, Debug)]
#[group(required = true, multiple = false)]
pub struct Place {
    /// Socket of the engine
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Folder for the frames, with motion, depth, instance ids and poses, for `esaac simulate`
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &RenderArguments, common: &CommonArguments) -> Result<Outcome> {
    match (&arguments.place.socket, &arguments.place.out) {
        (Some(socket), _) => service::run(arguments, socket, common),
        (None, Some(out)) => folder::run(arguments, out, common.json),
        (None, None) => anyhow::bail!("no --socket and no --out, expected one of them"),
    }
}
