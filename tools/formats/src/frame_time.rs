//! When a frame is.

/// Time of frame `index` at `rate_hz`, rounded to the nearest nanosecond. Whole rates are exact.
#[must_use]
pub fn frame_time_ns(index: usize, rate_hz: f64) -> i64 {
    if rate_hz.fract() == 0.0 && rate_hz >= 1.0 {
        let (index, rate) = (index as i128, rate_hz as i128);
        return ((2 * index * 1_000_000_000 + rate) / (2 * rate)) as i64;
    }
    (index as f64 * 1e9 / rate_hz).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_times_are_exact_for_whole_rates() {
        assert_eq!([0, 1, 2, 3].map(|k| frame_time_ns(k, 30.0)), [0, 33_333_333, 66_666_667, 100_000_000]);
        assert_eq!(frame_time_ns(3_000_000_000, 30.0), 100_000_000_000_000_000);
        assert_eq!(frame_time_ns(1, 29.97), 33_366_700);
    }
}
