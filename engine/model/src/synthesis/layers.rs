//! The equations of synthesis `motion` where motions meet: which surfaces a pixel shows between two frames, told apart by
//! their motion vectors. A camera with [`layers`](crate::SensorModel::layers) of 1 follows one surface in each pixel. One
//! with 0 does so too unless much of its image needs more ([`layers_for_scene`]).
//!
//! Notation is that of [`synthesis`](super); `t = a - 1`. In the first interval, and where the frame before has no
//! vectors, frame k-1 has none.
//!
//! **Where motions meet.** Two neighbouring pixels of frame k with usable vectors, side by side or one above the other,
//! differ by the larger component of the difference of their vectors, rounded down to sixteenths of a pixel. The pair of a
//! block of [`BLOCK_PX`] is the one that differs most, if by more than [`MEET_PX`]; of equals the first, by its upper or
//! left pixel row by row, side by side before one above the other. That pixel lies in the block. Below that difference a
//! pixel that follows one surface is as good.
//!
//! A block's pair **passes** another block at most [`REACH_BLOCKS`] away (in columns and rows) if the block's square,
//! displaced by anything from 0 to the vector of either pixel, comes within [`REACH_PX`] of the other's. Blocks that no
//! pair passes are as without layers.
//!
//! **Layers.** A layer is a surface whose vectors are linear in the image: `M(q) = m + S (q - y)`, given by a pixel `y` of
//! frame k with vector `m`. Along each axis `S` is measured from the farthest to the farthest pixel that is reached from
//! `y` in at most [`SLOPE_REACH_PX`] steps either way, while vectors change by at most [`SMOOTH_PX`] (larger component) a
//! step; it is 0 where these are fewer than two steps in all, and as a whole where `det(I + S) < `[`LEAST_DETERMINANT`].
//!
//! Its earlier vector `u` is read in frame k-1 at `y + m`, from the four pixels around: of those with weight, the mean of
//! the ones that are within [`SMOOTH_PX`] of the one nearest to `r m`. If that place lies outside the image by more than [`OUTSIDE_PX`], or `u`
//! differs from `r m` by more than [`BEND_PX`]` + `[`BEND_SHARE`]` |r m|`, it shows something else, and there is no layer.
//! The curvature is `c = (u - r m) / (r (1 + r))`. Without vectors of frame k-1, `c = S m / 2`: vectors at a place of the
//! image are taken to stay the same.
//!
//! The point that pixel `x` shows at `a` lies at `q` in frame k with `(I - t S)(q - y) = x - y + t m - t a c`, and at
//! `q + M(q)` in frame k-1.
//!
//! **Layers of a block.** Both pixels of every pair that passes it, and, if it has no pair itself, its own pixel right and
//! below of the middle. Nearer blocks come first (the larger of columns and rows away), then row by row; the pair's upper
//! or left pixel comes first. A layer is left out whose `M` at the block's centre is nearer than [`MERGE_PX`] to that of
//! one before it. The first [`BLOCK_LAYERS`] count.
//!
//! **What a pixel of a frame shows.** In frame k, the layer whose `M` is nearest to its vector, if that differs by no more
//! than [`BELONG_PX`]` + `[`BELONG_SHARE`]` |M|`; else the farthest layer. In frame k-1 likewise, with
//! `u + r S (p - y - m)` in place of `M`. Without vectors there, the nearest layer whose point of that pixel is seen in
//! frame k, by the pixel nearest to it; else the farthest. Without a usable vector it is not known.
//!
//! **Order.** What disappears is behind. Pixels of frame k in the block and the 8 pixels around it vote: each that shows
//! (is within the bounds above of) a layer B, and whose own vector leads to a pixel of frame k-1 that shows another layer A,
//! if A's point of that pixel is seen in frame k too: A hides B. A is nearer than B with at least
//! [`LEAST_VOTES`] votes more than twice the other way's. Without such votes, the faster one at the block's centre is
//! nearer. A layer's rank is the number of those nearer than it.
//!
//! **Layers of a pixel.** Each layer of the block is followed at `N + 1` instants from `a = 0` to 1, where `N` is the
//! largest difference of two layers' `M` at the pixel, rounded up but for a thousandth, from 1 to [`MOST_STEPS`]. It is seen where the pixel
//! nearest to its point shows it in either frame. Of those seen at all, the
//! [`layers`](crate::SensorModel::layers) seen most often count. A pixel with fewer than two is as without layers.
//!
//! **Composite.** As in [`rigid`](super::rigid), where the four pixels around a position always speak: those that show the
//! layer, `s`; those that show a nearer one or are unknown, `h`; and those that show a farther one. Weights below
//! [`SLIGHT_WEIGHT`] do not count. Renderers mix the colours of what meets in a pixel, so a layer shows beyond the pixels
//! whose vectors are its own: its **fringe**, `f`, are those that show a farther layer and of whose 3x3 pixels it is the
//! nearest that shows. And a pixel that shows the layer is mixed if one of its 3x3 pixels shows a nearer one.
//!
//! With `u` as there, a layer covers `c = sum u s / sum u (1 - h)` of the pixel and reaches into `e = sum u (s + f) / sum u
//! (1 - h)` of it, both at most 1. Its level `L` is the mean by `u s`, where mixed pixels count [`MIXED_WEIGHT`] times. In a
//! frame it is the mean of the pixels that show it, and where no others are around the one read from the half-pel
//! frame: up to a share of [`WHOLE_SHARE`] that is mixed or of other layers, it goes over from one to the other. `R` is the
//! level at its positions whatever it is of, the mean in log by `u (1 - h)`; it is `L` where no pixel shows the layer.
//!
//! From far to near, with `H` the light of the farther layers, that of a layer over them is
//! `e (v R + (1 - v) (c exp(L) + (1 - c) H)) + (1 - e) H`. It is `exp(L)` if no farther one shows, or if `c` is at least
//! `1 - `[`SLIGHT_WEIGHT`]. Layers with `e = 0` do not show. `R` holds another background than the pixel's, `B`: as there,
//! the mean by `u (1 - h)` of `exp` of the level of farther pixels around, or `H` in a frame that shows none.
//! `v = 1 - d min(|ln(H / B)| / `[`BACKGROUND_LOG`]`, 1)`. The **thickness** `d` is the smaller number of the steps along the
//! two axes over which the layer's slopes were measured, over [`THICK_STEPS`], at most 1: of what is thin no pixel shows
//! the colour unmixed, so there is nothing to make a composite of. Where no layer shows, the pixel is as without layers.
//!
//! **Sub-steps.** The vectors of pairs that pass a block count for its number of sub-steps.

pub mod pairs;

pub use super::rigid::{BLOCK_PX, MIXED_WEIGHT, SLIGHT_WEIGHT, SNAP_SAMPLES};

/// Most surfaces that a pixel may show between two frames.
pub const MAX_LAYERS: u32 = 3;

/// Of how many blocks pairs must pass one for a camera to go over to several surfaces, if it leaves that to the scene.
pub const BLOCKS_OF_MEETING: u64 = 4;

/// Of how many blocks pairs must pass one for it to stay with them.
pub const BLOCKS_TO_STAY: u64 = 8;

/// Surfaces that a pixel may show in an interval, for a camera that leaves it to the scene: [`MAX_LAYERS`] or 1. `before` is
/// that of the last interval, in which pairs passed `meeting` of the camera's `blocks`. In the first interval `before` is 1,
/// and its own pairs count.
#[must_use]
pub fn layers_for_scene(before: u32, meeting: u64, blocks: u64) -> u32 {
    let blocks_of_one = if before > 1 { BLOCKS_TO_STAY } else { BLOCKS_OF_MEETING };
    if meeting > 0 && meeting * blocks_of_one >= blocks { MAX_LAYERS } else { 1 }
}

/// Difference of the vectors of neighbouring pixels, pixels, above which two motions meet.
pub const MEET_PX: f64 = 3.0;

/// Difference of the vectors of neighbouring pixels, pixels, up to which they are of one surface.
pub const SMOOTH_PX: f64 = 0.5;

/// How far around a pixel the slopes of its layer are measured, pixels.
pub const SLOPE_REACH_PX: usize = 4;

/// Least determinant of a layer's map from frame to frame; below it the image would fold.
pub const LEAST_DETERMINANT: f64 = 0.25;

/// How many blocks away a pair may be that passes a block.
pub const REACH_BLOCKS: usize = 4;

/// How near to a block a pair must pass, pixels. Not a round number: vectors often are, and rounding would decide.
pub const REACH_PX: f64 = 2.03;

/// Difference of vectors at a block's centre, pixels, below which two layers are one.
pub const MERGE_PX: f64 = 1.0;

/// Difference from a layer's vector, pixels, up to which a pixel shows it.
pub const BELONG_PX: f64 = 1.0;

/// Further difference up to which it does, as a share of the vector.
pub const BELONG_SHARE: f64 = 0.1;

/// Difference of a layer's earlier vector from its present one, pixels, up to which it is of the same surface.
pub const BEND_PX: f64 = 2.0;

/// Further difference up to which it is, as a share of the vector.
pub const BEND_SHARE: f64 = 0.5;

/// How far outside the image a position counts as in it, pixels: rounding.
pub const OUTSIDE_PX: f64 = 0.01;

/// Largest number of layers of a block.
pub const BLOCK_LAYERS: usize = 6;

/// Largest number of steps in which a pixel follows its layers.
pub const MOST_STEPS: usize = 16;

/// Fewest votes by which one layer counts as nearer than another: some pixels at edges err.
pub const LEAST_VOTES: u32 = 16;

/// Difference of the background here from that in the frames, nepers, at which a silhouette's mixture does not count.
pub const BACKGROUND_LOG: f64 = 1.0;

/// Steps across a layer, by vectors that go on, from which it is thick enough to show its own colour.
pub const THICK_STEPS: i64 = 4;

/// Share of the pixels around that are mixed or of other layers, from which a layer's level is the mean of its own.
pub const WHOLE_SHARE: f64 = 0.05;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_needs_several_surfaces_from_a_quarter_of_its_blocks_to_an_eighth() {
        let after = |before, meeting| layers_for_scene(before, meeting, 80);
        assert_eq!([0, 9, 10, 19].map(|meeting| after(1, meeting)), [1; 4]);
        assert_eq!([20, 80].map(|meeting| after(1, meeting)), [MAX_LAYERS; 2]);
        assert_eq!([10, 20, 80].map(|meeting| after(MAX_LAYERS, meeting)), [MAX_LAYERS; 3]);
        assert_eq!([0, 9].map(|meeting| after(MAX_LAYERS, meeting)), [1; 2]);
        assert_eq!(layers_for_scene(1, 0, 0), 1, "a camera that has told nothing");
    }
}
