//! One step of a damped least-squares fit.

/// What a step is made from.
pub struct Step<'a> {
    /// Slope of each residual, by parameter.
    pub slopes: &'a [Vec<f64>],
    /// Residuals.
    pub residuals: &'a [f64],
    /// How far each parameter is from the first guess.
    pub moved: &'a [f64],
    /// Weight of the first guess.
    pub guess: f64,
    /// Damping, as a share of the diagonal.
    pub damping: f64,
}

/// The step that makes the squares of residuals and distances from the guess least, were all slopes constant.
pub fn solve(step: &Step<'_>) -> Vec<f64> {
    let count = step.slopes.len();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut rows: Vec<Vec<f64>> = (0..count)
        .map(|i| {
            let mut row: Vec<f64> = (0..count).map(|j| product(&step.slopes[i], &step.slopes[j])).collect();
            row[i] += step.damping * row[i] + step.guess;
            row.push(-product(&step.slopes[i], step.residuals) - step.guess * step.moved[i]);
            row
        })
        .collect();
    // Gauss's elimination with pivots; the matrix is positive definite.
    for i in 0..count {
        let pivot = (i..count).max_by(|&a, &b| rows[a][i].abs().total_cmp(&rows[b][i].abs())).unwrap_or(i);
        rows.swap(i, pivot);
        let (above, below) = rows.split_at_mut(i + 1);
        let pivot = &above[i];
        for row in below {
            let factor = row[i] / pivot[i];
            row.iter_mut().zip(pivot).skip(i).for_each(|(value, above)| *value -= factor * above);
        }
    }
    let mut by = vec![0.0; count];
    for i in (0..count).rev() {
        let known: f64 = (i + 1..count).map(|j| rows[i][j] * by[j]).sum();
        by[i] = ((rows[i][count] - known) / rows[i][i]).clamp(-0.7, 0.7);
    }
    by
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_problem_is_solved_in_one_step_and_what_nothing_tells_stays() {
        let slopes = [vec![2.0, 0.0, 1.0], vec![0.0, 4.0, -1.0], vec![0.0; 3]];
        let truth = [0.3, -0.2, 0.0];
        let residuals: Vec<f64> =
            (0..3).map(|r| -(0..3).map(|i| slopes[i][r] * truth[i]).sum::<f64>()).collect();
        let step =
            Step { slopes: &slopes, residuals: &residuals, moved: &[0.0; 3], guess: 1e-12, damping: 0.0 };
        for (by, truth) in solve(&step).iter().zip(truth) {
            assert!((by - truth).abs() < 1e-9, "{by} {truth}");
        }
    }
}
