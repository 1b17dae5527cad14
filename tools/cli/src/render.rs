//! `esaac render`: renders a built-in scene in its own process, directly into memory that it shares with the
//! engine.

use crate::arguments::CommonArguments;
use crate::frame_time::frame_time_ns;
use crate::link_report::{memory_name, timeline_name};
use crate::outcome::Outcome;
use crate::scene_argument::scene_parser;
use crate::{device_choice, progress};
use anyhow::{Context, Result};
use esaac_engine::Device;
use esaac_interop::{Copies, InteropError, Producer, ProducerOptions};
use esaac_model::MotionFormat;
use esaac_scene::renderer::{Renderer, Targets};
use esaac_scene::{RenderError, SceneKind};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Arguments of `render`.
#[derive(clap::Args, Clone, Debug)]
pub struct RenderArguments {
    /// Socket of the engine
    #[arg(long, value_name = "PATH")]
    pub socket: PathBuf,
    /// Scene to render
    #[arg(long, value_name = "NAME", default_value = "flight", value_parser = scene_parser())]
    pub scene: SceneKind,
    /// Frames to render
    #[arg(long, default_value_t = 21, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub frames: u32,
    /// Frames per second of simulated time
    #[arg(long, value_name = "HZ", default_value_t = 30.0, value_parser = rate)]
    pub rate: f64,
    /// Camera to render for; may be given several times [default: all cameras of the rig]
    #[arg(long, value_name = "N")]
    pub camera: Vec<u32>,
    /// How long to wait for the engine's answers, and for a free slot
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub patience: u64,
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if (1.0..=1e6).contains(&rate) => Ok(rate),
        _ => Err("expected 1 to 1000000".to_owned()),
    }
}

/// Counts of a camera's frames.
#[derive(Clone, Debug, Serialize)]
struct CameraSummary {
    camera: u32,
    memory: &'static str,
    timeline: &'static str,
    stepped: u64,
    dropped: u64,
}

/// A camera of the engine and its renderer.
struct Feed {
    producer: Producer,
    renderer: Renderer,
}

/// Runs the command.
pub fn run(arguments: &RenderArguments, common: &CommonArguments) -> Result<Outcome> {
    let device = device_choice::open(common)?;
    let mut feeds = connect(&device, arguments)?;
    let progress = progress::bar(arguments.frames as usize);
    let mut previous_ns = None;
    for index in 0..arguments.frames as usize {
        let t_ns = frame_time_ns(index, arguments.rate);
        for feed in &mut feeds {
            feed.send(t_ns, previous_ns).with_context(|| format!("frame {index}"))?;
        }
        previous_ns = Some(t_ns);
        progress.inc(1);
    }
    progress.finish_and_clear();
    let mut summaries = Vec::new();
    for feed in feeds {
        let offer = *feed.producer.client().offer();
        let (stepped, dropped) = feed.producer.finish()?;
        let (memory, timeline) = (memory_name(offer.memory), timeline_name(offer.timeline));
        summaries.push(CameraSummary { camera: offer.camera, memory, timeline, stepped, dropped });
    }
    device_choice::check_validation(&device)?;
    if common.json {
        return Ok(Outcome::complete(serde_json::to_string_pretty(&summaries)? + "\n"));
    }
    let line = |s: &CameraSummary| {
        format!(
            "camera {}  {} frames stepped, {} dropped; memory {}, timelines {}\n",
            s.camera, s.stepped, s.dropped, s.memory, s.timeline
        )
    };
    Ok(Outcome::complete(summaries.iter().map(line).collect()))
}

/// Connects every camera before any frame is sent, so that the engine can step them together.
fn connect(device: &Arc<Device>, arguments: &RenderArguments) -> Result<Vec<Feed>> {
    let mut cameras = arguments.camera.clone();
    let mut feeds = Vec::new();
    let mut next = 0;
    while cameras.is_empty() || next < cameras.len() {
        let camera = cameras.get(next).copied().unwrap_or(0);
        let options = ProducerOptions {
            camera,
            timeout: Duration::from_secs(arguments.patience),
            ..ProducerOptions::default()
        };
        let producer = Producer::connect(device, &arguments.socket, &options)
            .with_context(|| format!("camera {camera}"))?;
        if cameras.is_empty() {
            cameras = (0..producer.client().offer().cameras).collect();
        }
        let images = *producer.client().images();
        let scene = arguments.scene.scene(images.width_px, images.height_px);
        // The renderer needs a format even if the engine takes no motion.
        let motion = images.motion.unwrap_or(MotionFormat::F32x2);
        let renderer = Renderer::new(device, scene, images.hdr, motion)?;
        feeds.push(Feed { producer, renderer });
        next += 1;
    }
    Ok(feeds)
}

impl Feed {
    fn send(&mut self, t_ns: i64, previous_ns: Option<i64>) -> Result<(), FeedError> {
        let slot = self.producer.slot()?;
        let renderer = &mut self.renderer;
        self.producer.write(slot, |place, hooks| {
            let inputs = place.inputs();
            let targets = Targets { hdr: inputs.hdr, motion: inputs.motion, depth: None, ids: None };
            renderer.render_with_hooks(t_ns, previous_ns, targets, hooks)
        })?;
        // No copies: it rendered into the engine's memory.
        Ok(self.producer.publish(slot, t_ns, Copies::default())?)
    }
}

/// Why a frame could not be sent.
#[derive(Debug, thiserror::Error)]
enum FeedError {
    #[error(transparent)]
    Link(#[from] InteropError),
    #[error(transparent)]
    Render(#[from] RenderError),
}
