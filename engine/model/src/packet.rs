//! Packets: the events of one camera in one interval.

use serde::{Deserialize, Serialize};

/// Sign of a change in log intensity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum Polarity {
    /// Darker.
    Off = 0,
    /// Brighter.
    On = 1,
}

impl Polarity {
    /// -1 or +1.
    #[must_use]
    pub fn sign(self) -> i8 {
        match self {
            Polarity::Off => -1,
            Polarity::On => 1,
        }
    }
}

/// Events of one camera in one interval: struct of arrays, sorted by (t, y, x, polarity), complete
/// up to and including `watermark_ns`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Packet {
    /// Packets of this camera before this one.
    pub sequence: u64,
    /// Sensor width, pixels.
    pub width_px: u32,
    /// Sensor height, pixels.
    pub height_px: u32,
    /// Time that `t_offset_ns` counts from.
    pub base_ns: i64,
    /// No later packet of this camera holds an event at or before this time.
    pub watermark_ns: i64,
    /// Column of each event.
    pub x: Vec<u16>,
    /// Row of each event.
    pub y: Vec<u16>,
    /// Nanoseconds since `base_ns`.
    pub t_offset_ns: Vec<u32>,
    /// 0 OFF, 1 ON.
    pub polarity: Vec<u8>,
    /// Events left out because of the sensor's `max_events_per_interval`.
    pub dropped: u64,
}

/// A packet, or part of one, that borrows its events.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacketView<'a> {
    /// Packets of this camera before this one.
    pub sequence: u64,
    /// Sensor width, pixels.
    pub width_px: u32,
    /// Sensor height, pixels.
    pub height_px: u32,
    /// Time that `t_offset_ns` counts from.
    pub base_ns: i64,
    /// No later packet or part holds an event at or before this time.
    pub watermark_ns: i64,
    /// Column of each event.
    pub x: &'a [u16],
    /// Row of each event.
    pub y: &'a [u16],
    /// Nanoseconds since `base_ns`.
    pub t_offset_ns: &'a [u32],
    /// 0 OFF, 1 ON.
    pub polarity: &'a [u8],
    /// Events left out because of the sensor's `max_events_per_interval`.
    pub dropped: u64,
    /// How often the host has copied the events since the device wrote them: 0 if they lie where the device wrote
    /// them, 1 in a [`Packet`].
    pub host_copies: u32,
}

impl PacketView<'_> {
    /// Number of events.
    #[must_use]
    pub fn len(&self) -> usize {
        self.t_offset_ns.len()
    }

    /// Whether it holds no events.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.t_offset_ns.is_empty()
    }

    /// ON events and OFF events.
    #[must_use]
    pub fn on_off(&self) -> (u64, u64) {
        let on = self.polarity.iter().filter(|&&p| p == Polarity::On as u8).count() as u64;
        (on, self.len() as u64 - on)
    }

    /// A packet that owns a copy of the events.
    #[must_use]
    pub fn to_packet(&self) -> Packet {
        Packet {
            sequence: self.sequence,
            width_px: self.width_px,
            height_px: self.height_px,
            base_ns: self.base_ns,
            watermark_ns: self.watermark_ns,
            x: self.x.to_vec(),
            y: self.y.to_vec(),
            t_offset_ns: self.t_offset_ns.to_vec(),
            polarity: self.polarity.to_vec(),
            dropped: self.dropped,
        }
    }

    /// The events of `range`, with this packet's base time and watermark.
    ///
    /// # Panics
    /// If `range` exceeds the packet, as slicing does.
    #[must_use]
    pub fn part(&self, range: std::ops::Range<usize>) -> Self {
        PacketView {
            x: &self.x[range.clone()],
            y: &self.y[range.clone()],
            t_offset_ns: &self.t_offset_ns[range.clone()],
            polarity: &self.polarity[range],
            ..*self
        }
    }
}

/// One event, sorted by (t, y, x, polarity).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Event {
    /// Time, nanoseconds.
    pub t_ns: i64,
    /// Row.
    pub y: u16,
    /// Column.
    pub x: u16,
    /// Polarity.
    pub polarity: Polarity,
}

impl Packet {
    /// Number of events.
    #[must_use]
    pub fn len(&self) -> usize {
        self.t_offset_ns.len()
    }

    /// Whether it holds no events.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.t_offset_ns.is_empty()
    }

    /// A view that borrows the events.
    #[must_use]
    pub fn view(&self) -> PacketView<'_> {
        PacketView {
            sequence: self.sequence,
            width_px: self.width_px,
            height_px: self.height_px,
            base_ns: self.base_ns,
            watermark_ns: self.watermark_ns,
            x: &self.x,
            y: &self.y,
            t_offset_ns: &self.t_offset_ns,
            polarity: &self.polarity,
            dropped: self.dropped,
            host_copies: 1,
        }
    }

    /// ON events and OFF events.
    #[must_use]
    pub fn on_off(&self) -> (u64, u64) {
        self.view().on_off()
    }

    /// Event `index`.
    ///
    /// # Panics
    /// If `index` exceeds the packet, as indexing does.
    #[must_use]
    pub fn event(&self, index: usize) -> Event {
        Event {
            t_ns: self.base_ns + i64::from(self.t_offset_ns[index]),
            y: self.y[index],
            x: self.x[index],
            polarity: if self.polarity[index] == Polarity::On as u8 { Polarity::On } else { Polarity::Off },
        }
    }

    /// All events in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Event> + '_ {
        (0..self.len()).map(|index| self.event(index))
    }

    /// Appends an event. The caller keeps the order; the event's time must lie within u32 nanoseconds after `base_ns`.
    pub fn push(&mut self, event: Event) {
        self.x.push(event.x);
        self.y.push(event.y);
        self.t_offset_ns.push((event.t_ns - self.base_ns) as u32);
        self.polarity.push(event.polarity as u8);
    }

    /// Removes all events and keeps their storage.
    pub fn clear(&mut self) {
        self.x.clear();
        self.y.clear();
        self.t_offset_ns.clear();
        self.polarity.clear();
        self.dropped = 0;
    }

    /// Whether events are sorted by (t, y, x, polarity).
    #[must_use]
    pub fn is_sorted(&self) -> bool {
        self.iter().zip(self.iter().skip(1)).all(|(a, b)| a <= b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_is_t_y_x_polarity() {
        let event = |t_ns, y, x, polarity| Event { t_ns, y, x, polarity };
        let mut packet = Packet { base_ns: 100, ..Packet::default() };
        for e in [
            event(101, 0, 5, Polarity::On),
            event(101, 1, 0, Polarity::Off),
            event(101, 1, 0, Polarity::On),
            event(102, 0, 0, Polarity::Off),
        ] {
            packet.push(e);
        }
        assert!(packet.is_sorted());
        assert_eq!(packet.on_off(), (2, 2));
        assert_eq!(packet.view().to_packet(), packet);
        packet.push(event(101, 9, 9, Polarity::On));
        assert!(!packet.is_sorted());
    }
}
