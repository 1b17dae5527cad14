//! Whether the events of a rig are so dense that `cross` synthesises all levels of a pixel before it walks.
//!
//! A pixel that has an event makes the others of its subgroup wait. Where nearly every sub-step of a subgroup has one, it
//! pays to let each pixel walk at its own pace, for which its levels must be at hand. Where a rig has few pixels, a device
//! waits for memory more than it computes, and it takes more events until it pays. Packets do not depend on it.

use crate::policy::LevelsFirst;
use esaac_layout::{CROWDED_QUEUE_PER_PX, QUEUE_PER_PX};

/// Events a pixel and tick from which on a rig is dense, and below which it no longer is.
const DENSE: u64 = 2;
const SPARSE: u64 = 1;

/// The same for a rig with fewer than [`MANY_PIXELS`].
const DENSE_OF_FEW: u64 = 8;
const SPARSE_OF_FEW: u64 = 6;

/// Pixels of a rig that fill a device.
const MANY_PIXELS: u64 = 200_000;

/// Ticks in a row that change it.
const TICKS: u32 = 2;

/// Events that the queue of `cross` has room for in a dense rig, for each pixel of a sub-tile. A sub-tile that has more goes on
/// once the queue is empty, so a short queue will do, and more workgroups run at once; where there are not so many, a long
/// queue is emptied less often.
pub(super) fn dense_queue_per_px(pixels_of_rig: u64) -> u32 {
    if pixels_of_rig < MANY_PIXELS { CROWDED_QUEUE_PER_PX } else { QUEUE_PER_PX }
}

/// What past ticks say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Density {
    is_dense: bool,
    ticks: u32,
}

impl Density {
    /// Whether levels are synthesised first in the next tick.
    pub(super) fn levels_first(self, policy: LevelsFirst) -> bool {
        match policy {
            LevelsFirst::Never => false,
            LevelsFirst::WherePaid => self.is_dense,
            LevelsFirst::Always => true,
        }
    }

    /// Adapts after a tick in which cameras of so many pixels had so many events.
    pub(super) fn follow(&mut self, events: u64, pixels: u64) {
        let [dense, sparse] =
            if pixels < MANY_PIXELS { [DENSE_OF_FEW, SPARSE_OF_FEW] } else { [DENSE, SPARSE] };
        let changes = if self.is_dense { events < sparse * pixels } else { events >= dense * pixels };
        self.ticks = if changes { self.ticks + 1 } else { 0 };
        if self.ticks == TICKS {
            *self = Density { is_dense: !self.is_dense, ticks: 0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether levels come first after each of some ticks with so many events, in hundreds of thousands.
    fn after<const N: usize>(density: &mut Density, pixels: u64, events: [u64; N]) -> [bool; N] {
        events.map(|events| {
            density.follow(events * 100_000, pixels);
            density.levels_first(LevelsFirst::WherePaid)
        })
    }

    #[test]
    fn a_rig_is_dense_after_two_dense_ticks_and_until_two_sparse_ones() {
        let mut density = Density::default();
        assert_eq!(after(&mut density, MANY_PIXELS, [4, 3, 4, 4]), [false, false, false, true]);
        assert_eq!(after(&mut density, MANY_PIXELS, [1, 2, 1, 1]), [true, true, true, false]);
    }

    #[test]
    fn a_rig_of_few_pixels_takes_more_events_and_the_policy_decides() {
        let mut density = Density::default();
        assert_eq!(after(&mut density, MANY_PIXELS / 2, [7, 7, 8, 8]), [false, false, false, true]);
        assert_eq!(after(&mut density, MANY_PIXELS / 2, [6, 5, 5]), [true, true, false]);
        assert!(density.levels_first(LevelsFirst::Always));
        assert_eq!(after(&mut density, MANY_PIXELS, [9, 9]), [false, true]);
        assert!(!density.levels_first(LevelsFirst::Never));
        assert_eq!(after(&mut density, 0, [0, 0]), [true, true], "no cameras");
    }

    #[test]
    fn a_small_rig_has_long_queues() {
        assert_eq!(
            [MANY_PIXELS - 1, MANY_PIXELS].map(dense_queue_per_px),
            [CROWDED_QUEUE_PER_PX, QUEUE_PER_PX]
        );
    }
}
