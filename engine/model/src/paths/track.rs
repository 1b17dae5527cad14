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

use super::pose::Pose;
use super::turn::{nearest_turn, rotation_of, rotation_vector, rotation_vector_rate};
use glam::DVec3;
use std::ops::Range;
use std::sync::Arc;
use thiserror::Error;

/// Samples on either side of one that its velocity comes from. Two in place of one make a camera's path that shakes at
/// 25 Hz several times as exact at 240 samples a second; the design notes have the figures.
const VELOCITY_REACH: usize = 2;

/// Most samples that a velocity comes from.
const STENCIL: usize = 2 * VELOCITY_REACH + 1;

/// Poses at ascending times, and every pose between.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseTrack {
    times: PoseTimes,
    poses: Vec<Pose>,
    /// One for each pose; none for a body that stands still.
    velocities: Vec<Velocity>,
}

/// Times of samples, which many tracks may share: what follows from times alone is worked out once.
#[derive(Clone, Debug)]
pub struct PoseTimes(Arc<Times>);

#[derive(Debug)]
struct Times {
    times_ns: Vec<i64>,
    stencils: Vec<Stencil>,
}

/// The samples that a sample's velocity comes from.
#[derive(Clone, Copy, Debug)]
struct Stencil {
    first: usize,
    count: usize,
    /// From the sample to each of them.
    offsets_s: [f64; STENCIL],
    /// The derivative at the sample of Lagrange's polynomial that is 1 at each of them and 0 at the others.
    weights_hz: [f64; STENCIL],
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

/// Rates at a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Velocity {
    /// Metres a second, world axes.
    linear_m_s: DVec3,
    /// Radians a second, body axes.
    angular_rad_s: DVec3,
}

impl PoseTimes {
    /// Times of samples.
    ///
    /// # Errors
    /// If there are none, or a time is not after the one before.
    pub fn new(times_ns: Vec<i64>) -> Result<Self, TrackError> {
        if times_ns.is_empty() {
            return Err(TrackError::Empty);
        }
        if let Some(i) = times_ns.windows(2).position(|pair| pair[1] <= pair[0]) {
            return Err(TrackError::Order {
                index: i + 1,
                previous_ns: times_ns[i],
                actual_ns: times_ns[i + 1],
            });
        }
        let stencils = (0..times_ns.len()).map(|i| Stencil::new(&times_ns, i)).collect();
        Ok(PoseTimes(Arc::new(Times { times_ns, stencils })))
    }

    /// The times.
    #[must_use]
    pub fn times_ns(&self) -> &[i64] {
        &self.0.times_ns
    }
}

impl PartialEq for PoseTimes {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0) || self.times_ns() == other.times_ns()
    }
}

impl Stencil {
    fn new(times_ns: &[i64], i: usize) -> Self {
        let count = STENCIL.min(times_ns.len());
        let first = i.saturating_sub(VELOCITY_REACH).min(times_ns.len() - count);
        let mut offsets_s = [0.0; STENCIL];
        for (k, offset_s) in offsets_s[..count].iter_mut().enumerate() {
            *offset_s = seconds(times_ns[i], times_ns[first + k]);
        }
        let own = i - first;
        let mut weights_hz = [0.0; STENCIL];
        for j in (0..count).filter(|&j| j != own) {
            let others = (0..count).filter(|&k| k != own && k != j);
            weights_hz[j] = others
                .fold(1.0 / offsets_s[j], |weight, k| weight * offsets_s[k] / (offsets_s[k] - offsets_s[j]));
        }
        Stencil { first, count, offsets_s, weights_hz }
    }
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

    /// As [`PoseTrack::new`], at times that other tracks have too.
    ///
    /// # Errors
    /// If the number of poses differs from that of the times.
    pub fn at_times(times: &PoseTimes, poses: Vec<Pose>) -> Result<Self, TrackError> {
        let Times { times_ns, stencils } = &*times.0;
        if times_ns.len() != poses.len() {
            return Err(TrackError::Count { times: times_ns.len(), poses: poses.len() });
        }
        let stands = poses.iter().all(|pose| *pose == poses[0]);
        let moving = if stands { &[][..] } else { &stencils[..] };
        let velocities = moving.iter().enumerate().map(|(i, stencil)| velocity(stencil, &poses, i)).collect();
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

/// What lies between two samples: a pose and two curves from there. [`Segment::at`] takes sums and products of them alone,
/// in a fixed order, so that a kernel that does the same gives the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// From the first sample up to the next, which is not in it. If they are the same, the sample alone.
    times_ns: [i64; 2],
    /// Part of the segment that a nanosecond is; 0 where the body stands.
    per_ns: f64,
    start: Pose,
    shift_m: Curve,
    turned: Curve,
}

impl Segment {
    /// One pose at all times of a segment.
    fn standing(times_ns: [i64; 2], pose: Pose) -> Self {
        Segment { times_ns, per_ns: 0.0, start: pose, shift_m: Curve::default(), turned: Curve::default() }
    }

    fn holds(&self, t_ns: i64) -> bool {
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

/// Velocity of sample `i`.
fn velocity(stencil: &Stencil, poses: &[Pose], i: usize) -> Velocity {
    let &Stencil { first, count, offsets_s, weights_hz } = stencil;
    let (own, from_world) = (i - first, poses[i].rotation().conjugate());
    let mut result = Velocity::default();
    let mut add = |j: usize, nearer: Option<(f64, DVec3)>| {
        let pose = &poses[first + j];
        let short = rotation_vector(from_world * pose.rotation());
        let turn = match nearer {
            None => short,
            Some((nearer_s, nearer_turn)) => nearest_turn(short, nearer_turn * (offsets_s[j] / nearer_s)),
        };
        result.linear_m_s += (pose.translation_m() - poses[i].translation_m()) * weights_hz[j];
        result.angular_rad_s += turn * weights_hz[j];
        Some((offsets_s[j], turn))
    };
    // Outwards from the sample on either side, so that each rotation can go on from the one before.
    (0..own).rev().fold(None, |nearer, j| add(j, nearer));
    (own + 1..count).fold(None, |nearer, j| add(j, nearer));
    result
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
mod tests {
    use super::*;
    use glam::DQuat;
    use std::f64::consts::TAU;

    const MS: i64 = 1_000_000;

    /// A hand-held camera that shakes at 9 to 23 Hz, and its pose at every time.
    fn shaking(t_s: f64) -> Pose {
        let wave = |hz: f64, phase: f64| (TAU * hz * t_s + phase).sin();
        let turn = DVec3::new(
            0.02 * wave(9.0, 0.3) + 0.004 * wave(23.0, 1.0),
            0.02 * wave(11.0, 2.0) + 0.3 * t_s,
            0.01 * wave(17.0, 0.7),
        );
        let place = DVec3::new(0.02 * wave(10.0, 0.0), 0.01 * wave(13.0, 1.0), 1.5 + 0.005 * wave(21.0, 0.0));
        Pose::new(DQuat::from_scaled_axis(DVec3::new(0.7, 1.1, -0.4)) * DQuat::from_scaled_axis(turn), place)
            .unwrap()
    }

    fn sampled(path: impl Fn(f64) -> Pose, times_ns: &[i64]) -> PoseTrack {
        let poses = times_ns.iter().map(|&t_ns| path(t_ns as f64 * 1e-9)).collect();
        PoseTrack::new(times_ns.to_vec(), poses).unwrap()
    }

    fn angle(a: Pose, b: Pose) -> f64 {
        rotation_vector(a.rotation().conjugate() * b.rotation()).length()
    }

    /// Largest distance and angle between a track and the path it was sampled from.
    fn errors(track: &PoseTrack, path: impl Fn(f64) -> Pose) -> (f64, f64) {
        let (first_ns, last_ns) = (track.times_ns()[0], *track.times_ns().last().unwrap());
        let at = |k: i64| first_ns + (last_ns - first_ns) * k / 997;
        (0..=997).fold((0.0, 0.0), |(distance, turn), k| {
            let (found, expected) = (track.at(at(k)).unwrap(), path(at(k) as f64 * 1e-9));
            let apart_m = (found.translation_m() - expected.translation_m()).length();
            (f64::max(distance, apart_m), f64::max(turn, angle(found, expected)))
        })
    }

    #[test]
    fn samples_come_back_as_they_are() {
        let times_ns: Vec<i64> = (0..9).map(|k| k * 4_166_667).collect();
        let track = sampled(shaking, &times_ns);
        for (&t_ns, &pose) in times_ns.iter().zip(track.poses()) {
            assert_eq!(track.at(t_ns).unwrap(), pose);
        }
    }

    #[test]
    fn poses_at_many_times_are_those_at_each() {
        let times_ns: Vec<i64> = (0..9).map(|k| k * 4_166_667).collect();
        let track = sampled(shaking, &times_ns);
        let wanted: Vec<i64> = (0..=200).rev().chain(50..70).map(|k| k * 8 * 4_166_667 / 200).collect();
        let mut together = vec![Pose::IDENTITY];
        track.at_all(&wanted, &mut together).unwrap();
        assert_eq!(together, wanted.iter().map(|&t_ns| track.at(t_ns).unwrap()).collect::<Vec<_>>());
        assert!(track.at_all(&[0, 8 * 4_166_667 + 1], &mut together).is_err());
        let still = PoseTrack::still(shaking(0.3));
        still.at_all(&[-5, 7], &mut together).unwrap();
        assert_eq!(together, [shaking(0.3); 2]);
    }

    #[test]
    fn a_shake_is_followed_many_times_closer_than_straight_lines() {
        let times_ns: Vec<i64> = (0..25).map(|k| k * 25 * MS / 6).collect();
        let smooth = errors(&sampled(shaking, &times_ns), shaking);
        let mut straight = (0.0_f64, 0.0_f64);
        for pair in times_ns.windows(2) {
            let piece = errors(&sampled(shaking, pair), shaking);
            straight = (straight.0.max(piece.0), straight.1.max(piece.1));
        }
        assert!(smooth.0 < straight.0 / 15.0, "{smooth:?} {straight:?}");
        assert!(smooth.1 < straight.1 / 15.0, "{smooth:?} {straight:?}");
    }

    #[test]
    fn the_error_falls_with_the_fourth_power_of_the_spacing_even_at_uneven_times() {
        let uneven = |n: i64| -> Vec<i64> {
            (0..=n).map(|k| 100 * MS * k / n + if k % 2 == 1 { 20 * MS / n } else { 0 }).collect()
        };
        let (coarse, fine) = (
            errors(&sampled(shaking, &uneven(32)), shaking),
            errors(&sampled(shaking, &uneven(64)), shaking),
        );
        assert!(fine.0 < coarse.0 / 12.0, "{coarse:?} {fine:?}");
        assert!(fine.1 < coarse.1 / 12.0, "{coarse:?} {fine:?}");
    }

    #[test]
    fn velocities_are_continuous_at_every_sample() {
        let times_ns = [0, 3, 9, 11, 20, 26, 33].map(|ms| ms * MS);
        let track = sampled(shaking, &times_ns);
        let step_ns = 1000;
        for &t_ns in &times_ns[1..6] {
            let [a, b, c] = [t_ns - step_ns, t_ns, t_ns + step_ns].map(|t_ns| track.at(t_ns).unwrap());
            let speed = |a: Pose, b: Pose| (b.translation_m() - a.translation_m()) / (step_ns as f64 * 1e-9);
            // What the acceleration adds within a step.
            assert!((speed(b, c) - speed(a, b)).length() < 1e-3, "{t_ns}");
            let turn = |a: Pose, b: Pose| {
                rotation_vector(a.rotation().conjugate() * b.rotation()) / (step_ns as f64 * 1e-9)
            };
            assert!((turn(b, c) - turn(a, b)).length() < 2e-3, "{t_ns}");
        }
    }

    #[test]
    fn a_steady_screw_is_exact_however_fast_it_turns() {
        // Up to just below half a turn from sample to sample.
        for turn_a_sample in [0.01, 1.0, 2.0, 3.1] {
            let axis = DVec3::new(1.0, -2.0, 0.5).normalize();
            let screw = |t_s: f64| {
                Pose::new(
                    DQuat::from_scaled_axis(axis * (turn_a_sample * t_s / 0.01)),
                    DVec3::new(3.0 * t_s, 0.0, 1.0 - t_s),
                )
                .unwrap()
            };
            let times_ns: Vec<i64> = (0..7).map(|k| k * 10 * MS).collect();
            let (distance, turn) = errors(&sampled(screw, &times_ns), screw);
            assert!(distance < 1e-12 && turn < 1e-7, "{turn_a_sample}: {distance} {turn}");
        }
    }

    #[test]
    fn the_sign_of_a_quaternion_means_nothing() {
        let times_ns: Vec<i64> = (0..8).map(|k| k * 5 * MS).collect();
        let track = sampled(shaking, &times_ns);
        let flipped: Vec<Pose> = track
            .poses()
            .iter()
            .enumerate()
            .map(|(i, p)| if i % 3 == 1 { Pose::new(-p.rotation(), p.translation_m()).unwrap() } else { *p })
            .collect();
        let flipped = PoseTrack::new(times_ns, flipped).unwrap();
        for k in 0..350 {
            let (a, b) = (track.at(k * MS / 10).unwrap(), flipped.at(k * MS / 10).unwrap());
            assert!(angle(a, b) < 1e-7 && (a.translation_m() - b.translation_m()).length() < 1e-15, "{k}");
        }
    }

    #[test]
    fn two_samples_are_slerp_and_a_straight_line() {
        let (start, end) = (shaking(0.0), shaking(0.03));
        let track = PoseTrack::new(vec![-10, 10], vec![start, end]).unwrap();
        let middle = track.at(5).unwrap();
        let line = start.translation_m().lerp(end.translation_m(), 0.75);
        assert!((middle.translation_m() - line).length() < 1e-15);
        let total = angle(start, end);
        assert!((angle(start, middle) - 0.75 * total).abs() < 1e-7);
        assert!((angle(middle, end) - 0.25 * total).abs() < 1e-7);
    }

    #[test]
    fn one_sample_stands_still_at_all_times() {
        let pose = shaking(0.2);
        for track in [PoseTrack::still(pose), PoseTrack::new(vec![7], vec![pose]).unwrap()] {
            for t_ns in [i64::MIN, 0, 7, i64::MAX] {
                assert_eq!(track.at(t_ns).unwrap(), pose);
            }
            track.check_span(i64::MIN, i64::MAX).unwrap();
        }
    }

    #[test]
    fn samples_at_one_place_stand_still_within_their_times() {
        let stands = PoseTrack::new(vec![0, 4, 9], vec![shaking(0.2); 3]).unwrap();
        assert!(stands.stands() && stands.at(3) == Ok(shaking(0.2)) && stands.at(10).is_err());
        let moves = PoseTrack::new(vec![0, 4], vec![shaking(0.2), shaking(0.3)]).unwrap();
        assert!(!moves.stands());
    }

    #[test]
    fn tracks_at_shared_times_are_those_of_times_of_their_own() {
        let times_ns: Vec<i64> = [0, 3, 9, 11, 20, 26, 33].map(|ms| ms * MS).to_vec();
        let track = sampled(shaking, &times_ns);
        let times = PoseTimes::new(times_ns).unwrap();
        assert_eq!(PoseTrack::at_times(&times, track.poses().to_vec()), Ok(track));
        let few = PoseTrack::at_times(&times, vec![Pose::IDENTITY; 3]);
        assert_eq!(few, Err(TrackError::Count { times: 7, poses: 3 }));
    }

    #[test]
    fn wrong_tracks_and_times_outside_are_named() {
        let pose = Pose::IDENTITY;
        assert_eq!(PoseTrack::new(vec![], vec![]), Err(TrackError::Empty));
        assert_eq!(PoseTrack::new(vec![1, 2], vec![pose]), Err(TrackError::Count { times: 2, poses: 1 }));
        let order = PoseTrack::new(vec![5, 9, 9], vec![pose; 3]).unwrap_err();
        assert_eq!(order, TrackError::Order { index: 2, previous_ns: 9, actual_ns: 9 });
        assert_eq!(order.to_string(), "pose 2 is at 9 ns, expected after pose 1 at 9 ns");
        let track = PoseTrack::new(vec![5, 9], vec![pose; 2]).unwrap();
        track.check_span(5, 9).unwrap();
        for t_ns in [4, 10] {
            assert!(matches!(track.at(t_ns), Err(TrackError::Span { first_ns: 5, last_ns: 9, .. })));
        }
        let error = track.check_span(0, 20).unwrap_err().to_string();
        assert_eq!(error, "poses from 5 to 9 ns, expected them to span 0 to 20 ns");
    }

    #[test]
    fn times_at_both_ends_of_the_clock_do_not_overflow() {
        let track = PoseTrack::new(vec![i64::MIN, i64::MAX], vec![Pose::IDENTITY, shaking(0.0)]).unwrap();
        let middle = track.at(0).unwrap().translation_m();
        assert!((middle - 0.5 * shaking(0.0).translation_m()).length() < 1e-9);
    }
}
