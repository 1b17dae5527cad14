//! Packets into messages of ROS 2: encoded in place, where the device wrote them, and encoded from a copy.

use super::sensors::clean;
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::scenes::FRAME_NS;
use crate::statistics::Spread;
use anyhow::Result;
use esaac_engine::{CameraConfig, PacketPlace, Rig, RigOptions};
use esaac_model::{Packet, PacketView};
use esaac_ros::EventFormat;
use esaac_ros::encode::Header;
use esaac_ros::events::{PacketHead, encode};
use esaac_scene::SceneKind;
use serde::Serialize;
use std::time::Instant;

#[derive(Serialize)]
struct Row {
    sensor: &'static str,
    format: &'static str,
    /// Mean events of a packet and mean bytes of its message.
    events: f64,
    bytes: f64,
    /// Time to copy the packet and encode the message from the copy, microseconds.
    copied_us: Spread,
    /// Time to encode the message in place, microseconds.
    in_place_us: Spread,
}

/// Number of timed ticks of each kind.
const TICKS: usize = 100;
const SOFTWARE_TICKS: usize = 12;
const QUICK_TICKS: usize = 3;
const WARM_UP: usize = 4;

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let mut cells = Vec::new();
    let quick = laboratory.is_software() && laboratory.options().quick;
    let sensors: &[_] = if quick { &["davis346"] } else { &["davis346", "genx320", "vga"] };
    for &sensor in sensors {
        cells.extend(EventFormat::NAMES.map(|(name, format)| (sensor, name, format)));
    }
    cells.retain(|(sensor, name, _)| laboratory.wants(&format!("{sensor} {name}")));
    let rows = laboratory
        .rows("encode", cells, |(sensor, name, format)| measure(laboratory, sensor, name, format))?;
    let document = show(&rows);
    Ok(Outcome { figures: serde_json::json!({ "rows": rows }), document })
}

/// Times ticks of both kinds by turns. Each packet is read only once, because a second reading would find it in the
/// cache.
fn measure(
    laboratory: &Laboratory,
    sensor: &'static str,
    name: &'static str,
    format: EventFormat,
) -> Result<Row> {
    let model = clean(sensor);
    let mut feed = laboratory.scene(SceneKind::Flight, (model.width, model.height))?;
    let (hdr, motion) = FORMATS;
    let config = CameraConfig { sensor: model, camera: 0, hdr, motion: Some(motion), geometry: None };
    let options = RigOptions { packets: PacketPlace::InPlace, ..RigOptions::default() };
    let mut rig = Rig::with_options(laboratory.device(), &[config], options)?;
    let ticks = match (laboratory.is_software(), laboratory.options().quick) {
        (true, true) => QUICK_TICKS,
        (true, false) => SOFTWARE_TICKS,
        (false, _) => TICKS,
    };
    let (mut owned, mut message) = (Packet::default(), Vec::new());
    let (mut copied_us, mut in_place_us) = (Vec::new(), Vec::new());
    let (mut events, mut bytes) = (0, 0);
    for index in 0..WARM_UP + 2 * ticks {
        let t_ns = feed.put(&mut rig, index)?;
        let tick = rig.step(&[t_ns])?;
        let view = tick.view(0);
        let began = Instant::now();
        let copies = index % 2 == 0;
        if copies {
            copy(&view, &mut owned);
            write(&mut message, format, &owned.view());
        } else {
            write(&mut message, format, &view);
        }
        let took_us = began.elapsed().as_secs_f64() * 1e6;
        if index >= WARM_UP {
            if copies {
                copied_us.push(took_us)
            } else {
                in_place_us.push(took_us)
            }
            events += view.len();
            bytes += message.len();
        }
    }
    let (copied_us, in_place_us) = (Spread::of(&copied_us), Spread::of(&in_place_us));
    let a_tick = |sum: usize| sum as f64 / (2 * ticks) as f64;
    Ok(Row { sensor, format: name, events: a_tick(events), bytes: a_tick(bytes), copied_us, in_place_us })
}

/// Copies into storage that is already allocated, as a rig does with `PacketPlace::Owned`.
fn copy(view: &PacketView<'_>, packet: &mut Packet) {
    packet.clear();
    packet.t_offset_ns.extend_from_slice(view.t_offset_ns);
    packet.x.extend_from_slice(view.x);
    packet.y.extend_from_slice(view.y);
    packet.polarity.extend_from_slice(view.polarity);
}

fn write(message: &mut Vec<u8>, format: EventFormat, packet: &PacketView<'_>) {
    let header = Header { stamp_ns: packet.watermark_ns, frame_id: "camera_optical_frame" };
    encode(message, format, &PacketHead { header, sequence: 0, sensor_name: "sensor" }, packet);
}

fn show(rows: &[Row]) -> Document {
    let mut document = Document::new("Packets into ROS messages");
    document.say(&format!(
        "Scene `flight` at {:.0} Hz. Microseconds from the tick's end to the encoded message: the packet copied out \
         of the memory that the device wrote and encoded from the copy, against encoded from that memory; ticks of \
         both kinds by turns.",
        1e9 / FRAME_NS as f64
    ));
    let mut table = vec![cells!["sensor", "message", "events", "kB", "copied", "in place", "ratio"]];
    for row in rows {
        table.push(cells![
            row.sensor,
            row.format,
            short(row.events),
            short(row.bytes / 1e3),
            short(row.copied_us.median),
            short(row.in_place_us.median),
            short(row.in_place_us.median / row.copied_us.median)
        ]);
    }
    document.table(&table);
    document
}
