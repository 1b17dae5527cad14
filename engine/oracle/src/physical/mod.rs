//! Stage `cross` of the physical pixel ([`esaac_model::physical`]): walks one pixel through the sub-steps of an
//! interval. The photoreceptor is the solution of its differential equations ([`response`]) and the hazard is integrated
//! in continuous time, so that the events do not depend on where sub-steps end. [`readout`] is the bus.

pub mod readout;
pub mod response;

use crate::cross::{Crossing, Span};
use esaac_model::physical::crossing::SlopeLaw;
use esaac_model::physical::noise::{
    ARMED_WITHIN, AtEvent, Renewal, armed_leak_log, armed_log, correlation, forgotten, hazard_per_s,
    release_log, sigma_log,
};
use esaac_model::physical::photoreceptor::{Drive, Photoreceptor, phi};
use esaac_model::physical::{MOST_EVENTS, PhysicalDraws, PhysicalPixel};
use esaac_model::random::{PixelKey, leak_phase};
use esaac_model::substeps::substep_end_ns;
use esaac_model::{Polarity, SensorModel, Timestamps};
use response::{LEAST_RATIO, Point, Response};

/// Distance from a threshold, nepers, that counts as touching it.
pub const TOUCH_LOG: f64 = 1e-12;

/// Largest distance, in thresholds, between the watched level and a straight line in a stride of the walk. An excursion
/// beyond a threshold by less may be missed.
const STRIDE_BEND: f64 = 1e-3;

/// Largest error of a stride's hazard: absolute, and relative to it.
const STRIDE_HAZARD: [f64; 2] = [1e-6, 1e-5];

/// Shortest stride, nanoseconds.
const SHORTEST_NS: f64 = 1e-3;

/// State that a physical pixel keeps from one interval to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhysicalState {
    /// The reference, nepers.
    pub reference_log: f64,
    /// The photoreceptor, relative to `level_log`.
    pub photoreceptor: Photoreceptor,
    /// Level at the end of the last sub-step, nepers.
    pub level_log: f64,
    /// Noise at the last release, nepers.
    pub noise_log: f64,
    /// Phases of both poles since the last release or, while the pixel is held, since the event.
    pub phases: [f64; 2],
    /// End of the refractory period, nanoseconds, and the noise at the event, if the pixel is held.
    pub held: Option<(i64, AtEvent)>,
    /// Hazard left until a noise event.
    pub clock: f64,
    /// Events emitted, modulo 2^32.
    pub events: u32,
}

impl PhysicalState {
    /// Arms a settled pixel, which has sent `events` so far.
    #[must_use]
    pub fn arm(
        sensor: &SensorModel,
        pixel: &PhysicalPixel,
        draws: &PhysicalDraws,
        key: PixelKey,
        intensity: f64,
        events: u32,
    ) -> Self {
        let seen = intensity + pixel.dark_intensity(draws.dark_factor);
        let rates_per_s = [pixel.drive_per_s(seen), pixel.second_pole_per_s()];
        let sigma = sigma_log(pixel.photoreceptor_charge_e, pixel.noise_gain, rates_per_s[0], rates_per_s[1]);
        let noise_log = if pixel.noise_gain > 0.0 { armed_log(key, events, sigma) } else { 0.0 };
        let leak_hz = pixel.leak_hz(intensity * pixel.lux_per_unit, draws.leak_factor);
        let [off_log, on_log] = draws.threshold_log;
        // How far what it watches is above its reference.
        let above_log = if leak_hz == 0.0 {
            0.0
        } else {
            let [p, q] = rates_per_s.map(|rate_per_s| rate_per_s * f64::from(sensor.refractory_ns) * 1e-9);
            let threshold_log = if leak_hz > 0.0 { on_log } else { off_log };
            let leaked_log = armed_leak_log(leak_phase(key, events), threshold_log, sigma, correlation(p, q));
            let watched_log = noise_log + leak_hz.signum() * leaked_log;
            watched_log.clamp(-ARMED_WITHIN * off_log, ARMED_WITHIN * on_log)
        };
        PhysicalState {
            reference_log: seen.ln() + noise_log - above_log,
            photoreceptor: Photoreceptor::default(),
            level_log: seen.ln(),
            noise_log,
            phases: [0.0; 2],
            held: None,
            clock: Renewal::draw(key, events).clock,
            events,
        }
    }

    /// Moves the level without moving what the photoreceptor shows: a step of the light, or of a parameter.
    fn step_level(&mut self, level_log: f64) {
        let change = level_log - self.level_log;
        if change != 0.0 {
            self.photoreceptor.lag_log -= change;
            let ratio = (self.photoreceptor.excess + 1.0) * change.exp();
            self.photoreceptor.excess = ratio.max(LEAST_RATIO) - 1.0;
            self.level_log = level_log;
        }
    }
}

/// Walks a pixel through an interval and emits its events in time order. Returns whether it would have sent more than
/// [`MOST_EVENTS`]; it is armed anew then.
pub fn walk(
    sensor: &SensorModel,
    pixel: &PhysicalPixel,
    draws: &PhysicalDraws,
    state: &mut PhysicalState,
    span: &Span<'_>,
    emit: &mut dyn FnMut(Crossing),
) -> bool {
    let events_before = state.events;
    let substeps = (span.samples.len() - 1) as u32;
    let end_ns = |i| substep_end_ns(span.interval_ns, i, substeps);
    let dark = pixel.dark_intensity(draws.dark_factor);
    let mut first = 0;
    for last in 1..=substeps {
        // Sub-steps of length zero are merged with the next one.
        if end_ns(last) == end_ns(first) {
            continue;
        }
        let duration_ns = i64::from(end_ns(last) - end_ns(first));
        let [from, to] = [first, last].map(|i| span.samples[i as usize] + dark);
        state.step_level(from.ln());
        let drive = Drive {
            start_per_s: pixel.drive_per_s(from),
            change_log: (to / from).ln(),
            duration_s: duration_ns as f64 * 1e-9,
            second_pole_per_s: pixel.second_pole_per_s(),
        };
        let substep = Substep {
            sensor,
            pixel,
            draws,
            key: span.key,
            start_ns: span.start_ns + i64::from(end_ns(first)),
            duration_ns,
            from_log: from.ln(),
            from,
            response: Response::solve(state.photoreceptor, &drive),
            drive,
        };
        substep.walk(state, events_before, emit);
        if state.events.wrapping_sub(events_before) >= MOST_EVENTS {
            let last = span.samples[substeps as usize];
            *state = PhysicalState::arm(sensor, pixel, draws, span.key, last, state.events);
            return true;
        }
        state.photoreceptor = substep.response.end();
        state.level_log = to.ln();
        first = last;
    }
    false
}

/// Why and when the next event happens.
#[derive(Clone, Copy)]
struct Happening {
    /// Nanoseconds since the sub-step's start.
    at_ns: f64,
    polarity: Polarity,
    /// Whether it is a noise event.
    noise: bool,
}

/// What the comparators see at an instant.
#[derive(Clone, Copy, Default)]
struct Look {
    /// The watched level, with the noise that a signal meets, above the reference, nepers.
    above_log: f64,
    /// The noise in it, nepers.
    noise_log: f64,
    /// Hazards of OFF and ON noise, per nanosecond (indexed by [`Polarity`]).
    hazard_per_ns: [f64; 2],
}

impl Look {
    fn hazard(&self) -> f64 {
        self.hazard_per_ns[0] + self.hazard_per_ns[1]
    }
}

/// A walk's place: the renewal that it is in.
struct Watch {
    /// When the renewal (or the hold) began within the sub-step, or 0; nanoseconds.
    since_ns: f64,
    /// Phase of the first stage at that instant, since the sub-step's start.
    since_phase: f64,
    renewal: Renewal,
}

struct Substep<'a> {
    sensor: &'a SensorModel,
    pixel: &'a PhysicalPixel,
    draws: &'a PhysicalDraws,
    key: PixelKey,
    start_ns: i64,
    duration_ns: i64,
    /// Level at the start, nepers.
    from_log: f64,
    /// Intensity at the start with the dark current, scene units.
    from: f64,
    response: Response,
    drive: Drive,
}

impl Substep<'_> {
    fn walk(&self, state: &mut PhysicalState, events_before: u32, emit: &mut dyn FnMut(Crossing)) {
        let mut now_ns = 0.0;
        let mut watch =
            Watch { since_ns: 0.0, since_phase: 0.0, renewal: Renewal::draw(self.key, state.events) };
        loop {
            if let Some((held_until_ns, at_event)) = state.held {
                let release_ns = held_until_ns - self.start_ns;
                if release_ns > self.duration_ns {
                    break;
                }
                now_ns = release_ns.max(0) as f64;
                self.release(state, &mut watch, at_event, now_ns);
            }
            let Some(happening) = self.next(state, &watch, now_ns) else { break };
            now_ns = happening.at_ns;
            let t_ns = self.start_ns + self.whole_ns(now_ns);
            // Only the stamp waits for the end of the sub-step.
            let stamp_ns = match self.sensor.timestamps {
                Timestamps::Interpolated => t_ns,
                Timestamps::AtSample => self.start_ns + self.duration_ns,
            };
            emit(Crossing { t_ns: stamp_ns, polarity: happening.polarity, index: state.events });
            self.fire(state, &mut watch, happening, t_ns);
            if state.events.wrapping_sub(events_before) >= MOST_EVENTS {
                return;
            }
        }
        let end_ns = self.duration_ns as f64;
        state.phases = self.phases(state, &watch, end_ns, &self.point(end_ns));
        state.reference_log -= self.leaked_log(end_ns);
    }

    /// Books an event: begins the hold or, without a refractory period, the next renewal.
    fn fire(&self, state: &mut PhysicalState, watch: &mut Watch, happening: Happening, t_ns: i64) {
        let threshold = self.draws.threshold_log[happening.polarity as usize];
        let sign = f64::from(happening.polarity.sign());
        let look = self.look(state, watch, happening.at_ns);
        // In a noise event the noise lifts the level to the threshold.
        let lifted_log = if happening.noise { sign * threshold - look.above_log } else { 0.0 };
        let noise_log = look.noise_log + lifted_log;
        let slope = if self.is_noisy() && self.sensor.refractory_ns > 0 {
            self.noise_slope(state, watch, happening, noise_log)
        } else {
            0.0
        };
        state.events = state.events.wrapping_add(1);
        state.phases = [0.0; 2];
        watch.since_ns = happening.at_ns;
        watch.since_phase = self.point(happening.at_ns).phase;
        if self.sensor.refractory_ns > 0 {
            state.held = Some((t_ns + i64::from(self.sensor.refractory_ns), AtEvent { noise_log, slope }));
        } else {
            state.reference_log += sign * threshold;
            state.noise_log = noise_log;
            watch.renewal = Renewal::draw(self.key, state.events);
            state.clock = watch.renewal.clock;
        }
    }

    /// Slope of the noise at an event at which it is `noise_log`, in its standard deviations.
    fn noise_slope(&self, state: &PhysicalState, watch: &Watch, happening: Happening, noise_log: f64) -> f64 {
        let sign = f64::from(happening.polarity.sign());
        let point = self.point(happening.at_ns);
        let sigma_log = self.sigma_log(&point);
        let [p, q] = self.phases(state, watch, happening.at_ns, &point);
        let [released, now] = [state.noise_log, noise_log].map(|log| sign * log / sigma_log);
        let deviation_per_s = sigma_log * (point.first_per_s * self.drive.second_pole_per_s).sqrt();
        let light = sign * (point.slope_per_s + self.leak_log_per_s(happening.at_ns)) / deviation_per_s;
        sign * SlopeLaw::between(released, now, p, q).at_event(light, watch.renewal.slope)
    }

    /// Ends the hold: draws the noise at this instant and sets the reference to what the pixel shows.
    fn release(&self, state: &mut PhysicalState, watch: &mut Watch, at_event: AtEvent, now_ns: f64) {
        let point = self.point(now_ns);
        let noise_log = if self.is_noisy() {
            let [p, q] = self.phases(state, watch, now_ns, &point);
            release_log(self.key, state.events, at_event, self.sigma_log(&point), p, q)
        } else {
            0.0
        };
        state.held = None;
        state.noise_log = noise_log;
        // The reference at the sub-step's start has not leaked yet what it has now.
        state.reference_log = self.shown_log(&point) + noise_log + self.leaked_log(now_ns);
        state.phases = [0.0; 2];
        *watch = Watch {
            since_ns: now_ns,
            since_phase: point.phase,
            renewal: Renewal::draw(self.key, state.events),
        };
        state.clock = watch.renewal.clock;
    }

    /// The next event after `now_ns`, if it lies in the sub-step. Spends the hazard up to it.
    fn next(&self, state: &mut PhysicalState, watch: &Watch, now_ns: f64) -> Option<Happening> {
        let end_ns = self.duration_ns as f64;
        let (mut now_ns, mut stride_ns) = (now_ns, end_ns);
        let mut start = self.look(state, watch, now_ns);
        if let Some(polarity) = self.reached(start.above_log) {
            return Some(Happening { at_ns: now_ns, polarity, noise: false });
        }
        while now_ns < end_ns {
            stride_ns = stride_ns.min(end_ns - now_ns);
            let at = |quarter: usize| now_ns + 0.25 * quarter as f64 * stride_ns;
            let looks: [Look; 5] =
                std::array::from_fn(
                    |quarter| {
                        if quarter == 0 { start } else { self.look(state, watch, at(quarter)) }
                    },
                );
            let coarse = stride_ns * simpson([&looks[0], &looks[2], &looks[4]]);
            let hazard = 0.5
                * stride_ns
                * (simpson([&looks[0], &looks[1], &looks[2]]) + simpson([&looks[2], &looks[3], &looks[4]]));
            let level = looks.map(|look| look.above_log);
            let bend = |from: usize, middle: usize, to: usize| {
                (level[middle] - 0.5 * (level[from] + level[to])).abs()
            };
            let bent = bend(0, 2, 4).max(bend(0, 1, 2)).max(bend(2, 3, 4));
            let allowed = STRIDE_BEND * self.draws.threshold_log[0].min(self.draws.threshold_log[1]);
            let [absolute, relative] = STRIDE_HAZARD;
            let smooth = bent <= allowed && (coarse - hazard).abs() <= absolute + relative * hazard;
            if !smooth && stride_ns > SHORTEST_NS {
                stride_ns *= 0.5;
                continue;
            }
            let signal = (1..5).find_map(|quarter| {
                let polarity = self.reached(level[quarter])?;
                let crossed = |t_ns: f64| self.reached(self.look(state, watch, t_ns).above_log).is_some();
                let at_ns = bisect(at(quarter - 1), at(quarter), crossed);
                Some(Happening { at_ns, polarity, noise: false })
            });
            let noise = (state.clock <= hazard).then(|| {
                let spent = |t_ns: f64| {
                    let middle = self.look(state, watch, 0.5 * (now_ns + t_ns));
                    let end = self.look(state, watch, t_ns);
                    (t_ns - now_ns) * simpson([&start, &middle, &end]) >= state.clock
                };
                let at_ns = bisect(now_ns, now_ns + stride_ns, spent);
                let [off, on] = self.look(state, watch, at_ns).hazard_per_ns;
                let is_on = watch.renewal.polarity * (off + on) < on;
                let polarity = if is_on { Polarity::On } else { Polarity::Off };
                Happening { at_ns, polarity, noise: true }
            });
            match (signal, noise) {
                (Some(signal), Some(noise)) if noise.at_ns < signal.at_ns => return Some(noise),
                (Some(signal), _) => return Some(signal),
                (None, Some(noise)) => return Some(noise),
                (None, None) => {}
            }
            state.clock -= hazard;
            now_ns = if stride_ns == end_ns - now_ns { end_ns } else { now_ns + stride_ns };
            start = looks[4];
            stride_ns *= 2.0;
        }
        None
    }

    fn look(&self, state: &PhysicalState, watch: &Watch, t_ns: f64) -> Look {
        let point = self.point(t_ns);
        let above_log = self.shown_log(&point) + self.leaked_log(t_ns) - state.reference_log;
        if !self.is_noisy() {
            return Look { above_log, ..Look::default() };
        }
        let [p, q] = self.phases(state, watch, t_ns, &point);
        let forgotten = forgotten(p, q).max(0.0);
        let deviation_log = self.sigma_log(&point) * (forgotten * (2.0 - forgotten)).sqrt();
        let mean_log = correlation(p, q) * state.noise_log;
        let [off, on] = self.draws.threshold_log;
        let hazard_per_ns = [off + above_log + mean_log, on - above_log - mean_log].map(|gap_log| {
            if deviation_log == 0.0 {
                return 0.0;
            }
            hazard_per_s(gap_log / deviation_log, point.first_per_s, self.drive.second_pole_per_s) * 1e-9
        });
        let noise_log = mean_log + deviation_log * watch.renewal.z;
        Look { above_log: above_log + noise_log, noise_log, hazard_per_ns }
    }

    fn is_noisy(&self) -> bool {
        self.pixel.noise_gain > 0.0
    }

    fn point(&self, t_ns: f64) -> Point {
        self.response.at(t_ns * 1e-9)
    }

    /// What the photoreceptor shows without noise, nepers.
    fn shown_log(&self, point: &Point) -> f64 {
        self.from_log + point.change_log + point.lag_log
    }

    fn sigma_log(&self, point: &Point) -> f64 {
        let PhysicalPixel { photoreceptor_charge_e, noise_gain, .. } = *self.pixel;
        sigma_log(photoreceptor_charge_e, noise_gain, point.first_per_s, self.drive.second_pole_per_s)
    }

    /// Phases since the renewal (or the hold) began.
    fn phases(&self, state: &PhysicalState, watch: &Watch, t_ns: f64, point: &Point) -> [f64; 2] {
        [
            (state.phases[0] + point.phase - watch.since_phase).max(0.0),
            state.phases[1] + self.drive.second_pole_per_s * (t_ns - watch.since_ns) * 1e-9,
        ]
    }

    /// Fall of the reference since the sub-step's start, nepers.
    fn leaked_log(&self, t_ns: f64) -> f64 {
        let t_s = t_ns * 1e-9;
        let dark = self.pixel.dark_intensity(self.draws.dark_factor);
        let change_log = self.drive.change_log * t_s / self.drive.duration_s;
        let lux_s = self.pixel.lux_per_unit * (self.from * phi(change_log) - dark) * t_s;
        let dark_hz = self.pixel.leak_hz(0.0, self.draws.leak_factor);
        self.sensor.contrast_on * (dark_hz * t_s + self.pixel.leak_per_lux_hz * lux_s)
    }

    /// Speed at which the reference falls, nepers per second.
    fn leak_log_per_s(&self, t_ns: f64) -> f64 {
        let dark = self.pixel.dark_intensity(self.draws.dark_factor);
        let change_log = self.drive.change_log * t_ns * 1e-9 / self.drive.duration_s;
        let lux = self.pixel.lux_per_unit * (self.from * change_log.exp() - dark);
        self.sensor.contrast_on * self.pixel.leak_hz(lux, self.draws.leak_factor)
    }

    /// Polarity of the threshold that a distance from the reference touches or exceeds.
    fn reached(&self, above_log: f64) -> Option<Polarity> {
        [Polarity::Off, Polarity::On].into_iter().find(|&polarity| {
            let threshold = self.draws.threshold_log[polarity as usize];
            f64::from(polarity.sign()) * above_log >= threshold - TOUCH_LOG
        })
    }

    /// Time of a crossing in whole nanoseconds from the sub-step's start.
    fn whole_ns(&self, crossed_ns: f64) -> i64 {
        (crossed_ns.ceil() as i64).clamp(1, self.duration_ns)
    }
}

/// Mean hazard of a stretch by Simpson's rule.
fn simpson(looks: [&Look; 3]) -> f64 {
    (looks[0].hazard() + 4.0 * looks[1].hazard() + looks[2].hazard()) / 6.0
}

/// First instant in `(from, to]` at which `holds`, which does at `to`, to the precision of f64.
fn bisect(from: f64, to: f64, holds: impl Fn(f64) -> bool) -> f64 {
    let (mut from, mut to) = (from, to);
    for _ in 0..60 {
        let middle = 0.5 * (from + to);
        if middle <= from || middle >= to {
            break;
        }
        if holds(middle) {
            to = middle;
        } else {
            from = middle;
        }
    }
    to
}
