//! Half-pel frames: log images of twice their frame's density.

use super::sampling::Sampling;
use super::taps::{cubic, cubic_in};
use esaac_model::synthesis::{CELL_SLACK, CUBIC_FRAME};

/// A log image of twice its frame's density. Sample `(X, Y)` lies at pixel `(X / 2, Y / 2)`.
#[derive(Clone, Debug, PartialEq)]
pub struct HalfPelFrame {
    size: (usize, usize),
    log: Vec<f64>,
    sampling: Sampling,
}

impl HalfPelFrame {
    /// The half-pel frame of a frame of `size` pixels. Its samples at pixels are those of `frame`, the others are
    /// `between(X, Y)`. `sampling` says how it is read.
    #[must_use]
    pub fn new(
        size: (usize, usize),
        sampling: Sampling,
        frame: &[f64],
        between: impl Fn(usize, usize) -> f64,
    ) -> Self {
        let (width, height) = (2 * size.0, 2 * size.1);
        let entry = |i: usize| {
            let (x, y) = (i % width, i / width);
            if x % 2 == 0 && y % 2 == 0 { frame[y / 2 * size.0 + x / 2] } else { between(x, y) }
        };
        HalfPelFrame { size: (width, height), log: (0..width * height).map(entry).collect(), sampling }
    }

    /// The half-pel frame interpolated from one frame alone.
    #[must_use]
    pub fn of_frame(size: (usize, usize), sampling: Sampling, frame: &[f64]) -> Self {
        HalfPelFrame::new(size, sampling, frame, |x, y| {
            cubic(frame, size, 0.5 * x as f64, 0.5 * y as f64, CUBIC_FRAME, sampling.twelve_taps)
        })
    }

    /// The half-pel frame of these samples, row by row, of a frame of `size` pixels.
    #[must_use]
    pub fn of_samples(size: (usize, usize), sampling: Sampling, log: Vec<f64>) -> Self {
        HalfPelFrame { size: (2 * size.0, 2 * size.1), log, sampling }
    }

    /// How it is read.
    #[must_use]
    pub fn sampling(&self) -> Sampling {
        self.sampling
    }

    /// Its samples, row by row, nepers.
    #[must_use]
    pub fn into_samples(self) -> Vec<f64> {
        self.log
    }

    /// Sample `(X, Y)`, nepers.
    #[must_use]
    pub fn entry(&self, x: usize, y: usize) -> f64 {
        self.log[y * self.size.0 + x]
    }

    /// Value at a position in pixels of the frame, nepers. `parameter` is that of Keys' kernel.
    #[must_use]
    pub fn at(&self, [x, y]: [f64; 2], parameter: f64) -> f64 {
        cubic(&self.log, self.size, 2.0 * x, 2.0 * y, parameter, self.sampling.twelve_taps)
    }

    /// Value at pixel `at + step / 2 + shift`, nepers. `step` is 0 or 1 half-pel samples on each axis. With shared
    /// footprints, the taps are those of the cell `step` samples from the cell that contains `at + own_shift`.
    #[must_use]
    pub fn shared_footprint(
        &self,
        at: [usize; 2],
        own_shift: [f64; 2],
        step: [usize; 2],
        shift: [f64; 2],
        parameter: f64,
    ) -> f64 {
        if !self.sampling.shared_footprint {
            let on_axis = |axis: usize| at[axis] as f64 + 0.5 * step[axis] as f64 + shift[axis];
            return self.at([on_axis(0), on_axis(1)], parameter);
        }
        let sizes = [self.size.0, self.size.1];
        let on_axis = |axis: usize| {
            let last = (sizes[axis] - 1) as f64;
            let entry = 2.0 * at[axis] as f64;
            let cell = (entry + (2.0 * own_shift[axis]).floor()).clamp(0.0, last - 1.0) as usize + step[axis];
            let place = (entry + step[axis] as f64 + 2.0 * shift[axis]).clamp(0.0, last);
            (cell, (place - cell as f64).clamp(-CELL_SLACK, 1.0 + CELL_SLACK))
        };
        let ((x, fx), (y, fy)) = (on_axis(0), on_axis(1));
        cubic_in(&self.log, self.size, [x, y], [fx, fy], parameter, self.sampling.twelve_taps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::synthesis::CUBIC_HALF_PEL;

    #[test]
    fn beside_is_at_where_neighbours_move_alike_and_within_the_slack_where_they_do_not() {
        let size = (6, 5);
        let frame: Vec<f64> = (0..30).map(|i| f64::from(i * i % 7)).collect();
        let half_pel = HalfPelFrame::of_frame(size, Sampling::ENGINE, &frame);
        for shift in [[0.0, 0.0], [0.3, -0.4], [-1.7, 0.9]] {
            // Outside the image the cell is clamped to it, and so it does not contain the position.
            let inside =
                |at: usize, shift: f64, size: usize| (0.0..=(size - 1) as f64).contains(&(at as f64 + shift));
            let pixels = (0..30).map(|pixel| (pixel % 6, pixel / 6));
            for (x, y) in pixels.filter(|&(x, y)| inside(x, shift[0], 6) && inside(y, shift[1], 5)) {
                for step in [[0, 0], [1, 0], [0, 1], [1, 1]] {
                    let on_axis = |i: usize, at: usize| at as f64 + 0.5 * step[i] as f64 + shift[i];
                    let got = half_pel.shared_footprint([x, y], shift, step, shift, CUBIC_HALF_PEL);
                    let expected = half_pel.at([on_axis(0, x), on_axis(1, y)], CUBIC_HALF_PEL);
                    assert!((got - expected).abs() < 1e-9, "({x}, {y}) + {step:?} / 2 + {shift:?}");
                }
            }
        }
        // Half a pixel further is a whole half-pel sample further. The position is clamped to the slack.
        let shared_footprint = |further: f64| {
            half_pel.shared_footprint([2, 2], [0.1, 0.0], [1, 0], [0.1 + further, 0.0], CUBIC_HALF_PEL)
        };
        assert_eq!(shared_footprint(0.5), shared_footprint(1.0));
        assert_ne!(shared_footprint(0.5), shared_footprint(0.3));
    }
}
