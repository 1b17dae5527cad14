//! How long the event queues of `cross` are.
//!
//! A sub-tile with more events than its queue holds runs again, and walks its pixels twice more. A longer queue spares
//! that, but it takes shared memory, so that fewer sub-tiles run at once. So queues are short until intervals overflow
//! them, and become short again after a time of few events. Packets do not depend on it.

use super::CameraState;
use super::machine::TickEnd;
use esaac_layout::{Counters, QUEUE_PER_PX};

/// Queues grow if more than one tile in this many overflows. Below that, running a few sub-tiles again costs less than
/// a longer queue for all.
const TILES_PER_OVERFLOW: u64 = 1024;

/// Queues shrink if for this many ticks each pixel has had, on average, less than one event in [`QUIET_SHARE`] of their
/// length.
const QUIET_TICKS: u32 = 100;

/// See [`QUIET_TICKS`].
const QUIET_SHARE: u64 = 8;

/// What a tick tells about the queues of its cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Load {
    pixels: u64,
    tiles: u64,
    events: u64,
    overflows: u64,
}

impl Load {
    /// The load of all cameras that took part in a tick.
    pub(super) fn of(cameras: &[CameraState], end: &TickEnd) -> Self {
        let mut load = Load { overflows: end.queue_overflows, ..Load::default() };
        for (camera, counters) in cameras.iter().zip(&end.counters) {
            let Some(Counters { emitted, .. }) = *counters else { continue };
            load.pixels += u64::from(camera.place.pixels);
            load.tiles += u64::from(camera.place.tiles);
            load.events += u64::from(emitted);
        }
        load
    }
}

/// The length of all queues of a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct QueueLength {
    per_px: u32,
    quiet_ticks: u32,
}

impl Default for QueueLength {
    fn default() -> Self {
        QueueLength { per_px: QUEUE_PER_PX, quiet_ticks: 0 }
    }
}

impl QueueLength {
    /// Events that a queue has room for, for each pixel of a sub-tile.
    pub(super) fn per_px(self) -> u32 {
        self.per_px
    }

    /// Adapts the length after a tick. `most_per_px` limits it.
    pub(super) fn follow(&mut self, load: Load, most_per_px: u32) {
        if load.overflows * TILES_PER_OVERFLOW > load.tiles {
            *self =
                QueueLength { per_px: (2 * self.per_px).min(most_per_px.max(self.per_px)), quiet_ticks: 0 };
            return;
        }
        let is_quiet = load.events * QUIET_SHARE < load.pixels * u64::from(self.per_px);
        self.quiet_ticks = if is_quiet { self.quiet_ticks + 1 } else { 0 };
        if self.quiet_ticks >= QUIET_TICKS {
            *self = QueueLength { per_px: (self.per_px / 2).max(QUEUE_PER_PX), quiet_ticks: 0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOST: u32 = 32;

    fn load(events_per_px: u64, overflows: u64) -> Load {
        Load { pixels: 10_000, tiles: 2048, events: events_per_px * 10_000, overflows }
    }

    #[test]
    fn queues_grow_with_overflows_up_to_the_limit() {
        let mut length = QueueLength::default();
        let mut seen = Vec::new();
        for _ in 0..4 {
            length.follow(load(20, 3), MOST);
            seen.push(length.per_px());
        }
        assert_eq!(seen, [16, 32, 32, 32]);
    }

    #[test]
    fn few_overflows_of_many_tiles_change_nothing() {
        let mut length = QueueLength::default();
        length.follow(load(5, 2), MOST);
        assert_eq!(length.per_px(), QUEUE_PER_PX);
        length.follow(load(5, 3), MOST);
        assert_eq!(length.per_px(), 2 * QUEUE_PER_PX);
    }

    #[test]
    fn queues_shrink_after_a_quiet_time_that_nothing_interrupts() {
        let mut length = QueueLength::default();
        length.follow(load(20, 3), MOST);
        for _ in 1..QUIET_TICKS {
            length.follow(load(1, 0), MOST);
        }
        length.follow(load(2, 0), MOST);
        for _ in 1..QUIET_TICKS {
            length.follow(load(1, 0), MOST);
        }
        assert_eq!(length.per_px(), 2 * QUEUE_PER_PX);
        length.follow(load(1, 0), MOST);
        assert_eq!(length, QueueLength::default());
    }

    #[test]
    fn a_tick_without_cameras_is_no_reason_to_grow() {
        let mut length = QueueLength::default();
        length.follow(Load::default(), MOST);
        assert_eq!(length, QueueLength::default());
    }
}
