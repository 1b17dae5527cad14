//! Reading a key frame for a surface: how much of it is seen at a position, and its level there.

use super::surface::{Relation, Surfaces};
use crate::synthesize::half_pel::HalfPelFrame;
use crate::synthesize::trajectory::outside_px;
use esaac_model::Taps;
use esaac_model::synthesis::rigid::{MIXED_WEIGHT, SNAP_SAMPLES};
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

/// What a key frame knows of a surface at a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// Weight of the pixels around that belong.
    pub seen: f64,
    /// Weight of those that may hide it.
    pub hidden: f64,
    /// Weight of those that belong, less where they may hold a mixture.
    pub trust: f64,
    /// Its level, nepers. `None` if none of them belongs.
    pub level: Option<f64>,
    /// Weight of those that belong, and of those in its fringe.
    pub reach: f64,
    /// Weight of those of the reach, each by how thick the surface is there.
    pub thick: f64,
    /// Level of those that are farther, nepers. `None` if there are none.
    pub behind: Option<f64>,
    /// Level there, of whatever it is, nepers.
    pub as_shown: f64,
}

/// A key frame as it is read.
#[derive(Clone, Debug)]
pub struct KeyFrame {
    /// Its surfaces.
    pub surfaces: Surfaces,
    /// Whether the 3x3 pixels around each continue its surface.
    pub pure: Vec<bool>,
    /// How thick the surface is that each shows.
    pub thickness: Vec<f64>,
    /// The front of each.
    pub front: Vec<Option<usize>>,
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

/// The pixel nearest to a position, and the way from there.
struct Spot {
    /// The position, snapped.
    at: DVec2,
    nearest: usize,
    off: DVec2,
}

impl KeyFrame {
    /// Prepares a key frame.
    #[must_use]
    pub fn new(surfaces: Surfaces) -> Self {
        let (width, height) = surfaces.size;
        let pure = (0..width * height).map(|pixel| surfaces.all_continue(pixel, pixel, 1)).collect();
        let thickness = (0..width * height).map(|pixel| surfaces.thickness(pixel)).collect();
        let front = (0..width * height).map(|pixel| surfaces.front(pixel)).collect();
        let joined = (0..4 * width * height)
            .map(|sample| {
                let first = parent((width, height), sample);
                parents((width, height), sample).all(|parent| surfaces.continues(first, parent))
            })
            .collect();
        KeyFrame { surfaces, pure, thickness, front, joined }
    }

    /// Weight of the pixels around a position that belong to a surface; 0 if it lies outside the image.
    #[must_use]
    pub fn belonging(&self, at: DVec2, surface: &Seen) -> f64 {
        if self.outside_px(at) > 0.5 {
            return 0.0;
        }
        let spot = self.spot(at);
        let beside: f64 = self.beside(&spot).map(|(_, weight)| weight).sum();
        let pixels = self.beside(&spot).chain([(spot.nearest, 1.0 - beside)]);
        pixels.filter(|&(pixel, _)| self.belongs(pixel, surface)).map(|(_, weight)| weight).sum()
    }

    /// Whether a pixel belongs to a surface.
    #[must_use]
    pub fn belongs(&self, pixel: usize, seen: &Seen) -> bool {
        self.surfaces.relation(pixel, seen.id, seen.plane, seen.parallax_px_m) == Relation::Belongs
    }

    fn relation(&self, pixel: usize, seen: &Seen) -> Relation {
        self.surfaces.relation(pixel, seen.id, seen.plane, seen.parallax_px_m)
    }

    fn spot(&self, at: DVec2) -> Spot {
        let size = self.surfaces.size;
        let last = DVec2::new((size.0 - 1) as f64, (size.1 - 1) as f64);
        let at = 0.5 * snapped(2.0 * at);
        let inside = at.clamp(DVec2::ZERO, last);
        let nearest = (inside + 0.5).floor();
        Spot { at, nearest: nearest.y as usize * size.0 + nearest.x as usize, off: inside - nearest }
    }

    /// The pixels beside the nearest one that a position lies between, with their bilinear weights.
    fn beside(&self, spot: &Spot) -> impl Iterator<Item = (usize, f64)> {
        let (width, off) = (self.surfaces.size.0, spot.off);
        let (x, y) = (spot.nearest % width, spot.nearest / width);
        let next = |at: usize, off: f64| if off > 0.0 { at + 1 } else { at.saturating_sub(1) };
        let (column, row) = (next(x, off.x), next(y, off.y));
        let w = off.abs();
        [
            (y * width + column, w.x * (1.0 - w.y)),
            (row * width + x, (1.0 - w.x) * w.y),
            (row * width + column, w.x * w.y),
        ]
        .into_iter()
        .filter(|&(_, weight)| weight > 0.0)
    }

    /// Whether the pixels that a position lies between continue the surface of the nearest, so that this speaks for all.
    fn is_within(&self, spot: &Spot) -> bool {
        self.beside(spot).all(|(pixel, _)| self.surfaces.continues(spot.nearest, pixel))
    }

    /// What is known of a surface at a position, pixels; `half_pel` is the half-pel frame, as pixel `reader` reads it. With
    /// bilinear taps levels are from the frame's pixels alone.
    #[must_use]
    pub fn look(
        &self,
        half_pel: &HalfPelFrame,
        reader: [usize; 2],
        taps: Taps,
        at: DVec2,
        surface: &Seen,
    ) -> Known {
        let spot = self.spot(at);
        let as_shown = self.level(half_pel, reader, taps, spot.at);
        if !self.is_within(&spot) {
            let relation = |pixel| self.relation(pixel, surface);
            return self.look_around(half_pel, &spot, as_shown, surface, relation);
        }
        let lies = self.relation(spot.nearest, surface);
        if lies == Relation::Farther && !self.is_pure_within(&spot) {
            let known = self.look_around(half_pel, &spot, as_shown, surface, |_| Relation::Farther);
            return Known { behind: Some(as_shown), ..known };
        }
        let share = |of: Relation| if lies == of { 1.0 } else { 0.0 };
        let level = |of: Relation| (lies == of).then_some(as_shown);
        Known {
            seen: share(Relation::Belongs),
            hidden: share(Relation::Hides),
            trust: share(Relation::Belongs) * self.trust_within(&spot),
            level: level(Relation::Belongs),
            reach: share(Relation::Belongs),
            thick: self.thickness[spot.nearest] * share(Relation::Belongs),
            behind: level(Relation::Farther),
            as_shown,
        }
    }

    /// Whether a pixel that shows something farther is in the fringe of a surface, and then how thick that is there: the
    /// pixel's front belongs to it.
    fn fringe(&self, pixel: usize, surface: &Seen) -> Option<f64> {
        let front = self.front[pixel].filter(|&front| self.belongs(front, surface))?;
        Some(self.thickness[front])
    }

    /// Whether a pixel is pure, as far as the nearest one of a position tells: the 3x3 pixels around it continue the
    /// nearest one's surface.
    fn is_pure_for(&self, spot: &Spot, pixel: usize) -> bool {
        self.surfaces.all_continue(spot.nearest, pixel, 1)
    }

    /// Whether all pixels that a position within a surface lies between are.
    fn is_pure_within(&self, spot: &Spot) -> bool {
        self.is_pure_for(spot, spot.nearest)
            && self.beside(spot).all(|(pixel, _)| self.is_pure_for(spot, pixel))
    }

    /// Whether the pixels that a position lies between are of one surface, and pure.
    #[must_use]
    pub fn is_pure_at(&self, at: DVec2) -> bool {
        let spot = self.spot(at);
        self.is_within(&spot) && self.is_pure_within(&spot)
    }

    /// Whether the pixel nearest to a position belongs to a surface. `None` if that pixel is not inner.
    #[must_use]
    pub fn shows_inside(&self, at: DVec2, surface: &Seen) -> Option<bool> {
        let nearest = self.spot(at).nearest;
        self.surfaces.all_continue(nearest, nearest, 2).then(|| self.belongs(nearest, surface))
    }

    /// Confidence in the light at a position within a surface.
    fn trust_within(&self, spot: &Spot) -> f64 {
        let trust = |pixel: usize| if self.is_pure_for(spot, pixel) { 1.0 } else { MIXED_WEIGHT };
        let beside: f64 = self.beside(spot).map(|(_, weight)| weight).sum();
        let trust_beside: f64 = self.beside(spot).map(|(pixel, weight)| weight * trust(pixel)).sum();
        (1.0 - beside) * trust(spot.nearest) + trust_beside
    }

    /// What the four pixels around a position know of a surface, by how each lies to it.
    fn look_around(
        &self,
        half_pel: &HalfPelFrame,
        spot: &Spot,
        as_shown: f64,
        surface: &Seen,
        relation: impl Fn(usize) -> Relation,
    ) -> Known {
        let size = self.surfaces.size;
        let mut known = Known {
            seen: 0.0,
            hidden: 0.0,
            trust: 0.0,
            level: None,
            reach: 0.0,
            thick: 0.0,
            behind: None,
            as_shown,
        };
        let (mut level, mut behind, mut farther) = (0.0, 0.0, 0.0);
        for (pixel, weight) in Cell::new(size, spot.at).corners() {
            let own = half_pel.samples()[pixel_sample(size, pixel)];
            let thickness = match relation(pixel) {
                Relation::Belongs => {
                    known.seen += weight;
                    known.trust += if self.pure[pixel] { weight } else { MIXED_WEIGHT * weight };
                    level += weight * own;
                    Some(self.thickness[pixel])
                }
                Relation::Hides => {
                    known.hidden += weight;
                    None
                }
                Relation::Farther => {
                    farther += weight;
                    behind += weight * own;
                    self.fringe(pixel, surface)
                }
            };
            known.reach += if thickness.is_some() { weight } else { 0.0 };
            known.thick += weight * thickness.unwrap_or(0.0);
        }
        known.level = (known.seen > 0.0).then(|| level / known.seen);
        known.behind = (farther > 0.0).then(|| behind / farther);
        known
    }

    /// Level of a surface at a position from a half-pel frame, nepers, as pixel `reader` reads it. `None` if the pixels
    /// around do not all show it.
    #[must_use]
    pub fn half_pel_level(
        &self,
        half_pel: &HalfPelFrame,
        reader: [usize; 2],
        at: DVec2,
        surface: &Seen,
    ) -> Option<f64> {
        let spot = self.spot(at);
        (self.is_within(&spot) && self.belongs(spot.nearest, surface))
            .then(|| self.level(half_pel, reader, Taps::Cubic, spot.at))
    }

    /// Level at a snapped position, nepers, of whatever is there.
    fn level(&self, half_pel: &HalfPelFrame, reader: [usize; 2], taps: Taps, at: DVec2) -> f64 {
        let size = self.surfaces.size;
        match taps {
            Taps::Cubic => half_pel.at(at.to_array(), reader),
            Taps::Bilinear => Cell::new(size, at)
                .corners()
                .iter()
                .map(|&(pixel, weight)| weight * half_pel.samples()[pixel_sample(size, pixel)])
                .sum(),
        }
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
