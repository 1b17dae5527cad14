//! Encodes ROS messages, straight into the buffer that is sent and recorded.
//!
//! Axes and units follow REP 103, frames REP 105, depth images REP 118, IMUs REP 145.

use crate::cdr::CdrWriter;
use crate::definition::{self, Base};
use crate::message::{MessageType, texts};
use esaac_model::SensorModel;
use esaac_model::paths::{Intrinsics, Projection};

/// `std_msgs/Header`.
#[derive(Clone, Copy, Debug)]
pub struct Header<'a> {
    /// Time, nanoseconds.
    pub stamp_ns: i64,
    /// Frame.
    pub frame_id: &'a str,
}

const SECOND_NS: i64 = 1_000_000_000;

/// Whether a `builtin_interfaces/Time` holds a time: some 68 years before and after 0.
pub(crate) fn holds_time(t_ns: i64) -> bool {
    i32::try_from(t_ns.div_euclid(SECOND_NS)).is_ok()
}

/// Writes a `builtin_interfaces/Time`. Seconds round down, so nanoseconds are never negative. Seconds that do not fit stay
/// at their limit.
pub(crate) fn time(cdr: &mut CdrWriter<'_>, t_ns: i64) {
    let seconds = t_ns.div_euclid(SECOND_NS);
    let seconds = i32::try_from(seconds).unwrap_or(if seconds < 0 { i32::MIN } else { i32::MAX });
    cdr.i32(seconds).u32(t_ns.rem_euclid(SECOND_NS) as u32);
}

impl Header<'_> {
    pub(crate) fn write(&self, cdr: &mut CdrWriter<'_>) {
        time(cdr, self.stamp_ns);
        cdr.string(self.frame_id);
    }
}

/// Size and encoding of an image.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// ROS's name of the encoding: `rgb8`, `mono8`, `32FC1` ...
    pub encoding: &'a str,
    /// Bytes of a pixel.
    pub pixel_bytes: u32,
}

/// `sensor_msgs/Image`. `pixels` appends the rows, without padding between them.
pub fn image(out: &mut Vec<u8>, header: Header<'_>, image: Image<'_>, pixels: impl FnOnce(&mut Vec<u8>)) {
    let step = image.width_px * image.pixel_bytes;
    let mut cdr = CdrWriter::new(out);
    header.write(&mut cdr);
    cdr.u32(image.height_px).u32(image.width_px).string(image.encoding).u8(0).u32(step);
    cdr.reserve(step as usize * image.height_px as usize + 8).bytes_with(pixels);
}

/// `sensor_msgs/CameraInfo`. Without a lens K and P are zero, ROS's sign of an uncalibrated camera. A pinhole is ROS's
/// `plumb_bob` and an equidistant fisheye its `equidistant`, both without distortion.
pub fn camera_info(out: &mut Vec<u8>, header: Header<'_>, size_px: (u32, u32), lens: Option<Intrinsics>) {
    let (k, p) = match lens {
        None => ([0.0; 9], [0.0; 12]),
        Some(lens) => {
            let ([fx, fy], [cx, cy]) = (lens.focal_px().to_array(), lens.centre_px().to_array());
            (
                [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
                [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            )
        }
    };
    let (model, distortion) = match lens.map(|lens| lens.projection()) {
        None | Some(Projection::Pinhole) => ("plumb_bob", &[0.0_f64; 5][..]),
        Some(Projection::Fisheye) => ("equidistant", &[0.0; 4][..]),
    };
    let r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let mut cdr = CdrWriter::new(out);
    header.write(&mut cdr);
    cdr.u32(size_px.1).u32(size_px.0).string(model).sequence(distortion);
    // No binning; the region of interest is the whole image.
    cdr.f64s(&k).f64s(&r).f64s(&p).u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).bool(false);
}

/// An IMU sample in the body frame: x forward, y left, z up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Imu {
    /// Time, nanoseconds.
    pub t_ns: i64,
    /// Angular rate, rad/s.
    pub angular_rate_rad_s: [f64; 3],
    /// Specific force, m/s^2; at rest it is 9.81 upwards.
    pub specific_force_m_s2: [f64; 3],
}

/// `sensor_msgs/Imu`. A first covariance of -1 means that there is no orientation (REP 145). The other
/// covariances are zero, which means unknown.
pub fn imu(out: &mut Vec<u8>, frame_id: &str, sample: &Imu) {
    let mut cdr = CdrWriter::new(out);
    Header { stamp_ns: sample.t_ns, frame_id }.write(&mut cdr);
    let mut absent = [0.0; 9];
    absent[0] = -1.0;
    cdr.f64s(&[0.0, 0.0, 0.0, 1.0]).f64s(&absent);
    cdr.f64s(&sample.angular_rate_rad_s).f64s(&[0.0; 9]);
    cdr.f64s(&sample.specific_force_m_s2).f64s(&[0.0; 9]);
}

/// `rosgraph_msgs/Clock`.
pub fn clock(out: &mut Vec<u8>, t_ns: i64) {
    time(&mut CdrWriter::new(out), t_ns);
}

/// `tf2_msgs/TFMessage` with the rotation from each body frame (x forward, y left, z up) to its camera's
/// optical frame (z forward, x right, y down), as REP 103 defines them. Both frames have the same origin.
pub fn optical_frames(out: &mut Vec<u8>, stamp_ns: i64, frames: &[(&str, &str)]) {
    let mut cdr = CdrWriter::new(out);
    cdr.u32(frames.len() as u32);
    for (body, optical) in frames {
        Header { stamp_ns, frame_id: body }.write(&mut cdr);
        cdr.string(optical).f64s(&[0.0; 3]).f64s(&[-0.5, 0.5, -0.5, 0.5]);
    }
}

/// `esaac_msgs/SensorModel`: the sensor's parameters, in the order of the message's definition.
pub fn sensor_model(out: &mut Vec<u8>, header: Header<'_>, sensor: &SensorModel) {
    let name = MessageType::SensorModel.name();
    let fields = definition::parse(name, &texts()[name]).expect("the built-in definitions are complete");
    let values = serde_json::to_value(sensor).expect("a sensor is plain data");
    let mut cdr = CdrWriter::new(out);
    header.write(&mut cdr);
    for field in &fields[1..] {
        let value = &values[&field.name];
        match (&field.base, value) {
            (Base::String(_), serde_json::Value::String(text)) => drop(cdr.string(text)),
            (Base::Primitive("float64"), value) if value.is_f64() => {
                cdr.f64(value.as_f64().unwrap_or_default());
            }
            (Base::Primitive("uint32"), value) if value.is_u64() => {
                cdr.u32(value.as_u64().unwrap_or_default() as u32);
            }
            (Base::Primitive("uint64"), value) if value.is_u64() => {
                cdr.u64(value.as_u64().unwrap_or_default());
            }
            (base, value) => unreachable!("SensorModel.msg: `{}` is {base:?}, not {value}", field.name),
        }
    }
}

/// One `diagnostic_msgs/DiagnosticStatus`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Status {
    /// Whether the user should look into it.
    pub warn: bool,
    /// Subject.
    pub name: String,
    /// One line of text.
    pub message: String,
    /// Names and values.
    pub values: Vec<(String, String)>,
}

/// `diagnostic_msgs/DiagnosticArray`.
pub fn diagnostics(out: &mut Vec<u8>, stamp_ns: i64, hardware_id: &str, statuses: &[Status]) {
    let mut cdr = CdrWriter::new(out);
    Header { stamp_ns, frame_id: "" }.write(&mut cdr);
    cdr.u32(statuses.len() as u32);
    for status in statuses {
        cdr.u8(status.warn.into()).string(&status.name).string(&status.message).string(hardware_id);
        cdr.u32(status.values.len() as u32);
        for (key, value) in &status.values {
            cdr.string(key).string(value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::PARAMETERS;

    #[test]
    fn the_message_has_every_parameter_of_a_sensor_in_order() {
        let name = MessageType::SensorModel.name();
        let fields = definition::parse(name, &texts()[name]).unwrap();
        let fields: Vec<&str> = fields[1..].iter().map(|field| field.name.as_str()).collect();
        let parameters: Vec<&str> = PARAMETERS.iter().map(|parameter| parameter.name).collect();
        fn beside<'a>(names: &[&'a str], others: &[&str]) -> Vec<&'a str> {
            names.iter().filter(|name| !others.contains(name)).copied().collect()
        }
        let (missing, extra) = (beside(&parameters, &fields), beside(&fields, &parameters));
        assert!(
            missing.is_empty() && extra.is_empty(),
            "ros/esaac_msgs/msg/SensorModel.msg lacks the parameters {missing:?}, and has {extra:?}, which are none"
        );
        let moved = fields.iter().zip(&parameters).find(|(field, parameter)| field != parameter);
        assert_eq!(moved, None, "first place of ros/esaac_msgs/msg/SensorModel.msg that is in another order");
        let mut out = Vec::new();
        sensor_model(&mut out, Header { stamp_ns: 0, frame_id: "f" }, &SensorModel::default());
        assert!(out.len() > 100);
    }

    #[test]
    fn times_before_zero_round_down() {
        let mut out = Vec::new();
        clock(&mut out, -1);
        assert_eq!(out[4..], [255, 255, 255, 255, 0xff, 0xc9, 0x9a, 0x3b]);
        // Seconds beyond 32 bits stay at the limit.
        for (t_ns, seconds) in [(i64::MAX, i32::MAX), (i64::MIN, i32::MIN)] {
            clock(&mut out, t_ns);
            assert_eq!(out[4..8], seconds.to_le_bytes());
        }
    }
}
