//! No new connections for a while: the system had no descriptor or memory for the last one. The listener
//! stays readable then, so looking again at once would keep a processor busy and help nobody.

use std::time::{Duration, Instant};

/// The first pause.
const FIRST: Duration = Duration::from_millis(20);

/// Each failure doubles the pause, up to this.
const LONGEST: Duration = Duration::from_secs(1);

/// Whether connections may be accepted.
#[derive(Default)]
pub(super) struct Pause {
    until: Option<Instant>,
    failures: u32,
}

impl Pause {
    /// A connection could not be accepted; how long the pause is.
    pub(super) fn begin(&mut self, now: Instant) -> Duration {
        let length = (FIRST * 2_u32.saturating_pow(self.failures.min(16))).min(LONGEST);
        self.failures += 1;
        self.until = Some(now + length);
        length
    }

    /// One was accepted: the next pause is short again.
    pub(super) fn forget(&mut self) {
        *self = Pause::default();
    }

    /// What is left of the pause; `None` if connections may be accepted.
    pub(super) fn left(&self, now: Instant) -> Option<Duration> {
        let left = self.until?.saturating_duration_since(now);
        (!left.is_zero()).then_some(left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_to_a_second_and_start_short_again() {
        let now = Instant::now();
        let mut pause = Pause::default();
        assert_eq!(pause.left(now), None);
        let lengths: Vec<u128> = (0..8).map(|_| pause.begin(now).as_millis()).collect();
        assert_eq!(lengths, [20, 40, 80, 160, 320, 640, 1000, 1000]);
        assert_eq!(pause.left(now), Some(LONGEST));
        assert_eq!(pause.left(now + LONGEST), None);
        for _ in 0..100 {
            assert_eq!(pause.begin(now), LONGEST);
        }
        pause.forget();
        assert_eq!((pause.left(now), pause.begin(now)), (None, FIRST));
    }
}
