//! How far recordings allow a parameter to be from where it was found.
//!
//! The parameter is held at ever larger distances while the others are fitted anew. It is as far as it can be where the
//! squares have risen by what chance explains in one of twenty cases.

use super::least_squares::{Step, solve};
use super::search::{Found, Residuals, moved, squares};
use anyhow::Result;

/// Rise of the squares at the ends: two standard deviations.
const RISE: f64 = 4.0;

/// Largest distance that is looked at, a factor of four.
const FURTHEST: f64 = 1.386;

/// Smallest distance that is looked at.
const NEAREST: f64 = 0.02;

/// Distances that are looked at on each side, at most: enough to double from the smallest one to beyond the largest, and
/// to narrow an end.
const LOOKS: usize = 10;

/// Steps that fit the other parameters at each distance.
const STEPS: usize = 2;

/// The distances from the found point at which a parameter no longer agrees with the recordings, below and above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Below, as a positive number; `None` if there is none that is near.
    pub below: Option<f64>,
    /// Above, likewise.
    pub above: Option<f64>,
}

/// What is around a found point.
#[derive(Debug)]
pub struct Around {
    /// How far the parameter may be.
    pub interval: Interval,
    /// A point that agrees better by more than chance explains: the search had stopped at a wrong place.
    pub better: Option<Vec<f64>>,
}

/// Looks how far a parameter may be from where it was found. Both sides are simulated side by side.
pub fn look_around(of: &(impl Residuals + Sync), found: &Found, parameter: usize) -> Result<Around> {
    let sides = std::thread::scope(|scope| {
        let sides = [-1.0, 1.0].map(|sign| scope.spawn(move || side(of, found, parameter, sign)));
        sides.map(|side| side.join().expect("a simulation panicked"))
    });
    let [below, above] = sides;
    let (below, above) = (below?, above?);
    let lowest = [&below, &above].into_iter().min_by(|a, b| a.lowest.0.total_cmp(&b.lowest.0));
    let better = lowest.filter(|side| side.lowest.0 < -side.rise).map(|side| side.lowest.1.clone());
    Ok(Around { interval: Interval { below: below.end, above: above.end }, better })
}

/// One side of a found point.
struct Side {
    /// Distance of the end.
    end: Option<f64>,
    /// Rise of the squares at an end.
    rise: f64,
    /// Least rise that was met, and where.
    lowest: (f64, Vec<f64>),
}

fn side(of: &impl Residuals, found: &Found, parameter: usize, sign: f64) -> Result<Side> {
    let here = squares(&found.residuals);
    // Where even the best point does not agree, the errors are larger than was assumed.
    let rows = found.residuals.iter().filter(|residual| **residual != 0.0).count();
    let degrees = rows.saturating_sub(found.point.len()).max(1) as f64;
    let rise = RISE * (here / degrees).max(1.0);
    let mut side = Side { end: None, rise, lowest: (0.0, found.point.clone()) };
    let mut inside = (0.0, 0.0);
    let mut outside: Option<(f64, f64)> = None;
    let mut distance = (rise * variance(found, parameter)).sqrt().clamp(NEAREST, FURTHEST);
    for _ in 0..LOOKS {
        let there = refitted(of, found, parameter, sign * distance, here + rise)?;
        let risen = squares(&there.residuals) - here;
        if risen < side.lowest.0 {
            side.lowest = (risen, there.point);
        }
        if risen < rise {
            inside = (distance, risen.max(0.0));
            if distance >= FURTHEST {
                return Ok(side);
            }
        } else {
            outside = Some((distance, risen));
        }
        let Some((far, risen)) = outside else {
            distance = (2.0 * distance).min(FURTHEST);
            continue;
        };
        // Squares rise about as the square of the distance.
        let [low, high, end] = [inside.1, risen, rise].map(f64::sqrt);
        distance = inside.0 + (far - inside.0) * (end - low) / (high - low).max(1e-9);
        side.end = Some(distance);
        if far < 1.7 * inside.0 || high < 1.5 * end {
            break;
        }
    }
    Ok(side)
}

/// The variance of a parameter, were all slopes constant: what the others cannot undo tells it.
pub fn variance(found: &Found, parameter: usize) -> f64 {
    let free: Vec<usize> = (0..found.slopes.len()).filter(|&i| i != parameter).collect();
    // Small, since steps are cut at a bound.
    let small = 1e-3;
    let mut left: Vec<f64> = found.slopes[parameter].iter().map(|slope| slope * small).collect();
    let slopes: Vec<Vec<f64>> = free.iter().map(|&i| found.slopes[i].clone()).collect();
    let none = vec![0.0; slopes.len()];
    let by = solve(&Step { slopes: &slopes, residuals: &left, moved: &none, guess: 1e-6, damping: 0.0 });
    for (by, slopes) in by.iter().zip(&slopes) {
        left.iter_mut().zip(slopes).for_each(|(left, slope)| *left += by * slope);
    }
    small * small / squares(&left).max(1e-12)
}

/// The point with a parameter moved and the others fitted anew, until its squares are at most `enough`.
fn refitted(of: &impl Residuals, found: &Found, parameter: usize, by: f64, enough: f64) -> Result<Found> {
    let mut there = found.clone();
    there.point = moved(&found.point, parameter, by);
    // Others go with it as slopes foretell, before anything is simulated.
    there.residuals.iter_mut().zip(&found.slopes[parameter]).for_each(|(r, slope)| *r += by * slope);
    there.follow(&[parameter]);
    there.residuals = of.at(std::slice::from_ref(&there.point))?.remove(0);
    for _ in 0..STEPS {
        if squares(&there.residuals) < enough || there.attempt(of, &[parameter], 1e-2)? != Some(true) {
            break;
        }
    }
    Ok(there)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physical::search::search;

    /// Two parameters, of which the second one saturates: rates tell it while it is low.
    struct Saturating {
        truth: [f64; 2],
    }

    impl Saturating {
        fn rates(point: &[f64]) -> [f64; 3] {
            let part = 1.0 / (1.0 + (-3.0 * point[1]).exp());
            [point[0], point[0] + part, part - point[0]]
        }
    }

    impl Residuals for Saturating {
        fn steps(&self) -> &[f64] {
            &[0.01, 0.01]
        }

        fn at(&self, points: &[Vec<f64>]) -> Result<Vec<Vec<f64>>> {
            let truth = Self::rates(&self.truth);
            let of = |p: &Vec<f64>| {
                Self::rates(p).iter().zip(truth).map(|(a, b)| (a - b) / 0.03).collect::<Vec<f64>>()
            };
            Ok(points.iter().map(of).collect())
        }
    }

    fn ends(truth: [f64; 2]) -> Interval {
        let of = Saturating { truth };
        let found = search(&of, vec![0.0, 0.0], |_| {}).unwrap();
        assert!((found.point[0] - truth[0]).abs() < 0.02, "{:?}", found.point);
        let around = look_around(&of, &found, 1).unwrap();
        assert!(around.better.is_none(), "{around:?}");
        around.interval
    }

    #[test]
    fn what_is_told_has_two_ends_and_what_is_told_from_below_has_one() {
        let told = ends([0.2, 0.1]);
        // A rise of 4: .06 of two rates together, whose slope is about 3/4.
        for end in [told.below.unwrap(), told.above.unwrap()] {
            assert!((0.04..0.08).contains(&end), "{told:?}");
        }
        let from_below = ends([0.2, 1.5]);
        assert!(from_below.above.is_none() && from_below.below.unwrap() < 1.2, "{from_below:?}");
    }
}
