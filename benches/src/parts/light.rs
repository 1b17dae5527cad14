//! What each effect of the physical pixel costs, and what leaving it out does to the events, in bright and in dim scenes:
//! which effects to model.

use super::sensors::clean;
use crate::amount::Amount;
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::measure::Stand;
use anyhow::Result;
use esaac_engine::RigOptions;
use esaac_model::packet::Event;
use esaac_model::physical::light::{Lens, SceneUnit};
use esaac_model::presets::preset_with_physical_pixel;
use esaac_model::{Pixel, SensorModel};
use esaac_oracle::metrics::compare;
use esaac_scene::SceneKind;
use serde::Serialize;

/// Illuminance of the scenes, lux.
const SCENES_LUX: [f64; 3] = [1000.0, 10.0, 0.1];

/// The lens before the sensor.
const LENS: Lens = Lens { f_number: 2.0, transmission: 0.9 };

/// The sensor whose pixel this is: the only one whose noise is fitted.
const PIXEL: &str = "hd";

#[derive(Serialize)]
struct Row {
    scene_lux: f64,
    name: &'static str,
    /// Time of an interval, microseconds.
    us: f64,
    /// Time of the whole pixel over this one's, minus one: what the effect costs.
    cost: f64,
    /// Events of a pixel and second.
    rate_hz: f64,
    /// The same over the whole pixel's.
    rate_ratio: f64,
    /// Victor-Purpura distance for each event of the whole pixel.
    victor_purpura: f64,
    /// Events matched within a millisecond.
    f1: f64,
}

type Change = fn(&mut SensorModel);

/// The whole pixel twice, with other random numbers for a floor; then without one effect each.
const VARIANTS: [(&str, Change); 10] = [
    ("the whole pixel", |_| ()),
    ("other random numbers", |s| s.seed += 1),
    ("without noise", |s| s.noise_gain = 0.0),
    ("without leak", |s| (s.leak_rate_hz, s.leak_per_lux_hz) = (0.0, 0.0)),
    ("without mismatch", |s| s.contrast_mismatch = 0.0),
    ("without refractory period", |s| s.refractory_ns = 0),
    ("without dark current", |s| s.dark_lux = 1e-9),
    ("without second pole", |s| s.second_pole_hz = 1e9),
    ("infinitely fast, without noise", |s| {
        (s.noise_gain, s.second_pole_hz, s.response_e_per_lux_s) = (0.0, 1e9, 1e9);
    }),
    ("log-intensity pixel", |s| {
        let dark_level = s.dark_level();
        (s.pixel, s.log_offset) = (Pixel::Log, dark_level.max(1e-6));
        (s.leak_rate_hz, s.shot_noise_rate_hz) = (0.0, 0.0);
    }),
];

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let size = clean(if laboratory.is_software() { "dvs128" } else { "genx320" });
    let base = SensorModel {
        width: size.width,
        height: size.height,
        ..preset_with_physical_pixel(PIXEL).expect("a preset")
    };
    let frames = if laboratory.options().quick { 10 } else { 31 };
    let amount = Amount { frames, warm_up: 1, passes: 1, keep: frames };
    let wanted: Vec<(f64, &'static str, Change)> =
        SCENES_LUX.iter().flat_map(|&lux| VARIANTS.map(|(name, change)| (lux, name, change))).collect();
    let mut whole: Option<(Vec<Event>, f64)> = None;
    let rows = laboratory.rows("light", wanted, |(scene_lux, name, change)| {
        let mut sensor = SensorModel { lux_per_unit: lux_per_unit(scene_lux)?, ..base.clone() };
        change(&mut sensor);
        let feed = laboratory.scene(SceneKind::Flight, (base.width, base.height))?;
        let run = Stand::new(laboratory, &sensor, 1, FORMATS, feed, RigOptions::default())?.run(amount)?;
        let us = run.timing.gpu_us.median;
        if name == VARIANTS[0].0 {
            whole = Some((run.events.clone(), us));
        }
        let (true_events, whole_us) = whole.as_ref().expect("the whole pixel is the first of each scene");
        let compared =
            compare((base.width, base.height), true_events.iter().copied(), run.events.iter().copied());
        let seconds = (frames - 1) as f64 * crate::scenes::FRAME_NS as f64 * 1e-9;
        Ok(Row {
            scene_lux,
            name,
            us,
            cost: whole_us / us - 1.0,
            rate_hz: run.events.len() as f64 / base.pixels() as f64 / seconds,
            rate_ratio: compared.count_ratio,
            victor_purpura: compared.victor_purpura,
            f1: compared.f1,
        })
    })?;
    let document = show(&base, &rows)?;
    Ok(Outcome { figures: serde_json::json!({ "rows": rows }), document })
}

/// Focal-plane lux of a white surface in a scene of this illuminance.
fn lux_per_unit(scene_lux: f64) -> Result<f64> {
    Ok(LENS.lux_per_unit(SceneUnit::Luminance)? * scene_lux / std::f64::consts::PI)
}

fn show(base: &SensorModel, rows: &[Row]) -> Result<Document> {
    let mut document = Document::new("Effects of the physical pixel in bright and dim scenes");
    document.say(&format!(
        "Scene `flight`, {}x{}, pixel of `{PIXEL}`, lens F/{} that passes {:.0}%. Each row leaves one effect out and is \
         compared with the whole pixel. `cost` is the time of the whole pixel over this row's, minus one: what the \
         effect costs. VP is the Victor-Purpura distance for each event of the whole pixel. Noise cannot be compared \
         event by event: what other random numbers alone do is the floor.",
        base.width,
        base.height,
        LENS.f_number,
        100.0 * LENS.transmission
    ));
    for scene_lux in SCENES_LUX {
        document.heading(&format!(
            "A scene of {} lux (white: {} lux on the focal plane)",
            short(scene_lux),
            short(lux_per_unit(scene_lux)?)
        ));
        let mut table = vec![cells!["pixel", "us", "cost", "events a px and s", "/ whole", "VP", "F1"]];
        table.extend(rows.iter().filter(|row| row.scene_lux == scene_lux).map(|row| {
            cells![
                row.name,
                short(row.us),
                format!("{:+.0}%", 100.0 * row.cost),
                short(row.rate_hz),
                short(row.rate_ratio),
                short(row.victor_purpura),
                short(row.f1)
            ]
        }));
        document.table(&table);
    }
    Ok(document)
}
