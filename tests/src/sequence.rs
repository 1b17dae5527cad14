//! The path-traced sequence, as frames for the engine and the oracle.

use exr::prelude::{Vec2, read_first_flat_layer_from_file};
use std::path::{Path, PathBuf};

/// A key frame.
pub struct Key {
    /// Time.
    pub t_ns: i64,
    /// f32 x 4.
    pub hdr: Vec<u8>,
    /// f32 x 2.
    pub motion: Vec<u8>,
}

/// Columns and rows.
pub const SIZE: (u32, u32) = (240, 180);

/// The folder; a missing one fails the test.
#[must_use]
pub fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/sequences/tumble");
    assert!(folder.is_dir(), "the tumble sequence is missing: expected {}", folder.display());
    folder
}

/// Channels of an EXR file, in the order asked for.
#[must_use]
pub fn read<const N: usize>(path: &Path, names: [&str; N]) -> [Vec<f32>; N] {
    let image = read_first_flat_layer_from_file(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    assert_eq!(image.layer_data.size, Vec2(SIZE.0 as usize, SIZE.1 as usize), "{}", path.display());
    names.map(|name| {
        let channel = image.layer_data.channel_data.list.iter().find(|c| c.name.to_string() == name);
        let channel = channel.unwrap_or_else(|| panic!("{} has no channel {name}", path.display()));
        channel.sample_data.values_as_f32().collect()
    })
}

/// Key frame `k` at 30 Hz.
#[must_use]
pub fn key(k: usize) -> Key {
    let [r, g, b, x, y] =
        read(&folder().join(format!("key_{k:04}.exr")), ["R", "G", "B", "motion.X", "motion.Y"]);
    let bytes = |texels: Vec<f32>| texels.iter().flat_map(|v| v.to_le_bytes()).collect();
    Key {
        t_ns: (k as f64 * 1e9 / 30.0).round() as i64,
        hdr: bytes((0..r.len()).flat_map(|i| [r[i], g[i], b[i], 1.0]).collect()),
        motion: bytes((0..r.len()).flat_map(|i| [x[i], y[i]]).collect()),
    }
}
