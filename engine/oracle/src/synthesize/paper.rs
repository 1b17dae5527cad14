//! Synthesis `paper`: `I_{k,n}(x) = I_k(x - a v)` as the paper prints it, `v` the displacement from
//! the previous frame, read at the target pixel.

use super::Gap;
use super::taps::bilinear;
use esaac_model::synthesis::is_usable;

/// Intensity of plane `plane` at pixel `(x, y)` and `fraction` of the interval, scene units. `None` if the pixel's
/// motion is invalid.
#[must_use]
pub fn sample(gap: &Gap<'_>, plane: usize, x: usize, y: usize, fraction: f64) -> Option<f64> {
    let size = (gap.end.width, gap.end.height);
    // v = -motion, so x - a v = x + a motion.
    let [dx, dy] = gap.end.motion.as_ref()?[y * size.0 + x];
    if !is_usable([dx, dy]) {
        return None;
    }
    Some(bilinear(&gap.end_planes[plane], size, x as f64 + fraction * dx, y as f64 + fraction * dy))
}
