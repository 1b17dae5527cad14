//! Temporal detail transfer: takes detail from one frame's half-pel frame to the other's.

use super::half_pel::HalfPelFrame;
use super::taps::bilinear;
use super::trajectory::{Field, Warp, outside_px};
use esaac_model::synthesis::is_usable;
use esaac_model::synthesis::{CONFIDENCE_PX, LEADING_BACK};

/// Direction in which a frame looks for detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// The end looks in the start: a forward transfer.
    ToStart,
    /// The start looks in the end: the backward transfer.
    ToEnd,
}

impl Way {
    fn displacement(self, warp: &Warp) -> [f64; 2] {
        match self {
            Way::ToStart => warp.end.motion,
            Way::ToEnd => warp.start.motion.map(|m| -m),
        }
    }
}

/// For each half-pel sample of a frame, its displacement to the other frame and the confidence in the detail there.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// Whether a pixel and its half-pel samples are read from one footprint.
    shares_footprint: bool,
    /// Displacements to the other frame, pixels.
    shift: Vec<[f64; 2]>,
    /// Confidence in the other frame, 0 to 1.
    confidence: Vec<f64>,
}

impl Route {
    /// The route of a frame of `size` pixels, given the motion of the frame at the interval's end. `shares_footprint`: whether
    /// a pixel and its half-pel samples are read from one footprint, as in the first transfer.
    #[must_use]
    pub fn new(
        size: (usize, usize),
        motion: &[[f64; 2]],
        warps: &[Warp],
        way: Way,
        shares_footprint: bool,
    ) -> Self {
        let displacement: [Vec<f64>; 2] =
            [0, 1].map(|axis| warps.iter().map(|warp| way.displacement(warp)[axis]).collect());
        let pixel_confidence = confidence(size, motion, warps, way);
        let (shift, confidence) = (0..4 * size.0 * size.1)
            .map(|entry| {
                let (x, y) = (0.5 * (entry % (2 * size.0)) as f64, 0.5 * (entry / (2 * size.0)) as f64);
                let read = |plane: &[f64]| bilinear(plane, size, x, y);
                ([read(&displacement[0]), read(&displacement[1])], read(&pixel_confidence))
            })
            .unzip();
        Route { shares_footprint, shift, confidence }
    }
}

/// Confidence of each pixel in the detail at its position in the other frame, 0 to 1.
fn confidence(size: (usize, usize), motion: &[[f64; 2]], warps: &[Warp], way: Way) -> Vec<f64> {
    let last = [size.0 - 1, size.1 - 1].map(|last| last as f64);
    let field = Field::new(size, motion);
    (0..size.0 * size.1)
        .map(|pixel| {
            let (x, y) = (pixel % size.0, pixel / size.0);
            let shift = way.displacement(&warps[pixel]);
            let there = [x as f64 + shift[0], y as f64 + shift[1]];
            let mut apart_px = disagreement_px(size, motion, x, y);
            if way == Way::ToEnd {
                let [u, v] = [0, 1].map(|axis| (there[axis].clamp(0.0, last[axis]) + 0.5).floor() as usize);
                let back = field.at(there);
                let astray_px = [0, 1].map(|axis| (back[axis] + shift[axis]).abs());
                apart_px = apart_px
                    .max(disagreement_px(size, motion, u, v))
                    .max(LEADING_BACK * astray_px[0].max(astray_px[1]));
            }
            let inside = (1.0 - outside_px(size, there)).max(0.0);
            (2.0 - apart_px / CONFIDENCE_PX).clamp(0.0, 1.0) * inside
        })
        .collect()
}

/// Largest difference of a component of a pixel's vector to that of one of the 3x3 pixels around; infinite if one of them
/// has no usable vector.
fn disagreement_px(size: (usize, usize), motion: &[[f64; 2]], x: usize, y: usize) -> f64 {
    let own = motion[y * size.0 + x];
    let mut apart_px = 0.0_f64;
    for ny in y.saturating_sub(1)..=(y + 1).min(size.1 - 1) {
        for nx in x.saturating_sub(1)..=(x + 1).min(size.0 - 1) {
            let other = motion[ny * size.0 + nx];
            if !is_usable(own) || !is_usable(other) {
                return f64::INFINITY;
            }
            apart_px = apart_px.max((other[0] - own[0]).abs()).max((other[1] - own[1]).abs());
        }
    }
    apart_px
}

/// The half-pel frame of `frame` with the detail of `other`, the other frame's half-pel frame. Where confidence falls
/// it blends towards `alone`.
#[must_use]
pub fn transfer(
    size: (usize, usize),
    frame: &[f64],
    alone: &HalfPelFrame,
    other: &HalfPelFrame,
    route: &Route,
) -> HalfPelFrame {
    let entry = |x: usize, y: usize| y * 2 * size.0 + x;
    let seen = |x: usize, y: usize| {
        let shift = route.shift[entry(x, y)];
        if route.shares_footprint {
            let own_shift = route.shift[entry(x & !1, y & !1)];
            other.shared_footprint([x / 2, y / 2], own_shift, [x & 1, y & 1], shift)
        } else {
            other.at([0.5 * x as f64 + shift[0], 0.5 * y as f64 + shift[1]], [x / 2, y / 2])
        }
    };
    let residual: Vec<f64> = (0..size.0 * size.1)
        .map(|pixel| frame[pixel] - seen(2 * (pixel % size.0), 2 * (pixel / size.0)))
        .collect();
    HalfPelFrame::new(size, other.sampling(), frame, |x, y| {
        let confidence = route.confidence[entry(x, y)];
        let correction = bilinear(&residual, size, 0.5 * x as f64, 0.5 * y as f64);
        confidence * (seen(x, y) + correction) + (1.0 - confidence) * alone.entry(x, y)
    })
}

#[cfg(test)]
mod tests {
    use super::super::sampling::Sampling;
    use super::*;

    const SIZE: (usize, usize) = (6, 5);

    #[test]
    fn motion_that_differs_between_neighbours_is_not_trusted() {
        let mut motion = vec![[0.0; 2]; 30];
        motion[2 * 6 + 2] = [0.0, 0.75];
        motion[4 * 6 + 5] = [f64::NAN, 0.0];
        let confidence = confidence(SIZE, &motion, &[Warp::default(); 30], Way::ToStart);
        assert_eq!(
            (confidence[0], confidence[6 + 1], confidence[2 * 6 + 2], confidence[3 * 6 + 3]),
            (1.0, 0.5, 0.5, 0.5)
        );
        assert_eq!((confidence[3 * 6 + 4], confidence[4 * 6 + 5]), (0.0, 0.0));
    }

    #[test]
    fn the_start_asks_the_vectors_where_it_leads_to() {
        // Where the pixel leads to, one of the vectors around is another; then its own leads elsewhere.
        let size = (8, 5);
        let to_the_right = |motion: &[[f64; 2]]| {
            let mut warp = Warp::default();
            warp.start.motion = [-3.0, 0.0];
            confidence(size, motion, &[warp; 40], Way::ToEnd)
        };
        let mut motion = vec![[-3.0, 0.0]; 40];
        assert_eq!(to_the_right(&motion)[2 * 8 + 1], 1.0);
        motion[8 + 5] = [-3.0, 0.75];
        let asked = to_the_right(&motion);
        assert_eq!((asked[2 * 8], asked[2 * 8 + 1], asked[2 * 8 + 3]), (1.0, 0.5, 0.5));
        motion[8 + 5] = [f64::NAN, 0.0];
        assert_eq!(to_the_right(&motion)[2 * 8 + 1], 0.0);
        let astray = vec![[-3.375, 0.0]; 40];
        assert_eq!(to_the_right(&astray)[2 * 8 + 1], 0.5);
    }

    #[test]
    fn a_place_outside_the_image_is_not_trusted() {
        let motion = vec![[-0.5, 0.0]; 30];
        let mut warp = Warp::default();
        warp.end.motion = [-0.5, 0.0];
        let confidence = confidence(SIZE, &motion, &[warp; 30], Way::ToStart);
        assert_eq!((confidence[0], confidence[1]), (0.5, 1.0));
    }

    #[test]
    fn untrusted_entries_stay_and_pixels_are_the_frame() {
        let frame: Vec<f64> = (0..30).map(|i| f64::from(i * i % 7)).collect();
        let alone = HalfPelFrame::of_frame(SIZE, Sampling::ENGINE, &frame);
        let other = HalfPelFrame::new(SIZE, Sampling::ENGINE, &[9.0; 30], |_, _| 4.0);
        let route = |v: [f64; 2]| Route::new(SIZE, &[v; 30], &[Warp::default(); 30], Way::ToEnd, false);
        assert_eq!(transfer(SIZE, &frame, &alone, &other, &route([f64::NAN; 2])), alone);
        let got = transfer(SIZE, &frame, &alone, &other, &route([0.0; 2]));
        assert_eq!(got.entry(4, 2), frame[6 + 2]);
        assert_ne!(got.entry(5, 2), alone.entry(5, 2));
    }
}
