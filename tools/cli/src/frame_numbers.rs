//! The numbers in the names of frames: their order, and whether one is missing.

use std::collections::{BTreeMap, HashSet};

/// Text and numbers of a name in turn. Names in the order of their keys are in the order of their numbers: `f10` follows
/// `f9`, and `f_-3` comes before `f_0`.
pub type Key = Vec<Part>;

/// A text, and the number after it; the last text of a name may have none.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Part {
    /// The text.
    pub text: String,
    /// The number after it.
    pub number: Option<i128>,
}

/// Before a number that follows one of these, or that begins a name, `-` is always its sign.
const BEFORE_SIGN: [char; 2] = ['_', '.'];

/// The keys of the names of a folder. In `shot-0003` and `2026-11-29` the `-` is text; in `f_-0003` it is a sign, and so
/// it is in `shot-0003` where another name lacks it, as `shot0000` does. Numbers after a dot are decimals where they must
/// be: 0.25 comes before 0.5.
pub fn keys(names: &[String]) -> Vec<Key> {
    let plain: Vec<Key> = names.iter().map(|name| unsigned(name)).collect();
    let texts: HashSet<Vec<&str>> = plain.iter().map(|key| texts(key)).collect();
    let mut keys: Vec<Key> = plain.iter().map(|key| signed(key, &texts)).collect();
    read_decimals(names, &mut keys);
    keys
}

/// The texts of a key.
pub fn texts(key: &Key) -> Vec<&str> {
    key.iter().map(|part| part.text.as_str()).collect()
}

fn unsigned(name: &str) -> Key {
    let mut parts = vec![Part { text: String::new(), number: None }];
    for c in name.chars() {
        let last = parts.last_mut().expect("never empty");
        match (c.to_digit(10), last.number) {
            (Some(digit), number) => {
                let before = number.unwrap_or(0).saturating_mul(10);
                last.number = Some(before.saturating_add(i128::from(digit)));
            }
            (None, None) => last.text.push(c),
            (None, Some(_)) => parts.push(Part { text: c.to_string(), number: None }),
        }
    }
    parts
}

/// The key with the signs that its numbers have in a folder of these `texts`.
fn signed(key: &Key, texts: &HashSet<Vec<&str>>) -> Key {
    let part = |(place, part): (usize, &Part)| {
        let (Some(number), Some(before)) = (part.number, part.text.strip_suffix('-')) else {
            return part.clone();
        };
        let begins = place == 0 && before.is_empty();
        let mut without: Vec<&str> = self::texts(key);
        without[place] = before;
        match begins || before.ends_with(BEFORE_SIGN) || texts.contains(&without) {
            true => Part { text: before.to_owned(), number: Some(-number) },
            false => part.clone(),
        }
    };
    key.iter().enumerate().map(part).collect()
}

/// Turns fractions of different lengths into numbers of one length: in 0.25 and 0.5 they are 25 and 50. They are fractions
/// if one begins with 0, or if the numbers before them differ: `v2.9` and `v2.10` are frames 9 and 10.
fn read_decimals(names: &[String], keys: &mut [Key]) {
    let mut groups: BTreeMap<Vec<String>, Vec<usize>> = BTreeMap::new();
    for (index, key) in keys.iter().enumerate() {
        groups.entry(key.iter().map(|part| part.text.clone()).collect()).or_default().push(index);
    }
    for (texts, group) in groups {
        for place in (1..texts.len()).filter(|&place| texts[place] == ".") {
            let fraction = |index: usize| digits(&names[index]).get(place).copied().unwrap_or_default();
            let longest = group.iter().map(|&index| fraction(index).len()).max().unwrap_or(0);
            let is_any = |is: &dyn Fn(usize) -> bool| group.iter().any(|&index| is(index));
            let whole = keys[group[0]][place - 1].number;
            let differ = is_any(&|index| fraction(index).len() != longest);
            let must = is_any(&|index| fraction(index).len() > 1 && fraction(index).starts_with('0'))
                || is_any(&|index| keys[index][place - 1].number != whole);
            if !differ || !must {
                continue;
            }
            for &index in &group {
                let shorter_by = (longest - fraction(index).len()) as u32;
                let number = &mut keys[index][place].number;
                *number = number.map(|number| number.saturating_mul(10_i128.saturating_pow(shorter_by)));
            }
        }
    }
}

/// The numbers of a name as they are written.
pub fn digits(name: &str) -> Vec<&str> {
    name.split(|c: char| !c.is_ascii_digit()).filter(|digits| !digits.is_empty()).collect()
}

/// A warning if names in their order leave numbers out. Names that differ in more than one number are not judged, and
/// every so many numbers is a rule, not a gap; times that were rounded, such as .033, .067 and .1, are none either.
pub fn gap_warning(names: &[String], keys: &[Key]) -> Option<String> {
    let steps: Vec<(usize, i128)> =
        keys.windows(2).map(|pair| step(&pair[0], &pair[1])).collect::<Option<_>>()?;
    let (place, _) = *steps.first()?;
    if steps.iter().any(|(other, _)| *other != place) {
        return None;
    }
    let usual = if steps.len() == 1 { 1 } else { steps.iter().map(|(_, step)| *step).min()? };
    let most = usual.saturating_add(usual / 2);
    let mut gaps = (1..).zip(&steps).filter(|(_, (_, step))| *step > most).map(|(after, _)| after);
    let after: usize = gaps.next()?;
    let more = match gaps.count() {
        0 => String::new(),
        1 => " (and there is one more gap)".to_owned(),
        more => format!(" (and there are {more} more gaps)"),
    };
    Some(format!(
        "after {} comes {}{more}: frames seem to be missing, and no time is left for them",
        names[after - 1],
        names[after]
    ))
}

/// Where the only number is that two names differ in, and by how much it grows.
fn step(from: &Key, to: &Key) -> Option<(usize, i128)> {
    let same_text = texts(from) == texts(to);
    let mut differing = (0..from.len()).filter(|&i| same_text && from[i].number != to[i].number);
    let place = differing.next()?;
    let grows = to[place].number?.checked_sub(from[place].number?).filter(|step| *step >= 0)?;
    differing.next().is_none().then_some((place, grows))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn owned(names: &[&str]) -> Vec<String> {
        names.iter().map(ToString::to_string).collect()
    }

    #[track_caller]
    fn assert_order(names: &[&str]) {
        let mut backwards = owned(names);
        backwards.reverse();
        let mut sorted: Vec<_> = keys(&backwards).into_iter().zip(backwards).collect();
        sorted.sort();
        assert_eq!(sorted.into_iter().map(|(_, name)| name).collect::<Vec<_>>(), names);
    }

    #[test]
    fn frame_nine_comes_before_frame_ten() {
        assert_order(&["f0001.exr", "f9.exr", "f009b.exr", "f10.exr"]);
    }

    #[test]
    fn a_dash_is_a_sign_or_a_separator() {
        assert_order(&["f_-0003.exr", "f_-0001.exr", "f_0000.exr", "f_0002.exr"]);
        assert_order(&["f_-3.exr", "f_-2.exr"]);
        assert_order(&["-0002.exr", "-0001.exr", "0000.exr"]);
        assert_order(&["f.-0012.exr", "f.-0002.exr", "f.0001.exr"]);
        // Blender appends the number to any name.
        assert_order(&["frame-0002.exr", "frame-0001.exr", "frame0000.exr", "frame0001.exr"]);
        assert_order(&["shot--0002.exr", "shot--0001.exr", "shot-0000.exr"]);
        assert_order(&["shot-0001.exr", "shot-0002.exr", "shot-0010.exr"]);
        assert_order(&["2026-11-09.exr", "2026-11-29.exr", "2026-12-01.exr"]);
        assert_order(&["take 1 - 0001.exr", "take 1 - 0002.exr"]);
        assert_order(&["-0001-2.exr", "0000-1.exr", "0000-2.exr"]);
    }

    #[test]
    fn a_number_after_a_dot_is_a_decimal_where_it_must_be() {
        assert_order(&["0.25.exr", "0.5.exr", "0.75.exr", "1.0.exr", "1.125.exr"]);
        assert_order(&["t0.0.exr", "t0.0333.exr", "t0.0667.exr", "t0.1.exr"]);
        assert_order(&["f.2.exr", "f.10.exr"]);
        assert_order(&["v2.9.exr", "v2.10.exr", "v2.11.exr"]);
        assert_order(&["1.0009.exr", "1.0010.exr", "2.0001.exr"]);
        let huge = "9".repeat(60);
        assert_order(&["0.5.exr", &format!("1.{huge}.exr"), "2.5.exr"]);
    }

    #[test]
    fn a_number_that_is_left_out_is_told() {
        let warning = |names: &[&str]| gap_warning(&owned(names), &keys(&owned(names)));
        let told = warning(&["f_0000.exr", "f_0002.exr", "f_0003.exr"]).unwrap();
        assert!(told.starts_with("after f_0000.exr comes f_0002.exr: frames seem to be missing"), "{told}");
        assert!(warning(&["f_0000.exr", "f_0002.exr"]).is_some());
        let told = warning(&["a1.exr", "a2.exr", "a4.exr", "a5.exr", "a9.exr"]).unwrap();
        assert!(told.starts_with("after a2.exr comes a4.exr (and there is one more gap)"), "{told}");
        let told = warning(&["f_-0002.exr", "f_-0001.exr", "f_0001.exr"]).unwrap();
        assert!(told.starts_with("after f_-0001.exr comes f_0001.exr"), "{told}");
        for whole in [
            &["f_0009.exr", "f_0010.exr"][..],
            &["f0.exr", "f10.exr", "f20.exr"],
            &["left1_2.exr", "left1_3.exr", "left2_1.exr"],
            &["f1.exr", "g3.exr"],
            &["f01.exr", "f1.exr"],
            &["day.exr", "night.exr"],
            &["f_-0001.exr", "f_0000.exr", "f_0001.exr"],
            &["t0.0000.exr", "t0.0333.exr", "t0.0667.exr", "t0.1000.exr"],
            &["t0.0.exr", "t0.0333.exr", "t0.0667.exr", "t0.1.exr"],
            &["33333333ns.exr", "66666666ns.exr", "100000000ns.exr"],
        ] {
            assert_eq!(warning(whole), None, "{whole:?}");
        }
        let huge = "9".repeat(60);
        assert!(warning(&["f1.exr", &format!("f{huge}.exr")]).is_some());
    }
}
