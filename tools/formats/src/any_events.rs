//! Events of a file of any format that the tools read: its ending says which.

use crate::recording::{Recording, aedat4, evt3};
use crate::truth_file::TruthFile;
use crate::{event_file, truth_file};
use anyhow::{Context, Result, bail};
use esaac_model::packet::Event;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;
use zip::ZipArchive;

/// Events of one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct AnyEvents {
    /// Columns and rows of the sensor.
    pub size_px: (u32, u32),
    /// Events in time order.
    pub events: Vec<Event>,
    /// If they are true events, which are known in (0, `end_ns`].
    pub end_ns: Option<i64>,
}

/// Reads `.npz` (events or true events), `.raw` (EVT3) or `.aedat4`.
pub fn read(path: &Path) -> Result<AnyEvents> {
    read_with(path, None)
}

/// As [`read`], of events that count as true. Where an archive has columns of events, these may come without `sensor`, and
/// are of a sensor of this size then; with `end_ns` they are known up to there.
pub fn read_truth(path: &Path, size_px: (u32, u32)) -> Result<AnyEvents> {
    read_with(path, Some(size_px))
}

fn read_with(path: &Path, truth_px: Option<(u32, u32)>) -> Result<AnyEvents> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("npz") => {
            let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
            archived(BufReader::new(file), truth_px)
                .with_context(|| format!("{} holds no events", path.display()))
        }
        Some("raw") => Ok(recorded(evt3::read(path)?)),
        Some("aedat4") => Ok(recorded(aedat4::read_events(path)?)),
        _ => bail!("{}: expected a recording .npz, .aedat4 or .raw (EVT3)", path.display()),
    }
}

fn recorded(recording: Recording) -> AnyEvents {
    let size_px = (recording.width_px, recording.height_px);
    AnyEvents { size_px, events: recording.events, end_ns: None }
}

/// Events of an archive: those of [`truth_file`] or of [`event_file`]. Of true events, `truth_px` is the size of the sensor
/// where the archive does not say it.
fn archived(file: impl Read + Seek, truth_px: Option<(u32, u32)>) -> Result<AnyEvents> {
    let mut archive = ZipArchive::new(file)?;
    if truth_file::is_truth(&archive) {
        let TruthFile { sensor, end_ns, events } = truth_file::decode_archive(archive)?;
        return Ok(AnyEvents { size_px: (sensor.width, sensor.height), events, end_ns: Some(end_ns) });
    }
    let size_px = match truth_px {
        Some(size_px) if !event_file::has_sensor(&archive) => size_px,
        _ => event_file::size_px(&mut archive)?,
    };
    let end_ns = if truth_px.is_some() { truth_file::end_ns(&mut archive)? } else { None };
    let mut events = event_file::read_columns(&mut archive, size_px)?;
    events.sort_by_key(|event| event.t_ns);
    Ok(AnyEvents { size_px, events, end_ns })
}
