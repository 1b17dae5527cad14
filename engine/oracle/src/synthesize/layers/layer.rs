//! A layer: a surface whose motion vectors are linear in the image.

use super::super::trajectory::outside_px;
use esaac_model::synthesis::is_usable;
use esaac_model::synthesis::layers::{
    BEND_PX, BEND_SHARE, LEAST_DETERMINANT, OUTSIDE_PX, SLOPE_REACH_PX, SMOOTH_PX, SNAP_SAMPLES, THICK_STEPS,
};
use glam::{DMat2, DVec2};

/// Motion vectors of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Vectors<'a> {
    /// Columns and rows.
    pub size: (usize, usize),
    /// Vector of each pixel, pixels; it may be non-finite.
    pub motion: &'a [[f64; 2]],
}

impl Vectors<'_> {
    /// The vector of a pixel; `None` if it is unusable or outside the image.
    #[must_use]
    pub fn at(&self, x: i64, y: i64) -> Option<DVec2> {
        let inside = x >= 0 && y >= 0 && x < self.size.0 as i64 && y < self.size.1 as i64;
        let vector = inside.then(|| self.motion[y as usize * self.size.0 + x as usize])?;
        is_usable(vector).then_some(DVec2::from(vector))
    }

    /// The pixel nearest to a position, and its vector.
    #[must_use]
    pub fn nearest(&self, at: DVec2) -> Option<(DVec2, DVec2)> {
        let pixel = nearest_pixel(at);
        Some((pixel, self.at(pixel.x as i64, pixel.y as i64)?))
    }

    /// Change of the vectors along an axis around a pixel, a pixel, and the number of steps that it is measured over.
    fn slope(&self, (x, y): (usize, usize), (dx, dy): (i64, i64)) -> (DVec2, i64) {
        let walk = |way: i64| {
            let mut steps = 0;
            let mut last = self.at(x as i64, y as i64).unwrap_or_default();
            while steps < SLOPE_REACH_PX as i64 {
                let to = (x as i64 + way * (steps + 1) * dx, y as i64 + way * (steps + 1) * dy);
                let Some(next) = self.at(to.0, to.1).filter(|next| largest(*next - last) <= SMOOTH_PX) else {
                    break;
                };
                (last, steps) = (next, steps + 1);
            }
            (last, steps)
        };
        let ((before, back), (after, on)) = (walk(-1), walk(1));
        let steps = back + on;
        (if steps < 2 { DVec2::ZERO } else { (after - before) / steps as f64 }, steps)
    }
}

/// A position on a row or column of half-pel samples if it is near one.
#[must_use]
pub fn snapped(at: DVec2) -> DVec2 {
    let half = 2.0 * at;
    let nearest = half.round();
    0.5 * DVec2::select((half - nearest).abs().cmple(DVec2::splat(SNAP_SAMPLES)), nearest, half)
}

/// The pixel nearest to a position. Half way between two, rounding does not decide.
#[must_use]
pub fn nearest_pixel(at: DVec2) -> DVec2 {
    (snapped(at) + 0.5).floor()
}

/// The larger component.
#[must_use]
pub fn largest(v: DVec2) -> f64 {
    v.abs().max_element()
}

/// A layer, given by a pixel that shows it in the frame at the interval's end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// The pixel.
    pub at: DVec2,
    /// Its vector.
    pub motion: DVec2,
    /// Change of the vector with the position.
    pub slopes: DMat2,
    /// The vector of its point in the frame at the start.
    pub before: DVec2,
    /// Change of that with the position there.
    pub slopes_before: DMat2,
    /// Curvature of its path.
    pub curvature: DVec2,
    /// From 0, one pixel wide, to 1.
    pub thickness: f64,
}

impl Layer {
    /// The layer of a pixel. `None` if its path is not known.
    #[must_use]
    pub fn new(end: &Vectors<'_>, start: Option<(&Vectors<'_>, f64)>, pixel: (usize, usize)) -> Option<Self> {
        let at = DVec2::new(pixel.0 as f64, pixel.1 as f64);
        let motion = end.at(pixel.0 as i64, pixel.1 as i64)?;
        let ((along_x, steps_x), (along_y, steps_y)) = (end.slope(pixel, (1, 0)), end.slope(pixel, (0, 1)));
        let thickness = steps_x.min(steps_y).min(THICK_STEPS) as f64 / THICK_STEPS as f64;
        let mut slopes = DMat2::from_cols(along_x, along_y);
        if (DMat2::IDENTITY + slopes).determinant() < LEAST_DETERMINANT {
            slopes = DMat2::ZERO;
        }
        let layer = Layer {
            at,
            motion,
            slopes,
            before: motion,
            slopes_before: slopes,
            curvature: DVec2::ZERO,
            thickness,
        };
        let Some((start, ratio)) = start else {
            return Some(Layer { curvature: 0.5 * (slopes * motion), ..layer });
        };
        let there = at + motion;
        if outside_px(end.size, there.to_array()) > OUTSIDE_PX {
            return None;
        }
        let steady = ratio * motion;
        let taps: Vec<(DVec2, f64)> = corners(end.size, there)
            .filter_map(|((x, y), weight)| Some((start.at(x, y)?, weight)))
            .filter(|&(_, weight)| weight > 0.0)
            .collect();
        let nearest = taps
            .iter()
            .map(|tap| tap.0)
            .min_by(|a, b| a.distance_squared(steady).total_cmp(&b.distance_squared(steady)))?;
        let alike = |tap: &&(DVec2, f64)| largest(tap.0 - nearest) <= SMOOTH_PX;
        let weights: f64 = taps.iter().filter(alike).map(|tap| tap.1).sum();
        let off: DVec2 = taps.iter().filter(alike).map(|tap| (tap.0 - nearest) * tap.1).sum();
        let before = nearest + off / weights;
        if (before - steady).length() > BEND_PX + BEND_SHARE * steady.length() {
            return None;
        }
        let curvature = (before - steady) / (ratio * (1.0 + ratio));
        Some(Layer { before, slopes_before: ratio * slopes, curvature, ..layer })
    }

    /// Its vector at a position in the frame at the end.
    #[must_use]
    pub fn motion_at(&self, at: DVec2) -> DVec2 {
        self.motion + self.slopes * (at - self.at)
    }

    /// Its vector at a position in the frame at the start, over the interval before.
    #[must_use]
    pub fn before_at(&self, at: DVec2) -> DVec2 {
        self.before + self.slopes_before * (at - self.at - self.motion)
    }

    /// Where the point that lies at `at` at `fraction` of the interval is in the frames at the start and at the end.
    #[must_use]
    pub fn sources(&self, at: DVec2, fraction: f64) -> [DVec2; 2] {
        let t = fraction - 1.0;
        let along = at - self.at + t * self.motion - (t + t * t) * self.curvature;
        let from = (DMat2::IDENTITY - t * self.slopes).inverse() * along;
        let in_end = self.at + from;
        [in_end + self.motion + self.slopes * from, in_end]
    }
}

/// The four pixels around a position, which is clamped to the image, with their bilinear weights.
pub fn corners((width, height): (usize, usize), at: DVec2) -> impl Iterator<Item = ((i64, i64), f64)> {
    let last = DVec2::new((width - 1) as f64, (height - 1) as f64);
    let inside = at.clamp(DVec2::ZERO, last);
    let low = inside.floor();
    let f = inside - low;
    let (x, y) = (low.x as i64, low.y as i64);
    let (x1, y1) = ((x + 1).min(width as i64 - 1), (y + 1).min(height as i64 - 1));
    [
        ((x, y), (1.0 - f.x) * (1.0 - f.y)),
        ((x1, y), f.x * (1.0 - f.y)),
        ((x, y1), (1.0 - f.x) * f.y),
        ((x1, y1), f.x * f.y),
    ]
    .into_iter()
}
