//! Half-pel frames: log images of twice their frame's density.

use super::sampling::Sampling;
use super::taps::{cubic, cubic_in};
use esaac_model::substeps::BLOCK_PX;
use esaac_model::synthesis::{CELL_SLACK, HALF_PEL_WEIGHTS, cubic_parameter, roughness_of};

/// A log image of twice its frame's density. Sample `(X, Y)` lies at pixel `(X / 2, Y / 2)`.
#[derive(Clone, Debug, PartialEq)]
pub struct HalfPelFrame {
    size: (usize, usize),
    log: Vec<f64>,
    /// Keys' parameter of each block of the frame, row by row.
    parameters: Vec<f64>,
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
        let log = (0..width * height).map(entry).collect();
        HalfPelFrame { size: (width, height), log, parameters: parameters(size, frame), sampling }
    }

    /// The half-pel frame interpolated from one frame alone.
    #[must_use]
    pub fn of_frame(size: (usize, usize), sampling: Sampling, frame: &[f64]) -> Self {
        HalfPelFrame::new(size, sampling, frame, |x, y| interpolated(size, frame, [x, y]))
    }

    /// The same with other samples, row by row; those at pixels must be the same.
    #[must_use]
    pub fn with_samples(&self, log: Vec<f64>) -> Self {
        assert_eq!(log.len(), self.log.len(), "samples of another size");
        HalfPelFrame { size: self.size, log, parameters: self.parameters.clone(), sampling: self.sampling }
    }

    /// How it is read.
    #[must_use]
    pub fn sampling(&self) -> Sampling {
        self.sampling
    }

    /// Its samples, row by row, nepers.
    #[must_use]
    pub fn samples(&self) -> &[f64] {
        &self.log
    }

    /// Keys' parameter of each block, row by row.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// Sample `(X, Y)`, nepers.
    #[must_use]
    pub fn entry(&self, x: usize, y: usize) -> f64 {
        self.log[y * self.size.0 + x]
    }

    /// Value at a position in pixels of the frame, nepers, as pixel `reader` reads it.
    #[must_use]
    pub fn at(&self, [x, y]: [f64; 2], reader: [usize; 2]) -> f64 {
        let parameter = self.parameter(reader);
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
    ) -> f64 {
        if !self.sampling.shared_footprint {
            let on_axis = |axis: usize| at[axis] as f64 + 0.5 * step[axis] as f64 + shift[axis];
            return self.at([on_axis(0), on_axis(1)], at);
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
        cubic_in(&self.log, self.size, [x, y], [fx, fy], self.parameter(at), self.sampling.twelve_taps)
    }

    /// Keys' parameter with which pixel `reader` reads this frame.
    fn parameter(&self, [x, y]: [usize; 2]) -> f64 {
        let block_px = BLOCK_PX as usize;
        self.parameters[y / block_px * (self.size.0 / 2).div_ceil(block_px) + x / block_px]
    }
}

/// A frame whose border pixels repeat beyond it.
struct Repeated<'a> {
    size: (usize, usize),
    frame: &'a [f64],
}

impl Repeated<'_> {
    fn at(&self, x: i64, y: i64) -> f64 {
        let clamped = |at: i64, size: usize| at.clamp(0, size as i64 - 1) as usize;
        self.frame[clamped(y, self.size.1) * self.size.0 + clamped(x, self.size.0)]
    }

    /// The six pixels of row `y` around the middle between `x` and the next.
    fn along_row(&self, x: i64, y: i64) -> [f64; 6] {
        std::array::from_fn(|i| self.at(x + i as i64 - 2, y))
    }

    /// The six pixels of column `x` around the middle between `y` and the next.
    fn along_column(&self, x: i64, y: i64) -> [f64; 6] {
        std::array::from_fn(|i| self.at(x, y + i as i64 - 2))
    }
}

fn sum_of_six(line: [f64; 6]) -> f64 {
    HALF_PEL_WEIGHTS.iter().enumerate().map(|(i, weight)| weight * (line[2 - i] + line[3 + i])).sum()
}

fn mean(line: [f64; 6], other: [f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| 0.5 * (line[i] + other[i]))
}

/// Half-pel sample `(X, Y)` from a frame alone.
fn interpolated(size: (usize, usize), frame: &[f64], [x, y]: [usize; 2]) -> f64 {
    let frame = Repeated { size, frame };
    let right = x % 2 == 1 && x / 2 + 1 < size.0;
    let below = y % 2 == 1 && y / 2 + 1 < size.1;
    let (x, y) = ((x / 2) as i64, (y / 2) as i64);
    let around = [
        (x, y),
        (x + i64::from(right), y),
        (x, y + i64::from(below)),
        (x + i64::from(right), y + i64::from(below)),
    ]
    .map(|(x, y)| frame.at(x, y));
    let sum = match (right, below) {
        (false, false) => around[0],
        (true, false) => sum_of_six(frame.along_row(x, y)),
        (false, true) => sum_of_six(frame.along_column(x, y)),
        (true, true) => {
            sum_of_six(mean(frame.along_row(x, y), frame.along_row(x, y + 1)))
                + sum_of_six(mean(frame.along_column(x, y), frame.along_column(x + 1, y)))
                - 0.25 * around.iter().sum::<f64>()
        }
    };
    let low = around.into_iter().fold(f64::INFINITY, f64::min);
    let high = around.into_iter().fold(f64::NEG_INFINITY, f64::max);
    sum.clamp(low, high)
}

/// Keys' parameter of each block of a frame.
fn parameters(size: (usize, usize), frame: &[f64]) -> Vec<f64> {
    let block_px = BLOCK_PX as usize;
    let columns = size.0.div_ceil(block_px);
    let mut sums = vec![[0_u32; 2]; columns * size.1.div_ceil(block_px)];
    let frame = Repeated { size, frame };
    for (x, y) in (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y))) {
        let at = |dx: i64, dy: i64| frame.at(x as i64 + dx, y as i64 + dy);
        let own = roughness_of(at(0, 0), [at(-1, 0), at(1, 0), at(0, -1), at(0, 1)]);
        let sum = &mut sums[y / block_px * columns + x / block_px];
        *sum = [sum[0] + own[0], sum[1] + own[1]];
    }
    sums.into_iter().map(cubic_parameter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
                    let got = half_pel.shared_footprint([x, y], shift, step, shift);
                    let expected = half_pel.at([on_axis(0, x), on_axis(1, y)], [x, y]);
                    assert!((got - expected).abs() < 1e-9, "({x}, {y}) + {step:?} / 2 + {shift:?}");
                }
            }
        }
        // Half a pixel further is a whole half-pel sample further. The position is clamped to the slack.
        let shared_footprint =
            |further: f64| half_pel.shared_footprint([2, 2], [0.1, 0.0], [1, 0], [0.1 + further, 0.0]);
        assert_eq!(shared_footprint(0.5), shared_footprint(1.0));
        assert_ne!(shared_footprint(0.5), shared_footprint(0.3));
    }
}
