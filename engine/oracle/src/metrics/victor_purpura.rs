//! Victor-Purpura distance: the lowest cost of turning one stream into another. Adding or deleting an event costs 1,
//! shifting it in time costs `|dt| / shift_ns`.

/// Distance between two ascending streams of times in nanoseconds.
///
/// No event is ever shifted by more than twice `shift_ns`: deleting and adding is cheaper. Wherever both streams pause
/// for longer than that, the problem separates into independent parts.
#[must_use]
pub fn distance(a: &[i64], b: &[i64], shift_ns: f64) -> f64 {
    let (mut i, mut j) = (0, 0);
    let mut total = 0.0;
    while i < a.len() || j < b.len() {
        let (i0, j0) = (i, j);
        let mut latest: Option<i64> = None;
        loop {
            let next = match (a.get(i), b.get(j)) {
                (Some(&s), Some(&t)) => s.min(t),
                (Some(&s), None) => s,
                (None, Some(&t)) => t,
                (None, None) => break,
            };
            if latest.is_some_and(|latest| next.abs_diff(latest) as f64 > 2.0 * shift_ns) {
                break;
            }
            latest = Some(next);
            if a.get(i) == Some(&next) {
                i += 1;
            } else {
                j += 1;
            }
        }
        total += edit_distance(&a[i0..i], &b[j0..j], shift_ns);
    }
    total
}

/// The distance by its definition: dynamic programming over all pairs of prefixes.
fn edit_distance(a: &[i64], b: &[i64], shift_ns: f64) -> f64 {
    if a.is_empty() || b.is_empty() {
        return (a.len() + b.len()) as f64;
    }
    let mut row: Vec<f64> = (0..=b.len()).map(|j| j as f64).collect();
    for (i, &s) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = (i + 1) as f64;
        for (j, &t) in b.iter().enumerate() {
            let shifted = diagonal + s.abs_diff(t) as f64 / shift_ns;
            diagonal = row[j + 1];
            row[j + 1] = shifted.min(row[j + 1] + 1.0).min(row[j] + 1.0);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::random::philox4x32_10;

    #[test]
    fn closed_forms() {
        let d = |a: &[i64], b: &[i64]| distance(a, b, 1000.0);
        assert_eq!(d(&[], &[]), 0.0);
        assert_eq!(d(&[1, 2, 3], &[]), 3.0);
        assert_eq!(d(&[0], &[500]), 0.5);
        assert_eq!(d(&[0], &[2000]), 2.0);
        assert_eq!(d(&[0], &[5000]), 2.0, "deleted and added");
        assert_eq!(d(&[0, 100], &[100]), 1.0);
        assert_eq!(d(&[0, 1000, 2000], &[1000, 2000, 3000]), 2.0, "one deleted, one added, none shifted");
        assert_eq!(d(&[7, 7], &[7]), 1.0);
    }

    #[test]
    fn cutting_at_pauses_changes_nothing_and_the_distance_is_a_metric() {
        let stream = |seed: u32, events: u32| {
            let mut t = 0;
            (0..events)
                .map(|i| {
                    t += i64::from(philox4x32_10([i, seed, 0, 0], [0; 2])[0] % 3000);
                    t
                })
                .collect::<Vec<i64>>()
        };
        for seed in 0..50 {
            let (a, b, c) = (stream(seed, 40), stream(seed + 100, 35), stream(seed + 200, 45));
            let ab = distance(&a, &b, 1000.0);
            assert!((ab - edit_distance(&a, &b, 1000.0)).abs() < 1e-9, "seed {seed}");
            assert_eq!(ab, distance(&b, &a, 1000.0), "seed {seed}");
            let detour = distance(&a, &c, 1000.0) + distance(&c, &b, 1000.0);
            assert!(ab <= detour + 1e-9, "seed {seed}");
            assert!(ab >= 5.0, "seed {seed}");
        }
    }
}
