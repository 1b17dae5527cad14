//! Stage `synthesize`: the intensity of a pixel at the end of every sub-step, from the two frames
//! that an interval lies between.

pub mod lattice;
pub mod motion;
pub mod paper;
pub mod paths;
pub mod taps;
pub mod transfer;

use crate::ingest::{Image, plane_of};
use esaac_model::{SensorModel, Synthesis};
use lattice::Lattice;
use motion::Motion;

/// An interval's two frames, made ready for a synthesis.
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
    /// Both frames made ready for `motion`, if that is the synthesis.
    pub motion: Option<Motion>,
}

impl<'a> Gap<'a> {
    /// The gap between two frames; `ratio` is the length of the interval before over this one's, `None`
    /// in the first interval; `history` is what [`Gap::into_history`] gave for the one before.
    #[must_use]
    pub fn new(
        sensor: &'a SensorModel,
        start: &'a Image,
        end: &'a Image,
        ratio: Option<f64>,
        history: Option<Vec<Lattice>>,
    ) -> Self {
        let start_planes = start.planes(sensor.intensity);
        let end_planes = end.planes(sensor.intensity);
        let motion = match sensor.synthesis {
            Synthesis::Motion => {
                Motion::new(sensor, start, end, [&start_planes, &end_planes], ratio, history)
            }
            Synthesis::Linear | Synthesis::Paper | Synthesis::None => None,
        };
        Gap { sensor, start, end, start_planes, end_planes, motion }
    }

    /// What the next gap builds on.
    #[must_use]
    pub fn into_history(self) -> Option<Vec<Lattice>> {
        self.motion.and_then(Motion::into_history)
    }

    /// Intensity of pixel `(x, y)` at the start of the interval and at the end of each of `substeps`
    /// sub-steps. The first and the last are the frames' own.
    pub fn samples(&self, x: usize, y: usize, substeps: u32, samples: &mut Vec<f64>) {
        let pixel = y * self.end.width + x;
        let plane = plane_of(self.sensor.intensity, x, y);
        let (from, to) = (self.start_planes[plane][pixel], self.end_planes[plane][pixel]);
        samples.clear();
        samples.push(from);
        for i in 1..substeps {
            let fraction = f64::from(i) / f64::from(substeps);
            let synthesized = match self.sensor.synthesis {
                Synthesis::Linear | Synthesis::None => None,
                Synthesis::Paper => paper::sample(self, plane, x, y, fraction),
                Synthesis::Motion => {
                    self.motion.as_ref().and_then(|motion| motion.sample(plane, x, y, fraction))
                }
            };
            samples.push(synthesized.unwrap_or_else(|| linear(from, to, fraction)));
        }
        samples.push(to);
    }
}

/// Synthesis `linear`: a blend of the two frames, and what a pixel falls back to.
#[must_use]
pub fn linear(from: f64, to: f64, fraction: f64) -> f64 {
    (1.0 - fraction) * from + fraction * to
}
