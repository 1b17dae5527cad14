//! Renders into memory that is shared with a running service.

use super::RenderArguments;
use crate::arguments::CommonArguments;
use crate::link_report::{memory_name, timeline_name};
use crate::outcome::Outcome;
use crate::{device_choice, progress};
use anyhow::{Context, Result, ensure};
use esaac_engine::{Device, GeometryConfig, InputBuffers};
use esaac_formats::frame_time::frame_time_ns;
use esaac_interop::{Copies, Gives, Images, InteropError, Producer, ProducerOptions};
use esaac_model::paths::Intrinsics;
use esaac_model::{IdFormat, MotionFormat};
use esaac_scene::renderer::{Renderer, Targets};
use esaac_scene::{RenderError, Scene};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Counts of a camera's frames.
#[derive(Clone, Debug, Serialize)]
struct CameraSummary {
    camera: u32,
    memory: &'static str,
    timeline: &'static str,
    /// Whether depth and poses went with the frames.
    poses: bool,
    stepped: u64,
    dropped: u64,
}

/// A camera of the engine and its renderer.
struct Feed {
    producer: Producer,
    renderer: Renderer,
    /// Poses a second of simulated time, if the camera takes them.
    pose_rate_hz: Option<f64>,
}

/// Renders for the service at `socket`.
pub(super) fn run(arguments: &RenderArguments, socket: &Path, common: &CommonArguments) -> Result<Outcome> {
    let device = device_choice::open(common)?;
    let mut feeds = connect(&device, arguments, socket)?;
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
        let (camera, poses) = (offer.camera, feed.pose_rate_hz.is_some());
        summaries.push(CameraSummary { camera, memory, timeline, poses, stepped, dropped });
    }
    device_choice::check_validation(&device)?;
    if common.json {
        return Ok(Outcome::complete(serde_json::to_string_pretty(&summaries)? + "\n"));
    }
    let line = |s: &CameraSummary| {
        format!(
            "camera {}  {} frames stepped, {} dropped; {}; memory {}, timelines {}\n",
            s.camera,
            s.stepped,
            s.dropped,
            if s.poses { "with depth and poses" } else { "without poses" },
            s.memory,
            s.timeline
        )
    };
    Ok(Outcome::complete(summaries.iter().map(line).collect()))
}

/// Connects every camera before any frame is sent, so that the engine can step them together.
fn connect(device: &Arc<Device>, arguments: &RenderArguments, socket: &Path) -> Result<Vec<Feed>> {
    let mut cameras = arguments.camera.clone();
    let mut feeds = Vec::new();
    let mut next = 0;
    while cameras.is_empty() || next < cameras.len() {
        let camera = cameras.get(next).copied().unwrap_or(0);
        let options = ProducerOptions {
            camera,
            geometry: Gives::Geometry,
            timeout: Duration::from_secs(arguments.patience),
            ..ProducerOptions::default()
        };
        let producer =
            Producer::connect(device, socket, &options).with_context(|| format!("camera {camera}"))?;
        if cameras.is_empty() {
            cameras = (0..producer.client().offer().cameras).collect();
        }
        let images = *producer.client().images();
        let scene = arguments.scene.scene(images.width_px, images.height_px);
        if let Some(geometry) = &images.geometry {
            check_geometry(&scene, &images, geometry).with_context(|| format!("camera {camera}"))?;
        }
        // The renderer needs a format even if the engine takes no motion.
        let motion = images.motion.unwrap_or(MotionFormat::F32x2);
        let renderer = Renderer::new(device, scene, images.hdr, motion)?;
        let pose_rate_hz = images.geometry.map(|_| arguments.pose_rate);
        feeds.push(Feed { producer, renderer, pose_rate_hz });
        next += 1;
    }
    Ok(feeds)
}

/// Whether a scene is rendered as the rig wants its depth, ids and poses.
fn check_geometry(scene: &Scene, images: &Images, geometry: &GeometryConfig) -> Result<()> {
    let (actual, expected) = (scene.intrinsics(), geometry.lens);
    let numbers = |lens: &Intrinsics| [lens.focal_px().to_array(), lens.centre_px().to_array()];
    let [[fx, fy], [cx, cy]] = numbers(&actual);
    ensure!(
        images.takes_lens(&actual),
        "the scene has the lens {actual:?}, the rig {expected:?}; \
         write in the rig file: lens = {{ fx = {fx}, fy = {fy}, cx = {cx}, cy = {cy} }}"
    );
    ensure!(
        geometry.ids != Some(IdFormat::U16),
        "the scene is rendered with ids of 32 bits; write `ids = \"u32\"`"
    );
    Ok(())
}

/// Times of poses of an interval, of one clock for all intervals; some before and after it, so that the poses between
/// them are as smooth at its ends.
fn pose_times_ns(from_ns: i64, to_ns: i64, rate_hz: f64) -> Vec<i64> {
    const MORE: i64 = 4;
    let position = |t_ns: i64| t_ns as f64 * 1e-9 * rate_hz;
    let (first, last) = (position(from_ns).floor() as i64 - MORE, position(to_ns).ceil() as i64 + MORE);
    (first..=last).map(|k| (k as f64 * 1e9 / rate_hz).round() as i64).collect()
}

impl Feed {
    fn send(&mut self, t_ns: i64, previous_ns: Option<i64>) -> Result<(), FeedError> {
        let slot = self.producer.slot()?;
        let renderer = &mut self.renderer;
        self.producer.write(slot, |place, hooks| {
            let InputBuffers { hdr, motion, depth, ids } = place.inputs();
            let targets = Targets { hdr, motion, depth, ids };
            renderer.render_with_hooks(t_ns, previous_ns, targets, hooks)
        })?;
        // No copies: it rendered into the engine's memory.
        let copies = Copies::default();
        match self.pose_rate_hz {
            Some(rate_hz) => {
                let times_ns = pose_times_ns(previous_ns.unwrap_or(t_ns), t_ns, rate_hz);
                let motion = self.renderer.scene().scene_motion(&times_ns);
                self.producer.publish_scene(slot, t_ns, copies, &motion)?;
            }
            None => self.producer.publish(slot, t_ns, copies)?,
        }
        Ok(())
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
