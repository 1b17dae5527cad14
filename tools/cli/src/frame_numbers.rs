//! The numbers in the names of frames: their order, and whether one is missing.

/// Sort key under which `f10` follows `f9`: text and numbers in turn.
pub fn natural(name: &str) -> Vec<(String, u128)> {
    let mut parts = vec![(String::new(), 0_u128)];
    let mut in_number = false;
    for c in name.chars() {
        if let Some(digit) = c.to_digit(10) {
            let number = &mut parts.last_mut().expect("never empty").1;
            *number = number.saturating_mul(10).saturating_add(u128::from(digit));
            in_number = true;
        } else {
            if in_number {
                parts.push((String::new(), 0));
                in_number = false;
            }
            parts.last_mut().expect("never empty").0.push(c);
        }
    }
    parts
}

/// A warning if names in their order leave numbers out. Names that differ in more than one number are not judged, and
/// every so many numbers is a rule, not a gap.
pub fn gap_warning(names: &[String]) -> Option<String> {
    let keys: Vec<_> = names.iter().map(|name| natural(name)).collect();
    let steps: Vec<(usize, u128)> =
        keys.windows(2).map(|pair| step(&pair[0], &pair[1])).collect::<Option<_>>()?;
    let (place, _) = *steps.first()?;
    if steps.iter().any(|(other, _)| *other != place) {
        return None;
    }
    let usual = if steps.len() == 1 { 1 } else { steps.iter().map(|(_, step)| *step).min()? };
    let mut gaps = (1..).zip(&steps).filter(|(_, (_, step))| *step > usual).map(|(after, _)| after);
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
fn step(from: &[(String, u128)], to: &[(String, u128)]) -> Option<(usize, u128)> {
    let same_text = from.len() == to.len() && from.iter().zip(to).all(|((a, _), (b, _))| a == b);
    let mut differing = (0..from.len()).filter(|&i| same_text && from[i].1 != to[i].1);
    let place = differing.next()?;
    let grows = to[place].1.checked_sub(from[place].1)?;
    differing.next().is_none().then_some((place, grows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_nine_comes_before_frame_ten() {
        let mut names = ["f10.exr", "f9.exr", "f009b.exr", "f0001.exr"];
        names.sort_by_key(|name| natural(name));
        assert_eq!(names, ["f0001.exr", "f9.exr", "f009b.exr", "f10.exr"]);
    }

    #[test]
    fn a_number_that_is_left_out_is_told() {
        let warning =
            |names: &[&str]| gap_warning(&names.iter().map(ToString::to_string).collect::<Vec<_>>());
        let told = warning(&["f_0000.exr", "f_0002.exr", "f_0003.exr"]).unwrap();
        assert!(told.starts_with("after f_0000.exr comes f_0002.exr: frames seem to be missing"), "{told}");
        assert!(warning(&["f_0000.exr", "f_0002.exr"]).is_some());
        let told = warning(&["a1.exr", "a2.exr", "a4.exr", "a5.exr", "a9.exr"]).unwrap();
        assert!(told.starts_with("after a2.exr comes a4.exr (and there is one more gap)"), "{told}");
        for whole in [
            &["f_0009.exr", "f_0010.exr"][..],
            &["f0.exr", "f10.exr", "f20.exr"],
            &["left1_2.exr", "left1_3.exr", "left2_1.exr"],
            &["f1.exr", "g3.exr"],
            &["f01.exr", "f1.exr"],
            &["day.exr", "night.exr"],
        ] {
            assert_eq!(warning(whole), None, "{whole:?}");
        }
        let huge = "9".repeat(60);
        assert!(warning(&["f1.exr", &format!("f{huge}.exr")]).is_some());
    }
}
