//! The equations of synthesis `rigid`: what a pixel shows between two key frames, from their colour, depth and instance
//! ids, the lens, and the poses of the camera and of every instance ([`paths`](crate::paths)).
//!
//! As in [`synthesis`](super), `L = ln(S + log_offset)`, `a` is the fraction of the interval, and each intensity plane
//! is synthesised by itself. Key frame 0 is the one at the interval's start, key frame 1 the one at its end. `r(x)` is
//! the ray of pixel `x`, `w` an inverse depth ([`Intrinsics::ray`](crate::paths::Intrinsics::ray)). `A_k(a)` and
//! `b_k(a)` are rotation and translation from camera axes at `a` to those of key frame k, for the points of an instance
//! ([`SceneMotion::relative`](crate::paths::SceneMotion::relative)).
//!
//! **Surfaces.** A surface is an instance and a plane. A plane is a vector `m` in camera axes with `m . X = 1` for its
//! points `X`, so that the inverse depth along a ray is `w = m . r`. A background at infinity has `m = 0`. Each pixel
//! of a key frame shows a surface: its plane goes through the pixel's own point, with the slope of `w` to the left and
//! right neighbour, or above and below. Of the two differences the smaller counts; it is 0 where they disagree in sign
//! or where a neighbour is of another instance. A pixel without depth, of an instance without poses, or where the lens
//! shows nothing, shows no surface. Seen from the other key frame the plane is `m' = A m / (1 + (A m) . b)`, with `A`
//! and `b` from one key frame to the other.
//!
//! **Path.** A surface that pixel `x` shows at `a` is in key frame k where `A_k r + b_k w` is projected to. Here `w =
//! m_k . A_k r / (1 - m_k . b_k)` is the inverse depth at `a`. This is exact for a plane, at any speed. A surface with
//! `w < 0` is not before the camera.
//!
//! **Belonging.** A pixel of a key frame belongs to a surface if both have the same instance and `|w - m . r| P < `
//! [`BELONG_PX`], with the pixel's own `w` and `r`. `P` is the instance's **parallax**, the largest `f |b_k(a)|` at the
//! knots, but at least 1 (pixels for each unit of inverse depth; `f` is the mean of the two focal lengths): depths that
//! move alike need not be told apart. The knots are [`KNOTS`] instants from `a = 0` to 1, evenly spaced. Otherwise the
//! pixel is **nearer** than the surface if its `w` is larger, or else **farther**.
//!
//! **Candidates.** A pixel reads the surfaces that may show in its 8x8 block during the interval, and its own two.
//!
//! 1. Each block of each key frame, for each instance in it, has two surfaces: those of its nearest and of its farthest
//!    pixel. The first [`BLOCK_SURFACES`] count, from near to far.
//! 2. Such a surface is a candidate of every block that it passes: the square of its own block, displaced as its pixel
//!    is at one of the knots, lies within [`REACH_PX`] of the other block. Key frame 0 comes first, and blocks row by
//!    row.
//! 3. Two surfaces of one instance are one candidate if the paths of the block's centre along both differ by less than
//!    [`MERGE_PX`] on each axis at all knots. The first counts. A block has at most [`BLOCK_CANDIDATES`].
//! 4. A pixel's first candidates are the surfaces that it shows in key frames 0 and 1. If the two are one, by the path
//!    of the pixel, its position is the mean of both, by `1 - a` and `a`; so is its `w`. Then come the block's that are
//!    neither, by the same comparison, up to [`PIXEL_CANDIDATES`].
//!
//! **What a key frame knows.** At the position where key frame k is read, the four pixels around are weighed
//! bilinearly. `s` is the weight of those that belong to the candidate: it is seen. `h` is the weight of the nearer
//! ones and of those without a surface: it may be hidden. The rest is farther: it is not there.
//!
//! **Coverage.** With weights `u_0 = (1 - a) e_0` and `u_1 = a e_1`, where `e = max(1 - o, `[`EDGE_WEIGHT`]`)` and `o`
//! is how far the position lies outside the image, a candidate covers the pixel by `c = sum u s / sum u (1 - h)`: what
//! is hidden in one key frame is judged by the other. It is 0 where the candidate is hidden in both. Its level is `L =
//! sum u g E / sum u g`. Here `E` is the level that the key frame shows there. `g` is the weight of the pixels that
//! belong, where a pixel counts [`MIXED_WEIGHT`] times if one of the 3x3 around it is of another surface: at a
//! silhouette a pixel is a mixture of two surfaces, and what uncovers itself is seen unmixed in the other key frame.
//!
//! **Composite.** Candidates count from near to far, by `w` at `a`. Each takes `c` of what the nearer ones leave. The
//! mean of `exp(L)` by these shares is the pixel's `S + log_offset`. It is a mean in linear intensity, as a renderer's
//! antialiasing is, and it is continuous in time: a silhouette passes as a ramp, without events of its own.
//!
//! **Unseen.** Where the shares sum to less than [`UNSEEN_SHARE`], no key frame shows what is there. The pixel is then
//! blended as by `linear`, and counted. A pixel that shows no surface in either key frame has no candidates and no
//! path. It is blended as by `linear`, or takes `motion` where there are vectors, and is counted.
//!
//! **Half-pel frames.** Each key frame has one, as in [`synthesis`](super), but within surfaces: a sample between
//! pixels is *joined* if the pixels that it lies between belong to the surface of the first of them or have it belong
//! to theirs. It is interpolated with sixteen taps ([`CUBIC_FRAME`](super::CUBIC_FRAME)) and clamped to the range of
//! those pixels; taps of other surfaces count as the nearest of those. A sample that is not joined is their mean. The
//! transfers follow the path of each sample to the other key frame. Their confidence is 1 where the four inner taps
//! there are joined and belong, less how far the position lies outside the image; and for a sample between pixels the
//! smallest of its own and theirs.
//!
//! **Level.** `E` is read from the half-pel frame with sixteen taps ([`CUBIC_HALF_PEL`](super::CUBIC_HALF_PEL)),
//! clamped to the four inner ones, if these are joined and belong to the candidate; outer ones that are not count as
//! the inner tap nearest to them. Otherwise `E` is the mean of the pixels around that belong, weighed bilinearly.

pub use super::EDGE_WEIGHT;

/// Instants at which paths are compared. Between nine of them a shake at 25 Hz turns by less than a tenth of its
/// period in an interval at 30 Hz.
pub const KNOTS: usize = 9;

/// Displacement, pixels, up to which a difference of depth counts as one surface.
pub const BELONG_PX: f64 = 0.7;

/// Difference of two paths, pixels, up to which surfaces of one instance are one candidate.
pub const MERGE_PX: f64 = 0.7;

/// How near to a block a surface must pass to be its candidate, pixels.
pub const REACH_PX: f64 = 1.5;

/// Side of a block, pixels.
pub const BLOCK_PX: usize = 8;

/// Surfaces that a block hands on to the blocks that it passes.
pub const BLOCK_SURFACES: usize = 6;

/// Largest number of candidates of a block.
pub const BLOCK_CANDIDATES: usize = 12;

/// Largest number of candidates of a pixel.
pub const PIXEL_CANDIDATES: usize = 6;

/// Weight of a pixel at a silhouette, which is a mixture of two surfaces, against one inside a surface.
pub const MIXED_WEIGHT: f64 = 0.2;

/// Share of a pixel below which what it shows counts as unseen.
pub const UNSEEN_SHARE: f64 = 1e-3;
