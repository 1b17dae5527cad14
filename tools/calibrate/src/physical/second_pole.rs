//! What recordings say about the second pole.

use super::interval::Interval;
use serde::Serialize;

/// Between which frequencies the second pole is, in nineteen of twenty cases.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SecondPole {
    /// The lowest one, Hz; `None` if even a quarter of the fitted frequency agrees with the exposures.
    pub least_hz: Option<f64>,
    /// The highest one, Hz; `None` if even four times the fitted frequency agrees with the exposures.
    pub most_hz: Option<f64>,
}

impl SecondPole {
    /// Of a pole that was found at this frequency.
    pub(super) fn of(second_pole_hz: f64, interval: Interval) -> Self {
        SecondPole {
            least_hz: interval.below.map(|below| second_pole_hz * (-below).exp()),
            most_hz: interval.above.map(|above| second_pole_hz * above.exp()),
        }
    }

    /// What to say if the exposures do not tell it.
    pub(super) fn remark(&self) -> Option<String> {
        let bound = match (self.least_hz, self.most_hz) {
            (Some(_), Some(_)) => return None,
            (Some(least_hz), None) => format!("it is at least {least_hz:.0} Hz"),
            (None, Some(most_hz)) => format!("it is at most {most_hz:.0} Hz"),
            (None, None) => "it may be far off in both directions".to_owned(),
        };
        Some(format!(
            "the exposures do not determine second_pole_hz: {bound}; fast flicker or steps in bright light would tell it"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pole_that_is_not_told_says_so_with_the_bound_that_there_is() {
        let remark = |below, above| SecondPole::of(1000.0, Interval { below, above }).remark();
        let [half, double] = [Some(2.0_f64.ln()); 2];
        assert_eq!(remark(half, double), None);
        assert!(remark(half, None).unwrap().contains("second_pole_hz: it is at least 500 Hz;"));
        assert!(remark(None, double).unwrap().contains("it is at most 2000 Hz;"));
        assert!(remark(None, None).unwrap().contains("it may be far off in both directions;"));
    }
}
