//! Stage `synthesize`: the intensity of a pixel at the end of every sub-step, from the two frames of the interval.

pub mod half_pel;
pub mod layers;
pub mod motion;
pub mod paper;
pub mod rigid;
pub mod sampling;
pub mod taps;
pub mod trajectory;
pub mod transfer;

use crate::ingest::{Image, plane_of};
use esaac_model::paths::SceneMotion;
use esaac_model::{SensorModel, Synthesis};
use half_pel::HalfPelFrame;
use motion::Motion;
use rigid::candidates::Instant;
use rigid::surface::Geometry;
use rigid::{Input, Rigid, Sample};
use sampling::Sampling;
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::rc::Rc;

/// What an interval hands on to the next: half-pel frames of its end, one per plane.
#[derive(Clone, Debug)]
pub enum History {
    /// Of synthesis `motion`.
    Motion(Vec<HalfPelFrame>),
    /// Of synthesis `rigid`.
    Rigid(Vec<HalfPelFrame>),
}

/// The motion of an interval's scene, for synthesis `rigid`.
#[derive(Clone, Copy, Debug)]
pub struct Motions<'a> {
    /// Poses.
    pub scene: &'a SceneMotion,
    /// Times of the two frames.
    pub times_ns: [i64; 2],
}

/// The two frames of an interval, prepared for a synthesis.
pub struct Gap<'a> {
    /// The sensor.
    pub sensor: &'a SensorModel,
    /// Frame at the interval's start.
    pub start: &'a Image,
    /// Frame at its end.
    pub end: &'a Image,
    /// Intensity planes of `start` ([`Image::planes`]).
    pub start_planes: Vec<Vec<f64>>,
    /// Intensity planes of `end`.
    pub end_planes: Vec<Vec<f64>>,
    /// Both frames prepared for synthesis `motion`, if that is chosen and possible; with synthesis `rigid`, for the
    /// pixels that have no path.
    pub motion: Option<Motion>,
    /// Both frames prepared for synthesis `rigid`, likewise.
    pub rigid: Option<Rigid<'a>>,
    /// Pixel sub-steps that show what neither frame shows.
    unseen: Cell<u64>,
    /// Poses at the ends of sub-steps, by sub-step and their number.
    instants: RefCell<BTreeMap<(u32, u32), Rc<Instant>>>,
}

impl<'a> Gap<'a> {
    /// Prepares the gap between two frames. `ratio` is the length of the previous interval over that of this one,
    /// `None` in the first interval. `history` comes from [`Gap::into_history`] of the previous interval. `sampling`
    /// says how synthesis `motion` reads its frames. Synthesis `rigid` needs `motions`.
    #[must_use]
    pub fn new(
        sensor: &'a SensorModel,
        start: &'a Image,
        end: &'a Image,
        ratio: Option<f64>,
        history: Option<History>,
        sampling: Sampling,
        motions: Option<Motions<'a>>,
    ) -> Self {
        let start_planes = start.planes(sensor.intensity);
        let end_planes = end.planes(sensor.intensity);
        let planes = [&start_planes[..], &end_planes[..]];
        let (mut motion, mut rigid) = (None, None);
        match sensor.synthesis {
            Synthesis::Motion => {
                let history = match history {
                    Some(History::Motion(history)) => Some(history),
                    _ => None,
                };
                motion = Motion::new(sensor, start, end, planes, ratio, history, sampling);
            }
            Synthesis::Rigid => {
                let history = match history {
                    Some(History::Rigid(history)) => Some(history),
                    _ => None,
                };
                rigid = prepare_rigid(sensor, [start, end], planes, history, motions);
                motion = rigid
                    .as_ref()
                    .and_then(|rigid| Motion::without_paths(sensor, start, end, ratio, rigid.half_pels()));
            }
            Synthesis::Linear | Synthesis::Paper | Synthesis::None | Synthesis::Auto => {}
        }
        let (unseen, instants) = (Cell::new(0), RefCell::new(BTreeMap::new()));
        Gap { sensor, start, end, start_planes, end_planes, motion, rigid, unseen, instants }
    }

    /// The history for the next gap.
    #[must_use]
    pub fn into_history(self) -> Option<History> {
        match self.rigid {
            Some(rigid) => Some(History::Rigid(rigid.into_history())),
            None => self.motion.and_then(Motion::into_history).map(History::Motion),
        }
    }

    /// Pixel sub-steps so far that show what neither frame shows.
    #[must_use]
    pub fn unseen(&self) -> u64 {
        self.unseen.get()
    }

    /// What synthesis `rigid` shows at the end of sub-step `i` of `n`.
    fn rigid_sample(&self, plane: usize, (x, y): (usize, usize), i: u32, n: u32) -> Option<f64> {
        let rigid = self.rigid.as_ref()?;
        let instant = self
            .instants
            .borrow_mut()
            .entry((i, n))
            .or_insert_with(|| Rc::new(rigid.instant(f64::from(i) / f64::from(n))))
            .clone();
        let sample = rigid.sample(&instant, plane, x, y);
        self.unseen.set(self.unseen.get() + u64::from(matches!(sample, Sample::Unseen(_))));
        sample.intensity()
    }

    /// Writes the intensity of pixel `(x, y)` at the interval's start and at the end of each of `substeps` sub-steps to
    /// `samples`, scene units. The first and the last are those of the frames.
    pub fn samples(&self, x: usize, y: usize, substeps: u32, samples: &mut Vec<f64>) {
        let pixel = y * self.end.width + x;
        let plane = plane_of(self.sensor.intensity, x, y);
        let (from, to) = (self.start_planes[plane][pixel], self.end_planes[plane][pixel]);
        let along_vector =
            |fraction| self.motion.as_ref().and_then(|motion| motion.sample(plane, x, y, fraction));
        samples.clear();
        samples.push(from);
        for i in 1..substeps {
            let fraction = f64::from(i) / f64::from(substeps);
            let synthesized = match self.sensor.synthesis {
                Synthesis::Linear | Synthesis::None | Synthesis::Auto => None,
                Synthesis::Rigid => {
                    self.rigid_sample(plane, (x, y), i, substeps).or_else(|| along_vector(fraction))
                }
                Synthesis::Paper => paper::sample(self, plane, x, y, fraction),
                Synthesis::Motion => along_vector(fraction),
            };
            samples.push(synthesized.unwrap_or_else(|| linear(from, to, fraction)));
        }
        samples.push(to);
    }
}

/// Both frames prepared for synthesis `rigid`, if they have depth and there are poses.
fn prepare_rigid<'a>(
    sensor: &SensorModel,
    images: [&Image; 2],
    planes: [&[Vec<f64>]; 2],
    history: Option<Vec<HalfPelFrame>>,
    motions: Option<Motions<'a>>,
) -> Option<Rigid<'a>> {
    let Motions { scene, times_ns } = motions?;
    let [start, end] = images.map(|image| {
        let (depth_m, ids) = image.geometry.as_ref()?;
        Some(Geometry { size: (image.width, image.height), depth_m, ids })
    });
    let geometries = [start?, end?];
    let inputs =
        [0, 1].map(|key| Input { t_ns: times_ns[key], planes: planes[key], geometry: geometries[key] });
    Some(Rigid::new(scene, inputs, sensor.log_offset, (sensor.taps, sensor.detail_transfers()), history))
}

/// Synthesis `linear`: blends the two frames. A pixel without a usable motion vector falls back to it.
#[must_use]
pub fn linear(from: f64, to: f64, fraction: f64) -> f64 {
    (1.0 - fraction) * from + fraction * to
}
