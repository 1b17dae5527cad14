//! Reads EVT3 files (`.raw`), as Prophesee's cameras record them. They hold events alone, no frames.

use super::{Recording, RecordingError};
use esaac_model::evt3::{Evt3File, read_file};
use std::path::Path;

/// Reads the events of a file. A file that cannot be read, is broken or is of another encoding is an error.
pub fn read(path: &Path) -> Result<Recording, RecordingError> {
    let bytes = std::fs::read(path).map_err(|source| RecordingError::Io { path: path.to_owned(), source })?;
    let Evt3File { size_px: [width_px, height_px], mut events } = read_file(&bytes)
        .map_err(|error| RecordingError::Format { path: path.to_owned(), reason: error.to_string() })?;
    // The lower half of a time may go back within an upper half. Events of the same time stay in the file's order.
    events.sort_by_key(|event| event.t_ns);
    Ok(Recording { width_px, height_px, events, ..Recording::default() })
}
