//! How an interval is cut into sub-steps, and how time stamps are quantised.
//!
//! Each block has a number of sub-steps of its own, of equal lengths ([`substep_count`]). By speed, a sub-step is half a
//! pixel of the largest motion around the block. That is finer than smooth texture needs, whose level hardly bends on its
//! way. So [`by_error`] the way is shorter, down to what the bend of the texture needs: along motion vectors
//! [`needed_motion_px`], along exact paths [`needed_on_way_px`].

use crate::{Intensity, SensorModel, SubstepPolicy, Synthesis, Taps};

/// Side of a block, pixels. The pixels of a block share one sub-step count and are skipped together.
pub const BLOCK_PX: u32 = 8;

/// Motion per sub-step that the adaptive policy aims at, pixels.
pub const SUBSTEP_MOTION_PX: f64 = 0.5;

/// Timing error per sub-step that the adaptive policy aims at where brightness changes, nanoseconds. A ramp of linear
/// intensity over an interval of length `T` in `n` sub-steps differs from its log-linear chord by at most
/// `T |dL| / (8 n^2)`.
pub const SUBSTEP_TIME_ERROR_NS: f64 = 50_000.0;

/// By error: how far the level may be off between two sub-steps whatever its slope, as a share of the smaller threshold.
pub const SUBSTEP_LEVEL_ERROR: f64 = 0.005;

/// Least motion of a block that moves, pixels: it is not still.
pub const LEAST_NEEDED_PX: f64 = 1e-12;

/// Sub-steps in a period of a lamp's flicker, at least. Between sub-steps log intensity is linear, so a peak is too low by
/// up to 8% of the flicker's depth.
pub const FLICKER_SUBSTEPS: u32 = 8;

/// Largest sub-step count.
pub const MAX_SUBSTEPS: u32 = 64;

/// Number of sub-steps of a block. `motion_px` is the largest finite motion vector of both frames in the 3x3 blocks
/// around it, or 0 for a synthesis without motion; or [`by_error`] the largest [`needed_motion_px`] of these blocks.
/// `change_log` is the largest `|L_k - L_{k-1}|` in the block itself; by error it counts only if the block has an invalid
/// vector in frame k, since what follows a vector is blended in the log, where a change does not bend. Along exact
/// paths both are as [`motion_on_way_px`] says.
/// A lamp's flicker needs [`least_substeps`] everywhere.
/// The caller gives [`Synthesis::None`] one sub-step in place of this.
#[must_use]
pub fn substep_count(sensor: &SensorModel, motion_px: f64, change_log: f64, interval_ns: f64) -> u32 {
    match sensor.substep_policy {
        SubstepPolicy::Fixed => sensor.substeps,
        SubstepPolicy::Adaptive => {
            let for_motion = (motion_px / SUBSTEP_MOTION_PX).ceil();
            let for_change = for_change(change_log, interval_ns).ceil();
            let least = least_substeps(sensor, interval_ns as u32);
            for_motion.max(for_change).clamp(f64::from(least), f64::from(sensor.substeps)) as u32
        }
    }
}

/// Whether sub-steps follow how far levels bend along their motion. The level between two frames must be the texture of
/// the frames: that of [`Synthesis::Motion`] or [`Synthesis::Rigid`], with taps that see as much as the bend. Along exact
/// paths a mosaic stays by speed: to find the bends of three planes costs more than the sub-steps that they save.
#[must_use]
pub fn by_error(sensor: &SensorModel) -> bool {
    sensor.substep_error_ns > 0
        && sensor.substep_policy == SubstepPolicy::Adaptive
        && match sensor.synthesis {
            Synthesis::Motion => true,
            Synthesis::Rigid => sensor.intensity != Intensity::BayerRggb,
            _ => false,
        }
        && sensor.taps == Taps::Cubic
}

/// What the pixels of a block of a frame show at most.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockActivity {
    /// Motion, pixels.
    pub motion_px: f64,
    /// Change since the frame before, nepers; 0 in a camera's first.
    pub change_log: f64,
    /// Bend along motion, nepers for the square of an interval.
    pub bend_log: f64,
    /// Slope along motion, nepers for an interval.
    pub slope_log: f64,
}

/// By error: motion of a block of a frame as its number of sub-steps needs it, pixels; at most what speed and change give
/// it, and 0 without motion. `interval_ns` is the length of the interval that ends at the frame, 0 if it is a camera's first.
///
/// Along its vector `m` the level of a pixel has a slope and bends, nepers for an interval and its square: with first and
/// second differences of the frame's log intensity around the pixel
/// ```text
/// slope = |L_x m_x + L_y m_y|        L_x = (L(x+1, y) - L(x-1, y)) / 2
/// bend  = |L_xx m_x^2 + 2 L_xy m_x m_y + L_yy m_y^2|
/// L_xx = L(x-1, y) - 2 L(x, y) + L(x+1, y)
/// L_xy = (L(x+1, y+1) - L(x-1, y+1) - L(x+1, y-1) + L(x-1, y-1)) / 4
/// ```
/// for pixels with a valid vector. Beyond the image the frame repeats its border. Under a mosaic the largest of all colours
/// count, since what a block shows may pass pixels of each. Of `n` sub-steps each is off by up to
/// `bend / (8 n^2)`. That may be what a slope passes in `substep_error_ns`, or [`SUBSTEP_LEVEL_ERROR`].
#[must_use]
pub fn needed_motion_px(sensor: &SensorModel, block: BlockActivity, interval_ns: u32) -> f64 {
    if block.motion_px == 0.0 {
        return 0.0;
    }
    let allowed_log = (block.slope_log * error_share(sensor, interval_ns)).max(level_error_log(sensor));
    let by_bend = (block.bend_log / (8.0 * allowed_log)).sqrt();
    let by_change = for_change(block.change_log, f64::from(interval_ns));
    let most_px = block.motion_px.max(SUBSTEP_MOTION_PX * by_change);
    (SUBSTEP_MOTION_PX * by_bend).max(LEAST_NEEDED_PX).min(most_px)
}

/// What a block of a frame shows at most, whichever way it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockTexture {
    /// Bend, nepers for the square of a pixel.
    pub bend_log_px2: f64,
    /// Slope, nepers a pixel.
    pub slope_log_px: f64,
}

impl BlockTexture {
    /// That of a pixel: the slope `|(L_x, L_y)|` and the larger eigenvalue, without its sign, of the second differences
    /// `L_xx`, `L_xy` and `L_yy` of [`needed_motion_px`].
    #[must_use]
    pub fn of_pixel([x, y]: [f64; 2], [xx, xy, yy]: [f64; 3]) -> Self {
        let bend_log_px2 = 0.5 * ((xx + yy).abs() + (xx - yy).hypot(2.0 * xy));
        BlockTexture { bend_log_px2, slope_log_px: x.hypot(y) }
    }

    /// The larger bend and the larger slope of two.
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        BlockTexture {
            bend_log_px2: self.bend_log_px2.max(other.bend_log_px2),
            slope_log_px: self.slope_log_px.max(other.slope_log_px),
        }
    }

    /// As kernels keep it: of each the upper half of the bits of an f32, cut off.
    #[must_use]
    pub fn kept(self) -> Self {
        let kept = |value: f64| f64::from(f32::from_bits((value as f32).to_bits() & 0xffff_0000));
        BlockTexture { bend_log_px2: kept(self.bend_log_px2), slope_log_px: kept(self.slope_log_px) }
    }
}

/// How what passes a block moves along exact paths, at most.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockWay {
    /// Length of the way in the interval, pixels.
    pub way_px: f64,
    /// Bend of the way: the largest second difference of places at three knots in a row, over the square of the time
    /// between two, pixels for the square of an interval.
    pub bend_px: f64,
}

/// By error along exact paths: motion as a block's number of sub-steps needs it for a texture that passes it, pixels.
///
/// A path may be bent and come back to where it began. So the texture counts by the length of the way `s`, in whichever
/// direction it bends most, and a bent way bends the level on a slope too: with the texture's bend `B` and slope `G` and
/// the way's bend `a`
/// ```text
/// bend  = B s^2 + G a
/// slope = G s
/// ```
/// Of `n` sub-steps each may be off as in [`needed_motion_px`].
#[must_use]
pub fn needed_on_way_px(sensor: &SensorModel, texture: BlockTexture, way: BlockWay, interval_ns: u32) -> f64 {
    let BlockTexture { bend_log_px2, slope_log_px } = texture;
    let bend_log = bend_log_px2 * way.way_px * way.way_px + slope_log_px * way.bend_px;
    let slope_log = slope_log_px * way.way_px;
    let allowed_log = (slope_log * error_share(sensor, interval_ns)).max(level_error_log(sensor));
    SUBSTEP_MOTION_PX * (bend_log / (8.0 * allowed_log)).sqrt()
}

/// Motion of a block along exact paths as its number of sub-steps needs it, pixels; 0 if nothing that passes it moves.
/// `needed_px` is the largest [`needed_on_way_px`] of the textures of the 3x3 blocks around it in both frames, as far as
/// they have no silhouette. `None` is by speed: for a block with a silhouette in either frame, or which a surface of such a
/// block passes. Motion is then the longest way, and a change counts. By error it does not count: along a path a level is
/// blended in the log. But a block needs at most what its way and `change_log` give it by speed.
#[must_use]
pub fn motion_on_way_px(way: BlockWay, needed_px: Option<f64>, change_log: f64, interval_ns: u32) -> f64 {
    let Some(needed_px) = needed_px.filter(|_| way.way_px > 0.0) else { return way.way_px };
    let most_px = way.way_px.max(SUBSTEP_MOTION_PX * for_change(change_log, f64::from(interval_ns)));
    needed_px.max(LEAST_NEEDED_PX).min(most_px)
}

/// Sub-steps of a change, not rounded; see [`SUBSTEP_TIME_ERROR_NS`].
fn for_change(change_log: f64, interval_ns: f64) -> f64 {
    (change_log * interval_ns / (8.0 * SUBSTEP_TIME_ERROR_NS)).sqrt()
}

/// The bound of a crossing's error as a share of the interval; 0 without one.
#[must_use]
pub fn error_share(sensor: &SensorModel, interval_ns: u32) -> f64 {
    if interval_ns == 0 { 0.0 } else { f64::from(sensor.substep_error_ns) / f64::from(interval_ns) }
}

/// See [`SUBSTEP_LEVEL_ERROR`]; nepers.
#[must_use]
pub fn level_error_log(sensor: &SensorModel) -> f64 {
    SUBSTEP_LEVEL_ERROR * sensor.contrast_on.min(sensor.contrast_off)
}

/// Sub-steps that the adaptive policy gives a block without motion and change: 1, or what a lamp's flicker needs, but no
/// more than the sensor's `substeps` ([`SensorModel::flicker_warning`] tells).
#[must_use]
pub fn least_substeps(sensor: &SensorModel, interval_ns: u32) -> u32 {
    sensor.flicker().map_or(1, |flicker| flicker.substeps(interval_ns).clamp(1, sensor.substeps))
}

/// Nanoseconds from the interval's start to the end of sub-step `i` of `n`: `floor(i T / n)`.
#[must_use]
pub fn substep_end_ns(interval_ns: u32, i: u32, n: u32) -> u32 {
    (u64::from(interval_ns) * u64::from(i) / u64::from(n)) as u32
}

/// Largest multiple of `quantum_ns` at or before `t_ns`, also for negative times.
#[must_use]
pub fn quantise_ns(t_ns: i64, quantum_ns: i64) -> i64 {
    t_ns.div_euclid(quantum_ns) * quantum_ns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn substeps_follow_motion_and_change_within_their_bounds() {
        let sensor = SensorModel { substeps: 32, ..SensorModel::default() };
        let interval_ns = 33_333_333.0;
        assert_eq!(substep_count(&sensor, 0.0, 0.0, interval_ns), 1);
        assert_eq!(substep_count(&sensor, 4.0, 0.0, interval_ns), 8);
        assert_eq!(substep_count(&sensor, 4.1, 0.0, interval_ns), 9);
        assert_eq!(substep_count(&sensor, 1000.0, 0.0, interval_ns), 32);
        assert_eq!(substep_count(&sensor, 0.0, 1.0, interval_ns), 10);
        let lit = SensorModel { flicker_depth: 0.2, flicker_hz: 60.0, ..sensor.clone() };
        assert_eq!(substep_count(&lit, 0.0, 0.0, interval_ns), 16, "two periods");
        assert_eq!(substep_count(&lit, 10.0, 0.0, interval_ns), 20);
        let few = SensorModel { substeps: 5, ..lit };
        assert_eq!(substep_count(&few, 0.0, 0.0, interval_ns), 5);
        let fixed = SensorModel { substep_policy: SubstepPolicy::Fixed, ..sensor };
        assert_eq!(substep_count(&fixed, 0.0, 0.0, interval_ns), 32);
    }

    #[test]
    fn smooth_texture_needs_fewer_substeps_than_its_speed() {
        let sensor = SensorModel {
            substep_error_ns: 100_000,
            synthesis: Synthesis::Motion,
            contrast_off: 0.1,
            ..SensorModel::default()
        };
        assert!(by_error(&sensor));
        for other in [
            SensorModel { substep_error_ns: 0, ..sensor.clone() },
            SensorModel { substep_policy: SubstepPolicy::Fixed, ..sensor.clone() },
            SensorModel { synthesis: Synthesis::Linear, ..sensor.clone() },
            SensorModel { taps: Taps::Bilinear, ..sensor.clone() },
            SensorModel { synthesis: Synthesis::Rigid, intensity: Intensity::BayerRggb, ..sensor.clone() },
        ] {
            assert!(!by_error(&other));
        }
        let needed = |motion_px, bend_log, slope_log, interval_ns| {
            let block = BlockActivity { motion_px, bend_log, slope_log, change_log: 0.0 };
            needed_motion_px(&sensor, block, interval_ns)
        };
        // In 100 us of 20 ms a slope of 2 passes .01; a chord of 4 sub-steps is off by 1.28 / (8 16).
        assert!((needed(9.0, 1.28, 2.0, 20_000_000) - 4.0 * SUBSTEP_MOTION_PX).abs() < 1e-12);
        // A slope of .01 passes less than the share of the threshold, .0005.
        assert!((needed(9.0, 0.064, 0.01, 20_000_000) - 4.0 * SUBSTEP_MOTION_PX).abs() < 1e-12);
        assert_eq!(needed(9.0, 0.064, 2.0, 0), needed(9.0, 0.064, 0.0, 20_000_000), "a first frame");
        assert_eq!(needed(1.5, 1.28, 2.0, 20_000_000), 1.5, "no more than by speed");
        let changed = BlockActivity { motion_px: 1.5, change_log: 0.5, bend_log: 1.28, slope_log: 2.0 };
        // The change has 5 sub-steps.
        assert!((needed_motion_px(&sensor, changed, 20_000_000) - 4.0 * SUBSTEP_MOTION_PX).abs() < 1e-12);
        assert_eq!(needed(9.0, 0.0, 0.0, 20_000_000), LEAST_NEEDED_PX, "flat, but not still");
        assert_eq!(needed(0.0, 0.0, 0.0, 20_000_000), 0.0);
    }

    #[test]
    fn a_way_needs_what_its_texture_and_its_own_bend_ask_for() {
        let sensor = SensorModel {
            substep_error_ns: 100_000,
            synthesis: Synthesis::Rigid,
            contrast_off: 0.1,
            ..SensorModel::default()
        };
        assert!(by_error(&sensor));
        let texture = |bend_log_px2, slope_log_px| BlockTexture { bend_log_px2, slope_log_px };
        let way = |way_px, bend_px| BlockWay { way_px, bend_px };
        let needed = |texture, way| needed_on_way_px(&sensor, texture, way, 20_000_000);
        // In 100 us of 20 ms a slope of 2 passes .01; a chord of 4 sub-steps is off by 1.28 / (8 16).
        let straight = needed(texture(1.28 / 100.0, 0.2), way(10.0, 0.0));
        assert!((straight - 4.0 * SUBSTEP_MOTION_PX).abs() < 1e-12);
        // There and back again on a slope without a bend.
        let bent = needed(texture(0.0, 0.2), way(10.0, 6.4));
        assert!((bent - 4.0 * SUBSTEP_MOTION_PX).abs() < 1e-12);
        let both = needed(texture(1.28 / 100.0, 0.2), way(10.0, 3.0 * 6.4));
        assert!((both - 8.0 * SUBSTEP_MOTION_PX).abs() < 1e-12);

        let motion_px =
            |way_px, needed_px, change| motion_on_way_px(way(way_px, 0.0), needed_px, change, 20_000_000);
        assert_eq!(motion_px(9.0, Some(2.0), 0.0), 2.0);
        assert_eq!(motion_px(9.0, None, 0.0), 9.0, "by speed");
        assert_eq!(motion_px(1.5, Some(2.0), 0.0), 1.5, "no more than by speed");
        assert_eq!(motion_px(1.5, Some(2.0), 0.5), 2.0, "the change has 5 sub-steps");
        assert_eq!(motion_px(9.0, Some(0.0), 0.0), LEAST_NEEDED_PX, "flat, but not still");
        assert_eq!(motion_px(0.0, Some(2.0), 0.0), 0.0);
    }

    #[test]
    fn a_texture_bends_most_across_its_ridge() {
        for angle in [0.0_f64, 0.3, 1.1, 2.6] {
            let (sin, cos) = angle.sin_cos();
            // -0.7 across the ridge, 0.2 along it.
            let second =
                [-0.7 * cos * cos + 0.2 * sin * sin, -0.9 * sin * cos, -0.7 * sin * sin + 0.2 * cos * cos];
            let found = BlockTexture::of_pixel([0.3 * sin, -0.3 * cos], second);
            assert!((found.bend_log_px2 - 0.7).abs() < 1e-12 && (found.slope_log_px - 0.3).abs() < 1e-12);
            let kept = found.kept();
            assert!(kept.bend_log_px2 <= 0.7 && kept.bend_log_px2 > 0.7 * (1.0 - 1.0 / 128.0));
            assert_eq!(kept.kept(), kept);
        }
    }

    #[test]
    fn substeps_end_on_the_frame() {
        for n in 1..=MAX_SUBSTEPS {
            assert_eq!(substep_end_ns(33_333_333, 0, n), 0);
            assert_eq!(substep_end_ns(33_333_333, n, n), 33_333_333);
        }
    }

    #[test]
    fn quantisation_floors_negative_times_too() {
        assert_eq!(quantise_ns(1999, 1000), 1000);
        assert_eq!(quantise_ns(-1, 1000), -1000);
        assert_eq!(quantise_ns(5, 1), 5);
    }
}
