//! The corpus: hard cases as data, which the oracle and the engine both run.

use crate::frames::{Frame, Sequence};
use esaac_model::{HdrFormat, MotionFormat, Polarity, SensorModel};
use serde::Deserialize;
use std::path::Path;

/// One file of cases.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    case: Vec<Case>,
}

/// A case: a sensor, frames and what must come of them.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// Name.
    pub name: String,
    /// What goes wrong elsewhere.
    pub about: String,
    /// Sensor parameters that differ from [`SensorModel::default`]; synthesis `linear` unless given.
    #[serde(default)]
    pub sensor: toml::Table,
    /// What `levels` are.
    #[serde(default)]
    pub unit: Unit,
    /// Format of the frames.
    #[serde(default = "float_frames")]
    pub format: HdrFormat,
    /// Frame times, nanoseconds.
    #[serde(default)]
    pub times_ns: Vec<i64>,
    /// In place of `times_ns`: the first and the step between them; as many as there are levels.
    #[serde(default)]
    pub clock_ns: Option<[i64; 2]>,
    /// Gray level of each pixel in each frame, `[frame][pixel]`; a shorter list repeats its last entry.
    pub levels: Vec<Vec<f64>>,
    /// How often the levels are gone through after the first frame.
    #[serde(default = "once")]
    pub repeat: usize,
    /// Events of pixels.
    #[serde(default)]
    pub expect: Vec<Expectation>,
    /// Pixels that were invalid in each frame.
    #[serde(default)]
    pub invalid_pixels: Option<Vec<u64>>,
    /// Pixels that had no valid level yet after each frame.
    #[serde(default)]
    pub unarmed_pixels: Option<Vec<u64>>,
}

/// What a level is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Scene units.
    #[default]
    Intensity,
    /// `ln(S + log_offset)`.
    Log,
}

/// What a pixel sends.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expectation {
    /// `y * width + x`; all pixels together if it is not given.
    #[serde(default)]
    pub pixel: Option<usize>,
    /// `+` and `-` in order.
    #[serde(default)]
    pub polarities: Option<String>,
    /// Least and greatest number of ON events.
    #[serde(default)]
    pub on: Option<[usize; 2]>,
    /// Least and greatest number of OFF events.
    #[serde(default)]
    pub off: Option<[usize; 2]>,
    /// Times, nanoseconds.
    #[serde(default)]
    pub times_ns: Option<Vec<i64>>,
    /// How far they may be off.
    #[serde(default)]
    pub tolerance_ns: i64,
}

fn float_frames() -> HdrFormat {
    HdrFormat::F32x4
}

fn once() -> usize {
    1
}

/// Every case of `tests/corpus`.
#[must_use]
pub fn cases() -> Vec<Case> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let mut paths: Vec<_> = std::fs::read_dir(&folder)
        .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
        .map(|entry| entry.expect("a folder that can be read").path())
        .collect();
    paths.sort();
    paths
        .iter()
        .flat_map(|path| {
            let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            let file: File = toml::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            file.case
        })
        .collect()
}

impl Case {
    /// The sensor, one row of as many pixels as there are levels.
    #[must_use]
    pub fn sensor(&self) -> SensorModel {
        let width = self.levels.iter().map(Vec::len).max().expect("a case has levels");
        let mut table = toml::Table::new();
        table.insert("synthesis".to_owned(), "linear".into());
        table.insert("width".to_owned(), toml::Value::Integer(width as i64));
        table.insert("height".to_owned(), toml::Value::Integer(1));
        table.extend(self.sensor.clone());
        SensorModel::from_toml(&table.to_string()).unwrap_or_else(|e| panic!("{}: {e}", self.name))
    }

    /// The frames, with motion zero where the sensor's synthesis asks for it.
    #[must_use]
    pub fn sequence(&self) -> Sequence {
        let sensor = self.sensor();
        let later = self.levels[1..].iter().cycle().take((self.levels.len() - 1) * self.repeat);
        let levels: Vec<&Vec<f64>> = self.levels[..1].iter().chain(later).collect();
        let times_ns = match self.clock_ns {
            Some([first, step]) => (0..levels.len() as i64).map(|k| first + k * step).collect(),
            None => self.times_ns.clone(),
        };
        assert_eq!(times_ns.len(), levels.len(), "{}: a time for each frame", self.name);
        let frames = times_ns.into_iter().zip(levels).map(|(t_ns, levels)| {
            let hdr = (0..sensor.pixels()).flat_map(|pixel| {
                let level = *levels.get(pixel).or(levels.last()).expect("a frame has levels");
                let intensity = match self.unit {
                    Unit::Intensity => level,
                    Unit::Log => level.exp() - sensor.log_offset,
                };
                self.texel(intensity)
            });
            Frame { t_ns, hdr: hdr.collect(), motion: Some(vec![0; 8 * sensor.pixels()]) }
        });
        Sequence { hdr: self.format, motion: Some(MotionFormat::F32x2), frames: frames.collect() }
    }

    fn texel(&self, intensity: f64) -> Vec<u8> {
        match self.format {
            HdrFormat::F32x4 => [intensity as f32; 4].iter().flat_map(|v| v.to_le_bytes()).collect(),
            HdrFormat::F16x4 => {
                [half::f16::from_f64(intensity); 4].iter().flat_map(|v| v.to_le_bytes()).collect()
            }
            HdrFormat::Srgb8x4 => vec![intensity as u8; 4],
        }
    }

    /// Holds events of one pixel, `(time, polarity)` in time order, against the expectation.
    pub fn check(&self, who: &str, expected: &Expectation, events: &[(i64, Polarity)]) {
        let which = expected.pixel.map_or("all pixels".to_owned(), |pixel| format!("pixel {pixel}"));
        let name = format!("{} by the {who}, {which}", self.name);
        let signs: String = events.iter().map(|e| if e.1 == Polarity::On { '+' } else { '-' }).collect();
        if let Some(polarities) = &expected.polarities {
            assert_eq!(&signs, polarities, "{name} ({}): {events:?}", self.about);
        }
        for (sign, range) in [('+', expected.on), ('-', expected.off)] {
            let count = signs.matches(sign).count();
            let Some([least, greatest]) = range else { continue };
            assert!(
                (least..=greatest).contains(&count),
                "{name} ({}): {count} of {sign}, expected {least} to {greatest}",
                self.about
            );
        }
        if let Some(times_ns) = &expected.times_ns {
            let actual: Vec<i64> = events.iter().map(|e| e.0).collect();
            assert_eq!(actual.len(), times_ns.len(), "{name} ({}): {actual:?}", self.about);
            for (actual_ns, expected_ns) in actual.iter().zip(times_ns) {
                assert!(
                    (actual_ns - expected_ns).abs() <= expected.tolerance_ns,
                    "{name} ({}): {actual_ns} ns, expected {expected_ns} within {}",
                    self.about,
                    expected.tolerance_ns
                );
            }
        }
    }
}
