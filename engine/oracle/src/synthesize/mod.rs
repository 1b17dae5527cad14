//! Stage `synthesize`: the intensity of a pixel at the end of every sub-step, from the two frames of the interval.

pub mod half_pel;
pub mod motion;
pub mod paper;
pub mod rigid;
pub mod sampling;
pub mod taps;
pub mod trajectory;
pub mod transfer;

use crate::ingest::{Image, plane_of};
use esaac_model::{SensorModel, Synthesis};
use half_pel::HalfPelFrame;
use motion::Motion;
use sampling::Sampling;

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
    /// Both frames prepared for synthesis `motion`, if that is chosen and possible.
    pub motion: Option<Motion>,
}

impl<'a> Gap<'a> {
    /// Prepares the gap between two frames. `ratio` is the length of the previous interval over that of this one,
    /// `None` in the first interval. `history` comes from [`Gap::into_history`] of the previous interval. `sampling`
    /// says how synthesis `motion` reads its frames.
    #[must_use]
    pub fn new(
        sensor: &'a SensorModel,
        start: &'a Image,
        end: &'a Image,
        ratio: Option<f64>,
        history: Option<Vec<HalfPelFrame>>,
        sampling: Sampling,
    ) -> Self {
        let start_planes = start.planes(sensor.intensity);
        let end_planes = end.planes(sensor.intensity);
        let motion = match sensor.synthesis {
            Synthesis::Motion => {
                Motion::new(sensor, start, end, [&start_planes, &end_planes], ratio, history, sampling)
            }
            Synthesis::Linear | Synthesis::Paper | Synthesis::None => None,
        };
        Gap { sensor, start, end, start_planes, end_planes, motion }
    }

    /// The history for the next gap.
    #[must_use]
    pub fn into_history(self) -> Option<Vec<HalfPelFrame>> {
        self.motion.and_then(Motion::into_history)
    }

    /// Writes the intensity of pixel `(x, y)` at the interval's start and at the end of each of `substeps` sub-steps to
    /// `samples`, scene units. The first and the last are those of the frames.
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

/// Synthesis `linear`: blends the two frames. A pixel without a usable motion vector falls back to it.
#[must_use]
pub fn linear(from: f64, to: f64, fraction: f64) -> f64 {
    (1.0 - fraction) * from + fraction * to
}
