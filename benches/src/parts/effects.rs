//! Cost of each sensor effect. An effect that is off must cost nothing.

use super::sensors::{clean, noisy};
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::measure::{Stand, Timing};
use anyhow::Result;
use esaac_engine::RigOptions;
use esaac_model::{Intensity, ReadoutKind, SensorModel, Synthesis};
use esaac_scene::SceneKind;
use serde::Serialize;

#[derive(Serialize)]
struct Row {
    name: &'static str,
    /// Time with the effect on, microseconds.
    on_us: f64,
    /// Relative cost: time with the effect over the clean sensor's, minus one.
    cost: f64,
    /// Time after the effect was on and is off again, microseconds.
    off_us: f64,
    /// Time of the clean sensor, measured right after it, microseconds.
    absent_us: f64,
    /// Noise, relative: the largest of the distances between quartiles and of the difference between the clean sensor's
    /// two runs.
    spread: f64,
    /// Whether the kernels after switching off include all kernels of the clean sensor; `None` if the driver has no
    /// statistics.
    same_kernels: Option<bool>,
    events_per_pixel: f64,
}

type Change = fn(&mut SensorModel);

const EFFECTS: [(&str, Change); 18] = [
    ("mismatch", |s| s.contrast_mismatch = 0.05),
    ("refractory", |s| s.refractory_ns = 500_000),
    ("leak", |s| s.leak_rate_hz = 0.1),
    ("shot noise", |s| s.shot_noise_rate_hz = 5.0),
    ("latency", |s| s.latency_ns = 100_000),
    ("jitter", |s| s.latency_jitter_ns = 10_000),
    ("quantum", |s| s.timestamp_quantum_ns = 1_000),
    ("APS", |s| s.aps_exposure_ns = 10_000_000),
    ("blur", |s| s.psf_sigma_px = 0.7),
    ("vignetting", |s| s.vignetting_fov_deg = 60.0),
    // Below the thresholds: a deeper flicker costs what its events cost, and makes the event queues grow.
    ("flicker", |s| s.flicker_depth = 0.05),
    ("silicon", |s| s.intensity = Intensity::SiliconFront),
    ("Bayer", |s| s.intensity = Intensity::BayerRggb),
    ("one transfer", |s| s.transfers = 1),
    ("three transfers", |s| s.transfers = 3),
    ("readout, one by one", |s| (s.readout, s.readout_event_ns) = (ReadoutKind::Fifo, 83.0)),
    ("readout by row", |s| (s.readout, s.readout_row_ns) = (ReadoutKind::Rows, 130.0)),
    ("physical pixel", |s| *s = s.clone().with_preset_pixel()),
];

/// Least relative difference of medians that counts as one, if the spread is smaller.
const NOISE: f64 = 0.03;

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let base = clean(if laboratory.is_software() { "dvs128" } else { "genx320" });
    let stand = |sensor: &SensorModel| {
        let feed = laboratory.scene(SceneKind::Flight, (base.width, base.height))?;
        Stand::new(laboratory, sensor, 1, FORMATS, feed, RigOptions::default())
    };
    let amount = laboratory.amount();
    let mut absent = stand(&base)?;
    let clean_timing = absent.run(amount)?.timing;
    let kernels = absent.kernel_statistics()?;
    let rows = laboratory.rows("effects", EFFECTS.to_vec(), |(name, change)| {
        let mut sensor = base.clone();
        change(&mut sensor);
        let mut switched = stand(&sensor)?;
        let on = switched.run(amount)?.timing;
        switched.set_sensor(&base)?;
        let off = switched.run(amount)?.timing;
        // Measure the clean sensor again now, so that other load of the machine is in both times.
        let again = absent.run(amount)?.timing;
        // The rig has compiled kernels for both sensors. The clean sensor's kernels must be among them, unchanged.
        let there = switched.kernel_statistics()?;
        let same_kernels = (kernels.iter().any(|(_, told)| !told.is_empty()))
            .then(|| kernels.iter().all(|kernel| there.contains(kernel)));
        Ok(row(name, &clean_timing, &again, [&on, &off], same_kernels))
    })?;
    let whole = [
        ("clean", base.clone()),
        ("noisy: every effect", noisy(&base.name)),
        ("linear", SensorModel { synthesis: Synthesis::Linear, ..base.clone() }),
    ];
    let wholes = laboratory
        .rows("effects", whole.to_vec(), |(name, sensor)| Ok((name, stand(&sensor)?.run(amount)?.timing)))?;
    let document = show(&base, &rows, &wholes);
    let figures = serde_json::json!({ "clean": clean_timing, "effects": rows, "whole": wholes });
    Ok(Outcome { figures, document })
}

fn row(
    name: &'static str,
    clean: &Timing,
    absent: &Timing,
    [on, off]: [&Timing; 2],
    same_kernels: Option<bool>,
) -> Row {
    let own = (absent.gpu_us.median / clean.gpu_us.median - 1.0).abs();
    let spread = [absent, on, off].map(|t| t.gpu_us.relative()).into_iter().fold(own, f64::max);
    Row {
        name,
        on_us: on.gpu_us.median,
        cost: on.gpu_us.median / absent.gpu_us.median - 1.0,
        off_us: off.gpu_us.median,
        absent_us: absent.gpu_us.median,
        spread,
        same_kernels,
        events_per_pixel: on.events_per_pixel,
    }
}

fn show(base: &SensorModel, rows: &[Row], wholes: &[(&str, Timing)]) -> Document {
    let mut document = Document::new("Cost of each sensor effect");
    let clean_us = wholes[0].1.gpu_us.median;
    document.say(&format!(
        "{} {}x{}, scene `flight`, each effect alone on top of the clean sensor ({} us). `off again` is the same \
         rig with the effect switched off at run time: it must cost what the clean sensor does. The kernels are \
         compared too, where the driver tells of them.",
        base.name,
        base.width,
        base.height,
        short(clean_us)
    ));
    let mut table = vec![cells![
        "effect",
        "on, us",
        "cost",
        "off again, us",
        "off / absent",
        "spread",
        "kernels",
        "verdict"
    ]];
    for row in rows {
        let ratio = row.off_us / row.absent_us;
        let band = NOISE.max(row.spread);
        let equal = (ratio - 1.0).abs() <= band && row.same_kernels != Some(false);
        table.push(cells![
            row.name,
            short(row.on_us),
            format!("{:+.0}%", 100.0 * row.cost),
            short(row.off_us),
            format!("{ratio:.3}"),
            format!("{:.1}%", 100.0 * row.spread),
            match row.same_kernels {
                Some(true) => "the same",
                Some(false) => "OTHERS",
                None => "not told",
            },
            if equal { "off equals absent" } else { "**DIFFERS**" }
        ]);
    }
    document.table(&table);
    let mut table = vec![cells!["sensor", "us", "events a px"]];
    for (name, timing) in wholes {
        table.push(cells![name, short(timing.gpu_us.median), short(timing.events_per_pixel)]);
    }
    document.table(&table);
    document
}
