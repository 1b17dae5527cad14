//! The velocity of a sample of a track.

use super::seconds;
use crate::paths::pose::Pose;
use crate::paths::turn::{nearest_turn, rotation_vectors};
use glam::DVec3;

/// Samples on either side of one that its velocity comes from. Two in place of one make a camera's path that shakes at
/// 25 Hz several times as exact at 240 samples a second; the design notes have the figures.
const REACH: usize = 2;

/// Most samples of a track that the velocity at one of them comes from, besides itself. At a track's end all of them are on
/// one side. So whoever takes a part of a track takes as many samples beyond either end of an interval, and poses within are
/// those of the whole track.
pub const NEIGHBOURS: usize = 2 * REACH;

/// Samples that are closer than this share of what a velocity spans are taken for one: a frame's pose beside that of a
/// simulation's step, some nanoseconds apart. The rounding of such poses would be divided by next to no time.
const ONE_SAMPLE: u64 = 2048;

/// The samples that a sample's velocity comes from besides itself. On either side outwards, so that each rotation can go
/// on from the one before. Where there are fewer, the sample itself stands for the others, without a weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stencil([Neighbour; NEIGHBOURS]);

#[derive(Clone, Copy, Debug)]
struct Neighbour {
    sample: usize,
    /// The derivative at the sample of Lagrange's polynomial that is 1 at the neighbour and 0 at the others.
    weight_hz: f64,
    /// How many times as far as the neighbour before on the same side it is; `None` without one.
    times_as_far: Option<f64>,
}

/// Rates at a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Velocity {
    /// Metres a second, world axes.
    pub linear_m_s: DVec3,
    /// Radians a second, body axes.
    pub angular_rad_s: DVec3,
}

impl Stencil {
    /// That of sample `own`.
    pub(super) fn new(times_ns: &[i64], own: usize) -> Self {
        let last = times_ns.len() - 1;
        let spans = [own.saturating_sub(REACH), (own + REACH).min(last)];
        let span_ns = spans.map(|end| times_ns[end].abs_diff(times_ns[own])).into_iter().max().unwrap_or(0);
        let least_ns = span_ns / ONE_SAMPLE;
        let before = Side::new(times_ns, own, least_ns, (0..own).rev());
        let after = Side::new(times_ns, own, least_ns, own + 1..times_ns.len());
        // As many on either side, unless the track ends before.
        let from_after = (NEIGHBOURS - before.count.min(REACH)).min(after.count);
        let before = before.nearest(NEIGHBOURS - from_after);
        let after = after.nearest(from_after);

        let offset_s = |sample: usize| seconds(times_ns[own], times_ns[sample]);
        let weight_hz = |sample: usize| {
            let others = before.iter().rev().chain(after).filter(|&&other| other != sample);
            others.fold(1.0 / offset_s(sample), |weight, &other| {
                weight * offset_s(other) / (offset_s(other) - offset_s(sample))
            })
        };
        let mut neighbours = [Neighbour { sample: own, weight_hz: 0.0, times_as_far: None }; NEIGHBOURS];
        let outwards = [before, after].into_iter().flat_map(|side| {
            let nearer = std::iter::once(None).chain(side.iter().map(Some));
            side.iter().zip(nearer)
        });
        for (neighbour, (&sample, nearer)) in neighbours.iter_mut().zip(outwards) {
            let times_as_far = nearer.map(|&nearer| offset_s(sample) / offset_s(nearer));
            *neighbour = Neighbour { sample, weight_hz: weight_hz(sample), times_as_far };
        }
        Stencil(neighbours)
    }
}

/// The nearest samples on one side of another, outwards, of which none are taken for one.
struct Side {
    samples: [usize; NEIGHBOURS],
    count: usize,
}

impl Side {
    fn new(times_ns: &[i64], own: usize, least_ns: u64, outwards: impl Iterator<Item = usize>) -> Self {
        let mut side = Side { samples: [own; NEIGHBOURS], count: 0 };
        let mut nearer = own;
        for sample in outwards {
            if side.count == NEIGHBOURS {
                break;
            }
            if times_ns[sample].abs_diff(times_ns[nearer]) > least_ns {
                side.samples[side.count] = sample;
                side.count += 1;
                nearer = sample;
            }
        }
        side
    }

    fn nearest(&self, most: usize) -> &[usize] {
        &self.samples[..self.count.min(most)]
    }
}

/// Velocity of sample `own`, whose stencil this is.
pub(super) fn velocity(Stencil(neighbours): &Stencil, poses: &[Pose], own: usize) -> Velocity {
    let from_world = poses[own].rotation().conjugate();
    let turns = rotation_vectors(neighbours.map(|n| from_world * poses[n.sample].rotation()));
    let mut velocity = Velocity::default();
    let mut before = DVec3::ZERO;
    for (neighbour, short) in neighbours.iter().zip(turns) {
        let turn = match neighbour.times_as_far {
            None => short,
            Some(times) => nearest_turn(short, before * times),
        };
        let shift_m = poses[neighbour.sample].translation_m() - poses[own].translation_m();
        velocity.linear_m_s += shift_m * neighbour.weight_hz;
        velocity.angular_rad_s += turn * neighbour.weight_hz;
        before = turn;
    }
    velocity
}
