//! Slows a simulation down to the wall clock, so that one can watch it.

use std::time::{Duration, Instant};

/// The pace of a simulation.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    real_time: bool,
    start: Option<(Instant, i64)>,
}

impl Pace {
    /// The wall clock's pace if `real_time`, else as fast as possible.
    #[must_use]
    pub fn new(real_time: bool) -> Self {
        Pace { real_time, start: None }
    }

    /// Waits until the wall time since the first call equals the simulated time since the first call's
    /// `t_ns`. Returns at once if that moment has passed.
    pub fn wait(&mut self, t_ns: i64) {
        if self.real_time {
            let (began, first_ns) = *self.start.get_or_insert_with(|| (Instant::now(), t_ns));
            let due = began + Duration::from_nanos(u64::try_from(t_ns - first_ns).unwrap_or(0));
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn real_time_waits_and_else_nothing_does() {
        let began = Instant::now();
        let mut pace = Pace::new(true);
        [5_000_000, 45_000_000].into_iter().for_each(|t_ns| pace.wait(t_ns));
        assert!(began.elapsed() >= Duration::from_millis(40));
        let began = Instant::now();
        let mut pace = Pace::new(false);
        [0, 3_600_000_000_000].into_iter().for_each(|t_ns| pace.wait(t_ns));
        assert!(began.elapsed() < Duration::from_secs(60));
    }
}
