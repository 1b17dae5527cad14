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

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::synthesis::CUBIC_LATTICE;

    #[test]
    fn beside_is_at_where_neighbours_move_alike_and_within_the_slack_where_they_do_not() {
        let size = (6, 5);
        let frame: Vec<f64> = (0..30).map(|i| f64::from(i * i % 7)).collect();
        let lattice = Lattice::of_frame(size, &frame);
        for shift in [[0.0, 0.0], [0.3, -0.4], [-1.7, 0.9]] {
            // Beyond the image the cell stays inside, and so it is not the one of the place.
            let inside =
                |at: usize, shift: f64, size: usize| (0.0..=(size - 1) as f64).contains(&(at as f64 + shift));
            let pixels = (0..30).map(|pixel| (pixel % 6, pixel / 6));
            for (x, y) in pixels.filter(|&(x, y)| inside(x, shift[0], 6) && inside(y, shift[1], 5)) {
                for step in [[0, 0], [1, 0], [0, 1], [1, 1]] {
                    let on_axis = |i: usize, at: usize| at as f64 + 0.5 * step[i] as f64 + shift[i];
                    let got = lattice.beside([x, y], shift, step, shift, CUBIC_LATTICE);
                    let expected = lattice.at([on_axis(0, x), on_axis(1, y)], CUBIC_LATTICE);
                    assert!((got - expected).abs() < 1e-9, "({x}, {y}) + {step:?} / 2 + {shift:?}");
                }
            }
        }
        // Half a pixel further is an entry further: only the slack of it is read by.
        let beside =
            |further: f64| lattice.beside([2, 2], [0.1, 0.0], [1, 0], [0.1 + further, 0.0], CUBIC_LATTICE);
        assert_eq!(beside(0.5), beside(1.0));
        assert_ne!(beside(0.5), beside(0.3));
    }
}
