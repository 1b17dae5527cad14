//! Frames for the engine and the oracle, from the analytic scenes or from values of single pixels.

use esaac_model::random::philox4x32_10;
use esaac_model::{HdrFormat, MotionFormat, SensorModel};
use esaac_oracle::Frame as OracleFrame;
use esaac_scene::{SceneKind, render_cpu};

/// An interval at 30 Hz, nanoseconds.
pub const FRAME_NS: i64 = 33_333_333;

/// A frame as bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Time.
    pub t_ns: i64,
    /// Colour.
    pub hdr: Vec<u8>,
    /// Motion.
    pub motion: Option<Vec<u8>>,
}

/// Frames of one camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// Format of the colour.
    pub hdr: HdrFormat,
    /// Format of the motion, if there is any.
    pub motion: Option<MotionFormat>,
    /// The frames, in order.
    pub frames: Vec<Frame>,
}

impl Sequence {
    /// Frame `index` for the oracle.
    #[must_use]
    pub fn oracle_frame(&self, index: usize) -> OracleFrame<'_> {
        let frame = &self.frames[index];
        OracleFrame {
            t_ns: frame.t_ns,
            hdr: (self.hdr, &frame.hdr),
            motion: self.motion.zip(frame.motion.as_deref()),
            depth: None,
            ids: None,
        }
    }

    /// The first `count` frames.
    #[must_use]
    pub fn first(mut self, count: usize) -> Self {
        self.frames.truncate(count);
        self
    }
}

/// Times of `count` frames at 30 Hz from `first_ns` on.
#[must_use]
pub fn times(first_ns: i64, count: usize) -> Vec<i64> {
    (0..count as i64).map(|k| first_ns + k * FRAME_NS).collect()
}

/// An analytic scene at the given times.
#[must_use]
pub fn scene(
    kind: SceneKind,
    (width_px, height_px): (u32, u32),
    times_ns: &[i64],
    hdr: HdrFormat,
    motion: MotionFormat,
) -> Sequence {
    let scene = kind.scene(width_px, height_px);
    let mut previous_ns = None;
    let frames = times_ns
        .iter()
        .map(|&t_ns| {
            let image = render_cpu(&scene, t_ns, previous_ns, hdr, motion);
            previous_ns = Some(t_ns);
            Frame { t_ns, hdr: image.hdr, motion: Some(image.motion) }
        })
        .collect();
    Sequence { hdr, motion: Some(motion), frames }
}

/// Gray frames without motion: `intensity(frame, pixel)` at each of `times_ns`.
#[must_use]
pub fn gray(sensor: &SensorModel, times_ns: &[i64], intensity: impl Fn(usize, usize) -> f32) -> Sequence {
    let frames = times_ns
        .iter()
        .enumerate()
        .map(|(index, &t_ns)| {
            let texels = (0..sensor.pixels()).flat_map(|pixel| {
                let value = intensity(index, pixel);
                [value, value, value, 1.0]
            });
            Frame { t_ns, hdr: texels.flat_map(f32::to_le_bytes).collect(), motion: None }
        })
        .collect();
    Sequence { hdr: HdrFormat::F32x4, motion: None, frames }
}

/// Intensity whose log intensity is `log`, as a renderer would give it.
#[must_use]
pub fn intensity_of(sensor: &SensorModel, log: f64) -> f32 {
    (log.exp() - sensor.log_offset) as f32
}

/// Every pixel crosses some six thresholds of .9 in each interval, at times of its own, most of them while it is dark (by
/// synthesis `linear`): the largest of its bins has three times as many events as the others.
#[must_use]
pub fn crowded(sensor: &SensorModel, frames: usize) -> Sequence {
    gray(sensor, &times(0, frames), |frame, pixel| {
        let word = philox4x32_10([pixel as u32, frame as u32, 0, 0], [5, 0])[0];
        let phase = f64::from(word) / f64::from(u32::MAX);
        intensity_of(sensor, if frame % 2 == 0 { -4.0 + 0.5 * phase } else { 1.0 + 1.2 * phase })
    })
}
