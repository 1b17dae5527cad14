//! Rotations as rotation vectors, axis times angle, and back.
//!
//! From one physics step to the next a body turns little, so series serve where their next term is below rounding.

use glam::{DQuat, DVec3};
use std::f64::consts::{PI, TAU};

/// Angle below which the axis of a rotation means nothing, radians.
const SMALL_ANGLE: f64 = 1e-4;

/// Square of a distance between rotation vectors, somewhat less than half a turn: no other one of the same rotation is
/// nearer.
const NEAR_SQUARE: f64 = 9.0;

/// Square of half an angle up to which short series are used.
pub const SERIES_SQUARE: f64 = 0.01;

/// Square of half an angle up to which long series are used: somewhat more than half a turn.
pub const LONG_SERIES_SQUARE: f64 = 2.5;

/// How often an angle is halved at most, for long series to serve. Angles that this does not suffice for do not occur.
pub const MOST_HALVINGS: u32 = 500;

/// Half the sine of an angle over that angle, by the angle's square.
pub const HALF_SINE: [f64; 5] = [0.5 / 362_880.0, -0.5 / 5040.0, 0.5 / 120.0, -0.5 / 6.0, 0.5];

/// The cosine of an angle, by its square.
pub const COSINE: [f64; 6] = [-1.0 / 3_628_800.0, 1.0 / 40_320.0, -1.0 / 720.0, 1.0 / 24.0, -1.0 / 2.0, 1.0];

/// As [`HALF_SINE`], long.
pub const LONG_HALF_SINE: [f64; 13] = long_series(0.5, 1);

/// As [`COSINE`], long.
pub const LONG_COSINE: [f64; 13] = long_series(1.0, 0);

/// `first`, and each coefficient the one before over the next two numbers from `from` on, with the other sign; from the
/// highest to the lowest.
const fn long_series(first: f64, from: u32) -> [f64; 13] {
    let mut coefficients = [first; 13];
    let mut i = 1;
    while i < 13 {
        let next = from + 2 * i as u32;
        coefficients[12 - i] = -coefficients[13 - i] / ((next - 1) * next) as f64;
        i += 1;
    }
    coefficients
}

/// A polynomial, from its highest coefficient to its lowest.
fn polynomial<const N: usize>(x: f64, coefficients: [f64; N]) -> f64 {
    coefficients.into_iter().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// Twice the arc sine over the sine, by the sine's square.
const TWICE_ARC: [f64; 8] = [
    2.0 * 143.0 / 10240.0,
    2.0 * 231.0 / 13312.0,
    2.0 * 63.0 / 2816.0,
    2.0 * 35.0 / 1152.0,
    2.0 * 5.0 / 112.0,
    2.0 * 3.0 / 40.0,
    2.0 / 6.0,
    2.0,
];

/// Axis times angle of the shorter way, radians.
pub(super) fn rotation_vector(rotation: DQuat) -> DVec3 {
    let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
    let axis = rotation.xyz();
    let square = axis.length_squared();
    if square < SERIES_SQUARE {
        return axis * polynomial(square, TWICE_ARC);
    }
    let sine = square.sqrt();
    axis * (2.0 * sine.atan2(rotation.w) / sine)
}

/// [`rotation_vector`] of several, with the same bits. Where all are short they are made in step, which takes less time.
pub(super) fn rotation_vectors<const N: usize>(rotations: [DQuat; N]) -> [DVec3; N] {
    let sign = rotations.map(|rotation| if rotation.w < 0.0 { -1.0 } else { 1.0 });
    let axes: [DVec3; N] = std::array::from_fn(|i| rotations[i].xyz() * sign[i]);
    let squares = axes.map(DVec3::length_squared);
    if squares.iter().any(|&square| square >= SERIES_SQUARE) {
        return rotations.map(rotation_vector);
    }
    let mut factors = [0.0; N];
    for coefficient in TWICE_ARC {
        for (factor, square) in factors.iter_mut().zip(squares) {
            *factor = *factor * square + coefficient;
        }
    }
    std::array::from_fn(|i| axes[i] * factors[i])
}

/// The rotation of a rotation vector, by sums and products alone: a kernel that takes the same has the same bits. Angles
/// for which no series serves are halved, and the rotation doubled as often.
pub(super) fn rotation_of(turn: DVec3) -> DQuat {
    let mut square = 0.25 * turn.length_squared();
    if square <= SERIES_SQUARE {
        let axis = turn * polynomial(square, HALF_SINE);
        return DQuat::from_xyzw(axis.x, axis.y, axis.z, polynomial(square, COSINE));
    }
    let (mut part, mut halvings) = (1.0, 0);
    while square > LONG_SERIES_SQUARE && halvings < MOST_HALVINGS {
        square *= 0.25;
        part *= 0.5;
        halvings += 1;
    }
    let mut axis = turn * (part * polynomial(square, LONG_HALF_SINE));
    let mut cosine = polynomial(square, LONG_COSINE);
    for _ in 0..halvings {
        let (sine_square, cosine_square) = (axis.length_squared(), cosine * cosine);
        // Twice a rotation of unit length, as `Pose` keeps it: else rounding would grow with each doubling.
        let unit = 1.5 - 0.5 * (sine_square + cosine_square);
        axis *= 2.0 * cosine * unit;
        cosine = (cosine_square - sine_square) * unit;
    }
    DQuat::from_xyzw(axis.x, axis.y, axis.z, cosine)
}

/// Of the rotation vectors of one rotation (they differ by whole turns), the one nearest to `expected`.
pub(super) fn nearest_turn(short: DVec3, expected: DVec3) -> DVec3 {
    if (expected - short).length_squared() < NEAR_SQUARE {
        return short;
    }
    let angle = short.length();
    let axis = if angle > SMALL_ANGLE { short / angle } else { expected.normalize_or_zero() };
    short + axis * (((expected - short).dot(axis) / TAU).round() * TAU)
}

/// The rate of change of the rotation vector `turn` of a body that turns at `angular_rad_s` about its own axes.
pub(super) fn rotation_vector_rate(turn: DVec3, angular_rad_s: DVec3) -> DVec3 {
    let square = turn.length_squared();
    let factor = if square < 4.0 * SERIES_SQUARE {
        const FACTOR: [f64; 6] = [
            691.0 / 1_307_674_368_000.0,
            1.0 / 47_900_160.0,
            1.0 / 1_209_600.0,
            1.0 / 30_240.0,
            1.0 / 720.0,
            1.0 / 12.0,
        ];
        polynomial(square, FACTOR)
    } else {
        let angle = square.sqrt();
        // (1 + cos) / sin is 1 / tan of the half angle, which is defined at half a turn too.
        (1.0 - 0.5 * angle / (0.5 * angle.min(PI)).tan()) / square
    };
    let cross = turn.cross(angular_rad_s);
    angular_rad_s + cross * 0.5 + turn.cross(cross) * factor
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turns about one axis, from tiny ones to ones for which series do not serve.
    fn turns() -> impl Iterator<Item = DVec3> {
        let axis = DVec3::new(0.6, -0.7, 0.39).normalize();
        (0..400).map(move |k| axis * (1e-9 * 1.0555_f64.powi(k)))
    }

    #[test]
    fn turns_of_many_times_around_are_halved_and_doubled() {
        let axis = DVec3::new(0.6, -0.7, 0.39).normalize();
        for turns in 1..4000 {
            let turn = axis * (0.37 * f64::from(turns));
            let apart = rotation_of(turn) - DQuat::from_scaled_axis(turn);
            assert!(apart.length() < 1e-15 * (1.0 + turn.length()), "{turn}: {apart}");
        }
        let endless = rotation_of(axis * 1e100);
        assert!((endless.length() - 1.0).abs() < 1e-12, "{endless}");
    }

    #[test]
    fn series_are_the_functions_that_they_stand_for() {
        let largest = turns().map(|turn| turn.length()).fold(0.0, f64::max);
        assert!(largest > 2.0 && largest < PI, "{largest}");
        for turn in turns() {
            let exact = DQuat::from_scaled_axis(turn);
            let apart = rotation_of(turn) - exact;
            assert!(apart.length() < 3e-16, "{turn}: {apart}");
            let back = rotation_vector(exact);
            assert!((back - turn).length() <= 4e-16 * (1.0 + turn.length()), "{turn}: {back}");
            assert!((rotation_vector(-exact) - back).length() == 0.0);
        }
        assert_eq!(rotation_vector(DQuat::IDENTITY), DVec3::ZERO);
        assert_eq!(rotation_of(DVec3::ZERO), DQuat::IDENTITY);
    }

    #[test]
    fn several_rotations_have_the_vectors_of_each() {
        let turns: Vec<DVec3> = turns().collect();
        for some in turns.windows(4) {
            let rotations: [DQuat; 4] = std::array::from_fn(|i| {
                let rotation = DQuat::from_scaled_axis(some[i]);
                if i % 2 == 0 { rotation } else { -rotation }
            });
            assert_eq!(rotation_vectors(rotations), rotations.map(rotation_vector));
        }
    }

    #[test]
    fn of_the_vectors_of_a_rotation_the_nearest_is_chosen() {
        let axis = DVec3::new(0.6, -0.7, 0.39).normalize();
        for short in (-31..=31).map(|k| axis * (0.1 * f64::from(k))) {
            for expected in (-400..400).map(|k| axis * (0.05 * f64::from(k)) + DVec3::new(0.3, 0.1, -0.2)) {
                let candidates = (-5..=5).map(|turns| short + axis * (TAU * f64::from(turns)));
                let apart = |turn: &DVec3| (expected - *turn).length();
                let least = candidates.map(|turn| apart(&turn)).fold(f64::INFINITY, f64::min);
                let chosen = nearest_turn(short, expected);
                // Without an angle the axis is the expected one's.
                let axis_known = short.length() > SMALL_ANGLE;
                assert!(!axis_known || apart(&chosen) <= least + 1e-9, "{short} {expected}: {chosen}");
                let turns = (chosen - short).length() / TAU;
                assert!((turns - turns.round()).abs() < 1e-9, "{short} {expected}: {chosen}");
            }
        }
    }

    #[test]
    fn the_rate_of_a_rotation_vector_is_what_a_small_further_turn_adds() {
        let rate = DVec3::new(-0.3, 0.9, 0.2);
        for turn in turns() {
            let step_s = 1e-5;
            let [before, after] = [-step_s, step_s]
                .map(|step_s| rotation_vector(DQuat::from_scaled_axis(turn) * rotation_of(rate * step_s)));
            let expected = (after - before) / (2.0 * step_s);
            assert!((rotation_vector_rate(turn, rate) - expected).length() < 1e-9, "{turn}");
        }
    }
}
