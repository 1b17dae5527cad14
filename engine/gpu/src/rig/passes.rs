//! How many passes of `synthesize` and `cross` a tick takes.
//!
//! `levels` has room for those of most intervals, not for the most that an interval could need. In each pass the tiles that
//! find room are synthesised and walked, and the others are left to the next one. A pass without tiles costs time
//! too, so a tick has as many as the ones before it needed; the first interval has as many as any can
//! need. If they are too few, the rest runs again, with as many as any interval can need. Packets do not depend on it.

use super::geometry::TILE_LEVEL_ROWS;
use super::machine::TickEnd;

/// Passes shrink once so many ticks in a row needed fewer.
const QUIET_TICKS: u32 = 8;

/// Rows of `levels` that cameras used in a tick; `None` if it had no interval.
pub(super) fn rows_used(end: &TickEnd) -> Option<u64> {
    let counters = || end.counters.iter().flatten();
    let any_interval = counters().any(|counters| counters.substeps > 0 || counters.skipped_blocks > 0);
    any_interval.then(|| counters().map(|counters| u64::from(counters.level_rows)).sum())
}

/// The number of passes of a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Passes {
    count: u32,
    quiet_ticks: u32,
    /// The most that a tick needed since passes last changed or were about to shrink.
    needed: u32,
}

impl Default for Passes {
    /// As many as any interval needs: nothing is known yet.
    fn default() -> Self {
        Passes { count: u32::MAX, quiet_ticks: 0, needed: 0 }
    }
}

impl Passes {
    /// The passes of the next tick. `most` is what any interval needs.
    pub(super) fn count(self, most: u32) -> u32 {
        self.count.min(most)
    }

    /// Adapts the number after a tick with an interval that used `used` of `rows` rows, each of its passes.
    pub(super) fn follow(&mut self, used: u64, rows: u64) {
        // A quarter more: intervals are not alike.
        let wanted = (used + used / 4).div_ceil(rows.saturating_sub(TILE_LEVEL_ROWS).max(1));
        let wanted = u32::try_from(wanted).unwrap_or(u32::MAX).max(1);
        if wanted > self.count || *self == Passes::default() {
            *self = Passes { count: wanted, quiet_ticks: 0, needed: 0 };
            return;
        }
        self.needed = self.needed.max(wanted);
        self.quiet_ticks = if wanted < self.count { self.quiet_ticks + 1 } else { 0 };
        if self.quiet_ticks == 0 {
            self.needed = 0;
        } else if self.quiet_ticks >= QUIET_TICKS {
            *self = Passes { count: self.needed, quiet_ticks: 0, needed: 0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: u64 = 1000 + TILE_LEVEL_ROWS;

    #[test]
    fn passes_grow_at_once_and_shrink_after_a_quiet_time_to_what_it_needed() {
        let mut passes = Passes::default();
        assert_eq!((passes.count(1), passes.count(9)), (1, 9));
        passes.follow(6800, ROWS);
        for used in [100, 100, 900, 100, 100, 100, 100] {
            assert_eq!(passes.count(9), 9);
            passes.follow(used, ROWS);
        }
        assert_eq!(passes.count(9), 9);
        passes.follow(100, ROWS);
        assert_eq!(passes.count(9), 2, "900 rows and a quarter more");
        passes.follow(4000, ROWS);
        assert_eq!((passes.count(9), passes.count(3)), (5, 3));
        for _ in 0..QUIET_TICKS {
            assert_eq!(passes.count(9), 5);
            passes.follow(0, ROWS);
        }
        assert_eq!(passes.count(9), 1, "there is one at least");
    }

    #[test]
    fn the_first_interval_tells_how_many_are_needed() {
        for (used, count) in [(0, 1), (100, 1), (900, 2)] {
            let mut passes = Passes::default();
            passes.follow(used, ROWS);
            assert_eq!(passes.count(9), count);
        }
    }
}
