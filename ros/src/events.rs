//! Encodes event packets, after [`Split`] has divided them into messages.

use crate::cdr::CdrWriter;
use crate::encode::Header;
use crate::message::MessageType;
use esaac_model::PacketView;
use esaac_model::evt3::{self, Words};
use std::ops::Range;
use std::str::FromStr;

/// The message type and encoding of events.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EventFormat {
    /// `esaac_msgs/PackedEventPacket`: arrays, nanoseconds, 9 bytes an event.
    #[default]
    Packed,
    /// `esaac_msgs/EventPacket`: one by one, nanoseconds, 16 bytes an event.
    Plain,
    /// `event_camera_msgs/EventPacket`, encoding `evt3`: microseconds, 2 to 8 bytes an event.
    Evt3,
    /// `event_camera_msgs/EventPacket`, encoding `mono`: nanoseconds, 8 bytes an event.
    Mono,
}

impl EventFormat {
    /// Names for flags.
    pub const NAMES: [(&'static str, EventFormat); 4] = [
        ("packed", EventFormat::Packed),
        ("plain", EventFormat::Plain),
        ("evt3", EventFormat::Evt3),
        ("mono", EventFormat::Mono),
    ];

    /// The message type.
    #[must_use]
    pub fn message(self) -> MessageType {
        match self {
            EventFormat::Packed => MessageType::PackedEventPacket,
            EventFormat::Plain => MessageType::EventPacket,
            EventFormat::Evt3 | EventFormat::Mono => MessageType::EventCameraPacket,
        }
    }

    /// Largest number of rows or columns of a sensor.
    #[must_use]
    pub fn side_limit_px(self) -> u32 {
        if self == EventFormat::Evt3 { evt3::SIDE_PX } else { u32::from(u16::MAX) / 2 + 1 }
    }

    /// Most bytes of an event.
    fn event_bytes(self) -> usize {
        match self {
            EventFormat::Packed => 9,
            EventFormat::Plain => 16,
            // evt3: time high, time low, row and column, two bytes each.
            EventFormat::Evt3 | EventFormat::Mono => 8,
        }
    }
}

impl FromStr for EventFormat {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = EventFormat::NAMES.iter().find(|(known, _)| *known == name);
        found.map(|&(_, format)| format).ok_or_else(|| {
            let names = EventFormat::NAMES.map(|(name, _)| name).join(", ");
            format!("unknown event message `{name}`, expected one of {names}")
        })
    }
}

/// How a packet is divided into messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Split {
    /// Time that a message covers, nanoseconds from the packet's base on, or from where the packet before ended. A slice
    /// without events is a message too. 0: no limit. Otherwise at least [`Split::LEAST_SLICE_NS`].
    pub slice_ns: u32,
    /// Most bytes of a message's events, but at least one event. 0: no limit.
    pub max_bytes: u32,
}

impl Split {
    /// Least time of a slice. Messages of shorter times would be mostly headers: gigabytes a second of simulated time.
    pub const LEAST_SLICE_NS: u32 = 1000;

    /// Whether `slice_ns` is no limit, or one that [`Plan::new`](crate::Plan::new) takes.
    #[must_use]
    pub fn has_valid_slice(self) -> bool {
        self.slice_ns == 0 || self.slice_ns >= Self::LEAST_SLICE_NS
    }

    /// Divides a packet into one or more parts, in order of time. Together they are the whole packet.
    pub fn parts<'a>(self, packet: &PacketView<'a>, format: EventFormat) -> Vec<PacketView<'a>> {
        self.parts_after(None, packet, format)
    }

    /// The same of a packet before which packets are complete up to `complete_ns`. Its base may lie before that where the
    /// sensor's time stamps have become coarser: no slice ends there, so that time does not go back.
    pub(crate) fn parts_after<'a>(
        self,
        complete_ns: Option<i64>,
        packet: &PacketView<'a>,
        format: EventFormat,
    ) -> Vec<PacketView<'a>> {
        let from_ns = complete_ns
            .filter(|&ns| ns <= packet.watermark_ns)
            .map_or(packet.base_ns, |ns| ns.max(packet.base_ns));
        let mut parts = Vec::new();
        let most = match self.max_bytes {
            0 => usize::MAX,
            bytes => (bytes as usize / format.event_bytes()).max(1),
        };
        for (range, end_ns) in self.slices(from_ns, packet) {
            let mut start = range.start;
            loop {
                let end = range.end.min(start.saturating_add(most));
                let mut part = packet.part(start..end);
                part.dropped = 0;
                // The next part may begin with events of the same instant, so this one ends before it.
                part.watermark_ns = match end < range.end {
                    true => packet.base_ns + i64::from(packet.t_offset_ns[end]) - 1,
                    false => end_ns,
                };
                parts.push(part);
                start = end;
                if start >= range.end {
                    break;
                }
            }
        }
        if let Some(last) = parts.last_mut() {
            last.dropped = packet.dropped;
        }
        parts
    }

    /// Events and end of each slice of time from `from_ns` on.
    fn slices(self, from_ns: i64, packet: &PacketView<'_>) -> Vec<(Range<usize>, i64)> {
        let slice_ns = i64::from(self.slice_ns);
        let span_ns = packet.watermark_ns - from_ns;
        if slice_ns == 0 {
            return vec![(0..packet.len(), packet.watermark_ns)];
        }
        // Slices of equal length; the last one ends with the packet.
        let count = (span_ns as f64 / slice_ns as f64).round().max(1.0) as i64;
        let mut start = 0;
        (1..=count)
            .map(|k| {
                let end_ns = from_ns + span_ns * k / count;
                let end = match k == count {
                    true => packet.len(),
                    false => packet.t_offset_ns.partition_point(|&t| packet.base_ns + i64::from(t) <= end_ns),
                };
                (std::mem::replace(&mut start, end)..end, end_ns)
            })
            .collect()
    }
}

/// The fields of a packet before its events.
#[derive(Clone, Copy, Debug)]
pub struct PacketHead<'a> {
    /// Stamp and frame.
    pub header: Header<'a>,
    /// Messages on this topic before this one.
    pub sequence: u64,
    /// Name of the sensor.
    pub sensor_name: &'a str,
}

/// Encodes a packet or a part of one.
pub fn encode(out: &mut Vec<u8>, format: EventFormat, head: &PacketHead<'_>, packet: &PacketView<'_>) {
    let mut cdr = CdrWriter::new(out);
    head.header.write(&mut cdr);
    cdr.u32(packet.height_px).u32(packet.width_px).u64(head.sequence);
    cdr.reserve(packet.len() * format.event_bytes() + 128);
    match format {
        EventFormat::Packed => {
            cdr.i64(packet.base_ns).i64(packet.watermark_ns).string(head.sensor_name).u64(packet.dropped);
            cdr.sequence(packet.x).sequence(packet.y).sequence(packet.t_offset_ns).sequence(packet.polarity);
        }
        EventFormat::Plain => {
            cdr.i64(packet.base_ns).i64(packet.watermark_ns).string(head.sensor_name).u64(packet.dropped);
            cdr.u32(packet.len() as u32);
            plain(&mut cdr, packet);
        }
        EventFormat::Mono => {
            // Times count from the base. `RigPublisher::check_base` has refused one before 0.
            cdr.u64(packet.base_ns as u64).string("mono").bool(false);
            cdr.bytes_with(|out| mono(out, packet));
        }
        EventFormat::Evt3 => {
            // The encoding contains absolute times.
            cdr.u64(0).string("evt3").bool(false).bytes_with(|out| evt3(out, packet));
        }
    }
}

/// Eight bytes of time, two of the column, two of the row and one of the polarity. Three bytes of padding
/// align the next event; the last event has none.
fn plain(cdr: &mut CdrWriter<'_>, packet: &PacketView<'_>) {
    let last = packet.len().saturating_sub(1);
    for i in 0..packet.len() {
        let t_ns = (packet.base_ns + i64::from(packet.t_offset_ns[i])) as u64;
        let rest =
            u64::from(packet.x[i]) | u64::from(packet.y[i]) << 16 | u64::from(packet.polarity[i]) << 32;
        let record = (u128::from(t_ns) | u128::from(rest) << 64).to_le_bytes();
        let bytes = if i == last { 13 } else { 16 };
        if i == 0 {
            cdr.align_to(8);
        }
        cdr.raw(&record[..bytes]);
    }
}

/// A word of 64 bits for each event: nanoseconds since the base (bits 0 to 31), column (32 to 47), row (48 to
/// 62), polarity (63).
fn mono(out: &mut Vec<u8>, packet: &PacketView<'_>) {
    for i in 0..packet.len() {
        let place = u64::from(packet.x[i]) << 32 | u64::from(packet.y[i]) << 48;
        let word = u64::from(packet.t_offset_ns[i]) | place | u64::from(packet.polarity[i]) << 63;
        out.extend_from_slice(&word.to_le_bytes());
    }
}

/// The 24 bits of time, row and column of each event. Every packet begins with its time.
fn evt3(out: &mut Vec<u8>, packet: &PacketView<'_>) {
    let mut words = Words::new(out);
    if packet.is_empty() {
        // The 24 bits of time overflow every 17 s. Readers count the overflows, also while nothing happens.
        words.time(packet.watermark_ns);
    }
    for i in 0..packet.len() {
        words.time(packet.base_ns + i64::from(packet.t_offset_ns[i]));
        words.event(packet.x[i], packet.y[i], packet.polarity[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::packet::Event;
    use esaac_model::{Packet, Polarity};

    fn packet(times_ns: &[i64], watermark_ns: i64) -> Packet {
        let mut packet = Packet { width_px: 8, height_px: 8, watermark_ns, ..Packet::default() };
        for (i, &t_ns) in times_ns.iter().enumerate() {
            packet.push(Event { t_ns, x: i as u16 % 8, y: 3, polarity: Polarity::On });
        }
        packet
    }

    fn ends(split: Split, packet: &Packet) -> Vec<(usize, i64)> {
        split.parts(&packet.view(), EventFormat::Packed).iter().map(|p| (p.len(), p.watermark_ns)).collect()
    }

    #[test]
    fn slices_of_time_cover_the_packet_with_events_or_without() {
        let packet = Packet { dropped: 4, ..packet(&[1, 25, 26, 100], 100) };
        let split = Split { slice_ns: 25, ..Split::default() };
        assert_eq!(ends(split, &packet), [(2, 25), (1, 50), (0, 75), (1, 100)]);
        let parts = split.parts(&packet.view(), EventFormat::Packed);
        assert_eq!(parts.iter().map(|p| p.dropped).collect::<Vec<_>>(), [0, 0, 0, 4]);
        assert_eq!(ends(Split::default(), &packet), [(4, 100)]);
        // A thirtieth of a second by 1/960 s: 32 slices, of which the last ends with the interval.
        let second = ends(Split { slice_ns: 1_041_667, ..split }, &self::packet(&[], 33_333_333));
        assert_eq!((second.len(), second[31].1), (32, 33_333_333));
    }

    #[test]
    fn slices_are_as_long_as_asked_for_as_nearly_as_they_fill_the_packet() {
        let ends_of = |span_ns: i64| {
            let packet = Packet { base_ns: 1000, watermark_ns: 1000 + span_ns, ..Packet::default() };
            ends(Split { slice_ns: 30, ..Split::default() }, &packet)
        };
        assert_eq!(ends_of(100), [(0, 1033), (0, 1066), (0, 1100)]);
        assert_eq!(ends_of(110), [(0, 1027), (0, 1055), (0, 1082), (0, 1110)]);
        assert_eq!([ends_of(30), ends_of(7)], [[(0, 1030)], [(0, 1007)]]);
    }

    #[test]
    fn no_slice_ends_before_what_the_packet_before_is_complete_up_to() {
        let packet = packet(&[41, 41, 70, 90], 100);
        let split = Split { slice_ns: 20, ..Split::default() };
        let after = |complete_ns| {
            let parts = split.parts_after(complete_ns, &packet.view(), EventFormat::Packed);
            parts.iter().map(|part| (part.len(), part.watermark_ns)).collect::<Vec<_>>()
        };
        assert_eq!(after(Some(40)), [(2, 60), (1, 80), (1, 100)]);
        assert_eq!(after(Some(100)), [(4, 100)]);
        let all = [(0, 20), (0, 40), (2, 60), (1, 80), (1, 100)];
        assert_eq!([after(None), after(Some(-1)), after(Some(101))], [&all[..]; 3], "a clock that went back");
    }

    #[test]
    fn parts_of_few_bytes_say_up_to_when_they_are_complete() {
        let packet = packet(&[5, 5, 5, 9], 20);
        let split = Split { max_bytes: 18, ..Split::default() };
        assert_eq!(ends(split, &packet), [(2, 4), (2, 20)]);
        assert_eq!(ends(Split { max_bytes: 1, ..split }, &packet).len(), 4);
        assert_eq!(ends(split, &self::packet(&[], 20)), [(0, 20)]);
    }

    #[test]
    fn an_event_has_the_bytes_that_splitting_counts_with() {
        // The time's upper half, its lower half and the row change with every event: the most words of evt3.
        let bytes = |format: EventFormat, events: u16| {
            let mut packet = Packet { width_px: 8, height_px: 64, ..Packet::default() };
            for i in 0..events {
                let t_ns = i64::from(i) * 4_097_000;
                packet.push(Event { t_ns, x: i % 8, y: i, polarity: Polarity::On });
            }
            let header = Header { stamp_ns: 0, frame_id: "f" };
            let mut out = Vec::new();
            let head = PacketHead { header, sequence: 0, sensor_name: "s" };
            encode(&mut out, format, &head, &packet.view());
            out.len()
        };
        for (_, format) in EventFormat::NAMES {
            assert_eq!(bytes(format, 48) - bytes(format, 16), 32 * format.event_bytes(), "{format:?}");
        }
    }

    #[test]
    fn a_side_has_as_many_pixels_as_the_coordinate_has_values() {
        // 11 bits in evt3; 15 bits of mono's row, which the other formats share.
        let limits = EventFormat::NAMES.map(|(name, format)| (name, format.side_limit_px()));
        assert_eq!(limits, [("packed", 1 << 15), ("plain", 1 << 15), ("evt3", 1 << 11), ("mono", 1 << 15)]);
    }

    #[test]
    fn evt3_says_what_changes_and_mono_all_in_a_word() {
        let mut packet = packet(&[4_096_000, 4_096_500, 4_097_000], 5_000_000);
        packet.base_ns = 0;
        let mut out = Vec::new();
        evt3(&mut out, &packet.view());
        let words: Vec<u16> = out.chunks(2).map(|w| u16::from_le_bytes([w[0], w[1]])).collect();
        assert_eq!(words, [0x8001, 0x6000, 0x0003, 0x2800, 0x2801, 0x6001, 0x2802]);
        out.clear();
        mono(&mut out, &packet.view().part(1..2));
        assert_eq!(out, (4_096_500_u64 | 1 << 32 | 3 << 48 | 1 << 63).to_le_bytes());
        out.clear();
        evt3(&mut out, &packet.view().part(0..0));
        assert_eq!(out.len(), 4, "the time goes on without events");
        // A nanosecond before zero is the microsecond before zero.
        let mut before = packet;
        before.base_ns = -4_096_001;
        out.clear();
        evt3(&mut out, &before.view().part(0..1));
        assert_eq!(out[..4], [0xff, 0x8f, 0xff, 0x6f]);
    }
}
