//! Where motions meet: the pair of each 8x8 block, and the blocks that it passes. The equations are in
//! [`layers`](super).

use super::{BLOCK_PX, MEET_PX, REACH_BLOCKS, REACH_PX};
use glam::DVec2;

/// Column and row of a pixel or a block.
pub type Place = (usize, usize);

/// The two neighbouring pixels of a block whose vectors differ most, with their vectors.
type Pair = [(Place, DVec2); 2];

/// Vectors are compared in these steps, pixels.
const STEPS_OF_A_PIXEL: f64 = 16.0;

/// The pairs of a frame's blocks.
pub struct Pairs {
    /// Columns and rows of blocks.
    blocks: (usize, usize),
    /// The pair of each block, row by row.
    of_blocks: Vec<Option<Pair>>,
}

impl Pairs {
    /// The pairs of a frame of `size` pixels. `vector(x, y)` is the motion vector of a pixel, pixels; `None` if it is not
    /// finite.
    pub fn new(size: (usize, usize), vector: impl Fn(usize, usize) -> Option<DVec2>) -> Self {
        let blocks = (size.0.div_ceil(BLOCK_PX), size.1.div_ceil(BLOCK_PX));
        let pair_of = |i: usize| pair(size, &vector, (i % blocks.0, i / blocks.0));
        Pairs { blocks, of_blocks: (0..blocks.0 * blocks.1).map(pair_of).collect() }
    }

    /// Columns and rows of blocks.
    #[must_use]
    pub fn blocks(&self) -> (usize, usize) {
        self.blocks
    }

    /// Whether motions meet in a block.
    #[must_use]
    pub fn meet_in(&self, block: Place) -> bool {
        self.of_blocks[self.number(block)].is_some()
    }

    /// Pixels of the pairs that pass a block, in the order in which they count, and the longest of their vectors, pixels.
    #[must_use]
    pub fn passing(&self, block: Place) -> (Vec<Place>, f64) {
        let mut passing: Vec<(usize, usize, Pair)> = self
            .around(block)
            .filter_map(|from| {
                let away = from.0.abs_diff(block.0).max(from.1.abs_diff(block.1));
                Some((away, self.number(from), self.pair_passing(from, block)?))
            })
            .collect();
        passing.sort_unstable_by_key(|&(away, number, _)| (away, number));
        let pixels = passing.iter().flat_map(|(.., pair)| pair.map(|(pixel, _)| pixel)).collect();
        let lengths = passing.iter().flat_map(|(.., pair)| pair.map(|(_, motion)| motion.length()));
        (pixels, lengths.fold(0.0, f64::max))
    }

    /// Blocks that pairs pass.
    #[must_use]
    pub fn meeting_blocks(&self) -> u64 {
        let all = (0..self.of_blocks.len()).map(|i| (i % self.blocks.0, i / self.blocks.0));
        all.filter(|&to| self.around(to).any(|from| self.pair_passing(from, to).is_some())).count() as u64
    }

    /// A block's number, row by row.
    fn number(&self, (bx, by): Place) -> usize {
        by * self.blocks.0 + bx
    }

    /// The pair of block `from`, if it passes block `to`.
    fn pair_passing(&self, from: Place, to: Place) -> Option<Pair> {
        let pair = self.of_blocks[self.number(from)]?;
        pair.iter().any(|&(_, motion)| passes(from, motion, to)).then_some(pair)
    }

    /// Blocks at most [`REACH_BLOCKS`] away, row by row.
    fn around(&self, (bx, by): Place) -> impl Iterator<Item = Place> + use<> {
        let near =
            |b: usize, blocks: usize| b.saturating_sub(REACH_BLOCKS)..(b + REACH_BLOCKS + 1).min(blocks);
        let (columns, rows) = (near(bx, self.blocks.0), near(by, self.blocks.1));
        rows.flat_map(move |y| columns.clone().map(move |x| (x, y)))
    }
}

/// The pair of a block, if motions meet there.
fn pair(
    (width, height): (usize, usize),
    vector: &impl Fn(usize, usize) -> Option<DVec2>,
    (bx, by): Place,
) -> Option<Pair> {
    let mut best: Option<(f64, Pair)> = None;
    for y in by * BLOCK_PX..((by + 1) * BLOCK_PX).min(height) {
        for x in bx * BLOCK_PX..((bx + 1) * BLOCK_PX).min(width) {
            let Some(own) = vector(x, y) else { continue };
            for other in [(x + 1, y), (x, y + 1)].into_iter().filter(|&(x, y)| x < width && y < height) {
                let Some(beside) = vector(other.0, other.1) else { continue };
                let apart =
                    ((own - beside).abs().max_element() * STEPS_OF_A_PIXEL).floor() / STEPS_OF_A_PIXEL;
                if apart > MEET_PX && best.is_none_or(|(most, _)| apart > most) {
                    best = Some((apart, [((x, y), own), (other, beside)]));
                }
            }
        }
    }
    best.map(|(_, pair)| pair)
}

/// Whether what moves by `motion` from block `from` passes block `to`.
fn passes(from: Place, motion: DVec2, to: Place) -> bool {
    let axis = |from: usize, motion: f64, to: usize| {
        let (first, goal) = ((from * BLOCK_PX) as f64, (to * BLOCK_PX) as f64);
        let side = (BLOCK_PX - 1) as f64;
        first + motion.min(0.0) - REACH_PX <= goal + side && first + side + motion.max(0.0) + REACH_PX >= goal
    };
    axis(from.0, motion.x, to.0) && axis(from.1, motion.y, to.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bar of two columns from `x` on that moves by `motion` before what stands still.
    fn bar(x: usize, motion: DVec2) -> Pairs {
        let vector = move |column: usize, _| Some(if column / 2 == x / 2 { motion } else { DVec2::ZERO });
        Pairs::new((80, 8), vector)
    }

    #[test]
    fn a_pair_passes_the_blocks_on_its_way() {
        let pairs = bar(34, DVec2::new(-20.0, 0.0));
        assert!(pairs.meet_in((4, 0)) && !pairs.meet_in((3, 0)));
        let passed: Vec<usize> = (0..10).filter(|&x| !pairs.passing((x, 0)).0.is_empty()).collect();
        assert_eq!(
            passed,
            [1, 2, 3, 4, 5],
            "from two pixels left of where it leads to, to two right of the block"
        );
        assert_eq!((pairs.meeting_blocks(), pairs.blocks()), (5, (10, 1)));
        assert_eq!(pairs.passing((1, 0)), (vec![(33, 0), (34, 0)], 20.0));
    }

    #[test]
    fn motions_that_differ_little_or_are_not_known_do_not_meet() {
        assert_eq!(bar(34, DVec2::new(3.0, 0.0)).meeting_blocks(), 0);
        assert_eq!(bar(34, DVec2::new(3.1, 0.0)).meeting_blocks(), 3, "its own and those beside");
        let unknown = Pairs::new((80, 8), |x, _| (x < 34).then_some(DVec2::new(9.0, 0.0)));
        assert_eq!(unknown.meeting_blocks(), 0);
    }
}
