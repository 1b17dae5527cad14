//! Whether depth, ids and poses follow the conventions: they predict a renderer's motion vectors.
//!
//! For pixels of each key frame, the vector predicted is `path(x, z, b, t_k, t_{k-1}) - x` ([`SceneMotion::path`]). The
//! error is the distance to the vector given, and its median is taken apart for the static world and each instance. So
//! pixels at edges, which show two surfaces, do not count. Backgrounds at infinity are left out: renderers differ in what
//! vectors they give them.
//!
//! The two agree if the median error is at most [`AGREEMENT_PX`] or [`AGREEMENT_SHARE`] of the median motion. If not,
//! every [`Mistake`] is undone in turn, alone and together with a mistake of the vectors' sign and unit. What explains
//! the vectors with the fewest mistakes is the cause. It explains them if what is left agrees, or is a quarter of the
//! error at most.

mod mistake;

pub use mistake::Mistake;

use super::{ImagePoint, Pose, PoseTrack, STATIC_WORLD, SceneMotion};
use glam::DVec2;
use mistake::{BODY, CAMERA, SIGNS, UNITS};
use std::collections::BTreeMap;
use thiserror::Error;

/// Median error that is rounding, pixels.
pub const AGREEMENT_PX: f64 = 0.02;

/// Median error, over the median motion, that is rounding: half floats have a thousandth.
pub const AGREEMENT_SHARE: f64 = 0.02;

/// Part of the error that may be left by an explanation that is not exact.
const EXPLAINED_SHARE: f64 = 0.25;

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

/// A key frame as the renderer gave it.
#[derive(Clone, Copy, Debug)]
pub struct KeyFrame<'a> {
    width_px: u32,
    height_px: u32,
    t_ns: i64,
    previous_ns: i64,
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
    Unexplained,
}

impl<'a> KeyFrame<'a> {
    /// A frame of `width_px` x `height_px` at `t_ns` whose vectors lead to `previous_ns`, row by row. Without ids all
    /// belongs to the static world.
    ///
    /// # Errors
    /// If an image has another number of pixels.
    pub fn new(
        (width_px, height_px): (u32, u32),
        (previous_ns, t_ns): (i64, i64),
        depth_m: &'a [f32],
        ids: Option<&'a [u32]>,
        motion_px: &'a [[f32; 2]],
    ) -> Result<Self, ShapeError> {
        let expected = width_px as usize * height_px as usize;
        let ids_len = ids.map_or(expected, <[u32]>::len);
        for (image, actual) in [("depth", depth_m.len()), ("ids", ids_len), ("motion", motion_px.len())] {
            if actual != expected {
                return Err(ShapeError { image, expected, actual, width_px, height_px });
            }
        }
        Ok(KeyFrame { width_px, height_px, t_ns, previous_ns, depth_m, ids, motion_px })
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
    /// Takes pixels of a frame: evenly spread, some of each instance. A frame whose vectors are all 0 says nothing:
    /// renderers have none for their first frame.
    pub fn add(&mut self, frame: &KeyFrame<'_>) {
        if frame.motion_px.iter().all(|vector| *vector == [0.0; 2]) {
            return;
        }
        let usable = |i: usize| {
            let (depth_m, vector) = (frame.depth_m[i], frame.motion_px[i]);
            depth_m > 0.0 && depth_m.is_finite() && vector.iter().all(|v| v.is_finite())
        };
        let mut pixels: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for i in (0..frame.depth_m.len()).filter(|&i| usable(i)) {
            pixels.entry(frame.ids.map_or(STATIC_WORLD, |ids| ids[i])).or_default().push(i);
        }
        let size_px = DVec2::new(f64::from(frame.width_px), f64::from(frame.height_px));
        for (id, pixels) in pixels {
            let stride = pixels.len().div_ceil(PIXELS_OF_INSTANCE);
            self.samples.entry(id).or_default().extend(pixels.iter().step_by(stride).map(|&i| Sample {
                pixel_px: DVec2::new(
                    (i % frame.width_px as usize) as f64,
                    (i / frame.width_px as usize) as f64,
                ),
                size_px,
                depth_m: f64::from(frame.depth_m[i]),
                vector: DVec2::from(frame.motion_px[i].map(f64::from)),
                t_ns: frame.t_ns,
                previous_ns: frame.previous_ns,
            }));
        }
    }

    /// Compares what was collected with `scene`. `None` if too few pixels can be compared.
    #[must_use]
    pub fn report(&self, scene: &SceneMotion) -> Option<ConventionReport> {
        let mut report =
            ConventionReport { world: None, instances: BTreeMap::new(), pixels_without_poses: 0 };
        // Mistakes of the camera and the vectors, found on the static world, hold for the instances too.
        let mut common: Vec<Mistake> = Vec::new();
        let mut explanations = camera_explanations();
        if let Some(samples) = self.samples.get(&STATIC_WORLD) {
            report.world = Comparison { scene, id: STATIC_WORLD, samples }.agreement(&common, &explanations);
        }
        let body_alone = || BODY.iter().map(|&mistake| vec![mistake]).collect();
        match report.world.as_ref().map(|world| &world.verdict) {
            Some(Verdict::Agrees) => explanations = body_alone(),
            Some(Verdict::Mistaken { causes, .. }) => {
                common.clone_from(&causes[0]);
                explanations = body_alone();
            }
            Some(Verdict::Still | Verdict::Unexplained) | None => {
                explanations.extend(with_vectors(&BODY));
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

/// All combinations of one of `mistakes` or none with a sign and a unit of the vectors, fewest mistakes first.
fn with_vectors(mistakes: &[Mistake]) -> Vec<Vec<Mistake>> {
    let alone = mistakes.iter().map(std::slice::from_ref).chain([&[][..]]);
    let mut all: Vec<Vec<Mistake>> = alone
        .flat_map(|other| {
            let vectors = SIGNS.iter().flat_map(|sign| UNITS.iter().map(move |unit| (sign, unit)));
            vectors.map(move |(sign, unit)| [other, sign, unit].concat())
        })
        .filter(|combination| !combination.is_empty())
        .collect();
    all.sort_by_key(Vec::len);
    all
}

fn camera_explanations() -> Vec<Vec<Mistake>> {
    with_vectors(&CAMERA)
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
        self.error_px <= AGREEMENT_PX.max(AGREEMENT_SHARE * self.motion_px)
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

    /// The explanation with the fewest mistakes that agrees, else the best one that explains most of the error.
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
        let explained = |fit: &Fit| fit.error_px <= EXPLAINED_SHARE * as_given.error_px;
        // Minimum by count of mistakes keeps the first of equals, which has the least error.
        let fewest = fits.iter().filter(|(_, fit)| fit.agrees()).min_by_key(|(cause, _)| cause.len());
        let Some(&(best, fit)) = fewest.or_else(|| fits.first().filter(|(_, fit)| explained(fit))) else {
            return Verdict::Unexplained;
        };
        let limit_px = fit.error_px * (1.0 + TIE_SHARE) + 0.1 * AGREEMENT_PX;
        let ties = fits.iter().filter(|(cause, other)| {
            cause.len() == best.len() && other.error_px >= fit.error_px && other.error_px <= limit_px
        });
        Verdict::Mistaken { causes: ties.map(|(cause, _)| (*cause).clone()).collect(), left_px: fit.error_px }
    }

    /// How well the vectors fit once `mistakes` are undone. `None` for too few pixels.
    fn fit(&self, mistakes: &[Mistake]) -> Option<Fit> {
        let mut relative: BTreeMap<(i64, i64), Option<Pose>> = BTreeMap::new();
        let (mut lengths, mut errors) = (Vec::new(), Vec::new());
        for sample in self.samples {
            let times = (sample.previous_ns, sample.t_ns);
            let motion = relative.entry(times).or_insert_with(|| self.relative(mistakes, times));
            let size_px = sample.size_px;
            let pixel_px = mistakes.iter().fold(sample.pixel_px, |p, m| m.pixel_px(p, size_px));
            let lens = self.scene.lens();
            let depth_m = mistakes.iter().fold(sample.depth_m, |d, m| m.depth_m(d, pixel_px, lens));
            let Some(motion) = motion else { continue };
            let Ok(ImagePoint { pixel_px: end_px, .. }) = lens.path(pixel_px, depth_m, motion) else {
                continue;
            };
            let given_px = mistakes.iter().fold(sample.vector, |v, m| m.vector_px(v, size_px));
            lengths.push((end_px - pixel_px).length());
            errors.push((end_px - pixel_px).distance(given_px));
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
            let t_ns = t_ns.checked_add(shift_ns)?;
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
mod tests {
    use super::*;
    use crate::paths::Intrinsics;
    use glam::{DQuat, DVec3};

    const WIDTH_PX: u32 = 64;
    const HEIGHT_PX: u32 = 48;
    const FRAME_NS: i64 = 33_333_333;
    const FRAMES: i64 = 6;
    const BALL: u32 = 9;
    const OTHER: u32 = 11;

    /// A camera by hand, unevenly: nothing about it is symmetric or steady.
    fn camera(k: f64) -> Pose {
        let turn = DVec3::new(
            0.9 + 0.06 * (1.1 * k).sin(),
            0.4 + 0.05 * (0.8 * k + 1.0).sin(),
            0.2 + 0.04 * (1.7 * k).cos(),
        );
        let place =
            DVec3::new(0.3 * (0.9 * k).sin(), -2.0 + 0.2 * (1.3 * k).cos(), 1.5 + 0.1 * (0.7 * k).sin());
        Pose::new(DQuat::from_scaled_axis(turn), place).unwrap()
    }

    /// A ball that tumbles and speeds up.
    fn ball(k: f64) -> Pose {
        let turn = DVec3::new(0.3 * k, 0.5 + 0.05 * k * k, 0.4);
        Pose::new(DQuat::from_scaled_axis(turn), DVec3::new(0.2 * k, 1.0 - 0.02 * k * k, 0.5)).unwrap()
    }

    /// A body that goes another way.
    fn other(k: f64) -> Pose {
        let turn = DVec3::new(0.1, 0.4 * k, 0.2 * k);
        Pose::new(DQuat::from_scaled_axis(turn), DVec3::new(1.0, 0.3 * k, -0.1 * k)).unwrap()
    }

    /// Time, depth, ids and vectors of a key frame.
    type Images = (i64, Vec<f32>, Vec<u32>, Vec<[f32; 2]>);

    struct Sequence {
        scene: SceneMotion,
        frames: Vec<Images>,
    }

    fn pixel_px(i: usize) -> DVec2 {
        DVec2::new((i % WIDTH_PX as usize) as f64, (i / WIDTH_PX as usize) as f64)
    }

    fn track(pose: impl Fn(f64) -> Pose) -> PoseTrack {
        let samples = 0..=4 * FRAMES;
        PoseTrack::new(
            samples.clone().map(|j| j * FRAME_NS / 4).collect(),
            samples.map(|j| pose(j as f64 / 4.0)).collect(),
        )
        .unwrap()
    }

    fn scene(lens: Intrinsics, camera: impl Fn(f64) -> Pose, ball: impl Fn(f64) -> Pose) -> SceneMotion {
        let mut scene = SceneMotion::new(lens, track(camera));
        scene.insert(BALL, track(ball)).unwrap();
        scene
    }

    fn lens() -> Intrinsics {
        Intrinsics::pinhole(60.0, 55.0, 31.0, 24.0).unwrap()
    }

    /// Right in everything: a rough surface, a ball in the middle, a few pixels of sky and of edges.
    fn right() -> Sequence {
        let scene = scene(lens(), camera, ball);
        let frames = (1..FRAMES).map(|k| {
            let (mut depth, mut ids, mut motion) = (Vec::new(), Vec::new(), Vec::new());
            for i in 0..WIDTH_PX * HEIGHT_PX {
                let (x, y) = (f64::from(i % WIDTH_PX), f64::from(i / WIDTH_PX));
                let id = if (x - 30.0).hypot(y - 20.0) < 9.0 { BALL } else { STATIC_WORLD };
                let depth_m = if i < 40 {
                    f64::INFINITY
                } else {
                    3.0 + (0.3 * x).sin() + 0.8 * (0.2 * y + 0.1 * x).cos()
                };
                let pixel_px = DVec2::new(x, y);
                let end = scene.path(pixel_px, depth_m, id, k * FRAME_NS, (k - 1) * FRAME_NS).unwrap();
                let at_edge = i % 11 == 0;
                let vector = if at_edge { DVec2::new(9.0, -7.0) } else { end.pixel_px - pixel_px };
                depth.push(depth_m as f32);
                ids.push(id);
                motion.push(vector.to_array().map(|v| v as f32));
            }
            (k * FRAME_NS, depth, ids, motion)
        });
        Sequence { frames: frames.collect(), scene }
    }

    fn report(sequence: &Sequence) -> ConventionReport {
        let mut check = ConventionCheck::default();
        for (t_ns, depth, ids, motion) in &sequence.frames {
            let times = (t_ns - FRAME_NS, *t_ns);
            check.add(&KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap());
        }
        check.report(&sequence.scene).expect("enough pixels")
    }

    fn change_vectors(sequence: &mut Sequence, change: impl Fn([f32; 2]) -> [f32; 2]) {
        for vector in sequence.frames.iter_mut().flat_map(|(_, _, _, motion)| motion) {
            *vector = change(*vector);
        }
    }

    fn change_depth(sequence: &mut Sequence, change: impl Fn(f64, DVec2) -> f64) {
        for (_, depth, _, _) in &mut sequence.frames {
            for (i, depth_m) in depth.iter_mut().enumerate() {
                *depth_m = change(f64::from(*depth_m), pixel_px(i)) as f32;
            }
        }
    }

    /// World and ball as they are, with columns exchanged or signs changed: `pose` with other axes of the camera.
    fn with_axes(pose: Pose, axes: [[f64; 3]; 3]) -> Pose {
        let rows = pose.to_rows();
        let mut other = rows;
        for (i, row) in other.iter_mut().take(3).enumerate() {
            for (j, axis) in axes.iter().enumerate() {
                row[j] = (0..3).map(|l| rows[i][l] * axis[l]).sum();
            }
        }
        Pose::from_rows(&other).unwrap()
    }

    fn with_transposed_rotation(pose: Pose) -> Pose {
        let rows = pose.to_rows();
        let mut other = rows;
        for i in 0..3 {
            for j in 0..3 {
                other[i][j] = rows[j][i];
            }
        }
        Pose::from_rows(&other).unwrap()
    }

    fn read_scalar_first_as_last(pose: Pose) -> Pose {
        let [x, y, z, w] = pose.rotation().to_array();
        let [tx, ty, tz] = pose.translation_m().to_array();
        Pose::from_xyz_qxyzw(&[tx, ty, tz, w, x, y, z]).unwrap()
    }

    /// The sequence with a mistake made in it. Each is written as who makes it would, not as it is undone.
    fn planted(mistake: Mistake) -> Sequence {
        let mut sequence = right();
        let (width, height) = (WIDTH_PX as f32, HEIGHT_PX as f32);
        let with_camera = |change: fn(Pose) -> Pose| scene(lens(), |k| change(camera(k)), ball);
        let with_ball = |change: fn(Pose) -> Pose| scene(lens(), camera, |k| change(ball(k)));
        match mistake {
            Mistake::VectorsNegated => change_vectors(&mut sequence, |[x, y]| [-x, -y]),
            Mistake::VectorsYUp => change_vectors(&mut sequence, |[x, y]| [x, -y]),
            Mistake::VectorsXLeft => change_vectors(&mut sequence, |[x, y]| [-x, y]),
            Mistake::VectorsOfImageSize => change_vectors(&mut sequence, |[x, y]| [x / width, y / height]),
            Mistake::VectorsOfHalfSize => {
                change_vectors(&mut sequence, |[x, y]| [2.0 * x / width, 2.0 * y / height]);
            }
            Mistake::VectorsToNextFrame => {
                for (t_ns, depth, ids, motion) in &mut sequence.frames {
                    for i in 0..motion.len() {
                        let pixel_px = pixel_px(i);
                        let end = sequence
                            .scene
                            .path(pixel_px, f64::from(depth[i]), ids[i], *t_ns, *t_ns + FRAME_NS)
                            .unwrap();
                        motion[i] = (end.pixel_px - pixel_px).to_array().map(|v| v as f32);
                    }
                }
            }
            Mistake::PosesAhead => {
                sequence.scene = scene(lens(), |k| camera(k + 1.0), |k| ball(k + 1.0));
            }
            Mistake::PosesBehind => {
                sequence.scene = scene(lens(), |k| camera(k - 1.0), |k| ball(k - 1.0));
            }
            // Columns: right, down, forward.
            Mistake::CameraOpenCv => {
                sequence.scene = with_camera(|pose| {
                    with_axes(pose, [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
                });
            }
            // Left, up, forward.
            Mistake::CameraAlongZ => {
                sequence.scene = with_camera(|pose| {
                    with_axes(pose, [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
                });
            }
            // Forward, left, up.
            Mistake::CameraAlongX => {
                sequence.scene = with_camera(|pose| {
                    with_axes(pose, [[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
                });
            }
            Mistake::CameraInverted => sequence.scene = with_camera(|pose| pose.inverse()),
            Mistake::CameraTransposed => sequence.scene = with_camera(with_transposed_rotation),
            Mistake::CameraScalarFirst => sequence.scene = with_camera(read_scalar_first_as_last),
            Mistake::DepthOfOtherKind => change_depth(&mut sequence, |depth_m, pixel_px| {
                let point = lens().unproject(pixel_px, depth_m).unwrap();
                point.truncate().length() * depth_m
            }),
            Mistake::DepthTimes(factor) => change_depth(&mut sequence, |depth_m, _| depth_m / factor),
            Mistake::RowsFromBottom => {
                let size = WIDTH_PX as usize;
                for (_, depth, ids, motion) in &mut sequence.frames {
                    *depth = depth.chunks(size).rev().flatten().copied().collect();
                    *ids = ids.chunks(size).rev().flatten().copied().collect();
                    *motion = motion.chunks(size).rev().flatten().map(|&[x, y]| [x, -y]).collect();
                }
            }
            Mistake::BodyInverted => sequence.scene = with_ball(|pose| pose.inverse()),
            Mistake::BodyTransposed => sequence.scene = with_ball(with_transposed_rotation),
            Mistake::BodyScalarFirst => sequence.scene = with_ball(read_scalar_first_as_last),
            Mistake::BodyOf(_) => {
                sequence.scene = scene(lens(), camera, other);
                sequence.scene.insert(OTHER, track(ball)).unwrap();
            }
            Mistake::BodyStill => {
                let still = scene(lens(), camera, |_| Pose::IDENTITY);
                for (t_ns, depth, ids, motion) in &mut sequence.frames {
                    for i in (0..motion.len()).filter(|&i| ids[i] == BALL) {
                        let pixel_px = pixel_px(i);
                        let end =
                            still.path(pixel_px, f64::from(depth[i]), BALL, *t_ns, *t_ns - FRAME_NS).unwrap();
                        motion[i] = (end.pixel_px - pixel_px).to_array().map(|v| v as f32);
                    }
                }
            }
        }
        sequence
    }

    fn mistaken(agreement: &Agreement) -> &[Vec<Mistake>] {
        match &agreement.verdict {
            Verdict::Mistaken { causes, .. } => causes,
            verdict => panic!("{verdict:?}, error {} px", agreement.median_error_px),
        }
    }

    #[test]
    fn a_right_sequence_agrees() {
        let report = report(&right());
        assert!(report.agrees(), "{report:?}");
        let world = report.world.unwrap();
        assert_eq!(world.verdict, Verdict::Agrees);
        assert!(world.median_error_px < 1e-4 && world.median_motion_px > 1.0, "{world:?}");
        assert_eq!(report.instances[&BALL].verdict, Verdict::Agrees);
        assert_eq!(report.pixels_without_poses, 0);
    }

    #[test]
    fn each_mistake_of_vectors_camera_depth_or_time_is_the_one_named() {
        let vectors = SIGNS.iter().chain(&UNITS).filter_map(|one| one.first());
        for &mistake in vectors.chain(&CAMERA) {
            let report = report(&planted(mistake));
            let world = report.world.as_ref().unwrap();
            let causes = mistaken(world);
            assert_eq!(causes[0], [mistake], "{world:?}");
            assert_eq!(causes.len(), 1, "{mistake:?} is not told from {causes:?}");
            assert!(!report.agrees());
            // The ball has no mistake of its own.
            assert_eq!(report.instances[&BALL].verdict, Verdict::Agrees, "{mistake:?}");
        }
    }

    #[test]
    fn each_mistake_of_a_body_is_named_and_the_world_agrees() {
        for mistake in [
            Mistake::BodyInverted,
            Mistake::BodyTransposed,
            Mistake::BodyScalarFirst,
            Mistake::BodyStill,
            Mistake::BodyOf(OTHER),
        ] {
            let report = report(&planted(mistake));
            assert_eq!(report.world.as_ref().unwrap().verdict, Verdict::Agrees);
            let causes = mistaken(&report.instances[&BALL]);
            assert_eq!(causes, [vec![mistake]], "{mistake:?}");
        }
    }

    #[test]
    fn a_shift_is_found_in_three_intervals_whose_times_are_rounded() {
        let key_ns = |k: i64| (k as f64 * 1e9 / 30.0).round() as i64;
        // The poses end with the last frame to the nanosecond, and are a frame behind.
        let late = |pose: fn(f64) -> Pose| {
            let samples = (0..=3).map(|k| (key_ns(k), pose(k as f64 - 1.0)));
            let (times_ns, poses) = samples.unzip();
            PoseTrack::new(times_ns, poses).unwrap()
        };
        let mut scene = SceneMotion::new(lens(), late(camera));
        scene.insert(BALL, late(ball)).unwrap();
        let mut check = ConventionCheck::default();
        for (k, (_, depth, ids, motion)) in (1..=3).zip(&right().frames) {
            let times = (key_ns(k - 1), key_ns(k));
            check.add(&KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap());
        }
        let report = check.report(&scene).unwrap();
        assert_eq!(mistaken(report.world.as_ref().unwrap()), [vec![Mistake::PosesBehind]]);
    }

    #[test]
    fn two_mistakes_are_both_named() {
        let mut sequence = planted(Mistake::CameraOpenCv);
        change_vectors(&mut sequence, |[x, y]| [2.0 * x / WIDTH_PX as f32, -2.0 * y / HEIGHT_PX as f32]);
        let report = report(&sequence);
        let causes = mistaken(report.world.as_ref().unwrap());
        let expected = [Mistake::CameraOpenCv, Mistake::VectorsYUp, Mistake::VectorsOfHalfSize];
        assert_eq!(causes, [expected.to_vec()]);
        assert_eq!(report.instances[&BALL].verdict, Verdict::Agrees);
    }

    #[test]
    fn noise_is_unexplained() {
        let mut sequence = right();
        let mut state = 1_u32;
        for vector in sequence.frames.iter_mut().flat_map(|(_, _, _, motion)| motion) {
            *vector = [0; 2].map(|_: i32| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as f32 - 128.0
            });
        }
        assert_eq!(report(&sequence).world.unwrap().verdict, Verdict::Unexplained);
    }

    #[test]
    fn a_still_scene_tells_nothing_and_says_so() {
        let mut sequence = right();
        sequence.scene = scene(lens(), |_| camera(0.0), |_| ball(0.0));
        change_vectors(&mut sequence, |_| [0.001, 0.0]);
        let report = report(&sequence);
        assert_eq!(report.world.as_ref().unwrap().verdict, Verdict::Still);
        assert!(report.agrees());
    }

    #[test]
    fn without_a_world_the_ball_alone_tells_the_sign() {
        let mut sequence = planted(Mistake::VectorsNegated);
        sequence.frames.iter_mut().for_each(|(_, _, ids, _)| ids.fill(BALL));
        for (t_ns, depth, _, motion) in &mut sequence.frames {
            for i in 0..motion.len() {
                let pixel_px = pixel_px(i);
                let depth_m = f64::from(depth[i]);
                let end = sequence.scene.path(pixel_px, depth_m, BALL, *t_ns, *t_ns - FRAME_NS).unwrap();
                motion[i] = (pixel_px - end.pixel_px).to_array().map(|v| v as f32);
            }
        }
        let report = report(&sequence);
        assert_eq!(report.world, None);
        assert_eq!(mistaken(&report.instances[&BALL])[0], [Mistake::VectorsNegated]);
    }

    #[test]
    fn pixels_that_cannot_be_compared_are_left_out_or_counted() {
        let mut sequence = right();
        sequence.scene = SceneMotion::new(lens(), track(camera));
        let without = report(&sequence);
        assert!(without.pixels_without_poses > 500 && without.instances.is_empty());
        // Nothing but background, bad depth, bad vectors or vectors of a first frame: nothing to compare.
        for depth_m in [f32::INFINITY, 0.0, f32::NAN, -1.0] {
            change_depth(&mut sequence, |_, _| f64::from(depth_m));
            let mut check = ConventionCheck::default();
            for (t_ns, depth, ids, motion) in &sequence.frames {
                let times = (t_ns - FRAME_NS, *t_ns);
                check.add(&KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap());
            }
            assert_eq!(check.report(&sequence.scene), None, "{depth_m}");
        }
        for vector in [[f32::NAN, 0.0], [0.0, 0.0]] {
            let mut sequence = right();
            change_vectors(&mut sequence, |_| vector);
            let (t_ns, depth, ids, motion) = &sequence.frames[0];
            let mut check = ConventionCheck::default();
            let times = (t_ns - FRAME_NS, *t_ns);
            check.add(&KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap());
            assert_eq!(check.report(&sequence.scene), None, "{vector:?}");
        }
    }

    #[test]
    fn images_of_a_wrong_size_are_named() {
        let (depth, ids, motion) = ([1.0; 12], [0; 12], [[1.0; 2]; 12]);
        let error = |depth: &[f32], ids: &[u32], motion: &[[f32; 2]]| {
            KeyFrame::new((4, 3), (0, 1), depth, Some(ids), motion).unwrap_err().to_string()
        };
        assert_eq!(error(&depth[1..], &ids, &motion), "depth has 11 pixels, expected 12 (4x3)");
        assert_eq!(error(&depth, &ids[2..], &motion), "ids has 10 pixels, expected 12 (4x3)");
        assert_eq!(error(&depth, &ids, &motion[..0]), "motion has 0 pixels, expected 12 (4x3)");
        assert!(KeyFrame::new((4, 3), (0, 1), &depth, None, &motion).is_ok());
    }
}
