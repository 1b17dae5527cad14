//! What lies between two samples of a track.

use super::nanoseconds;
use crate::paths::pose::Pose;
use crate::paths::turn::rotation_of;
use glam::DVec3;

/// What lies between two samples: a pose and two curves from there. [`Segment::at`] takes sums and products of them alone,
/// in a fixed order, so that a kernel that does the same gives the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// From the first sample up to the next, which is not in it. If they are the same, the sample alone.
    pub(super) times_ns: [i64; 2],
    /// Part of the segment that a nanosecond is; 0 where the body stands.
    pub(super) per_ns: f64,
    pub(super) start: Pose,
    pub(super) shift_m: Curve,
    pub(super) turned: Curve,
}

impl Segment {
    /// One pose at all times of a segment.
    pub(super) fn standing(times_ns: [i64; 2], pose: Pose) -> Self {
        Segment { times_ns, per_ns: 0.0, start: pose, shift_m: Curve::default(), turned: Curve::default() }
    }

    pub(super) fn holds(&self, t_ns: i64) -> bool {
        t_ns == self.times_ns[0] || (self.times_ns[0]..self.times_ns[1]).contains(&t_ns)
    }

    /// Time of its first sample.
    #[must_use]
    pub fn start_ns(&self) -> i64 {
        self.times_ns[0]
    }

    /// Part of the segment that a nanosecond is; 0 where the body stands.
    #[must_use]
    pub fn per_ns(&self) -> f64 {
        self.per_ns
    }

    /// Its first sample.
    #[must_use]
    pub fn start(&self) -> Pose {
        self.start
    }

    /// The way from its first sample, metres in world axes.
    #[must_use]
    pub fn shift_m(&self) -> &Curve {
        &self.shift_m
    }

    /// The rotation vector relative to its first sample, radians in body axes.
    #[must_use]
    pub fn turned(&self) -> &Curve {
        &self.turned
    }

    /// The pose at a time of the segment. Its first sample is given back as it came, without rounding.
    #[must_use]
    pub fn at(&self, t_ns: i64) -> Pose {
        let fraction = nanoseconds(self.times_ns[0], t_ns) * self.per_ns;
        if fraction == 0.0 {
            return self.start;
        }
        let translation_m = self.start.translation_m() + self.shift_m.at(fraction);
        let turn = rotation_of(self.turned.at(fraction));
        Pose::from_parts(self.start.rotation() * turn, translation_m)
    }
}

/// The cubic from 0 to `end` over fractions 0 to 1, with slopes at both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Curve {
    /// Its value at 1.
    pub end: DVec3,
    /// Its slopes at 0 and 1.
    pub slopes: [DVec3; 2],
}

impl Curve {
    fn at(&self, fraction: f64) -> DVec3 {
        let (s, left) = (fraction, 1.0 - fraction);
        self.end * (s * s * (3.0 - 2.0 * s)) + self.slopes[0] * (s * left * left)
            - self.slopes[1] * (s * s * left)
    }
}
