//! Reads AEDAT 4, the format of iniVation's DV: a header in XML, then packets of events, frames and more. Each packet
//! is a FlatBuffer and may be compressed.
//!
//! Layout (iniVation's documentation of the AEDAT file formats): `#!AER-DAT4.0\r\n`, a sized FlatBuffer with
//! the compression, the position of a table at the file's end and the XML; then packets, each an i32 stream
//! number, an i32 length and as many bytes. Streams `EVTS` hold structs of 16 bytes (i64 time in microseconds,
//! i16 x, i16 y, bool ON), `FRME` tables of times, format, size and pixels. The reader skips other streams. A file may
//! hold several cameras; each stream names its own.

use super::flatbuffer_reader::{Broken, Scalar, Table};
use super::{Aps, Recording, RecordingError};
use esaac_model::Polarity;
use esaac_model::packet::Event;
use std::io::Read;
use std::path::Path;

pub(super) const MAGIC: &[u8] = b"#!AER-DAT4.0\r\n";

/// Bytes of an event in its packet.
const EVENT_BYTES: usize = 16;

/// Largest unpacked packet. A larger one is broken.
const LARGEST_PACKET: u64 = 1 << 30;

/// Most unpacked bytes for each byte of a file: no recording is compressed so well. A file that claims more would fill the
/// memory.
const MOST_PER_BYTE: usize = 1000;

/// Bytes that any file may unpack to.
const FEW_BYTES: usize = 1 << 24;

/// Most bytes that so many bytes of a file may unpack to.
fn most_unpacked(packed_bytes: usize) -> usize {
    FEW_BYTES.saturating_add(packed_bytes.saturating_mul(MOST_PER_BYTE))
}

/// A stream, as the header describes it.
struct Stream {
    number: i32,
    /// What it holds, such as `EVTS`.
    holds: String,
    /// DV's name of it.
    output: String,
    /// The camera.
    source: String,
    /// Columns and rows, if they are of a sensor.
    size: Option<(u32, u32)>,
}

/// The header's contents that matter here.
struct Header {
    compression: i32,
    /// The only stream of events.
    events: i32,
    /// Streams of frames of the same camera.
    frames: Vec<Stream>,
    name: String,
    size: (u32, u32),
    /// Position where packets end: the start of the table, or the end of the file.
    end: usize,
}

/// Reads events and frames of a file. A file that cannot be read, is broken or is none of the format is an error.
pub fn read(path: &Path) -> Result<Recording, RecordingError> {
    read_wanted(path, true)
}

/// As [`read`], but passes over frames, whatever their format.
pub fn read_events(path: &Path) -> Result<Recording, RecordingError> {
    read_wanted(path, false)
}

fn read_wanted(path: &Path, with_frames: bool) -> Result<Recording, RecordingError> {
    let bytes = std::fs::read(path).map_err(|source| RecordingError::Io { path: path.to_owned(), source })?;
    parse(&bytes, with_frames).map_err(|reason| RecordingError::Format { path: path.to_owned(), reason })
}

/// Reads events, and frames if they are wanted, of a file's bytes.
fn parse(bytes: &[u8], with_frames: bool) -> Result<Recording, Broken> {
    if !bytes.starts_with(MAGIC) {
        return Err("not an AEDAT 4 file: expected it to begin with `#!AER-DAT4.0`".to_owned());
    }
    let length = u32::at(bytes, MAGIC.len())? as usize;
    let packets = MAGIC.len() + 4 + length;
    let header = bytes.get(MAGIC.len() + 4..packets).ok_or("the header ends beyond the file")?;
    let header = read_header(header, bytes.len())?;
    let frames = if with_frames { only(&header.frames, "frames")?.map(|stream| stream.number) } else { None };
    let (width_px, height_px) = header.size;
    let mut recording = Recording { name: header.name.clone(), width_px, height_px, ..Recording::default() };
    let mut at = packets;
    while at < header.end {
        let stream = i32::at(bytes, at)?;
        let length = i32::at(bytes, at + 4)?;
        let end = usize::try_from(length).ok().and_then(|length| (at + 8).checked_add(length));
        let packed = end.and_then(|end| bytes.get(at + 8..end)).ok_or_else(|| {
            format!("the packet at byte {at} has a length of {length}, which ends beyond the file")
        })?;
        let broken = |error: Broken| format!("the packet at byte {at}: {error}");
        if stream == header.events {
            let unpacked = unpack(packed, header.compression).map_err(broken)?;
            append_events(&unpacked, &mut recording).map_err(broken)?;
            if recording.events.len().saturating_mul(EVENT_BYTES) > most_unpacked(bytes.len()) {
                let events = recording.events.len();
                return Err(broken(format!("{events} events in a file of {} bytes", bytes.len())));
            }
        } else if frames == Some(stream) {
            let unpacked = unpack(packed, header.compression).map_err(broken)?;
            read_frame(&unpacked, &mut recording).map_err(broken)?;
        }
        at += 8 + packed.len();
    }
    // Events of the same time stay in the file's order.
    recording.events.sort_by_key(|event| event.t_ns);
    recording.frames.sort_by_key(|frame| frame.start_ns);
    Ok(recording)
}

fn read_header(header: &[u8], file_bytes: usize) -> Result<Header, Broken> {
    let fields = || -> Result<_, Broken> {
        let table = Table::root(header, false)?;
        Ok((table.scalar::<i32>(0)?, table.scalar::<i64>(1)?, table.text(2)?))
    };
    let (compression, position, xml) = fields().map_err(|error| format!("the header: {error}"))?;
    let xml = roxmltree::Document::parse(xml).map_err(|e| format!("the header's XML: {e}"))?;
    let attribute = |node: roxmltree::Node<'_, '_>, key: &str| {
        node.descendants()
            .find(|n| n.has_tag_name("attr") && n.attribute("key") == Some(key))
            .and_then(|n| n.text())
            .map(str::to_owned)
    };
    let is_stream = |n: &roxmltree::Node<'_, '_>| {
        n.has_tag_name("node") && n.parent().and_then(|parent| parent.attribute("name")) == Some("outInfo")
    };
    let stream = |node| -> Result<Stream, Broken> {
        let number = node_number(node).ok_or("the header names a stream that is no number")?;
        let text = |key| attribute(node, key).unwrap_or_default();
        let pixels = |key| text(key).parse::<u32>().ok().filter(|side| (1..=16384).contains(side));
        Ok(Stream {
            number,
            holds: text("typeIdentifier"),
            output: text("originalOutputName"),
            source: text("source"),
            size: pixels("sizeX").zip(pixels("sizeY")),
        })
    };
    let streams: Vec<Stream> = xml.descendants().filter(is_stream).map(stream).collect::<Result<_, _>>()?;
    let (events, others): (Vec<_>, Vec<_>) = streams.into_iter().partition(|stream| stream.holds == "EVTS");
    let sized = only(&events, "events")?.and_then(|events| Some((events, events.size?)));
    let (events, size) = sized.ok_or("the header has no stream of events with a size of 1 to 16384 px")?;
    let (number, name) = (events.number, events.source.clone());
    let frames = others.into_iter().filter(|s| s.holds == "FRME" && s.source == name).collect();
    // A writer that ended early has put no table behind the packets.
    let end = usize::try_from(position).ok().filter(|&end| end > 0).unwrap_or(file_bytes);
    if end > file_bytes {
        return Err(format!(
            "packets end at byte {end}, as the header says, and the file has {file_bytes} bytes"
        ));
    }
    Ok(Header { compression, events: number, frames, name, size, end })
}

/// The number of a stream: the name of its node.
fn node_number(node: roxmltree::Node<'_, '_>) -> Option<i32> {
    node.attribute("name")?.parse().ok()
}

/// The only one of these streams, or none.
///
/// # Errors
/// If there are several: two cameras, or one camera's events twice, would be taken for one sensor.
fn only<'a>(streams: &'a [Stream], what: &str) -> Result<Option<&'a Stream>, Broken> {
    let [_, _, ..] = streams else { return Ok(streams.first()) };
    let named = |s: &Stream| format!("{} (`{}` of `{}`)", s.number, s.output, s.source);
    let named: Vec<String> = streams.iter().map(named).collect();
    Err(format!(
        "{} streams of {what}, expected one: {}; write each camera to a file of its own",
        streams.len(),
        named.join(", ")
    ))
}

/// Unpacks a packet. The header's `compression` is 0 for none, 1 and 2 for LZ4, 3 and 4 for Zstandard, each in its
/// frame format.
fn unpack(packed: &[u8], compression: i32) -> Result<Vec<u8>, Broken> {
    let mut unpacked = Vec::new();
    let most = LARGEST_PACKET.min(most_unpacked(packed.len()) as u64);
    let read = |reader: &mut dyn Read, unpacked: &mut Vec<u8>| {
        reader.take(most + 1).read_to_end(unpacked).map_err(|e| e.to_string())
    };
    match compression {
        0 => unpacked.extend_from_slice(packed),
        1 | 2 => {
            read(&mut lz4_flex::frame::FrameDecoder::new(packed), &mut unpacked)?;
        }
        3 | 4 => {
            let mut decoder = ruzstd::decoding::StreamingDecoder::new(packed).map_err(|e| e.to_string())?;
            read(&mut decoder, &mut unpacked)?;
        }
        other => return Err(format!("compression {other}, expected 0 to 4")),
    }
    if compression != 0 && unpacked.len() as u64 > most {
        return Err(format!("{} bytes that unpack to more than {most}", packed.len()));
    }
    Ok(unpacked)
}

fn append_events(unpacked: &[u8], recording: &mut Recording) -> Result<(), Broken> {
    let table = Table::root(unpacked, true)?;
    for event in table.vector(0, EVENT_BYTES)?.chunks_exact(EVENT_BYTES) {
        let (x, y) = (i16::at(event, 8)?, i16::at(event, 10)?);
        let inside = |v: i16, size: u32| u32::try_from(v).is_ok_and(|v| v < size);
        if !inside(x, recording.width_px) || !inside(y, recording.height_px) {
            return Err(format!(
                "an event at ({x}, {y}) on a sensor of {}x{} px",
                recording.width_px, recording.height_px
            ));
        }
        let polarity = if event[12] != 0 { Polarity::On } else { Polarity::Off };
        let t_ns = microseconds(i64::at(event, 0)?)?;
        recording.events.push(Event { t_ns, y: y as u16, x: x as u16, polarity });
    }
    Ok(())
}

fn microseconds(us: i64) -> Result<i64, Broken> {
    us.checked_mul(1000).ok_or_else(|| format!("a time of {us} us is beyond i64 nanoseconds"))
}

/// Reads a frame. Its fields are: 0 time, 1 and 2 start and end of the frame, 3 and 4 start and end of the exposure,
/// 5 format, 6 and 7 size, 8 and 9 position, 10 pixels.
fn read_frame(unpacked: &[u8], recording: &mut Recording) -> Result<(), Broken> {
    let table = Table::root(unpacked, true)?;
    let time = |index| table.scalar::<i64>(index).and_then(microseconds);
    let (width, height) = (table.scalar::<i16>(6)?, table.scalar::<i16>(7)?);
    let expected = (recording.width_px, recording.height_px);
    if (i64::from(width), i64::from(height)) != (i64::from(expected.0), i64::from(expected.1)) {
        return Err(format!("a frame of {width}x{height} px, expected {}x{}", expected.0, expected.1));
    }
    // OpenCV's numbers of pixel types: 0 is 8-bit gray, 16 is 8-bit BGR.
    let channels = match table.scalar::<i8>(5)? {
        0 => 1,
        16 => 3,
        other => return Err(format!("a frame of format {other}, expected 0 (8-bit gray) or 16 (8-bit BGR)")),
    };
    let bytes = table.vector(10, 1)?;
    let wanted = recording.width_px as usize * recording.height_px as usize * channels;
    if bytes.len() != wanted {
        return Err(format!("a frame of {} bytes, expected {wanted}", bytes.len()));
    }
    let mean = |texel: &[u8]| texel.iter().map(|&v| f32::from(v)).sum::<f32>() / (255.0 * channels as f32);
    let pixels = bytes.chunks_exact(channels).map(mean).collect();
    recording.frames.push(Aps { start_ns: time(3)?, end_ns: time(4)?, pixels });
    Ok(())
}
