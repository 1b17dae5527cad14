//! The equations of [`Synthesis::Motion`](crate::Synthesis::Motion), and of the taps that it reads
//! images with.
//!
//! All of it happens in `L = ln(S + log_offset)` (the sensor's own scale, in which an edge is as sharp
//! going up as going down), per intensity plane; of a mosaic there are three. `a` is the fraction of
//! the interval, positions are in pixels, `m_k` is frame k's motion field (previous position = position
//! + motion), read between pixels bilinearly, with a non-finite vector as 0.
//!
//! **Paths.** The surface point at `q` in frame k was at `q + m`, `m = m_k(q)`, in frame k-1; with
//! `u = m_{k-1}(q + m)` and `r` the length of the interval before over this one's, its acceleration gives
//! `c = (u - r m) / (r (1 + r))` (0 without the previous field), and at `a` it is at `q + D`, `D = t ((c -
//! m) + t c)`, `t = a - 1`. In the first interval `r` is taken as 1, and a `u` of exactly 0 as no
//! vector: renderers have none to give with their first frame. Each pixel `x` has `(m, c)` of the point
//! that it shows at `a = 1` (`q = x`) and of the one at `a = 0` ([`PATH_STEPS`] steps of `q = x -
//! m_k(q)` from `q = x`; its `u` is `m_{k-1}(x)`), and blends the two linearly in `a`. Its sources are
//! then `q = x - D` in frame k and `p = q + m` in frame k-1.
//!
//! **Lattices.** Each frame gets a lattice of twice its density, entry `(X, Y)` at pixel `(X / 2, Y /
//! 2)`, whose even entries are the frame. The others come first from the frame itself (cubic,
//! [`CUBIC_FRAME`]). Then detail is transferred from the other frame's lattice `E'`: `E(x) = v
//! (E'(x + d) + r(x)) + (1 - v) E_0(x)`, `d` the way to the other frame (`m` of the path at `a = 1`, or
//! minus `m` of the path at `a = 0`), `r = L - E'(x + d)` at the pixels; `d`, `r` and `v` are bilinear
//! between them. The first transfer is to frame k from frame k-1; a sensor with two
//! [`transfers`](crate::SensorModel::transfers) has another one back. `E_0` of frame k-1 is the lattice
//! that the last interval left of it, so that detail gathers over the frames. The second transfer serves
//! its own interval only: what is left of frame k is the work of the first.
//!
//! The first transfer reads a pixel and the three entries right of and below it by the taps of four cells that lie
//! to each other as they do, less than half as many as with a cell of its own for each: the one of `x + d` of the
//! pixel, and for the entry `(i, j)` away the one `(i, j)` away, at the fraction that its own `x + d` has there,
//! clamped to [[`CELL_SLACK`] below 0, as much above 1]. Motion at a pixel is what was rendered, so that
//! `floor(2 d)` is exact and every device finds the same cell. The second transfer's `d` is computed: it gives each
//! entry a cell of its own.
//!
//! **What a transfer gains and costs.** On the path-traced sequence of the tests, in 32 sub-steps, F1 is
//! .721 with none, .774 with one and .793 with two; the Victor-Purpura distance is .734, .653 and .622.
//! Of an interval of 320x320 pixels the first takes 5 us on an NVIDIA H200 in gray and 11 us in Bayer, the second 9 us
//! and some 12 us.
//! One is the default, for real time; two are for quality. Other syntheses and
//! [`Taps::Bilinear`](crate::Taps::Bilinear) have no lattices, and there the parameter does nothing.
//!
//! **Trust** `v` at a pixel: `clamp(2 - e / TRUST_PX, 0, 1)`, `e` the largest difference of a motion
//! component to one of the 3x3 pixels around it; 0 if one of them has a non-finite vector; times `max(0,
//! 1 - o)` with `o` how far `x + d` lies outside the image (pixels, the larger of the two axes).
//!
//! **Sample.** `L = (w_0 E_{k-1}(p) + w_1 E_k(q)) / (w_0 + w_1)`, cubic ([`CUBIC_LATTICE`]), `w_0 = (1 -
//! a) b(p)`, `w_1 = a b(q)`, `b = max(1 - o / EDGE_PX, EDGE_WEIGHT)`; then `S = max(0, exp(L) -
//! log_offset)`. A pixel whose own vector is non-finite is blended as by `linear`.
//!
//! **Taps.** Cubic: Keys' kernel down 4 rows of entries, the inner two of them read by Keys' kernel across 4 entries,
//! the outer two linearly across 2: the corners cost a quarter of the reads, and are worth a tenth of the time error
//! in the smoothest scenes and nothing on path-traced frames. The result is clamped to the range of the central 2x2 entries. [`Taps::Bilinear`](crate::Taps::Bilinear) reads the frames themselves, without lattices.
//! Positions are clamped to the image.

/// Keys' parameter for lattice entries made from one frame alone.
pub const CUBIC_FRAME: f64 = -1.0;

/// Keys' parameter for reading a lattice.
pub const CUBIC_LATTICE: f64 = -0.75;

/// How far beyond its cell an entry may be read with the cell's taps, entries. It is what motion may differ
/// between a pixel and the entries beside it before these are read in the wrong place: at a turn of a tenth of a
/// radian a frame, a lattice read so is 1% less exact than with each entry's own taps, which are more than
/// twice as many.
pub const CELL_SLACK: f64 = 0.125;

/// Difference of motion between neighbours at which transferred detail begins to be distrusted; at
/// twice that it is not used. Pixels.
pub const TRUST_PX: f64 = 0.5;

/// Distance outside the image over which a source fades out, pixels.
pub const EDGE_PX: f64 = 1.0;

/// Least weight of a source outside the image.
pub const EDGE_WEIGHT: f64 = 1e-3;

/// Most transfers an interval. Further ones, to and fro, gain little: on the path-traced sequence of the
/// tests F1 is .793 with two, .807 with three and .809 with four.
pub const MAX_TRANSFERS: u32 = 2;

/// Fixed-point steps from a pixel to the surface point that it shows at the interval's start.
pub const PATH_STEPS: u32 = 3;

/// Keys' cubic weights of the entries -1, 0, 1, 2 around a position at `fraction` between entries 0
/// and 1.
#[inline]
#[must_use]
pub fn cubic_weights(fraction: f64, parameter: f64) -> [f64; 4] {
    let a = parameter;
    let inner = |d: f64| ((a + 2.0) * d - (a + 3.0)) * d * d + 1.0;
    let outer = |d: f64| ((a * d - 5.0 * a) * d + 8.0 * a) * d - 4.0 * a;
    [outer(1.0 + fraction), inner(fraction), inner(1.0 - fraction), outer(2.0 - fraction)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubic_weights_interpolate_and_sum_to_one() {
        for parameter in [CUBIC_FRAME, CUBIC_LATTICE, -0.5] {
            assert_eq!(cubic_weights(0.0, parameter), [0.0, 1.0, 0.0, 0.0]);
            for fraction in [0.1, 0.5, 0.9, 1.0] {
                let sum: f64 = cubic_weights(fraction, parameter).iter().sum();
                assert!((sum - 1.0).abs() < 1e-12);
            }
        }
        // Catmull-Rom at the middle.
        assert_eq!(cubic_weights(0.5, -0.5), [-0.0625, 0.5625, 0.5625, -0.0625]);
    }
}
