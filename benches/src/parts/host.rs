//! What poses cost the host.

use super::sensors::clean;
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::laboratory::Laboratory;
use crate::scenes::FRAME_NS;
use crate::statistics::median;
use anyhow::Result;
use esaac_engine::{CameraConfig, FrameBytes, GeometryConfig, Rig};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::{DepthFormat, HdrFormat, IdFormat, SensorModel, Synthesis};
use glam::{DQuat, DVec3};
use serde::Serialize;
use std::time::Instant;

/// Side of an image, pixels: small, so that the device hardly matters.
const SIDE_PX: u32 = 16;

/// Poses of a track from frame to frame.
const POSES: i64 = 8;

/// Ticks that are timed, after the first.
const TICKS: i64 = 9;

#[derive(Serialize)]
struct Row {
    cameras: usize,
    bodies: u32,
    set_scene_us: f64,
    prepare_us: f64,
}

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let cameras: &[usize] = if laboratory.options().quick { &[4, 16] } else { &[1, 16, 64, 256] };
    let cases = cameras.iter().flat_map(|&cameras| [0, 3].map(|bodies| (cameras, bodies))).collect();
    let rows = laboratory.rows("host", cases, |(cameras, bodies)| measure(laboratory, cameras, bodies))?;
    Ok(Outcome { document: show(&rows), figures: serde_json::json!({ "rows": rows }) })
}

fn measure(laboratory: &Laboratory, cameras: usize, bodies: u32) -> Result<Row> {
    let centre_px = 0.5 * f64::from(SIDE_PX - 1);
    let lens = Intrinsics::pinhole(20.0, 20.0, centre_px, centre_px)?;
    let sensor =
        SensorModel { width: SIDE_PX, height: SIDE_PX, synthesis: Synthesis::Rigid, ..clean("dvs128") };
    let geometry = GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U32), lens };
    let config = |camera| CameraConfig {
        sensor: sensor.clone(),
        camera,
        hdr: HdrFormat::F32x4,
        motion: None,
        geometry: Some(geometry),
    };
    let configs: Vec<CameraConfig> = (0..cameras as u32).map(config).collect();
    let mut rig = Rig::new(laboratory.device(), &configs)?;
    let pixels = sensor.pixels();
    let (hdr, depth) = (1.0_f32.to_le_bytes().repeat(4 * pixels), 3.0_f32.to_le_bytes().repeat(pixels));
    let ids: Vec<u8> = (0..pixels).flat_map(|pixel| (pixel as u32 % (bodies + 1)).to_le_bytes()).collect();
    let frame = FrameBytes { hdr: &hdr, depth: Some(&depth), ids: Some(&ids), ..FrameBytes::default() };
    for camera in 0..cameras {
        rig.upload(camera, &frame)?;
    }
    let (mut set_us, mut prepare_us) = (Vec::new(), Vec::new());
    for tick in 0..=TICKS {
        let scenes =
            (0..cameras).map(|camera| scene(lens, camera, bodies, tick)).collect::<Result<Vec<_>>>()?;
        let started = Instant::now();
        for (camera, scene) in scenes.into_iter().enumerate() {
            rig.set_scene(camera, scene)?;
        }
        let set = started.elapsed();
        let started = Instant::now();
        let submitted_ns = rig.step(&vec![tick * FRAME_NS; cameras])?.submit_to_packet_ns;
        let whole = started.elapsed();
        if tick > 0 {
            set_us.push(set.as_secs_f64() * 1e6);
            prepare_us.push(whole.as_secs_f64() * 1e6 - submitted_ns as f64 / 1e3);
        }
    }
    Ok(Row { cameras, bodies, set_scene_us: median(&set_us), prepare_us: median(&prepare_us) })
}

/// A camera that turns and bodies that fly, with the poses of the interval that ends at `tick`.
fn scene(lens: Intrinsics, camera: usize, bodies: u32, tick: i64) -> Result<SceneMotion> {
    let track = |speed: f64| -> Result<PoseTrack> {
        let times_ns: Vec<i64> = (0..=POSES).map(|i| (tick - 1) * FRAME_NS + i * FRAME_NS / POSES).collect();
        let pose = |&t_ns: &i64| {
            let t_s = t_ns as f64 * 1e-9;
            Pose::new(
                DQuat::from_scaled_axis(DVec3::new(0.0, speed * t_s, 0.1 * (9.0 * t_s).sin())),
                DVec3::new(0.1 * t_s, 0.0, camera as f64),
            )
        };
        Ok(PoseTrack::new(times_ns.clone(), times_ns.iter().map(pose).collect::<Result<_, _>>()?)?)
    };
    let mut scene = SceneMotion::new(lens, track(0.5)?);
    for id in 1..=bodies {
        scene.insert(id, track(f64::from(id))?)?;
    }
    Ok(scene)
}

fn show(rows: &[Row]) -> Document {
    let mut document = Document::new("What poses cost the host");
    document.say(&format!(
        "Microseconds of a tick of many small cameras with synthesis `rigid`, each with a track of its own and \
         {} poses an interval for itself and each body. *Set*: `Rig::set_scene` for all cameras. *Prepare*: what \
         `Rig::step` does before it submits.",
        POSES + 1
    ));
    let head = cells!["cameras", "bodies each", "set", "prepare", "a camera"];
    let row = |r: &Row| {
        let each = (r.set_scene_us + r.prepare_us) / r.cameras as f64;
        cells![r.cameras, r.bodies, short(r.set_scene_us), short(r.prepare_us), short(each)]
    };
    document.table(&std::iter::once(head).chain(rows.iter().map(row)).collect::<Vec<_>>());
    document
}
