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
//! or where a neighbour is of another instance. A pixel at the image's border has the differences of the pixel beside it.
//! The slope is kept as a fraction of `w`, rounded to f16, and holds for the
//! tangents (pinhole) or the angles (fisheye) that the lens maps to pixels. A pixel without depth, of an instance
//! without poses, or where the lens shows nothing, shows no surface. Seen from the other key frame the plane is `m' =
//! A m / (1 + (A m) . b)`, with `A` and `b` from one key frame to the other.
//!
//! **Path.** The surface of plane `m` (axes of key frame 0) that pixel `x` shows at `a` has the inverse depth `w = m .
//! A_0 r / (1 - m . b_0)` there. In key frame k it is where `A_k r + b_k w` is projected to. This is exact for a plane,
//! at any speed. A surface with `w < 0` is not before the camera.
//!
//! **Belonging.** A pixel of a key frame belongs to a surface if both have the same instance and `|w - m . r| P < `
//! [`BELONG_PX`], with the pixel's own `w` and `r`. `P` is the instance's **parallax**, the largest `f |b_k(a)|` at the
//! knots, but at least 1 (pixels for each unit of inverse depth; `f` is the mean of the two focal lengths): depths that
//! move alike need not be told apart. The knots are [`KNOTS`] instants from `a = 0` to 1, evenly spaced. Otherwise the
//! pixel is **nearer** than the surface if its `w` is larger, or else **farther**.
//!
//! A pixel **continues** the surface of another one of its key frame if both have the same instance and `|w - m . r| `
//! [`LEAST_MOTION_PX`]` <= `[`BELONG_PX`]` w`, with `m` of the other. A pixel at infinity continues only others there: of a
//! plane that comes to `w = 0` just at it, rounding would decide. This is known before the motion that follows the
//! key frame. A pixel is **pure** if the 3x3 pixels around it continue its surface, and **inner** if the 5x5 do.
//!
//! **Candidates.** A pixel reads the surfaces that may show in its 8x8 block during the interval, and its own two.
//!
//! 1. Each block of each key frame, for each instance in it, has two surfaces: those of its nearest and of its farthest
//!    pixel. The first [`BLOCK_SURFACES`] count, from near to far.
//! 2. Such a surface passes a block if the square of its own block, displaced as its pixel is at one of the knots or on the
//!    straight line from one to the next, lies within [`REACH_PX`] of the other block. It is a candidate there if its own block has a silhouette, a pixel that
//!    is not inner: only at silhouettes can anything come into view that neither key frame shows in the pixel. Key frame
//!    0 comes first, and blocks row by row.
//! 3. Two surfaces of one instance are one candidate along a ray if `|m . r - m' . r| P < `[`MERGE_PX`] for their planes
//!    `m` and `m'` in the axes of both key frames. Along the ray of the block's centre the first counts. A block has at
//!    most [`BLOCK_CANDIDATES`].
//! 4. A pixel's first candidates are the surfaces that it shows in key frames 0 and 1. If the two are one along its ray,
//!    the plane at `a` is the mean of both by `1 - a` and `a`, in the axes of each key frame. Then come the block's that
//!    are neither, by the same comparison, up to [`PIXEL_CANDIDATES`].
//!
//! **Unoccluded.** Most pixels show one surface all the time, and nothing passes before it. A pixel is
//! unoccluded if the surfaces that it shows in the key frames are one, or it shows one in one of them only, and if its
//! block has no candidates: no silhouette passes. In a block that has some it is looked at. The interval is cut into legs in
//! which the block moves [`LEG_PX`] at most ([`legs`]), and in the middle of each leg the pixels nearest to a candidate's
//! positions in both key frames must be inner: for the pixel's own candidate they must belong, and for each nearer one they
//! must not. An unoccluded pixel reads its own candidate alone, and `L = sum u E / sum u`, with weights `u` and levels `E`
//! as below. All that it reads lies inside one surface, so this is what coverage and composite would give, but for the
//! weight of pixels that are not pure.
//!
//! **What a key frame knows.** A position within [`SNAP_SAMPLES`] of a row or column of half-pel samples counts as on
//! it. If the pixels that the position lies between continue the surface of the nearest of them, this one speaks for all:
//! either it belongs, `s = 1`, or it is nearer or shows no surface, `h = 1`, or it is farther. Otherwise the four pixels
//! are weighed bilinearly. `s` is the weight of those that belong to the candidate: it is seen. `h` is the weight of the
//! nearer ones and of those without a surface: it may be hidden. The rest is farther: it is not there.
//!
//! Renderers mix the colours of what meets in a pixel, so a surface shows beyond the pixels that belong to it. The
//! **front** of a pixel is, of those of the eight pixels around that do not continue its surface, the one of the largest
//! `w`, if that is larger than the pixel's own; of equals the first row by row. A pixel without a surface counts as nearest
//! of all. A farther pixel whose front belongs to the candidate is in its **fringe**, and `f` is the weight of those. Where
//! the nearest pixel speaks for all and is farther, and one that the position lies between is not pure, the four count as
//! farther and are asked for their fronts. A surface is **thick** at a pixel if some 3x3 pixels that hold the pixel
//! continue its surface, and [`HALF_THICK`] if some 2x2 pixels do; beyond the image its border goes on. `t` is the weight of
//! the pixels that belong, and of those in the fringe, each by how thick the surface is at the pixel or at its front.
//!
//! **Coverage.** With weights `u_0 = (1 - a) e_0` and `u_1 = a e_1`, where `e = max(1 - o, `[`EDGE_WEIGHT`]`)` and `o`
//! is how far the position lies outside the image, a candidate covers the pixel by `c = sum u s / sum u (1 - h)`: what
//! is hidden in one key frame is judged by the other. It is 0 where the candidate is hidden in both. Its level is `L =
//! sum u g E / sum u g`. Here `E` is the level that the key frame shows there. `g` is the weight of the pixels that
//! belong, where a pixel that is not pure counts [`MIXED_WEIGHT`] times: at a silhouette a pixel is a mixture of two
//! surfaces, and what uncovers itself is seen unmixed in the other key frame. Where the nearest pixel speaks for all, a
//! pixel beside it counts as pure if the 3x3 pixels around that continue the nearest one's surface.
//!
//! **Composite.** Candidates count from near to far, by `w` in the middle of the interval: rigid surfaces hardly change
//! places along a ray within it, and one that is not there is not shown. Each takes `c` of what the nearer ones leave.
//! The mean of `exp(L)` by these shares is the pixel's `S + log_offset`. It is a mean in linear intensity, as a
//! renderer's antialiasing is, and it is continuous in time: a silhouette passes as a ramp, without events of its own.
//!
//! **Silhouettes.** A candidate covers `c` of the pixel and reaches into `e = sum u (s + f) / sum u (1 - h)` of it, at most
//! 1; with `e = 0` it does not show. Where the nearest one that shows covers the pixel in part, by `c < 1 -
//! `[`SLIGHT_WEIGHT`], its silhouette passes. The mixture is then also known as it is: `R` is read at the candidate's
//! positions in the half-pel frames, whatever surfaces the taps are of: the mean in log by `u (1 - h)`. It holds another
//! background than the pixel's. `H` is the composite of the other candidates, and `B` what the key frames show behind the
//! silhouette at its positions: the mean by `u (1 - h)` of `exp` of the level of the farther pixels around, or `H` in a key
//! frame that shows none. The pixel is `e (v R + (1 - v) (c exp(L) + (1 - c) H)) + (1 - e) H` with `v = 1 - d min(|ln(H /
//! B)| / `[`BACKGROUND_LOG`]`, 1)`: the more alike both backgrounds are, the more the mixture counts. `d = sum u t / sum u
//! (s + f)` tells how thick the surface is there: of what is thin no pixel shows the colour unmixed, so there is nothing to
//! make a composite of. Without other candidates that show, the pixel is `R`.
//!
//! **Unseen.** Where the shares sum to less than [`UNSEEN_SHARE`], no key frame shows what is there. The pixel then
//! takes the level of its farthest candidate at the nearest pixels that belong to it, in the row and the column of its
//! rounded position in both key frames, at most [`UNSEEN_REACH_PX`] away. The equally near ones count by `1 - a` in key
//! frame 0 and by `a` in key frame 1. It is counted.
//!
//! **The instance of an event.** An event shows what is nearest in its pixel at its time, `a`. Candidates are the
//! pixel's own surfaces and all of its block. One is there if in a key frame, at its position, the pixels that belong to it
//! weigh more than [`EVENT_ID_WEIGHT`] bilinearly; more than half a pixel outside the image it is not. Of those that are
//! there the one of the largest `w` along the pixel's ray at `a` counts; if none is, the farthest of all. So events of a
//! silhouette are those of what is in front, whose motion sends them. A single candidate needs no such look, and a pixel
//! without a surface of its own tells nothing. An event that a sensor stamps late counts at its stamp.
//!
//! **Without a path.** A pixel that shows no surface in either key frame has no candidates and no path; so has an unseen
//! one without a background nearby. It follows its motion vector as by `motion`, in the half-pel frames below. Without a
//! vector it is blended as by `linear`. It is counted.
//!
//! **Half-pel frames.** Each key frame has one. From the frame alone it is that of [`synthesis`](super). A sample between
//! pixels is *joined* if the pixels that it lies between continue the surface of the first of them. The transfers
//! follow the path of each joined sample to the other key frame; the others stay as they are. The confidence is 1 where
//! `E` there is read from the half-pel frame, less how far the position lies outside the image; and for a sample between
//! pixels the smallest of its own and theirs. The backward transfer trusts only what lies between pure pixels of key
//! frame 1: beside a silhouette those of both key frames are mixed with different backgrounds.
//!
//! **Level.** `E` is read from the half-pel frame as in [`synthesis`](super), with twelve taps, where the nearest
//! pixel speaks for all. Outer taps may be of other surfaces: the clamp bounds what they do. Otherwise `E` is the mean of
//! the pixels around that belong, weighed bilinearly. With bilinear taps there are no half-pel frames: `E` is that mean
//! everywhere, of all four where the nearest speaks for all.
//!
//! **Sub-steps.** The motion of a block is the longest way of the surfaces that pass it: the sum of their displacements
//! from knot to knot, each as its pixel is displaced; 0 if that is less than [`REST_PX`]. A camera that shakes may end
//! where it began. A block without silhouettes needs less where its texture is smooth
//! ([`motion_on_way_px`](crate::substeps::motion_on_way_px)). Motion vectors in and around the block count only where
//! their frame shows no surface ([`substep_count`](crate::substeps::substep_count)).

pub use super::EDGE_WEIGHT;

/// Instants at which paths are followed from block to block; between them ways are straight lines. Between nine of them a shake at 25 Hz turns by less than a
/// tenth of its period in an interval at 30 Hz.
pub const KNOTS: usize = 9;

/// Displacement, pixels, up to which a difference of depth counts as one surface.
pub const BELONG_PX: f64 = 0.7;

/// Displacement, pixels, up to which a difference of depth counts as one candidate.
pub const MERGE_PX: f64 = 0.7;

/// How near to a block a surface must pass to be its candidate, pixels.
pub const REACH_PX: f64 = 1.5;

/// Instants at which the host gives the poses of an interval, evenly spaced from its start to its end. Those of
/// sub-steps are interpolated from six of them each. Every fourth is a knot.
pub const POSE_INSTANTS: usize = 33;

/// How near to rest a motion between two instants counts as none: rounding of poses in f64, radians and metres.
pub const POSE_REST: f64 = 1e-9;

/// Motion, pixels, below which a surface counts as at rest: rounding.
pub const REST_PX: f64 = 1e-3;

/// Share of a pixel that counts as none: rounding decides on it.
pub const SLIGHT_WEIGHT: f64 = 1e-3;

/// How near a row or column of half-pel samples a position counts as on it, samples. What is hidden changes there, and
/// the range that a level is clamped to: rounding would decide on which side a position falls that does not move across.
pub const SNAP_SAMPLES: f64 = 0.002;

/// Motion, pixels, by which it is told whether neighbouring pixels show one surface. It is told when a key frame comes,
/// before the motion that follows it is known.
pub const LEAST_MOTION_PX: f64 = 8.0;

/// Longest leg of an interval, pixels: inside surfaces, a look in the middle of it tells what is shown all along it.
pub const LEG_PX: f64 = 2.0;

/// Most legs. In the middle of each is an instant at which the host gives poses.
pub const MOST_LEGS: u32 = (POSE_INSTANTS as u32 - 1) / 2;

/// Legs into which an interval is cut in which the surfaces that pass a block move `motion_px`. `None` if it needs more than
/// [`MOST_LEGS`].
#[must_use]
pub fn legs(motion_px: f64) -> Option<u32> {
    let is_enough = |legs: &u32| f64::from(*legs) * LEG_PX >= motion_px;
    std::iter::successors(Some(1), |legs| Some(2 * legs))
        .take_while(|legs| *legs <= MOST_LEGS)
        .find(is_enough)
}

/// Side of a block, pixels.
pub const BLOCK_PX: usize = 8;

/// Surfaces that a block hands on to the blocks that it passes.
pub const BLOCK_SURFACES: usize = 6;

/// Largest number of candidates of a block.
pub const BLOCK_CANDIDATES: usize = 12;

/// Largest number of candidates of a pixel.
pub const PIXEL_CANDIDATES: usize = 6;

/// A surface is in an event's pixel if those of the four pixels around its position that belong weigh more than this.
pub const EVENT_ID_WEIGHT: f64 = 0.15;

/// Difference of the background here from that in the key frames, nepers, at which a silhouette's mixture does not count.
pub const BACKGROUND_LOG: f64 = 0.5;

/// How thick a surface counts, of 1, where 2x2 pixels continue it and no 3x3 do.
pub const HALF_THICK: f64 = 0.5;

/// Weight of a pixel at a silhouette, which is a mixture of two surfaces, against one inside a surface.
pub const MIXED_WEIGHT: f64 = 0.2;

/// Share of a pixel below which what it shows counts as unseen.
pub const UNSEEN_SHARE: f64 = 1e-3;

/// How far the background beside what is unseen is looked for, pixels.
pub const UNSEEN_REACH_PX: u32 = 16;
