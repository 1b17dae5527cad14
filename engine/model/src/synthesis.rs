//! The equations of [`Synthesis::Motion`](crate::Synthesis::Motion), and of the interpolation with which it reads
//! images.
//!
//! Synthesis works in `L = ln(S + log_offset)`, the sensor's own scale, in which an edge is as sharp going up as going
//! down. Each intensity plane is synthesised by itself; a mosaic has three. `a` is the fraction of the interval.
//! Positions are in pixels. `m_k` is the motion field of frame k: previous position = position + motion. It is read
//! bilinearly between pixels, with 0 in place of a vector that is not [usable](is_usable).
//!
//! **Trajectories.** The surface point at `q` in frame k was at `q + m` in frame k-1, with `m = m_k(q)`. Its motion in
//! the interval before is `u = m_{k-1}(q + m)`. With `r`, the length of the interval before over that of this one, its
//! curvature is `c = (u - r m) / (r (1 + r))`, or 0 without the previous field. At `a` the point is at `q + D`, where
//! `D = t ((c - m) + t c)` and `t = a - 1`. In the first interval `r` counts as 1, and a `u` of exactly 0 counts as
//! missing, because renderers have no motion for their first frame.
//!
//! Each pixel `x` has two pairs `(m, c)`. One is that of the point that it shows at `a = 1`: `q = x`. The other is that
//! of the point that it shows at `a = 0`: [`TRAJECTORY_STEPS`] fixed-point steps `m = m_k(q)`, `q = x - m`, the first
//! from `q = x`; its `u` is `m_{k-1}(x)`. The pixel blends the pairs linearly in `a`. It then reads frame k at
//! `q = x - D` and frame k-1 at `p = q + m`.
//!
//! **Half-pel frames.** Each frame gets a half-pel frame of twice its density. Sample `(X, Y)` lies at pixel
//! `(X / 2, Y / 2)`, so that the even samples are the frame. The others are interpolated from the frame alone
//! ([`HALF_PEL_WEIGHTS`]), which gives `E_0`. Then detail is transferred from the half-pel frame `E'` of the other frame:
//! `E(x) = v (E'(x + d) + r(x)) + (1 - v) E_0(x)`. Here `d` is the displacement to the other frame: `m` at `a = 1`, or
//! `-m` at `a = 0`. `r = L - E'(x + d)` is the residual at the pixels, and `v` the confidence. `d`, `r` and `v` are
//! bilinear between pixels. The first transfer is forward: it takes detail of frame k-1 to frame k. With two
//! [`transfers`](crate::SensorModel::transfers) a backward one follows, with three another forward one, for which `E_0` is
//! what the first has made. From the second interval on, `E_0` of frame k-1 is the half-pel frame that the last forward
//! transfer of the interval before made, so that detail gathers over the frames. The backward transfer serves its own
//! interval only.
//!
//! The first transfer reads a pixel and its three half-pel neighbours (right, below, diagonal) from one shared
//! footprint, with less than half the loads of separate ones. A cell is the square of half-pel samples around a
//! position. The pixel's position `x + d` lies in one cell. The neighbour `(i, j)` samples away is read with the taps
//! of the cell that lies `(i, j)` samples from that one. Its fraction in this cell comes from its own `x + d`, clamped
//! to `[-CELL_SLACK, 1 + CELL_SLACK]` ([`CELL_SLACK`]). A pixel's motion comes straight from the renderer, so that
//! `floor(2 d)` is exact and every device finds the same cell. In the other transfers each sample has the cell of its own
//! position.
//!
//! **Number of transfers.** Two are the default along motion vectors, three along exact paths. Fewer are faster: each
//! costs more than the first and gains less. `docs/design/synthesis.md` lists what each gains. Other syntheses and
//! [`Taps::Bilinear`](crate::Taps::Bilinear) have no half-pel frames and ignore the parameter.
//!
//! **Confidence.** At a pixel, `v = clamp(2 - e / CONFIDENCE_PX, 0, 1) max(0, 1 - o)`. Here `o` is how far `x + d` lies
//! outside the image (pixels, the larger of the two axes). `e` says how far vectors are from agreeing. In a forward
//! transfer it is `e(x)`, the largest difference of a component of `m_k(x)` to that of one of the 3x3 pixels around.
//! `m_k` belongs to frame k, so a pixel of frame k-1 may have another neighbour there than at its place in frame k. In the
//! backward transfer `e` is therefore the largest of `e(x)`, of `e` at the pixel nearest to `x + d` (clamped to the image),
//! and of `LEADING_BACK |m_k(x + d) + d|` (the larger component). `v` is 0 if a vector among these 3x3 is not
//! usable ([`is_usable`]).
//!
//! **Sample.** `L = (w_0 E_{k-1}(p) + w_1 E_k(q)) / (w_0 + w_1)`, read cubically, with weights
//! `w_0 = (1 - a) b(p)` and `w_1 = a b(q)`. `b = max(1 - o / EDGE_PX, EDGE_WEIGHT)`, where `o` is how far the position
//! lies outside the image. Then `S = max(0, exp(L) - log_offset)`. A pixel whose own vector is not usable is blended
//! as by `linear`.
//!
//! **From one frame alone.** A half-pel sample right of or below a pixel is the sum of the six pixels in its row or column
//! by [`HALF_PEL_WEIGHTS`], clamped to the range of the middle two. A diagonal one lies between two rows and two columns:
//! it is the sum along the mean of the rows, plus that along the mean of the columns, minus the mean of the four pixels
//! around, clamped to their range. The frame repeats its border pixels.
//!
//! **Roughness.** Keys' kernel with [`CUBIC_SMOOTH`] reads what is smooth as it is: straight lines stay straight. With any
//! other parameter a slope has a wiggle in each cell, which moves crossings. [`CUBIC_SHARP`] gives texture as fine as the
//! pixels back some of the contrast that is lost between them. So each 8x8 block of a frame has a parameter of its own
//! ([`cubic_parameter`]). It follows from the squares of the differences of pixels to their four neighbours, and of second
//! differences along both axes, summed over the block. A half-pel frame is read with the parameter that the reading pixel's
//! own block has in that frame. A half-pel sample has that of the pixel that it is right of or below.
//!
//! **Taps.** The cubic kernel is Keys', over 4 rows. The inner two rows are read by Keys' kernel across 4 samples, the
//! outer two linearly across 2: twelve taps, without the four corners. The result is clamped to the range of the
//! central 2x2 samples. [`Taps::Bilinear`](crate::Taps::Bilinear) reads the frames themselves, without half-pel frames.
//! Positions are clamped to the image.
//!
//! **What the saved loads cost.** Twelve taps and the shared footprint each make the synthesised level less exact than
//! sixteen taps around every position. Twelve taps cost accuracy wherever the image moves, most on smooth texture. The
//! shared footprint costs accuracy near the border of the image and where motion varies; inside the image it costs
//! nothing under uniform motion. At rest neither costs anything. The test
//! `cargo test -p esaac-tests --test approximations` measures both.

pub mod layers;
pub mod rigid;

/// Weights of the pixels on either side of a half-pel sample, the nearest first: those of H.264's luma interpolation
/// (ITU-T H.264, 8.4.2.2.1). They hardly change waves longer than three pixels.
pub const HALF_PEL_WEIGHTS: [f64; 3] = [20.0 / 32.0, -5.0 / 32.0, 1.0 / 32.0];

/// Keys' parameter for reading a half-pel frame where it is smooth. The kernel is then exact for polynomials of the second
/// degree (Keys 1981).
pub const CUBIC_SMOOTH: f64 = -0.5;

/// Keys' parameter for reading a half-pel frame of texture that is as fine as the pixels.
pub const CUBIC_SHARP: f64 = -0.75;

/// Roughness up to which a block counts as smooth: that of waves of six pixels.
pub const SMOOTH_ROUGHNESS: f64 = 1.0;

/// Roughness from which on a block counts as fine texture: that of waves of four pixels. Noise has 3.
pub const FINE_ROUGHNESS: f64 = 2.0;

/// Largest square of differences that a pixel adds to a block's roughness, nepers squared: that the sums fit 32 bits.
pub const MOST_ROUGH: f64 = 32.0;

/// Steps for each neper squared in which squares of differences are summed.
pub const ROUGHNESS_STEPS: f64 = (1_u32 << 20) as f64;

/// A pixel's part of its block's roughness: its level and those left, right, above and below of it, nepers. Returns half
/// the sum of the squared differences to the four, and the sum of the squared second differences, in
/// [`ROUGHNESS_STEPS`].
#[inline]
#[must_use]
pub fn roughness_of(level: f64, [left, right, above, below]: [f64; 4]) -> [u32; 2] {
    let square = |difference: f64| difference * difference;
    let first = [left, right, above, below].map(|other| 0.5 * square(other - level)).iter().sum::<f64>();
    let second = square(left + right - 2.0 * level) + square(above + below - 2.0 * level);
    [first, second].map(|sum| (sum.min(MOST_ROUGH) * ROUGHNESS_STEPS) as u32)
}

/// Keys' parameter for a block whose pixels have these sums of [`roughness_of`].
#[inline]
#[must_use]
pub fn cubic_parameter([first, second]: [u32; 2]) -> f64 {
    let roughness = f64::from(second) / f64::from(first.max(1));
    let fine = ((roughness - SMOOTH_ROUGHNESS) / (FINE_ROUGHNESS - SMOOTH_ROUGHNESS)).clamp(0.0, 1.0);
    CUBIC_SMOOTH + fine * (CUBIC_SHARP - CUBIC_SMOOTH)
}

/// How far outside its cell a half-pel sample may be read with the cell's taps, in half-pel samples. It bounds how much
/// the motion of a half-pel sample may differ from that of its pixel. Beyond it the position is clamped, and the sample
/// is read in the wrong place. The test `cargo test -p esaac-tests --test approximations` measures what that costs.
pub const CELL_SLACK: f64 = 0.125;

/// Length along an axis from which on a motion vector counts as invalid, pixels. Squares of longer ones do not fit an f32,
/// and nothing in an image moves so far.
pub const MOST_MOTION_PX: f64 = 1e6;

/// Whether a motion vector can be followed: it is finite, and shorter than [`MOST_MOTION_PX`] along both axes.
#[must_use]
pub fn is_usable(vector_px: [f64; 2]) -> bool {
    vector_px.iter().all(|v| v.abs() < MOST_MOTION_PX)
}

/// Difference of motion between neighbours, pixels, at which the confidence in transferred detail begins to fall. At
/// twice this difference the confidence is 0.
pub const CONFIDENCE_PX: f64 = 0.5;

/// How much more than a difference between neighbours it counts that a vector does not lead back to the pixel that it was
/// looked up for.
pub const LEADING_BACK: f64 = 2.0;

/// Distance outside the image over which a source fades out, pixels. Positions are clamped to the image, so what is read
/// there is the border's level, not the source's; but a source that ended at once would send events.
pub const EDGE_PX: f64 = 0.25;

/// Smallest weight of a source outside the image, so that the sum of both weights is never 0.
pub const EDGE_WEIGHT: f64 = 1e-3;

/// Largest number of transfers in an interval. Further ones, backward and forward in turn, gain little.
pub const MAX_TRANSFERS: u32 = 3;

/// Transfers by default where motion is that of vectors.
pub const TRANSFERS_BY_VECTORS: u32 = 2;

/// Transfers by default along exact paths, where the third costs a smaller part of an interval's time.
pub const TRANSFERS_BY_PATHS: u32 = 3;

/// Fixed-point steps from a pixel to the surface point that it shows at the interval's start.
pub const TRAJECTORY_STEPS: u32 = 3;

/// Keys' cubic weights of the samples -1, 0, 1, 2 around a position at `fraction` between samples 0 and 1 (Keys,
/// "Cubic convolution interpolation for digital image processing", 1981). They sum to 1.
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
        for parameter in [-1.0, CUBIC_SHARP, CUBIC_SMOOTH] {
            assert_eq!(cubic_weights(0.0, parameter), [0.0, 1.0, 0.0, 0.0]);
            for fraction in [0.1, 0.5, 0.9, 1.0] {
                let sum: f64 = cubic_weights(fraction, parameter).iter().sum();
                assert!((sum - 1.0).abs() < 1e-12);
            }
        }
        // Catmull-Rom at the middle.
        assert_eq!(cubic_weights(0.5, -0.5), [-0.0625, 0.5625, 0.5625, -0.0625]);
    }

    /// Only that parameter leaves a straight line straight.
    #[test]
    fn smooth_slopes_are_read_as_they_are() {
        let read = |parameter: f64, fraction: f64| -> f64 {
            cubic_weights(fraction, parameter)
                .iter()
                .zip([-1.0, 0.0, 1.0, 2.0])
                .map(|(w, level)| w * level)
                .sum()
        };
        assert!((read(CUBIC_SMOOTH, 0.25) - 0.25).abs() < 1e-12);
        assert!((read(CUBIC_SHARP, 0.25) - 0.25).abs() > 0.01);
    }

    #[test]
    fn half_pel_weights_sum_to_one() {
        assert_eq!(2.0 * HALF_PEL_WEIGHTS.iter().sum::<f64>(), 1.0);
    }

    #[test]
    fn the_parameter_follows_the_length_of_waves() {
        let of_waves = |length_px: f64| {
            let level = |x: f64| (std::f64::consts::TAU * x / length_px).sin();
            let mut sums = [0; 2];
            for x in (0..64).map(f64::from) {
                let own = roughness_of(level(x), [level(x - 1.0), level(x + 1.0), level(x), level(x)]);
                sums = [sums[0] + own[0], sums[1] + own[1]];
            }
            cubic_parameter(sums)
        };
        assert_eq!((of_waves(8.0), of_waves(3.0)), (CUBIC_SMOOTH, CUBIC_SHARP));
        assert!((CUBIC_SHARP..CUBIC_SMOOTH).contains(&of_waves(5.0)));
        assert_eq!(cubic_parameter([0, 0]), CUBIC_SMOOTH);
        // An edge of any height is within what the sums of a block hold.
        let most = roughness_of(20.0, [-20.0; 4]).map(|part| u64::from(part) * 64);
        assert!(most.iter().all(|&sum| sum <= u64::from(u32::MAX)), "{most:?}");
    }
}
