//! Reads EVT3: words into events, and whole files.

use super::{SIDE_PX, kind};
use crate::Polarity;
use crate::packet::Event;
use thiserror::Error;

/// Values of the upper half of a time.
const HIGHS: i64 = 1 << 12;

/// Why bytes are no EVT3.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Evt3Error {
    /// There is no header.
    #[error("not an EVT file: expected it to begin with lines of text such as `% evt 3.0`")]
    NoHeader,
    /// The header does not tell the encoding.
    #[error("the header does not tell the encoding, expected `% evt 3.0`")]
    NoEncoding,
    /// Another encoding of the same maker.
    #[error("the header says `{actual}`, expected `evt 3.0`: EVT2, EVT2.1 and EVT4 are not read")]
    Encoding {
        /// The line of the header.
        actual: String,
    },
    /// The header does not tell the sensor's size.
    #[error("the header does not tell the sensor's size, expected a line such as `% geometry 1280x720`")]
    NoSize,
    /// A size that is none, or is too large.
    #[error("the header says `{actual}`, expected columns and rows of 1 to {SIDE_PX}")]
    Size {
        /// The line of the header.
        actual: String,
    },
    /// The bytes end within a word.
    #[error("{actual} bytes of events, expected an even number: a word is cut off")]
    HalfWord {
        /// Bytes behind the header.
        actual: usize,
    },
    /// A word of a kind that there is not.
    #[error("the word at byte {at} is of kind {actual}, expected 0, 2 to 8, 10, 14 or 15")]
    Kind {
        /// Its place.
        at: usize,
        /// Its kind.
        actual: u16,
    },
    /// An event beside the sensor.
    #[error("the word at byte {at} has an event at ({x}, {y}) on a sensor of {width_px}x{height_px} px")]
    Outside {
        /// Its place.
        at: usize,
        /// Column.
        x: u16,
        /// Row.
        y: u16,
        /// Columns of the sensor.
        width_px: u32,
        /// Rows of the sensor.
        height_px: u32,
    },
    /// A time that goes back. Where its upper half falls by half of its range or more, it has wrapped.
    #[error("the word at byte {at} takes the time back from {from_us} to {to_us} us, expected it to go on")]
    Back {
        /// Its place.
        at: usize,
        /// The upper half of the time so far, microseconds since its last wrap.
        from_us: i64,
        /// The next.
        to_us: i64,
    },
}

/// Makes events of words. It keeps time, row and column between calls.
#[derive(Clone, Debug)]
pub struct Decoder {
    size_px: [u32; 2],
    /// The upper half of the time, with its wraps since the first word.
    high: Option<i64>,
    low: i64,
    row: Option<u16>,
    /// Where the next vector begins.
    vector: Option<(u16, Polarity)>,
}

impl Decoder {
    /// A decoder for a sensor of `[columns, rows]`.
    #[must_use]
    pub fn new(size_px: [u32; 2]) -> Self {
        Decoder { size_px, high: None, low: 0, row: None, vector: None }
    }

    /// The time that was last told, microseconds. The 24 bits of the first time count from 0, and each wrap adds to them.
    #[must_use]
    pub fn time_us(&self) -> Option<i64> {
        self.high.map(|high| high << 12 | self.low)
    }

    /// Appends the events of `bytes`, which are whole words, to `events`. Those before the first time, row or column are left
    /// out: a recording may begin anywhere.
    ///
    /// # Errors
    /// If a word is of no kind, an event is beside the sensor, the time goes back, or a word is cut off.
    pub fn decode(&mut self, bytes: &[u8], events: &mut Vec<Event>) -> Result<(), Evt3Error> {
        let (words, rest) = bytes.as_chunks();
        if !rest.is_empty() {
            return Err(Evt3Error::HalfWord { actual: bytes.len() });
        }
        let words = words.iter().map(|&word| u16::from_le_bytes(word));
        words.enumerate().try_for_each(|(number, word)| self.word(2 * number, word, events))
    }

    fn word(&mut self, at: usize, word: u16, events: &mut Vec<Event>) -> Result<(), Evt3Error> {
        let (value, place) = (word & 0xfff, word & 0x7ff);
        let polarity = if word & 0x800 == 0 { Polarity::Off } else { Polarity::On };
        match word >> 12 {
            kind::ROW => self.row = Some(place),
            kind::COLUMN => self.event(at, place, polarity, events)?,
            kind::VECTOR_START => self.vector = Some((place, polarity)),
            kind::VECTOR_12 => self.vector(at, value, 12, events)?,
            kind::VECTOR_8 => self.vector(at, value & 0xff, 8, events)?,
            kind::LOW => self.low = value.into(),
            kind::HIGH => self.high(at, value.into())?,
            other if kind::NO_EVENTS.contains(&other) => {}
            actual => return Err(Evt3Error::Kind { at, actual }),
        }
        Ok(())
    }

    fn vector(
        &mut self,
        at: usize,
        bits: u16,
        columns: u16,
        events: &mut Vec<Event>,
    ) -> Result<(), Evt3Error> {
        let Some((start, polarity)) = self.vector else { return Ok(()) };
        for column in (0..columns).filter(|column| bits >> column & 1 == 1) {
            self.event(at, start.saturating_add(column), polarity, events)?;
        }
        self.vector = Some((start.saturating_add(columns), polarity));
        Ok(())
    }

    fn event(&self, at: usize, x: u16, polarity: Polarity, events: &mut Vec<Event>) -> Result<(), Evt3Error> {
        let (Some(t_us), Some(y)) = (self.time_us(), self.row) else { return Ok(()) };
        let [width_px, height_px] = self.size_px;
        if u32::from(x) >= width_px || u32::from(y) >= height_px {
            return Err(Evt3Error::Outside { at, x, y, width_px, height_px });
        }
        events.push(Event { t_ns: t_us * 1000, y, x, polarity });
        Ok(())
    }

    fn high(&mut self, at: usize, value: i64) -> Result<(), Evt3Error> {
        let before = self.high.unwrap_or(value);
        let from = before % HIGHS;
        let wraps = if from >= value + HIGHS / 2 { HIGHS } else { 0 };
        if wraps == 0 && value < from {
            return Err(Evt3Error::Back { at, from_us: from << 12, to_us: value << 12 });
        }
        if value != from || self.high.is_none() {
            // The lower half of the time before says nothing of this one.
            self.low = 0;
        }
        self.high = Some(before - from + value + wraps);
        Ok(())
    }
}

/// What an EVT3 file holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Evt3File {
    /// Columns and rows of the sensor.
    pub size_px: [u32; 2],
    /// Events in the file's order. Times are whole microseconds.
    pub events: Vec<Event>,
}

/// Reads the bytes of a file (`.raw`).
///
/// # Errors
/// If the header is none of EVT3 or lacks the sensor's size, and as [`Decoder::decode`].
pub fn read_file(bytes: &[u8]) -> Result<Evt3File, Evt3Error> {
    let (header, start) = header_lines(bytes);
    if header.is_empty() {
        return Err(Evt3Error::NoHeader);
    }
    check_encoding(&header)?;
    let size_px = size_px(&header)?;
    let mut events = Vec::new();
    Decoder::new(size_px).decode(&bytes[start..], &mut events).map_err(|error| error.behind(start))?;
    Ok(Evt3File { size_px, events })
}

impl Evt3Error {
    /// The same of words behind `start` bytes.
    fn behind(mut self, start: usize) -> Self {
        use Evt3Error::{Back, Kind, Outside};
        if let Kind { at, .. } | Outside { at, .. } | Back { at, .. } = &mut self {
            *at += start;
        }
        self
    }
}

/// Lines of the header, without their `% `, and where the words begin: behind `% end`, or in older files where a line
/// begins otherwise.
fn header_lines(bytes: &[u8]) -> (Vec<String>, usize) {
    let (mut lines, mut at) = (Vec::new(), 0);
    while bytes[at..].starts_with(b"% ") {
        let Some(length) = bytes[at..].iter().position(|&byte| byte == b'\n') else { break };
        let line = String::from_utf8_lossy(&bytes[at + 2..at + length]).trim().to_owned();
        at += length + 1;
        let is_end = line == "end";
        lines.push(line);
        if is_end {
            break;
        }
    }
    (lines, at)
}

/// The first line of the header that begins with `key`, and what comes behind it.
fn header_line<'a>(header: &'a [String], key: &str) -> Option<(&'a String, &'a str)> {
    header.iter().find_map(|line| Some((line, line.strip_prefix(key)?.trim())))
}

fn check_encoding(header: &[String]) -> Result<(), Evt3Error> {
    let version = header_line(header, "evt ").map(|(line, version)| (line, version == "3.0"));
    let format =
        header_line(header, "format ").map(|(line, format)| (line, format.split(';').next() == Some("EVT3")));
    if version.or(format).is_none() {
        return Err(Evt3Error::NoEncoding);
    }
    match version.into_iter().chain(format).find(|(_, is_evt3)| !is_evt3) {
        Some((line, _)) => Err(Evt3Error::Encoding { actual: line.clone() }),
        None => Ok(()),
    }
}

/// Columns and rows, from the line `geometry` or else from the line `format`.
fn size_px(header: &[String]) -> Result<[u32; 2], Evt3Error> {
    let of_geometry = || {
        let (line, size) = header_line(header, "geometry ")?;
        let (width, height) = size.split_once('x').unwrap_or((size, ""));
        Some((line, [width, height]))
    };
    let of_format = || {
        let (line, format) = header_line(header, "format ")?;
        let part = |name: &str| format.split(';').find_map(|part| part.strip_prefix(name));
        Some((line, [part("width=")?, part("height=")?]))
    };
    let (line, sides) = of_geometry().or_else(of_format).ok_or(Evt3Error::NoSize)?;
    let [width_px, height_px] = sides.map(|side| side.trim().parse().unwrap_or(0));
    if [width_px, height_px].iter().all(|side_px| (1..=SIDE_PX).contains(side_px)) {
        Ok([width_px, height_px])
    } else {
        Err(Evt3Error::Size { actual: line.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "% evt 3.0\n% geometry 64x32\n% end\n";

    /// A header, and words behind it.
    fn file(header: &str, words: &[u16]) -> Vec<u8> {
        let words = words.iter().flat_map(|word| word.to_le_bytes());
        header.bytes().chain(words).collect()
    }

    /// Times in microseconds, columns, rows and whether ON.
    fn events(words: &[u16]) -> Result<Vec<(i64, u16, u16, bool)>, Evt3Error> {
        let fields = |e: &Event| (e.t_ns / 1000, e.x, e.y, e.polarity == Polarity::On);
        Ok(read_file(&file(HEADER, words))?.events.iter().map(fields).collect())
    }

    #[test]
    fn single_events_and_vectors_are_read() {
        let words = [
            &[0x8001, 0x6002, 0x0005][..],     // 4098 us, row 5
            &[0x2803, 0x2004],                 // ON in column 3, OFF in column 4
            &[0x3810, 0x4801, 0x5082], // ON from column 16: the first and last of twelve, two of the next eight
            &[0xa001, 0xe123, 0x7004, 0xf005], // a trigger, and what is no event
            &[0x8001, 0x2006],         // the upper half as before: the time stays
            &[0x8002, 0x2007],         // another, without a lower half
        ];
        let expected = [
            (4098, 3, 5, true),
            (4098, 4, 5, false),
            (4098, 16, 5, true),
            (4098, 27, 5, true),
            (4098, 29, 5, true),
            (4098, 35, 5, true),
            (4098, 6, 5, false),
            (8192, 7, 5, false),
        ];
        assert_eq!(events(&words.concat()).unwrap(), expected);
    }

    #[test]
    fn what_comes_before_the_first_time_and_row_is_left_out() {
        let words = [0x2001, 0x0002, 0x2001, 0x4fff, 0x8000, 0x6001, 0x2003];
        assert_eq!(events(&words).unwrap(), [(1, 3, 2, false)]);
        assert_eq!(events(&[]).unwrap(), []);
        assert_eq!(events(&[0x8000, 0x4fff]).unwrap(), []);
    }

    #[test]
    fn times_count_their_wraps_and_do_not_go_back() {
        let start = [0x8fff, 0x6fff, 0x0000, 0x2000];
        let on = |high: u16| events(&[&start[..], &[0x8000 | high, 0x6000, 0x2001]].concat());
        assert_eq!(on(0).unwrap()[1].0, 1 << 24);
        assert_eq!(on(2047).unwrap()[1].0, (1 << 24) + (2047 << 12), "the last one that counts as a wrap");
        let back = |to_us| Evt3Error::Back { at: HEADER.len() + 8, from_us: 4095 << 12, to_us };
        assert_eq!(on(2048).unwrap_err(), back(2048 << 12));
        assert_eq!(on(4094).unwrap_err(), back(4094 << 12));
        let gap = events(&[0x8000, 0x6007, 0x0000, 0x2000, 0x8fff, 0x2001]).unwrap();
        assert_eq!([gap[0].0, gap[1].0], [7, 4095 << 12]);
    }

    #[test]
    fn damaged_words_are_named_with_their_place() {
        let start = HEADER.len();
        let error = |words: &[u16]| events(words).unwrap_err();
        for kind in [1, 9, 0xb, 0xc, 0xd] {
            assert_eq!(error(&[0x8000, kind << 12]), Evt3Error::Kind { at: start + 2, actual: kind });
        }
        let outside = |x, y| format!("byte {} has an event at ({x}, {y}) on a sensor of 64x32 px", start + 4);
        assert!(error(&[0x8000, 0x0000, 0x2040]).to_string().contains(&outside(64, 0)));
        assert!(error(&[0x8000, 0x0020, 0x2000]).to_string().contains(&outside(0, 32)));
        assert!(error(&[0x8000, 0x0000, 0x303f, 0x4002]).to_string().contains("(64, 0)"), "a second column");
        assert!(events(&[0x8000, 0x0000, 0x303f, 0x4001]).is_ok());
        let endless = [&[0x8000, 0x0000, 0x37ff][..], &[0x4000; 6000]].concat();
        assert!(events(&endless).unwrap().is_empty(), "empty vectors beyond any sensor");
        let cut = [&file(HEADER, &[0x8000])[..], &[7]].concat();
        assert_eq!(read_file(&cut), Err(Evt3Error::HalfWord { actual: 3 }));
    }

    #[test]
    fn headers_tell_encoding_and_size() {
        let size = |header: &str| read_file(&file(header, &[0x8000])).map(|file| file.size_px);
        for header in [
            "% Date 2023-03-01 10:00:00\n% evt 3.0\n% geometry 1280x720\n% end\n",
            "% evt 3.0\r\n% geometry 1280x720\r\n% end\r\n",
            "% format EVT3;height=720;width=1280\n% end\n",
            "% evt 3.0\n% geometry 1280x720\n",
        ] {
            assert_eq!(size(header), Ok([1280, 720]), "{header}");
        }
        let error = |header: &str| size(header).unwrap_err().to_string();
        assert!(error("").contains("not an EVT file"));
        assert!(
            error("% evt 2.0\n% geometry 640x480\n").contains("`evt 2.0`, expected `evt 3.0`: EVT2, EVT2.1")
        );
        assert!(error("% evt 3.0\n% format EVT21;height=720;width=1280\n% end\n").contains("`format EVT21"));
        assert_eq!(size("% geometry 640x480\n% end\n"), Err(Evt3Error::NoEncoding));
        assert_eq!(size("% evt 3.0\n% end\n"), Err(Evt3Error::NoSize));
        assert_eq!(size("% format EVT3\n% end\n"), Err(Evt3Error::NoSize));
        for wrong in ["0x720", "2049x720", "1280", "-1x5", "x"] {
            assert!(error(&format!("% evt 3.0\n% geometry {wrong}\n% end\n")).contains(wrong), "{wrong}");
        }
    }

    #[test]
    fn damaged_files_are_errors_or_have_events_on_the_sensor() {
        let words = [0x8001, 0x6002, 0x0005, 0x2803, 0x3810, 0x4801, 0x5082, 0x8002, 0x2007];
        let whole = file(HEADER, &words);
        let cut = (0..whole.len()).map(|length| whole[..length].to_vec());
        let flipped = (0..8 * whole.len()).map(|bit| {
            let mut damaged = whole.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            damaged
        });
        let mut errors = 0;
        for damaged in cut.chain(flipped) {
            match read_file(&damaged) {
                Ok(Evt3File { size_px: [width_px, height_px], events }) => {
                    assert!(events.iter().all(|e| u32::from(e.x) < width_px && u32::from(e.y) < height_px));
                }
                Err(_) => errors += 1,
            }
        }
        assert!(errors > 100, "{errors}");
    }
}
