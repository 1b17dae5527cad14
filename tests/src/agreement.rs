//! Compares the engine with the oracle: sequences of polarities pixel by pixel, ties, times.

use crate::frames::Sequence;
use crate::run::{Step, events, oracle, oracle_events};
use esaac_model::intensity::weights;
use esaac_model::packet::Event;
use esaac_model::random::{PixelKey, jitter_bound_ns};
use esaac_model::substeps::substep_end_ns;
use esaac_model::{Polarity, SensorModel};
use esaac_oracle::Interval;
use esaac_oracle::cross::PixelConstants;
use std::cell::LazyCell;

/// Tolerance of event times, nanoseconds (a requirement).
pub const TIME_TOLERANCE_NS: f64 = 2_000.0;

/// How far a log intensity of the engine may be from the oracle's, nepers. The engine computes in f32: there the log of
/// an intensity of 1e5 has an ulp of 1e-6, and a position in the image one of 4e-6 pixels. Suite `stages` asserts this
/// tolerance. On a slope `s` it moves an event by the tolerance over `s`. A level this close to a threshold is a tie.
pub const LEVEL_TOLERANCE_LOG: f64 = 1e-5;

/// Result of a comparison.
#[derive(Clone, Debug, Default)]
pub struct Agreement {
    /// Pixels compared.
    pub pixels: usize,
    /// Events of the oracle.
    pub events: usize,
    /// Pixels with another sequence of polarities, or with an event that a tie moved to another sample or crossing.
    pub differing: usize,
    /// Descriptions of differing pixels that no tie explains: no level comes within [`LEVEL_TOLERANCE_LOG`] of a
    /// threshold.
    pub unexplained: Vec<String>,
    /// Descriptions of events whose time differs by more than [`TIME_TOLERANCE_NS`] and the slope allow.
    pub late: Vec<String>,
    /// Events within [`TIME_TOLERANCE_NS`], regardless of their slope.
    pub prompt: usize,
    /// Events whose times were compared.
    pub timed: usize,
}

impl Agreement {
    /// Adds the counts of another comparison.
    pub fn add(&mut self, other: Agreement) {
        self.pixels += other.pixels;
        self.events += other.events;
        self.differing += other.differing;
        self.unexplained.extend(other.unexplained);
        self.late.extend(other.late);
        self.prompt += other.prompt;
        self.timed += other.timed;
    }

    /// Share of events within [`TIME_TOLERANCE_NS`].
    #[must_use]
    pub fn prompt_share(&self) -> f64 {
        self.prompt as f64 / self.timed.max(1) as f64
    }
}

/// Times and polarities of each pixel's events, row by row.
pub type PixelEvents = Vec<Vec<(i64, Polarity)>>;

/// Events of each pixel of an image with so many columns and rows, in the order in which they are given.
#[must_use]
pub fn by_pixel((width_px, height_px): (u32, u32), events: &[Event]) -> PixelEvents {
    let mut pixels = vec![Vec::new(); width_px as usize * height_px as usize];
    for e in events {
        pixels[usize::from(e.y) * width_px as usize + usize::from(e.x)].push((e.t_ns, e.polarity));
    }
    pixels
}

/// Polarities of a pixel's events.
pub fn polarities(events: &[(i64, Polarity)]) -> impl Iterator<Item = Polarity> + '_ {
    events.iter().map(|e| e.1)
}

/// A stretch of time in which a pixel's log intensity, together with its leak, is linear.
pub struct Stretch {
    /// Start, nanoseconds.
    pub start_ns: i64,
    /// End, nanoseconds.
    pub end_ns: i64,
    /// Slope, nepers per nanosecond.
    pub slope_per_ns: f64,
}

/// How an event's stamp follows from when it happened. Where a sensor changes during a run, the widest of all.
#[derive(Clone, Copy, Debug)]
pub struct Stamps {
    /// Shortest and longest latency, nanoseconds.
    latency_ns: (i64, i64),
    /// How far the jitter and the flooring may move a stamp, nanoseconds.
    spread_ns: i64,
    quantum_ns: u32,
    refractory_ns: u32,
    /// Whether events set the reference from the level of an instant.
    sets_anew: bool,
}

impl Stamps {
    /// Stamps of a run with these sensors, one after the other.
    #[must_use]
    pub fn of<'a>(sensors: impl IntoIterator<Item = &'a SensorModel>) -> Self {
        let mut stamps = Stamps {
            latency_ns: (i64::MAX, 0),
            spread_ns: 0,
            quantum_ns: 1,
            refractory_ns: 0,
            sets_anew: false,
        };
        for sensor in sensors {
            let latency_ns = i64::from(sensor.latency_ns);
            let spread_ns =
                jitter_bound_ns(sensor.latency_jitter_ns) + i64::from(sensor.timestamp_quantum_ns);
            stamps.latency_ns.0 = stamps.latency_ns.0.min(latency_ns);
            stamps.latency_ns.1 = stamps.latency_ns.1.max(latency_ns);
            stamps.spread_ns = stamps.spread_ns.max(spread_ns);
            stamps.quantum_ns = stamps.quantum_ns.max(sensor.timestamp_quantum_ns);
            stamps.refractory_ns = stamps.refractory_ns.max(sensor.refractory_ns);
            stamps.sets_anew |= sensor.refractory_ns > 0 || sensor.shot_noise_rate_hz > 0.0;
        }
        stamps
    }
}

/// How the times of a pixel's events compare.
#[derive(Default)]
struct Times {
    timed: usize,
    prompt: usize,
    late: Vec<String>,
}

/// What a stream of events is compared with.
pub struct Reference<'a> {
    /// Columns and rows.
    pub size_px: (u32, u32),
    /// How stamps follow from times.
    pub stamps: Stamps,
    /// How far a log intensity may be from the reference's, nepers.
    pub level_tolerance_log: f64,
    /// The events.
    pub events: &'a [Event],
    /// The stretches of a pixel's log intensity, in order of time.
    pub stretches: &'a dyn Fn(usize) -> Vec<Stretch>,
    /// What may be moved so that a tie falls the other way; see [`perturbations`].
    pub perturbations: Vec<Perturbation>,
    /// Events of a run in which that is moved. Each is asked for once at most, and only if a pixel differs.
    pub perturbed: &'a dyn Fn(Perturbation) -> Vec<Event>,
}

/// Compares a run of the engine with the oracle on the same frames.
#[must_use]
pub fn compare(sensor: &SensorModel, camera: u32, sequence: &Sequence, steps: &[Step]) -> Agreement {
    let intervals = oracle(sensor, camera, sequence);
    compare_streams(sensor, camera, sequence, &intervals, &events(steps))
}

/// As [`compare`], for given streams.
#[must_use]
pub fn compare_streams(
    sensor: &SensorModel,
    camera: u32,
    sequence: &Sequence,
    intervals: &[Interval],
    engine: &[Event],
) -> Agreement {
    let light = Light { sensor, camera, sequence, intervals };
    let run = |moved: &SensorModel| oracle_events(&oracle(moved, camera, sequence));
    let perturbed = |moved: Perturbation| run(&moved.of(sensor));
    Reference {
        size_px: (sensor.width, sensor.height),
        stamps: Stamps::of([sensor]),
        level_tolerance_log: LEVEL_TOLERANCE_LOG,
        events: &oracle_events(intervals),
        stretches: &|pixel| light.stretches(pixel),
        perturbations: perturbations(LEVEL_TOLERANCE_LOG).collect(),
        perturbed: &perturbed,
    }
    .compare(engine)
}

impl Reference<'_> {
    /// Compares a stream of the engine with the reference.
    #[must_use]
    pub fn compare(&self, engine: &[Event]) -> Agreement {
        let expected = by_pixel(self.size_px, self.events);
        let actual = by_pixel(self.size_px, engine);
        let mut got = Agreement { pixels: expected.len(), ..Agreement::default() };
        let run = |moved: Perturbation| by_pixel(self.size_px, &(self.perturbed)(moved));
        let perturbed: Vec<LazyCell<PixelEvents, _>> =
            self.perturbations.iter().map(|&moved| LazyCell::new(move || run(moved))).collect();
        for (pixel, (expected, actual)) in expected.iter().zip(&actual).enumerate() {
            got.events += expected.len();
            let same = |run: &[(i64, Polarity)]| polarities(run).eq(polarities(actual));
            if same(expected) {
                let times = self.compare_times(pixel, expected, actual);
                // A tie moves an event to another sample, or to another crossing of the same threshold.
                let is_tie = |run: &LazyCell<PixelEvents, _>| {
                    let run = &run[pixel];
                    same(run) && self.compare_times(pixel, run, actual).late.is_empty()
                };
                got.timed += times.timed;
                got.prompt += times.prompt;
                if !times.late.is_empty() && perturbed.iter().any(is_tie) {
                    got.differing += 1;
                } else {
                    got.late.extend(times.late);
                }
                continue;
            }
            got.differing += 1;
            if !perturbed.iter().any(|run| same(&run[pixel])) {
                got.unexplained.push(format!(
                    "pixel ({}, {}): oracle {}, engine {}",
                    pixel % self.size_px.0 as usize,
                    pixel / self.size_px.0 as usize,
                    show(expected),
                    show(actual)
                ));
            }
        }
        got
    }

    /// Compares event times. A crossing moves by the level's error over its slope. If the reference is set from the
    /// level of an instant (refractory period, shot noise), the error at that instant adds to the error of the level
    /// from then on.
    fn compare_times(&self, pixel: usize, expected: &[(i64, Polarity)], actual: &[(i64, Polarity)]) -> Times {
        let mut got = Times::default();
        if expected.is_empty() {
            return got;
        }
        let Stamps { latency_ns, spread_ns, refractory_ns, .. } = self.stamps;
        let stretches = (self.stretches)(pixel);
        // Flooring moves the stamps of two neighbouring times apart by at most one quantum.
        let quantum_ns = f64::from(self.stamps.quantum_ns - 1);
        let mut level_error = self.level_tolerance_log;
        for (e, a) in expected.iter().zip(actual) {
            let error_ns = (e.0 - a.0).abs() as f64;
            let (earliest_ns, latest_ns) = (e.0 - latency_ns.1 - spread_ns, e.0 - latency_ns.0 + spread_ns);
            let around = |from_ns: i64, to_ns: i64| {
                stretches.iter().filter(move |s| s.start_ns <= to_ns && s.end_ns >= from_ns)
            };
            let near = around(earliest_ns, latest_ns);
            let slope = near.map(|s| s.slope_per_ns.abs()).fold(f64::INFINITY, f64::min);
            let allowed_ns = TIME_TOLERANCE_NS + quantum_ns + level_error / slope;
            got.timed += 1;
            got.prompt += usize::from(error_ns <= TIME_TOLERANCE_NS + quantum_ns);
            if error_ns > allowed_ns {
                got.late.push(format!(
                    "pixel {pixel}: oracle {}, engine {}, allowed {allowed_ns:.0} ns; of {} and {}",
                    e.0,
                    a.0,
                    show(expected),
                    show(actual)
                ));
            }
            if self.stamps.sets_anew {
                let until_ns = latest_ns + i64::from(refractory_ns);
                let steepest =
                    around(earliest_ns, until_ns).map(|s| s.slope_per_ns.abs()).fold(0.0, f64::max);
                // Two times that are a quantum apart may have one stamp.
                level_error = self.level_tolerance_log + steepest * (error_ns + quantum_ns).max(1.0);
            }
        }
        got
    }
}

fn show(events: &[(i64, Polarity)]) -> String {
    let one = |&(t_ns, p): &(i64, Polarity)| format!("{}{t_ns}", if p == Polarity::On { '+' } else { '-' });
    events.iter().map(one).collect::<Vec<_>>().join(" ")
}

/// What events follow from, moved by as much as it is exact to: thresholds or motion vectors.
#[derive(Clone, Copy, Debug, Default)]
pub struct Perturbation {
    on_log: f64,
    off_log: f64,
    /// By how much motion vectors are moved, pixels, if they are. What a position in single precision cannot tell from rest is
    /// rest then.
    pub vectors_px: Option<[f64; 2]>,
}

impl Perturbation {
    /// A sensor with these thresholds.
    #[must_use]
    pub fn of(&self, sensor: &SensorModel) -> SensorModel {
        let contrast_on = sensor.contrast_on + self.on_log;
        let contrast_off = sensor.contrast_off + self.off_log;
        SensorModel { contrast_on, contrast_off, ..sensor.clone() }
    }
}

/// Each of the thresholds ON and OFF up, down or not at all, but not neither, by the tolerance and by less. If a run of the
/// oracle with such thresholds gives another sequence, some level came within the tolerance of a threshold: a tie. Each
/// event moves the reference by its threshold, so that over hundreds of events only small moves leave all but the tie as
/// they are.
pub fn perturbations(tolerance_log: f64) -> impl Iterator<Item = Perturbation> {
    [1.0, 0.1, 0.01].into_iter().flat_map(move |part| {
        let moves = [-part * tolerance_log, 0.0, part * tolerance_log];
        let pairs = moves.into_iter().flat_map(move |on_log| {
            moves.map(move |off_log| Perturbation { on_log, off_log, vectors_px: None })
        });
        pairs.filter(|moved| (moved.on_log, moved.off_log) != (0.0, 0.0))
    })
}

/// Vectors moved by as much as a position is exact to, in each of eight directions and not at all. They say where a level is
/// read, through steps that multiply an error where vectors differ. A level that such a move changes much is one on a steep
/// edge, or a tie of positions: from cell to cell of samples the range changes that a level is clamped to.
pub fn moved_vectors(exact_px: f64) -> impl Iterator<Item = Perturbation> {
    let moves = [0.0, -exact_px, exact_px];
    let pairs = moves.into_iter().flat_map(move |across| moves.map(move |down| [across, down]));
    pairs.map(|by_px| Perturbation { vectors_px: Some(by_px), ..Perturbation::default() })
}

/// Log intensity of every pixel over time, according to the oracle.
struct Light<'a> {
    sensor: &'a SensorModel,
    camera: u32,
    sequence: &'a Sequence,
    intervals: &'a [Interval],
}

impl Light<'_> {
    fn first_log(&self, pixel: usize) -> f64 {
        let width = self.sensor.width as usize;
        let weights = weights(self.sensor.intensity, (pixel % width) as u32, (pixel / width) as u32);
        let rgb = self.sequence.hdr.decode(&self.sequence.frames[0].hdr, pixel);
        let sum: f64 = weights.iter().zip(rgb).map(|(w, c)| w * c).sum();
        (sum * self.sensor.exposure_gain + self.sensor.log_offset).ln()
    }

    /// The stretches of a pixel's log intensity plus its leak.
    fn stretches(&self, pixel: usize) -> Vec<Stretch> {
        let key = PixelKey { seed: self.sensor.seed, camera: self.camera, pixel: pixel as u32 };
        let leak_per_ns = PixelConstants::draw(self.sensor, key).leak_log_per_ns;
        let mut stretches = Vec::new();
        let mut from = self.first_log(pixel);
        for (interval, frames) in self.intervals[1..].iter().zip(self.sequence.frames.windows(2)) {
            let samples = interval.samples.as_ref().expect("runs keep samples").at(pixel);
            let interval_ns = (frames[1].t_ns - frames[0].t_ns) as u32;
            for (i, sample) in (1..).zip(samples) {
                let end =
                    |i| frames[0].t_ns + i64::from(substep_end_ns(interval_ns, i, samples.len() as u32));
                let (start_ns, end_ns) = (end(i - 1), end(i));
                let to = (sample + self.sensor.log_offset).ln();
                let slope_per_ns = (to - from) / (end_ns - start_ns) as f64 + leak_per_ns;
                stretches.push(Stretch { start_ns, end_ns, slope_per_ns });
                from = to;
            }
        }
        stretches
    }
}
