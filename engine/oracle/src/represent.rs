//! Representations of a packet for machine learning: stages `event_frame` and `voxel_grid`.

use esaac_model::VOTE_FRACTION_BITS;
use esaac_model::{Packet, Polarity};

/// Number of OFF and of ON events of each pixel, `[2][row][column]`.
#[must_use]
pub fn event_frame(packet: &Packet) -> Vec<i32> {
    let pixels = (packet.width_px * packet.height_px) as usize;
    let mut counts = vec![0; 2 * pixels];
    for event in packet.iter() {
        let pixel = event.y as usize * packet.width_px as usize + event.x as usize;
        counts[event.polarity as usize * pixels + pixel] += 1;
    }
    counts
}

/// Voxel grid `[bin][row][column]` (Zhu et al., CVPR 2019, equations 1 to 3). The `bins` instants are evenly spaced
/// from `start_ns` to `end_ns`. Each event casts a vote of +1 (ON) or -1 (OFF), split linearly between the two instants
/// around it. Shares of votes are multiples of 2^-[`VOTE_FRACTION_BITS`].
#[must_use]
pub fn voxel_grid(packet: &Packet, bins: usize, start_ns: i64, end_ns: i64) -> Vec<f32> {
    let pixels = (packet.width_px * packet.height_px) as usize;
    let vote = f64::from(1_u32 << VOTE_FRACTION_BITS);
    let mut sums = vec![0.0_f64; bins * pixels];
    for event in packet.iter() {
        let since = (event.t_ns - start_ns).clamp(0, end_ns - start_ns) as f64;
        let place = since * (bins - 1) as f64 / (end_ns - start_ns) as f64;
        let bin = place.floor();
        let second = ((place - bin) * vote).floor() / vote;
        let sign = if event.polarity == Polarity::On { 1.0 } else { -1.0 };
        let voxel = bin as usize * pixels + event.y as usize * packet.width_px as usize + event.x as usize;
        sums[voxel] += sign * (1.0 - second);
        if second > 0.0 {
            sums[voxel + pixels] += sign * second;
        }
    }
    sums.into_iter().map(|sum| sum as f32).collect()
}
