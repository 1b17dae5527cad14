//! The velocity of a sample of a track.

use super::seconds;
use crate::paths::pose::Pose;
use crate::paths::turn::{nearest_turn, rotation_vector};
use glam::DVec3;

/// Samples on either side of one that its velocity comes from. Two in place of one make a camera's path that shakes at
/// 25 Hz several times as exact at 240 samples a second; the design notes have the figures.
const VELOCITY_REACH: usize = 2;

/// Most samples that a velocity comes from.
const STENCIL: usize = 2 * VELOCITY_REACH + 1;

/// The samples that a sample's velocity comes from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stencil {
    first: usize,
    count: usize,
    /// From the sample to each of them.
    offsets_s: [f64; STENCIL],
    /// The derivative at the sample of Lagrange's polynomial that is 1 at each of them and 0 at the others.
    weights_hz: [f64; STENCIL],
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
    pub(super) fn new(times_ns: &[i64], i: usize) -> Self {
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

/// Velocity of sample `i`.
pub(super) fn velocity(stencil: &Stencil, poses: &[Pose], i: usize) -> Velocity {
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
