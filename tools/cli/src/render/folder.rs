//! Renders into a folder that `esaac simulate` reads: frames with all that a simulator knows, and `sequence.json`.

use super::RenderArguments;
use crate::counted::counted;
use crate::outcome::Outcome;
use crate::{output_file, progress};
use anyhow::{Context, Result, ensure};
use esaac_formats::exr_frame::{ChannelNames, DEPTH_CHANNEL, FrameImages, FrameLayout, ID_CHANNEL};
use esaac_formats::exr_writer::write_frame;
use esaac_formats::frame_time::frame_time_ns;
use esaac_formats::scene_file::{SequenceFile, pose_times_ns};
use esaac_formats::truth_file::{self, TruthFile};
use esaac_model::{HdrFormat, MotionFormat, SensorModel};
use esaac_scene::{Scene, all_pixels, exact_events, render_cpu};
use serde::Serialize;
use std::path::Path;

/// Formats of the images in memory; the files hold half floats and floats.
const HDR: HdrFormat = HdrFormat::F16x4;
const MOTION: MotionFormat = MotionFormat::F32x2;

/// What was written.
#[derive(Clone, Debug, Serialize)]
struct Written {
    folder: String,
    frames: usize,
    width_px: u32,
    height_px: u32,
    rate_hz: f64,
    /// Poses of the camera and of each moving instance.
    poses: usize,
    instances: usize,
    /// Events in `truth.npz`, if it was asked for.
    true_events: Option<usize>,
}

/// Renders into `folder`.
pub(super) fn run(arguments: &RenderArguments, folder: &Path, json: bool) -> Result<Outcome> {
    let &RenderArguments { rate, pose_rate, width, height, .. } = arguments;
    let frames = arguments.frames as usize;
    make_empty(folder)?;
    let scene = arguments.scene.scene(width, height);
    // First, so that the frames of a run that was stopped have their rate and poses.
    let motion = scene.scene_motion(&pose_times_ns(frames, rate, pose_rate));
    let sequence = SequenceFile::new(&motion, rate, pose_rate);
    let text = serde_json::to_string(&sequence)? + "\n";
    output_file::write(&folder.join(SequenceFile::NAME), |out| Ok(out.write_all(text.as_bytes())?))?;
    let layout = layout(&scene);
    let progress = progress::bar(frames);
    for index in 0..frames {
        let previous_ns = index.checked_sub(1).map(|before| frame_time_ns(before, rate));
        let images = images(&scene, frame_time_ns(index, rate), previous_ns);
        let path = folder.join(format!("key_{index:04}.exr"));
        output_file::write(&path, |out| write_frame(out, &layout, &images))?;
        progress.inc(1);
    }
    progress.finish_and_clear();
    let true_events = match arguments.truth {
        true => Some(write_truth(&scene, frame_time_ns(frames - 1, rate), folder)?),
        false => None,
    };
    let written = Written {
        folder: folder.display().to_string(),
        frames,
        width_px: width,
        height_px: height,
        rate_hz: rate,
        poses: motion.camera().poses().len(),
        instances: motion.ids().count(),
        true_events,
    };
    Ok(Outcome::complete(if json {
        serde_json::to_string_pretty(&written)? + "\n"
    } else {
        written.to_text()
    }))
}

/// Makes the folder. Frames of another run in it would be taken for frames of this one.
fn make_empty(folder: &Path) -> Result<()> {
    output_file::make_folder(folder)?;
    let entry =
        std::fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))?.next();
    if let Some(entry) = entry {
        let name = entry.with_context(|| format!("cannot list {}", folder.display()))?.file_name();
        ensure!(false, "{} holds {}, expected an empty folder", folder.display(), name.display());
    }
    Ok(())
}

fn layout(scene: &Scene) -> FrameLayout {
    FrameLayout {
        width_px: scene.width_px,
        height_px: scene.height_px,
        names: ChannelNames::default(),
        hdr: HDR,
        motion: Some(MOTION),
        motion_factors: [1.0; 2],
        depth: Some(DEPTH_CHANNEL.to_owned()),
        ids: Some(ID_CHANNEL.to_owned()),
    }
}

fn images(scene: &Scene, t_ns: i64, previous_ns: Option<i64>) -> FrameImages {
    let frame = render_cpu(scene, t_ns, previous_ns, HDR, MOTION);
    let words = |bytes: &[u8]| -> Vec<[u8; 4]> { bytes.as_chunks().0.to_vec() };
    FrameImages {
        depth: Some(words(&frame.depth).into_iter().map(f32::from_le_bytes).collect()),
        ids: Some(words(&frame.ids).into_iter().map(u32::from_le_bytes).collect()),
        hdr: frame.hdr,
        motion: Some(frame.motion),
    }
}

/// Writes the exact events in (0, `end_ns`] and returns their number.
fn write_truth(scene: &Scene, end_ns: i64, folder: &Path) -> Result<usize> {
    let sensor = SensorModel { width: scene.width_px, height: scene.height_px, ..SensorModel::default() };
    let pixels: Vec<(u32, u32)> = all_pixels(scene).collect();
    let mut events = exact_events(scene, &sensor, &pixels, 0, end_ns).concat();
    events.sort_unstable();
    let truth = TruthFile { sensor, end_ns, events };
    output_file::write(&folder.join("truth.npz"), |out| truth_file::write(out, &truth))?;
    Ok(truth.events.len())
}

impl Written {
    fn to_text(&self) -> String {
        let Written { folder, frames, width_px, height_px, rate_hz, poses, instances, .. } = self;
        let count = |n: usize, one: &str| counted(n as u64, one);
        let mut text = format!(
            "{} of {width_px}x{height_px} px at {rate_hz} Hz, {} of the camera and of {}",
            count(*frames, "frame"),
            count(*poses, "pose"),
            count(*instances, "moving instance")
        );
        if let Some(events) = self.true_events {
            text.push_str(&format!(", {events} true events"));
        }
        let next = match frames {
            1 => "`esaac simulate` makes events from two frames on".to_owned(),
            _ => format!("`esaac simulate {folder}` makes events"),
        };
        text + &format!("\nwrote {folder}; {next}\n")
    }
}
