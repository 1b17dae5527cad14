//! What poses, and the report of the light, cost the host.

use super::sensors::clean;
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::laboratory::Laboratory;
use crate::scenes::FRAME_NS;
use crate::statistics::median;
use anyhow::Result;
use esaac_engine::{CameraConfig, FrameBytes, GeometryConfig, Rig};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::presets::preset_with_physical_pixel;
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
    let light_cameras: &[usize] = if laboratory.options().quick { &[1] } else { &[1, 4, 16] };
    let light =
        laboratory.rows("host", light_cameras.to_vec(), |cameras| measure_light(laboratory, cameras))?;
    let mut document = show(&rows);
    show_light(&mut document, &light);
    Ok(Outcome { document, figures: serde_json::json!({ "rows": rows, "light": light }) })
}

/// Ticks of a pass over cameras whose light is looked at; few of them look. Passes, and those of `--quick`.
const LIGHT_TICKS: i64 = 70;
const LIGHT_PASSES: [i64; 2] = [6, 1];

/// Ticks of such cameras: those that look at the light, and the others.
#[derive(Serialize)]
struct LightRow {
    cameras: usize,
    looks: usize,
    look_us: f64,
    other_us: f64,
}

fn measure_light(laboratory: &Laboratory, cameras: usize) -> Result<LightRow> {
    let sensor = SensorModel {
        width: 640,
        height: 480,
        synthesis: Synthesis::Linear,
        ..preset_with_physical_pixel("vga").expect("a preset")
    };
    let config = |camera| CameraConfig {
        sensor: sensor.clone(),
        camera,
        hdr: HdrFormat::F16x4,
        motion: None,
        geometry: None,
    };
    let configs: Vec<CameraConfig> = (0..cameras as u32).map(config).collect();
    let mut rig = Rig::new(laboratory.device(), &configs)?;
    // Still light of an intensity of 1.
    let hdr = 0x3c00_u16.to_le_bytes().repeat(4 * sensor.pixels());
    for camera in 0..cameras {
        rig.upload(camera, &FrameBytes { hdr: &hdr, ..FrameBytes::default() })?;
    }
    let (mut looks_us, mut others_us) = (Vec::new(), Vec::new());
    for _ in 0..LIGHT_PASSES[usize::from(laboratory.options().quick)] {
        (0..cameras).try_for_each(|camera| rig.reset(camera))?;
        for tick in 0..LIGHT_TICKS {
            let looked = |rig: &Rig| rig.light(0).map(|light| light.map_or(0, |light| light.frames));
            let before = looked(&rig)?;
            let started = Instant::now();
            let submitted_ns = rig.step(&vec![tick * FRAME_NS; cameras])?.submit_to_packet_ns;
            let own_us = started.elapsed().as_secs_f64() * 1e6 - submitted_ns as f64 / 1e3;
            // The first ticks record commands.
            if tick > 1 {
                if looked(&rig)? > before { &mut looks_us } else { &mut others_us }.push(own_us);
            }
        }
    }
    let (look_us, other_us) = (median(&looks_us), median(&others_us));
    Ok(LightRow { cameras, looks: looks_us.len(), look_us, other_us })
}

fn show_light(document: &mut Document, rows: &[LightRow]) {
    document.say(
        "Microseconds of a tick before it is submitted, cameras of 640x480 with a physical pixel. *Looks*: ticks that read some \
         rows of the frame back for the report of the light. *Each*: what that costs a tick if one in 256 looks.",
    );
    let mut table = vec![cells!["cameras", "looks", "others", "a look costs", "each"]];
    for row in rows {
        let cost_us = row.look_us - row.other_us;
        table.push(cells![
            row.cameras,
            short(row.look_us),
            short(row.other_us),
            short(cost_us),
            short(cost_us / 256.0)
        ]);
    }
    document.table(&table);
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
    let times_ns: Vec<i64> = (0..=POSES).map(|i| (tick - 1) * FRAME_NS + i * FRAME_NS / POSES).collect();
    let track = |speed: f64| {
        PoseTrack::through(&times_ns, |t_s| {
            Pose::new(
                DQuat::from_scaled_axis(DVec3::new(0.0, speed * t_s, 0.1 * (9.0 * t_s).sin())),
                DVec3::new(0.1 * t_s, 0.0, camera as f64),
            )
            .expect("finite numbers")
        })
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
