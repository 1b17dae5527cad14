//! A log image of twice its frame's density.

use super::taps::cubic;
use esaac_model::synthesis::CUBIC_FRAME;

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
}
