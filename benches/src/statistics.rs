//! Statistics of samples.

use serde::Serialize;

/// The quantile `q` (0 to 1) of the values, by nearest rank; 0 for no values.
#[must_use]
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}

/// The median, by nearest rank; 0 for no values.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// The mean; 0 for no values.
#[must_use]
pub fn mean(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { values.iter().sum::<f64>() / values.len() as f64 }
}

/// Median of repeated measurements and how they spread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// Quantile .25.
    pub lower_quartile: f64,
    /// Quantile .75.
    pub upper_quartile: f64,
    /// Quantile .99.
    pub p99: f64,
}

impl Spread {
    /// The spread of some values.
    #[must_use]
    pub fn of(values: &[f64]) -> Self {
        Spread {
            median: median(values),
            lower_quartile: quantile(values, 0.25),
            upper_quartile: quantile(values, 0.75),
            p99: quantile(values, 0.99),
        }
    }

    /// Distance between the quartiles as a share of the median; 0 if the median is 0.
    #[must_use]
    pub fn relative(&self) -> f64 {
        if self.median == 0.0 { 0.0 } else { (self.upper_quartile - self.lower_quartile) / self.median }
    }
}

/// Slope and intercept of the straight line with the least squared error; `None` for fewer than two
/// different `x`.
#[must_use]
pub fn line(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let (mx, my) = (mean_of(points, |p| p.0), mean_of(points, |p| p.1));
    let sxx: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
    let sxy: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    (sxx > 0.0).then(|| (sxy / sxx, my - sxy / sxx * mx))
}

fn mean_of(points: &[(f64, f64)], of: impl Fn(&(f64, f64)) -> f64) -> f64 {
    points.iter().map(of).sum::<f64>() / points.len().max(1) as f64
}

/// Order of convergence: minus the slope of `ln error` over `ln n`, from the points that are above zero.
#[must_use]
pub fn order(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<_> =
        points.iter().filter(|p| p.0 > 0.0 && p.1 > 0.0).map(|p| (p.0.ln(), p.1.ln())).collect();
    line(&logs).map(|(slope, _)| -slope)
}

/// Kolmogorov-Smirnov distance of two samples: the largest difference of their distribution functions.
#[must_use]
pub fn kolmogorov_smirnov(a: &[f64], b: &[f64]) -> f64 {
    let sorted = |values: &[f64]| {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted
    };
    let (a, b) = (sorted(a), sorted(b));
    if a.is_empty() || b.is_empty() {
        return if a.len() == b.len() { 0.0 } else { 1.0 };
    }
    let share = |sorted: &[f64], x: f64| sorted.partition_point(|v| *v <= x) as f64 / sorted.len() as f64;
    a.iter().chain(&b).map(|&x| (share(&a, x) - share(&b, x)).abs()).fold(0.0, f64::max)
}

/// First Wasserstein distance of two samples: the mean difference of their quantiles; NaN if one is empty.
#[must_use]
pub fn wasserstein(a: &[f64], b: &[f64]) -> f64 {
    const STEPS: usize = 1000;
    if a.is_empty() || b.is_empty() {
        return f64::NAN;
    }
    let at = |sorted: &[f64], q: f64| sorted[((q * sorted.len() as f64) as usize).min(sorted.len() - 1)];
    let (mut a, mut b) = (a.to_vec(), b.to_vec());
    a.sort_by(f64::total_cmp);
    b.sort_by(f64::total_cmp);
    let middle = |i: usize| (i as f64 + 0.5) / STEPS as f64;
    (0..STEPS).map(|i| (at(&a, middle(i)) - at(&b, middle(i))).abs()).sum::<f64>() / STEPS as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_their_closed_forms() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        let spread = Spread::of(&values);
        assert_eq!(
            [spread.median, spread.lower_quartile, spread.upper_quartile, spread.p99],
            [50.0, 25.0, 75.0, 99.0]
        );
        assert_eq!(spread.relative(), 1.0);
        assert_eq!(line(&[(1.0, 5.0), (3.0, 9.0)]), Some((2.0, 3.0)));
        assert_eq!(line(&[(1.0, 5.0), (1.0, 9.0)]), None);
        let second: Vec<(f64, f64)> = [8.0, 16.0, 32.0].map(|n| (n, 7.0 / (n * n))).to_vec();
        assert!((order(&second).unwrap() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn distances_of_samples_see_a_shift() {
        let a: Vec<f64> = (0..1000).map(f64::from).collect();
        let b: Vec<f64> = a.iter().map(|v| v + 100.0).collect();
        assert_eq!((kolmogorov_smirnov(&a, &a), wasserstein(&a, &a)), (0.0, 0.0));
        assert!((kolmogorov_smirnov(&a, &b) - 0.1).abs() < 1e-9);
        assert!((wasserstein(&a, &b) - 100.0).abs() < 1e-9);
        assert_eq!(kolmogorov_smirnov(&a, &[]), 1.0);
    }
}
