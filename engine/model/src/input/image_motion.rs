//! How far images move, from the images alone: blocks of one are looked for in the other.

use crate::HdrFormat;
use crate::intensity::REC709;
use crate::quantile::upper;

/// Side of a block, pixels.
const BLOCK_PX: usize = 12;

/// Farthest that a block is looked for, pixels.
const REACH_PX: isize = 16;

/// Most blocks on either axis.
const BLOCKS: usize = 10;

/// Mean difference of log luminance below which a block has not changed.
const SAME_LOG: f64 = 0.02;

/// What a match must leave of a block's change to count as its motion.
const MATCH: f64 = 0.5;

/// The logarithm of an image's luminance.
#[derive(Clone, Debug)]
pub(super) struct Luminance {
    width: usize,
    height: usize,
    log: Vec<f32>,
}

impl Luminance {
    /// Of a colour image of `width` by `height` pixels.
    pub(super) fn new(
        (width, height): (usize, usize),
        format: HdrFormat,
        hdr: &[u8],
        log_offset: f64,
    ) -> Self {
        let log = |texel| {
            let colour = format.decode(hdr, texel);
            let luminance: f64 = REC709.iter().zip(colour).map(|(weight, value)| weight * value).sum();
            (luminance.max(0.0) + log_offset).ln() as f32
        };
        Luminance { width, height, log: (0..width * height).map(log).collect() }
    }

    /// Width and height.
    pub(super) fn size_px(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// At a pixel of the image.
    pub(super) fn log(&self, x: usize, y: usize) -> f32 {
        self.log[y * self.width + x]
    }

    /// Mean difference between the block at `corner` and the one in `other` that lies `by` away, but for what is the same
    /// in the whole block: light that changes does not move. `None` if that is not inside, or if a pixel has no number.
    fn difference(&self, other: &Luminance, corner: (usize, usize), by: (isize, isize)) -> Option<f64> {
        let column = corner.0.checked_add_signed(by.0)?;
        let row = corner.1.checked_add_signed(by.1)?;
        if column + BLOCK_PX > self.width || row + BLOCK_PX > self.height {
            return None;
        }
        let mut differences = [0.0_f32; BLOCK_PX * BLOCK_PX];
        for (y, line) in differences.chunks_exact_mut(BLOCK_PX).enumerate() {
            let here = &self.log[(corner.1 + y) * self.width + corner.0..][..BLOCK_PX];
            let there = &other.log[(row + y) * other.width + column..][..BLOCK_PX];
            line.iter_mut().zip(here.iter().zip(there)).for_each(|(d, (a, b))| *d = a - b);
        }
        let count = differences.len() as f32;
        let common = differences.iter().sum::<f32>() / count;
        let left = differences.iter().map(|d| (d - common).abs()).sum::<f32>() / count;
        left.is_finite().then_some(f64::from(left))
    }

    /// The shortest way from a block to its like in `other`, pixels. 0 if it has not changed, or if it has in another
    /// way than by moving.
    fn moved_px(&self, other: &Luminance, corner: (usize, usize)) -> Option<f64> {
        let still = self.difference(other, corner, (0, 0))?;
        if still < SAME_LOG {
            return Some(0.0);
        }
        let shifts = (-REACH_PX..=REACH_PX).flat_map(|y| (-REACH_PX..=REACH_PX).map(move |x| (x, y)));
        let found: Vec<(f64, f64)> = shifts
            .filter_map(|by| Some(((by.0 as f64).hypot(by.1 as f64), self.difference(other, corner, by)?)))
            .collect();
        let best = found.iter().map(|(_, left)| *left).fold(still, f64::min);
        if best > MATCH * still {
            return Some(0.0);
        }
        // Along an edge many places are alike.
        let as_good = found.iter().filter(|(_, left)| *left <= 1.1 * best + 0.1 * SAME_LOG);
        as_good.map(|(px, _)| *px).min_by(f64::total_cmp)
    }
}

/// Pixels that a share of the image moves by between two images, or more. `None` if they are too small to tell.
pub(super) fn fastest_px(before: &Luminance, after: &Luminance, share: f64) -> Option<f64> {
    let corners = |length: usize| {
        let last = length.checked_sub(BLOCK_PX)?;
        let count = (length / BLOCK_PX).min(BLOCKS);
        Some((0..count).map(move |i| if count == 1 { last / 2 } else { i * last / (count - 1) }))
    };
    let (columns, rows) = (corners(before.width)?, corners(before.height)?);
    let mut moved_px: Vec<f64> = rows
        .flat_map(|y| columns.clone().map(move |x| (x, y)))
        .filter_map(|corner| after.moved_px(before, corner))
        .collect();
    upper(&mut moved_px, share)
}
