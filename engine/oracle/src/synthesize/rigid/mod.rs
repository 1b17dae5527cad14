//! Synthesis `rigid`: follows surfaces along the exact paths of a simulator's poses, and tells by depth which of them a
//! pixel shows (equations in [`esaac_model::synthesis::rigid`]).

pub mod candidates;
pub mod event_ids;
pub mod read;
pub mod surface;
pub mod transfer;

use super::half_pel::HalfPelFrame;
use super::sampling::Sampling;
use candidates::{Candidate, Instant, Interval, Passing, Sources, Surface};
use esaac_model::Taps;
use esaac_model::paths::{NoPath, SceneMotion};
use esaac_model::substeps::BlockWay;
use esaac_model::synthesis::rigid::{
    BACKGROUND_LOG, BLOCK_PX, EDGE_WEIGHT, KNOTS, SLIGHT_WEIGHT, UNSEEN_REACH_PX, UNSEEN_SHARE, legs,
};
use glam::DVec2;
use read::{KeyFrame, Known, Seen, pixel_sample};
use std::collections::BTreeMap;
use surface::{Geometry, Surfaces};
use transfer::{Route, transfer};

#[cfg(test)]
mod tests;

/// A key frame as a simulator gives it.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Its time, nanoseconds.
    pub t_ns: i64,
    /// Intensity planes, scene units ([`Image::planes`](crate::ingest::Image::planes)).
    pub planes: &'a [Vec<f64>],
    /// Depth and instances.
    pub geometry: Geometry<'a>,
}

/// What a pixel shows at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sample {
    /// Synthesised intensity, scene units.
    Seen(f64),
    /// Neither key frame shows what is there: the background nearest to it, if there is any.
    Unseen(Option<f64>),
    /// The pixel has no candidate.
    NoPath,
}

impl Sample {
    /// The intensity, scene units. `None` if no path tells it.
    #[must_use]
    pub fn intensity(self) -> Option<f64> {
        match self {
            Sample::Seen(intensity) => Some(intensity),
            Sample::Unseen(intensity) => intensity,
            Sample::NoPath => None,
        }
    }
}

/// Pixels of a key frame without a path, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WithoutPath {
    /// Their depth is NaN, negative or too small to invert.
    pub depth: u64,
    /// Their instance has no poses.
    pub poses: u64,
    /// The lens shows nothing there.
    pub lens: u64,
}

impl WithoutPath {
    /// Those of a key frame.
    #[must_use]
    pub fn of(surfaces: &Surfaces) -> Self {
        let mut counts = WithoutPath::default();
        for pixel in 0..surfaces.size.0 * surfaces.size.1 {
            match surfaces.element(pixel) {
                Ok(_) => {}
                Err(NoPath::NoPoses { .. } | NoPath::Time { .. }) => counts.poses += 1,
                Err(NoPath::OutsideLens) => counts.lens += 1,
                Err(NoPath::Depth | NoPath::BehindCamera) => counts.depth += 1,
            }
        }
        counts
    }
}

/// What a key frame knows of a candidate, and how much it counts by its time.
struct View {
    weight: f64,
    known: Known,
}

impl View {
    /// The weight, less what may be hidden.
    fn open(&self) -> f64 {
        self.weight * (1.0 - self.known.hidden)
    }
}

/// How much of a pixel a candidate covers.
struct Cover {
    coverage: f64,
    /// Its own light; 0 if it covers nothing.
    light: f64,
    /// How much of the pixel it reaches into, with its fringe, and how much of that is where it is thick.
    reach: f64,
    thickness: f64,
}

/// `None` if it reaches into nothing, or is hidden in both key frames.
fn covers(views: &[View; 2]) -> Option<Cover> {
    let sum = |of: &dyn Fn(&View) -> f64| views.iter().map(of).sum::<f64>();
    let trust = sum(&|view| view.weight * view.known.trust);
    let levels = sum(&|view| view.known.level.map_or(0.0, |level| view.weight * view.known.trust * level));
    let open = sum(&View::open);
    let reach = sum(&|view| view.weight * view.known.reach);
    (reach > 0.0).then(|| Cover {
        coverage: (sum(&|view| view.weight * view.known.seen) / open).min(1.0),
        light: if trust > 0.0 { (levels / trust).exp() } else { 0.0 },
        reach: (reach / open).min(1.0),
        thickness: sum(&|view| view.weight * view.known.thick) / reach,
    })
}

/// Two key frames prepared to be read along exact paths.
pub struct Rigid<'a> {
    scene: &'a SceneMotion,
    times_ns: [i64; 2],
    log_offset: f64,
    taps: Taps,
    parallax_px_m: BTreeMap<u32, f64>,
    keys: [KeyFrame; 2],
    candidates: Vec<Vec<Candidate>>,
    /// The candidates of each block.
    listed: Vec<Vec<Surface>>,
    passing: Vec<Passing>,
    /// Whether each block of both key frames has a silhouette.
    silhouettes: [Vec<bool>; 2],
    /// The candidate of each pixel that is unoccluded.
    unoccluded: Vec<Option<Candidate>>,
    /// One pair a plane.
    half_pels: Vec<[HalfPelFrame; 2]>,
}

impl<'a> Rigid<'a> {
    /// Prepares an interval. `taps`, `transfers` and `history` are as in synthesis `motion`: `history` comes from
    /// [`Rigid::into_history`] of the interval before. With bilinear taps there are no transfers.
    #[must_use]
    pub fn new(
        scene: &'a SceneMotion,
        inputs: [Input<'_>; 2],
        log_offset: f64,
        (taps, transfers): (Taps, u32),
        history: Option<Vec<HalfPelFrame>>,
    ) -> Self {
        let transfers = if taps == Taps::Cubic { transfers } else { 0 };
        let times_ns = inputs.map(|input| input.t_ns);
        let knots: Vec<Instant> =
            (0..KNOTS).map(|knot| Instant::new(scene, times_ns, knot as f64 / (KNOTS - 1) as f64)).collect();
        let parallax_px_m = parallax_px_m(scene, &knots);
        let parallax = |id: u32| parallax_px_m.get(&id).copied().unwrap_or(1.0);
        let surfaces = inputs.map(|input| Surfaces::new(scene, &input.geometry));
        let interval =
            Interval { lens: scene.lens(), keys: &surfaces, knots: &knots, parallax_px_m: &parallax };
        let silhouettes = [0, 1].map(|key| interval.silhouettes(key));
        let (candidates, passing, listed) = interval.candidates(&silhouettes);
        let keys = surfaces.clone().map(KeyFrame::new);
        let routes: Vec<Route> = [1, 0]
            .into_iter()
            .cycle()
            .take(transfers as usize)
            .map(|key| Route::new(&interval, &keys, key, &parallax))
            .collect();
        let mut history = history.into_iter().flatten();
        let half_pels = (0..inputs[0].planes.len())
            .map(|plane| {
                let log = |key: usize| -> Vec<f64> {
                    inputs[key].planes[plane].iter().map(|s| (s + log_offset).ln()).collect()
                };
                let of_frame = [0, 1]
                    .map(|key| HalfPelFrame::of_frame(keys[key].surfaces.size, Sampling::ENGINE, &log(key)));
                half_pel_frames(&keys, &routes, of_frame, history.next())
            })
            .collect();
        let mut rigid = Rigid {
            scene,
            times_ns,
            log_offset,
            taps,
            parallax_px_m,
            keys,
            candidates,
            listed,
            passing,
            silhouettes,
            unoccluded: Vec::new(),
            half_pels,
        };
        rigid.unoccluded = rigid.find_unoccluded();
        rigid
    }

    fn find_unoccluded(&self) -> Vec<Option<Candidate>> {
        let (width, columns) =
            (self.keys[0].surfaces.size.0, self.keys[0].surfaces.size.0.div_ceil(BLOCK_PX));
        let mut middles: BTreeMap<u32, Vec<Instant>> = BTreeMap::new();
        let mut find = |pixel: usize| {
            let block = pixel / width / BLOCK_PX * columns + pixel % width / BLOCK_PX;
            let passing = &self.passing[block];
            if !passing.is_listed {
                return self.unoccluded(pixel, &[]);
            }
            let legs = legs(passing.way.way_px)?;
            let middles = middles.entry(legs).or_insert_with(|| {
                let fraction = |leg: u32| (f64::from(leg) + 0.5) / f64::from(legs);
                (0..legs).map(|leg| self.instant(fraction(leg))).collect()
            });
            self.unoccluded(pixel, middles)
        };
        (0..self.candidates.len()).map(&mut find).collect()
    }

    /// A pixel's own candidate, if it is the only one that the pixel shows in a key frame, and at all these instants each
    /// nearer candidate lies inside something else, and it inside itself.
    fn unoccluded(&self, pixel: usize, instants: &[Instant]) -> Option<Candidate> {
        let (candidates, ray) = (&self.candidates[pixel], self.keys[0].surfaces.ray(pixel)?);
        if candidates.iter().filter(|candidate| candidate.is_own).count() != 1 {
            return None;
        }
        let own = candidates.iter().position(|candidate| candidate.is_own)?;
        let lies_inside = |candidate: &Candidate, instant: &Instant| {
            let surface = candidate.at(instant.fraction);
            let Some(sources) = surface.sources(self.scene.lens(), instant, ray) else {
                return !candidate.is_own;
            };
            (0..2).all(|key| {
                let shows = self.keys[key].shows_inside(sources[key], &self.seen(&surface, key));
                shows == Some(candidate.is_own)
            })
        };
        let up_to_own = &candidates[..=own];
        instants
            .iter()
            .all(|instant| up_to_own.iter().all(|candidate| lies_inside(candidate, instant)))
            .then(|| candidates[own])
    }

    /// Pixels that are unoccluded, each with what it shows (`y * width + x`).
    #[must_use]
    pub fn unoccluded_pixels(&self) -> &[Option<Candidate>] {
        &self.unoccluded
    }

    /// The poses at `fraction` of the interval.
    #[must_use]
    pub fn instant(&self, fraction: f64) -> Instant {
        Instant::new(self.scene, self.times_ns, fraction)
    }

    /// Candidates of each pixel (`y * width + x`).
    #[must_use]
    pub fn candidates(&self) -> &[Vec<Candidate>] {
        &self.candidates
    }

    /// How what passes a block moves; blocks count row by row.
    #[must_use]
    pub fn way(&self, block: usize) -> BlockWay {
        self.passing[block].way
    }

    /// Whether a surface of a block with a silhouette passes a block.
    #[must_use]
    pub fn is_passed_by_silhouette(&self, block: usize) -> bool {
        self.passing[block].with_silhouette
    }

    /// Whether a block of key frame `key` (0 or 1) has a silhouette, pixels that are not inner.
    #[must_use]
    pub fn has_silhouette(&self, key: usize, block: usize) -> bool {
        self.silhouettes[key][block]
    }

    /// Whether a pixel of key frame `key` (0 or 1) shows a surface.
    #[must_use]
    pub fn shows_surface(&self, key: usize, pixel: usize) -> bool {
        self.keys[key].surfaces.element(pixel).is_ok()
    }

    /// Pixels without a path of key frame `key` (0 or 1).
    #[must_use]
    pub fn without_path(&self, key: usize) -> WithoutPath {
        WithoutPath::of(&self.keys[key].surfaces)
    }

    /// What pixel `(x, y)` shows at an instant, in plane `plane`.
    #[must_use]
    pub fn sample(&self, instant: &Instant, plane: usize, x: usize, y: usize) -> Sample {
        self.along_own_path(instant, plane, x, y).unwrap_or_else(|| self.composite(instant, plane, x, y))
    }

    /// What an unoccluded pixel shows: its own candidate.
    fn along_own_path(&self, instant: &Instant, plane: usize, x: usize, y: usize) -> Option<Sample> {
        let pixel = y * self.keys[0].surfaces.size.0 + x;
        let surface = self.unoccluded[pixel].as_ref()?.at(instant.fraction);
        let ray = self.keys[0].surfaces.ray(pixel)?;
        let sources = surface.sources(self.scene.lens(), instant, ray)?;
        let views = self.views(instant.fraction, plane, [x, y], &sources, &surface);
        let weights: f64 = views.iter().map(|view| view.weight).sum();
        let level: f64 = views.iter().map(|view| view.weight * view.known.as_shown).sum();
        Some(Sample::Seen(self.intensity((level / weights).exp())))
    }

    /// What pixel `(x, y)` shows by all its candidates.
    #[must_use]
    pub fn composite(&self, instant: &Instant, plane: usize, x: usize, y: usize) -> Sample {
        let pixel = y * self.keys[0].surfaces.size.0 + x;
        let (candidates, Some(ray)) = (&self.candidates[pixel], self.keys[0].surfaces.ray(pixel)) else {
            return Sample::NoPath;
        };
        // From near to far.
        let here: Vec<(Sources, Surface)> = candidates
            .iter()
            .filter_map(|candidate| {
                let surface = candidate.at(instant.fraction);
                Some((surface.sources(self.scene.lens(), instant, ray)?, surface))
            })
            .collect();
        if here.is_empty() {
            return Sample::NoPath;
        }
        let (mut light, mut shown) = (0.0, 0.0);
        let mut silhouette = None;
        for (sources, surface) in &here {
            let views = self.views(instant.fraction, plane, [x, y], sources, surface);
            let Some(cover) = covers(&views) else { continue };
            if silhouette.is_none() && shown == 0.0 && cover.coverage < 1.0 - SLIGHT_WEIGHT {
                silhouette = Some((cover, views));
                continue;
            }
            let share = (1.0 - shown) * cover.coverage;
            light += share * cover.light;
            shown += share;
        }
        if let Some((cover, views)) = silhouette {
            let open: f64 = views.iter().map(View::open).sum();
            let mean = |of: &dyn Fn(&View) -> f64| views.iter().map(|v| v.open() / open * of(v)).sum::<f64>();
            let mixture = mean(&|view| view.known.as_shown).exp();
            if shown < UNSEEN_SHARE {
                return Sample::Seen(self.intensity(mixture));
            }
            let here = light / shown;
            let there = mean(&|view| view.known.behind.map_or(here, f64::exp));
            let unlike = ((here / there).ln().abs() / BACKGROUND_LOG).min(1.0);
            let composite = cover.coverage * cover.light + (1.0 - cover.coverage) * here;
            let strange = cover.thickness * unlike;
            let reached = (1.0 - strange) * mixture + strange * composite;
            return Sample::Seen(self.intensity(cover.reach * reached + (1.0 - cover.reach) * here));
        }
        if shown < UNSEEN_SHARE {
            let level = here.last().and_then(|(sources, farthest)| {
                self.nearest_level(instant.fraction, plane, sources, farthest)
            });
            return Sample::Unseen(level.map(|level| self.intensity(level.exp())));
        }
        Sample::Seen(self.intensity(light / shown))
    }

    /// Intensity of `exp(L)`, scene units.
    fn intensity(&self, light: f64) -> f64 {
        (light - self.log_offset).max(0.0)
    }

    /// What both key frames know of a candidate.
    fn views(
        &self,
        fraction: f64,
        plane: usize,
        reader: [usize; 2],
        sources: &Sources,
        surface: &Surface,
    ) -> [View; 2] {
        [(0, 1.0 - fraction), (1, fraction)].map(|(key, time)| {
            let (frame, at) = (&self.keys[key], sources[key]);
            let weight = time * (1.0 - frame.outside_px(at)).max(EDGE_WEIGHT);
            let half_pel = &self.half_pels[plane][key];
            let known = frame.look(half_pel, reader, self.taps, at, &self.seen(surface, key));
            View { weight, known }
        })
    }

    /// Level of a candidate beside what hides it: that of the nearest pixels that belong, in the row and the column of
    /// its position in both key frames, nepers. `None` if there is none within [`UNSEEN_REACH_PX`].
    fn nearest_level(
        &self,
        fraction: f64,
        plane: usize,
        sources: &Sources,
        surface: &Surface,
    ) -> Option<f64> {
        let size = self.keys[0].surfaces.size;
        (1..=UNSEEN_REACH_PX).find_map(|distance_px| {
            let (mut sum, mut weights) = (0.0, 0.0);
            for (key, weight) in [(0, 1.0 - fraction), (1, fraction)] {
                let surface = self.seen(surface, key);
                for step in [DVec2::X, -DVec2::X, DVec2::Y, -DVec2::Y] {
                    let at = sources[key].round() + step * f64::from(distance_px);
                    let inside = at.cmpge(DVec2::ZERO).all() && at.x < size.0 as f64 && at.y < size.1 as f64;
                    if !inside {
                        continue;
                    }
                    let pixel = at.y as usize * size.0 + at.x as usize;
                    if self.keys[key].belongs(pixel, &surface) {
                        sum += weight * self.half_pels[plane][key].samples()[pixel_sample(size, pixel)];
                        weights += weight;
                    }
                }
            }
            (weights > 0.0).then(|| sum / weights)
        })
    }

    /// A surface as key frame `key` sees it.
    fn seen(&self, surface: &Surface, key: usize) -> Seen {
        let parallax_px_m = self.parallax_px_m.get(&surface.id).copied().unwrap_or(1.0);
        Seen { id: surface.id, plane: surface.planes[key], parallax_px_m }
    }

    /// Half-pel frames of both key frames, one pair a plane.
    #[must_use]
    pub fn half_pels(&self) -> &[[HalfPelFrame; 2]] {
        &self.half_pels
    }

    /// A key frame (0 or 1) as it is read.
    #[must_use]
    pub fn key(&self, key: usize) -> &KeyFrame {
        &self.keys[key]
    }

    /// The half-pel frames of the end, which the next interval improves.
    #[must_use]
    pub fn into_history(self) -> Vec<HalfPelFrame> {
        self.half_pels.into_iter().map(|[_, end]| end).collect()
    }
}

/// Half-pel frames of both key frames, with one transfer for each route. The first improves the end.
fn half_pel_frames(
    keys: &[KeyFrame; 2],
    routes: &[Route],
    [of_start, of_end]: [HalfPelFrame; 2],
    history: Option<HalfPelFrame>,
) -> [HalfPelFrame; 2] {
    let [start_key, end_key] = keys;
    let start_alone = history.unwrap_or(of_start);
    let (mut start, mut end) = (start_alone.clone(), of_end);
    for (turn, route) in routes.iter().enumerate() {
        if turn % 2 == 0 {
            end = transfer(end_key, &end, start_key, &start, route);
        } else {
            start = transfer(start_key, &start_alone, end_key, &end, route);
        }
    }
    [start, end]
}

/// The parallax of every instance with poses, pixels for each unit of inverse depth.
fn parallax_px_m(scene: &SceneMotion, knots: &[Instant]) -> BTreeMap<u32, f64> {
    let focal_px = 0.5 * scene.lens().focal_px().element_sum();
    std::iter::once(esaac_model::paths::STATIC_WORLD)
        .chain(scene.ids())
        .map(|id| {
            let shifts_m = knots.iter().filter_map(|knot| knot.to_keys(id)).flatten();
            let largest_m = shifts_m.map(|pose| pose.translation_m().length()).fold(0.0, f64::max);
            (id, (focal_px * largest_m).max(1.0))
        })
        .collect()
}
