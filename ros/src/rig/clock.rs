//! Stamps of messages, in simulation time or wall-clock time.

use std::time::{SystemTime, UNIX_EPOCH};

/// Converts simulation times to stamps, and to the recording's times, which never go back.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StampClock {
    wall_offset_ns: Option<i64>,
    last_stamp_ns: Option<i64>,
    log_offset_ns: i64,
    restarted: bool,
    /// How often the simulation's time has gone back.
    pub resets: u64,
}

impl StampClock {
    /// The stamp of a tick at `t_ns`, and whether it moves the clock on. A tick may be older than the one
    /// before: one camera may lag behind another. The clock itself goes back only after
    /// [`StampClock::restart`], and wall-clock stamps never do.
    pub fn tick(&mut self, t_ns: i64, sim_time: bool) -> (i64, bool) {
        if !sim_time && self.wall_offset_ns.is_none() {
            self.wall_offset_ns = Some(wall_ns() - t_ns);
        }
        let mut stamp_ns = self.stamp(t_ns);
        if self.is_new() {
            // A recording has no times before 0: it counts from such a first stamp on.
            self.log_offset_ns = stamp_ns.min(0).saturating_neg();
        }
        let last_ns = self.last_stamp_ns.unwrap_or(i64::MIN);
        let restarted = std::mem::take(&mut self.restarted);
        if stamp_ns < last_ns && restarted {
            self.resets += 1;
            if sim_time {
                self.log_offset_ns += last_ns - stamp_ns;
            } else {
                // A simulation that runs faster than the wall clock may have used up future stamps.
                stamp_ns = wall_ns().max(last_ns + 1);
                self.wall_offset_ns = Some(stamp_ns - t_ns);
            }
        }
        let goes_on = stamp_ns > last_ns || restarted;
        if goes_on {
            self.last_stamp_ns = Some(stamp_ns);
        }
        (stamp_ns, goes_on)
    }

    /// Allows the simulation's time to go back with the next tick.
    pub fn restart(&mut self) {
        self.restarted = true;
    }

    /// Whether a stamp is older than the clock.
    pub fn is_past(&self, stamp_ns: i64) -> bool {
        self.last_stamp_ns.is_some_and(|last_ns| stamp_ns < last_ns)
    }

    /// Whether there has been no tick yet.
    pub fn is_new(&self) -> bool {
        self.last_stamp_ns.is_none()
    }

    /// The stamp of a simulation time.
    pub fn stamp(&self, t_ns: i64) -> i64 {
        t_ns + self.wall_offset_ns.unwrap_or(0)
    }

    /// The recording's time of a stamp: the stamp itself, unless the simulation began before 0 or went back. What is
    /// older than the first tick, such as its first IMU samples, is recorded at 0 at the earliest.
    pub fn log(&self, stamp_ns: i64) -> u64 {
        u64::try_from(stamp_ns.saturating_add(self.log_offset_ns)).unwrap_or(0)
    }
}

fn wall_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_goes_back_only_where_the_simulation_was_reset() {
        let mut clock = StampClock::default();
        assert_eq!([clock.tick(10, true), clock.tick(20, true)], [(10, true), (20, true)]);
        assert_eq!(clock.tick(15, true), (15, false), "a camera that is behind");
        clock.restart();
        assert_eq!((clock.tick(3, true), clock.resets), ((3, true), 1));
        assert_eq!((clock.log(3), clock.log(5)), (20, 22));
        assert_eq!((clock.tick(2, true), clock.resets), ((2, false), 1));
    }

    #[test]
    fn a_recording_of_a_time_before_zero_counts_from_its_first_stamp() {
        let mut clock = StampClock::default();
        assert_eq!(clock.tick(-200, true), (-200, true));
        clock.tick(50, true);
        assert_eq!([-250, -200, -150, 0, 50].map(|stamp| clock.log(stamp)), [0, 0, 50, 200, 250]);
        clock.restart();
        clock.tick(-200, true);
        assert_eq!(clock.log(-200), 250, "times go on after a reset");
    }

    #[test]
    fn wall_time_starts_now_and_goes_on_with_the_simulation() {
        let mut clock = StampClock::default();
        let (first_ns, _) = clock.tick(5, false);
        assert!(first_ns > 1_600_000_000_000_000_000);
        assert_eq!(clock.tick(1_005, false).0, first_ns + 1_000);
    }

    #[test]
    fn wall_time_goes_on_where_the_simulation_goes_back() {
        let mut clock = StampClock::default();
        clock.tick(0, false);
        let (last_ns, _) = clock.tick(3_600_000_000_000, false);
        clock.restart();
        assert_eq!((clock.tick(0, false), clock.resets), ((last_ns + 1, true), 1), "an hour is used up");
        assert_eq!(clock.tick(50, false), (last_ns + 51, true));
        assert_eq!(clock.log(last_ns + 51), last_ns as u64 + 51);
    }
}
