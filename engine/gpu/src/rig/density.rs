//! Whether the events of a rig are so dense that `cross` synthesises all levels of a pixel before it walks.
//!
//! A pixel that has an event makes the others of its subgroup wait. Where nearly every sub-step of a subgroup has one, it
//! pays to let each pixel walk at its own pace, for which its levels must be at hand. It does not pay where a device waits
//! for memory more than it computes: in rigs of few pixels. Packets do not depend on it.

use crate::policy::LevelsFirst;

/// Events a pixel and tick from which on a rig is dense, and below which it no longer is.
const DENSE: u64 = 3;
const SPARSE: u64 = 2;

/// Fewest pixels of a tick that is dense.
const LEAST_PIXELS: u64 = 200_000;

/// Ticks in a row that change it.
const TICKS: u32 = 2;

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
        let is_dense = pixels >= LEAST_PIXELS && events >= DENSE * pixels;
        let is_sparse = pixels < LEAST_PIXELS || events < SPARSE * pixels;
        let changes = if self.is_dense { is_sparse } else { is_dense };
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
        assert_eq!(after(&mut density, LEAST_PIXELS, [6, 5, 6, 6]), [false, false, false, true]);
        assert_eq!(after(&mut density, LEAST_PIXELS, [3, 4, 3, 3]), [true, true, true, false]);
    }

    #[test]
    fn a_rig_of_few_pixels_is_not_dense_and_the_policy_decides() {
        let mut density = Density::default();
        assert_eq!(after(&mut density, LEAST_PIXELS - 1, [9, 9, 9]), [false; 3]);
        assert!(density.levels_first(LevelsFirst::Always));
        assert_eq!(after(&mut density, LEAST_PIXELS, [9, 9]), [false, true]);
        assert!(!density.levels_first(LevelsFirst::Never));
        assert_eq!(after(&mut density, 0, [0, 0]), [true, false]);
    }
}
