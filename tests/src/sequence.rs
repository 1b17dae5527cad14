//! The path-traced sequence `tests/data/tumble`: frames for the engine, and the true events.

use esaac_formats::exr_frame::{ChannelNames, FrameLayout, read_frame};
use esaac_formats::truth_file;
use esaac_model::packet::Event;
use esaac_model::{HdrFormat, MotionFormat};
use std::path::{Path, PathBuf};

/// A key frame.
pub struct Key {
    /// Time.
    pub t_ns: i64,
    /// Colour, f32x4.
    pub hdr: Vec<u8>,
    /// Motion, f32x2.
    pub motion: Vec<u8>,
}

/// Columns and rows.
pub const SIZE: (u32, u32) = (240, 180);

/// Key frames per second.
const KEY_HZ: f64 = 30.0;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/tumble")
}

/// Key frame `k`.
#[must_use]
pub fn key(k: usize) -> Key {
    let layout = FrameLayout {
        width_px: SIZE.0,
        height_px: SIZE.1,
        names: ChannelNames::default(),
        hdr: HdrFormat::F32x4,
        motion: Some(MotionFormat::F32x2),
        motion_factors: [1.0; 2],
        depth: None,
        ids: None,
    };
    let images = read_frame(&folder().join(format!("key_{k:04}.exr")), &layout)
        .unwrap_or_else(|e| panic!("key frame {k}: {e:#}"));
    Key {
        t_ns: (k as f64 * 1e9 / KEY_HZ).round() as i64,
        hdr: images.hdr,
        motion: images.motion.expect("the layout has motion"),
    }
}

/// True events, from renderings at 960 Hz, in time order.
#[must_use]
pub fn true_events() -> Vec<Event> {
    let truth = truth_file::read(&folder().join("truth.npz")).unwrap_or_else(|e| panic!("{e:#}"));
    assert_eq!((truth.sensor.width, truth.sensor.height), SIZE);
    truth.events
}
