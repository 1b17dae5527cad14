//! Draws the pictures of the guide's page on input: `cargo run --release -p esaac-cli --example hard_cases -- DIR`.
//!
//! One for each scene that is hard to synthesise: a frame, and the events of a few milliseconds between two frames, the
//! exact ones, those from motion vectors, by one surface a pixel and by as many as the scene needs, and those from depth
//! and poses. It prints how near the events of each input set come to the exact ones.

use anyhow::{Context, Result, ensure};
use bytemuck::cast_slice;
use esaac_benches::truth::Truth;
use esaac_cli::canvas::{Align, Canvas};
use esaac_cli::{colour, output_file};
use esaac_engine::{CameraConfig, Device, DeviceChoice, FrameBytes, GeometryConfig, Rig, Validation};
use esaac_formats::frame_time::frame_time_ns;
use esaac_formats::scene_file::pose_times_ns;
use esaac_model::packet::Event;
use esaac_model::{DepthFormat, HdrFormat, IdFormat, MotionFormat, Polarity, SensorModel, Synthesis};
use esaac_scene::{Scene, SceneKind, all_pixels, exact_events, render_cpu};
use std::path::PathBuf;
use std::sync::Arc;

const CASES: [SceneKind; 5] =
    [SceneKind::Shake, SceneKind::Poles, SceneKind::Foliage, SceneKind::Propeller, SceneKind::Bounce];
const SIZE_PX: (u32, u32) = (120, 90);
const RATE_HZ: f64 = 30.0;
const POSE_RATE_HZ: f64 = 960.0;

/// Frames until the end of the interval that is shown.
const FRAMES: usize = 4;

/// The part of the last interval whose events are shown: its middle, where a synthesis has least to go by.
const SHOWN: (f64, f64) = (0.4, 0.6);

/// Pixels whose events are compared with the exact ones.
const COMPARED_PIXELS: usize = 3000;

const PAPER: [u8; 3] = [0xff; 3];
const INK: [u8; 3] = [0x20, 0x24, 0x2b];
const ENLARGED: usize = 3;
const GAP_PX: usize = 8;
const TITLE_PX: usize = 30;

/// A frame in host memory.
struct Frame {
    t_ns: i64,
    images: esaac_scene::Frame,
}

fn main() -> Result<()> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [folder] = &arguments[..] else {
        anyhow::bail!("{} arguments, expected 1: the folder to write to", arguments.len());
    };
    ensure!(folder.is_dir(), "there is no folder {}", folder.display());
    let device = Device::open(DeviceChoice::Best, Validation::Off)?;
    println!(
        "| scene | colour | and motion vectors, one surface | and motion vectors | depth and poses |\n|---|---|---|---|---|"
    );
    for kind in CASES {
        let path = folder.join(format!("{}.png", kind.name()));
        let case = Case::of(&device, kind).with_context(|| kind.name())?;
        output_file::write(&path, |out| case.picture().write_png(out))?;
        let errors = case.simulated.each_ref().map(|events| case.error(events));
        println!("| `{}` | {} |", kind.name(), errors.join(" | "));
    }
    Ok(())
}

/// A scene's frames, its exact events, and those of each input set.
struct Case {
    frames: Vec<Frame>,
    truth: Vec<Event>,
    judge: Truth,
    /// By `linear`, `motion` with one surface, `motion`, and `rigid`.
    simulated: [Vec<Event>; 4],
}

impl Case {
    fn of(device: &Arc<Device>, kind: SceneKind) -> Result<Self> {
        let scene = kind.scene(SIZE_PX.0, SIZE_PX.1);
        let frames: Vec<Frame> = (0..FRAMES)
            .map(|index| {
                let t_ns = frame_time_ns(index, RATE_HZ);
                let previous_ns = index.checked_sub(1).map(|before| frame_time_ns(before, RATE_HZ));
                let images = render_cpu(&scene, t_ns, previous_ns, HdrFormat::F16x4, MotionFormat::F32x2);
                Frame { t_ns, images }
            })
            .collect();
        let sensor = SensorModel { width: SIZE_PX.0, height: SIZE_PX.1, ..SensorModel::default() };
        let pixels: Vec<(u32, u32)> = all_pixels(&scene).collect();
        let end_ns = frames[FRAMES - 1].t_ns;
        let truth = exact_events(&scene, &sensor, &pixels, 0, end_ns).concat();
        let judge = Truth::of_scene(&scene, &sensor, COMPARED_PIXELS, (0, end_ns));
        let by = |synthesis, layers| simulated(device, &scene, &frames, synthesis, layers);
        let simulated = [
            by(Synthesis::Linear, 1)?,
            by(Synthesis::Motion, 1)?,
            by(Synthesis::Motion, 0)?,
            by(Synthesis::Rigid, 1)?,
        ];
        Ok(Case { frames, truth, judge, simulated })
    }

    fn picture(&self) -> Canvas {
        let Case { frames, truth, simulated: [_, motion, layers, rigid], .. } = self;
        let panels = [
            ("a frame", still(&frames[FRAMES - 1].images.hdr)),
            ("exact events", shown(frames, truth)),
            ("vectors, one surface", shown(frames, motion)),
            ("from motion vectors", shown(frames, layers)),
            ("from depth and poses", shown(frames, rigid)),
        ];
        let (width, height) = (SIZE_PX.0 as usize * ENLARGED, SIZE_PX.1 as usize * ENLARGED);
        let mut canvas = Canvas::new(panels.len() * (width + GAP_PX) - GAP_PX, height + TITLE_PX, PAPER);
        for (column, (title, panel)) in panels.iter().enumerate() {
            let x = column * (width + GAP_PX);
            let middle = (x + width / 2) as f32;
            canvas.text(title, (middle, TITLE_PX as f32 - 9.0), Align::Centre, 20.0, INK);
            canvas.draw((x, TITLE_PX), &panel.enlarged(ENLARGED));
        }
        canvas
    }

    /// F1 within 1 ms, Victor-Purpura distance a true event, and events over true ones.
    fn error(&self, events: &[Event]) -> String {
        let found = self.judge.compare(events.iter().copied());
        let ratio = events.len() as f64 / self.truth.len() as f64;
        format!("{:.2} / {:.2} / {:.2}", found.f1, found.victor_purpura, ratio)
    }
}

fn simulated(
    device: &Arc<Device>,
    scene: &Scene,
    frames: &[Frame],
    synthesis: Synthesis,
    layers: u32,
) -> Result<Vec<Event>> {
    let sensor =
        SensorModel { width: SIZE_PX.0, height: SIZE_PX.1, synthesis, layers, ..SensorModel::default() };
    let exact =
        GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U32), lens: scene.intrinsics() };
    let camera = CameraConfig {
        sensor,
        camera: 0,
        hdr: HdrFormat::F16x4,
        motion: Some(MotionFormat::F32x2),
        geometry: (synthesis == Synthesis::Rigid).then_some(exact),
    };
    let mut rig = Rig::new(device, &[camera])?;
    if synthesis == Synthesis::Rigid {
        rig.set_scene(0, scene.scene_motion(&pose_times_ns(FRAMES, RATE_HZ, POSE_RATE_HZ)))?;
    }
    let mut events = Vec::new();
    for Frame { t_ns, images } in frames {
        let esaac_scene::Frame { hdr, motion, depth, ids } = images;
        let depth_and_ids = (synthesis == Synthesis::Rigid).then_some((&depth[..], &ids[..]));
        let (depth, ids) = depth_and_ids.unzip();
        rig.upload(0, &FrameBytes { hdr, motion: Some(motion), depth, ids })?;
        events.extend(rig.step(&[*t_ns])?.packets[0].iter());
    }
    Ok(events)
}

fn still(hdr: &[u8]) -> Canvas {
    let halves: &[half::f16] = cast_slice(hdr);
    let colours = || halves.chunks_exact(4).map(|c| [c[0], c[1], c[2]].map(half::f16::to_f32));
    let exposure = colour::exposure(colours().map(colour::luminance));
    let pixels = colours().map(|c| colour::tone_map(c, exposure)).collect();
    Canvas { width_px: SIZE_PX.0 as usize, height_px: SIZE_PX.1 as usize, pixels }
}

/// The events of the part of the last interval that is shown.
fn shown(frames: &[Frame], events: &[Event]) -> Canvas {
    let [start_ns, end_ns] = [FRAMES - 2, FRAMES - 1].map(|index| frames[index].t_ns);
    let at = |fraction: f64| start_ns + (fraction * (end_ns - start_ns) as f64) as i64;
    let (width, height) = (SIZE_PX.0 as usize, SIZE_PX.1 as usize);
    let mut counts = vec![[0_u32; 2]; width * height];
    for event in events.iter().filter(|e| e.t_ns > at(SHOWN.0) && e.t_ns <= at(SHOWN.1)) {
        let on = usize::from(event.polarity == Polarity::On);
        counts[usize::from(event.y) * width + usize::from(event.x)][on] += 1;
    }
    let pixels = counts.into_iter().map(|[off, on]| colour::events(on, off)).collect();
    Canvas { width_px: width, height_px: height, pixels }
}
