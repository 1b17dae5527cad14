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

use crate::npy;
use crate::until_failure::UntilFailure;
use anyhow::{Context, Result, ensure};
use esaac_model::packet::Event;
use esaac_model::{Polarity, SensorModel};
use std::io::{Read, Seek, Write};
use std::path::Path;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Most characters of a sensor's text.
const MOST_SENSOR_CHARACTERS: usize = 1 << 16;

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

fn decode(file: impl Read + Seek) -> Result<TruthFile> {
    let mut archive = ZipArchive::new(file)?;
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
    let end_ns = npy::read(&mut archive, ("end_ns", "<i8"), 1)?;
    let end_ns = i64::from_le_bytes(*end_ns.first().context("`end_ns` is empty")?);
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
