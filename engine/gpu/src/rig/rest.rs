//! When pixels in still light rest: whether `cross` passes them over until their noise may send something.
//!
//! The kernels that let pixels rest cost more where things move, and kernels that do not know of rest cost more where
//! nothing does. So a rig chooses by what past ticks were like. Packets do not depend on it: before pixels stop resting,
//! and before anything that a rest depends on changes, their state is brought up to date.

use super::machine::TickEnd;
use super::record::{order, record_catch_up};
use super::{CameraState, Rig};
use crate::error::EngineError;
use crate::policy::Resting;
use esaac_layout::{self as layout, Counters, FrameKind, Rest, RestMode};
use esaac_model::{Pixel, SensorModel};

/// What a tile costs whose pixels may rest, in walks of a tile of which none may: one that is not still; and one that is,
/// what it costs more if any pixel is awake, and what it costs more if all are.
const RESTLESS_COST: f64 = 1.06;
const STILL_COST: f64 = 0.33;
const ANY_AWAKE_COST: f64 = 0.6;
const ALL_AWAKE_COST: f64 = 0.6;

/// Pixels begin to rest if a tick would have cost less than this share of what it costs with all pixels walked, and stop
/// if it would have cost more than that.
const BEGIN_SHARE: f64 = 0.9;
const STOP_SHARE: f64 = 0.95;

/// Pixels begin or stop to rest once so many ticks in a row speak for it.
const TICKS: u32 = 8;

/// Whether the pixels of a sensor can rest.
pub(super) fn can_rest(sensor: &SensorModel) -> bool {
    sensor.pixel == Pixel::Log
        && (sensor.leak_rate_hz > 0.0 || sensor.shot_noise_rate_hz > 0.0)
        && sensor.aps_exposure_ns == 0
        && sensor.flicker().is_none()
}

/// Lengths of the intervals that a camera's pixels have passed over; see `resting.glsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(super) struct PassedIntervals {
    /// Two lengths, 0 for none yet.
    lengths_ns: [u32; 2],
    /// How often each has occurred, modulo 2^8.
    counts: [u8; 2],
}

impl PassedIntervals {
    /// With one more interval; `None` if its length is a third one.
    fn with(self, interval_ns: u32) -> Option<Self> {
        let number = self.lengths_ns.iter().position(|&ns| ns == interval_ns || ns == 0)?;
        let mut after = self;
        after.lengths_ns[number] = interval_ns;
        after.counts[number] = after.counts[number].wrapping_add(1);
        Some(after)
    }

    fn count_bits(self) -> u32 {
        u32::from(self.counts[0]) | u32::from(self.counts[1]) << 8
    }

    /// The row of a camera whose pixels are brought up to date between two intervals.
    fn ended(self) -> Rest {
        let [first_ns, second_ns] = self.lengths_ns;
        Rest { mode: RestMode::Ends as u32, counts: self.count_bits(), first_ns, second_ns }
    }

    /// The row of a camera for an interval, and what its pixels know after it. `before`: `None` if they know nothing yet.
    fn row(before: Option<Self>, interval_ns: u32) -> (Rest, Self) {
        // Pixels count from the interval in which all are walked: it is none that they have passed over.
        let none = PassedIntervals::default();
        let Some(before) = before else { return (Rest::default(), none) };
        let Some(after) = before.with(interval_ns) else { return (before.ended(), none) };
        let row = Rest {
            mode: RestMode::Allowed as u32,
            counts: before.count_bits() | after.count_bits() << 16,
            first_ns: after.lengths_ns[0],
            second_ns: after.lengths_ns[1],
        };
        (row, after)
    }
}

/// A camera's row of the table of rests for a tick; `t_ns` is `None` if the camera takes no part.
pub(super) fn rest_row(camera: &CameraState, t_ns: Option<i64>) -> Rest {
    match (camera.last_ns, t_ns) {
        (Some(last_ns), Some(t_ns)) => PassedIntervals::row(camera.rested, (t_ns - last_ns) as u32).0,
        _ => camera.rested.map_or_else(Rest::default, PassedIntervals::ended),
    }
}

/// Whether a rig lets pixels rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RestChoice {
    rests: bool,
    ticks: u32,
}

/// What a tick tells about its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RestLoad {
    /// Blocks whose pixels can rest, and those of them that were still.
    blocks: f64,
    still_blocks: f64,
    /// What these would have cost with pixels at rest.
    still_cost: f64,
}

/// What a still tile costs, of whose pixels each has so many events of noise on average. Work is spared where so many
/// pixels `together` are at rest.
fn still_cost(events_per_px: f64, together: u32) -> f64 {
    let awake = |pixels: f64| 1.0 - (-events_per_px * pixels).exp();
    STILL_COST + ANY_AWAKE_COST * awake(f64::from(together)) + ALL_AWAKE_COST * awake(1.0)
}

impl RestLoad {
    /// The load of all cameras that took part in a tick. `together`: see [`still_cost`].
    pub(super) fn of(cameras: &[CameraState], end: &TickEnd, together: u32) -> Self {
        let mut load = RestLoad::default();
        for (camera, counters) in cameras.iter().zip(&end.counters) {
            let sensor = &camera.config.sensor;
            let Some(Counters { still_blocks, .. }) = *counters else { continue };
            if can_rest(sensor) {
                let rate_hz = sensor.leak_rate_hz + sensor.shot_noise_rate_hz;
                let events_per_px = rate_hz * f64::from(camera.last_interval_ns) * 1e-9;
                load.blocks += f64::from(camera.place.blocks);
                load.still_blocks += f64::from(still_blocks);
                load.still_cost += f64::from(still_blocks) * still_cost(events_per_px, together);
            }
        }
        load
    }

    /// The cost with pixels at rest, as a share of that with all pixels walked.
    fn cost_share(self) -> f64 {
        ((self.blocks - self.still_blocks) * RESTLESS_COST + self.still_cost) / self.blocks
    }
}

impl RestChoice {
    pub(super) fn new(resting: Resting) -> Self {
        RestChoice { rests: resting == Resting::Always, ticks: 0 }
    }

    /// Whether pixels that can rest do so in the next tick.
    pub(super) fn rests(self) -> bool {
        self.rests
    }

    /// Chooses anew after a tick.
    pub(super) fn follow(&mut self, load: RestLoad, resting: Resting) {
        if resting != Resting::WherePaid || load.blocks == 0.0 {
            return;
        }
        let share = load.cost_share();
        let speaks = if self.rests { share > STOP_SHARE } else { share < BEGIN_SHARE };
        self.ticks = if speaks { self.ticks + 1 } else { 0 };
        if self.ticks >= TICKS {
            *self = RestChoice { rests: !self.rests, ticks: 0 };
        }
    }
}

impl CameraState {
    /// Whether its kernels must know of rest, if pixels rest in the rig (`rests`) or not.
    pub(super) fn knows_rest(&self, rests: bool) -> bool {
        can_rest(&self.config.sensor) && (rests || self.rested.is_some())
    }

    /// Takes note of an interval at whose end pixels rest (`rests`) or not.
    pub(super) fn note_rest(&mut self, rests: bool, interval_ns: u32) {
        self.rested = self.knows_rest(rests).then(|| PassedIntervals::row(self.rested, interval_ns).1);
    }
}

impl Rig {
    /// Ends the rest of all pixels if the next tick lets none rest.
    pub(super) fn end_rest(&mut self) -> Result<(), EngineError> {
        if self.rest.rests() { Ok(()) } else { self.catch_up() }
    }

    /// Brings the state of pixels at rest up to date, so that it does not depend on past intervals any more. On an error
    /// nothing has changed, unless the rig is lost.
    pub(super) fn catch_up(&mut self) -> Result<(), EngineError> {
        if self.cameras.iter().all(|camera| camera.rested.is_none()) {
            return Ok(());
        }
        let permutations = self.permutations();
        self.need_kernels(&permutations, true, false)?;
        self.forget_paths();
        self.bind_current();
        self.prepare_rows(&vec![None; self.cameras.len()]);
        let order = order(&permutations);
        for (row, &camera) in self.parameters.iter_mut().zip(&order) {
            if self.cameras[camera].rested.is_some() {
                row.frame_kind = FrameKind::CatchUp as u32;
            }
        }
        self.arena.table(layout::CAMERAS).write(0, &self.parameters);
        let groups = self.groups(&permutations, &order);
        let ran = self.device.run_once(|commands| record_catch_up(self, commands, &groups));
        if let Err(error) = ran {
            return Err(if error.leaves_work() { self.lose(error) } else { error });
        }
        self.cameras.iter_mut().for_each(|camera| camera.rested = None);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u32 = 1_000_000;

    #[test]
    fn two_lengths_of_intervals_are_counted_and_a_third_ends_the_rest() {
        let (row, after) = PassedIntervals::row(None, 33 * MS);
        assert_eq!((row.mode, row.counts), (RestMode::Unknown as u32, 0));
        let mut passed = after;
        for _ in 0..3 {
            passed = PassedIntervals::row(Some(passed), 33 * MS).1;
        }
        let (row, after) = PassedIntervals::row(Some(passed), 34 * MS);
        let expected = Rest {
            mode: RestMode::Allowed as u32,
            counts: 3 | (3 | 1 << 8) << 16,
            first_ns: 33 * MS,
            second_ns: 34 * MS,
        };
        assert_eq!(row, expected);
        // What is walked in the interval of a third length has passed over those of the first two.
        let (row, last) = PassedIntervals::row(Some(after), 35 * MS);
        let ends = Rest { mode: RestMode::Ends as u32, counts: 3 | 1 << 8, ..expected };
        assert_eq!((row, last), (ends, PassedIntervals::default()));
    }

    #[test]
    fn counts_wrap() {
        let mut passed = PassedIntervals::default();
        for _ in 0..257 {
            passed = passed.with(MS).expect("one length");
        }
        assert_eq!(passed, PassedIntervals { lengths_ns: [MS, 0], counts: [1, 0] });
    }

    /// Of 100 blocks so many are still; each pixel has so many events of noise.
    fn load(still: f64, events_per_px: f64) -> RestLoad {
        RestLoad { blocks: 100.0, still_blocks: still, still_cost: still * still_cost(events_per_px, 256) }
    }

    /// Whether pixels rest after each of `ticks` ticks.
    fn choices(choice: &mut RestChoice, load: RestLoad, ticks: u32) -> Vec<bool> {
        (0..ticks)
            .map(|_| {
                choice.follow(load, Resting::WherePaid);
                choice.rests()
            })
            .collect()
    }

    #[test]
    fn pixels_rest_after_a_still_time_and_stop_when_much_moves() {
        let mut choice = RestChoice::new(Resting::WherePaid);
        let begun = choices(&mut choice, load(100.0, 0.002), TICKS);
        assert_eq!(begun.iter().filter(|&&rests| rests).count(), 1, "only the last of {TICKS} ticks");
        let stopped = choices(&mut choice, load(10.0, 0.002), TICKS);
        assert_eq!(stopped.iter().filter(|&&rests| !rests).count(), 1);
        // What moves now and then, or what is nearly as costly, changes nothing.
        for _ in 0..TICKS {
            choice.follow(load(100.0, 0.002), Resting::WherePaid);
            choice.follow(load(0.0, 0.0), Resting::WherePaid);
            assert!(!choice.rests());
        }
        assert!(choices(&mut choice, load(25.0, 0.002), 100).iter().all(|rests| !rests));
    }

    #[test]
    fn noise_that_wakes_most_pixels_is_walked() {
        let mut choice = RestChoice::new(Resting::WherePaid);
        assert!(choices(&mut choice, load(100.0, 0.15), 100).iter().all(|rests| !rests));
    }

    #[test]
    fn a_forced_choice_stays() {
        for (resting, rests) in [(Resting::Always, true), (Resting::Never, false)] {
            let mut choice = RestChoice::new(resting);
            for still in [100.0, 0.0] {
                (0..100).for_each(|_| choice.follow(load(still, 0.0), resting));
                assert_eq!(choice.rests(), rests);
            }
        }
    }
}
