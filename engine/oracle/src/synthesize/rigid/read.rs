//! Reading a key frame for a surface: how much of it is seen at a position, and its level there.

use super::surface::{Relation, Surfaces};
use crate::synthesize::taps::cubic;
use crate::synthesize::trajectory::outside_px;
use esaac_model::Taps;
use esaac_model::synthesis::CUBIC_HALF_PEL;
use esaac_model::synthesis::rigid::{MIXED_WEIGHT, SLIGHT_WEIGHT, SNAP_SAMPLES};
use glam::{DVec2, DVec3};

/// A surface as a key frame sees it.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Its instance.
    pub id: u32,
    /// Its plane, camera axes of the key frame.
    pub plane: DVec3,
    /// The instance's parallax, pixels for each unit of inverse depth.
    pub parallax_px_m: f64,
}

/// What a key frame knows of a surface at a position: weights of the four pixels around.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shares {
    /// Of those that belong.
    pub seen: f64,
    /// Of those that may hide it.
    pub hidden: f64,
    /// Of those that belong, less where they may hold a mixture.
    pub trust: f64,
}

/// A key frame as it is read.
#[derive(Clone, Debug)]
pub struct KeyFrame {
    /// Its surfaces.
    pub surfaces: Surfaces,
    /// Whether the 3x3 pixels around each continue its surface.
    pub pure: Vec<bool>,
    /// Whether the 5x5 pixels around each do.
    pub inner: Vec<bool>,
    /// Whether each half-pel sample lies between pixels that continue the surface of the first of them.
    pub joined: Vec<bool>,
}

/// The four samples around a position, with bilinear weights: positions are clamped to the image.
pub struct Cell {
    first: [usize; 2],
    fraction: [f64; 2],
    size: (usize, usize),
}

impl Cell {
    /// The cell of a position in samples.
    #[must_use]
    pub fn new(size: (usize, usize), at: DVec2) -> Self {
        let on_axis = |at: f64, size: usize| {
            let at = at.clamp(0.0, (size - 1) as f64);
            let first = (at as usize).min(size.saturating_sub(2));
            (first, at - first as f64)
        };
        let ((x, fx), (y, fy)) = (on_axis(at.x, size.0), on_axis(at.y, size.1));
        Cell { first: [x, y], fraction: [fx, fy], size }
    }

    /// The four samples and their weights.
    fn corners(&self) -> [(usize, f64); 4] {
        let [fx, fy] = self.fraction;
        let sample = |i: usize, j: usize| {
            let (x, y) = (self.first[0] + i, self.first[1] + j);
            y.min(self.size.1 - 1) * self.size.0 + x.min(self.size.0 - 1)
        };
        [
            (sample(0, 0), (1.0 - fx) * (1.0 - fy)),
            (sample(1, 0), fx * (1.0 - fy)),
            (sample(0, 1), (1.0 - fx) * fy),
            (sample(1, 1), fx * fy),
        ]
    }
}

impl Cell {
    /// Those of the four samples whose row and column weigh more than slightly.
    fn needed(&self) -> impl Iterator<Item = usize> {
        let weighs = |fraction: f64| [fraction < 1.0 - SLIGHT_WEIGHT, fraction > SLIGHT_WEIGHT];
        let ([columns, rows], corners) = (self.fraction.map(weighs), self.corners());
        (0..4).filter(move |i| columns[i % 2] && rows[i / 2]).map(move |i| corners[i].0)
    }
}

impl KeyFrame {
    /// Prepares a key frame.
    #[must_use]
    pub fn new(surfaces: Surfaces) -> Self {
        let (width, height) = surfaces.size;
        let within = |reach: usize| -> Vec<bool> {
            (0..width * height)
                .map(|pixel| {
                    let (x, y) = (pixel % width, pixel / width);
                    let columns = x.saturating_sub(reach)..=(x + reach).min(width - 1);
                    (y.saturating_sub(reach)..=(y + reach).min(height - 1))
                        .all(|ny| columns.clone().all(|nx| surfaces.continues(pixel, ny * width + nx)))
                })
                .collect()
        };
        let (pure, inner) = (within(1), within(2));
        let joined = (0..4 * width * height)
            .map(|sample| {
                let first = parent((width, height), sample);
                parents((width, height), sample).all(|parent| surfaces.continues(first, parent))
            })
            .collect();
        KeyFrame { surfaces, pure, inner, joined }
    }

    /// Whether a pixel belongs to a surface.
    #[must_use]
    pub fn belongs(&self, pixel: usize, seen: &Seen) -> bool {
        self.surfaces.relation(pixel, seen.id, seen.plane, seen.parallax_px_m) == Relation::Belongs
    }

    /// Whether the pixel nearest to a position belongs to a surface, and so does all around it.
    #[must_use]
    pub fn is_inner(&self, at: DVec2, surface: &Seen) -> bool {
        let size = self.surfaces.size;
        let last = DVec2::new((size.0 - 1) as f64, (size.1 - 1) as f64);
        let nearest = (at.clamp(DVec2::ZERO, last) + 0.5).floor();
        let pixel = nearest.y as usize * size.0 + nearest.x as usize;
        self.inner[pixel] && self.belongs(pixel, surface)
    }

    /// What is known of a surface at a position, pixels.
    #[must_use]
    pub fn shares(&self, at: DVec2, surface: &Seen) -> Shares {
        let at = 0.5 * snapped(2.0 * at);
        if self.is_inner(at, surface) {
            return Shares { seen: 1.0, hidden: 0.0, trust: 1.0 };
        }
        let mut shares = Shares::default();
        for (pixel, weight) in Cell::new(self.surfaces.size, at).corners() {
            match self.surfaces.relation(pixel, surface.id, surface.plane, surface.parallax_px_m) {
                Relation::Belongs => {
                    shares.seen += weight;
                    shares.trust += if self.pure[pixel] { weight } else { MIXED_WEIGHT * weight };
                }
                Relation::Hides => shares.hidden += weight,
                Relation::Farther => {}
            }
        }
        shares
    }

    /// Level of a surface at a position from a half-pel frame, nepers. `None` if not all of the four samples around
    /// show it.
    #[must_use]
    pub fn half_pel_level(&self, half_pel: &[f64], at: DVec2, surface: &Seen) -> Option<f64> {
        let size = self.surfaces.size;
        let samples = (2 * size.0, 2 * size.1);
        let usable = |sample: usize| self.joined[sample] && self.belongs(parent(size, sample), surface);
        let place = snapped(2.0 * at);
        let shows_it = || Cell::new(samples, place).needed().all(usable);
        (self.is_inner(0.5 * place, surface) || shows_it())
            .then(|| cubic(half_pel, samples, place.x, place.y, CUBIC_HALF_PEL, true))
    }

    /// Level at a position, nepers, of whatever is there.
    #[must_use]
    pub fn any_level(&self, half_pel: &[f64], taps: Taps, at: DVec2) -> f64 {
        let size = self.surfaces.size;
        let place = snapped(2.0 * at);
        match taps {
            Taps::Cubic => cubic(half_pel, (2 * size.0, 2 * size.1), place.x, place.y, CUBIC_HALF_PEL, true),
            Taps::Bilinear => {
                let corners = Cell::new(size, 0.5 * place).corners();
                corners.iter().map(|&(pixel, weight)| weight * half_pel[pixel_sample(size, pixel)]).sum()
            }
        }
    }

    /// Level of a surface at a position, nepers; with bilinear taps, from the frame's pixels alone. `None` if none of the
    /// four pixels around shows it.
    #[must_use]
    pub fn level(&self, half_pel: &[f64], taps: Taps, at: DVec2, surface: &Seen) -> Option<f64> {
        let between = (taps == Taps::Cubic).then(|| self.half_pel_level(half_pel, at, surface)).flatten();
        between.or_else(|| {
            let (size, at) = (self.surfaces.size, 0.5 * snapped(2.0 * at));
            let inner = self.is_inner(at, surface);
            let (mut sum, mut weights) = (0.0, 0.0);
            for (pixel, weight) in Cell::new(size, at).corners() {
                if weight > 0.0 && (inner || self.belongs(pixel, surface)) {
                    sum += weight * half_pel[pixel_sample(size, pixel)];
                    weights += weight;
                }
            }
            (weights > 0.0).then(|| sum / weights)
        })
    }

    /// How far a position lies outside the image, pixels.
    #[must_use]
    pub fn outside_px(&self, at: DVec2) -> f64 {
        outside_px(self.surfaces.size, at.to_array())
    }
}

/// A position in half-pel samples, on a row or column of them if it is near one.
fn snapped(at: DVec2) -> DVec2 {
    let nearest = at.round();
    DVec2::select((at - nearest).abs().cmple(DVec2::splat(SNAP_SAMPLES)), nearest, at)
}

/// The half-pel sample at a pixel.
#[must_use]
pub fn pixel_sample(size: (usize, usize), pixel: usize) -> usize {
    let (x, y) = (pixel % size.0, pixel / size.0);
    2 * y * 2 * size.0 + 2 * x
}

/// The pixel that a half-pel sample lies at, or right or below of.
#[must_use]
pub fn parent(size: (usize, usize), sample: usize) -> usize {
    let (x, y) = (sample % (2 * size.0), sample / (2 * size.0));
    y / 2 * size.0 + x / 2
}

/// The pixels that a half-pel sample lies between, clamped to the image.
pub fn parents(size: (usize, usize), sample: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (sample % (2 * size.0), sample / (2 * size.0));
    (y / 2..=y.div_ceil(2)).flat_map(move |row| {
        (x / 2..=x.div_ceil(2)).map(move |column| row.min(size.1 - 1) * size.0 + column.min(size.0 - 1))
    })
}

/// Position of a half-pel sample, pixels.
#[must_use]
pub fn sample_position(size: (usize, usize), sample: usize) -> DVec2 {
    0.5 * DVec2::new((sample % (2 * size.0)) as f64, (sample / (2 * size.0)) as f64)
}
