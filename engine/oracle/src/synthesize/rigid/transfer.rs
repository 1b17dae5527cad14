//! Temporal detail transfer along exact paths: a half-pel frame takes detail from that of the other key frame.

use super::candidates::Interval;
use super::read::{KeyFrame, Seen, parent, parents, pixel_sample, sample_position};
use super::surface::moved_plane;
use crate::synthesize::half_pel::HalfPelFrame;

/// For each half-pel sample of a key frame: where it lies in the other one, if that shows its surface there.
pub struct Route {
    /// Position in the other key frame, and confidence in what is read there.
    samples: Vec<Option<Step>>,
}

#[derive(Clone, Copy)]
struct Step {
    at: glam::DVec2,
    surface: Seen,
    inside: f64,
}

impl Route {
    /// The route of key frame `key` (0 or 1) to the other.
    #[must_use]
    pub fn new(
        interval: &Interval<'_>,
        keys: &[KeyFrame; 2],
        key: usize,
        parallax_px_m: &dyn Fn(u32) -> f64,
    ) -> Self {
        let (own, other) = (&keys[key], &keys[1 - key]);
        let size = own.surfaces.size;
        let step = |sample: usize| {
            if !own.joined[sample] {
                return None;
            }
            let element = own.surfaces.element(parent(size, sample)).ok()?;
            let motion = interval.to_other(element.id, key)?;
            let ray = interval.lens.ray(sample_position(size, sample))?;
            let moved = motion.apply(ray.extend(element.plane.dot(ray)));
            let at = interval.lens.project(moved)?.pixel_px;
            let inside = 1.0 - other.outside_px(at);
            let plane = moved_plane(element.plane, &motion)?;
            let surface = Seen { id: element.id, plane, parallax_px_m: parallax_px_m(element.id) };
            // The later frame's mixtures are of another background.
            let usable = inside > 0.0 && (key == 1 || other.is_pure_at(at));
            usable.then_some(Step { at, surface, inside })
        };
        Route { samples: (0..4 * size.0 * size.1).map(step).collect() }
    }
}

/// The half-pel frame `alone` of `own` with the detail of `other_half_pel`, that of `other`.
#[must_use]
pub fn transfer(
    own: &KeyFrame,
    alone: &HalfPelFrame,
    other: &KeyFrame,
    other_half_pel: &HalfPelFrame,
    route: &Route,
) -> HalfPelFrame {
    let size = own.surfaces.size;
    let alone_samples = alone.samples();
    // What the other frame says at each sample, and the confidence in it.
    let told: Vec<Option<(f64, f64)>> = route
        .samples
        .iter()
        .enumerate()
        .map(|(sample, step)| {
            let step = step.as_ref()?;
            let pixel = parent(size, sample);
            let reader = [pixel % size.0, pixel / size.0];
            Some((other.half_pel_level(other_half_pel, reader, step.at, &step.surface)?, step.inside))
        })
        .collect();
    let samples = (0..alone_samples.len())
        .map(|sample| {
            let own = alone_samples[sample];
            let Some((level, mut confidence)) = told[sample] else { return own };
            if sample == pixel_sample(size, parent(size, sample)) {
                return own;
            }
            let (mut residual, mut count) = (0.0, 0.0);
            for pixel in parents(size, sample) {
                let anchor = pixel_sample(size, pixel);
                let Some((there, trust)) = told[anchor] else { return own };
                confidence = confidence.min(trust);
                residual += alone_samples[anchor] - there;
                count += 1.0;
            }
            confidence * (level + residual / count) + (1.0 - confidence) * own
        })
        .collect();
    alone.with_samples(samples)
}
