//! Few combinations that hold every pair of values: faults that it takes two parameters to show are found without
//! trying all values of all with all others.

use std::collections::BTreeSet;

/// A parameter and the values that it takes in turn.
pub type Choice = (&'static str, &'static [&'static str]);

/// Combinations, of each choice's value by its number, in which every two values of every two choices meet.
/// Greedy: each begins with a pair that is still missing, and takes what adds most of the others.
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
            // The earlier of two that add as much.
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
        // Twelve hold the two longest choices alone, 48 would be all.
        assert!((12..=15).contains(&rows.len()), "{}", rows.len());
    }
}
