//! What representations of packets cost on the device.

use super::sensors::noisy;
use crate::amount::Amount;
use crate::cells;
use crate::document::{Document, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::measure::Stand;
use crate::statistics::median;
use anyhow::Result;
use esaac_engine::ash::vk;
use esaac_engine::{MemoryLocation, PacketPlace, Representation, RigOptions, Share};
use esaac_model::{SensorModel, Synthesis};
use esaac_scene::SceneKind;
use serde::Serialize;
use std::time::Instant;

/// Name of the rows, for `--only`.
pub(super) const NAME: &str = "representations";

/// Frames before the packets that are represented.
const FRAMES: usize = 4;

/// How often each is made, after the first time.
const ROUNDS: usize = 20;

#[derive(Serialize)]
pub(super) struct Row {
    what: &'static str,
    cameras: usize,
    million_events: f64,
    us: f64,
}

const KINDS: [(&str, Representation); 4] = [
    ("gathered", Representation::Gathered),
    ("event_frame", Representation::EventFrame),
    ("voxel_grid, 5 bins", Representation::VoxelGrid { bins: 5 }),
    ("event_ids", Representation::EventIds),
];

pub(super) fn measure(laboratory: &Laboratory) -> Result<Vec<Row>> {
    let cameras: &[usize] = if laboratory.is_software() { &[1] } else { &[1, 8] };
    let cases = cameras.iter().flat_map(|&cameras| KINDS.map(|kind| (cameras, kind))).collect();
    laboratory.rows(NAME, cases, |(cameras, (name, what))| {
        let camera = noisy(if laboratory.is_software() { "dvs128" } else { "vga" });
        let sensor = SensorModel { synthesis: Synthesis::Rigid, ..camera };
        let feed = laboratory.scene(SceneKind::Bounce, (sensor.width, sensor.height))?;
        let options = RigOptions { packets: PacketPlace::OnDevice, ..RigOptions::default() };
        let mut stand = Stand::new(laboratory, &sensor, cameras, FORMATS, feed, options)?;
        stand.run(Amount { frames: FRAMES, warm_up: 0, keep: 0, passes: 1 })?;
        let rig = stand.rig_mut();
        let events = rig.elements(Representation::Gathered) as f64;
        let bytes = (rig.elements(what) * what.element_bytes()).max(16);
        let usage = vk::BufferUsageFlags::empty();
        let target = laboratory.device().allocate("representation", bytes, usage, MemoryLocation::GpuOnly)?;
        let mut rounds_us = Vec::new();
        for round in 0..=ROUNDS {
            laboratory.clock().heat()?;
            let started = Instant::now();
            rig.represent(what, &target, Share::default())?;
            // The first one compiles its kernels.
            if round > 0 {
                rounds_us.push(started.elapsed().as_secs_f64() * 1e6);
            }
        }
        Ok(Row { what: name, cameras, million_events: events * 1e-6, us: median(&rounds_us) })
    })
}

pub(super) fn show(document: &mut Document, rows: &[Row]) {
    document.heading(NAME);
    document.say(
        "Representations of the packets of a tick, scene `bounce`, synthesis `rigid`, made on the device: by the host's \
         clock, from the call to the end of the wait.",
    );
    let head = cells!["representation", "cameras", "million events", "us", "ns an event"];
    let row = |r: &Row| {
        cells![r.what, r.cameras, short(r.million_events), short(r.us), short(1e-3 * r.us / r.million_events)]
    };
    document.table(&std::iter::once(head).chain(rows.iter().map(row)).collect::<Vec<_>>());
}
