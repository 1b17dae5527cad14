//! A log image of twice its frame's density.

use super::taps::{cubic, cubic_in};
use esaac_model::synthesis::{CELL_SLACK, CUBIC_FRAME};

/// Entry `(X, Y)` is at pixel `(X / 2, Y / 2)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    size: (usize, usize),
    log: Vec<f64>,
}

impl Lattice {
    /// A lattice of a frame of `size` pixels, whose entries at the pixels are `frame` and the others
    /// `between(X, Y)`.
    #[must_use]
    pub fn new(size: (usize, usize), frame: &[f64], between: impl Fn(usize, usize) -> f64) -> Self {
        let (width, height) = (2 * size.0, 2 * size.1);
        let entry = |i: usize| {
            let (x, y) = (i % width, i / width);
            if x % 2 == 0 && y % 2 == 0 { frame[y / 2 * size.0 + x / 2] } else { between(x, y) }
        };
        Lattice { size: (width, height), log: (0..width * height).map(entry).collect() }
    }

    /// The lattice that one frame gives by itself.
    #[must_use]
    pub fn of_frame(size: (usize, usize), frame: &[f64]) -> Self {
        Lattice::new(size, frame, |x, y| cubic(frame, size, 0.5 * x as f64, 0.5 * y as f64, CUBIC_FRAME))
    }

    /// Entry `(X, Y)`.
    #[must_use]
    pub fn entry(&self, x: usize, y: usize) -> f64 {
        self.log[y * self.size.0 + x]
    }

    /// Value at a position in pixels of the frame.
    #[must_use]
    pub fn at(&self, [x, y]: [f64; 2], parameter: f64) -> f64 {
        cubic(&self.log, self.size, 2.0 * x, 2.0 * y, parameter)
    }

    /// Value at pixel `at` + half of `step` + `shift`, by the taps of the cell that lies `step` entries from the one
    /// of `at` + `own_shift`.
    #[must_use]
    pub fn beside(
        &self,
        at: [usize; 2],
        own_shift: [f64; 2],
        step: [usize; 2],
        shift: [f64; 2],
        parameter: f64,
    ) -> f64 {
        let sizes = [self.size.0, self.size.1];
        let on_axis = |axis: usize| {
            let last = (sizes[axis] - 1) as f64;
            let entry = 2.0 * at[axis] as f64;
            let cell = (entry + (2.0 * own_shift[axis]).floor()).clamp(0.0, last - 1.0) as usize + step[axis];
            let place = (entry + step[axis] as f64 + 2.0 * shift[axis]).clamp(0.0, last);
            (cell, (place - cell as f64).clamp(-CELL_SLACK, 1.0 + CELL_SLACK))
        };
        let ((x, fx), (y, fy)) = (on_axis(0), on_axis(1));
        cubic_in(&self.log, self.size, [x, y], [fx, fy], parameter)
    }
}
