//! True events of a sequence, stored compactly: a NumPy archive with the events of each pixel in time order. Pixels are
//! in row-major order.
//!
//! | array | type | content |
//! |---|---|---|
//! | `events_of_pixel` | `<u2` | number of events of each pixel |
//! | `dt_ns_low`, `dt_ns_high` | `<u2` | time since the pixel's previous event, or since zero, in two halves |
//! | `p` | `\|i1` | -1 OFF, +1 ON |
//! | `end_ns` | `<i8` | the truth is known in (0, `end_ns`] |
//! | `sensor` | text | the sensor as TOML |
//!
//! The halves of `dt_ns` are separate arrays because the high half is regular, and alone Deflate packs it well.
//!
//! A truth from elsewhere may have the columns of a recording instead ([`event_file`]), with `end_ns` and `sensor` or
//! without ([`read_of_frames`]).

use crate::event_file::MOST_SENSOR_CHARACTERS;
use crate::until_failure::UntilFailure;
use crate::{event_file, npy};
use anyhow::{Context, Result, ensure};
use esaac_model::packet::Event;
use esaac_model::{Polarity, SensorModel};
use std::io::{Read, Seek, Write};
use std::path::Path;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Events that an ideal sensor sends.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthFile {
    /// The sensor.
    pub sensor: SensorModel,
    /// The truth is known in (0, `end_ns`].
    pub end_ns: i64,
    /// Events in time order.
    pub events: Vec<Event>,
}

/// Writes the archive.
pub fn write(out: impl Write + Seek, truth: &TruthFile) -> Result<()> {
    let width = truth.sensor.width as usize;
    let mut of_pixel: Vec<Vec<&Event>> = vec![Vec::new(); truth.sensor.pixels()];
    for event in &truth.events {
        ensure!(
            u32::from(event.x) < truth.sensor.width && u32::from(event.y) < truth.sensor.height,
            "an event at ({}, {}) on a sensor of {}x{} px",
            event.x,
            event.y,
            truth.sensor.width,
            truth.sensor.height
        );
        of_pixel[usize::from(event.y) * width + usize::from(event.x)].push(event);
    }
    let (mut counts, mut dt_ns, mut signs) = (Vec::new(), Vec::new(), Vec::new());
    for (pixel, events) in of_pixel.iter_mut().enumerate() {
        events.sort_unstable();
        counts.push(u16::try_from(events.len()).with_context(|| {
            format!("pixel {pixel} has {} events, expected at most {}", events.len(), u16::MAX)
        })?);
        let mut previous_ns = 0;
        for event in events {
            let step_ns = event.t_ns - previous_ns;
            dt_ns.push(u32::try_from(step_ns).with_context(|| {
                format!("pixel {pixel}: {step_ns} ns before an event, expected 0 to {}", u32::MAX)
            })?);
            signs.push(if event.polarity == Polarity::On { 1_i8 } else { -1 });
            previous_ns = event.t_ns;
        }
    }
    let mut archive = ZipWriter::new(UntilFailure::new(out));
    let (deflated, count) = (CompressionMethod::Deflated, Some(dt_ns.len()));
    let half = |shift: u32| dt_ns.iter().map(move |dt| ((dt >> shift) as u16).to_le_bytes());
    let of_pixels = ("events_of_pixel", "<u2");
    npy::write(
        &mut archive,
        deflated,
        of_pixels,
        Some(counts.len()),
        counts.iter().map(|n| n.to_le_bytes()),
    )?;
    npy::write(&mut archive, deflated, ("dt_ns_low", "<u2"), count, half(0))?;
    npy::write(&mut archive, deflated, ("dt_ns_high", "<u2"), count, half(16))?;
    npy::write(&mut archive, deflated, ("p", "|i1"), count, signs.iter().map(|v| v.to_le_bytes()))?;
    let end_ns = std::iter::once(truth.end_ns.to_le_bytes());
    npy::write(&mut archive, deflated, ("end_ns", "<i8"), None, end_ns)?;
    npy::write_text(&mut archive, deflated, "sensor", &truth.sensor.to_toml())?;
    archive.finish()?;
    Ok(())
}

/// Reads an archive.
pub fn read(path: &Path) -> Result<TruthFile> {
    let file = std::fs::File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    decode(std::io::BufReader::new(file)).with_context(|| format!("{} holds no true events", path.display()))
}

/// As [`read`], of frames with so many columns and rows whose last is at `last_ns`; also reads the columns of a recording.
/// Without `sensor` these are of the default sensor of the frames' size, without `end_ns` they are known up to the last
/// frame. Events later than that are left out.
pub fn read_of_frames(path: &Path, size_px: (u32, u32), last_ns: i64) -> Result<TruthFile> {
    let file = std::fs::File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    decode_of_frames(std::io::BufReader::new(file), size_px, last_ns)
        .with_context(|| format!("{} holds no true events", path.display()))
}

fn decode_of_frames(file: impl Read + Seek, size_px: (u32, u32), last_ns: i64) -> Result<TruthFile> {
    let mut archive = ZipArchive::new(file)?;
    let has = |name: &str| npy::has(&archive, name);
    if is_truth(&archive) {
        return decode_archive(archive);
    }
    let missing: Vec<&str> = ["x", "y", "t", "p"].into_iter().filter(|name| !has(name)).collect();
    ensure!(
        missing.is_empty(),
        "it lacks {}, expected the arrays x, y, t, p, or those that `esaac render --truth` writes",
        missing.join(", ")
    );
    let sensor = match has("sensor") {
        true => SensorModel::from_toml(&npy::read_text(&mut archive, "sensor", MOST_SENSOR_CHARACTERS)?)?,
        false => SensorModel { width: size_px.0, height: size_px.1, ..SensorModel::default() },
    };
    let end_ns = end_ns(&mut archive)?.unwrap_or(last_ns);
    let mut events = event_file::read_columns(&mut archive, (sensor.width, sensor.height))?;
    events.sort_unstable();
    if let Some(first) = events.first() {
        ensure!(
            first.t_ns >= 0,
            "an event at {} ns, expected 0 or later, where the first frame is",
            first.t_ns
        );
    }
    events.retain(|event| event.t_ns <= end_ns);
    Ok(TruthFile { sensor, end_ns, events })
}

/// Up to where the events of an archive are known, if it says that.
pub(crate) fn end_ns(archive: &mut ZipArchive<impl Read + Seek>) -> Result<Option<i64>> {
    npy::has(archive, "end_ns").then(|| read_end_ns(archive)).transpose()
}

fn read_end_ns(archive: &mut ZipArchive<impl Read + Seek>) -> Result<i64> {
    let end_ns = npy::read(archive, ("end_ns", "<i8"), 1)?;
    Ok(i64::from_le_bytes(*end_ns.first().context("`end_ns` is empty")?))
}

fn decode(file: impl Read + Seek) -> Result<TruthFile> {
    decode_archive(ZipArchive::new(file)?)
}

/// Whether an archive has what [`write`] writes.
pub(crate) fn is_truth(archive: &ZipArchive<impl Read + Seek>) -> bool {
    npy::has(archive, "events_of_pixel")
}

/// The true events of an archive that [`write`] made.
pub(crate) fn decode_archive(mut archive: ZipArchive<impl Read + Seek>) -> Result<TruthFile> {
    let sensor = SensorModel::from_toml(&npy::read_text(&mut archive, "sensor", MOST_SENSOR_CHARACTERS)?)?;
    let counts = npy::read(&mut archive, ("events_of_pixel", "<u2"), sensor.pixels())?;
    let counts: Vec<u16> = counts.into_iter().map(u16::from_le_bytes).collect();
    ensure!(
        counts.len() == sensor.pixels(),
        "`events_of_pixel` has {} entries, expected {} ({}x{} px)",
        counts.len(),
        sensor.pixels(),
        sensor.width,
        sensor.height
    );
    let count: usize = counts.iter().map(|n| usize::from(*n)).sum();
    let low = npy::read(&mut archive, ("dt_ns_low", "<u2"), count)?;
    let high = npy::read(&mut archive, ("dt_ns_high", "<u2"), count)?;
    let signs = npy::read(&mut archive, ("p", "|i1"), count)?;
    for (name, length) in [("dt_ns_low", low.len()), ("dt_ns_high", high.len()), ("p", signs.len())] {
        ensure!(length == count, "`{name}` has {length} entries, expected {count}, the sum of all pixels");
    }
    let end_ns = read_end_ns(&mut archive)?;
    let halves =
        low.into_iter().zip(high).map(|(low, high)| (u16::from_le_bytes(low), u16::from_le_bytes(high)));
    let mut entries = halves.zip(signs.into_iter().map(|[sign]| sign as i8));
    let mut events = Vec::with_capacity(count);
    for (pixel, count) in counts.into_iter().enumerate() {
        let mut t_ns = 0_i64;
        for ((low, high), sign) in entries.by_ref().take(usize::from(count)) {
            t_ns += i64::from(low) | i64::from(high) << 16;
            let polarity = match sign {
                1 => Polarity::On,
                -1 => Polarity::Off,
                other => anyhow::bail!("a polarity of {other}, expected -1 or 1"),
            };
            let (x, y) = (pixel as u32 % sensor.width, pixel as u32 / sensor.width);
            events.push(Event { t_ns, y: y as u16, x: x as u16, polarity });
        }
    }
    events.sort_unstable();
    Ok(TruthFile { sensor, end_ns, events })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn truth() -> TruthFile {
        let event = |t_ns, y, x, on: bool| Event {
            t_ns,
            y,
            x,
            polarity: if on { Polarity::On } else { Polarity::Off },
        };
        TruthFile {
            sensor: SensorModel { width: 3, height: 2, ..SensorModel::default() },
            end_ns: 5_000_000_000,
            events: vec![
                event(0, 0, 0, true),
                event(70_000, 1, 2, false),
                event(70_001, 1, 2, false),
                event(4_294_967_295, 0, 1, true),
            ],
        }
    }

    fn written(truth: &TruthFile) -> Result<Vec<u8>> {
        let mut bytes = Cursor::new(Vec::new());
        write(&mut bytes, truth)?;
        Ok(bytes.into_inner())
    }

    #[test]
    fn what_is_written_is_read_back() {
        let truth = truth();
        assert_eq!(decode(Cursor::new(written(&truth).unwrap())).unwrap(), truth);
        let empty = TruthFile { events: Vec::new(), ..truth };
        assert_eq!(decode(Cursor::new(written(&empty).unwrap())).unwrap(), empty);
    }

    /// Columns of events, as `EventColumns` writes them and NumPy does, with other arrays.
    fn columns(t_ns: &[i64], sensor: Option<&SensorModel>, end_ns: Option<i64>) -> Cursor<Vec<u8>> {
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        let (stored, count) = (CompressionMethod::Stored, Some(t_ns.len()));
        let zeros = || t_ns.iter().map(|_| 0_u16.to_le_bytes());
        npy::write(&mut archive, stored, ("x", "<u2"), count, zeros()).unwrap();
        npy::write(&mut archive, stored, ("y", "<u2"), count, zeros()).unwrap();
        npy::write(&mut archive, stored, ("t", "<i8"), count, t_ns.iter().map(|t| t.to_le_bytes())).unwrap();
        npy::write(&mut archive, stored, ("p", "|i1"), count, t_ns.iter().map(|_| [1])).unwrap();
        if let Some(sensor) = sensor {
            npy::write_text(&mut archive, stored, "sensor", &sensor.to_toml()).unwrap();
        }
        if let Some(end_ns) = end_ns {
            npy::write(&mut archive, stored, ("end_ns", "<i8"), None, [end_ns.to_le_bytes()].into_iter())
                .unwrap();
        }
        archive.finish().unwrap()
    }

    #[test]
    fn columns_of_events_are_a_truth_of_the_frames() {
        let (size_px, last_ns) = ((3, 2), 1000);
        let read = |file| decode_of_frames(file, size_px, last_ns);
        let default = SensorModel { width: 3, height: 2, ..SensorModel::default() };
        let times = |truth: &TruthFile| truth.events.iter().map(|event| event.t_ns).collect::<Vec<_>>();
        let bare = read(columns(&[700, 5, 1001], None, None)).unwrap();
        assert_eq!((&bare.sensor, bare.end_ns, times(&bare)), (&default, last_ns, vec![5, 700]));
        let own = SensorModel { contrast_on: 0.3, ..default };
        let full = read(columns(&[5, 700], Some(&own), Some(600))).unwrap();
        assert_eq!((&full.sensor, full.end_ns, times(&full)), (&own, 600, vec![5]));
        let compact = truth();
        assert_eq!(read(Cursor::new(written(&compact).unwrap())).unwrap(), compact);
    }

    #[test]
    fn what_is_no_truth_of_frames_is_told() {
        let error = |file| format!("{:#}", decode_of_frames(file, (3, 2), 1000).unwrap_err());
        let early = error(columns(&[-3, 5], None, None));
        assert!(early.contains("an event at -3 ns, expected 0 or later"), "{early}");
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        let one = || [1_i64.to_le_bytes()].into_iter();
        npy::write(&mut archive, CompressionMethod::Stored, ("t", "<i8"), Some(1), one()).unwrap();
        let partial = error(archive.finish().unwrap());
        assert!(
            partial.contains("it lacks x, y, p, expected the arrays x, y, t, p, or those that"),
            "{partial}"
        );
    }

    #[test]
    fn events_that_do_not_fit_are_refused() {
        let refusal = |change: fn(&mut Event)| {
            let mut truth = truth();
            change(&mut truth.events[3]);
            format!("{:#}", written(&truth).unwrap_err())
        };
        assert!(refusal(|e| e.t_ns += 1).contains("4294967296 ns before an event"));
        assert!(refusal(|e| e.t_ns = -1).contains("-1 ns before an event"));
        assert!(refusal(|e| e.x = 3).contains("an event at (3, 0) on a sensor of 3x2 px"));
    }

    #[test]
    fn no_broken_archive_is_read() {
        let good = written(&truth()).unwrap();
        for length in 0..good.len() {
            assert!(decode(Cursor::new(&good[..length])).is_err(), "{length} bytes");
        }
        // The checksum finds a change in compressed data. A change elsewhere may be harmless.
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 0x55;
            if let Ok(read) = decode(Cursor::new(bad)) {
                assert_eq!(read, truth(), "byte {at}");
            }
        }
    }
}
