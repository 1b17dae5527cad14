//! Events on disk: a NumPy archive (`.npz`) with the arrays `x` (u16), `y` (u16), `t` (i64, nanoseconds), `p` (i8, -1
//! or +1), `sensor` (the sensor as TOML text) and, if they were asked for, `id` (i64, the instance that each event shows; -1
//! unknown). `numpy.load` reads it without pickles.

use crate::npy;
use crate::until_failure::UntilFailure;
use anyhow::{Result, bail, ensure};
use esaac_model::packet::Event;
use esaac_model::{PacketView, Polarity, SensorModel};
use std::io::{Read, Seek, Write};
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Most events of a file that is read.
const MOST_EVENTS: usize = 1 << 31;

/// Most characters of a sensor's text.
pub(crate) const MOST_SENSOR_CHARACTERS: usize = 1 << 16;

/// Events of one camera, column by column.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EventColumns {
    /// Column of the pixel.
    pub x: Vec<u16>,
    /// Row of the pixel.
    pub y: Vec<u16>,
    /// Time, nanoseconds.
    pub t_ns: Vec<i64>,
    /// -1 OFF, +1 ON.
    pub sign: Vec<i8>,
    /// The instance that each shows, -1 where it is unknown; `None` if that was not asked for.
    pub ids: Option<Vec<i64>>,
}

impl EventColumns {
    /// Appends a packet.
    pub fn extend(&mut self, packet: &PacketView<'_>) {
        self.x.extend_from_slice(packet.x);
        self.y.extend_from_slice(packet.y);
        self.t_ns.extend(packet.t_offset_ns.iter().map(|&t| packet.base_ns + i64::from(t)));
        self.sign.extend(packet.polarity.iter().map(|&p| if p == 1 { 1 } else { -1 }));
    }

    /// The events, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Event> + '_ {
        (0..self.len()).map(|i| {
            let polarity = if self.sign[i] > 0 { Polarity::On } else { Polarity::Off };
            Event { t_ns: self.t_ns[i], y: self.y[i], x: self.x[i], polarity }
        })
    }

    /// Number of events.
    #[must_use]
    pub fn len(&self) -> usize {
        self.t_ns.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.t_ns.is_empty()
    }
}

/// Writes the archive. Members are stored without compression, so that reading is fast.
pub fn write_npz(out: impl Write + Seek, events: &EventColumns, sensor_toml: &str) -> Result<()> {
    let mut archive = ZipWriter::new(UntilFailure::new(out));
    let (count, stored) = (Some(events.len()), CompressionMethod::Stored);
    npy::write(&mut archive, stored, ("x", "<u2"), count, events.x.iter().map(|v| v.to_le_bytes()))?;
    npy::write(&mut archive, stored, ("y", "<u2"), count, events.y.iter().map(|v| v.to_le_bytes()))?;
    npy::write(&mut archive, stored, ("t", "<i8"), count, events.t_ns.iter().map(|v| v.to_le_bytes()))?;
    npy::write(&mut archive, stored, ("p", "|i1"), count, events.sign.iter().map(|v| v.to_le_bytes()))?;
    if let Some(ids) = &events.ids {
        npy::write(&mut archive, stored, ("id", "<i8"), count, ids.iter().map(|v| v.to_le_bytes()))?;
    }
    npy::write_text(&mut archive, stored, "sensor", sensor_toml)?;
    archive.finish()?;
    Ok(())
}

/// Whether an archive says which sensor its events are of.
pub(crate) fn has_sensor(archive: &ZipArchive<impl Read + Seek>) -> bool {
    npy::has(archive, "sensor")
}

/// Columns and rows of an archive's sensor.
pub(crate) fn size_px(archive: &mut ZipArchive<impl Read + Seek>) -> Result<(u32, u32)> {
    let sensor = SensorModel::from_toml(&npy::read_text(archive, "sensor", MOST_SENSOR_CHARACTERS)?)?;
    Ok((sensor.width, sensor.height))
}

/// The events of an archive, in its order, of a sensor with so many columns and rows.
pub(crate) fn read_columns(
    archive: &mut ZipArchive<impl Read + Seek>,
    (width, height): (u32, u32),
) -> Result<Vec<Event>> {
    let x = npy::read(archive, ("x", "<u2"), MOST_EVENTS)?;
    let y = npy::read(archive, ("y", "<u2"), MOST_EVENTS)?;
    let t = npy::read(archive, ("t", "<i8"), MOST_EVENTS)?;
    let signs = npy::read(archive, ("p", "|i1"), MOST_EVENTS)?;
    for (name, length) in [("y", y.len()), ("t", t.len()), ("p", signs.len())] {
        ensure!(length == x.len(), "array `{name}` has {length} elements, expected {} as `x`", x.len());
    }
    let mut events = Vec::with_capacity(x.len());
    for (((x, y), t), [sign]) in x.into_iter().zip(y).zip(t).zip(signs) {
        let (x, y) = (u16::from_le_bytes(x), u16::from_le_bytes(y));
        ensure!(
            u32::from(x) < width && u32::from(y) < height,
            "an event at ({x}, {y}) on a sensor of {width}x{height} px"
        );
        let polarity = match sign as i8 {
            1 => Polarity::On,
            -1 => Polarity::Off,
            other => bail!("a polarity of {other}, expected -1 or 1"),
        };
        events.push(Event { t_ns: i64::from_le_bytes(t), y, x, polarity });
    }
    Ok(events)
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Packet;
    use std::io::{Cursor, Read};

    #[test]
    fn columns_follow_the_packet() {
        let packet = Packet {
            base_ns: 1_000,
            x: vec![1, 2],
            y: vec![3, 4],
            t_offset_ns: vec![5, 6],
            polarity: vec![0, 1],
            ..Packet::default()
        };
        let mut columns = EventColumns::default();
        columns.extend(&packet.view());
        assert_eq!(columns.t_ns, [1_005, 1_006]);
        assert_eq!(columns.sign, [-1, 1]);
        assert_eq!(columns.len(), 2);
        assert!(columns.iter().eq(packet.iter()));
    }

    #[test]
    fn what_is_written_is_read_back_and_what_does_not_fit_is_refused() {
        let sensor = SensorModel { width: 300, height: 8, ..SensorModel::default() }.to_toml();
        let read = |columns: &EventColumns| {
            let mut bytes = Cursor::new(Vec::new());
            write_npz(&mut bytes, columns, &sensor).unwrap();
            let mut archive = ZipArchive::new(bytes).unwrap();
            let size_px = size_px(&mut archive).unwrap();
            read_columns(&mut archive, size_px).map(|events| (size_px, events))
        };
        let (x, y, t_ns, sign) = (vec![258, 1], vec![7, 0], vec![-2, 9], vec![-1, 1]);
        let columns = EventColumns { x, y, t_ns, sign, ids: Some(vec![3, -1]) };
        let event = |t_ns, y, x, polarity| Event { t_ns, y, x, polarity };
        let events = vec![event(-2, 7, 258, Polarity::Off), event(9, 0, 1, Polarity::On)];
        assert_eq!(read(&columns).unwrap(), ((300, 8), events));
        let refused = |columns: EventColumns| format!("{:#}", read(&columns).unwrap_err());
        assert!(refused(EventColumns { x: vec![300, 1], ..columns.clone() }).contains("(300, 7)"));
        assert!(refused(EventColumns { sign: vec![0, 1], ..columns.clone() }).contains("polarity of 0"));
        assert!(refused(EventColumns { y: vec![7], ..columns }).contains("`y` has 1 elements"));
    }

    #[test]
    fn members_hold_header_and_little_endian_data() {
        let columns =
            EventColumns { x: vec![258], y: vec![7], t_ns: vec![-2], sign: vec![-1], ids: Some(vec![9]) };
        let mut bytes = Cursor::new(Vec::new());
        write_npz(&mut bytes, &columns, "a = 1").unwrap();
        let mut archive = zip::ZipArchive::new(bytes).unwrap();
        let mut read = |name: &str| {
            let mut data = Vec::new();
            archive.by_name(name).unwrap().read_to_end(&mut data).unwrap();
            let start = 10 + usize::from(u16::from_le_bytes([data[8], data[9]]));
            assert_eq!(start % 64, 0, "{name}");
            (String::from_utf8_lossy(&data[10..start]).into_owned(), data.split_off(start))
        };
        assert_eq!(read("x.npy").1, [2, 1]);
        assert_eq!(read("t.npy").1, (-2_i64).to_le_bytes());
        let (header, text) = read("sensor.npy");
        assert!(header.contains("'<U5'") && header.contains("'shape': ()"), "{header}");
        assert_eq!(text[..4], [b'a', 0, 0, 0]);
    }
}
