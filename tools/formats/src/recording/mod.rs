//! Recordings of real sensors: events and APS frames.

pub mod aedat4;
pub mod aedat4_writer;
pub mod evt3;
mod flatbuffer_reader;
mod flatbuffer_writer;

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
    /// The file is no recording, or a broken one.
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
    /// Start of the exposure, nanoseconds.
    pub start_ns: i64,
    /// End of the exposure, nanoseconds.
    pub end_ns: i64,
    /// Row-major, 0 to 1 of full scale.
    pub pixels: Vec<f32>,
}

impl Aps {
    /// Middle of the exposure, nanoseconds: the instant that the frame stands for.
    #[must_use]
    pub fn middle_ns(&self) -> i64 {
        self.start_ns.midpoint(self.end_ns)
    }
}

/// Events and frames of one sensor on one clock, nanoseconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Name of the sensor in the file.
    pub name: String,
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Events in time order.
    pub events: Vec<Event>,
    /// Frames in time order, each of the sensor's size.
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
