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
    try_read(path, names).unwrap_or_else(|e| panic!("{e}"))
}

/// As [`read`], with a message where it cannot be read.
pub fn try_read<const N: usize>(path: &Path, names: [&str; N]) -> Result<[Vec<f32>; N], String> {
    let said = |what: String| format!("{}: {what}", path.display());
    let image = read_first_flat_layer_from_file(path).map_err(|e| said(e.to_string()))?;
    let size = image.layer_data.size;
    if size != Vec2(SIZE.0 as usize, SIZE.1 as usize) {
        return Err(said(format!("{}x{} px, expected {}x{} px", size.0, size.1, SIZE.0, SIZE.1)));
    }
    let mut channels = [const { Vec::new() }; N];
    for (channel, name) in channels.iter_mut().zip(names) {
        let list = &image.layer_data.channel_data.list;
        let found = list.iter().find(|c| c.name.to_string() == name);
        let found = found.ok_or_else(|| said(format!("no channel {name}")))?;
        *channel = found.sample_data.values_as_f32().collect();
    }
    Ok(channels)
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
