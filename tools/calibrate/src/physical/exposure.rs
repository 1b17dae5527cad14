//! Recordings of a sensor under known light, and a list of them.

use anyhow::{Context, Result, bail, ensure};
use esaac_formats::any_events::{self, AnyEvents};
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

/// Longest recording, seconds: longer ones are slips of the unit.
const MOST_S: f64 = 1e6;

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
        if let Some(seconds) = self.seconds {
            ensure!(
                seconds > 0.0 && seconds <= MOST_S,
                "{name}: seconds is {seconds}, expected above 0 and at most {MOST_S}"
            );
        }
        let path = folder.join(&self.file);
        let AnyEvents { size_px: (width_px, height_px), mut events, .. } = any_events::read(&path)?;
        events.sort_unstable();
        let (first_ns, last_ns) = match (events.first(), events.last()) {
            (Some(first), Some(last)) => (first.t_ns, last.t_ns),
            _ => (0, 0),
        };
        // With a stated length a recording begins at time 0 (`esaac` writes such); else with its first event.
        let (start_ns, end_ns) = match self.seconds {
            Some(seconds) => (0, (seconds * 1e9).round() as i64),
            None => (first_ns, last_ns),
        };
        ensure!(
            events.is_empty() || first_ns <= end_ns,
            "{name}: its first event is at {:.3} s, expected within the stated length from time 0 on; without \
             `seconds` it begins with its first event",
            first_ns as f64 * 1e-9
        );
        let span_ns = end_ns.checked_sub(start_ns).filter(|&span_ns| span_ns as f64 <= MOST_S * 1e9);
        let span_ns = span_ns.with_context(|| {
            format!("{name}: its times go from {start_ns} to {end_ns} ns, expected at most {MOST_S} s of recording")
        })?;
        let whole_s = self.seconds.unwrap_or(span_ns as f64 * 1e-9);
        // Steps are left out in whole periods.
        let burn_in_s = match flicker {
            Some(Flicker { hz, shape: Shape::Step, .. }) => (burn_in_s * hz - 1e-6).ceil().max(0.0) / hz,
            _ => burn_in_s,
        };
        let begin_ns = start_ns.saturating_add((burn_in_s * 1e9).round() as i64);
        let kept = events.iter().filter(|event| (begin_ns..=end_ns).contains(&event.t_ns));
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

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_formats::event_file::{EventColumns, write_npz};
    use esaac_model::SensorModel;
    use esaac_model::evt3::write_file;

    /// Reads a list of one recording of a pixel that sends at `t_ns`.
    fn read(t_ns: &[i64], entry: &str) -> Result<Exposure> {
        read_as("a.npz", t_ns, entry)
    }

    fn read_as(name: &str, t_ns: &[i64], entry: &str) -> Result<Exposure> {
        let folder = tempfile::tempdir().unwrap();
        let zeros = vec![0; t_ns.len()];
        let sign = vec![1; t_ns.len()];
        let events = EventColumns { x: zeros.clone(), y: zeros, t_ns: t_ns.to_vec(), sign, ids: None };
        let sensor = SensorModel { width: 1, height: 1, ..SensorModel::default() };
        let mut file = std::fs::File::create(folder.path().join(name)).unwrap();
        match name {
            "a.raw" => write_file(&mut file, [1, 1], events.iter()).unwrap(),
            _ => write_npz(file, &events, &sensor.to_toml()).unwrap(),
        }
        let list = folder.path().join("list.toml");
        let text = format!("burn_in_s = 0.1\n[[exposure]]\nfile = \"{name}\"\nlux = 1.0\n{entry}\n");
        std::fs::write(&list, text).unwrap();
        read_exposures(&list).map(|exposures| exposures.all[0].clone())
    }

    const MS: i64 = 1_000_000;

    fn times_ms(exposure: &Exposure) -> Vec<i64> {
        exposure.events.iter().map(|event| event.t_ns / MS).collect()
    }

    #[test]
    fn events_before_the_burn_in_s_end_and_after_the_stated_length_do_not_count() {
        let times_ns = [50, 100, 300, 500, 501, 900].map(|ms| ms * MS);
        let stated = read(&times_ns, "seconds = 0.5").unwrap();
        assert_eq!((times_ms(&stated), stated.seconds), (vec![0, 200, 400], 0.4));
        let whole = read(&times_ns, "").unwrap();
        assert_eq!(times_ms(&whole), [150, 350, 351, 750]);
        assert!((whole.seconds - 0.75).abs() < 1e-9);
    }

    #[test]
    fn a_recording_in_evt3_is_read_and_one_of_another_ending_is_not() {
        let times_ns = [50, 100, 300, 20_000].map(|ms| ms * MS);
        let [raw, npz] = ["a.raw", "a.npz"].map(|name| read_as(name, &times_ns, "seconds = 30.0").unwrap());
        assert_eq!((&raw.events, raw.pixels, raw.seconds), (&npz.events, npz.pixels, npz.seconds));
        assert_eq!(times_ms(&raw), [0, 200, 19_900]);
        let said = read_as("a.dat", &times_ns, "").unwrap_err().to_string();
        assert!(said.contains("a.dat: expected a recording .npz, .aedat4 or .raw (EVT3)"), "{said}");
    }

    #[test]
    fn lengths_that_are_none_and_times_that_do_not_fit_them_are_named() {
        let error = |t_ns: &[i64], entry: &str| format!("{:#}", read(t_ns, entry).unwrap_err());
        for seconds in ["0.0", "-1.0", "nan", "inf", "1e9"] {
            let said = error(&[MS], &format!("seconds = {seconds}"));
            assert!(said.contains("a.npz: seconds is") && said.contains("at most 1000000"), "{said}");
        }
        let said = error(&[i64::MIN, i64::MAX], "");
        assert!(said.contains("a.npz: its times go from -9223372036854775808"), "{said}");
        let said = error(&[1_700_000_000_000 * MS], "seconds = 60.0");
        assert!(said.contains("a.npz: its first event is at 1700000000.000 s"), "{said}");
        let said = error(&[i64::MAX - 1, i64::MAX], "");
        assert!(said.contains("more than the burn-in"), "{said}");
    }
}
