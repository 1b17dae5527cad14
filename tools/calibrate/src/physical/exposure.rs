//! Recordings of a sensor under known light, and a list of them.

use anyhow::{Context, Result, bail, ensure};
use esaac_formats::event_file::read_npz;
use esaac_formats::recording::aedat4;
use esaac_model::packet::Event;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// How light swings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// Like a sine.
    #[default]
    Sine,
    /// In steps: up half a period after the recording begins, down with each full one.
    Step,
}

/// Light that swings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Flicker {
    /// Frequency, Hz.
    pub hz: f64,
    /// Depth of the modulation: the light swings from `lux (1 - depth)` to `lux (1 + depth)`.
    pub depth: f64,
    /// How it swings.
    pub shape: Shape,
}

/// A recording of a sensor whose pixels all see the same light.
#[derive(Clone, Debug)]
pub struct Exposure {
    /// Name for reports.
    pub name: String,
    /// Mean light, focal-plane lux.
    pub lux: f64,
    /// How the light swings; `None` if it is still.
    pub flicker: Option<Flicker>,
    /// Number of pixels.
    pub pixels: usize,
    /// Columns.
    pub width_px: u32,
    /// Length, seconds.
    pub seconds: f64,
    /// Events in time order, from time 0 on, burn-in left out.
    pub events: Vec<Event>,
}

/// A list of exposures, as TOML.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    /// Time at the start of each recording that is left out, seconds.
    #[serde(default)]
    burn_in_s: f64,
    exposure: Vec<Entry>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// Recording, relative to the list.
    file: PathBuf,
    lux: f64,
    #[serde(default)]
    kind: Shape,
    flicker_hz: Option<f64>,
    depth: Option<f64>,
    /// Length of the recording, seconds; without, the time of its last event.
    seconds: Option<f64>,
}

/// Recordings under known light, and the time that was left out at their start.
#[derive(Clone, Debug)]
pub struct Exposures {
    /// Time that the light had been on before each recording begins, seconds.
    pub burn_in_s: f64,
    /// The recordings.
    pub all: Vec<Exposure>,
}

/// Reads a list and the recordings that it names.
pub fn read_exposures(path: &Path) -> Result<Exposures> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("cannot read exposures {}", path.display()))?;
    let list: List = toml::from_str(&text).with_context(|| format!("exposures {}", path.display()))?;
    ensure!((0.0..=3600.0).contains(&list.burn_in_s), "burn_in_s is {}, expected 0 to 3600", list.burn_in_s);
    let folder = path.parent().unwrap_or(Path::new("."));
    let read = |entry: &Entry| entry.read(folder, list.burn_in_s);
    Ok(Exposures { burn_in_s: list.burn_in_s, all: list.exposure.iter().map(read).collect::<Result<_>>()? })
}

impl Entry {
    fn read(&self, folder: &Path, burn_in_s: f64) -> Result<Exposure> {
        let name = self.file.display().to_string();
        ensure!((1e-6..=1e6).contains(&self.lux), "{name}: lux is {}, expected 1e-6 to 1e6", self.lux);
        let flicker = match (self.flicker_hz, self.depth) {
            (None, None) if self.kind == Shape::Sine => None,
            (Some(hz), Some(depth)) => {
                let least_hz = if self.kind == Shape::Step { 1.0 } else { 0.01 };
                ensure!(
                    (least_hz..=1e5).contains(&hz),
                    "{name}: flicker_hz is {hz}, expected {least_hz} to 1e5"
                );
                ensure!(
                    self.kind == Shape::Sine || self.seconds.is_some(),
                    "{name}: expected `seconds` for steps: they begin at time 0"
                );
                ensure!((0.01..=0.99).contains(&depth), "{name}: depth is {depth}, expected 0.01 to 0.99");
                Some(Flicker { hz, depth, shape: self.kind })
            }
            _ => bail!("{name}: expected flicker_hz and depth together, or neither (steps have both)"),
        };
        let path = folder.join(&self.file);
        let (width_px, height_px, mut events) = match path.extension().and_then(|e| e.to_str()) {
            Some("npz") => read_npz(&path)?,
            Some("aedat4") => {
                let recording = aedat4::read(&path)?;
                (recording.width_px, recording.height_px, recording.events)
            }
            _ => bail!("{name}: expected a recording .npz or .aedat4"),
        };
        events.sort_unstable();
        let (first_ns, last_ns) = match (events.first(), events.last()) {
            (Some(first), Some(last)) => (first.t_ns, last.t_ns),
            _ => (0, 0),
        };
        // With a stated length a recording begins at time 0 (`esaac` writes such); else with its first event.
        let start_ns = if self.seconds.is_some() { 0 } else { first_ns };
        let whole_s = self.seconds.unwrap_or((last_ns - start_ns) as f64 * 1e-9);
        // Steps are left out in whole periods.
        let burn_in_s = match flicker {
            Some(Flicker { hz, shape: Shape::Step, .. }) => (burn_in_s * hz - 1e-6).ceil().max(0.0) / hz,
            _ => burn_in_s,
        };
        let begin_ns = start_ns + (burn_in_s * 1e9).round() as i64;
        let kept = events.iter().filter(|event| event.t_ns >= begin_ns);
        let events: Vec<Event> = kept.map(|event| Event { t_ns: event.t_ns - begin_ns, ..*event }).collect();
        let seconds = whole_s - burn_in_s;
        ensure!(
            seconds > 0.0,
            "{name}: {whole_s:.3} s of recording, expected more than the burn-in of {burn_in_s} s"
        );
        let pixels = width_px as usize * height_px as usize;
        Ok(Exposure { name, lux: self.lux, flicker, pixels, width_px, seconds, events })
    }
}
