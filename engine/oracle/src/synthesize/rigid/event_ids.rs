//! Stage `event_ids`: which instance an event shows.

use super::Rigid;
use super::candidates::{Candidate, Instant, Surface};
use esaac_model::Packet;
use esaac_model::synthesis::rigid::{BLOCK_PX, EVENT_ID_WEIGHT};
use glam::DVec3;

impl Rigid<'_> {
    /// The instance that pixel `(x, y)` shows at an instant. `None` if no path tells it.
    #[must_use]
    pub fn instance_at(&self, instant: &Instant, x: usize, y: usize) -> Option<u32> {
        let size = self.keys[0].surfaces.size;
        let pixel = y * size.0 + x;
        let ray = self.keys[0].surfaces.ray(pixel)?;
        let own: Vec<&Candidate> = self.candidates[pixel].iter().filter(|c| c.is_own).collect();
        if own.is_empty() {
            return None;
        }
        let of_block = &self.listed[y / BLOCK_PX * size.0.div_ceil(BLOCK_PX) + x / BLOCK_PX];
        if let ([alone], []) = (&own[..], &of_block[..]) {
            return Some(alone.start.id);
        }
        // The inverse depth of each candidate that has a path, and whether it is there.
        let here: Vec<(f64, bool, u32)> = own
            .into_iter()
            .map(|candidate| candidate.at(instant.fraction))
            .chain(of_block.iter().copied())
            .filter_map(|surface| {
                let inverse_depth = surface.inverse_depth(instant, ray)?;
                Some((inverse_depth, self.is_there(instant, &surface, ray)?, surface.id))
            })
            .collect();
        let nearest = here.iter().filter(|(_, there, _)| *there).max_by(|a, b| a.0.total_cmp(&b.0));
        let farthest = here.iter().min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.or(farthest).map(|&(_, _, id)| id)
    }

    /// Whether a key frame shows that a surface is there along a ray. `None` if it has no path.
    fn is_there(&self, instant: &Instant, surface: &Surface, ray: DVec3) -> Option<bool> {
        let sources = surface.sources(self.scene.lens(), instant, ray)?;
        let belonging = |key: usize| self.keys[key].belonging(sources[key], &self.seen(surface, key));
        Some((0..2).any(|key| belonging(key) > EVENT_ID_WEIGHT))
    }

    /// The instance of each event of a packet, -1 where no path tells it. Stamps outside the interval count as its ends.
    #[must_use]
    pub fn event_ids(&self, packet: &Packet) -> Vec<i64> {
        let [start_ns, end_ns] = self.times_ns;
        let fraction = |t_ns: i64| (t_ns - start_ns) as f64 / (end_ns - start_ns) as f64;
        packet
            .iter()
            .map(|event| {
                let instant = self.instant(fraction(event.t_ns.clamp(start_ns, end_ns)));
                self.instance_at(&instant, event.x.into(), event.y.into()).map_or(-1, i64::from)
            })
            .collect()
    }
}
