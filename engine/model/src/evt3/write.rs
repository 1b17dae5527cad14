//! Writes EVT3: events as words, and whole files.

use super::{SIDE_PX, kind};
use crate::packet::Event;
use std::io::{Error, ErrorKind, Result, Write};

/// Largest step of the upper half of the time in a file. Readers differ in what they take for a damaged time; a quarter
/// of the range is a step forward to all of them.
const HIGH_STEP: i64 = 1 << 10;

/// Bytes that gather before a file is written.
const BUFFER_BYTES: usize = 1 << 16;

/// Appends words to bytes.
#[derive(Debug)]
pub struct Words<'a> {
    out: &'a mut Vec<u8>,
    high: Option<u16>,
    low: Option<u16>,
    row: Option<u16>,
}

impl<'a> Words<'a> {
    /// Words behind those in `out`, which need not have told time and row.
    pub fn new(out: &'a mut Vec<u8>) -> Self {
        Words { out, high: None, low: None, row: None }
    }

    /// The lower 24 bits of a time.
    pub fn time(&mut self, t_ns: i64) {
        let t_us = t_ns.div_euclid(1000);
        let [high, low] = [t_us >> 12, t_us].map(|bits| (bits & 0xfff) as u16);
        self.high(high);
        if self.low.replace(low) != Some(low) {
            self.word(kind::LOW, low);
        }
    }

    /// An event at the time that was last given.
    pub fn event(&mut self, x: u16, y: u16, polarity: u8) {
        if self.row.replace(y) != Some(y) {
            self.word(kind::ROW, y & 0x7ff);
        }
        self.word(kind::COLUMN, x & 0x7ff | u16::from(polarity) << 11);
    }

    /// Writes what has gathered, if that is much.
    fn spill(&mut self, to: &mut dyn Write) -> Result<()> {
        if self.out.len() >= BUFFER_BYTES {
            to.write_all(self.out)?;
            self.out.clear();
        }
        Ok(())
    }

    fn high(&mut self, high: u16) {
        if self.high.replace(high) != Some(high) {
            self.word(kind::HIGH, high);
            self.low = None;
        }
    }

    fn word(&mut self, kind: u16, value: u16) {
        self.out.extend_from_slice(&(kind << 12 | value).to_le_bytes());
    }
}

/// Writes a file (`.raw`) of a sensor of `width_px` by `height_px` pixels. Its times are absolute: a reader counts how often
/// the 24 bits have wrapped since 0, so the upper half of the time is written at both sides of every wrap and on the
/// way there, also where there are no events. That is 10 bytes for each 16.78 s.
///
/// Fails if a side is longer than [`SIDE_PX`], or if times are negative or go back.
pub fn write_file(
    out: &mut dyn Write,
    [width_px, height_px]: [u32; 2],
    events: impl IntoIterator<Item = Event>,
) -> Result<()> {
    if width_px.max(height_px) > SIDE_PX {
        let message = format!("EVT3 of {width_px} x {height_px} pixels, expected at most {SIDE_PX} a side");
        return Err(Error::new(ErrorKind::InvalidInput, message));
    }
    write!(
        out,
        "% evt 3.0\n% format EVT3;height={height_px};width={width_px}\n% geometry {width_px}x{height_px}\n% end\n"
    )?;
    let mut bytes = Vec::with_capacity(BUFFER_BYTES + 64);
    let mut words = Words::new(&mut bytes);
    let (mut high, mut last_ns) = (0, 0);
    words.high(0);
    for event in events {
        if event.t_ns < last_ns {
            let message = format!("EVT3 event at {} ns, expected {last_ns} or later", event.t_ns);
            return Err(Error::new(ErrorKind::InvalidInput, message));
        }
        last_ns = event.t_ns;
        let event_high = (event.t_ns / 1000) >> 12;
        while high < event_high {
            let before_wrap = high | 0xfff;
            high = if high == before_wrap {
                high + 1
            } else {
                event_high.min(before_wrap).min(high + HIGH_STEP)
            };
            words.high((high & 0xfff) as u16);
            words.spill(out)?;
        }
        words.time(event.t_ns);
        words.event(event.x, event.y, event.polarity as u8);
        words.spill(out)?;
    }
    out.write_all(&bytes)
}

#[cfg(test)]
mod tests {
    use super::super::{Evt3File, read_file};
    use super::*;
    use crate::Polarity;

    fn events(times_us: &[i64]) -> Vec<Event> {
        let event = |(i, &t_us): (usize, &i64)| {
            let polarity = if i % 2 == 0 { Polarity::On } else { Polarity::Off };
            Event { t_ns: t_us * 1000 + 999, x: 2047 - i as u16, y: 3 * i as u16, polarity }
        };
        times_us.iter().enumerate().map(event).collect()
    }

    fn file(size: [u32; 2], events: &[Event]) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        write_file(&mut bytes, size, events.iter().copied()).map(|()| bytes)
    }

    /// Fails if the upper half of the time does what some reader takes for damage: it wraps from its last value to 0 and
    /// else grows by less than half its range. A lower half comes after each.
    fn check_times(bytes: &[u8]) {
        let end = bytes.windows(6).position(|six| six == b"% end\n").expect("a header") + 6;
        let words = bytes[end..].chunks(2).map(|word| u16::from_le_bytes([word[0], word[1]]));
        let (mut high, mut is_whole) = (0, false);
        for word in words {
            match word >> 12 {
                kind::HIGH => {
                    let next = word & 0xfff;
                    assert!(
                        (high, next) == (4095, 0) || (high..high + 2048).contains(&next),
                        "{high} to {next}"
                    );
                    (high, is_whole) = (next, false);
                }
                kind::LOW => is_whole = true,
                kind::COLUMN => assert!(is_whole, "a lower half after each upper half"),
                _ => {}
            }
        }
    }

    #[test]
    fn a_file_has_absolute_times_across_wraps_and_gaps() {
        let second = 1_000_000;
        let dense: Vec<i64> = (0..500).map(|i| i * 100_000).collect();
        for times_us in [
            &dense[..],
            &[60 * second, 60 * second + 5],
            &[0, 50_000, second, 21 * second, 141 * second],
            &[(1 << 24) - 1, 1 << 24, (1 << 24) + 4096, 2 << 24, 3 << 24],
            &[],
        ] {
            let events = events(times_us);
            let bytes = file([2048, 2048], &events).unwrap();
            check_times(&bytes);
            let whole_us = |event: &Event| Event { t_ns: event.t_ns / 1000 * 1000, ..*event };
            let events = events.iter().map(whole_us).collect();
            assert_eq!(read_file(&bytes), Ok(Evt3File { size_px: [2048, 2048], events }));
        }
    }

    #[test]
    fn a_gap_costs_a_few_words_for_each_wrap() {
        let bytes = file([2048, 2048], &events(&[1000 << 24])).unwrap();
        assert!((10_000..10_100).contains(&bytes.len()), "{}", bytes.len());
    }

    #[test]
    fn what_the_format_cannot_hold_is_refused() {
        let error = |size, times_us: &[i64]| file(size, &events(times_us)).unwrap_err().to_string();
        assert_eq!(error([2049, 10], &[]), "EVT3 of 2049 x 10 pixels, expected at most 2048 a side");
        assert_eq!(error([10, 10], &[-1]), "EVT3 event at -1 ns, expected 0 or later");
        assert_eq!(error([10, 10], &[5, 4]), "EVT3 event at 4999 ns, expected 5999 or later");
    }
}
