//! Values that a share of many reach.

/// The value that a share of `values` reaches or exceeds. `None` of none.
pub(crate) fn upper(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let rank = ((1.0 - share) * values.len() as f64) as usize;
    values.get(rank.min(values.len().wrapping_sub(1))).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_of_the_values_reaches_what_is_reported() {
        let mut values: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!((upper(&mut values, 0.05), upper(&mut values, 0.5)), (Some(96.0), Some(51.0)));
        assert_eq!((upper(&mut [7.0], 0.0), upper(&mut [], 0.5)), (Some(7.0), None));
    }
}
