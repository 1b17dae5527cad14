//! Which layers may show in a block during an interval, and which of them hides which.

use super::super::trajectory::outside_px;
use super::layer::{Layer, Vectors};
use esaac_model::synthesis::layers::pairs::{Pairs, Place};
use esaac_model::synthesis::layers::{
    BELONG_PX, BELONG_SHARE, BLOCK_LAYERS, BLOCK_PX, LEAST_VOTES, MERGE_PX, OUTSIDE_PX,
};
use glam::DVec2;

/// The layers of a block.
#[derive(Clone, Debug, Default)]
pub struct Block {
    /// From near to far.
    pub layers: Vec<Layer>,
    /// The longest vector of the pairs that pass it, pixels.
    pub motion_px: f64,
}

/// Which of some expected vectors a vector is.
#[must_use]
pub fn owner(vector: DVec2, expected: impl Iterator<Item = DVec2>) -> Option<usize> {
    let mut best = None;
    for (k, expected) in expected.enumerate() {
        let apart = vector.distance(expected);
        let belongs = apart <= BELONG_PX + BELONG_SHARE * expected.length();
        if belongs && best.is_none_or(|(least, _)| apart < least) {
            best = Some((apart, k));
        }
    }
    best.map(|(_, k)| k)
}

fn centre((bx, by): Place) -> DVec2 {
    DVec2::new((bx * BLOCK_PX) as f64, (by * BLOCK_PX) as f64) + 0.5 * (BLOCK_PX - 1) as f64
}

/// The pairs of a frame's blocks.
#[must_use]
pub fn pairs_of(end: &Vectors<'_>) -> Pairs {
    Pairs::new(end.size, |x, y| end.at(x as i64, y as i64))
}

/// Layers of every block, row by row. `start` are the vectors of the frame at the interval's start and the length of the
/// interval before over that of this one.
#[must_use]
pub fn blocks(end: &Vectors<'_>, start: Option<(&Vectors<'_>, f64)>) -> Vec<Block> {
    let pairs = pairs_of(end);
    let (blocks_x, blocks_y) = pairs.blocks();
    (0..blocks_x * blocks_y)
        .map(|i| {
            let (bx, by) = (i % blocks_x, i / blocks_x);
            let (mut pixels, motion_px) = pairs.passing((bx, by));
            if pixels.is_empty() {
                return Block::default();
            }
            if !pairs.meet_in((bx, by)) {
                let middle = |b: usize, size: usize| (b * BLOCK_PX + BLOCK_PX / 2).min(size - 1);
                pixels.insert(0, (middle(bx, end.size.0), middle(by, end.size.1)));
            }
            let mut layers: Vec<Layer> = Vec::new();
            for layer in pixels.into_iter().filter_map(|pixel| Layer::new(end, start, pixel)) {
                let at_centre = |layer: &Layer| layer.motion_at(centre((bx, by)));
                let is_new = layers.iter().all(|l| at_centre(l).distance(at_centre(&layer)) >= MERGE_PX);
                if is_new && layers.len() < BLOCK_LAYERS {
                    layers.push(layer);
                }
            }
            let votes = start.map(|(start, _)| votes(end, start, (bx, by), &layers)).unwrap_or_default();
            Block { layers: from_near_to_far(&layers, centre((bx, by)), &votes), motion_px }
        })
        .collect()
}

/// How many pixels say that one layer hides another, for each pair of them.
fn votes(end: &Vectors<'_>, start: &Vectors<'_>, (bx, by): Place, layers: &[Layer]) -> Vec<Vec<u32>> {
    let mut votes = vec![vec![0; layers.len()]; layers.len()];
    let around =
        |b: usize, size: usize| (b * BLOCK_PX).saturating_sub(BLOCK_PX)..((b + 2) * BLOCK_PX).min(size);
    for y in around(by, end.size.1) {
        for x in around(bx, end.size.0) {
            if let Some((front, hidden)) = vote(end, start, (x, y), layers) {
                votes[front][hidden] += 1;
            }
        }
    }
    votes
}

/// Which layer hid which where the point that a pixel shows was at the start.
fn vote(end: &Vectors<'_>, start: &Vectors<'_>, (x, y): Place, layers: &[Layer]) -> Option<(usize, usize)> {
    let in_end = |vector, at: DVec2| owner(vector, layers.iter().map(|layer| layer.motion_at(at)));
    let at = DVec2::new(x as f64, y as f64);
    let vector = end.at(x as i64, y as i64)?;
    let hidden = in_end(vector, at)?;
    let there = at + vector;
    if outside_px(end.size, there.to_array()) > OUTSIDE_PX {
        return None;
    }
    let (pixel, shown) = start.nearest(there)?;
    let front = owner(shown, layers.iter().map(|layer| layer.before_at(pixel)))?;
    let (now, shown) = end.nearest(layers[front].sources(pixel, 0.0)[1])?;
    (front != hidden && in_end(shown, now) == Some(front)).then_some((front, hidden))
}

/// Sorts layers by how many others are nearer.
fn from_near_to_far(layers: &[Layer], centre: DVec2, votes: &[Vec<u32>]) -> Vec<Layer> {
    let speed = |k: usize| layers[k].motion_at(centre).length();
    let hides = |a: usize, b: usize| !votes.is_empty() && votes[a][b] >= LEAST_VOTES + 2 * votes[b][a];
    let is_nearer = |a: usize, b: usize| {
        if hides(a, b) == hides(b, a) {
            speed(a) > speed(b) || (speed(a) == speed(b) && a < b)
        } else {
            hides(a, b)
        }
    };
    let rank = |k: usize| (0..layers.len()).filter(|&j| j != k && is_nearer(j, k)).count();
    let mut ranked: Vec<Place> = (0..layers.len()).map(|k| (rank(k), k)).collect();
    ranked.sort_unstable();
    ranked.into_iter().map(|(_, k)| layers[k]).collect()
}
