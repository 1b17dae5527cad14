//! Which surfaces a pixel may show during an interval.

use super::surface::{Element, Surfaces, moved_plane, position};
use esaac_model::paths::{Intrinsics, Pose, SceneMotion};
use esaac_model::substeps::BlockWay;
use esaac_model::synthesis::rigid::{
    BLOCK_CANDIDATES, BLOCK_PX, BLOCK_SURFACES, KNOTS, MERGE_PX, PIXEL_CANDIDATES, REACH_PX, REST_PX,
};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// The poses of an instant: for each instance, the rigid motion from camera axes then to those of both key frames.
#[derive(Clone, Debug)]
pub struct Instant {
    /// Fraction of the interval.
    pub fraction: f64,
    to_keys: BTreeMap<u32, [Pose; 2]>,
}

impl Instant {
    /// The instant at `fraction` of the interval from `from_ns` to `to_ns`. An instance whose poses do not reach it is
    /// left out.
    #[must_use]
    pub fn new(scene: &SceneMotion, [from_ns, to_ns]: [i64; 2], fraction: f64) -> Self {
        let t_ns = from_ns + (fraction * (to_ns - from_ns) as f64).round() as i64;
        let to_keys = std::iter::once(esaac_model::paths::STATIC_WORLD)
            .chain(scene.ids())
            .filter_map(|id| {
                let to = |key_ns: i64| scene.relative(id, t_ns, key_ns).ok();
                Some((id, [to(from_ns)?, to(to_ns)?]))
            })
            .collect();
        Instant { fraction, to_keys }
    }

    /// The motion of an instance from this instant to both key frames.
    #[must_use]
    pub fn to_keys(&self, id: u32) -> Option<&[Pose; 2]> {
        self.to_keys.get(&id)
    }
}

/// A surface as both key frames see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Its instance.
    pub id: u32,
    /// Its plane in the camera axes of both key frames.
    pub planes: [DVec3; 2],
}

/// Where a surface that a pixel shows lies in each key frame, pixels.
pub type Sources = [DVec2; 2];

impl Surface {
    /// The surface of a pixel of key frame `key` (0 or 1). `to_other` is the instance's motion from that key frame to
    /// the other.
    fn of_element(element: &Element, key: usize, to_other: &Pose) -> Option<Self> {
        let other = moved_plane(element.plane, to_other)?;
        let planes = if key == 0 { [element.plane, other] } else { [other, element.plane] };
        Some(Surface { id: element.id, planes })
    }

    /// Inverse depth along a ray at an instant, 1/m. `None` if the surface is not before the camera.
    #[must_use]
    pub fn inverse_depth(&self, instant: &Instant, ray: DVec3) -> Option<f64> {
        let poses = instant.to_keys(self.id)?;
        let (turned, shift) = (poses[0].direction(ray), poses[0].translation_m());
        let room = 1.0 - self.planes[0].dot(shift);
        let inverse_depth = self.planes[0].dot(turned) / room;
        (room > 0.0 && inverse_depth >= 0.0).then_some(inverse_depth)
    }

    /// Where the surface that lies on a ray at an instant is in both key frames. `None` if it is not before a camera.
    #[must_use]
    pub fn sources(&self, lens: &Intrinsics, instant: &Instant, ray: DVec3) -> Option<Sources> {
        let poses = instant.to_keys(self.id)?;
        let inverse_depth = self.inverse_depth(instant, ray)?;
        let mut sources = [DVec2::ZERO; 2];
        for (at, pose) in sources.iter_mut().zip(poses) {
            *at = lens.project(pose.apply(ray.extend(inverse_depth)))?.pixel_px;
        }
        Some(sources)
    }
}

/// A candidate of a pixel: one surface, or that of the pixel in key frame 0 and that in key frame 1 if both are one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The surface; towards the start, if there are two.
    pub start: Surface,
    /// The surface towards the end.
    pub end: Surface,
    /// Whether it is what the pixel shows in a key frame.
    pub is_own: bool,
}

impl Candidate {
    /// The surface at `fraction` of the interval: the mean of both.
    #[must_use]
    pub fn at(&self, fraction: f64) -> Surface {
        let planes = [0, 1].map(|key| self.start.planes[key].lerp(self.end.planes[key], fraction));
        Surface { id: self.start.id, planes }
    }
}

/// What passes a block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Passing {
    /// How it moves.
    pub way: BlockWay,
    /// Whether some of it is of blocks with a silhouette.
    pub with_silhouette: bool,
    /// Whether something of it is a candidate of the block.
    pub is_listed: bool,
}

impl Passing {
    fn add(&mut self, way: BlockWay, with_silhouette: bool) {
        self.way.way_px = self.way.way_px.max(way.way_px);
        self.way.bend_px = self.way.bend_px.max(way.bend_px);
        self.with_silhouette |= with_silhouette;
    }
}

/// What the search for candidates needs to know of an interval.
pub struct Interval<'a> {
    /// The lens.
    pub lens: &'a Intrinsics,
    /// The surfaces of both key frames.
    pub keys: &'a [Surfaces; 2],
    /// The knots.
    pub knots: &'a [Instant],
    /// The parallax of an instance, pixels for each unit of inverse depth.
    pub parallax_px_m: &'a dyn Fn(u32) -> f64,
}

impl Interval<'_> {
    /// The motion of an instance from key frame `key` to the other.
    #[must_use]
    pub fn to_other(&self, id: u32, key: usize) -> Option<Pose> {
        // The first knot lies at key frame 0 and the last at key frame 1.
        let knot = if key == 0 { self.knots.first()? } else { self.knots.last()? };
        Some(knot.to_keys(id)?[1 - key])
    }

    fn surface(&self, key: usize, pixel: usize) -> Option<Surface> {
        let element = self.keys[key].element(pixel).ok()?;
        Surface::of_element(&element, key, &self.to_other(element.id, key)?)
    }

    /// Whether two surfaces are one candidate along a ray.
    fn is_same(&self, a: &Surface, b: &Surface, ray: DVec3) -> bool {
        let parallax_px_m = (self.parallax_px_m)(a.id);
        let apart_px = |key: usize| (a.planes[key] - b.planes[key]).dot(ray).abs() * parallax_px_m;
        a.id == b.id && apart_px(0) < MERGE_PX && apart_px(1) < MERGE_PX
    }

    /// The candidates of all pixels (`y * width + x`), from near to far in the middle of the interval; and of each block
    /// what passes it and its candidates. `silhouettes` is what [`Interval::silhouettes`] says of both key frames.
    #[must_use]
    pub fn candidates(
        &self,
        silhouettes: &[Vec<bool>; 2],
    ) -> (Vec<Vec<Candidate>>, Vec<Passing>, Vec<Vec<Surface>>) {
        let size = self.keys[0].size;
        let (blocks, mut passing) = self.block_candidates(silhouettes);
        let candidates = (0..size.0 * size.1)
            .map(|pixel| {
                let block = pixel / size.0 / BLOCK_PX * size.0.div_ceil(BLOCK_PX) + pixel % size.0 / BLOCK_PX;
                self.pixel_candidates(pixel, &blocks[block])
            })
            .collect();
        for (passing, list) in passing.iter_mut().zip(&blocks) {
            passing.is_listed = !list.is_empty();
        }
        (candidates, passing, blocks)
    }

    fn pixel_candidates(&self, pixel: usize, block: &[Surface]) -> Vec<Candidate> {
        let mut candidates: Vec<Candidate> = Vec::new();
        let Some(ray) = self.keys[0].ray(pixel) else { return candidates };
        let own = [self.surface(0, pixel), self.surface(1, pixel)];
        if own == [None, None] {
            return candidates;
        }
        match own {
            [Some(start), Some(end)] if self.is_same(&start, &end, ray) => {
                candidates.push(Candidate { start, end, is_own: true });
            }
            _ => candidates.extend(own.into_iter().flatten().map(|own| Candidate {
                start: own,
                end: own,
                is_own: true,
            })),
        }
        for &surface in block {
            let known = candidates.iter().any(|known| self.is_same(&known.start, &surface, ray));
            if !known && candidates.len() < PIXEL_CANDIDATES {
                candidates.push(Candidate { start: surface, end: surface, is_own: false });
            }
        }
        let middle = &self.knots[KNOTS / 2];
        let depth = |candidate: &Candidate| candidate.at(0.5).inverse_depth(middle, ray).unwrap_or(-1.0);
        candidates.sort_by(|a, b| depth(b).total_cmp(&depth(a)));
        candidates
    }

    /// The surfaces that pass each block, and how they move.
    fn block_candidates(&self, silhouettes: &[Vec<bool>; 2]) -> (Vec<Vec<Surface>>, Vec<Passing>) {
        let size = self.keys[0].size;
        let (columns, rows) = (size.0.div_ceil(BLOCK_PX), size.1.div_ceil(BLOCK_PX));
        let mut candidates: Vec<Vec<Surface>> = vec![Vec::new(); columns * rows];
        let mut passing = vec![Passing::default(); columns * rows];
        for (key, silhouettes) in silhouettes.iter().enumerate() {
            for (block, &has_silhouette) in silhouettes.iter().enumerate() {
                let corner = (block % columns * BLOCK_PX, block / columns * BLOCK_PX);
                for pixel in self.block_surfaces(key, corner) {
                    let surface = self.surface(key, pixel);
                    let places = self.places(key, pixel);
                    let way = way(&places);
                    let from = position(size, pixel);
                    for passed in passed_blocks(&places, from, corner, (columns, rows)) {
                        passing[passed].add(way, has_silhouette);
                        // One that the camera is behind in the other key frame moves, and is no candidate.
                        let Some(surface) = surface.filter(|_| has_silhouette) else { continue };
                        let centre = DVec2::new((passed % columns) as f64, (passed / columns) as f64)
                            * BLOCK_PX as f64
                            + 0.5 * (BLOCK_PX - 1) as f64;
                        let Some(ray) = self.lens.ray(centre) else { continue };
                        let known = candidates[passed].iter().any(|known| self.is_same(known, &surface, ray));
                        if !known && candidates[passed].len() < BLOCK_CANDIDATES {
                            candidates[passed].push(surface);
                        }
                    }
                }
            }
        }
        (candidates, passing)
    }

    /// Which blocks of a key frame have a silhouette, row by row.
    #[must_use]
    pub fn silhouettes(&self, key: usize) -> Vec<bool> {
        let (width, height) = self.keys[key].size;
        let corners =
            (0..height).step_by(BLOCK_PX).flat_map(|y| (0..width).step_by(BLOCK_PX).map(move |x| (x, y)));
        corners.map(|corner| self.has_silhouette(key, corner)).collect()
    }

    /// Whether a block has pixels that are not inner.
    fn has_silhouette(&self, key: usize, corner: (usize, usize)) -> bool {
        let surfaces = &self.keys[key];
        let (width, height) = surfaces.size;
        let mut pixels = (corner.1..(corner.1 + BLOCK_PX).min(height))
            .flat_map(|y| (corner.0..(corner.0 + BLOCK_PX).min(width)).map(move |x| y * width + x));
        pixels.any(|pixel| !surfaces.all_continue(pixel, pixel, 2))
    }

    /// Pixels of the surfaces that a block hands on: the nearest and the farthest of each instance, from near to far.
    fn block_surfaces(&self, key: usize, corner: (usize, usize)) -> Vec<usize> {
        let size = self.keys[key].size;
        let mut extremes: BTreeMap<u32, [(f64, usize); 2]> = BTreeMap::new();
        for y in corner.1..(corner.1 + BLOCK_PX).min(size.1) {
            for x in corner.0..(corner.0 + BLOCK_PX).min(size.0) {
                let pixel = y * size.0 + x;
                let Ok(element) = self.keys[key].element(pixel) else { continue };
                let here = (element.inverse_depth, pixel);
                let [nearest, farthest] = extremes.entry(element.id).or_insert([here; 2]);
                if here.0 > nearest.0 {
                    *nearest = here;
                }
                if here.0 < farthest.0 {
                    *farthest = here;
                }
            }
        }
        let mut pixels: Vec<(f64, usize)> = extremes.into_values().flatten().collect();
        pixels.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        pixels.dedup();
        pixels.truncate(BLOCK_SURFACES);
        pixels.into_iter().map(|(_, pixel)| pixel).collect()
    }

    /// Where a pixel's point is at each knot.
    fn places(&self, key: usize, pixel: usize) -> Vec<Option<DVec2>> {
        let (Ok(element), Some(ray)) = (self.keys[key].element(pixel), self.keys[key].ray(pixel)) else {
            return Vec::new();
        };
        let place = |knot: &Instant| {
            let poses = knot.to_keys(element.id)?;
            let moved = poses[key].inverse().apply(ray.extend(element.inverse_depth));
            Some(self.lens.project(moved)?.pixel_px)
        };
        self.knots.iter().map(place).collect()
    }
}

/// The way from place to place at the knots.
fn way(places: &[Option<DVec2>]) -> BlockWay {
    let steps = places.windows(2).filter_map(|pair| Some((pair[1]? - pair[0]?).length()));
    let way_px: f64 = steps.sum();
    let bends =
        places.windows(3).filter_map(|three| Some((three[0]? - 2.0 * three[1]? + three[2]?).length()));
    let bend_px = bends.fold(0.0, f64::max) * ((KNOTS - 1) * (KNOTS - 1)) as f64;
    BlockWay { way_px: if way_px < REST_PX { 0.0 } else { way_px }, bend_px }
}

/// The square of a block's pixel centres and of what they reach, displaced by `shift`: its first corner.
fn square(corner: (usize, usize), shift: DVec2) -> DVec2 {
    DVec2::new(corner.0 as f64, corner.1 as f64) + shift - REACH_PX
}

/// Side of that square, pixels.
const SQUARE_PX: f64 = (BLOCK_PX - 1) as f64 + 2.0 * REACH_PX;

/// Blocks that a block's square passes, displaced as one of its pixels is from `from` to each of `places`, and on straight
/// lines from one to the next. Ascending.
fn passed_blocks(
    places: &[Option<DVec2>],
    from: DVec2,
    corner: (usize, usize),
    (columns, rows): (usize, usize),
) -> Vec<usize> {
    let mut passed = Vec::new();
    let mut add = |[a, b]: [DVec2; 2]| {
        let range = |a: f64, b: f64, blocks: usize| {
            let side = BLOCK_PX as f64;
            let low = (a.min(b) / side).floor().max(0.0);
            let high = ((a.max(b) + SQUARE_PX) / side).floor().min((blocks - 1) as f64);
            if low <= high { low as usize..high as usize + 1 } else { 0..0 }
        };
        for row in range(a.y, b.y, rows) {
            let beside = range(a.x, b.x, columns).filter(|&column| crosses([a, b], (column, row)));
            passed.extend(beside.map(|column| row * columns + column));
        }
    };
    let corners: Vec<Option<DVec2>> =
        places.iter().map(|place| place.map(|place| square(corner, place - from))).collect();
    corners.iter().flatten().for_each(|&at| add([at, at]));
    corners.windows(2).filter_map(|pair| Some([pair[0]?, pair[1]?])).for_each(add);
    passed.sort_unstable();
    passed.dedup();
    passed
}

/// Whether a square whose first corner goes straight from `a` to `b` meets a block.
fn crosses([a, b]: [DVec2; 2], block: (usize, usize)) -> bool {
    // The shares of the way between which the square reaches the block, in one direction.
    let shares = |a: f64, b: f64, block: usize| {
        let low = (block * BLOCK_PX) as f64 - SQUARE_PX - a;
        let high = ((block + 1) * BLOCK_PX) as f64 - a;
        match b - a {
            0.0 if low <= 0.0 && high > 0.0 => [0.0, 1.0],
            0.0 => [1.0, 0.0],
            way => [(low / way).min(high / way), (low / way).max(high / way)],
        }
    };
    let [across, down] = [shares(a.x, b.x, block.0), shares(a.y, b.y, block.1)];
    across[0].max(down[0]).max(0.0) <= across[1].min(down[1]).min(1.0)
}
