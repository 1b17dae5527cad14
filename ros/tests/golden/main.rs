//! Every message, byte for byte, as an independent library encodes it. `generate.py` says how the bytes of
//! `messages.txt` were made; the test `golden` of the binary `ros` makes them again.

use esaac_model::packet::Event;
use esaac_model::paths::Intrinsics;
use esaac_model::{PARAMETERS, Packet, Polarity, SensorModel};
use esaac_ros::EventFormat;
use esaac_ros::encode::{self, Header, Image, Imu, Status};
use esaac_ros::events::{self, PacketHead};
use esaac_ros::labels::{self, Instance};

const STAMP_NS: i64 = 12_345_678_901;

/// A message of `messages.txt`.
fn golden(name: &str) -> Vec<u8> {
    let line = |line: &'static str| line.strip_prefix(name)?.strip_prefix(": ");
    let hex = include_str!("messages.txt").lines().find_map(line).unwrap_or_else(|| panic!("no {name}"));
    assert_eq!(hex.len() % 2, 0, "{name}");
    hex.as_bytes()
        .chunks(2)
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect()
}

/// Compares `encode`'s bytes, written over what another message left in the buffer.
fn check(name: &str, encode: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = vec![0xee; 5];
    encode(&mut bytes);
    assert_eq!(bytes, golden(name), "{name}");
}

fn header(frame_id: &str) -> Header<'_> {
    Header { stamp_ns: STAMP_NS, frame_id }
}

#[test]
fn the_clock_is_as_golden() {
    check("clock", |out| encode::clock(out, 1_000_000_002));
}

#[test]
fn images_are_as_golden() {
    let fill = |count: u8| move |out: &mut Vec<u8>| out.extend(1..=count);
    let rgb = Image { width_px: 3, height_px: 2, encoding: "rgb8", pixel_bytes: 3 };
    check("image rgb8", |out| encode::image(out, header("abc"), rgb, fill(18)));
    let depth = Image { width_px: 2, height_px: 1, encoding: "32FC1", pixel_bytes: 4 };
    check("image 32FC1", |out| encode::image(out, header("ab"), depth, fill(8)));
}

#[test]
fn camera_infos_are_as_golden() {
    let known = Intrinsics::pinhole(300.0, 301.0, 15.5, 11.5).unwrap();
    let info = |out: &mut Vec<u8>, known| encode::camera_info(out, header("abc"), (32, 24), known);
    check("camera_info", |out| info(out, Some(known)));
    check("camera_info uncalibrated", |out| info(out, None));
}

#[test]
fn an_imu_sample_is_as_golden() {
    // A nanosecond before zero: seconds round down.
    let sample =
        Imu { t_ns: -1, angular_rate_rad_s: [0.1, -0.2, 0.3], specific_force_m_s2: [1.5, -2.5, 9.81] };
    check("imu", |out| encode::imu(out, "body", &sample));
}

#[test]
fn frames_are_as_golden() {
    check("transforms 0", |out| encode::optical_frames(out, STAMP_NS, &[]));
    let frames = [("left_link", "left_optical_frame"), ("b", "a")];
    check("transforms 2", |out| encode::optical_frames(out, STAMP_NS, &frames));
}

#[test]
fn diagnostics_are_as_golden() {
    let text = str::to_owned;
    let statuses = [
        Status {
            warn: true,
            name: text("node: a"),
            message: text("2 lost"),
            values: vec![(text("sent"), text("7")), (text("dropped"), text("22"))],
        },
        Status { warn: false, name: String::new(), message: text("good"), values: Vec::new() },
    ];
    check("diagnostics", |out| encode::diagnostics(out, STAMP_NS, "esaac", &statuses));
}

#[test]
fn a_sensor_with_a_different_value_in_every_field_is_as_golden() {
    // `generate.py` gives a field its value by the same rule.
    let mut fields = serde_json::to_value(SensorModel::default()).unwrap();
    for (place, parameter) in (1_u64..).zip(PARAMETERS) {
        let field = &mut fields[parameter.name];
        *field = match (parameter.name, &*field) {
            ("name", _) => "golden".into(),
            ("pixel", _) => "physical".into(),
            ("intensity", _) => "bayer_rggb".into(),
            ("synthesis", _) => "linear".into(),
            ("taps", _) => "bilinear".into(),
            ("substep_policy", _) => "fixed".into(),
            ("timestamps", _) => "at_sample".into(),
            ("readout", _) => "rows".into(),
            ("seed", _) => ((1 << 40) + place).into(),
            (_, value) if value.is_f64() => (place as f64 + 0.5).into(),
            _ => (1000 + place).into(),
        };
    }
    let sensor: SensorModel = serde_json::from_value(fields).unwrap();
    check("sensor_model", |out| encode::sensor_model(out, header("optical"), &sensor));
}

#[test]
fn ids_of_events_are_as_golden() {
    let ids = [-1, 0, 4_000_000_000];
    check("event_ids 0", |out| labels::event_ids(out, header("abc"), (1 << 33) + 5, &[]));
    check("event_ids 3", |out| labels::event_ids(out, header("abcdef"), (1 << 33) + 5, &ids));
}

#[test]
fn instances_are_as_golden() {
    let instance = |id: i64, name: &str, labels: &[(&str, &str)]| Instance {
        id,
        name: name.to_owned(),
        labels: labels.iter().map(|&(kind, label)| (kind.to_owned(), label.to_owned())).collect(),
    };
    let several = [
        instance(-5, "", &[]),
        instance(7, "/World/box", &[("class", "box"), ("class", "toy"), ("room", "")]),
        instance(1 << 40, "ab", &[("k", "v")]),
    ];
    check("instances 0", |out| labels::instances(out, header("abc"), &[]));
    check("instances 3", |out| labels::instances(out, header("abc"), &several));
}

/// The first `count` events of `generate.py`.
fn packet(count: usize) -> Packet {
    const BASE_NS: i64 = 8_192_000;
    let mut packet = Packet {
        width_px: 2048,
        height_px: 1999,
        base_ns: BASE_NS,
        watermark_ns: 41_525_333,
        dropped: 77,
        ..Packet::default()
    };
    let (on, off) = (Polarity::On, Polarity::Off);
    let events = [
        (3, 2, 1_000, on),
        (31, 2, 1_999, off),
        (0, 2, 2_000, on),
        (1500, 1998, 2_000, off),
        (2047, 1998, 4_098_000, on),
    ];
    for (x, y, t_ns, polarity) in events.into_iter().take(count) {
        packet.push(Event { t_ns: BASE_NS + t_ns, x, y, polarity });
    }
    packet
}

fn packets_are_as_golden(name: &str, format: EventFormat, frame_id: &str) {
    for count in [0, 1, 2, 5] {
        let head = PacketHead { header: header(frame_id), sequence: (1 << 33) + 5, sensor_name: "davis" };
        let packet = packet(count);
        check(&format!("{name} {count}"), |out| events::encode(out, format, &head, &packet.view()));
    }
}

#[test]
fn packed_packets_are_as_golden() {
    packets_are_as_golden("packed", EventFormat::Packed, "abc");
}

#[test]
fn plain_packets_are_as_golden() {
    packets_are_as_golden("plain", EventFormat::Plain, "abcdef");
}

#[test]
fn mono_packets_are_as_golden() {
    packets_are_as_golden("mono", EventFormat::Mono, "abcdef");
}

#[test]
fn evt3_packets_are_as_golden() {
    packets_are_as_golden("evt3", EventFormat::Evt3, "abc");
}

#[test]
fn every_golden_message_is_compared() {
    let text = include_str!("messages.txt");
    assert_eq!(text.lines().count(), 14 + 4 * 4, "add a test for the new message");
}
