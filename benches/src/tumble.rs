//! The path-traced sequence `tumble`: key frames at 30 Hz and the events of its 960 Hz renderings.

use crate::scenes::StoredFrame;
use anyhow::{Result, anyhow};
use esaac_model::intensity::REC709;
use esaac_model::packet::Event;
use esaac_model::{SensorModel, SubstepPolicy, Synthesis};
use esaac_oracle::truth;
use esaac_tests::frames::half_bytes;
use esaac_tests::sequence::{SIZE, try_read};
use std::path::Path;

/// Intervals that have a truth.
pub const INTERVALS: usize = 3;

/// Renderings of an interval.
const TRUTH_PER_INTERVAL: usize = 32;

/// The sensor of its figures: C = 0.2, `log_offset` 0.01, no noise.
#[must_use]
pub fn sensor() -> SensorModel {
    SensorModel { width: SIZE.0, height: SIZE.1, ..SensorModel::default() }
}

/// Key frames in f16x4 (`wide` false) or f32x4 colour, f32x2 motion.
pub fn frames(folder: &Path, wide: bool) -> Result<Vec<StoredFrame>> {
    (0..=INTERVALS)
        .map(|k| {
            let path = folder.join(format!("key_{k:04}.exr"));
            let [r, g, b, x, y] =
                try_read(&path, ["R", "G", "B", "motion.X", "motion.Y"]).map_err(|e| anyhow!(e))?;
            let texels = (0..r.len()).flat_map(|i| [r[i], g[i], b[i], 1.0]);
            let hdr = if wide {
                texels.flat_map(f32::to_le_bytes).collect()
            } else {
                texels.flat_map(|v| half_bytes(f64::from(v))).collect()
            };
            let motion = (0..x.len()).flat_map(|i| [x[i], y[i]]).flat_map(f32::to_le_bytes).collect();
            let t_ns = (k as f64 * 1e9 / 30.0).round() as i64;
            Ok(StoredFrame { t_ns, hdr, motion: Some(motion) })
        })
        .collect()
}

/// Events of the 960 Hz renderings.
pub fn truth(folder: &Path) -> Result<Vec<Event>> {
    let frames = (0..=INTERVALS * TRUTH_PER_INTERVAL)
        .map(|k| {
            let path = folder.join(format!("truth_{k:04}.exr"));
            let [r, g, b] = try_read(&path, ["R", "G", "B"]).map_err(|e| anyhow!(e))?;
            let luminance =
                |i: usize| -> f64 { REC709.iter().zip([&r, &g, &b]).map(|(w, c)| w * f64::from(c[i])).sum() };
            Ok(((k as f64 * 1e9 / 960.0).round() as i64, (0..r.len()).map(luminance).collect()))
        })
        .collect::<Result<Vec<(i64, Vec<f64>)>>>()?;
    let sensor = SensorModel { synthesis: Synthesis::None, substep_policy: SubstepPolicy::Fixed, ..sensor() };
    Ok(truth::events(&sensor, 0, frames.iter().map(|(t_ns, f)| (*t_ns, &f[..])))?)
}
