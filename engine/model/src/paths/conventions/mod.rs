//! Whether depth, ids and poses follow the conventions: they predict a renderer's motion vectors.
//!
//! For pixels of each key frame, the vector predicted is `path(x, z, b, t_k, t_{k-1}) - x` ([`SceneMotion::path`]). The
//! error is the distance to the vector given, and its median is taken apart for the static world and each instance. So
//! pixels at edges, which show two surfaces, do not count. Backgrounds at infinity are left out: renderers differ in what
//! vectors they give them.
//!
//! The two agree if the median error is at most [`AGREEMENT_PX`] or [`AGREEMENT_SHARE`] of the median motion. If not,
//! every [`Mistake`] is undone in turn, alone and together with a mistake of the vectors' sign and unit. What makes the
//! two agree with the fewest mistakes is the cause. If nothing does, what leaves little is
//! told as the nearest.
//!
//! A static world far away may agree whatever the depth is. Then a body tells a mistake of the depth or the lens, if the
//! static world agrees with that as well.
//!
//! [`Trust`] is what synthesis `auto` makes of it, and [`PoseCheck`] looks at the frames of a running camera.

mod check;
mod mistake;
mod text;
mod trust;

pub use check::PoseCheck;
pub use mistake::Mistake;
pub use trust::Trust;

use super::{ImagePoint, NoPath, Pose, PoseTrack, STATIC_WORLD, SceneMotion};
use crate::synthesis::is_usable;
use glam::DVec2;
use mistake::{BODY, CAMERA, FACTORS, SIGNS, SURFACE, UNITS};
use std::collections::BTreeMap;
use thiserror::Error;

/// Median error that is rounding, pixels.
pub const AGREEMENT_PX: f64 = 0.02;

/// Median error, over the median motion, that is rounding: half floats have a thousandth.
pub const AGREEMENT_SHARE: f64 = 0.02;

/// Part of the error that the nearest explanation may leave, if that is slight besides.
const NEAREST_SHARE: f64 = 0.25;

/// Explanations that leave this much more than the best, relatively, do as well as it.
const TIE_SHARE: f64 = 0.5;

/// Distance outside a track at which its end is meant, nanoseconds: the times of frames are rounded, so that an interval
/// moved by a frame may end that much later.
const ROUNDING_NS: u64 = 2;

/// Instances up to which each one's poses are tried for each other.
const MOST_EXCHANGED: usize = 32;

/// Pixels compared of an instance in a frame.
const PIXELS_OF_INSTANCE: usize = 512;

/// Pixels below which a median says nothing.
const FEWEST_PIXELS: usize = 16;

/// Pixels below which poses are not doubted: most of them may be at edges, where a pixel shows two surfaces.
const DOUBT_PIXELS: usize = 64;

/// Median error up to which poses are not doubted, pixels: vectors would not make better events.
const DOUBT_PX: f64 = 0.1;

/// The same over the median motion.
const DOUBT_SHARE: f64 = 0.1;

/// A key frame as the renderer gave it.
#[derive(Clone, Copy, Debug)]
pub struct KeyFrame<'a> {
    width_px: u32,
    height_px: u32,
    t_ns: i64,
    previous_ns: i64,
    /// The rows that the images have; `None` for all.
    rows: Option<&'a [u32]>,
    depth_m: &'a [f32],
    ids: Option<&'a [u32]>,
    motion_px: &'a [[f32; 2]],
}

/// An image has the wrong number of pixels.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{image} has {actual} pixels, expected {expected} ({width_px}x{height_px})")]
pub struct ShapeError {
    /// Which image.
    pub image: &'static str,
    /// Expected number.
    pub expected: usize,
    /// Number given.
    pub actual: usize,
    /// Width of the frame.
    pub width_px: u32,
    /// Height of the frame.
    pub height_px: u32,
}

/// How vectors and poses agree.
#[derive(Clone, Debug, PartialEq)]
pub struct ConventionReport {
    /// The static world, if enough pixels show it.
    pub world: Option<Agreement>,
    /// Instances of which enough pixels are seen.
    pub instances: BTreeMap<u32, Agreement>,
    /// Pixels of instances without poses, which cannot be compared.
    pub pixels_without_poses: usize,
}

/// How the vectors of some pixels agree with their paths.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement {
    /// Pixels compared.
    pub pixels: usize,
    /// Median length of the vectors predicted, pixels.
    pub median_motion_px: f64,
    /// Median distance between vectors given and predicted, pixels.
    pub median_error_px: f64,
    /// What follows from it.
    pub verdict: Verdict,
}

/// What follows from the error.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Depth and poses predict the vectors.
    Agrees,
    /// They agree, but hardly anything moves, so that they would under most mistakes too.
    Still,
    /// Undoing these mistakes makes them agree.
    Mistaken {
        /// The best explanation, and others that do as well with as many mistakes. Never empty.
        causes: Vec<Vec<Mistake>>,
        /// Median error that is left, pixels.
        left_px: f64,
    },
    /// They disagree, and no known mistake explains it.
    Unexplained {
        /// What explains all but a slight error.
        nearest: Option<Nearest>,
    },
}

/// Mistakes that explain an error, but for a part that is more than rounding.
#[derive(Clone, Debug, PartialEq)]
pub struct Nearest {
    /// The mistakes.
    pub cause: Vec<Mistake>,
    /// Median error that is left, pixels.
    pub left_px: f64,
}

impl<'a> KeyFrame<'a> {
    /// A frame of `width_px` x `height_px` at `t_ns` whose vectors lead to `previous_ns`, row by row. Without ids all
    /// belongs to the static world.
    ///
    /// # Errors
    /// If an image has another number of pixels.
    pub fn new(
        size_px: (u32, u32),
        times_ns: (i64, i64),
        depth_m: &'a [f32],
        ids: Option<&'a [u32]>,
        motion_px: &'a [[f32; 2]],
    ) -> Result<Self, ShapeError> {
        KeyFrame::of_rows(size_px, times_ns, None, depth_m, ids, motion_px)
    }

    /// As [`KeyFrame::new`], of images that hold these rows alone.
    ///
    /// # Errors
    /// If an image has another number of pixels.
    pub fn of_rows(
        (width_px, height_px): (u32, u32),
        (previous_ns, t_ns): (i64, i64),
        rows: Option<&'a [u32]>,
        depth_m: &'a [f32],
        ids: Option<&'a [u32]>,
        motion_px: &'a [[f32; 2]],
    ) -> Result<Self, ShapeError> {
        let expected = width_px as usize * rows.map_or(height_px as usize, <[u32]>::len);
        let ids_len = ids.map_or(expected, <[u32]>::len);
        for (image, actual) in [("depth", depth_m.len()), ("ids", ids_len), ("motion", motion_px.len())] {
            if actual != expected {
                return Err(ShapeError { image, expected, actual, width_px, height_px });
            }
        }
        Ok(KeyFrame { width_px, height_px, t_ns, previous_ns, rows, depth_m, ids, motion_px })
    }

    /// Where pixel `i` of the images is.
    fn pixel_px(&self, i: usize) -> DVec2 {
        let (column, row) = (i % self.width_px as usize, i / self.width_px as usize);
        DVec2::new(column as f64, self.rows.map_or(row as f64, |rows| f64::from(rows[row])))
    }
}

/// Collects the pixels of a sequence's key frames, one after another, and compares them with a scene's motion.
#[derive(Clone, Debug, Default)]
pub struct ConventionCheck {
    samples: BTreeMap<u32, Vec<Sample>>,
}

/// A pixel as it was given.
#[derive(Clone, Copy, Debug)]
struct Sample {
    pixel_px: DVec2,
    size_px: DVec2,
    depth_m: f64,
    vector: DVec2,
    t_ns: i64,
    previous_ns: i64,
}

impl ConventionCheck {
    /// Takes pixels of a frame with [usable](is_usable) vectors: evenly spread, some of each instance. A frame whose vectors
    /// are all 0 says nothing: renderers have none for their first frame.
    pub fn add(&mut self, frame: &KeyFrame<'_>) {
        let says_something = |vector: &[f32; 2]| *vector != [0.0; 2] && is_usable(vector.map(f64::from));
        if !frame.motion_px.iter().any(says_something) {
            return;
        }
        let usable = |i: usize| {
            let (depth_m, vector) = (frame.depth_m[i], frame.motion_px[i]);
            depth_m > 0.0 && depth_m.is_finite() && is_usable(vector.map(f64::from))
        };
        let mut pixels: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for i in (0..frame.depth_m.len()).filter(|&i| usable(i)) {
            pixels.entry(frame.ids.map_or(STATIC_WORLD, |ids| ids[i])).or_default().push(i);
        }
        let size_px = DVec2::new(f64::from(frame.width_px), f64::from(frame.height_px));
        for (id, pixels) in pixels {
            let stride = pixels.len().div_ceil(PIXELS_OF_INSTANCE);
            self.samples.entry(id).or_default().extend(pixels.iter().step_by(stride).map(|&i| Sample {
                pixel_px: frame.pixel_px(i),
                size_px,
                depth_m: f64::from(frame.depth_m[i]),
                vector: DVec2::from(frame.motion_px[i].map(f64::from)),
                t_ns: frame.t_ns,
                previous_ns: frame.previous_ns,
            }));
        }
    }

    /// Adds what another check has collected.
    fn append(&mut self, other: ConventionCheck) {
        for (id, mut samples) in other.samples {
            self.samples.entry(id).or_default().append(&mut samples);
        }
    }

    /// Compares what was collected with `scene`. `None` if too few pixels can be compared.
    #[must_use]
    pub fn report(&self, scene: &SceneMotion) -> Option<ConventionReport> {
        self.compare(scene, true)
    }

    /// The report, with times that come of rates or each of its own.
    fn compare(&self, scene: &SceneMotion, rates: bool) -> Option<ConventionReport> {
        let mut report =
            ConventionReport { world: None, instances: BTreeMap::new(), pixels_without_poses: 0 };
        // Mistakes of the camera and the vectors, found on the static world, hold for the instances too.
        let mut common: Vec<Mistake> = Vec::new();
        let mut explanations = camera_explanations(rates);
        if let Some(samples) = self.samples.get(&STATIC_WORLD) {
            report.world = Comparison { scene, id: STATIC_WORLD, samples }.agreement(&common, &explanations);
        }
        if let Some(Verdict::Mistaken { causes, .. }) = report.world.as_ref().map(|world| &world.verdict) {
            common.clone_from(&causes[0]);
        }
        match report.world.as_ref().map(|world| &world.verdict) {
            Some(Verdict::Agrees | Verdict::Mistaken { .. }) => {
                let samples = self.samples.get(&STATIC_WORLD).expect("the samples of the verdict");
                let world = Comparison { scene, id: STATIC_WORLD, samples };
                let surface = SURFACE.iter().filter(|&&mistake| world.agrees_as_well(&common, mistake));
                explanations = surface.chain(&BODY).map(|&mistake| vec![mistake]).collect();
            }
            Some(Verdict::Still | Verdict::Unexplained { .. }) | None => {
                // What both have, such as a shift in time, is one explanation.
                let of_body = with_vectors(&BODY).into_iter().filter(|one| !explanations.contains(one));
                explanations.extend(of_body.collect::<Vec<_>>());
                explanations.sort_by_key(Vec::len);
            }
        }
        for (&id, samples) in self.samples.iter().filter(|&(&id, _)| id != STATIC_WORLD) {
            if scene.instance(id).is_none() {
                report.pixels_without_poses += samples.len();
                continue;
            }
            let others = scene.ids().filter(|&other| other != id).map(|other| vec![Mistake::BodyOf(other)]);
            let exchanged = others.filter(|_| scene.ids().count() <= MOST_EXCHANGED);
            let explanations: Vec<_> = exchanged.chain(explanations.iter().cloned()).collect();
            if let Some(found) = (Comparison { scene, id, samples }).agreement(&common, &explanations) {
                report.instances.insert(id, found);
            }
        }
        (report.world.is_some() || !report.instances.is_empty()).then_some(report)
    }
}

impl ConventionReport {
    /// Whether nothing disagrees.
    #[must_use]
    pub fn agrees(&self) -> bool {
        self.world
            .iter()
            .chain(self.instances.values())
            .all(|found| matches!(found.verdict, Verdict::Agrees | Verdict::Still))
    }
}

impl Agreement {
    /// Whether poses and depth are wrong, as far as the vectors tell, by more than what hardly changes an event. They are
    /// right if the vectors' own sign, unit or frame explains all: then they predict the vectors.
    #[must_use]
    pub fn doubts_poses(&self) -> bool {
        if self.pixels < DOUBT_PIXELS || self.median_error_px <= slight_px(self.median_motion_px) {
            return false;
        }
        match &self.verdict {
            Verdict::Agrees | Verdict::Still => false,
            Verdict::Unexplained { .. } => true,
            Verdict::Mistaken { .. } => !self.blames_vectors(),
        }
    }

    /// Whether the vectors' own sign, unit or frame explains all, and nothing else does as well.
    fn blames_vectors(&self) -> bool {
        let Verdict::Mistaken { causes, .. } = &self.verdict else { return false };
        causes.iter().flatten().all(|mistake| mistake.is_of_vectors())
    }
}

/// Median error that is rounding where the median motion is this, pixels.
fn agreement_px(motion_px: f64) -> f64 {
    AGREEMENT_PX.max(AGREEMENT_SHARE * motion_px)
}

/// Median error that hardly changes an event where the median motion is this, pixels.
fn slight_px(motion_px: f64) -> f64 {
    DOUBT_PX.max(DOUBT_SHARE * motion_px)
}

/// All combinations of one of `mistakes` or none with a sign and a unit of the vectors, and of a sign with a factor, fewest
/// mistakes first.
fn with_vectors(mistakes: &[Mistake]) -> Vec<Vec<Mistake>> {
    let alone = mistakes.iter().map(std::slice::from_ref).chain([&[][..]]);
    let mut all: Vec<Vec<Mistake>> = alone
        .flat_map(|other| {
            let vectors = SIGNS.iter().flat_map(|sign| UNITS.iter().map(move |unit| (sign, unit)));
            vectors.map(move |(sign, unit)| [other, sign, unit].concat())
        })
        .filter(|combination| !combination.is_empty())
        .collect();
    all.extend(
        FACTORS.iter().flat_map(|&factor| SIGNS.iter().map(move |sign| [sign, &[factor][..]].concat())),
    );
    all.sort_by_key(Vec::len);
    all
}

/// What may be wrong with all pixels. A rate is wrong only where times come of one.
fn camera_explanations(rates: bool) -> Vec<Vec<Mistake>> {
    let mistakes = CAMERA.iter().chain(&SURFACE).copied();
    let mistakes: Vec<_> =
        mistakes.filter(|mistake| rates || !matches!(mistake, Mistake::PosesTimes(_))).collect();
    with_vectors(&mistakes)
}

/// The samples of one instance against a scene.
#[derive(Clone, Copy)]
struct Comparison<'a> {
    scene: &'a SceneMotion,
    id: u32,
    samples: &'a [Sample],
}

/// Median length and error of the vectors, once some mistakes are undone.
#[derive(Clone, Copy)]
struct Fit {
    pixels: usize,
    motion_px: f64,
    error_px: f64,
}

impl Fit {
    fn agrees(&self) -> bool {
        self.error_px <= agreement_px(self.motion_px)
    }
}

impl Comparison<'_> {
    /// The verdict with `common` mistakes undone already. `None` for too few pixels.
    fn agreement(&self, common: &[Mistake], explanations: &[Vec<Mistake>]) -> Option<Agreement> {
        let as_given = self.fit(common)?;
        let verdict = if as_given.agrees() {
            if as_given.motion_px > AGREEMENT_PX { Verdict::Agrees } else { Verdict::Still }
        } else {
            self.explain(as_given, common, explanations)
        };
        Some(Agreement {
            pixels: as_given.pixels,
            median_motion_px: as_given.motion_px,
            median_error_px: as_given.error_px,
            verdict,
        })
    }

    /// Whether it agrees with this mistake undone too.
    fn agrees_as_well(&self, common: &[Mistake], mistake: Mistake) -> bool {
        let (as_given, undone) = (self.fit(common), self.fit(&[&[mistake], common].concat()));
        as_given
            .zip(undone)
            .is_some_and(|(as_given, undone)| undone.agrees() && 2 * undone.pixels >= as_given.pixels)
    }

    /// The explanation with the fewest mistakes that agrees, else the nearest.
    fn explain(&self, as_given: Fit, common: &[Mistake], explanations: &[Vec<Mistake>]) -> Verdict {
        let mut fits: Vec<(&Vec<Mistake>, Fit)> = explanations
            .iter()
            .filter_map(|explanation| {
                // An explanation that few of the pixels can be tried with is none.
                let fit = self.fit(&[explanation, common].concat())?;
                (2 * fit.pixels >= as_given.pixels).then_some((explanation, fit))
            })
            .collect();
        fits.sort_by(|(_, a), (_, b)| a.error_px.total_cmp(&b.error_px));
        // Minimum by count of mistakes keeps the first of equals, which has the least error.
        let fewest = fits.iter().filter(|(_, fit)| fit.agrees()).min_by_key(|(cause, _)| cause.len());
        let Some(&(best, fit)) = fewest else {
            let nearest = fits.iter().filter(|(_, fit)| {
                fit.error_px <= NEAREST_SHARE * as_given.error_px && fit.error_px <= slight_px(fit.motion_px)
            });
            let nearest = nearest.min_by_key(|(cause, _)| cause.len());
            let nearest =
                nearest.map(|(cause, fit)| Nearest { cause: (*cause).clone(), left_px: fit.error_px });
            return Verdict::Unexplained { nearest };
        };
        let limit_px = fit.error_px * (1.0 + TIE_SHARE) + 0.1 * AGREEMENT_PX;
        // A factor of the vectors has the blame alone only if nothing else would do.
        let by_factor = best.iter().any(|mistake| FACTORS.contains(mistake));
        let ties = fits.iter().filter(|(cause, other)| {
            let as_well = other.error_px >= fit.error_px && other.error_px <= limit_px;
            let of_others = cause.iter().any(|mistake| !mistake.is_of_vectors());
            cause.len() == best.len() && (as_well || by_factor && of_others && other.agrees())
        });
        Verdict::Mistaken { causes: ties.map(|(cause, _)| (*cause).clone()).collect(), left_px: fit.error_px }
    }

    /// How well the vectors fit once `mistakes` are undone. `None` for too few pixels.
    fn fit(&self, mistakes: &[Mistake]) -> Option<Fit> {
        let mut relative: BTreeMap<(i64, i64), Option<Pose>> = BTreeMap::new();
        let (mut lengths, mut errors) = (Vec::new(), Vec::new());
        let lens = mistakes.iter().fold(*self.scene.lens(), |lens, mistake| mistake.lens(lens));
        for sample in self.samples {
            let times = (sample.previous_ns, sample.t_ns);
            let motion = relative.entry(times).or_insert_with(|| self.relative(mistakes, times));
            let size_px = sample.size_px;
            let pixel_px = mistakes.iter().fold(sample.pixel_px, |p, m| m.pixel_px(p, size_px));
            let depth_m = mistakes.iter().fold(sample.depth_m, |d, m| m.depth_m(d, pixel_px, &lens));
            let Some(motion) = motion else { continue };
            let (length_px, error_px) = match lens.path(pixel_px, depth_m, motion) {
                Ok(ImagePoint { pixel_px: end_px, .. }) => {
                    let interval_s = (sample.t_ns - sample.previous_ns) as f64 * 1e-9;
                    let given_px =
                        mistakes.iter().fold(sample.vector, |v, m| m.vector_px(v, size_px, interval_s));
                    ((end_px - pixel_px).length(), (end_px - pixel_px).distance(given_px))
                }
                // As far off as the image is large.
                Err(NoPath::BehindCamera) => (size_px.length(), size_px.length()),
                Err(_) => continue,
            };
            lengths.push(length_px);
            errors.push(error_px);
        }
        (errors.len() >= FEWEST_PIXELS).then(|| Fit {
            pixels: errors.len(),
            motion_px: median(&mut lengths),
            error_px: median(&mut errors),
        })
    }

    /// The instance's motion as the camera sees it from a frame to the one before, once `mistakes` are undone.
    fn relative(&self, mistakes: &[Mistake], (previous_ns, t_ns): (i64, i64)) -> Option<Pose> {
        let frame_ns = t_ns.checked_sub(previous_ns)?;
        let shift_ns = frame_ns.checked_mul(mistakes.iter().map(|m| m.shift_frames()).sum())?;
        let to_next = mistakes.contains(&Mistake::VectorsToNextFrame);
        let other_ns = if to_next { t_ns.checked_add(frame_ns)? } else { previous_ns };
        let at = |track: &PoseTrack, t_ns: i64| {
            let t_ns =
                mistakes.iter().fold(t_ns, |t_ns, mistake| mistake.time_ns(t_ns)).checked_add(shift_ns)?;
            let (first_ns, last_ns) = (*track.times_ns().first()?, *track.times_ns().last()?);
            let end_ns = t_ns.clamp(first_ns, last_ns);
            track.at(if t_ns.abs_diff(end_ns) <= ROUNDING_NS { end_ns } else { t_ns }).ok()
        };
        let camera = |t_ns| {
            Some(mistakes.iter().fold(at(self.scene.camera(), t_ns)?, |pose, mistake| mistake.camera(pose)))
        };
        let exchanged = mistakes.iter().find_map(|mistake| match mistake {
            Mistake::BodyOf(other) => Some(*other),
            _ => None,
        });
        let body = |t_ns| match self.scene.instance(exchanged.unwrap_or(self.id)) {
            None => Some(Pose::IDENTITY),
            Some(track) => Some(mistakes.iter().fold(at(track, t_ns)?, |pose, mistake| mistake.body(pose))),
        };
        Some(camera(other_ns)?.inverse() * body(other_ns)? * body(t_ns)?.inverse() * camera(t_ns)?)
    }
}

/// The middle one of `values`, of which there is one at least.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests;
