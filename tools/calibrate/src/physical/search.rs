//! The search for the parameters at which simulated rates agree with recorded ones.
//!
//! Rates rise in steps: a pixel in fast flicker sends a whole number of events a period, so a rate may stay where it is
//! while a parameter moves. Slopes therefore hold only near the place where they were measured. Each try corrects them by
//! what it has shown (Broyden's rule), and they are measured anew until the squares no longer fall.

use super::least_squares::{Step, solve};
use anyhow::Result;

/// Times that slopes are measured at most.
pub const ROUNDS: usize = 8;

/// Tries with the slopes of one round. A try is one simulation, slopes are one for each parameter.
const TRIES: usize = 5;

/// A step that lowers the sum of squares by less, of residuals in their errors, is not worth a simulation.
const GAIN: f64 = 1.0;

/// A round that lowers it by less is the last one.
const LEAST_GAIN: f64 = 2.0;

/// Weight of the first guess: a parameter that changes no rate by a tenth of this share stays where it is.
const GUESS: f64 = 0.02;

/// What is searched: residuals of points, which are distances of the parameters from the first guess.
pub trait Residuals {
    /// The step of each parameter for slopes.
    fn steps(&self) -> &[f64];
    /// The residuals of each of these points.
    fn at(&self, points: &[Vec<f64>]) -> Result<Vec<Vec<f64>>>;
}

/// A point, and residuals and their slopes there.
#[derive(Clone, Debug)]
pub struct Found {
    /// Distance of each parameter from the first guess.
    pub point: Vec<f64>,
    /// Residuals.
    pub residuals: Vec<f64>,
    /// Slope of each residual, by parameter.
    pub slopes: Vec<Vec<f64>>,
}

/// The sum of squares.
pub fn squares(residuals: &[f64]) -> f64 {
    residuals.iter().map(|r| r * r).sum()
}

/// The best point that is found from this one. `round` is called before each round.
pub fn search(of: &impl Residuals, start: Vec<f64>, mut round: impl FnMut(usize)) -> Result<Found> {
    let residuals = of.at(std::slice::from_ref(&start))?.remove(0);
    let mut found = Found { point: start, residuals, slopes: Vec::new() };
    let mut damping = 0.1;
    for number in 0..ROUNDS {
        round(number);
        found.slopes = slopes(of, &found)?;
        // The slopes that are kept are those that were measured: corrected ones hold along the way that was gone only.
        let mut tried = found.clone();
        let mut moved = false;
        for _ in 0..TRIES {
            let Some(better) = tried.attempt(of, &[], damping)? else { break };
            moved |= better;
            damping = if better { (damping * 0.3_f64).max(1e-3) } else { (damping * 4.0).min(1e3) };
        }
        let gain = squares(&found.residuals) - squares(&tried.residuals);
        (found.point, found.residuals) = (tried.point, tried.residuals);
        if !moved || gain < LEAST_GAIN {
            break;
        }
    }
    Ok(found)
}

/// The nearest of what `search` finds from these starts, each with its misfit. Those behind the first are searched only
/// while none came nearer than `near`: a search may end in a hollow beside the deepest one.
pub fn nearest<S, T>(
    starts: impl IntoIterator<Item = S>,
    near: f64,
    mut search: impl FnMut(S) -> Result<(f64, T)>,
) -> Result<Option<T>> {
    let mut best: Option<(f64, T)> = None;
    for start in starts {
        let found = search(start)?;
        if best.as_ref().is_none_or(|(misfit, _)| found.0 < *misfit) {
            best = Some(found);
        }
        if best.as_ref().is_some_and(|(misfit, _)| *misfit < near) {
            break;
        }
    }
    Ok(best.map(|(_, found)| found))
}

/// Measures slopes.
fn slopes(of: &impl Residuals, at: &Found) -> Result<Vec<Vec<f64>>> {
    let steps = of.steps();
    let points: Vec<Vec<f64>> = (0..steps.len()).map(|i| moved(&at.point, i, steps[i])).collect();
    let there = of.at(&points)?;
    let slope = |(there, step): (&Vec<f64>, &f64)| {
        there.iter().zip(&at.residuals).map(|(there, here)| (there - here) / step).collect()
    };
    Ok(there.iter().zip(steps).map(slope).collect())
}

/// The point with one parameter moved.
pub fn moved(point: &[f64], parameter: usize, by: f64) -> Vec<f64> {
    let mut point = point.to_vec();
    point[parameter] += by;
    point
}

impl Found {
    /// The step to where squares are least, were all slopes constant. Parameters in `held` stay.
    fn step(&self, held: &[usize], damping: f64) -> Vec<f64> {
        let free: Vec<usize> = (0..self.point.len()).filter(|i| !held.contains(i)).collect();
        let slopes: Vec<Vec<f64>> = free.iter().map(|&i| self.slopes[i].clone()).collect();
        let moved: Vec<f64> = free.iter().map(|&i| self.point[i]).collect();
        let free_by = solve(&Step {
            slopes: &slopes,
            residuals: &self.residuals,
            moved: &moved,
            guess: GUESS,
            damping,
        });
        let mut by = vec![0.0; self.point.len()];
        free.iter().zip(free_by).for_each(|(&i, free_by)| by[i] = free_by);
        by
    }

    /// The residuals after a step, were all slopes constant.
    fn foretold(&self, by: &[f64]) -> Vec<f64> {
        let mut residuals = self.residuals.clone();
        for (by, slopes) in by.iter().zip(&self.slopes) {
            residuals.iter_mut().zip(slopes).for_each(|(residual, slope)| *residual += by * slope);
        }
        residuals
    }

    /// Goes that step without a look at what is there.
    pub fn follow(&mut self, held: &[usize]) {
        let by = self.step(held, 0.0);
        self.point.iter_mut().zip(by).for_each(|(point, by)| *point += by);
    }

    /// Tries that step, goes there if it is better, and corrects the slopes by what it has shown. `None` if the slopes
    /// foretell no gain.
    pub fn attempt(&mut self, of: &impl Residuals, held: &[usize], damping: f64) -> Result<Option<bool>> {
        let by = self.step(held, damping);
        let foretold = self.foretold(&by);
        if squares(&self.residuals) - squares(&foretold) < GAIN {
            return Ok(None);
        }
        let point: Vec<f64> = self.point.iter().zip(&by).map(|(point, by)| point + by).collect();
        let residuals = of.at(std::slice::from_ref(&point))?.remove(0);
        let scaled: Vec<f64> = by.iter().zip(of.steps()).map(|(by, step)| by / step).collect();
        let length = squares(&scaled);
        for ((slopes, scaled), step) in self.slopes.iter_mut().zip(&scaled).zip(of.steps()) {
            for ((slope, there), foretold) in slopes.iter_mut().zip(&residuals).zip(&foretold) {
                *slope += (there - foretold) * scaled / (step * length);
            }
        }
        let better = squares(&residuals) < squares(&self.residuals);
        if better {
            (self.point, self.residuals) = (point, residuals);
        }
        Ok(Some(better))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's bent valley, whose floor slopes gently to its end at [1, 1].
    struct Valley;

    impl Residuals for Valley {
        fn steps(&self) -> &[f64] {
            &[0.05, 0.05]
        }

        fn at(&self, points: &[Vec<f64>]) -> Result<Vec<Vec<f64>>> {
            Ok(points.iter().map(|p| vec![100.0 * (p[1] - p[0] * p[0]), 30.0 * (1.0 - p[0])]).collect())
        }
    }

    #[test]
    fn a_bent_valley_is_followed_to_its_end() {
        let mut rounds = 0;
        let found = search(&Valley, vec![-0.5, 0.5], |_| rounds += 1).unwrap();
        assert!(found.point.iter().all(|at| (at - 1.0).abs() < 0.05), "{found:?}");
        assert!(squares(&found.residuals) < LEAST_GAIN && rounds < ROUNDS, "{found:?} {rounds}");
    }

    /// Two hollows, of which the one at 2 is the deeper.
    struct Hollows;

    impl Residuals for Hollows {
        fn steps(&self) -> &[f64] {
            &[0.01]
        }

        fn at(&self, points: &[Vec<f64>]) -> Result<Vec<Vec<f64>>> {
            Ok(points.iter().map(|p| vec![10.0 * (p[0] + 2.0) * (p[0] - 2.0), 3.0 * (p[0] - 2.0)]).collect())
        }
    }

    #[test]
    fn a_search_that_ends_in_a_hollow_begins_anew_elsewhere() {
        let mut begun = Vec::new();
        let mut from = |start: f64| {
            begun.push(start);
            let found = search(&Hollows, vec![start], |_| {})?;
            Ok((squares(&found.residuals).sqrt(), found.point[0]))
        };
        assert!((from(-3.0).unwrap().1 + 2.0).abs() < 0.3, "the hollow beside");
        let found = nearest([-3.0, -2.5, 3.0, 4.0], 1.0, &mut from).unwrap().unwrap();
        assert!((found - 2.0).abs() < 0.1, "{found}");
        assert_eq!(begun, [-3.0, -3.0, -2.5, 3.0]);
    }

    #[test]
    fn a_try_tells_slopes_that_were_not_measured() {
        let point = vec![0.5, 0.0];
        let residuals = Valley.at(std::slice::from_ref(&point)).unwrap().remove(0);
        // The slope of the first residual by the first parameter is -100 there.
        let slopes = vec![vec![0.0, -30.0], vec![100.0, 0.0]];
        let mut found = Found { point, residuals, slopes };
        assert_eq!(found.attempt(&Valley, &[], 0.0).unwrap(), Some(false));
        // It went to [1, .25], where the first residual is -75 in place of -25: slopes along the way say so now.
        let along = 0.5 * found.slopes[0][0] + 0.25 * found.slopes[1][0];
        assert!((along + 50.0).abs() < 0.1, "{found:?}");
        let held = found.clone();
        assert!(found.attempt(&Valley, &[0, 1], 0.0).unwrap().is_none());
        assert_eq!(found.point, held.point);
    }
}
