//! Whether the events of a rig are so dense that `cross` synthesises all levels of a pixel before it walks.
//!
//! A pixel that has an event makes the others of its subgroup wait. Where nearly every sub-step of a subgroup has one, it
//! pays to let each pixel walk at its own pace, for which its levels must be at hand. Where a rig has few pixels, a device
//! waits for memory more than it computes, and it takes more events until it pays.
//!
//! It also pays where few events are crowded: a kernel that has levels empties a full queue and goes on, while the other one
//! leaves such sub-tiles to another submission, which finds out anew what their pixels show. Packets do not depend on it.

use super::queue::Load;
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

/// One sub-tile in so many, left to another submission, makes a rig dense too.
const LEFT_SHARE: u64 = 32;

/// So does any sub-tile that is left in so many ticks in a row. Where a second run in the same submission could take it, that
/// has begun by then.
const LEFT_TICKS: u32 = 4;

/// A rig that has left sub-tiles and became dense for it does so again at once, once it is no longer dense and leaves another.
/// After so many ticks in a row that leave none it is as any other.
const FORGETS_TICKS: u32 = 30;

/// Such a rig is no longer dense once it has a quarter less events than it had then: what would be left is not seen in a
/// dense one.
const STILL_CROWDED: [u64; 2] = [3, 4];

/// Ticks in a row that change it.
const TICKS: u32 = 2;

/// Parts of an event a pixel, in which a bound is kept.
const PARTS: u64 = 1024;

/// Events that the queue of `cross` has room for in a dense rig, for each pixel of a sub-tile. A sub-tile that has more goes on
/// once the queue is empty, so a short queue will do, and more workgroups run at once; where there are not so many, a long
/// queue is emptied less often.
pub(super) fn dense_queue_per_px(pixels_of_rig: u64) -> u32 {
    if pixels_of_rig < MANY_PIXELS { CROWDED_QUEUE_PER_PX } else { QUEUE_PER_PX }
}

/// What past ticks say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Density {
    /// Of a dense rig: the events a pixel and tick, in [`PARTS`], below which it no longer is.
    sparse_below: Option<u64>,
    /// Ticks in a row with enough or few enough events for a change.
    ticks: u32,
    /// Ticks in a row that left a sub-tile, of a rig that is not dense.
    left_ticks: u32,
    /// Whether it has been dense for what it left.
    has_left: bool,
    /// Ticks in a row that left none, of a rig that is not dense.
    clear_ticks: u32,
}

impl Density {
    /// Whether levels are synthesised first in the next tick.
    pub(super) fn levels_first(self, policy: LevelsFirst) -> bool {
        match policy {
            LevelsFirst::Never => false,
            LevelsFirst::WherePaid => self.sparse_below.is_some(),
            LevelsFirst::Always => true,
        }
    }

    /// Adapts after a tick.
    pub(super) fn follow(&mut self, load: Load) {
        let Load { events, pixels, .. } = load;
        let [dense, sparse] =
            if pixels < MANY_PIXELS { [DENSE_OF_FEW, SPARSE_OF_FEW] } else { [DENSE, SPARSE] };
        let changes = match self.sparse_below {
            Some(least) => PARTS * events < least * pixels,
            None => events >= dense * pixels || load.left * LEFT_SHARE > load.sub_tiles,
        };
        self.ticks = if changes { self.ticks + 1 } else { 0 };
        let leaves = self.sparse_below.is_none() && load.left > 0;
        self.left_ticks = if leaves { self.left_ticks + 1 } else { 0 };
        self.clear_ticks = if leaves || self.sparse_below.is_some() { 0 } else { self.clear_ticks + 1 };
        self.has_left &= self.clear_ticks < FORGETS_TICKS;
        let is_left = self.left_ticks >= if self.has_left { 1 } else { LEFT_TICKS };
        if self.ticks == TICKS || is_left {
            let [share, of] = STILL_CROWDED;
            let sparse_below = (PARTS * events * share / (of * pixels.max(1))).min(PARTS * sparse);
            let sparse_below = self.sparse_below.is_none().then_some(sparse_below);
            *self = Density { sparse_below, has_left: self.has_left || is_left, ..Density::default() };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether levels come first after each of some ticks with so many events, in hundreds of thousands.
    fn after<const N: usize>(density: &mut Density, pixels: u64, events: [u64; N]) -> [bool; N] {
        events.map(|events| {
            density.follow(Load { events: events * 100_000, pixels, sub_tiles: 1000, ..Load::default() });
            density.levels_first(LevelsFirst::WherePaid)
        })
    }

    /// The same for small rigs after ticks with so many hundreds of events and sub-tiles that are left.
    fn after_leaving<const N: usize>(
        density: &mut Density,
        sub_tiles: u64,
        ticks: [(u64, u64); N],
    ) -> [bool; N] {
        ticks.map(|(hundreds, left)| {
            let load = Load { pixels: 1000, sub_tiles, events: 100 * hundreds, left, ..Load::default() };
            density.follow(load);
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
    fn a_rig_in_which_sub_tiles_are_left_is_dense_until_it_has_a_quarter_less_events() {
        let mut density = Density::default();
        let mut after = |ticks| after_leaving(&mut density, 64, ticks);
        assert_eq!(after([(40, 3), (40, 2), (40, 0), (40, 3)]), [false; 4]);
        assert_eq!(after([(40, 3), (31, 0), (29, 0), (31, 0)]), [true; 4], "two ticks in a row");
        assert_eq!(after([(29, 0), (29, 0), (40, 64), (40, 64)]), [true, false, false, true]);
    }

    #[test]
    fn a_rig_that_leaves_any_sub_tile_four_times_in_a_row_is_dense() {
        let mut density = Density::default();
        let seldom = [1, 1, 1, 0, 1, 1, 1].map(|left| (4, left));
        assert_eq!(after_leaving(&mut density, 640, seldom), [false; 7]);
        let mut after =
            |ticks: [u64; 4]| after_leaving(&mut density, 640, ticks.map(|hundreds| (hundreds, 1)));
        assert_eq!(
            after([4; 4]),
            [true; 4],
            "four ticks in a row, and what a dense rig leaves does not count"
        );
        assert_eq!(after([4; 4]), [true; 4]);
        assert_eq!(after([4, 4, 2, 2]), [true, true, true, false], "until it has a quarter less events");
        assert_eq!(after([2; 4]), [true; 4], "and at once where it leaves one again");
        assert_eq!(after([1; 4]), [true, false, true, true]);
        const CLEAR: usize = FORGETS_TICKS as usize + TICKS as usize;
        assert!(!after_leaving(&mut density, 640, [(0, 0); CLEAR])[CLEAR - 1]);
        let leaving = after_leaving(&mut density, 640, [(1, 1); 4]);
        assert_eq!(leaving, [false, false, false, true], "long after it is as any other");
    }

    #[test]
    fn a_small_rig_has_long_queues() {
        assert_eq!(
            [MANY_PIXELS - 1, MANY_PIXELS].map(dense_queue_per_px),
            [CROWDED_QUEUE_PER_PX, QUEUE_PER_PX]
        );
    }
}
