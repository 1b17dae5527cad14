//! Every message read back by a second reader of CDR that knows nothing but the `.msg` definitions.

use esaac_model::evt3::Decoder;
use esaac_model::packet::{Event, Polarity};
use esaac_model::paths::{Intrinsics, LensError};
use esaac_model::{Intensity, PARAMETERS, Packet, SensorModel, Timestamps};
use esaac_ros::MessageType;
use esaac_ros::cdr::CdrWriter;
use esaac_ros::definition::{Base, Extent, Field, parse};
use esaac_ros::encode::{
    self, Header, Image, Imu, Status, camera_info, clock, diagnostics, image, imu, optical_frames,
    sensor_model,
};
use esaac_ros::events::{self, EventFormat, PacketHead};
use esaac_ros::labels::{self, Instance};
use std::collections::BTreeMap;
use std::path::Path;

/// A field's value.
#[derive(Clone, Debug, PartialEq)]
enum Value {
    Whole(i128),
    Real(f64),
    Text(String),
    List(Vec<Value>),
    Message(BTreeMap<String, Value>),
}

impl Value {
    /// The value at a path such as `header.stamp.sec` or `events.3.x`.
    #[track_caller]
    fn at(&self, path: &str) -> &Value {
        path.split('.').fold(self, |value, part| match value {
            Value::Message(fields) => fields.get(part).unwrap_or_else(|| panic!("no field {part} of {path}")),
            Value::List(list) => &list[part.parse::<usize>().expect("an index")],
            other => panic!("{path} leads through {other:?}"),
        })
    }

    #[track_caller]
    fn whole(&self, path: &str) -> i128 {
        let Value::Whole(number) = self.at(path) else { panic!("{path} is no whole number") };
        *number
    }

    #[track_caller]
    fn text(&self, path: &str) -> &str {
        let Value::Text(text) = self.at(path) else { panic!("{path} is no text") };
        text
    }

    #[track_caller]
    fn wholes(&self, path: &str) -> Vec<i128> {
        self.list(path).iter().map(|value| value.whole_itself()).collect()
    }

    #[track_caller]
    fn reals(&self, path: &str) -> Vec<f64> {
        let real = |value: &Value| match value {
            Value::Real(number) => *number,
            other => panic!("{other:?} in {path}"),
        };
        self.list(path).iter().map(real).collect()
    }

    #[track_caller]
    fn list(&self, path: &str) -> &[Value] {
        let Value::List(list) = self.at(path) else { panic!("{path} is no list") };
        list
    }

    #[track_caller]
    fn whole_itself(&self) -> i128 {
        let Value::Whole(number) = self else { panic!("{self:?} is no whole number") };
        *number
    }
}

/// Reads fields one after the other; each is aligned to its size, counted from behind the header.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let taken = self.bytes.get(self.at..self.at + count);
        let taken = taken.ok_or_else(|| format!("{} bytes, expected {count} more", self.bytes.len()))?;
        self.at += count;
        Ok(taken)
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let padding = self.take((N - self.at % N) % N)?;
        if padding.iter().any(|&byte| byte != 0) {
            return Err(format!("padding {padding:?}, expected zeros"));
        }
        Ok(self.take(N)?.try_into().expect("as many as asked for"))
    }

    fn primitive(&mut self, kind: &str) -> Result<Value, String> {
        Ok(match kind {
            "bool" | "byte" | "char" | "uint8" => Value::Whole(self.number::<1>()?[0].into()),
            "uint16" => Value::Whole(u16::from_le_bytes(self.number()?).into()),
            "uint32" => Value::Whole(u32::from_le_bytes(self.number()?).into()),
            "int32" => Value::Whole(i32::from_le_bytes(self.number()?).into()),
            "uint64" => Value::Whole(u64::from_le_bytes(self.number()?).into()),
            "int64" => Value::Whole(i64::from_le_bytes(self.number()?).into()),
            "float64" => Value::Real(f64::from_le_bytes(self.number()?)),
            other => return Err(format!("no reader for {other}")),
        })
    }

    fn text(&mut self) -> Result<Value, String> {
        let bytes = u32::from_le_bytes(self.number()?) as usize;
        let (zero, text) = self.take(bytes)?.split_last().ok_or("a string without its zero")?;
        if *zero != 0 || text.contains(&0) {
            return Err(format!("{text:?} and {zero}, expected one zero at the end"));
        }
        String::from_utf8(text.to_vec()).map(Value::Text).map_err(|e| e.to_string())
    }

    fn one(&mut self, base: &Base) -> Result<Value, String> {
        match base {
            Base::Primitive(kind) => self.primitive(kind),
            Base::String(_) => self.text(),
            Base::WString(_) => Err("no reader for wide strings".to_owned()),
            Base::Message(name) => self.message(name),
        }
    }

    fn field(&mut self, field: &Field) -> Result<Value, String> {
        let count = match field.extent {
            Extent::One => return self.one(&field.base),
            Extent::Array(count) => count as usize,
            Extent::Sequence | Extent::Bounded(_) => u32::from_le_bytes(self.number()?) as usize,
        };
        (0..count).map(|_| self.one(&field.base)).collect::<Result<_, _>>().map(Value::List)
    }

    fn message(&mut self, name: &str) -> Result<Value, String> {
        let mut values = BTreeMap::new();
        for field in definition(name) {
            let value = self.field(&field).map_err(|e| format!("{name}.{}: {e}", field.name))?;
            values.insert(field.name, value);
        }
        Ok(Value::Message(values))
    }
}

/// Fields of `pkg/msg/Name`, from its file.
fn definition(name: &str) -> Vec<Field> {
    let package = if name.starts_with("esaac_msgs/") { "" } else { "definitions" };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(package).join(format!("{name}.msg"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    parse(name, &text).expect("a definition")
}

fn read(message: MessageType, bytes: &[u8]) -> Result<Value, String> {
    let (header, body) = bytes.split_at_checked(4).ok_or("no header")?;
    if header != [0, 1, 0, 0] {
        return Err(format!("header {header:?}, expected plain little-endian CDR"));
    }
    let mut reader = Reader { bytes: body, at: 0 };
    let value = reader.message(message.name())?;
    if reader.at != body.len() {
        return Err(format!("{} bytes are left", body.len() - reader.at));
    }
    Ok(value)
}

#[track_caller]
fn decoded(message: MessageType, bytes: &[u8]) -> Value {
    read(message, bytes).unwrap_or_else(|error| panic!("{error}: {bytes:?}"))
}

/// Names of frames whose lengths leave the next field at every place in a word.
const FRAME_IDS: [&str; 9] = ["", "c", "ca", "cam", "cam_", "cam_0", "cam_0o", "cam_0op", "cam_0opt"];

/// A time before zero: seconds round down, nanoseconds are never negative.
const STAMP_NS: i64 = -1_499_999_993;

fn header(frame_id: &str) -> Header<'_> {
    Header { stamp_ns: STAMP_NS, frame_id }
}

#[track_caller]
fn check_header(message: &Value, path: &str, frame_id: &str) {
    assert_eq!(message.whole(&format!("{path}.stamp.sec")), -2);
    assert_eq!(message.whole(&format!("{path}.stamp.nanosec")), 500_000_007);
    assert_eq!(message.text(&format!("{path}.frame_id")), frame_id);
}

#[test]
fn images() {
    for frame_id in FRAME_IDS {
        let pixels: Vec<u8> = (0..5 * 3 * 2).map(|i| 255 - i).collect();
        let described = Image { width_px: 5, height_px: 3, encoding: "mono16", pixel_bytes: 2 };
        let mut out = vec![1; 99];
        image(&mut out, header(frame_id), described, |out| out.extend_from_slice(&pixels));
        let got = decoded(MessageType::Image, &out);
        check_header(&got, "header", frame_id);
        assert_eq!((got.whole("width"), got.whole("height"), got.whole("step")), (5, 3, 10));
        assert_eq!((got.text("encoding"), got.whole("is_bigendian")), ("mono16", 0));
        assert_eq!(got.wholes("data"), pixels.iter().map(|&p| i128::from(p)).collect::<Vec<_>>());
    }
}

#[test]
fn camera_infos() {
    type Lens = fn(f64, f64, f64, f64) -> Result<Intrinsics, LensError>;
    let known = |lens: Lens| Some(lens(201.5, 202.5, 172.25, 129.75).unwrap());
    for frame_id in FRAME_IDS {
        for (lens, model, distortion) in [
            (known(Intrinsics::pinhole), "plumb_bob", &[0.0; 5][..]),
            (known(Intrinsics::fisheye), "equidistant", &[0.0; 4]),
            (None, "plumb_bob", &[0.0; 5]),
        ] {
            let mut out = Vec::new();
            camera_info(&mut out, header(frame_id), (346, 260), lens);
            let got = decoded(MessageType::CameraInfo, &out);
            check_header(&got, "header", frame_id);
            assert_eq!((got.whole("width"), got.whole("height")), (346, 260));
            assert_eq!((got.text("distortion_model"), &got.reals("d")[..]), (model, distortion));
            assert_eq!(got.reals("r"), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
            let (k, p) = if lens.is_some() {
                (
                    [201.5, 0.0, 172.25, 0.0, 202.5, 129.75, 0.0, 0.0, 1.0],
                    [201.5, 0.0, 172.25, 0.0, 0.0, 202.5, 129.75, 0.0, 0.0, 0.0, 1.0, 0.0],
                )
            } else {
                ([0.0; 9], [0.0; 12])
            };
            assert_eq!((got.reals("k"), got.reals("p")), (k.to_vec(), p.to_vec()));
            for field in ["binning_x", "binning_y", "roi.x_offset", "roi.y_offset", "roi.height", "roi.width"]
            {
                assert_eq!(got.whole(field), 0, "{field}");
            }
            assert_eq!(got.whole("roi.do_rectify"), 0);
        }
    }
}

#[test]
fn inertial_samples() {
    let sample =
        Imu { t_ns: STAMP_NS, angular_rate_rad_s: [0.1, -0.2, 0.3], specific_force_m_s2: [1.5, -2.5, 9.81] };
    for frame_id in FRAME_IDS {
        let mut out = Vec::new();
        imu(&mut out, frame_id, &sample);
        let got = decoded(MessageType::Imu, &out);
        check_header(&got, "header", frame_id);
        for (vector, expected) in [
            ("angular_velocity", sample.angular_rate_rad_s),
            ("linear_acceleration", sample.specific_force_m_s2),
            ("orientation", [0.0; 3]),
        ] {
            let actual = ["x", "y", "z"].map(|axis| got.at(&format!("{vector}.{axis}")).clone());
            assert_eq!(actual, expected.map(Value::Real), "{vector}");
        }
        assert_eq!(got.at("orientation.w"), &Value::Real(1.0));
        // REP 145: no orientation is known.
        let mut absent = vec![0.0; 9];
        absent[0] = -1.0;
        assert_eq!(got.reals("orientation_covariance"), absent);
        assert_eq!(got.reals("angular_velocity_covariance"), [0.0; 9]);
        assert_eq!(got.reals("linear_acceleration_covariance"), [0.0; 9]);
    }
}

#[test]
fn clocks_up_to_the_ends_of_their_range() {
    for (t_ns, seconds, nanoseconds) in [
        (0, 0, 0),
        (999_999_999, 0, 999_999_999),
        (1_000_000_000, 1, 0),
        (STAMP_NS, -2, 500_000_007),
        (i64::MIN, i32::MIN.into(), 145_224_192),
    ] {
        let mut out = Vec::new();
        clock(&mut out, t_ns);
        let got = decoded(MessageType::Clock, &out);
        assert_eq!((got.whole("clock.sec"), got.whole("clock.nanosec")), (seconds, nanoseconds), "{t_ns}");
    }
}

#[test]
fn optical_frames_turn_the_body_as_rep_103_has_it() {
    let mut out = Vec::new();
    optical_frames(&mut out, STAMP_NS, &[("left", "left_optical"), ("r", "r_optical_frame")]);
    let got = decoded(MessageType::Transforms, &out);
    assert_eq!(got.list("transforms").len(), 2);
    for (transform, (body, optical)) in
        got.list("transforms").iter().zip([("left", "left_optical"), ("r", "r_optical_frame")])
    {
        check_header(transform, "header", body);
        assert_eq!(transform.text("child_frame_id"), optical);
        for axis in ["x", "y", "z"] {
            assert_eq!(transform.at(&format!("transform.translation.{axis}")), &Value::Real(0.0));
        }
        let [x, y, z, w] = ["x", "y", "z", "w"].map(|part| {
            let Value::Real(part) = transform.at(&format!("transform.rotation.{part}")) else { panic!() };
            *part
        });
        // The optical frame's axes in the body frame: x to the right, y down, z forward.
        let turned = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
            [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
            [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        assert_eq!(turned, [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]);
    }
}

#[test]
fn every_parameter_of_a_sensor() {
    // No two numbers alike.
    let sensor = SensorModel {
        name: "prophesee".to_owned(),
        contrast_on: 0.21,
        contrast_off: 0.22,
        contrast_mismatch: 0.023,
        refractory_ns: 31,
        leak_rate_hz: 0.32,
        leak_spread_log: 0.33,
        shot_noise_rate_hz: 3.4,
        white_level: 3.5,
        latency_ns: 36,
        latency_jitter_ns: 37,
        timestamp_quantum_ns: 38,
        exposure_gain: 3.9,
        log_offset: 0.041,
        intensity: Intensity::BayerRggb,
        timestamps: Timestamps::AtSample,
        max_events_per_interval: 42,
        aps_exposure_ns: 43,
        aps_start_ns: 44,
        aps_gain: 4.5,
        aps_bits: 12,
        seed: 0x1234_5678_9abc_def0,
        ..SensorModel::default()
    };
    let table: serde_json::Value = serde_json::to_value(&sensor).expect("plain data");
    let mut out = Vec::new();
    sensor_model(&mut out, header("cam"), &sensor);
    let got = decoded(MessageType::SensorModel, &out);
    check_header(&got, "header", "cam");
    for parameter in PARAMETERS {
        let expected = match &table[parameter.name] {
            serde_json::Value::String(text) => Value::Text(text.clone()),
            number if number.is_u64() => Value::Whole(number.as_u64().expect("whole").into()),
            number => Value::Real(number.as_f64().expect("a number")),
        };
        assert_eq!(got.at(parameter.name), &expected, "{}", parameter.name);
    }
}

#[test]
fn diagnostics_of_several_cameras() {
    let status = |warn, name: &str, values: &[(&str, &str)]| Status {
        warn,
        name: name.to_owned(),
        message: format!("{name} says"),
        values: values.iter().map(|&(key, value)| (key.to_owned(), value.to_owned())).collect(),
    };
    let statuses = [
        status(false, "left", &[("events", "12"), ("late", "")]),
        status(true, "r", &[]),
        status(false, "", &[]),
    ];
    let mut out = Vec::new();
    diagnostics(&mut out, STAMP_NS, "gpu", &statuses);
    let got = decoded(MessageType::DiagnosticArray, &out);
    check_header(&got, "header", "");
    assert_eq!(got.list("status").len(), statuses.len());
    for (actual, expected) in got.list("status").iter().zip(&statuses) {
        // OK is 0 and WARN is 1.
        assert_eq!(actual.whole("level"), i128::from(expected.warn));
        assert_eq!((actual.text("name"), actual.text("message")), (&*expected.name, &*expected.message));
        assert_eq!(actual.text("hardware_id"), "gpu");
        let values: Vec<(&str, &str)> =
            actual.list("values").iter().map(|value| (value.text("key"), value.text("value"))).collect();
        let expected: Vec<(&str, &str)> =
            expected.values.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
        assert_eq!(values, expected);
    }
}

/// Events of every polarity, corner and kind of step in time: the same instant, a microsecond's end, 4096
/// microseconds, and the turn of 24 bits of microseconds.
fn packet() -> Packet {
    const BASE_NS: i64 = 16_777_000_000;
    let mut packet = Packet {
        sequence: 3,
        width_px: 2048,
        height_px: 2048,
        base_ns: BASE_NS,
        watermark_ns: BASE_NS + 1_000_000,
        dropped: 17,
        ..Packet::default()
    };
    let mut push = |t_ns: i64, y: u16, x: u16, polarity| packet.push(Event { t_ns, y, x, polarity });
    push(BASE_NS, 0, 0, Polarity::Off);
    push(BASE_NS, 0, 0, Polarity::On);
    push(BASE_NS, 0, 2047, Polarity::On);
    push(BASE_NS, 2047, 1, Polarity::Off);
    push(BASE_NS + 999, 2047, 2047, Polarity::On);
    push(BASE_NS + 1000, 2047, 2046, Polarity::Off);
    push(BASE_NS + 215_999, 5, 7, Polarity::On);
    push(BASE_NS + 216_000, 5, 7, Polarity::Off);
    push(BASE_NS + 4_096_000, 1024, 1023, Polarity::On);
    push(BASE_NS + 8_192_000, 1024, 1023, Polarity::On);
    packet
}

const HEAD: PacketHead<'_> = PacketHead {
    header: Header { stamp_ns: STAMP_NS, frame_id: "cam" },
    sequence: 41,
    sensor_name: "davis346",
};

fn encoded(format: EventFormat, packet: &Packet) -> Value {
    let mut out = Vec::new();
    events::encode(&mut out, format, &HEAD, &packet.view());
    let got = decoded(format.message(), &out);
    check_header(&got, "header", "cam");
    assert_eq!((got.whole("height"), got.whole("width")), (2048, 2048));
    got
}

#[test]
fn packed_and_plain_packets() {
    for packet in [packet(), Packet { base_ns: -5, watermark_ns: -3, ..empty() }] {
        let packed = encoded(EventFormat::Packed, &packet);
        let plain = encoded(EventFormat::Plain, &packet);
        for message in [&packed, &plain] {
            assert_eq!(message.whole("sequence"), 41);
            assert_eq!(message.whole("base_ns"), packet.base_ns.into());
            assert_eq!(message.whole("watermark_ns"), packet.watermark_ns.into());
            assert_eq!(message.text("sensor_name"), "davis346");
            assert_eq!(message.whole("dropped"), packet.dropped.into());
        }
        assert_eq!(packed.wholes("x"), packet.x.iter().map(|&v| v.into()).collect::<Vec<i128>>());
        assert_eq!(packed.wholes("y"), packet.y.iter().map(|&v| v.into()).collect::<Vec<i128>>());
        assert_eq!(
            packed.wholes("t_offset_ns"),
            packet.t_offset_ns.iter().map(|&v| v.into()).collect::<Vec<i128>>()
        );
        assert_eq!(
            packed.wholes("polarity"),
            packet.polarity.iter().map(|&v| v.into()).collect::<Vec<i128>>()
        );
        let events = plain.list("events");
        assert_eq!(events.len(), packet.len());
        for (actual, event) in events.iter().zip(packet.iter()) {
            let fields = ["t_ns", "x", "y", "polarity"].map(|field| actual.whole(field));
            let polarity = i128::from(event.polarity == Polarity::On);
            assert_eq!(fields, [event.t_ns.into(), event.x.into(), event.y.into(), polarity]);
        }
    }
}

#[test]
fn ids_of_events_and_what_they_are() {
    let ids = [-1, 0, i64::MAX, i64::MIN, 4_000_000_000];
    let labels = [("class".to_owned(), "box".to_owned()), (String::new(), "wide".to_owned())];
    for frame_id in FRAME_IDS {
        for count in [0, 1, 5] {
            let mut out = vec![1; 99];
            labels::event_ids(&mut out, header(frame_id), 41, &ids[..count]);
            let got = decoded(MessageType::EventIds, &out);
            check_header(&got, "header", frame_id);
            assert_eq!(got.whole("sequence"), 41);
            assert_eq!(got.wholes("ids"), ids[..count].iter().map(|&id| id.into()).collect::<Vec<i128>>());
        }
        let instance =
            |id: i64, labels: &[_]| Instance { id, name: frame_id.to_owned(), labels: labels.to_vec() };
        let table = [instance(-1, &[]), instance(7, &labels), instance(1 << 40, &labels[..1])];
        let mut out = Vec::new();
        labels::instances(&mut out, header(frame_id), &table);
        let got = decoded(MessageType::Instances, &out);
        check_header(&got, "header", frame_id);
        assert_eq!(got.list("instances").len(), table.len());
        for (actual, expected) in got.list("instances").iter().zip(&table) {
            assert_eq!((actual.whole("id"), actual.text("name")), (expected.id.into(), frame_id));
            let texts = |field: &str| actual.list(field).to_vec();
            let (kinds, labels): (Vec<_>, Vec<_>) =
                expected.labels.iter().cloned().map(|(k, l)| (Value::Text(k), Value::Text(l))).unzip();
            assert_eq!((texts("kinds"), texts("labels")), (kinds, labels));
        }
    }
}

fn empty() -> Packet {
    Packet {
        width_px: 2048,
        height_px: 2048,
        base_ns: 4_097_000,
        watermark_ns: 8_195_000,
        ..Packet::default()
    }
}

fn bytes_of(message: &Value) -> Vec<u8> {
    message.wholes("events").into_iter().map(|byte| byte as u8).collect()
}

#[test]
fn mono_packets() {
    let packet = packet();
    let got = encoded(EventFormat::Mono, &packet);
    assert_eq!((got.whole("seq"), got.whole("time_base")), (41, packet.base_ns.into()));
    assert_eq!((got.text("encoding"), got.whole("is_bigendian")), ("mono", 0));
    let words: Vec<u64> =
        bytes_of(&got).chunks(8).map(|word| u64::from_le_bytes(word.try_into().expect("eight"))).collect();
    assert_eq!(words.len(), packet.len());
    for (word, event) in words.iter().zip(packet.iter()) {
        assert_eq!(i64::from(*word as u32) + packet.base_ns, event.t_ns);
        assert_eq!(((word >> 32) as u16, (word >> 48) as u16 & 0x7fff), (event.x, event.y));
        assert_eq!(word >> 63 == 1, event.polarity == Polarity::On);
    }
}

/// The events of EVT3 words, and the time at their end in microseconds.
fn read_evt3(bytes: &[u8]) -> (Vec<Event>, Option<i64>) {
    let (mut decoder, mut events) = (Decoder::new([2048; 2]), Vec::new());
    decoder.decode(bytes, &mut events).expect("whole words");
    (events, decoder.time_us())
}

#[test]
fn evt3_packets() {
    const TURN: i64 = 1 << 24;
    let packet = packet();
    let before_zero = Packet { base_ns: -1_500, ..packet.clone() };
    for packet in [&before_zero, &packet] {
        let got = encoded(EventFormat::Evt3, packet);
        assert_eq!((got.whole("seq"), got.whole("time_base")), (41, 0));
        assert_eq!((got.text("encoding"), got.whole("is_bigendian")), ("evt3", 0));
        // A message tells 24 bits of its first time, and goes on from there.
        let first_us = packet.base_ns.div_euclid(1000);
        let untold_us = first_us - first_us.rem_euclid(TURN);
        let told_ns = |t_ns: i64| (t_ns.div_euclid(1000) - untold_us) * 1000;
        let expected: Vec<_> = packet.iter().map(|e| Event { t_ns: told_ns(e.t_ns), ..e }).collect();
        assert_eq!(read_evt3(&bytes_of(&got)).0, expected);
    }
    let bytes = bytes_of(&encoded(EventFormat::Evt3, &packet));
    // What has not changed is not said again, but the low half of a time follows each high one.
    let kinds = |kind: u8| bytes.chunks(2).filter(|word| word[1] >> 4 == kind).count();
    assert_eq!([kinds(0x8), kinds(0x6), kinds(0x0), kinds(0x2)], [3, 6, 4, 10]);
    // Without events the time goes on.
    let nothing = empty();
    let got = encoded(EventFormat::Evt3, &nothing);
    assert_eq!(read_evt3(&bytes_of(&got)), (vec![], Some(8_195)));
}

#[test]
fn bytes_that_are_wrong_are_found() {
    let mut out = Vec::new();
    events::encode(&mut out, EventFormat::Plain, &HEAD, &packet().view());
    assert!(read(MessageType::EventPacket, &out).is_ok());
    assert!(read(MessageType::EventPacket, &out[..out.len() - 1]).is_err());
    assert!(read(MessageType::EventPacket, &[&out[..], &[0]].concat()).is_err());
    assert!(read(MessageType::Imu, &out).is_err());
    let mut other = out.clone();
    other[1] = 0;
    assert!(read(MessageType::EventPacket, &other).is_err(), "big endian");
}

#[test]
fn an_empty_sequence_is_a_length_and_no_padding() {
    let mut out = Vec::new();
    CdrWriter::new(&mut out).sequence::<f64>(&[]).u8(7);
    assert_eq!(out, [0, 1, 0, 0, 0, 0, 0, 0, 7]);
}

#[test]
fn a_text_ends_at_its_first_zero() {
    let mut out = Vec::new();
    encode::imu(&mut out, "cam\0era", &Imu::default());
    assert_eq!(decoded(MessageType::Imu, &out).text("header.frame_id"), "cam");
}
