//! Writes AEDAT 4 files, laid out as [`super::aedat4`] says. Packets of events, frames and inertial samples are in
//! order of time. The header names the stream of events, and others if they have packets. There is no table at the end;
//! readers find the packets by their lengths.

use super::Recording;
use super::flatbuffer_writer::{Field, buffer};
use anyhow::{Context, Result, ensure};
use esaac_model::Polarity;
use std::io::Write;

/// Most events of a packet; similar to DV, whose packets hold some milliseconds.
const EVENTS_OF_PACKET: usize = 8192;

/// How packets are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// LZ4 frames.
    Lz4,
    /// Zstandard frames.
    Zstd,
}

/// A sample of the inertial sensors beside a camera's chip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Time, nanoseconds.
    pub t_ns: i64,
    /// Acceleration in x, y, z, multiples of standard gravity.
    pub acceleration_g: [f32; 3],
    /// Rate of turning about x, y, z, degrees a second.
    pub turning_deg_per_s: [f32; 3],
    /// Temperature of the chip, degrees Celsius.
    pub temperature_c: f32,
}

/// Streams in the order of their numbers: type of their packets, and DV's name of the output.
const STREAMS: [(&str, &str); 3] = [("EVTS", "events"), ("FRME", "frames"), ("IMUS", "imu")];

/// A packet before compression.
struct Packet {
    start_ns: i64,
    stream: i32,
    bytes: Vec<u8>,
}

/// Writes a file. Times must be whole microseconds, the format's unit. Frames are written with eight bits a pixel.
pub fn write(
    out: &mut impl Write,
    recording: &Recording,
    imu: &[ImuSample],
    compression: Compression,
) -> Result<()> {
    let mut packets = Vec::new();
    for events in recording.events.chunks(EVENTS_OF_PACKET) {
        let mut bytes = Vec::with_capacity(16 * events.len());
        for event in events {
            bytes.extend(microseconds(event.t_ns)?.to_le_bytes());
            bytes.extend(coordinate(u32::from(event.x))?.to_le_bytes());
            bytes.extend(coordinate(u32::from(event.y))?.to_le_bytes());
            bytes.extend([u8::from(event.polarity == Polarity::On), 0, 0, 0]);
        }
        let bytes = buffer(b"EVTS", &[Field::Vector(events.len(), bytes)]);
        packets.push(Packet { start_ns: events[0].t_ns, stream: 0, bytes });
    }
    let size = [coordinate(recording.width_px)?, coordinate(recording.height_px)?];
    let pixels = recording.width_px as usize * recording.height_px as usize;
    for frame in &recording.frames {
        ensure!(frame.pixels.len() == pixels, "a frame of {} px, expected {pixels}", frame.pixels.len());
        let (start, end) = (microseconds(frame.start_ns)?, microseconds(frame.end_ns)?);
        let gray: Vec<u8> = frame.pixels.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
        let mut fields: Vec<Field> = [start, start, end, start, end].map(Field::I64).into();
        fields.push(Field::I8(0)); // OpenCV's number for 8-bit gray
        fields.extend([size[0], size[1], 0, 0].map(Field::I16));
        fields.push(Field::Vector(pixels, gray));
        packets.push(Packet { start_ns: frame.start_ns, stream: 1, bytes: buffer(b"FRME", &fields) });
    }
    for sample in imu {
        let mut fields = vec![Field::I64(microseconds(sample.t_ns)?), Field::F32(sample.temperature_c)];
        fields.extend(sample.acceleration_g.map(Field::F32));
        fields.extend(sample.turning_deg_per_s.map(Field::F32));
        let bytes = buffer(b"IMUS", &[Field::Tables(vec![fields])]);
        packets.push(Packet { start_ns: sample.t_ns, stream: 2, bytes });
    }
    packets.sort_by_key(|packet| packet.start_ns);

    let number = match compression {
        Compression::None => 0,
        Compression::Lz4 => 1,
        Compression::Zstd => 3,
    };
    let has_packets = |&(number, _): &(i32, _)| packets.iter().any(|packet| packet.stream == number);
    let streams: Vec<_> = (0..).zip(STREAMS).filter(|s| s.0 == 0 || has_packets(s)).collect();
    // No table at the end: its position is -1.
    let header =
        [Field::I32(number), Field::I64(-1), Field::Text(description(recording, &streams, compression))];
    out.write_all(super::aedat4::MAGIC)?;
    out.write_all(&buffer(b"IOHE", &header))?;
    for packet in packets {
        let packed = pack(&packet.bytes, compression)?;
        let length = i32::try_from(packed.len()).context("a packet of 2 GiB or more")?;
        out.write_all(&packet.stream.to_le_bytes())?;
        out.write_all(&length.to_le_bytes())?;
        out.write_all(&packed)?;
    }
    Ok(())
}

fn microseconds(t_ns: i64) -> Result<i64> {
    ensure!(t_ns % 1000 == 0, "a time of {t_ns} ns, expected whole microseconds");
    Ok(t_ns / 1000)
}

fn coordinate(px: u32) -> Result<i16> {
    i16::try_from(px).with_context(|| format!("{px} px, expected at most {}", i16::MAX))
}

fn pack(bytes: &[u8], compression: Compression) -> Result<Vec<u8>> {
    Ok(match compression {
        Compression::None => bytes.to_vec(),
        Compression::Lz4 => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(bytes)?;
            encoder.finish()?
        }
        Compression::Zstd => {
            ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest)
        }
    })
}

/// Makes DV's tree of settings in XML, with a node for each stream.
fn description(recording: &Recording, streams: &[(i32, (&str, &str))], compression: Compression) -> String {
    let compression = match compression {
        Compression::None => "NONE",
        Compression::Lz4 => "LZ4",
        Compression::Zstd => "ZSTD",
    };
    let attribute = |key: &str, kind: &str, value: &str| {
        let value = value.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        format!("<attr key=\"{key}\" type=\"{kind}\">{value}</attr>")
    };
    let path = "/mainloop/Recorder/outInfo/";
    let streams: String = streams
        .iter()
        .map(|(number, (identifier, output))| {
            format!(
                "<node name=\"{number}\" path=\"{path}{number}/\">{}{}{}<node name=\"info\" path=\"{path}{number}/info/\">\
                 {}{}{}</node></node>",
                attribute("compression", "string", compression),
                attribute("originalOutputName", "string", output),
                attribute("typeIdentifier", "string", identifier),
                attribute("sizeX", "int", &recording.width_px.to_string()),
                attribute("sizeY", "int", &recording.height_px.to_string()),
                attribute("source", "string", &recording.name),
            )
        })
        .collect();
    format!("<dv version=\"2.0\"><node name=\"outInfo\" path=\"{path}\">{streams}</node></dv>")
}
