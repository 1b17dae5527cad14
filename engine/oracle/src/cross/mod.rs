//! Stage `cross`: walks one pixel through the sub-steps of an interval. Handles crossings, refractory period, leak and
//! shot noise.

pub mod aps;
pub mod shot;

use crate::split::Split;
use esaac_model::random::{PixelKey, Stream, leak_log_per_s, leak_phase_among_shots, threshold_log};
use esaac_model::substeps::substep_end_ns;
use esaac_model::{Polarity, SensorModel, Timestamps};
use shot::ShotClock;

/// Distance from a threshold, nepers, that counts as touching it. It is some ulps of a log intensity, so that a level
/// that touches a threshold in exact arithmetic also touches it in f64.
pub const TOUCH_LOG: f64 = 1e-14;

/// The random draws made once per pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelConstants {
    /// OFF and ON threshold, nepers (indexed by [`Polarity`]).
    pub threshold_log: [f64; 2],
    /// Rate at which the leak lowers the reference, nepers per nanosecond.
    pub leak_log_per_ns: f64,
}

impl PixelConstants {
    /// Draws the constants of the pixel `key`.
    #[must_use]
    pub fn draw(sensor: &SensorModel, key: PixelKey) -> Self {
        let sigma = sensor.contrast_mismatch;
        let nominal_log_per_s = sensor.leak_rate_hz * sensor.contrast_on;
        PixelConstants {
            threshold_log: [
                threshold_log(key, Stream::ContrastOff, sensor.contrast_off, sigma),
                threshold_log(key, Stream::ContrastOn, sensor.contrast_on, sigma),
            ],
            leak_log_per_ns: leak_log_per_s(key, nominal_log_per_s, sensor.leak_spread_log) * 1e-9,
        }
    }

    /// How far the leak has lowered the reference `age_ns` after the epoch, nepers.
    #[must_use]
    pub fn leak_log(&self, age_ns: i64) -> Split {
        if self.leak_log_per_ns == 0.0 {
            return Split::default();
        }
        Split::product(self.leak_log_per_ns, age_ns as f64)
    }

    /// How far the leak has lowered the reference of a pixel that is armed in this light, nepers.
    fn armed_leak_log(&self, sensor: &SensorModel, key: PixelKey, intensity: f64) -> f64 {
        if self.leak_log_per_ns == 0.0 {
            return 0.0;
        }
        let [off_log, on_log] = self.threshold_log;
        let shots_per_ns = shot::mean_hazard_per_ns(sensor, intensity, intensity)
            * (sensor.contrast_on / on_log + sensor.contrast_off / off_log);
        on_log * leak_phase_among_shots(key, shots_per_ns * on_log / self.leak_log_per_ns)
    }
}

/// State that a pixel keeps from one interval to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelState {
    /// Reference plus the leak's fall since the epoch, nepers. This sum is constant between events.
    pub reference: Split,
    /// End of the refractory period, nanoseconds, if the pixel is in one.
    pub held_until_ns: Option<i64>,
    /// Waiting times of OFF and ON shot noise.
    pub shot: [ShotClock; 2],
    /// Events emitted, modulo 2^32.
    pub events: u32,
}

impl PixelState {
    /// Arms a pixel at its first valid intensity, `age_ns` after the epoch.
    #[must_use]
    pub fn arm(
        sensor: &SensorModel,
        constants: &PixelConstants,
        key: PixelKey,
        intensity: f64,
        age_ns: i64,
    ) -> Self {
        PixelState {
            reference: constants
                .leak_log(age_ns)
                .plus((intensity + sensor.log_offset).ln())
                .plus(-constants.armed_leak_log(sensor, key, intensity)),
            held_until_ns: None,
            shot: [Polarity::Off, Polarity::On]
                .map(|polarity| ShotClock::start(sensor, constants, key, polarity)),
            events: 0,
        }
    }

    /// Changes the pixel's leak at `age_ns` after the epoch, without moving the reference.
    pub fn change_leak(&mut self, old: &PixelConstants, new: &PixelConstants, age_ns: i64) {
        self.reference = self.reference.minus_split(old.leak_log(age_ns)).plus_split(new.leak_log(age_ns));
    }
}

/// One interval of one pixel.
#[derive(Clone, Copy, Debug)]
pub struct Span<'a> {
    /// The pixel's key for random draws.
    pub key: PixelKey,
    /// Time of the camera's first frame, nanoseconds.
    pub epoch_ns: i64,
    /// The interval's start, nanoseconds.
    pub start_ns: i64,
    /// Its length, nanoseconds.
    pub interval_ns: u32,
    /// Intensity at the start and at the end of every sub-step.
    pub samples: &'a [f64],
    /// Intensity in both frames, in steady light.
    pub frames: [f64; 2],
}

/// An event before it is stamped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crossing {
    /// When it happens, nanoseconds.
    pub t_ns: i64,
    /// Its polarity.
    pub polarity: Polarity,
    /// Events that the pixel has emitted before.
    pub index: u32,
}

/// Walks a pixel through an interval and emits its events in time order. At equal times the order is: end of the
/// refractory period, crossing, OFF noise, ON noise.
pub fn walk(
    sensor: &SensorModel,
    constants: &PixelConstants,
    state: &mut PixelState,
    span: &Span<'_>,
    emit: &mut dyn FnMut(Crossing),
) {
    let substeps = (span.samples.len() - 1) as u32;
    let end_ns = |i| substep_end_ns(span.interval_ns, i, substeps);
    let shot_hazard = shot::mean_hazard_per_ns(sensor, span.frames[0], span.frames[1]);
    let mut first = 0;
    for last in 1..=substeps {
        // An interval of fewer nanoseconds than sub-steps has sub-steps of length zero. Merge them with the next one.
        if end_ns(last) == end_ns(first) {
            continue;
        }
        let (from, to) = (span.samples[first as usize], span.samples[last as usize]);
        let start_ns = span.start_ns + i64::from(end_ns(first));
        let substep = Substep {
            sensor,
            constants,
            key: span.key,
            start_ns,
            duration_ns: i64::from(end_ns(last) - end_ns(first)),
            log: [(from + sensor.log_offset).ln(), (to + sensor.log_offset).ln()],
            leaked: constants.leak_log(start_ns - span.epoch_ns),
            shot_hazard,
        };
        substep.walk(state, emit);
        first = last;
    }
}

/// A crossing or a shot event.
#[derive(Clone, Copy)]
struct Happening {
    /// Nanoseconds since the sub-step's start, from 1 to its duration.
    at_ns: i64,
    polarity: Polarity,
}

struct Substep<'a> {
    sensor: &'a SensorModel,
    constants: &'a PixelConstants,
    key: PixelKey,
    start_ns: i64,
    duration_ns: i64,
    /// Log intensity at the start and the end.
    log: [f64; 2],
    /// Fall of the reference by the leak up to the start, nepers.
    leaked: Split,
    /// Shot-noise hazard per nanosecond, without the factor of the pixel's threshold.
    shot_hazard: f64,
}

impl Substep<'_> {
    fn walk(&self, state: &mut PixelState, emit: &mut dyn FnMut(Crossing)) {
        // `anchor_ns`: the latest instant at which the reference was set. `at_start`: the walk is still at the
        // sub-step's start.
        let mut anchor_ns = 0;
        let mut at_start = true;
        loop {
            let noise = self.next_shot(state);
            if let Some(held_until_ns) = state.held_until_ns {
                let release_ns = held_until_ns - self.start_ns;
                if let Some(noise) = noise.filter(|noise| noise.at_ns < release_ns) {
                    self.consume_shot(state, noise.polarity);
                    continue;
                }
                if release_ns > self.duration_ns {
                    break;
                }
                anchor_ns = release_ns.max(0);
                at_start = false;
                state.held_until_ns = None;
                state.reference = self.level(anchor_ns);
                continue;
            }
            let crossing = if at_start { self.crossed_before(state) } else { None };
            at_start = crossing.is_some();
            let crossing = crossing.or_else(|| self.next_crossing(state, anchor_ns));
            let happening = match (crossing, noise) {
                (Some(crossing), noise) if noise.is_none_or(|noise| crossing.at_ns <= noise.at_ns) => {
                    let threshold = self.constants.threshold_log[crossing.polarity as usize];
                    state.reference = state.reference.plus(f64::from(crossing.polarity.sign()) * threshold);
                    crossing
                }
                (_, Some(noise)) => {
                    self.consume_shot(state, noise.polarity);
                    anchor_ns = noise.at_ns;
                    at_start = false;
                    state.reference = self.level(anchor_ns);
                    noise
                }
                (_, None) => break,
            };
            let t_ns = self.start_ns + happening.at_ns;
            emit(Crossing { t_ns, polarity: happening.polarity, index: state.events });
            state.events = state.events.wrapping_add(1);
            if self.sensor.refractory_ns > 0 {
                state.held_until_ns = Some(t_ns + i64::from(self.sensor.refractory_ns));
            }
        }
        for clock in &mut state.shot {
            clock.advance(self.shot_hazard * self.duration_ns as f64);
        }
    }

    /// Log intensity plus the leak's fall, `at_ns` after the sub-step's start.
    fn level(&self, at_ns: i64) -> Split {
        let [from, to] = self.log;
        let log = if at_ns == self.duration_ns {
            to
        } else {
            from + (to - from) * (at_ns as f64 / self.duration_ns as f64)
        };
        self.leaked.plus(self.constants.leak_log_per_ns * at_ns as f64).plus(log)
    }

    /// The event due at the sub-step's start, if the level is already at or beyond a threshold there. A changed
    /// parameter can cause that. A pixel that is looked at in samples sees it in the next one.
    fn crossed_before(&self, state: &PixelState) -> Option<Happening> {
        if self.sensor.timestamps == Timestamps::AtSample {
            return None;
        }
        let distance = self.level(0).minus_split(state.reference).value();
        let polarity = self.reached(distance)?;
        Some(Happening { at_ns: self.event_ns(0.0), polarity })
    }

    /// The next crossing of the level, which is linear in time. `anchor_ns` is when the reference was last set.
    fn next_crossing(&self, state: &PixelState, anchor_ns: i64) -> Option<Happening> {
        let distance = |at_ns| self.level(at_ns).minus_split(state.reference).value();
        let polarity = self.reached(distance(self.duration_ns))?;
        let slope_per_ns =
            (self.log[1] - self.log[0]) / self.duration_ns as f64 + self.constants.leak_log_per_ns;
        let threshold = f64::from(polarity.sign()) * self.constants.threshold_log[polarity as usize];
        let wait_ns = (threshold - distance(anchor_ns)) / slope_per_ns;
        Some(Happening { at_ns: self.event_ns(anchor_ns as f64 + wait_ns), polarity })
    }

    /// Polarity of the threshold that a distance from the reference touches or exceeds.
    fn reached(&self, distance_log: f64) -> Option<Polarity> {
        [Polarity::Off, Polarity::On].into_iter().find(|&polarity| {
            let threshold = self.constants.threshold_log[polarity as usize];
            f64::from(polarity.sign()) * distance_log >= threshold - TOUCH_LOG
        })
    }

    /// Time of the event of a crossing `crossed_ns` after the sub-step's start, nanoseconds from that start.
    fn event_ns(&self, crossed_ns: f64) -> i64 {
        match self.sensor.timestamps {
            Timestamps::Interpolated => (crossed_ns.ceil() as i64).clamp(1, self.duration_ns),
            Timestamps::AtSample => self.duration_ns,
        }
    }

    fn next_shot(&self, state: &PixelState) -> Option<Happening> {
        [Polarity::Off, Polarity::On]
            .into_iter()
            .filter_map(|polarity| {
                let at_ns = state.shot[polarity as usize].next_ns(self.shot_hazard, self.duration_ns)?;
                Some(Happening { at_ns, polarity })
            })
            .min_by_key(|noise| noise.at_ns)
    }

    fn consume_shot(&self, state: &mut PixelState, polarity: Polarity) {
        state.shot[polarity as usize].redraw(self.sensor, self.constants, self.key, polarity);
    }
}
