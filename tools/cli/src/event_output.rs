//! The event file of a run: its ending says the format.

use crate::output_file;
use anyhow::{Result, bail, ensure};
use esaac_formats::event_file::{EventColumns, write_npz};
use esaac_formats::recording::Recording;
use esaac_formats::recording::aedat4_writer::{self, Compression};
use esaac_model::packet::Event;
use esaac_model::substeps::quantise_ns;
use esaac_model::{SensorModel, evt3};
use std::path::{Path, PathBuf};

/// Format of an event file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum EventFormat {
    /// NumPy archive: nanoseconds, and the sensor.
    Npz,
    /// EVT3: microseconds.
    Evt3,
    /// AEDAT 4: microseconds.
    Aedat4,
}

/// An event file that will be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventOutput {
    path: PathBuf,
    format: EventFormat,
}

impl EventOutput {
    /// Fails before any work is done if the name's ending names no format, or if the file could not be written. A device such as
    /// `/dev/stdout` may have any name, and gets `.npz`.
    pub fn new(path: &Path) -> Result<Self> {
        output_file::check(path)?;
        let format = match path.extension().and_then(|ending| ending.to_str()) {
            Some("npz") => EventFormat::Npz,
            Some("raw") => EventFormat::Evt3,
            Some("aedat4") => EventFormat::Aedat4,
            _ if output_file::is_special(path) => EventFormat::Npz,
            _ => bail!(
                "cannot write {}: events are written as .npz, .raw (EVT3) or .aedat4, expected a name that ends so; \
                 `esaac.EventWriter` in Python writes HDF5 (.h5) too",
                path.display()
            ),
        };
        Ok(EventOutput { path: path.to_owned(), format })
    }

    /// Fails if the format has too few bits for the sensor's coordinates.
    pub fn check_size(&self, sensor: &SensorModel) -> Result<()> {
        let (width, height) = (sensor.width, sensor.height);
        ensure!(
            self.format != EventFormat::Evt3 || width.max(height) <= evt3::SIDE_PX,
            "cannot write {}: a sensor of {width}x{height} px, expected at most {} a side in EVT3",
            self.path.display(),
            evt3::SIDE_PX
        );
        Ok(())
    }

    /// Fails if the format has no place for the instances of events.
    pub fn check_ids(&self) -> Result<()> {
        ensure!(
            self.format == EventFormat::Npz,
            "cannot write ids to {}: .npz alone has a place for them",
            self.path.display()
        );
        Ok(())
    }

    /// Whether the events go to standard output, which then has no place for text.
    pub fn is_standard_output(&self) -> bool {
        output_file::is_standard_output(&self.path)
    }

    /// Writes the events of a sensor. The file appears whole or not at all.
    pub fn write(&self, events: &EventColumns, sensor: &SensorModel) -> Result<()> {
        output_file::write(&self.path, |mut out| match self.format {
            EventFormat::Npz => write_npz(out, events, &sensor.to_toml()),
            EventFormat::Evt3 => {
                Ok(evt3::write_file(&mut out, [sensor.width, sensor.height], events.iter())?)
            }
            EventFormat::Aedat4 => {
                let whole_us = |event: Event| Event { t_ns: quantise_ns(event.t_ns, 1000), ..event };
                let recording = Recording {
                    name: sensor.name.clone(),
                    width_px: sensor.width,
                    height_px: sensor.height,
                    events: events.iter().map(whole_us).collect(),
                    frames: Vec::new(),
                };
                aedat4_writer::write(&mut out, &recording, &[], Compression::Lz4)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_formats::recording::{aedat4, evt3 as evt3_file};
    use std::os::unix::fs::symlink;

    fn sensor(width: u32, height: u32) -> SensorModel {
        SensorModel { name: "mine".to_owned(), width, height, ..SensorModel::default() }
    }

    fn error(result: Result<impl std::fmt::Debug>) -> String {
        format!("{:#}", result.unwrap_err())
    }

    #[test]
    fn the_ending_says_the_format_and_the_file_holds_whole_microseconds() {
        let folder = tempfile::tempdir().unwrap();
        let columns = EventColumns {
            x: vec![3, 299, 0],
            y: vec![0, 7, 1],
            t_ns: vec![0, 1_999, 20_000_000_001],
            sign: vec![1, -1, 1],
            ids: None,
        };
        let expected: Vec<Event> =
            columns.iter().map(|event| Event { t_ns: event.t_ns / 1000 * 1000, ..event }).collect();
        for (name, read) in [("a.raw", evt3_file::read as fn(&Path) -> _), ("a.aedat4", aedat4::read)] {
            let path = folder.path().join(name);
            EventOutput::new(&path).unwrap().write(&columns, &sensor(300, 8)).unwrap();
            let recording = read(&path).unwrap();
            assert_eq!((recording.width_px, recording.height_px), (300, 8), "{name}");
            assert_eq!(recording.events, expected, "{name}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing else is left");
    }

    #[test]
    fn names_and_sensors_that_a_format_cannot_have_are_told_before_any_work() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.h5", "a.csv", "a", "a.RAW"] {
            let said = error(EventOutput::new(&folder.path().join(name)));
            assert!(said.contains(name) && said.contains(".npz, .raw (EVT3) or .aedat4"), "{said}");
        }
        assert!(error(EventOutput::new(Path::new("/nonesuch/a.raw"))).contains("no folder /nonesuch"));
        let output = |name: &str| EventOutput::new(&folder.path().join(name)).unwrap();
        output("a.raw").check_size(&sensor(2048, 2048)).unwrap();
        let said = error(output("a.raw").check_size(&sensor(20, 2049)));
        assert!(said.contains("20x2049 px, expected at most 2048 a side"), "{said}");
        output("a.npz").check_ids().unwrap();
        assert!(error(output("a.raw").check_ids()).contains("a.raw: .npz alone has a place for them"));
        ["a.aedat4", "a.npz"].iter().for_each(|name| output(name).check_size(&sensor(20, 2049)).unwrap());
    }

    #[test]
    fn a_full_disk_is_named_in_every_format() {
        let folder = tempfile::tempdir().unwrap();
        let columns = EventColumns { x: vec![1], y: vec![2], t_ns: vec![3], sign: vec![1], ids: None };
        for name in ["full.npz", "full.raw", "full.aedat4"] {
            let path = folder.path().join(name);
            symlink("/dev/full", &path).unwrap();
            let said = error(EventOutput::new(&path).unwrap().write(&columns, &sensor(10, 10)));
            assert!(said.contains(name) && said.contains("No space left on device"), "{said}");
        }
    }
}
