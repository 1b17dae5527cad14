//! Recordings are read as they were written, and broken copies of them are errors.

use esaac_formats::recording::aedat4_writer::{Compression, ImuSample, write};
use esaac_formats::recording::{Aps, Recording, RecordingError, aedat4};
use esaac_model::Polarity;
use esaac_model::packet::Event;
use std::path::Path;

/// Events of two packets and some frames, of a sensor that is wider than high.
fn recording() -> Recording {
    let (width_px, height_px) = (37, 23);
    let events = (0..10_000_u32).map(|i| Event {
        t_ns: i64::from(i) * 7_000 - 1_000_000,
        x: (i % width_px) as u16,
        y: (i / 3 % height_px) as u16,
        polarity: if i % 5 < 2 { Polarity::On } else { Polarity::Off },
    });
    let frames = (0..4_i64).map(|k| Aps {
        start_ns: k * 20_000_000,
        end_ns: k * 20_000_000 + 5_000_000,
        pixels: (0..width_px * height_px).map(|i| ((i + k as u32) % 256) as f32 / 255.0).collect(),
    });
    Recording {
        name: "DAVIS <&> \"1\"".to_owned(),
        width_px,
        height_px,
        events: events.collect(),
        frames: frames.collect(),
    }
}

fn imu() -> Vec<ImuSample> {
    let sample = |ms: i64| ImuSample {
        t_ns: ms * 1_000_000,
        acceleration_g: [0.0, -1.0, 0.1],
        turning_deg_per_s: [1.0, 2.0, 3.0],
        temperature_c: 30.5,
    };
    (0..60).map(sample).collect()
}

fn file(recording: &Recording, compression: Compression) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes, recording, &imu(), compression).unwrap();
    bytes
}

/// Writes bytes to a file and reads it as a recording.
fn read(bytes: &[u8]) -> Result<Recording, RecordingError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.aedat4");
    std::fs::write(&path, bytes).unwrap();
    aedat4::read(&path)
}

/// Equal events may compress so well that a small file could fill the memory.
#[test]
fn more_events_than_a_file_may_hold_are_an_error() {
    let written = |recording: &Recording, compression| {
        let mut bytes = Vec::new();
        write(&mut bytes, recording, &[], compression).unwrap();
        bytes
    };
    // A packet of events that are all zeroes, as one block of its first bytes and one that repeats a zero (RFC 8878).
    let empty = Recording { events: Vec::new(), frames: Vec::new(), ..recording() };
    let event = Event { t_ns: 0, x: 0, y: 0, polarity: Polarity::Off };
    let one_packet = written(&Recording { events: vec![event; 8000], ..empty.clone() }, Compression::None);
    let packet = &one_packet[written(&empty, Compression::None).len() + 8..];
    let first = packet.len() - packet.iter().rev().take_while(|&&byte| byte == 0).count();
    let block = |last: usize, kind: usize, bytes: usize| (last | kind << 1 | bytes << 3).to_le_bytes();
    let mut packed = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 7 << 3];
    packed.extend(&block(0, 0, first)[..3]);
    packed.extend(&packet[..first]);
    packed.extend(&block(1, 1, packet.len() - first)[..3]);
    packed.push(0);
    let file = |packets: usize| {
        let mut bytes = written(&empty, Compression::Zstd);
        for _ in 0..packets {
            bytes.extend(0_i32.to_le_bytes());
            bytes.extend((packed.len() as i32).to_le_bytes());
            bytes.extend(&packed);
        }
        bytes
    };
    assert_eq!(read(&file(2)).unwrap().events, vec![event; 2 * 8000]);
    let bomb = file(1500);
    let error = read(&bomb).unwrap_err().to_string();
    assert!(error.contains(&format!("events in a file of {} bytes", bomb.len())), "{error}");
}

/// One packet alone could fill the memory too, before its events are counted.
#[test]
fn a_packet_that_unpacks_to_far_more_than_it_has_is_an_error() {
    let empty = Recording { events: Vec::new(), frames: Vec::new(), ..recording() };
    let mut bytes = Vec::new();
    write(&mut bytes, &empty, &[], Compression::Zstd).unwrap();
    // Blocks of 128 KiB that repeat a zero (RFC 8878), the largest that there are.
    let block = |last: u32| (last | 1 << 1 | 0x2_0000 << 3).to_le_bytes();
    let mut packed = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 7 << 3];
    for last in [0; 1000].into_iter().chain([1]) {
        packed.extend(&block(last)[..3]);
        packed.push(0);
    }
    bytes.extend(0_i32.to_le_bytes());
    bytes.extend((packed.len() as i32).to_le_bytes());
    bytes.extend(&packed);
    let error = read(&bytes).unwrap_err().to_string();
    assert!(error.contains(&format!("{} bytes that unpack to more than", packed.len())), "{error}");
}

#[test]
fn events_alone_are_read_whatever_the_frames_are() {
    let recording = recording();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.aedat4");
    let mut bytes = file(&recording, Compression::None);
    // The length of a frame's pixels lies before the first of them.
    let mut other = recording.clone();
    other.frames[0].pixels[0] = 1.0;
    let differs = bytes.iter().zip(&file(&other, Compression::None)).position(|(a, b)| a != b).unwrap();
    let length_at = differs - 4;
    assert_eq!(bytes[length_at..differs], (37_u32 * 23).to_le_bytes(), "the number of the frame's pixels");
    bytes[length_at] -= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert!(aedat4::read(&path).unwrap_err().to_string().contains("a frame of 850 bytes, expected 851"));
    let expected = Recording { frames: Vec::new(), ..recording };
    assert_eq!(aedat4::read_events(&path).unwrap(), expected);
}

#[test]
fn events_of_the_same_time_stay_in_the_order_of_the_file() {
    let event = |t_ns, x| Event { t_ns, x, y: 0, polarity: Polarity::On };
    let unordered = vec![event(5000, 9), event(5000, 2), event(2000, 7), event(5000, 4)];
    let read = read(&file(&Recording { events: unordered, ..recording() }, Compression::None)).unwrap();
    assert_eq!(read.events, [event(2000, 7), event(5000, 9), event(5000, 2), event(5000, 4)]);
}

#[test]
fn what_is_written_is_read_back_in_every_compression() {
    let recording = recording();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let bytes = file(&recording, compression);
        assert_eq!(read(&bytes).unwrap(), recording, "{compression:?}");
    }
    let packed = [Compression::Lz4, Compression::Zstd].map(|c| file(&recording, c).len());
    let plain = file(&recording, Compression::None).len();
    assert!(packed.iter().all(|packed| *packed < plain), "{packed:?} bytes packed, {plain} plain");
}

#[test]
fn a_recording_of_nothing_is_read_back() {
    let recording = Recording { events: Vec::new(), frames: Vec::new(), ..recording() };
    assert_eq!(read(&file(&recording, Compression::None)).unwrap(), recording);
}

#[test]
fn what_the_format_cannot_hold_is_refused() {
    let refusal = |change: fn(&mut Recording)| {
        let mut recording = recording();
        change(&mut recording);
        write(&mut Vec::new(), &recording, &[], Compression::None).unwrap_err().to_string()
    };
    assert!(refusal(|r| r.events[0].t_ns = 1).contains("1 ns, expected whole microseconds"));
    assert!(refusal(|r| r.frames[0].end_ns = 999).contains("999 ns, expected whole microseconds"));
    assert!(refusal(|r| r.width_px = 40_000).contains("40000 px, expected at most 32767"));
    assert!(refusal(|r| r.frames[1].pixels.truncate(5)).contains("a frame of 5 px, expected 851"));
}

/// As `file`, with these words of its header exchanged for others of the same length.
fn with_header(recording: &Recording, from: &str, to: &str) -> Vec<u8> {
    let mut bytes = file(recording, Compression::None);
    let at: Vec<usize> =
        (0..bytes.len() - from.len()).filter(|&at| bytes[at..].starts_with(from.as_bytes())).collect();
    assert!(!at.is_empty() && from.len() == to.len(), "{from}");
    for at in at {
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    }
    bytes
}

#[test]
fn cameras_of_one_file_are_not_mixed() {
    let recording = recording();
    let error = |from, to| read(&with_header(&recording, from, to)).unwrap_err().to_string();
    let two = error(">IMUS<", ">EVTS<");
    let named = "2 streams of events, expected one: 0 (`events` of `DAVIS <&> \"1\"`), 2 (`imu` of `DAVIS";
    assert!(two.contains(named), "{two}");
    let two = error(">IMUS<", ">FRME<");
    assert!(two.contains("2 streams of frames, expected one: 1 (`frames` of `DAVIS"), "{two}");
    // The stream of frames is another camera's.
    let (frames, imu) = ("<node name=\"1\"", "<node name=\"2\"");
    let bytes = file(&recording, Compression::None);
    let place = |text: &str| bytes.windows(text.len()).position(|w| w == text.as_bytes()).unwrap();
    let mut other = bytes.clone();
    let source = b"DAVIS";
    let of_frames = place(frames)..place(imu);
    let at = of_frames.start + bytes[of_frames].windows(5).position(|window| window == source).unwrap();
    other[at..at + 5].copy_from_slice(b"OTHER");
    assert_eq!(read(&other).unwrap(), Recording { frames: Vec::new(), ..recording.clone() });
}

#[test]
fn streams_without_packets_are_not_declared() {
    let declares = |recording: &Recording, kind: &str| {
        let mut bytes = Vec::new();
        write(&mut bytes, recording, &[], Compression::None).unwrap();
        bytes.windows(kind.len()).any(|window| window == kind.as_bytes())
    };
    let events = Recording { frames: Vec::new(), ..recording() };
    assert!(declares(&events, ">EVTS<") && !declares(&events, ">FRME<") && !declares(&events, ">IMUS<"));
    assert!(declares(&recording(), ">FRME<"));
}

#[test]
fn broken_files_are_errors_with_a_reason() {
    let good = file(&recording(), Compression::Lz4);
    let error = |bytes: &[u8]| read(bytes).expect_err("a broken file").to_string();
    assert!(error(b"#!AER-DAT2.0\r\n").contains("not an AEDAT 4 file"));
    assert!(error(&good[..20]).contains("header ends beyond the file"));
    assert!(error(&good[..good.len() - 1]).contains("ends beyond the file"));
    // The position where packets end: -1, as nothing follows them.
    let position_at = good.windows(8).position(|bytes| bytes == [0xff; 8]).unwrap();
    let mut short = good.clone();
    short[position_at..position_at + 8].copy_from_slice(&(good.len() as i64 + 1).to_le_bytes());
    assert!(error(&short).contains(&format!("packets end at byte {}", good.len() + 1)));
    let header_bytes = u32::from_le_bytes(good[14..18].try_into().unwrap()) as usize;
    let packets = 18 + header_bytes;
    let mut scrambled = good.clone();
    scrambled[packets + 8..packets + 100].fill(0x5a);
    assert!(error(&scrambled).contains(&format!("packet at byte {packets}")));
    let missing = aedat4::read(Path::new("/nonesuch.aedat4")).unwrap_err();
    assert!(missing.to_string().contains("/nonesuch.aedat4"), "{missing}");
}

#[test]
fn events_and_frames_of_another_size_are_errors() {
    let error = |change: fn(&mut Recording)| {
        let mut recording = recording();
        change(&mut recording);
        read(&file(&recording, Compression::None)).unwrap_err().to_string()
    };
    assert!(error(|r| r.events[9_999].x = 37).contains("an event at (37, "));
    assert!(error(|r| r.events[9_999].y = 23).contains("23) on a sensor of 37x23 px"));
}

#[test]
fn no_broken_file_is_read_beyond_its_end() {
    let mut small = recording();
    small.events.truncate(3);
    small.frames.truncate(1);
    let good = file(&small, Compression::None);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.aedat4");
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        aedat4::read(&path)
    };
    for at in (0..good.len()).step_by(7) {
        for value in [0x7f, 0xff] {
            let mut bad = good.clone();
            bad[at] = value;
            if let Ok(recording) = read(&bad) {
                assert!(recording.events.iter().all(|e| u32::from(e.x) < recording.width_px));
            }
        }
    }
}
