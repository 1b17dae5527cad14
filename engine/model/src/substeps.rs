//! How an interval is cut into sub-steps, and how time stamps are quantised.

use crate::{SensorModel, SubstepPolicy};

/// Side of a block, pixels. The pixels of a block share one sub-step count and are skipped together.
pub const BLOCK_PX: u32 = 8;

/// Motion per sub-step that the adaptive policy aims at, pixels.
pub const SUBSTEP_MOTION_PX: f64 = 0.5;

/// Timing error per sub-step that the adaptive policy aims at where brightness changes, nanoseconds. A ramp of linear
/// intensity over an interval of length `T` in `n` sub-steps differs from its log-linear chord by at most
/// `T |dL| / (8 n^2)`.
pub const SUBSTEP_TIME_ERROR_NS: f64 = 50_000.0;

/// Sub-steps in a period of a lamp's flicker, at least. Between sub-steps log intensity is linear, so a peak is too low by
/// up to 8% of the flicker's depth.
pub const FLICKER_SUBSTEPS: u32 = 8;

/// Largest sub-step count.
pub const MAX_SUBSTEPS: u32 = 64;

/// Number of sub-steps of a block. `motion_px` is the largest finite motion vector of both frames in the 3x3 blocks
/// around it, or 0 for a synthesis without motion. `change_log` is the largest `|L_k - L_{k-1}|` in the block itself.
/// A lamp's flicker needs [`least_substeps`] everywhere.
/// The caller gives [`Synthesis::None`](crate::Synthesis::None) one sub-step in place of this.
#[must_use]
pub fn substep_count(sensor: &SensorModel, motion_px: f64, change_log: f64, interval_ns: f64) -> u32 {
    match sensor.substep_policy {
        SubstepPolicy::Fixed => sensor.substeps,
        SubstepPolicy::Adaptive => {
            let for_motion = (motion_px / SUBSTEP_MOTION_PX).ceil();
            let for_change = (change_log * interval_ns / (8.0 * SUBSTEP_TIME_ERROR_NS)).sqrt().ceil();
            let least = least_substeps(sensor, interval_ns as u32);
            for_motion.max(for_change).clamp(f64::from(least), f64::from(sensor.substeps)) as u32
        }
    }
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
