//! Reading a key frame for a surface: how much of it is seen at a position, and its level there.

use super::surface::{Element, Relation, Surfaces};
use crate::synthesize::trajectory::outside_px;
use esaac_model::synthesis::rigid::MIXED_WEIGHT;
use esaac_model::synthesis::{CUBIC_FRAME, CUBIC_HALF_PEL, cubic_weights};
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
    /// Whether each pixel and those around it belong to one surface.
    pub pure: Vec<bool>,
    /// Whether each half-pel sample lies between pixels of one surface.
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

    /// The sample `(i - 1, j - 1)` from the first, clamped to the image.
    fn sample(&self, i: usize, j: usize) -> usize {
        let on_axis = |first: usize, i: usize, size: usize| (first + i).saturating_sub(1).min(size - 1);
        on_axis(self.first[1], j, self.size.1) * self.size.0 + on_axis(self.first[0], i, self.size.0)
    }

    /// The four samples and their weights.
    fn corners(&self) -> [(usize, f64); 4] {
        let [fx, fy] = self.fraction;
        [
            (self.sample(1, 1), (1.0 - fx) * (1.0 - fy)),
            (self.sample(2, 1), fx * (1.0 - fy)),
            (self.sample(1, 2), (1.0 - fx) * fy),
            (self.sample(2, 2), fx * fy),
        ]
    }

    /// Keys' interpolation over sixteen taps, clamped to the range of the inner four, or of the two or one that the
    /// position lies between. A tap that `usable` refuses counts as the inner one nearest to it. `None` if it refuses
    /// an inner one.
    #[must_use]
    pub fn cubic(&self, values: &[f64], parameter: f64, usable: impl Fn(usize) -> bool) -> Option<f64> {
        // On a row or a column of samples, the next one does not count.
        let [last_column, last_row] = self.fraction.map(|fraction| if fraction > 0.0 { 2 } else { 1 });
        let inner = (1..=last_row).flat_map(|j| (1..=last_column).map(move |i| self.sample(i, j)));
        if !inner.clone().all(&usable) {
            return None;
        }
        let [across, down] = self.fraction.map(|fraction| cubic_weights(fraction, parameter));
        let mut sum = 0.0;
        for (j, down) in down.into_iter().enumerate() {
            for (i, across) in across.into_iter().enumerate() {
                let sample = self.sample(i, j);
                let nearest = self.sample(i.clamp(1, last_column), j.clamp(1, last_row));
                sum += across * down * values[if usable(sample) { sample } else { nearest }];
            }
        }
        let low = inner.clone().map(|sample| values[sample]).fold(f64::INFINITY, f64::min);
        let high = inner.map(|sample| values[sample]).fold(f64::NEG_INFINITY, f64::max);
        Some(sum.clamp(low, high))
    }
}

impl KeyFrame {
    /// Prepares a key frame. `parallax_px_m` is that of an instance.
    #[must_use]
    pub fn new(surfaces: Surfaces, parallax_px_m: &dyn Fn(u32) -> f64) -> Self {
        let (width, height) = surfaces.size;
        // Whether one of two pixels belongs to the surface of the other.
        let is_one = |a: usize, b: usize| {
            let (Ok(first), Ok(second)) = (surfaces.element(a), surfaces.element(b)) else { return false };
            let parallax_px_m = parallax_px_m(first.id);
            first.id == second.id
                && (surfaces.relation(b, first.id, first.plane, parallax_px_m) == Relation::Belongs
                    || surfaces.relation(a, second.id, second.plane, parallax_px_m) == Relation::Belongs)
        };
        let pure = (0..width * height)
            .map(|pixel| {
                let (x, y) = (pixel % width, pixel / width);
                (y.saturating_sub(1)..=(y + 1).min(height - 1)).all(|ny| {
                    (x.saturating_sub(1)..=(x + 1).min(width - 1)).all(|nx| is_one(pixel, ny * width + nx))
                })
            })
            .collect();
        let joined = (0..4 * width * height)
            .map(|sample| {
                let first = parent((width, height), sample);
                parents((width, height), sample).all(|parent| is_one(first, parent))
            })
            .collect();
        KeyFrame { surfaces, pure, joined }
    }

    fn belongs(&self, pixel: usize, seen: &Seen) -> bool {
        self.surfaces.relation(pixel, seen.id, seen.plane, seen.parallax_px_m) == Relation::Belongs
    }

    /// What is known of a surface at a position, pixels.
    #[must_use]
    pub fn shares(&self, at: DVec2, surface: &Seen) -> Shares {
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
        let usable = |sample: usize| self.joined[sample] && self.belongs(parent(size, sample), surface);
        Cell::new((2 * size.0, 2 * size.1), 2.0 * at).cubic(half_pel, CUBIC_HALF_PEL, usable)
    }

    /// Level of a surface at a position, nepers. `None` if none of the four pixels around shows it.
    #[must_use]
    pub fn level(&self, half_pel: &[f64], at: DVec2, surface: &Seen) -> Option<f64> {
        self.half_pel_level(half_pel, at, surface).or_else(|| {
            let size = self.surfaces.size;
            let (mut sum, mut weights) = (0.0, 0.0);
            for (pixel, weight) in Cell::new(size, at).corners() {
                if weight > 0.0 && self.belongs(pixel, surface) {
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

/// Half-pel samples of a frame alone, within surfaces. One that is not joined is the mean of the pixels around.
#[must_use]
pub fn half_pel_alone(key: &KeyFrame, frame: &[f64], parallax_px_m: &dyn Fn(u32) -> f64) -> Vec<f64> {
    let size = key.surfaces.size;
    (0..4 * size.0 * size.1)
        .map(|sample| {
            let first = parent(size, sample);
            if sample == pixel_sample(size, first) {
                return frame[first];
            }
            let within = || {
                let Element { id, plane, .. } = key.surfaces.element(first).ok()?;
                let surface = Seen { id, plane, parallax_px_m: parallax_px_m(id) };
                let is_parent = |pixel: usize| parents(size, sample).any(|parent| parent == pixel);
                let usable = |pixel: usize| is_parent(pixel) || key.belongs(pixel, &surface);
                Cell::new(size, sample_position(size, sample)).cubic(frame, CUBIC_FRAME, usable)
            };
            key.joined[sample].then(within).flatten().unwrap_or_else(|| {
                let (sum, count) =
                    parents(size, sample).fold((0.0, 0.0), |(s, n), p| (s + frame[p], n + 1.0));
                sum / count
            })
        })
        .collect()
}
