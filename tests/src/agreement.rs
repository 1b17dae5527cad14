//! Compares the engine with the oracle: sequences of polarities pixel by pixel, ties, times.

use crate::frames::Sequence;
use crate::run::{Step, events, oracle, oracle_events};
use esaac_model::intensity::weights;
use esaac_model::packet::Event;
use esaac_model::random::{PixelKey, jitter_bound_ns};
use esaac_model::substeps::substep_end_ns;
use esaac_model::{Polarity, SensorModel, Timestamps};
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
    /// Pixels with another sequence of polarities. With time stamps at samples, also pixels with an event that a tie
    /// moved to another sample.
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

type PixelEvents = Vec<Vec<(i64, Polarity)>>;

fn by_pixel(sensor: &SensorModel, events: &[Event]) -> PixelEvents {
    let mut pixels = vec![Vec::new(); sensor.pixels()];
    for e in events {
        pixels[usize::from(e.y) * sensor.width as usize + usize::from(e.x)].push((e.t_ns, e.polarity));
    }
    pixels
}

fn polarities(events: &[(i64, Polarity)]) -> impl Iterator<Item = Polarity> + '_ {
    events.iter().map(|e| e.1)
}

/// Whether two streams of a pixel have the same polarities, and the same times within the tolerance.
fn same_times(sensor: &SensorModel, a: &[(i64, Polarity)], b: &[(i64, Polarity)]) -> bool {
    let tolerance_ns = TIME_TOLERANCE_NS as u64 + u64::from(sensor.timestamp_quantum_ns - 1);
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.1 == b.1 && a.0.abs_diff(b.0) <= tolerance_ns)
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
    let expected = by_pixel(sensor, &oracle_events(intervals));
    let actual = by_pixel(sensor, engine);
    let light = Light::new(sensor, camera, sequence, intervals);
    let mut got = Agreement { pixels: sensor.pixels(), ..Agreement::default() };
    let perturbed = LazyCell::new(|| perturbed_runs(sensor, camera, sequence));
    for pixel in 0..sensor.pixels() {
        let (expected, actual) = (&expected[pixel], &actual[pixel]);
        got.events += expected.len();
        if polarities(expected).eq(polarities(actual)) {
            let late_before = got.late.len();
            light.compare_times(pixel, expected, actual, &mut got);
            // With time stamps at samples, a tie moves an event to the next sample.
            if sensor.timestamps == Timestamps::AtSample
                && got.late.len() > late_before
                && perturbed.iter().any(|run| same_times(sensor, &run[pixel], actual))
            {
                got.late.truncate(late_before);
                got.differing += 1;
            }
            continue;
        }
        got.differing += 1;
        if !perturbed.iter().any(|run| polarities(&run[pixel]).eq(polarities(actual))) {
            got.unexplained.push(format!(
                "pixel ({}, {}): oracle {}, engine {}",
                pixel % sensor.width as usize,
                pixel / sensor.width as usize,
                show(expected),
                show(actual)
            ));
        }
    }
    got
}

fn show(events: &[(i64, Polarity)]) -> String {
    let one = |&(t_ns, p): &(i64, Polarity)| format!("{}{t_ns}", if p == Polarity::On { '+' } else { '-' });
    events.iter().map(one).collect::<Vec<_>>().join(" ")
}

/// Runs the oracle with thresholds moved by the tolerance: each of ON and OFF up, down or not at all. If such a run
/// gives another sequence, some level came within the tolerance of a threshold: a tie.
fn perturbed_runs(sensor: &SensorModel, camera: u32, sequence: &Sequence) -> Vec<PixelEvents> {
    let moves = [-LEVEL_TOLERANCE_LOG, 0.0, LEVEL_TOLERANCE_LOG];
    let pairs = moves.into_iter().flat_map(|on| moves.into_iter().map(move |off| (on, off)));
    pairs
        .filter(|&pair| pair != (0.0, 0.0))
        .map(|(on, off)| {
            let contrast_on = sensor.contrast_on + on;
            let contrast_off = sensor.contrast_off + off;
            let moved = SensorModel { contrast_on, contrast_off, ..sensor.clone() };
            by_pixel(sensor, &oracle_events(&oracle(&moved, camera, sequence)))
        })
        .collect()
}

/// A stretch of time in which a pixel's log intensity is linear.
struct Stretch {
    start_ns: i64,
    end_ns: i64,
    slope_per_ns: f64,
}

/// Log intensity of every pixel over time, according to the oracle.
struct Light<'a> {
    sensor: &'a SensorModel,
    camera: u32,
    sequence: &'a Sequence,
    intervals: &'a [Interval],
}

impl<'a> Light<'a> {
    fn new(sensor: &'a SensorModel, camera: u32, sequence: &'a Sequence, intervals: &'a [Interval]) -> Self {
        Light { sensor, camera, sequence, intervals }
    }

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

    /// Compares event times. A crossing moves by the level's error over its slope. If the reference is set from the
    /// level of an instant (refractory period, shot noise), the error at that instant adds to the error of the level
    /// from then on.
    fn compare_times(
        &self,
        pixel: usize,
        expected: &[(i64, Polarity)],
        actual: &[(i64, Polarity)],
        got: &mut Agreement,
    ) {
        if expected.is_empty() {
            return;
        }
        let sensor = self.sensor;
        let stretches = self.stretches(pixel);
        let sets_anew = sensor.refractory_ns > 0 || sensor.shot_noise_rate_hz > 0.0;
        let spread_ns = jitter_bound_ns(sensor.latency_jitter_ns) + i64::from(sensor.timestamp_quantum_ns);
        let latency_ns = i64::from(sensor.latency_ns);
        // Flooring moves the stamps of two neighbouring times apart by at most one quantum.
        let quantum_ns = f64::from(sensor.timestamp_quantum_ns - 1);
        let mut level_error = LEVEL_TOLERANCE_LOG;
        for (e, a) in expected.iter().zip(actual) {
            let error_ns = (e.0 - a.0).abs() as f64;
            let happened_ns = e.0 - latency_ns;
            let around = |from_ns: i64, to_ns: i64| {
                stretches.iter().filter(move |s| s.start_ns <= to_ns && s.end_ns >= from_ns)
            };
            let near = around(happened_ns - spread_ns, happened_ns + spread_ns);
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
            if sets_anew {
                let until_ns = happened_ns + i64::from(sensor.refractory_ns) + spread_ns;
                let steepest = around(happened_ns - spread_ns, until_ns)
                    .map(|s| s.slope_per_ns.abs())
                    .fold(0.0, f64::max);
                level_error = LEVEL_TOLERANCE_LOG + steepest * error_ns.max(1.0);
            }
        }
    }
}
