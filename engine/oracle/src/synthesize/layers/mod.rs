//! Synthesis `motion` where motions meet: a pixel shows several surfaces between two frames, told apart by their motion
//! vectors (equations in [`esaac_model::synthesis::layers`]).

pub mod candidates;
pub mod layer;

use super::trajectory::outside_px;
use candidates::{Block, owner};
use esaac_model::synthesis::layers::{
    BACKGROUND_LOG, BLOCK_PX, MIXED_WEIGHT, MOST_STEPS, SLIGHT_WEIGHT, WHOLE_SHARE,
};
use esaac_model::synthesis::{EDGE_PX, EDGE_WEIGHT};
use glam::DVec2;
use layer::{Layer, Vectors, corners, largest, nearest_pixel, snapped};

#[cfg(test)]
mod tests;

/// The layers of an interval.
#[derive(Clone, Debug)]
pub struct Layers {
    size: (usize, usize),
    /// Vectors of the frames at the start and at the end.
    motion: [Vec<[f64; 2]>; 2],
    /// Whether vectors tell what the frame at the start shows.
    has_start: bool,
    blocks_x: usize,
    blocks: Vec<Block>,
    /// Layers of each pixel, from near to far, by their place in the block's list; none if it follows one surface.
    pixels: Vec<Vec<usize>>,
}

/// Levels of an intensity plane in both frames, nepers. Frame 0 is that at the start.
pub trait Levels {
    /// Between pixels.
    fn at(&self, frame: usize, position: DVec2) -> f64;
    /// At a pixel.
    fn pixel(&self, frame: usize, x: i64, y: i64) -> f64;
}

impl Layers {
    /// Finds the layers of an interval, in which pixels show at most `most`. The vectors and `ratio` are those of
    /// [`warps`](super::trajectory::warps).
    #[must_use]
    pub fn new(
        size: (usize, usize),
        motion: &[[f64; 2]],
        previous: Option<&[[f64; 2]]>,
        ratio: Option<f64>,
        most: u32,
    ) -> Self {
        let end = Vectors { size, motion };
        let start = previous.zip(ratio).map(|(motion, ratio)| (Vectors { size, motion }, ratio));
        let blocks = candidates::blocks(&end, start.as_ref().map(|(vectors, ratio)| (vectors, *ratio)));
        let mut layers = Layers {
            size,
            motion: [previous.map(<[_]>::to_vec).unwrap_or_default(), motion.to_vec()],
            has_start: start.is_some(),
            blocks_x: size.0.div_ceil(BLOCK_PX),
            blocks,
            pixels: Vec::new(),
        };
        layers.pixels = (0..size.0 * size.1).map(|pixel| layers.of_pixel(pixel, most as usize)).collect();
        layers
    }

    /// Whether a pixel is made of several layers.
    #[must_use]
    pub fn has(&self, pixel: usize) -> bool {
        !self.pixels[pixel].is_empty()
    }

    /// Motion of what passes each block, row by row, pixels.
    pub fn motion_px(&self) -> impl Iterator<Item = f64> {
        self.blocks.iter().map(|block| block.motion_px)
    }

    /// Layers of each block, row by row.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    fn block(&self, pixel: usize) -> &Block {
        let (x, y) = (pixel % self.size.0, pixel / self.size.0);
        &self.blocks[y / BLOCK_PX * self.blocks_x + x / BLOCK_PX]
    }

    fn position(&self, pixel: usize) -> DVec2 {
        DVec2::new((pixel % self.size.0) as f64, (pixel / self.size.0) as f64)
    }

    fn of_pixel(&self, pixel: usize, most: usize) -> Vec<usize> {
        let at = self.position(pixel);
        let all: Vec<&Layer> = self.block(pixel).layers.iter().collect();
        let apart =
            |a: &Layer| all.iter().map(|b| largest(a.motion_at(at) - b.motion_at(at))).fold(0.0, f64::max);
        let fastest = all.iter().map(|a| apart(a)).fold(0.0, f64::max);
        let steps = ((fastest - SLIGHT_WEIGHT).ceil() as usize).clamp(1, MOST_STEPS);
        let seen = |k: usize, step: usize| {
            let sources = all[k].sources(at, step as f64 / steps as f64);
            (0..2).any(|frame| {
                let nearest = nearest_pixel(sources[frame]);
                self.shown(&all, frame, nearest.x as i64, nearest.y as i64) == Some(k)
            })
        };
        let mut counts: Vec<(usize, usize)> = (0..all.len())
            .map(|k| ((0..=steps).filter(|&step| seen(k, step)).count(), k))
            .filter(|(count, _)| *count > 0)
            .collect();
        counts.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut kept: Vec<usize> = counts.into_iter().take(most).map(|(_, k)| k).collect();
        kept.sort_unstable();
        if kept.len() < 2 { Vec::new() } else { kept }
    }

    fn vectors(&self, frame: usize) -> Vectors<'_> {
        Vectors { size: self.size, motion: &self.motion[frame] }
    }

    /// Which of some layers, from near to far, a pixel of a frame shows. `None` if that is not known.
    fn shown(&self, layers: &[&Layer], frame: usize, x: i64, y: i64) -> Option<usize> {
        let at = DVec2::new(x as f64, y as f64);
        let farthest = layers.len() - 1;
        let in_end = |vector, at: DVec2| owner(vector, layers.iter().map(|layer| layer.motion_at(at)));
        if frame == 1 {
            return Some(in_end(self.vectors(1).at(x, y)?, at).unwrap_or(farthest));
        }
        if self.has_start {
            let expected = layers.iter().map(|layer| layer.before_at(at));
            return Some(owner(self.vectors(0).at(x, y)?, expected).unwrap_or(farthest));
        }
        let is_seen = |&k: &usize| {
            let [_, place] = layers[k].sources(at, 0.0);
            self.vectors(1).nearest(place).is_some_and(|(pixel, vector)| in_end(vector, pixel) == Some(k))
        };
        Some((0..layers.len()).find(is_seen).unwrap_or(farthest))
    }

    /// Level of a pixel of several layers at `fraction` of the interval, nepers. `None` if nothing is known.
    #[must_use]
    pub fn level(&self, levels: &dyn Levels, pixel: usize, fraction: f64) -> Option<f64> {
        let at = self.position(pixel);
        let block = self.block(pixel);
        let layers: Vec<&Layer> = self.pixels[pixel].iter().map(|&k| &block.layers[k]).collect();
        let mut light = None;
        for (k, layer) in layers.iter().enumerate().rev() {
            let views = [(0, 1.0 - fraction), (1, fraction)].map(|(frame, time)| {
                let place = snapped(layer.sources(at, fraction)[frame]);
                let edge = (1.0 - outside_px(self.size, place.to_array()) / EDGE_PX).max(EDGE_WEIGHT);
                self.view(levels, &layers, k, frame, place, time * edge)
            });
            if views.iter().any(|view| view.weight * (view.seen + view.fringe) > 0.0) {
                light = Some(over(layer, &views, light));
            }
        }
        light.map(f64::ln)
    }

    /// What a frame knows of a layer at a position.
    fn view(
        &self,
        levels: &dyn Levels,
        layers: &[&Layer],
        k: usize,
        frame: usize,
        place: DVec2,
        weight: f64,
    ) -> View {
        let as_shown = levels.at(frame, place);
        let mut view = View { weight, as_shown, ..View::default() };
        let (mut farther, mut behind, mut pure, mut all) = (0.0, 0.0, 0.0, 0.0);
        for ((x, y), weight) in corners(self.size, place) {
            if weight < SLIGHT_WEIGHT {
                continue;
            }
            all += weight;
            let own = levels.pixel(frame, x, y);
            let shown = self.shown(layers, frame, x, y);
            let nearest_around = self.nearest_around(layers, frame, (x, y));
            match shown {
                Some(owner) if owner == k => {
                    let is_mixed = nearest_around.is_some_and(|nearest| nearest < k);
                    let trust = weight * if is_mixed { MIXED_WEIGHT } else { 1.0 };
                    pure += if is_mixed { 0.0 } else { weight };
                    view.seen += weight;
                    view.trust += trust;
                    view.level += trust * own;
                }
                Some(owner) if owner > k => {
                    view.fringe += if nearest_around == Some(k) { weight } else { 0.0 };
                    farther += weight;
                    behind += weight * own;
                }
                _ => view.hidden += weight,
            }
        }
        if view.seen > 0.0 {
            let others = ((1.0 - pure / all) / WHOLE_SHARE).min(1.0);
            view.level = (1.0 - others) * as_shown + others * view.level / view.trust;
        }
        for share in [&mut view.seen, &mut view.fringe, &mut view.hidden, &mut view.trust] {
            *share /= all;
        }
        view.behind = (farther > 0.0).then(|| behind / farther);
        view
    }

    /// The nearest layer that the 3x3 pixels around one show.
    fn nearest_around(&self, layers: &[&Layer], frame: usize, (x, y): (i64, i64)) -> Option<usize> {
        let inside = |x, y| x >= 0 && y >= 0 && x < self.size.0 as i64 && y < self.size.1 as i64;
        (y - 1..=y + 1)
            .flat_map(|y| (x - 1..=x + 1).map(move |x| (x, y)))
            .filter(|&(x, y)| inside(x, y))
            .filter_map(|(x, y)| self.shown(layers, frame, x, y))
            .min()
    }
}

/// Light of a layer over that of the farther ones, `here`, if any shows.
fn over(layer: &Layer, views: &[View; 2], here: Option<f64>) -> f64 {
    let sum = |of: &dyn Fn(&View) -> f64| views.iter().map(|v| v.weight * of(v)).sum::<f64>();
    let open = sum(&|v| 1.0 - v.hidden);
    let mean = |of: &dyn Fn(&View) -> f64| sum(&|v| (1.0 - v.hidden) * of(v)) / open;
    let mixture = mean(&|v| v.as_shown).exp();
    let trust = sum(&|v| v.trust);
    let own = if trust > 0.0 { (sum(&|v| v.trust * v.level) / trust).exp() } else { mixture };
    let coverage = (sum(&|v| v.seen) / open).min(1.0);
    let Some(here) = here.filter(|_| coverage < 1.0 - SLIGHT_WEIGHT) else { return own };
    let there = mean(&|v| v.behind.map_or(here, f64::exp));
    let unlike = ((here / there).ln().abs() / BACKGROUND_LOG).min(1.0);
    let composite = coverage * own + (1.0 - coverage) * here;
    let strange = layer.thickness * unlike;
    let reach = (sum(&|v| v.seen + v.fringe) / open).min(1.0);
    reach * ((1.0 - strange) * mixture + strange * composite) + (1.0 - reach) * here
}

/// What a frame knows of a layer at a position.
#[derive(Clone, Copy, Debug, Default)]
struct View {
    /// How much it counts.
    weight: f64,
    /// Shares of the pixels around that show the layer, of those beside it, and of those that hide it.
    seen: f64,
    fringe: f64,
    hidden: f64,
    /// The layer's level, and how much it counts.
    level: f64,
    trust: f64,
    /// The level there, whatever it is of.
    as_shown: f64,
    /// That of farther layers.
    behind: Option<f64>,
}
