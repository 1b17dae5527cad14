//! Whether the names of a folder's frames are those of one sequence.

use crate::counted::counted;
use crate::frame_numbers::{Key, Part, digits, texts};
use glob::Pattern;
use std::collections::{BTreeMap, BTreeSet};

/// Sequences that a message lists.
const LISTED: usize = 5;

/// What names say of their sequences.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Series {
    /// They are of one, as far as one can see.
    One,
    /// All but these are of one.
    OneAnd(String),
    /// They count in two numbers, of which one looks like that of a sequence: each sequence has the same frames.
    ByNumber(String),
    /// Their texts are those of several sequences.
    ByText(String),
}

/// What `names` with these `keys` say of their sequences.
pub fn of(names: &[String], keys: &[Key]) -> Series {
    let mut groups: BTreeMap<Vec<&str>, Vec<usize>> = BTreeMap::new();
    for (index, key) in keys.iter().enumerate() {
        groups.entry(texts(key)).or_default().push(index);
    }
    let groups: Vec<Vec<usize>> = groups.into_values().collect();
    let (sequences, others): (Vec<_>, Vec<_>) = groups.into_iter().partition(|group| group.len() > 1);
    match (&sequences[..], &others[..]) {
        ([all], []) => {
            by_number(keys, all).map_or(Series::One, |groups| Series::ByNumber(listed(&groups, names, keys)))
        }
        // Names without a rule, such as day and night, have an order all the same.
        ([], _) => Series::One,
        ([_], _) => {
            // Each is alone in its group.
            Series::OneAnd(some(others.iter().map(|group| names[group[0]].clone())))
        }
        _ => Series::ByText(listed(&sequences, names, keys)),
    }
}

/// The sequences of names that differ in two numbers, if each has the same frames. Of a number with a decimal point the
/// two are one.
fn by_number(keys: &[Key], all: &[usize]) -> Option<Vec<Vec<usize>>> {
    let first = &keys[all[0]];
    let varies = |place: &usize| all.iter().any(|&index| keys[index][*place].number != first[*place].number);
    let places: Vec<usize> = (0..first.len()).filter(varies).collect();
    let [one, other] = places[..] else { return None };
    if first[other].text == "." {
        return None;
    }
    let by = |place: usize, counts: usize| -> Option<Vec<Vec<usize>>> {
        let mut groups: BTreeMap<_, (BTreeSet<_>, Vec<usize>)> = BTreeMap::new();
        for &index in all {
            let (frames, members) = groups.entry(keys[index][place].number).or_default();
            frames.insert(keys[index][counts].number);
            members.push(index);
        }
        let (frames, _) = groups.values().next()?;
        let alike = groups.values().all(|(others, _)| others == frames) && frames.len() > 1;
        alike.then(|| groups.into_values().map(|(_, members)| members).collect())
    };
    // There are fewer sequences than frames.
    let fewest = [by(one, other)?, by(other, one)?];
    fewest.into_iter().min_by_key(Vec::len)
}

/// The sequences, by patterns that choose them, and how many frames each has.
fn listed(groups: &[Vec<usize>], names: &[String], keys: &[Key]) -> String {
    let told = |group: &Vec<usize>| {
        format!("{} ({})", pattern(group, names, keys), counted(group.len() as u64, "frame"))
    };
    some(groups.iter().map(told))
}

/// The first of a list, and how many more there are.
fn some(all: impl ExactSizeIterator<Item = String>) -> String {
    let more = all.len().saturating_sub(LISTED);
    let rest = (more > 0).then(|| format!("{more} more"));
    all.take(LISTED).chain(rest).collect::<Vec<_>>().join(", ")
}

/// A pattern of a group's names that matches no others, if there is one.
fn pattern(group: &[usize], names: &[String], keys: &[Key]) -> String {
    let with = |wild: &dyn Fn(&str) -> String| -> String {
        let first = digits(&names[group[0]]);
        let varies = |place: usize| {
            group.iter().any(|&index| keys[index][place].number != keys[group[0]][place].number)
        };
        let part = |(place, part): (usize, &Part)| {
            let number = first.get(place).copied().unwrap_or_default();
            let sign = if part.number.is_some_and(|number| number < 0) { "-" } else { "" };
            let number = if varies(place) { wild(number) } else { format!("{sign}{number}") };
            format!("{}{number}", Pattern::escape(&part.text))
        };
        keys[group[0]].iter().enumerate().map(part).collect()
    };
    let is_exact = |text: &String| {
        let Ok(pattern) = Pattern::new(text) else { return false };
        (0..names.len()).all(|index| pattern.matches(&names[index]) == group.contains(&index))
    };
    let any = with(&|_| "*".to_owned());
    let wide = with(&|number| "?".repeat(number.len()));
    if !is_exact(&any) && is_exact(&wide) { wide } else { any }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame_numbers::keys;

    fn series(names: &[&str]) -> Series {
        let names: Vec<String> = names.iter().map(ToString::to_string).collect();
        of(&names, &keys(&names))
    }

    #[test]
    fn names_of_one_sequence_are_taken_as_they_are() {
        for names in [
            &["f_0000.exr", "f_0001.exr"][..],
            &["day.exr", "night.exr"],
            &["f1.exr", "g3.exr"],
            &["f_-0002.exr", "f_-0001.exr", "f_0000.exr", "f_0001.exr"],
            &["frame-0001.exr", "frame-0002.exr", "frame0000.exr", "frame0001.exr"],
            &["left1_2.exr", "left1_3.exr", "left2_1.exr"],
            &["2026-11-29.exr", "2026-11-30.exr", "2026-12-01.exr"],
            &["12-00-58.exr", "12-00-59.exr", "12-01-00.exr", "12-01-01.exr"],
            &["f_1.0.exr", "f_1.5.exr", "f_2.0.exr", "f_2.5.exr"],
            &["f_1_10.exr", "f_2_20.exr", "f_3_30.exr"],
        ] {
            assert_eq!(series(names), Series::One, "{names:?}");
        }
        let odd = series(&["f_0000.exr", "f_0001.exr", "reference.exr"]);
        assert_eq!(odd, Series::OneAnd("reference.exr".to_owned()));
    }

    #[test]
    fn several_sequences_are_listed_by_patterns_that_choose_them() {
        let by_text = |names: &[&str], told: &str| {
            assert_eq!(series(names), Series::ByText(told.to_owned()), "{names:?}");
        };
        by_text(
            &["left_0000.exr", "left_0001.exr", "right_0000.exr", "right_0001.exr"],
            "left_*.exr (2 frames), right_*.exr (2 frames)",
        );
        by_text(
            &["0000_left.exr", "0000_right.exr", "0001_left.exr", "0001_right.exr"],
            "*_left.exr (2 frames), *_right.exr (2 frames)",
        );
        by_text(
            &["f_0000.exr", "f_0000_id.exr", "f_0001.exr", "f_0001_id.exr"],
            "f_????.exr (2 frames), f_*_id.exr (2 frames)",
        );
        let by_number = |names: &[&str], told: &str| {
            assert_eq!(series(names), Series::ByNumber(told.to_owned()), "{names:?}");
        };
        let cam0 = ["cam0_0000.exr", "cam0_0001.exr", "cam0_0002.exr"];
        by_number(
            &[&cam0[..], &["cam1_0000.exr", "cam1_0001.exr", "cam1_0002.exr"]].concat(),
            "cam0_*.exr (3 frames), cam1_*.exr (3 frames)",
        );
        by_number(
            &["0_cam0.exr", "0_cam1.exr", "1_cam0.exr", "1_cam1.exr", "2_cam0.exr", "2_cam1.exr"],
            "*_cam0.exr (3 frames), *_cam1.exr (3 frames)",
        );
        let many: Vec<String> = (0..7)
            .flat_map(|k| [0, 1].map(|i| format!("{}_{i}.exr", "abcdefg".chars().nth(k).unwrap())))
            .collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        let Series::ByText(told) = series(&many) else { panic!("seven") };
        assert!(told.ends_with("e_*.exr (2 frames), 2 more"), "{told}");
    }
}
