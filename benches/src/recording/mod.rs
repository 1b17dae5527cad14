//! Recordings of real sensors: events and APS frames.

pub mod aedat4;
mod flatbuffer;

use esaac_model::packet::Event;
use std::path::PathBuf;
use thiserror::Error;

/// Why a recording cannot be read.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file cannot be read at all.
    #[error("{path}: {source}")]
    Io {
        /// File.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is no recording, or a broken one.
    #[error("{path}: {reason}")]
    Format {
        /// File.
        path: PathBuf,
        /// What is wrong, with what was expected.
        reason: String,
    },
}

/// An APS frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Aps {
    /// Start of the exposure.
    pub start_ns: i64,
    /// Its end.
    pub end_ns: i64,
    /// Row-major, 0 to 1 of full scale.
    pub pixels: Vec<f32>,
}

impl Aps {
    /// Middle of the exposure: the instant that the frame stands for.
    #[must_use]
    pub fn middle_ns(&self) -> i64 {
        self.start_ns + (self.end_ns - self.start_ns) / 2
    }
}

/// Events and frames of one sensor on one clock, nanoseconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// What the file calls the sensor.
    pub name: String,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// In time order.
    pub events: Vec<Event>,
    /// In time order; of the sensor's size.
    pub frames: Vec<Aps>,
}

impl Recording {
    /// Events between the middles of the first and the last frame.
    #[must_use]
    pub fn events_between_frames(&self) -> &[Event] {
        let (Some(first), Some(last)) = (self.frames.first(), self.frames.last()) else { return &[] };
        let from = self.events.partition_point(|e| e.t_ns <= first.middle_ns());
        let to = self.events.partition_point(|e| e.t_ns <= last.middle_ns());
        &self.events[from..to]
    }
}
