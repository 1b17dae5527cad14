//! The corpus: hard cases as data. The oracle and the engine run the same cases.

use crate::frames::{Frame, Sequence};
use crate::run::{Step, camera, engine_of_many_on, events, oracle, oracle_events};
use esaac_engine::{Device, RigOptions};
use esaac_model::packet::Event;
use esaac_model::{HdrFormat, MotionFormat, Polarity, SensorModel};
use serde::Deserialize;
use std::sync::Arc;

/// One file of cases.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    case: Vec<Case>,
}

/// A case: a sensor, its frames and the expected result.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// Name.
    pub name: String,
    /// The fault that the case guards against.
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
    /// In place of `times_ns`: the first frame time and the step between frames, for as many frames as there are
    /// levels.
    #[serde(default)]
    pub clock_ns: Option<[i64; 2]>,
    /// Gray level of each pixel in each frame, `[frame][pixel]`; a shorter list repeats its last entry.
    pub levels: Vec<Vec<f64>>,
    /// How many times the sequence goes through the levels after the first frame.
    #[serde(default = "once")]
    pub repeat: usize,
    /// Expected events, of one pixel or of all together.
    #[serde(default)]
    pub expect: Vec<Expectation>,
    /// Expected number of invalid pixels in each frame.
    #[serde(default)]
    pub invalid_pixels: Option<Vec<u64>>,
    /// Expected number of pixels without any valid level so far, after each frame.
    #[serde(default)]
    pub unarmed_pixels: Option<Vec<u64>>,
}

/// Unit of a level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Scene units.
    #[default]
    Intensity,
    /// `ln(S + log_offset)`.
    Log,
}

/// Events expected of a pixel, or of all pixels together.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expectation {
    /// Pixel, `y * width + x`. Without it, the expectation is about all pixels together.
    #[serde(default)]
    pub pixel: Option<usize>,
    /// Polarities in time order, as `+` and `-`.
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
    /// How far times may differ, nanoseconds.
    #[serde(default)]
    pub tolerance_ns: i64,
}

fn float_frames() -> HdrFormat {
    HdrFormat::F32x4
}

fn once() -> usize {
    1
}

/// The files of `tests/corpus`, compiled in so that test programs run on machines without the sources.
pub const FILES: [(&str, &str); 5] = [
    ("invalid.toml", include_str!("../corpus/invalid.toml")),
    ("light.toml", include_str!("../corpus/light.toml")),
    ("noise.toml", include_str!("../corpus/noise.toml")),
    ("optics.toml", include_str!("../corpus/optics.toml")),
    ("time.toml", include_str!("../corpus/time.toml")),
];

/// Every case of `tests/corpus`.
#[must_use]
pub fn cases() -> Vec<Case> {
    let read = |(name, text): (&str, &str)| -> Vec<Case> {
        let file: File = toml::from_str(text).unwrap_or_else(|e| panic!("{name}: {e}"));
        file.case
    };
    FILES.into_iter().flat_map(read).collect()
}

/// Result of running a case, by the oracle or by the engine.
pub struct Outcome {
    /// Events of all pixels in time order.
    pub events: Vec<Event>,
    /// Number of invalid pixels in each frame.
    pub invalid_pixels: Vec<u64>,
    /// Number of pixels without any valid level so far, after each frame.
    pub unarmed_pixels: Vec<u64>,
}

/// Runs each case through the oracle.
#[must_use]
pub fn by_oracle(cases: &[Case]) -> Vec<Outcome> {
    let run = |case: &Case| {
        let intervals = oracle(&case.sensor(), 0, &case.sequence());
        Outcome {
            events: oracle_events(&intervals),
            invalid_pixels: intervals.iter().map(|i| i.diagnostics.invalid_pixels).collect(),
            unarmed_pixels: intervals.iter().map(|i| i.diagnostics.unarmed_pixels).collect(),
        }
    };
    cases.iter().map(run).collect()
}

/// Runs all cases through the engine, as cameras of one rig with frame times of their own.
#[must_use]
pub fn by_engine(device: &Arc<Device>, cases: &[Case], options: RigOptions) -> Vec<Outcome> {
    let sequences: Vec<_> = cases.iter().map(Case::sequence).collect();
    // What a case expects, it expects of the draws of camera 0.
    let cameras: Vec<_> = cases
        .iter()
        .zip(&sequences)
        .map(|(case, frames)| (camera(&case.sensor(), 0, frames), frames))
        .collect();
    let outcome = |steps: &Vec<Step>| Outcome {
        events: events(steps),
        invalid_pixels: steps.iter().map(|s| s.diagnostics.invalid_pixels).collect(),
        unarmed_pixels: steps.iter().map(|s| s.diagnostics.unarmed_pixels).collect(),
    };
    engine_of_many_on(device, &cameras, options).iter().map(outcome).collect()
}

impl Case {
    /// The sensor: one row, with a pixel for each level.
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

    /// The frames. They have zero motion if the sensor's synthesis needs motion.
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

    /// Compares the result of a run with all that the case expects. The error says where they differ.
    pub fn judge(&self, outcome: &Outcome) -> Result<(), String> {
        for expected in &self.expect {
            let of_pixel: Vec<(i64, Polarity)> = outcome
                .events
                .iter()
                .filter(|e| expected.pixel.is_none_or(|pixel| usize::from(e.x) == pixel))
                .map(|e| (e.t_ns, e.polarity))
                .collect();
            expected.judge(&of_pixel)?;
        }
        for (what, actual, expected) in [
            ("invalid", &outcome.invalid_pixels, &self.invalid_pixels),
            ("unarmed", &outcome.unarmed_pixels, &self.unarmed_pixels),
        ] {
            if let Some(expected) = expected.as_ref().filter(|expected| *expected != actual) {
                return Err(format!("{what} pixels {actual:?}, expected {expected:?}"));
            }
        }
        Ok(())
    }
}

impl Expectation {
    /// Compares events, `(time, polarity)` in time order, with the expectation. The error says where they differ.
    pub fn judge(&self, events: &[(i64, Polarity)]) -> Result<(), String> {
        let which = self.pixel.map_or("all pixels".to_owned(), |pixel| format!("pixel {pixel}"));
        let signs: String = events.iter().map(|e| if e.1 == Polarity::On { '+' } else { '-' }).collect();
        if let Some(polarities) = self.polarities.as_ref().filter(|polarities| **polarities != signs) {
            return Err(format!("{which}: `{signs}`, expected `{polarities}`: {events:?}"));
        }
        for (sign, range) in [('+', self.on), ('-', self.off)] {
            let count = signs.matches(sign).count();
            let Some([least, greatest]) = range else { continue };
            if !(least..=greatest).contains(&count) {
                return Err(format!("{which}: {count} of {sign}, expected {least} to {greatest}"));
            }
        }
        let Some(times_ns) = &self.times_ns else { return Ok(()) };
        let actual: Vec<i64> = events.iter().map(|e| e.0).collect();
        let near = |(a, b): (&i64, &i64)| (a - b).abs() <= self.tolerance_ns;
        if actual.len() == times_ns.len() && actual.iter().zip(times_ns).all(near) {
            return Ok(());
        }
        Err(format!("{which}: times {actual:?} ns, expected {times_ns:?} within {}", self.tolerance_ns))
    }
}
