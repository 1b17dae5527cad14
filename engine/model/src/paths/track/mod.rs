//! A body's pose at any time, from its poses at some times.
//!
//! Between two samples, each of the two parts is a cubic Hermite curve through both samples with a velocity at each.
//! A sample's **velocity** is the derivative of the polynomial through it and up to two samples on either side; at the
//! ends of a track, through the nearest five. Times need not be evenly spaced. Two samples give a straight line and
//! slerp, one sample a body that stands still.
//!
//! **Rotations** are treated the same way in rotation vectors (axis times angle) relative to the sample. With samples
//! `q_j`, `log` the rotation vector of a quaternion and `exp` its inverse:
//!
//! - `w_i`, the angular velocity in body axes at sample i, is the velocity at `t_i` of the polynomial through
//!   `r_j = log(q_i^-1 q_j)`. `log` gives the short way round to the next sample, and to the one after that the way
//!   that goes on most evenly. So `q` and `-q` are the same, and a body may turn up to half a turn between samples.
//! - From sample i to i+1, `q(t) = q_i exp(r(t))`. Here `r` is the cubic with `r(t_i) = 0`, `r'(t_i) = w_i`,
//!   `r(t_{i+1}) = log(q_i^-1 q_{i+1}) = d` and `r'(t_{i+1}) = J(d) w_{i+1}`, where `J(d)` takes an angular velocity to
//!   the rate of a rotation vector:
//!   `J(d) = 1 + [d]/2 + (1/|d|^2 - (1 + cos|d|) / (2 |d| sin|d|)) [d]^2`, `[d] u = d x u`.
//!
//! Velocities are continuous through the samples, and a steady turn about a fixed axis is exact. Squad would be neither
//! at uneven times. A velocity that jumps (a bounce) is rounded off over the samples next to it.

mod segment;
mod times;
mod velocity;

pub use segment::{Curve, Segment};
pub use times::PoseTimes;
pub use velocity::NEIGHBOURS;

use super::pose::Pose;
use super::turn::{rotation_vector, rotation_vector_rate};
use std::ops::Range;
use thiserror::Error;
use times::Times;
use velocity::{Velocity, velocity};

/// Poses at ascending times, and every pose between.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseTrack {
    times: PoseTimes,
    poses: Vec<Pose>,
    /// One for each pose; none for a body that stands still.
    velocities: Vec<Velocity>,
}

/// The memory of a track that is no longer needed. Who makes many tracks for every frame makes them in that of earlier
/// ones: the system would take so much memory back each time, and give it again page by page.
#[derive(Debug, Default)]
pub struct TrackMemory {
    poses: Vec<Pose>,
    velocities: Vec<Velocity>,
}

impl From<PoseTrack> for TrackMemory {
    fn from(PoseTrack { poses, velocities, .. }: PoseTrack) -> Self {
        TrackMemory { poses, velocities }
    }
}

impl TrackMemory {
    /// Puts poses in the place of what is there.
    ///
    /// # Errors
    /// That of the first pose that has one.
    pub fn fill<E>(&mut self, poses: impl Iterator<Item = Result<Pose, E>>) -> Result<(), E> {
        self.poses.clear();
        self.poses.reserve(poses.size_hint().0);
        for pose in poses {
            self.poses.push(pose?);
        }
        Ok(())
    }
}

/// Why a track is refused or has no pose.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum TrackError {
    /// No samples.
    #[error("a track of 0 poses, expected at least 1")]
    Empty,
    /// Different numbers of times and poses.
    #[error("{poses} poses at {times} times, expected as many poses as times")]
    Count {
        /// Times given.
        times: usize,
        /// Poses given.
        poses: usize,
    },
    /// Times do not ascend.
    #[error("pose {index} is at {actual_ns} ns, expected after pose {before} at {previous_ns} ns", before = index - 1)]
    Order {
        /// The later of the two samples.
        index: usize,
        /// Time of the sample before.
        previous_ns: i64,
        /// Its time.
        actual_ns: i64,
    },
    /// The track does not reach the time asked for.
    #[error("poses from {first_ns} to {last_ns} ns, expected them to span {from_ns} to {to_ns} ns")]
    Span {
        /// First sample.
        first_ns: i64,
        /// Last sample.
        last_ns: i64,
        /// Start of what is asked for.
        from_ns: i64,
        /// End of what is asked for.
        to_ns: i64,
    },
}

impl PoseTrack {
    /// A body that stands still, at all times.
    #[must_use]
    pub fn still(pose: Pose) -> Self {
        let times = PoseTimes::new(vec![0]).expect("one time");
        PoseTrack { times, poses: vec![pose], velocities: Vec::new() }
    }

    /// A track through `poses[i]` at `times_ns[i]`. One pose alone stands still at all times.
    ///
    /// # Errors
    /// If there is no pose, their number differs from that of the times, or a time is not after the one before.
    pub fn new(times_ns: Vec<i64>, poses: Vec<Pose>) -> Result<Self, TrackError> {
        let (times, count) = (times_ns.len(), poses.len());
        if times != count {
            return Err(TrackError::Count { times, poses: count });
        }
        PoseTrack::at_times(&PoseTimes::new(times_ns)?, poses)
    }

    /// A track through what `path` gives at these times, seconds.
    ///
    /// # Errors
    /// As [`PoseTrack::new`].
    pub fn through(times_ns: &[i64], path: impl Fn(f64) -> Pose) -> Result<Self, TrackError> {
        let poses = times_ns.iter().map(|&t_ns| path(t_ns as f64 * 1e-9)).collect();
        PoseTrack::new(times_ns.to_vec(), poses)
    }

    /// As [`PoseTrack::new`], at times that other tracks have too.
    ///
    /// # Errors
    /// If the number of poses differs from that of the times.
    pub fn at_times(times: &PoseTimes, poses: Vec<Pose>) -> Result<Self, TrackError> {
        PoseTrack::in_memory(times, TrackMemory { poses, velocities: Vec::new() })
    }

    /// As [`PoseTrack::at_times`], of the poses that are in the memory of another track.
    ///
    /// # Errors
    /// As [`PoseTrack::at_times`].
    pub fn in_memory(times: &PoseTimes, memory: TrackMemory) -> Result<Self, TrackError> {
        let TrackMemory { poses, mut velocities } = memory;
        let Times { times_ns, stencils } = &*times.0;
        if times_ns.len() != poses.len() {
            return Err(TrackError::Count { times: times_ns.len(), poses: poses.len() });
        }
        let stands = poses.iter().all(|pose| *pose == poses[0]);
        let moving = if stands { &[][..] } else { &stencils[..] };
        velocities.clear();
        velocities.extend(moving.iter().enumerate().map(|(i, stencil)| velocity(stencil, &poses, i)));
        Ok(PoseTrack { times: times.clone(), poses, velocities })
    }

    /// Whether the body has one pose at all times.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.velocities.is_empty()
    }

    /// Times of the samples.
    #[must_use]
    pub fn times_ns(&self) -> &[i64] {
        self.times.times_ns()
    }

    /// The samples.
    #[must_use]
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// Whether the track has a pose at every time from `from_ns` to `to_ns`.
    ///
    /// # Errors
    /// [`TrackError::Span`] if not.
    pub fn check_span(&self, from_ns: i64, to_ns: i64) -> Result<(), TrackError> {
        let times_ns = self.times_ns();
        let (first_ns, last_ns) = (times_ns[0], times_ns[times_ns.len() - 1]);
        if self.poses.len() == 1 || (first_ns <= from_ns && to_ns <= last_ns) {
            Ok(())
        } else {
            Err(TrackError::Span { first_ns, last_ns, from_ns, to_ns })
        }
    }

    /// The pose at `t_ns`.
    ///
    /// # Errors
    /// [`TrackError::Span`] outside the samples.
    pub fn at(&self, t_ns: i64) -> Result<Pose, TrackError> {
        self.check_span(t_ns, t_ns)?;
        Ok(self.segment_for(t_ns, true).at(t_ns))
    }

    /// Puts the poses at `times_ns`, as [`PoseTrack::at`] gives them, in the place of what is in `poses`. Faster than
    /// one by one where times share a segment.
    ///
    /// # Errors
    /// [`TrackError::Span`] outside the samples.
    pub fn at_all(&self, times_ns: &[i64], poses: &mut Vec<Pose>) -> Result<(), TrackError> {
        poses.clear();
        let mut last: Option<Segment> = None;
        for (place, &t_ns) in times_ns.iter().enumerate() {
            self.check_span(t_ns, t_ns)?;
            let segment = match last {
                Some(ref segment) if segment.holds(t_ns) => segment,
                _ => last.insert(self.segment_for(t_ns, place + 1 == times_ns.len())),
            };
            poses.push(segment.at(t_ns));
        }
        Ok(())
    }

    /// The segments that hold `times_ns`, which the track must span, each with the places of its times: consecutive
    /// times in one segment share it.
    pub fn segments<'a>(&'a self, times_ns: &'a [i64]) -> impl Iterator<Item = (Segment, Range<usize>)> + 'a {
        let mut next = 0;
        std::iter::from_fn(move || {
            let first = next;
            let segment = self.segment_for(*times_ns.get(first)?, first + 1 == times_ns.len());
            let others = times_ns[first + 1..].iter().take_while(|&&t_ns| segment.holds(t_ns)).count();
            next = first + 1 + others;
            Some((segment, first..next))
        })
    }

    /// The segment that holds a time: from the sample at or before it to the next. At the last sample, and for the
    /// `last` time that is wanted if it is a sample's, that sample alone.
    fn segment_for(&self, t_ns: i64, last: bool) -> Segment {
        if self.stands() {
            return Segment::standing([i64::MIN, i64::MAX], self.poses[0]);
        }
        let i = self.times_ns().partition_point(|&sample_ns| sample_ns <= t_ns) - 1;
        let sample_ns = self.times_ns()[i];
        if i + 1 == self.poses.len() || (last && t_ns == sample_ns) {
            return Segment::standing([sample_ns, sample_ns], self.poses[i]);
        }
        self.segment(i)
    }

    /// What lies between samples `i` and `i + 1`.
    fn segment(&self, i: usize) -> Segment {
        let [start, end] = [self.poses[i], self.poses[i + 1]];
        let [before, after] = [self.velocities[i], self.velocities[i + 1]];
        let times_ns = [self.times_ns()[i], self.times_ns()[i + 1]];
        let length_s = seconds(times_ns[0], times_ns[1]);
        let turn = rotation_vector(start.rotation().conjugate() * end.rotation());
        Segment {
            times_ns,
            per_ns: 1.0 / nanoseconds(times_ns[0], times_ns[1]),
            start,
            shift_m: Curve {
                end: end.translation_m() - start.translation_m(),
                slopes: [before.linear_m_s * length_s, after.linear_m_s * length_s],
            },
            turned: Curve {
                end: turn,
                slopes: [
                    before.angular_rad_s * length_s,
                    rotation_vector_rate(turn, after.angular_rad_s) * length_s,
                ],
            },
        }
    }
}

fn seconds(from_ns: i64, to_ns: i64) -> f64 {
    let between_ns = to_ns.abs_diff(from_ns) as f64;
    if to_ns < from_ns { between_ns * -1e-9 } else { between_ns * 1e-9 }
}

/// Nanoseconds from a time to a later one. Times may lie at both ends of i64.
fn nanoseconds(from_ns: i64, to_ns: i64) -> f64 {
    to_ns.abs_diff(from_ns) as f64
}

#[cfg(test)]
mod tests;
