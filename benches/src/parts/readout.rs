//! Cost of each sensor's bus.

use super::sensors::{clean, stages};
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::measure::{Stand, Timing};
use crate::paper::SENSORS;
use anyhow::Result;
use esaac_engine::RigOptions;
use esaac_model::{ReadoutKind, SensorModel};
use esaac_scene::SceneKind;
use serde::Serialize;

/// Service of an event for a bus that serves one by one where the sensor's own does not; of a row likewise.
const EVENT_NS: f64 = 83.0;
const ROW_NS: f64 = 130.0;

#[derive(Serialize)]
struct Row {
    sensor: String,
    readout: ReadoutKind,
    /// Whether the sensor has such a bus.
    own: bool,
    /// Without a bus, measured before and after.
    off: [Timing; 2],
    on: Timing,
    /// Time with the bus over the mean of the times without, minus one.
    cost: f64,
    /// The same of the mean over ticks: ticks in which events wait for long take another submission.
    mean_cost: f64,
    /// Stages with the bus.
    stages_us: Vec<(&'static str, f64)>,
}

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let cases: Vec<_> = SENSORS
        .into_iter()
        .flat_map(|name| [ReadoutKind::Fifo, ReadoutKind::Rows].map(|kind| (name, kind)))
        .filter(|(name, kind)| laboratory.wants(&format!("{name}, {}", kind.name())))
        .collect();
    let rows = laboratory.rows("readout", cases, |(name, kind)| measure(laboratory, name, kind))?;
    Ok(Outcome { document: show(&rows), figures: serde_json::json!({ "rows": rows }) })
}

fn measure(laboratory: &Laboratory, name: &str, kind: ReadoutKind) -> Result<Row> {
    let plain = clean(name);
    let own = (plain.readout_row_ns > 0.0) == (kind == ReadoutKind::Rows);
    let bus = match (own, kind) {
        (true, _) => SensorModel { readout: kind, ..plain.clone() },
        (false, ReadoutKind::Rows) => SensorModel { readout: kind, readout_row_ns: ROW_NS, ..plain.clone() },
        (false, _) => {
            SensorModel { readout: kind, readout_event_ns: EVENT_NS, readout_row_ns: 0.0, ..plain.clone() }
        }
    };
    let stand = |sensor: &SensorModel, stage_times| {
        let feed = laboratory.scene(SceneKind::Flight, (sensor.width, sensor.height))?;
        Stand::new(laboratory, sensor, 1, FORMATS, feed, RigOptions { stage_times, ..RigOptions::default() })
    };
    let amount = laboratory.amount();
    let (mut without, mut with) = (stand(&plain, false)?, stand(&bus, false)?);
    let before = without.run(amount)?.timing;
    let on = with.run(amount)?.timing;
    let after = without.run(amount)?.timing;
    let stages_us = stand(&bus, true)?.run(amount)?.stages_us;
    let cost = |of: fn(&Timing) -> f64| 2.0 * of(&on) / (of(&before) + of(&after)) - 1.0;
    Ok(Row {
        sensor: name.to_owned(),
        readout: kind,
        own,
        cost: cost(|timing| timing.gpu_us.median),
        mean_cost: cost(|timing| timing.gpu_mean_us),
        stages_us,
        off: [before, after],
        on,
    })
}

fn show(rows: &[Row]) -> Document {
    let mut document = Document::new("Cost of the readout");
    document.say(&format!(
        "Scene `flight`, clean sensors, microseconds of a tick without a bus (before and after) and with one: the sensor's own, \
         or {EVENT_NS} ns an event, or {ROW_NS} ns a row. *Mean*: of the mean over ticks instead of the median."
    ));
    let mut table = vec![cells!["sensor", "readout", "off, us", "on, us", "cost", "mean", "stages, us"]];
    for row in rows {
        let kind = row.readout.name();
        table.push(cells![
            row.sensor,
            if row.own { format!("{kind}, its own") } else { kind.to_owned() },
            format!("{}, {}", short(row.off[0].gpu_us.median), short(row.off[1].gpu_us.median)),
            short(row.on.gpu_us.median),
            format!("{:+.0}%", 100.0 * row.cost),
            format!("{:+.0}%", 100.0 * row.mean_cost),
            stages(&row.stages_us)
        ]);
    }
    document.table(&table);
    document
}
