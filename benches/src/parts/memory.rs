//! Memory per resolution.

use super::sensors::{MODES, RIGID_MODES, noisy};
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::paper::{FACTORS, MEMORY_MB, SENSORS};
use crate::scenes::FRAME_NS;
use anyhow::Result;
use esaac_engine::{CameraConfig, GeometryConfig, Rig};
use esaac_model::{DepthFormat, IdFormat, SensorModel, Synthesis};
use esaac_scene::SceneKind;
use serde::Serialize;

#[derive(Serialize)]
struct Row {
    sensor: String,
    mode: &'static str,
    substeps: u32,
    cameras: usize,
    device_mb: f64,
    host_mb: f64,
    paper_mb: Option<f64>,
    /// Device memory of all cameras, in megabytes for each purpose.
    purposes_mb: Vec<(String, f64)>,
}

/// Modes of the rows whose memory is told by purpose.
const PURPOSE_MODES: [&str; 2] = [MODES[0].0, RIGID_MODES[0].0];

/// Most pixels of a rig on a software device, whose buffers lie in the machine's own memory.
const SOFTWARE_PIXELS: usize = 8 * 1280 * 720;

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let mut cells = Vec::new();
    for (sensor, of_sensor) in SENSORS.iter().zip(MEMORY_MB) {
        for (&substeps, of_factor) in FACTORS.iter().zip(of_sensor) {
            for ((mode, intensity), paper_mb) in MODES.into_iter().zip(of_factor) {
                let model = SensorModel { substeps, intensity, ..noisy(sensor) };
                cells.push((model, mode, 1, Some(paper_mb)));
            }
        }
    }
    // A rig's half-pel frames are at most 4 GiB. 48 HD cameras with Bayer just fit.
    for (sensor, most) in [("vga", 64), ("hd", 48)] {
        for cameras in [1, 8, most] {
            for (mode, intensity) in MODES {
                cells.push((SensorModel { intensity, ..noisy(sensor) }, mode, cameras, None));
            }
        }
    }
    for (sensor, cameras) in SENSORS.into_iter().map(|sensor| (sensor, 1)).chain([("vga", 1), ("vga", 64)]) {
        for (mode, intensity) in RIGID_MODES {
            let model = SensorModel { intensity, synthesis: Synthesis::Rigid, ..noisy(sensor) };
            cells.push((model, mode, cameras, None));
        }
    }
    let fits = |sensor: &SensorModel, cameras: usize| {
        !laboratory.is_software() || sensor.pixels() * cameras <= SOFTWARE_PIXELS
    };
    let (measured, left_out): (Vec<_>, Vec<_>) =
        cells.into_iter().partition(|(sensor, _, cameras, _)| fits(sensor, *cameras));
    let rows = laboratory.rows("memory", measured, |(sensor, mode, cameras, paper_mb)| {
        weigh(laboratory, &sensor, mode, cameras, paper_mb)
    })?;
    let left_out: Vec<String> =
        left_out.iter().map(|(s, mode, cameras, _)| format!("{cameras} x {} {mode}", s.name)).collect();
    let document = show(&rows, &left_out);
    Ok(Outcome { figures: serde_json::json!({ "rows": rows, "left_out": left_out }), document })
}

fn weigh(
    laboratory: &Laboratory,
    sensor: &SensorModel,
    mode: &'static str,
    cameras: usize,
    paper_mb: Option<f64>,
) -> Result<Row> {
    let (hdr, motion) = FORMATS;
    // The instances of a scene, as they take memory too.
    let scene = SceneKind::Flight.scene(sensor.width, sensor.height);
    let config =
        GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U32), lens: scene.intrinsics() };
    let geometry = (sensor.synthesis == Synthesis::Rigid).then_some(config);
    let configs: Vec<CameraConfig> = (0..cameras as u32)
        .map(|camera| CameraConfig { sensor: sensor.clone(), camera, hdr, motion: Some(motion), geometry })
        .collect();
    let mut rig = Rig::new(laboratory.device(), &configs)?;
    if geometry.is_some() {
        for camera in 0..cameras {
            rig.set_scene(camera, scene.scene_motion(&[0, FRAME_NS]))?;
        }
    }
    let memory = rig.memory();
    let mb = |on_host: bool| {
        memory.iter().filter(|m| m.on_host == on_host).map(|m| m.bytes as f64).sum::<f64>() / 1e6
    };
    let mut purposes_mb: Vec<(String, f64)> = Vec::new();
    for part in memory.iter().filter(|m| !m.on_host) {
        match purposes_mb.iter_mut().find(|(purpose, _)| *purpose == part.purpose) {
            Some((_, mb)) => *mb += part.bytes as f64 / 1e6,
            None => purposes_mb.push((part.purpose.clone(), part.bytes as f64 / 1e6)),
        }
    }
    purposes_mb.sort_by(|a, b| b.1.total_cmp(&a.1));
    let substeps = sensor.substeps;
    let (device_mb, host_mb, sensor) = (mb(false), mb(true), sensor.name.clone());
    Ok(Row { sensor, mode, substeps, cameras, device_mb, host_mb, paper_mb, purposes_mb })
}

fn show(rows: &[Row], left_out: &[String]) -> Document {
    let mut document = Document::new("Memory per resolution");
    document.say(
        "Megabytes (1e6 bytes) of device memory, profile `noisy`, f16x4 colour, f32x2 motion, event buffers for \
         1.5 events a pixel; packets and APS frames lie in host memory. Beside it the paper's table of allocated \
         GPU memory (RTX 4060).",
    );
    let mut head = cells!["sensor"];
    for substeps in FACTORS {
        head.extend(MODES.map(|(mode, _)| format!("x{substeps} {mode}")));
    }
    let mut table = vec![head];
    for sensor in SENSORS {
        let mut line = cells![sensor];
        for row in rows.iter().filter(|r| r.sensor == sensor && r.paper_mb.is_some()) {
            line.push(format!("{} / {}", short(row.device_mb), row.paper_mb.map_or("-".into(), short)));
        }
        table.push(line);
    }
    document.table(&table);
    let mut table = vec![cells!["cameras", "mode", "device MB", "host MB", "device MB a camera"]];
    for row in rows.iter().filter(|r| r.paper_mb.is_none() && MODES.iter().any(|(mode, _)| *mode == r.mode)) {
        table.push(cells![
            format!("{} x {}", row.cameras, row.sensor),
            row.mode,
            short(row.device_mb),
            short(row.host_mb),
            short(row.device_mb / row.cameras as f64)
        ]);
    }
    document.table(&table);
    if !left_out.is_empty() {
        document.say(&format!("Left out on a software device: {}.", left_out.join(", ")));
    }
    document.say(
        "With synthesis `rigid` a camera takes depth (f32), instance ids (u32) and poses beside motion vectors, and \
         keeps its pixels' surfaces:",
    );
    let mut table = vec![cells!["cameras", "mode", "motion, device MB", "rigid", "more"]];
    for row in rows {
        let Some(&(_, intensity)) = RIGID_MODES.iter().find(|(mode, _)| *mode == row.mode) else { continue };
        let Some(&(mode, _)) = MODES.iter().find(|(_, of)| *of == intensity) else { continue };
        let same = |r: &&Row| {
            r.mode == mode && (&r.sensor, r.cameras, r.substeps) == (&row.sensor, row.cameras, row.substeps)
        };
        if let Some(without) = rows.iter().find(same) {
            table.push(cells![
                format!("{} x {}", row.cameras, row.sensor),
                mode,
                short(without.device_mb),
                short(row.device_mb),
                format!("{:.0}%", 100.0 * (row.device_mb / without.device_mb - 1.0))
            ]);
        }
    }
    document.table(&table);
    for mode in PURPOSE_MODES {
        document.say(&format!("By purpose, x32, {mode}, megabytes:"));
        document.table(&by_purpose(rows, mode));
    }
    document
}

/// A line for each sensor, a column for each purpose.
fn by_purpose(rows: &[Row], mode: &str) -> Vec<Vec<String>> {
    let of_mode: Vec<&Row> =
        rows.iter().filter(|r| r.cameras == 1 && r.substeps == 32 && r.mode == mode).collect();
    let mut names: Vec<&String> = Vec::new();
    for (name, _) in of_mode.iter().flat_map(|r| &r.purposes_mb).filter(|(_, mb)| *mb >= 0.01) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let mut table =
        vec![std::iter::once("sensor".to_owned()).chain(names.iter().map(|n| n.to_string())).collect()];
    for row in of_mode {
        let of = |name: &String| row.purposes_mb.iter().find(|(n, _)| n == name).map_or(0.0, |(_, mb)| *mb);
        let figures = names.iter().map(|name| format!("{:.2}", of(name)));
        table.push(std::iter::once(row.sensor.clone()).chain(figures).collect());
    }
    table
}
