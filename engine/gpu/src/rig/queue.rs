//! How long the event queues of `cross` are, and whether a tick has a second run of `cross`.
//!
//! A sub-tile with more events than its queue holds runs again, and walks its pixels twice more. A longer queue spares
//! that, but it takes shared memory, so that fewer sub-tiles run at once. So queues are short until intervals overflow
//! them, and become short again after a time of few events.
//!
//! Where too few sub-tiles overflow to be worth longer queues for all, but some do in tick after tick, the tick has a
//! second run for these, with a queue that is long enough for most. It spares another submission, in which each sub-tile
//! looks for work and `sort` begins anew. Packets do not depend on any of this.

use super::CameraState;
use super::machine::TickEnd;
use super::record::MOST_GROUPS;
use esaac_layout::{Counters, QUEUE_PER_PX, SUB_TILES};

/// What a second run costs before its first sub-tile, in walks of a sub-tile.
const RERUN_WALKS: u64 = 280;

/// Walks that each sub-tile of a second run costs.
const OVERFLOW_WALKS: u64 = 1;

/// What a queue of twice the first length costs: a walk for every so many sub-tiles.
const SUB_TILES_PER_WALK: u64 = 8;

/// Queues grow once so many ticks in a row would have been cheaper with a longer one.
const BUSY_TICKS: u32 = 2;

/// Queues shrink once for so many ticks in a row each pixel has had, on average, less than one event in
/// [`QUIET_SHARE`] of their length.
const QUIET_TICKS: u32 = 30;

/// See [`QUIET_TICKS`].
const QUIET_SHARE: u64 = 8;

/// What a tick tells about the queues of its cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Load {
    pub pixels: u64,
    pub sub_tiles: u64,
    pub events: u64,
    pub overflows: u64,
    /// Sub-tiles that were left to another submission.
    pub left: u64,
}

impl Load {
    /// The load of all cameras that took part in a tick.
    pub(super) fn of(cameras: &[CameraState], end: &TickEnd) -> Self {
        let mut load = Load { overflows: end.queue_overflows, left: end.left_sub_tiles, ..Load::default() };
        for (camera, counters) in cameras.iter().zip(&end.counters) {
            let Some(Counters { emitted, .. }) = *counters else { continue };
            load.pixels += u64::from(camera.place.pixels);
            load.sub_tiles += u64::from(camera.place.tiles * SUB_TILES);
            load.events += u64::from(emitted);
        }
        load
    }
}

/// The length of all queues of a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct QueueLength {
    per_px: u32,
    busy_ticks: u32,
    quiet_ticks: u32,
}

impl Default for QueueLength {
    fn default() -> Self {
        QueueLength::of(QUEUE_PER_PX)
    }
}

impl QueueLength {
    fn of(per_px: u32) -> Self {
        QueueLength { per_px, busy_ticks: 0, quiet_ticks: 0 }
    }

    /// Events that a queue has room for, for each pixel of a sub-tile.
    pub(super) fn per_px(self) -> u32 {
        self.per_px
    }

    /// Adapts the length after a tick. `most_per_px` limits it.
    pub(super) fn follow(&mut self, load: Load, most_per_px: u32) {
        let is_quiet = load.events * QUIET_SHARE < load.pixels * u64::from(self.per_px);
        self.busy_ticks = if self.is_too_short(load) { self.busy_ticks + 1 } else { 0 };
        self.quiet_ticks = if is_quiet && self.busy_ticks == 0 { self.quiet_ticks + 1 } else { 0 };
        if self.busy_ticks >= BUSY_TICKS {
            *self = QueueLength::of((2 * self.per_px).min(most_per_px.max(self.per_px)));
        } else if self.quiet_ticks >= QUIET_TICKS {
            *self = QueueLength::of((self.per_px / 2).max(QUEUE_PER_PX));
        }
    }

    /// Whether a queue of twice the length would have cost less than running sub-tiles again. Shared memory grows with
    /// the length, and what a queue costs grows faster.
    fn is_too_short(self, load: Load) -> bool {
        let times_first = u64::from(self.per_px / QUEUE_PER_PX);
        let longer = load.sub_tiles * times_first.pow(3) / SUB_TILES_PER_WALK;
        load.overflows > 0 && RERUN_WALKS + OVERFLOW_WALKS * load.overflows > longer
    }
}

/// Fewest workgroups of a second run. One without work costs next to nothing.
const LEAST_SECOND_RUN: u32 = 64;

/// The second run of `cross` in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SecondRun {
    groups: u32,
    busy_ticks: u32,
    quiet_ticks: u32,
}

impl SecondRun {
    /// Sub-tiles of a camera that it has room for; 0 if a tick has none.
    pub(super) fn groups(self) -> u32 {
        self.groups
    }

    /// Adapts it after a tick in which no camera had more than `most` sub-tiles for it. `length_changes`: whether queues
    /// have another length in the next tick.
    pub(super) fn follow(&mut self, load: Load, most: u32, length_changes: bool) {
        // Another length may spare it.
        self.busy_ticks = if most > 0 && !length_changes { self.busy_ticks + 1 } else { 0 };
        self.quiet_ticks = if most == 0 { self.quiet_ticks + 1 } else { 0 };
        if self.quiet_ticks >= QUIET_TICKS || 2 * load.overflows > load.sub_tiles {
            // What it spares does not grow with the sub-tiles.
            *self = SecondRun::default();
        } else if self.busy_ticks >= BUSY_TICKS && most > self.groups {
            // Intervals are not alike: twice as many.
            self.groups = (2 * most).next_power_of_two().clamp(LEAST_SECOND_RUN, MOST_GROUPS);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOST: u32 = 32;

    #[test]
    fn a_second_run_follows_crowds_that_last_and_ends_with_them() {
        let mut second = SecondRun::default();
        let mut after = |most: u32, changes| {
            second.follow(load(2, most.into()), most, changes);
            second.groups()
        };
        assert_eq!([after(9, false), after(0, false), after(9, false)], [0; 3], "one tick is no reason");
        assert_eq!(after(9, true), 0, "queues grow");
        assert_eq!([after(9, false), after(9, false), after(70, false), after(9, false)], [0, 64, 256, 256]);
        for _ in 1..QUIET_TICKS {
            assert_eq!(after(0, false), 256);
        }
        assert_eq!([after(0, false), after(9, false)], [0, 0]);
        assert_eq!(
            [after(9, false), after(3600, false), after(3601, false)],
            [64, 8192, 0],
            "most sub-tiles"
        );
    }

    #[test]
    fn a_second_run_has_no_more_workgroups_than_every_device_takes() {
        let mut second = SecondRun::default();
        let large = Load { sub_tiles: 250_000, ..load(2, 40_000) };
        for _ in 0..BUSY_TICKS {
            second.follow(large, 40_000, false);
        }
        assert_eq!(second.groups(), MOST_GROUPS);
    }

    /// An image of 1280x720 pixels.
    fn load(events_per_px: u64, overflows: u64) -> Load {
        Load { pixels: 921_600, sub_tiles: 7200, events: events_per_px * 921_600, overflows, left: 0 }
    }

    /// The lengths after each of `ticks` ticks.
    fn lengths(load: Load, ticks: usize) -> Vec<u32> {
        let mut length = QueueLength::default();
        let mut after = || {
            length.follow(load, MOST);
            length.per_px()
        };
        (0..ticks).map(|_| after()).collect()
    }

    #[test]
    fn queues_grow_with_overflows_up_to_the_limit() {
        assert_eq!(lengths(load(20, 7000), 6), [8, 16, 16, 32, 32, 32]);
    }

    #[test]
    fn a_longer_queue_must_be_worth_what_it_costs() {
        // A seventh of the sub-tiles: worth twice the length, but not four times.
        assert_eq!(lengths(load(5, 1000), 6), [8, 16, 16, 16, 16, 16]);
        assert_eq!(lengths(load(2, 300), 4), [8; 4]);
        // In a small image the second run itself costs most.
        let small = Load { pixels: 43_200, sub_tiles: 338, events: 100_000, overflows: 1, left: 0 };
        assert_eq!(lengths(small, 4), [8, 16, 16, 16]);
    }

    #[test]
    fn one_busy_tick_is_no_reason_to_grow() {
        let mut length = QueueLength::default();
        for overflows in [7000, 0, 7000, 0] {
            length.follow(load(5, overflows), MOST);
            assert_eq!(length.per_px(), QUEUE_PER_PX);
        }
    }

    #[test]
    fn queues_shrink_after_a_quiet_time_that_nothing_interrupts() {
        let mut length = QueueLength::of(2 * QUEUE_PER_PX);
        for events_per_px in [1, 2] {
            for _ in 1..QUIET_TICKS {
                length.follow(load(1, 0), MOST);
            }
            assert_eq!(length.per_px(), 2 * QUEUE_PER_PX);
            length.follow(load(3 - events_per_px, 0), MOST);
        }
        assert_eq!(length, QueueLength::default());
    }

    #[test]
    fn a_tick_without_cameras_is_no_reason_to_grow() {
        let mut length = QueueLength::default();
        length.follow(Load::default(), MOST);
        assert_eq!(length, QueueLength::default());
    }
}
