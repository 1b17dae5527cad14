//! Pixel formats of a renderer's images, and the checks that come before an image is read.

use crate::intensity::srgb_to_linear;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Format of a colour image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum HdrFormat {
    /// Four f16, linear.
    F16x4 = 0,
    /// Four f32, linear.
    F32x4 = 1,
    /// Four u8, sRGB encoded.
    Srgb8x4 = 2,
}

/// Format of a motion image: previous position = position + motion, pixels, y down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum MotionFormat {
    /// Two f16.
    F16x2 = 0,
    /// Two f32.
    F32x2 = 1,
    /// Four f32, of which the first two count (Isaac Sim's `motion_vectors`).
    F32x4 = 2,
}

/// Format of a depth image: metres; a background may be infinite, zero or very large.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum DepthFormat {
    /// One f32.
    F32 = 0,
}

/// Format of an image of instance ids.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum IdFormat {
    /// One u16.
    U16 = 0,
    /// One u32.
    U32 = 1,
}

/// Why a frame is refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FrameError {
    /// An image has the wrong number of bytes.
    #[error(
        "camera {camera}: {image} has {actual} bytes, expected {expected} ({width_px}x{height_px} px of {texel_bytes} bytes)"
    )]
    Size {
        /// Camera number.
        camera: u32,
        /// Which image.
        image: &'static str,
        /// Expected size.
        expected: usize,
        /// Size given.
        actual: usize,
        /// Sensor width.
        width_px: u32,
        /// Sensor height.
        height_px: u32,
        /// Bytes a texel.
        texel_bytes: usize,
    },
    /// The frame's time is not after that of the previous frame.
    #[error("camera {camera}: frame time {actual_ns} ns is not after the previous frame's {previous_ns} ns")]
    Time {
        /// Camera number.
        camera: u32,
        /// Time of the previous frame, nanoseconds.
        previous_ns: i64,
        /// Time of this frame, nanoseconds.
        actual_ns: i64,
    },
    /// The frame's time is beyond `FARTHEST_T_NS`.
    #[error("camera {camera}: frame time {actual_ns} ns, expected within +-{expected_ns} ns")]
    Far {
        /// Camera number.
        camera: u32,
        /// Farthest time from 0, nanoseconds.
        expected_ns: i64,
        /// Time of this frame, nanoseconds.
        actual_ns: i64,
    },
    /// The time since the previous frame exceeds `MAX_INTERVAL_NS`.
    #[error(
        "camera {camera}: gap of {actual_ns} ns since the previous frame, expected at most {expected_ns} ns; reset the camera to start anew"
    )]
    Gap {
        /// Camera number.
        camera: u32,
        /// Longest gap allowed, nanoseconds.
        expected_ns: i64,
        /// Gap of this frame, nanoseconds.
        actual_ns: i64,
    },
    /// The synthesis needs motion vectors and the frame has none.
    #[error(
        "camera {camera}: synthesis `{synthesis}` needs motion vectors and the frame has none; give them or use `linear`"
    )]
    MissingMotion {
        /// Camera number.
        camera: u32,
        /// The synthesis asked for.
        synthesis: &'static str,
    },
    /// The synthesis needs depth and poses and the camera gets none.
    #[error(
        "camera {camera}: synthesis `rigid` needs depth, a lens and poses, and the camera gets none; configure its geometry or use `motion` or `linear`"
    )]
    MissingGeometry {
        /// Camera number.
        camera: u32,
    },
    /// The number of frames differs from the number of cameras in the rig.
    #[error("{actual} frames for {expected} cameras")]
    Count {
        /// Cameras of the rig.
        expected: usize,
        /// Frames given.
        actual: usize,
    },
}

impl HdrFormat {
    /// Bytes a texel.
    #[must_use]
    pub fn texel_bytes(self) -> usize {
        match self {
            HdrFormat::F16x4 => 8,
            HdrFormat::F32x4 => 16,
            HdrFormat::Srgb8x4 => 4,
        }
    }

    /// Linear R, G, B of texel `index`.
    #[must_use]
    pub fn decode(self, bytes: &[u8], index: usize) -> [f64; 3] {
        let texel = &bytes[index * self.texel_bytes()..][..self.texel_bytes()];
        std::array::from_fn(|c| match self {
            HdrFormat::F16x4 => half::f16::from_le_bytes([texel[2 * c], texel[2 * c + 1]]).to_f64(),
            HdrFormat::F32x4 => {
                f64::from(f32::from_le_bytes(texel[4 * c..4 * c + 4].try_into().expect("four bytes")))
            }
            HdrFormat::Srgb8x4 => srgb_to_linear(texel[c]),
        })
    }
}

impl MotionFormat {
    /// Bytes a texel.
    #[must_use]
    pub fn texel_bytes(self) -> usize {
        match self {
            MotionFormat::F16x2 => 4,
            MotionFormat::F32x2 => 8,
            MotionFormat::F32x4 => 16,
        }
    }

    /// Motion of texel `index`, pixels.
    #[must_use]
    pub fn decode(self, bytes: &[u8], index: usize) -> [f64; 2] {
        let texel = &bytes[index * self.texel_bytes()..][..self.texel_bytes()];
        std::array::from_fn(|c| match self {
            MotionFormat::F16x2 => half::f16::from_le_bytes([texel[2 * c], texel[2 * c + 1]]).to_f64(),
            MotionFormat::F32x2 | MotionFormat::F32x4 => {
                f64::from(f32::from_le_bytes(texel[4 * c..4 * c + 4].try_into().expect("four bytes")))
            }
        })
    }
}

impl DepthFormat {
    /// Bytes a texel.
    #[must_use]
    pub fn texel_bytes(self) -> usize {
        4
    }

    /// Depth of texel `index`, metres.
    #[must_use]
    pub fn decode(self, bytes: &[u8], index: usize) -> f32 {
        f32::from_le_bytes(bytes[4 * index..][..4].try_into().expect("four bytes"))
    }
}

impl IdFormat {
    /// Bytes a texel.
    #[must_use]
    pub fn texel_bytes(self) -> usize {
        match self {
            IdFormat::U16 => 2,
            IdFormat::U32 => 4,
        }
    }

    /// Id of texel `index`.
    #[must_use]
    pub fn decode(self, bytes: &[u8], index: usize) -> u32 {
        let texel = &bytes[index * self.texel_bytes()..][..self.texel_bytes()];
        match self {
            IdFormat::U16 => u16::from_le_bytes([texel[0], texel[1]]).into(),
            IdFormat::U32 => u32::from_le_bytes(texel.try_into().expect("four bytes")),
        }
    }
}

/// Farthest time of a frame from 0, nanoseconds: 146 years, so that sums and differences of times fit 64 bits.
pub const FARTHEST_T_NS: i64 = 1 << 62;

/// Checks a frame's time, and against the previous one's if there is one.
///
/// # Errors
/// `FrameError::Far` if it is beyond `FARTHEST_T_NS`, `FrameError::Time` if time does not advance, `FrameError::Gap` if the gap
/// exceeds `MAX_INTERVAL_NS`.
pub fn check_time(camera: u32, previous_ns: Option<i64>, actual_ns: i64) -> Result<(), FrameError> {
    if !(-FARTHEST_T_NS..=FARTHEST_T_NS).contains(&actual_ns) {
        return Err(FrameError::Far { camera, expected_ns: FARTHEST_T_NS, actual_ns });
    }
    let Some(previous_ns) = previous_ns else { return Ok(()) };
    let gap_ns = actual_ns.saturating_sub(previous_ns);
    if gap_ns <= 0 {
        return Err(FrameError::Time { camera, previous_ns, actual_ns });
    }
    if gap_ns > crate::MAX_INTERVAL_NS {
        return Err(FrameError::Gap { camera, expected_ns: crate::MAX_INTERVAL_NS, actual_ns: gap_ns });
    }
    Ok(())
}

/// Checks the size of an image: `actual` bytes for `width_px * height_px` texels of `texel_bytes`.
///
/// # Errors
/// `FrameError::Size` if it differs.
pub fn check_size(
    camera: u32,
    image: &'static str,
    (width_px, height_px): (u32, u32),
    texel_bytes: usize,
    actual: usize,
) -> Result<(), FrameError> {
    let expected = width_px as usize * height_px as usize * texel_bytes;
    if actual == expected {
        Ok(())
    } else {
        Err(FrameError::Size { camera, image, expected, actual, width_px, height_px, texel_bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_decode_what_they_encode() {
        let f16: Vec<u8> =
            [0.5, 2.0, 65504.0, 1.0].iter().flat_map(|&v| half::f16::from_f64(v).to_le_bytes()).collect();
        assert_eq!(HdrFormat::F16x4.decode(&f16, 0), [0.5, 2.0, 65504.0]);
        let f32x4: Vec<u8> = [1.5_f32, -2.5, 9.0, 9.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(MotionFormat::F32x4.decode(&f32x4, 0), [1.5, -2.5]);
        assert_eq!(IdFormat::U16.decode(&[1, 2, 0xff, 0xff], 1), 0xffff);
        assert_eq!(IdFormat::U32.decode(&[0; 8].map(|_: u8| 3), 1), 0x0303_0303);
    }

    #[test]
    fn time_must_advance_and_not_jump() {
        assert!(check_time(0, None, -5).is_ok());
        assert!(check_time(0, Some(0), 33_000_000).is_ok());
        assert_eq!(
            check_time(2, Some(10), 10),
            Err(FrameError::Time { camera: 2, previous_ns: 10, actual_ns: 10 })
        );
        assert!(matches!(check_time(0, Some(0), 2_000_000_000), Err(FrameError::Gap { .. })));
        let far = |t_ns| matches!(check_time(0, None, t_ns), Err(FrameError::Far { actual_ns, .. }) if actual_ns == t_ns);
        assert!(far(i64::MIN) && far(-FARTHEST_T_NS - 1) && far(FARTHEST_T_NS + 1) && far(i64::MAX));
        assert!(check_time(0, None, -FARTHEST_T_NS).is_ok() && check_time(0, None, FARTHEST_T_NS).is_ok());
        let whole = check_time(0, Some(-FARTHEST_T_NS), FARTHEST_T_NS);
        assert!(matches!(whole, Err(FrameError::Gap { .. })));
    }

    #[test]
    fn size_errors_name_expected_and_actual() {
        let error = check_size(1, "motion", (4, 3), 8, 95).unwrap_err().to_string();
        assert!(error.contains("95") && error.contains("96") && error.contains("motion"), "{error}");
    }
}
