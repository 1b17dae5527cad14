//! Which choices are worth their cost.

/// Whether each `(cost, error)` lies on the frontier, that is, whether no other point is better in one and as good in
/// the other. Costs that differ by a share of less than `band`, and errors that differ by less than `error_band`, count
/// as equal, because such differences are noise.
#[must_use]
pub fn frontier(points: &[(f64, f64)], band: f64, error_band: f64) -> Vec<bool> {
    let dominates = |a: &(f64, f64), b: &(f64, f64)| {
        let (cheaper, as_cheap) = (a.0 < b.0 * (1.0 - band), a.0 * (1.0 - band) <= b.0);
        let (better, as_good) = (a.1 < b.1 - error_band, a.1 <= b.1 + error_band);
        (cheaper && as_good) || (better && as_cheap)
    };
    points.iter().map(|point| !points.iter().any(|other| dominates(other, point))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dearer_and_worse_is_not_on_it() {
        let points = [(1.0, 1.0), (2.0, 0.5), (3.0, 0.6), (4.0, 0.1), (4.0, 0.2), (0.5, 3.0)];
        assert_eq!(frontier(&points, 0.0, 0.0), [true, true, false, true, false, true]);
    }

    #[test]
    fn differences_within_the_noise_do_not_decide() {
        let points = [(100.0, 0.5), (101.0, 0.5), (110.0, 0.5)];
        assert_eq!(frontier(&points, 0.0, 0.0), [true, false, false]);
        assert_eq!(frontier(&points, 0.05, 0.0), [true, true, false]);
        let points = [(100.0, 0.5), (100.0, 0.501), (100.0, 0.6)];
        assert_eq!(frontier(&points, 0.05, 0.01), [true, true, false]);
    }

    #[test]
    fn a_point_alone_or_twice_is_on_it() {
        assert_eq!(frontier(&[(1.0, 1.0)], 0.0, 0.0), [true]);
        assert_eq!(frontier(&[(1.0, 1.0), (1.0, 1.0)], 0.0, 0.0), [true, true]);
    }
}
