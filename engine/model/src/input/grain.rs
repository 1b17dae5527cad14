//! How grainy an image is: noise of few samples, and edges without antialiasing, differ from frame to frame, and each
//! difference of a contrast threshold sends an event.
//!
//! Each pixel's log luminance is held against its eight neighbours by Immerkaer's mask (`1 -2 1`, `-2 4 -2`, `1 -2 1`,
//! over 6), which leaves out slopes and straight edges, and has the deviation of noise that is independent in each pixel
//! (J. Immerkaer, *Fast noise variance estimation*, 1996). The deviation of a block is that of the median, so that a few
//! edges do not count. The image's is the one which three quarters of its blocks reach: fine textures seldom fill an image.

use super::image_motion::Luminance;
use crate::quantile::upper;

/// Side of a block, pixels.
const BLOCK_PX: usize = 8;

/// The share of the blocks that are as grainy or more.
const GRAINY_SHARE: f64 = 0.75;

/// The median of a normal distribution's absolute values, for each unit of its deviation.
const MEDIAN_OF_NORMAL: f64 = 0.674_49;

/// Grain, in contrast thresholds, from which on a frame sends false events of its own.
const GRAINY: f64 = 0.4;

/// Grain of log intensity that fine textures have.
const TEXTURE_LOG: f64 = 0.08;

/// Deviation of log luminance from pixel to pixel. `None` if the image has no block, or no numbers.
pub(super) fn grain_log(image: &Luminance) -> Option<f64> {
    let (width, height) = image.size_px();
    let inner = |length: usize| (1..length.saturating_sub(BLOCK_PX)).step_by(BLOCK_PX);
    let mut blocks: Vec<f64> = inner(height)
        .flat_map(|y| inner(width).map(move |x| (x, y)))
        .filter_map(|corner| block_log(image, corner))
        .collect();
    upper(&mut blocks, GRAINY_SHARE)
}

/// The deviation of the block at `corner`, which does not touch the image's border.
fn block_log(image: &Luminance, (left, top): (usize, usize)) -> Option<f64> {
    const MASK: [f32; 3] = [1.0, -2.0, 1.0];
    let mut off = [0.0_f32; BLOCK_PX * BLOCK_PX];
    for (i, off) in off.iter_mut().enumerate() {
        let (x, y) = (left + i % BLOCK_PX, top + i / BLOCK_PX);
        let around = (0..9).map(|k| MASK[k % 3] * MASK[k / 3] * image.log(x + k % 3 - 1, y + k / 3 - 1));
        *off = (around.sum::<f32>() / 6.0).abs();
    }
    if !off.iter().all(|off| off.is_finite()) {
        return None;
    }
    let middle = off.len() / 2;
    Some(f64::from(*off.select_nth_unstable_by(middle, f32::total_cmp).1) / MEDIAN_OF_NORMAL)
}

/// What to tell of frames with this grain, seen by a sensor with this contrast threshold; `None` if it is little.
pub(super) fn warning(grain_log: f64, threshold_log: f64) -> Option<String> {
    (grain_log > TEXTURE_LOG.max(GRAINY * threshold_log)).then(|| {
        let thresholds = grain_log / threshold_log;
        format!(
            "most of the image is grainy: pixels differ from those around them by {grain_log:.2} in log intensity, \
             {thresholds:.1} contrast thresholds; if that is noise of few samples, or edges without antialiasing, it \
             sends false events; render more samples a pixel, or denoise"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HdrFormat;

    /// A slope with edges, and noise with this deviation in the logarithm.
    fn image(noise_log: f64) -> Luminance {
        const SIZE_PX: (usize, usize) = (67, 51);
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 24)
        };
        let texels = (0..SIZE_PX.0 * SIZE_PX.1).flat_map(|i| {
            let (x, y) = (i % SIZE_PX.0, i / SIZE_PX.0);
            let normal = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
            let surface = if x > 20 { 3.0 } else { 0.1 } * (1.0 + 0.02 * y as f64);
            [(surface * (noise_log * normal).exp()) as f32; 4]
        });
        let bytes: Vec<u8> = texels.flat_map(f32::to_ne_bytes).collect();
        Luminance::new(SIZE_PX, HdrFormat::F32x4, &bytes, 1e-3)
    }

    #[test]
    fn noise_has_its_deviation_and_edges_and_slopes_have_none() {
        assert!(grain_log(&image(0.0)).expect("blocks") < 0.002);
        for noise_log in [0.02, 0.1, 0.3] {
            // Three quarters of the blocks have at least so much.
            let found = grain_log(&image(noise_log)).expect("blocks");
            assert!((0.8 * noise_log..noise_log).contains(&found), "{found} of {noise_log}");
        }
    }

    #[test]
    fn it_is_told_where_it_crosses_thresholds_by_itself() {
        assert_eq!(warning(0.079, 0.05), None, "as fine textures have");
        assert_eq!(warning(0.19, 0.5), None);
        let text = warning(0.19, 0.2).expect("a difference of a threshold every few frames");
        assert!(text.contains("by 0.19 in log intensity, 0.9 contrast thresholds"), "{text}");
    }

    #[test]
    fn images_without_blocks_or_numbers_tell_nothing() {
        let of = |size_px: (usize, usize), value: f32| {
            let bytes: Vec<u8> = (0..4 * size_px.0 * size_px.1).flat_map(|_| value.to_ne_bytes()).collect();
            grain_log(&Luminance::new(size_px, HdrFormat::F32x4, &bytes, 1e-3))
        };
        assert_eq!([of((9, 20), 1.0), of((0, 0), 1.0), of((20, 20), f32::INFINITY)], [None; 3]);
        assert_eq!(of((10, 10), 1.0), Some(0.0));
    }
}
