//! Counts durations in bins of constant relative width, so that a few kilobytes hold the quantiles of any
//! number of values.

/// Bins per octave. A quantile is off by at most 3%.
const PER_OCTAVE: u64 = 16;

/// Counts of durations.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Histogram {
    counts: Vec<u64>,
    total: u64,
}

impl Histogram {
    /// Counts a value, in nanoseconds.
    pub fn add(&mut self, ns: u64) {
        let class = class(ns);
        if self.counts.len() <= class {
            self.counts.resize(class + 1, 0);
        }
        self.counts[class] += 1;
        self.total += 1;
    }

    /// Number of values.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.total
    }

    /// Whether there are no values.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.total == 0
    }

    /// The value that this share (0 to 1) of all values does not exceed, nanoseconds. 0 if there are no
    /// values.
    #[must_use]
    pub fn quantile(&self, share: f64) -> u64 {
        let rank = ((share * self.total as f64).ceil() as u64).max(1);
        let mut seen = 0;
        for (class, count) in self.counts.iter().enumerate() {
            seen += count;
            if seen >= rank {
                return middle(class as u64);
            }
        }
        0
    }
}

/// The lowest values have a class each. Above them the leading bit and the next four bits make the class.
fn class(ns: u64) -> usize {
    if ns < PER_OCTAVE {
        return ns as usize;
    }
    let shift = u64::from(ns.ilog2()) - u64::from(PER_OCTAVE.ilog2());
    (shift * PER_OCTAVE + (ns >> shift)) as usize
}

fn middle(class: u64) -> u64 {
    if class < 2 * PER_OCTAVE {
        return class;
    }
    let shift = class / PER_OCTAVE - 1;
    ((class - shift * PER_OCTAVE) << shift) + (1 << shift) / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_right_to_three_percent() {
        let mut histogram = Histogram::default();
        (1..=10_000_u64).for_each(|i| histogram.add(i * 997));
        for share in [0.01, 0.5, 0.99, 1.0] {
            let (expected, actual) = (share * 9_970_000.0, histogram.quantile(share) as f64);
            assert!((actual / expected - 1.0).abs() < 0.032, "{share}: {actual}, expected {expected}");
        }
        assert_eq!((histogram.len(), Histogram::default().quantile(0.5)), (10_000, 0));
        assert_eq!(
            (0..40).map(|ns| middle(class(ns) as u64)).collect::<Vec<_>>()[..32],
            (0..32).collect::<Vec<_>>()[..]
        );
        histogram.add(u64::MAX);
        assert!(histogram.quantile(1.0) > u64::MAX / 32 * 31);
    }
}
