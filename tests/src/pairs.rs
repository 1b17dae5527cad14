//! Pairwise testing: a small set of combinations in which every pair of values of two parameters occurs. It finds
//! faults that need two parameters to show, without testing every combination.

use std::collections::BTreeSet;

/// A parameter and its values.
pub type Choice = (&'static str, &'static [&'static str]);

/// Combinations in which every two values of every two choices occur together. A combination holds the index of each
/// choice's value. Greedy: each combination begins with a missing pair, then takes for every other choice the value
/// that completes most missing pairs.
#[must_use]
pub fn every_pair(choices: &[Choice]) -> Vec<Vec<usize>> {
    let values = |choice: usize| 0..choices[choice].1.len();
    let mut missing = BTreeSet::new();
    for a in 0..choices.len() {
        for b in a + 1..choices.len() {
            missing.extend(values(a).flat_map(|x| values(b).map(move |y| [(a, x), (b, y)])));
        }
    }
    let mut rows: Vec<Vec<usize>> = Vec::new();
    while let Some(&begins_with) = missing.first() {
        let mut row = begins_with.to_vec();
        for choice in (0..choices.len()).filter(|&choice| begins_with.iter().all(|taken| taken.0 != choice)) {
            let adds = |value: usize| {
                let pair = |&taken: &(usize, usize)| {
                    let mut pair = [taken, (choice, value)];
                    pair.sort_unstable();
                    pair
                };
                row.iter().filter(|taken| missing.contains(&pair(taken))).count()
            };
            // `max_by_key` returns the last maximum; `rev` makes the earlier of two equal values win.
            let best = values(choice).rev().max_by_key(|&value| adds(value)).expect("a choice has values");
            row.push((choice, best));
        }
        row.sort_unstable();
        missing.retain(|pair| pair.iter().any(|part| !row.contains(part)));
        rows.push(row.into_iter().map(|(_, value)| value).collect());
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_two_values_meet_in_few_combinations() {
        const CHOICES: [Choice; 5] = [
            ("a", &["1", "2", "3", "4"]),
            ("b", &["1", "2", "3"]),
            ("c", &["1", "2"]),
            ("d", &["1", "2"]),
            ("e", &["1"]),
        ];
        let rows = every_pair(&CHOICES);
        for a in 0..5 {
            for b in (0..5).filter(|&b| b != a) {
                let met: BTreeSet<_> = rows.iter().map(|row| (row[a], row[b])).collect();
                assert_eq!(met.len(), CHOICES[a].1.len() * CHOICES[b].1.len(), "{a} and {b}");
            }
        }
        // The two longest choices need twelve combinations by themselves. All combinations would be 48.
        assert!((12..=15).contains(&rows.len()), "{}", rows.len());
    }
}
