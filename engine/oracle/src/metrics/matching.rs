//! Matches events of two streams of one pixel and polarity. Both streams are walked in time order. Their next events
//! match if they lie within the window; otherwise the earlier one stays unmatched.

/// Time between the two events of every match, nanoseconds. Both inputs must be ascending.
#[must_use]
pub fn matched_errors_ns(a: &[i64], b: &[i64], window_ns: i64) -> Vec<u64> {
    let (mut i, mut j) = (0, 0);
    let mut errors = Vec::new();
    while i < a.len() && j < b.len() {
        let error = a[i].abs_diff(b[j]);
        if error <= window_ns as u64 {
            errors.push(error);
            i += 1;
            j += 1;
        } else if a[i] < b[j] {
            i += 1;
        } else {
            j += 1;
        }
    }
    errors
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_matches_once() {
        assert_eq!(matched_errors_ns(&[100], &[90, 100, 110], 20), [10]);
        assert_eq!(matched_errors_ns(&[0, 100, 200], &[100, 221], 20), [0]);
        assert_eq!(matched_errors_ns(&[0, 50], &[20, 70], 20), [20, 20]);
        assert!(matched_errors_ns(&[], &[1], 20).is_empty());
    }
}
