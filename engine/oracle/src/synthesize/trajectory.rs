//! Trajectories of the surface points that a pixel shows at the two ends of an interval.

use super::taps::bilinear;
use esaac_model::synthesis::TRAJECTORY_STEPS;
use esaac_model::synthesis::is_usable;

/// Trajectory of a point, pixels: a parabola given by `m` and `c` of [`esaac_model::synthesis`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// `m`: position in the previous frame less that in the current one.
    pub motion: [f64; 2],
    /// `c`: curvature, from the motion over the last two intervals.
    pub curvature: [f64; 2],
}

/// Trajectories of the points that a pixel shows at the interval's two ends.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Warp {
    /// Trajectory of the point shown at the interval's start.
    pub start: Trajectory,
    /// Trajectory of the point shown at its end.
    pub end: Trajectory,
}

impl Warp {
    /// Positions, pixels, of the point that pixel `(x, y)` shows at `fraction` of the interval: in the frame at the
    /// start and in the frame at the end.
    #[must_use]
    pub fn sources(&self, x: usize, y: usize, fraction: f64) -> [[f64; 2]; 2] {
        let t = fraction - 1.0;
        let lerp = |start: f64, end: f64| (1.0 - fraction) * start + fraction * end;
        let pixel = [x as f64, y as f64];
        let mut sources = [[0.0; 2]; 2];
        for axis in 0..2 {
            let m = lerp(self.start.motion[axis], self.end.motion[axis]);
            let c = lerp(self.start.curvature[axis], self.end.curvature[axis]);
            let in_end = pixel[axis] - t * ((c - m) + t * c);
            sources[1][axis] = in_end;
            sources[0][axis] = in_end + m;
        }
        sources
    }
}

/// How far a position lies outside the image, pixels: the larger of the two axes.
#[must_use]
pub fn outside_px((width, height): (usize, usize), [x, y]: [f64; 2]) -> f64 {
    let beyond = |v: f64, size: usize| (-v).max(v - (size - 1) as f64);
    beyond(x, width).max(beyond(y, height)).max(0.0)
}

/// A motion field that can be read between its pixels. Invalid vectors count as zero.
pub(super) struct Field {
    size: (usize, usize),
    components: [Vec<f64>; 2],
}

impl Field {
    pub(super) fn new(size: (usize, usize), motion: &[[f64; 2]]) -> Self {
        let component =
            |axis: usize| motion.iter().map(|&v| if is_usable(v) { v[axis] } else { 0.0 }).collect();
        Field { size, components: [component(0), component(1)] }
    }

    pub(super) fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| bilinear(&self.components[axis], self.size, x, y))
    }
}

/// Trajectories of every pixel. `motion` is that of the frame at the interval's end. `previous` is that of the frame at
/// its start, which gives the curvature. `ratio` is the length of the previous interval over that of this one, `None`
/// in the first interval.
#[must_use]
pub fn warps(
    size: (usize, usize),
    motion: &[[f64; 2]],
    previous: Option<&[[f64; 2]]>,
    ratio: Option<f64>,
) -> Vec<Warp> {
    let field = Field::new(size, motion);
    let previous = previous.map(|previous| Field::new(size, previous));
    let trajectory = |motion: [f64; 2], in_previous: [f64; 2]| {
        let before = previous.as_ref().map(|previous| previous.at(in_previous));
        let curvature = match (before, ratio) {
            (None, _) | (Some([0.0, 0.0]), None) => [0.0; 2],
            (Some(before), ratio) => {
                let r = ratio.unwrap_or(1.0);
                [0, 1].map(|axis| (before[axis] - r * motion[axis]) / (r * (1.0 + r)))
            }
        };
        Trajectory { motion, curvature }
    };
    (0..size.0 * size.1)
        .map(|pixel| {
            let at = [(pixel % size.0) as f64, (pixel / size.0) as f64];
            let mut at_start = field.at(at);
            for _ in 1..TRAJECTORY_STEPS {
                at_start = field.at([at[0] - at_start[0], at[1] - at_start[1]]);
            }
            let at_end = field.at(at);
            Warp {
                start: trajectory(at_start, at),
                end: trajectory(at_end, [at[0] + at_end[0], at[1] + at_end[1]]),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_lies_on_its_own_path_at_both_ends() {
        let field: Vec<[f64; 2]> = (0..35).map(|i| [0.3 * f64::from(i % 7), -0.2]).collect();
        for warp in warps((7, 5), &field, Some(&field), Some(1.0)) {
            let [_, in_end] = warp.sources(3, 2, 1.0);
            let [in_start, _] = warp.sources(3, 2, 0.0);
            assert_eq!(in_end, [3.0, 2.0]);
            assert!((in_start[0] - 3.0).abs() < 1e-12 && (in_start[1] - 2.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_bent_path_is_exact_for_frames_at_unequal_times() {
        // A point at v t + b t^2; the frames are at -1 - r, -1 and 0.
        let place = |t: f64| 1.7 * t + 0.6 * t * t;
        for r in [0.25, 1.0, 3.0] {
            let field = [[place(-1.0) - place(0.0), 0.0]; 35];
            let previous = [[place(-1.0 - r) - place(-1.0), 0.0]; 35];
            let warp = warps((7, 5), &field, Some(&previous), Some(r))[17];
            for fraction in [0.0, 0.3, 0.5, 1.0] {
                let t = fraction - 1.0;
                let [in_start, in_end] = warp.sources(3, 2, fraction);
                assert!((in_end[0] - (3.0 + place(0.0) - place(t))).abs() < 1e-12);
                assert!((in_start[0] - (3.0 + place(-1.0) - place(t))).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_first_frame_without_vectors_bends_nothing() {
        let (field, zero) = ([[-2.0, 1.0]; 35], [[0.0; 2]; 35]);
        let curvature = |ratio| warps((7, 5), &field, Some(&zero), ratio)[17].end.curvature;
        assert_eq!(curvature(None), [0.0; 2]);
        assert_eq!(curvature(Some(1.0)), [1.0, -0.5], "later a zero is a point at rest");
    }

    #[test]
    fn distance_outside() {
        assert_eq!(outside_px((10, 5), [9.0, 4.0]), 0.0);
        assert_eq!(outside_px((10, 5), [-2.0, 4.5]), 2.0);
        assert_eq!(outside_px((10, 5), [9.25, 7.0]), 3.0);
    }
}
