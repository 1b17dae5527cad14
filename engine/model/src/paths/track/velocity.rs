//! The velocity of a sample of a track.

use super::seconds;
use crate::paths::pose::Pose;
use crate::paths::turn::{nearest_turn, rotation_vectors};
use glam::DVec3;

/// Samples on either side of one that its velocity comes from. Two in place of one make a camera's path that shakes at
/// 25 Hz several times as exact at 240 samples a second; the design notes have the figures.
const REACH: usize = 2;

/// Most neighbours that a velocity comes from.
const NEIGHBOURS: usize = 2 * REACH;

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
        let count = (NEIGHBOURS + 1).min(times_ns.len());
        let first = own.saturating_sub(REACH).min(times_ns.len() - count);
        let offset_s = |sample: usize| seconds(times_ns[own], times_ns[sample]);
        let weight_hz = |sample: usize| {
            let others = (first..first + count).filter(|&other| other != own && other != sample);
            others.fold(1.0 / offset_s(sample), |weight, other| {
                weight * offset_s(other) / (offset_s(other) - offset_s(sample))
            })
        };
        let mut neighbours = [Neighbour { sample: own, weight_hz: 0.0, times_as_far: None }; NEIGHBOURS];
        let outwards = (first..own).rev().chain(own + 1..first + count);
        for (neighbour, sample) in neighbours.iter_mut().zip(outwards) {
            let before = if sample < own { sample + 1 } else { sample - 1 };
            let times_as_far = (before != own).then(|| offset_s(sample) / offset_s(before));
            *neighbour = Neighbour { sample, weight_hz: weight_hz(sample), times_as_far };
        }
        Stencil(neighbours)
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
