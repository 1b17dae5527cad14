//! Thresholds, mismatch and noise from sums over pixels and intervals.

use anyhow::{Result, ensure};
use esaac_formats::recording::{Aps, Recording};
use esaac_model::packet::Event;
use esaac_model::{Polarity, SHOT_NOISE_FALL};
use serde::Serialize;

/// Fractions of full scale between which a frame's pixel tells the light: above its noise, below saturation.
const USABLE: (f32, f32) = (0.03, 0.97);

/// A pixel counts as still where its log intensity and its neighbours' change by less than this from frame to frame.
const STILL_LOG: f64 = 0.05;

/// A change is clear from this many thresholds on.
const CLEAR_THRESHOLDS: f64 = 2.0;

/// The first guess of both thresholds.
const FIRST_GUESS_LOG: f64 = 0.25;

/// Least observed time of still pixels. With less, rates below a hertz cannot be estimated.
pub(super) const ENOUGH_STILL_PIXEL_S: f64 = 100.0;

/// The result of [`estimate`].
#[derive(Clone, Debug, Serialize)]
pub struct Estimate {
    /// ON threshold, log intensity.
    pub contrast_on: f64,
    /// OFF threshold, log intensity.
    pub contrast_off: f64,
    /// Standard deviation of a pixel's threshold as a share of it.
    pub mismatch: f64,
    /// Correlation of `dL` with `C_on n_on - C_off n_off`.
    pub correlation: f64,
    /// Number of samples in the sums: usable pixels of all intervals.
    pub samples: usize,
    /// Events of still pixels.
    pub still: Still,
}

/// Events of still pixels.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Still {
    /// Observed time in seconds, summed over pixels.
    pub pixel_s: f64,
    /// The same, each pixel weighted by the model's relative shot noise at its brightness.
    pub shot_weighted_s: f64,
    /// Number of ON events.
    pub on: f64,
    /// Number of OFF events.
    pub off: f64,
}

/// Noise rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// The sensor's `leak_rate_hz`.
    pub leak_rate_hz: f64,
    /// The sensor's `shot_noise_rate_hz`.
    pub shot_noise_rate_hz: f64,
}

impl Still {
    /// Rates that explain the counts; `None` if too few pixels are still. A shot event resets the reference, so
    /// a leak event needs a time of `1 / leak` without one. With `h` shot events a second, there are
    /// `h / (exp(h / leak) - 1)` leak events a second.
    #[must_use]
    pub fn noise(&self) -> Option<Noise> {
        if self.pixel_s < ENOUGH_STILL_PIXEL_S {
            return None;
        }
        let (on_hz, off_hz) = (self.on / self.pixel_s, self.off / self.pixel_s);
        let shot_hz = 2.0 * off_hz;
        let excess_hz = on_hz - off_hz;
        let leak_rate_hz = match (excess_hz > 0.0, shot_hz > 0.0) {
            (false, _) => 0.0,
            (true, false) => excess_hz,
            (true, true) => shot_hz / (1.0 + shot_hz / excess_hz).ln(),
        };
        Some(Noise { leak_rate_hz, shot_noise_rate_hz: 2.0 * self.off / self.shot_weighted_s })
    }
}

/// One pixel between two frames.
struct Sample {
    pixel: u32,
    interval: u32,
    dl: f64,
    on: f32,
    off: f32,
}

/// Estimates thresholds, mismatch and noise from events and a recording's frames. `log_offset` belongs to the frames'
/// intensities, full scale being 1. Fails if the sums do not determine both thresholds.
pub fn estimate(recording: &Recording, events: &[Event], log_offset: f64) -> Result<Estimate> {
    let logs: Vec<Vec<f64>> = recording
        .frames
        .iter()
        .map(|f| f.pixels.iter().map(|&v| (f64::from(v) + log_offset).ln()).collect())
        .collect();
    let samples = samples(recording, events, &logs);
    let still = still(recording, events, &logs);
    let (mut on, mut off) = (FIRST_GUESS_LOG, FIRST_GUESS_LOG);
    for _ in 0..10 {
        (on, off) = thresholds(&samples, CLEAR_THRESHOLDS * 0.5 * (on + off))?;
    }
    let pairs: Vec<(f64, f64)> =
        samples.iter().map(|s| (s.dl, on * f64::from(s.on) - off * f64::from(s.off))).collect();
    let halves = recording.frames.len() as u32 / 2;
    Ok(Estimate {
        contrast_on: on,
        contrast_off: off,
        mismatch: mismatch(&samples, recording, (on, off), halves),
        correlation: correlation(&pairs),
        samples: samples.len(),
        still,
    })
}

fn usable(frame: &Aps, pixel: usize) -> bool {
    (USABLE.0..=USABLE.1).contains(&frame.pixels[pixel])
}

/// Every usable pixel of every interval, with the events between the middles of the exposures.
fn samples(recording: &Recording, events: &[Event], logs: &[Vec<f64>]) -> Vec<Sample> {
    let width = recording.width_px as usize;
    let pixels = width * recording.height_px as usize;
    let mut samples = Vec::new();
    for interval in 0..recording.frames.len() - 1 {
        let [start, end] = [&recording.frames[interval], &recording.frames[interval + 1]];
        let mut counts = vec![[0.0_f32; 2]; pixels];
        for event in between(events, start.middle_ns(), end.middle_ns()) {
            let pixel = usize::from(event.y) * width + usize::from(event.x);
            counts[pixel][usize::from(event.polarity == Polarity::On)] += 1.0;
        }
        for (pixel, [off, on]) in counts.into_iter().enumerate() {
            if usable(start, pixel) && usable(end, pixel) {
                let dl = logs[interval + 1][pixel] - logs[interval][pixel];
                samples.push(Sample { pixel: pixel as u32, interval: interval as u32, dl, on, off });
            }
        }
    }
    samples
}

fn between(events: &[Event], start_ns: i64, end_ns: i64) -> &[Event] {
    let from = events.partition_point(|e| e.t_ns <= start_ns);
    let to = events.partition_point(|e| e.t_ns <= end_ns);
    &events[from..to.max(from)]
}

/// Solves the two sums for the two thresholds.
fn thresholds(samples: &[Sample], clear_log: f64) -> Result<(f64, f64)> {
    // Rows: dL clearly up, clearly down; columns: sums of dL, of ON, of OFF.
    let mut sums = [[0.0_f64; 3]; 2];
    for s in samples.iter().filter(|s| s.dl.abs() >= clear_log) {
        let row = &mut sums[usize::from(s.dl < 0.0)];
        for (sum, value) in row.iter_mut().zip([s.dl, f64::from(s.on), f64::from(s.off)]) {
            *sum += value;
        }
    }
    let [[up, up_on, up_off], [down, down_on, down_off]] = sums;
    let most = |sign: f64| samples.iter().map(|s| sign * s.dl).fold(0.0, f64::max);
    ensure!(
        up > 0.0 && down < 0.0,
        "no thresholds follow from the recording: from one APS frame to the next, pixels grow brighter by at most {:.2} \
         log and darker by at most {:.2}, expected many that change by {clear_log:.2} or more (two thresholds) either way; \
         record faster motion or more contrast",
        most(1.0),
        most(-1.0)
    );
    let determinant = up_on * down_off - up_off * down_on;
    ensure!(
        determinant.abs() > 1e-9 && up_on > 0.0 && down_off > 0.0,
        "no thresholds follow from the recording: where it grows brighter by {clear_log:.2} log or more there are \
         {up_on} ON and {up_off} OFF events, where it grows darker {down_on} and {down_off}; expected many ON and \
         few OFF, and the reverse"
    );
    let on = (up * down_off - up_off * down) / determinant;
    let off = (up * down_on - up_on * down) / determinant;
    ensure!(on > 0.0 && off > 0.0, "the thresholds come out as {on:.3} and {off:.3}, expected both above 0");
    Ok((on, off))
}

/// Relative spread of thresholds over pixels, from the covariance of each pixel's count error in the first half of the
/// recording with its error in the second half. Rounding and noise of the halves are independent and cancel. The
/// pixel's own threshold is in both halves and remains.
fn mismatch(samples: &[Sample], recording: &Recording, (on, off): (f64, f64), half: u32) -> f64 {
    let pixels = recording.width_px as usize * recording.height_px as usize;
    // [half][polarity]: error of the counts, and expected change.
    let mut missed = vec![[[0.0_f64; 2]; 2]; pixels];
    let mut expected = vec![[[0.0_f64; 2]; 2]; pixels];
    for s in samples.iter().filter(|s| s.interval != half) {
        let polarity = usize::from(s.dl > 0.0);
        let (c, n, against) = if s.dl > 0.0 { (on, s.on, s.off) } else { (off, s.off, s.on) };
        if against > 0.0 || s.dl.abs() < c {
            continue;
        }
        let h = usize::from(s.interval > half);
        missed[s.pixel as usize][h][polarity] += s.dl.abs() - c * f64::from(n);
        expected[s.pixel as usize][h][polarity] += s.dl.abs();
    }
    let mut variance = 0.0;
    for polarity in 0..2 {
        let of = |values: &[[[f64; 2]; 2]], h: usize| values.iter().map(|v| v[h][polarity]).sum::<f64>();
        // The mean error comes from the thresholds themselves and from pixels that changed direction.
        let share: [f64; 2] = [0, 1].map(|h| of(&missed, h) / of(&expected, h).max(1e-9));
        let (mut product, mut weight) = (0.0, 0.0);
        for (missed, expected) in missed.iter().zip(&expected) {
            let rest = |h: usize| missed[h][polarity] - share[h] * expected[h][polarity];
            product += rest(0) * rest(1);
            weight += expected[0][polarity] * expected[1][polarity];
        }
        variance += 0.5 * product / weight.max(1e-9);
    }
    variance.max(0.0).sqrt()
}

/// Events of pixels that are still: they and all their neighbours, in this interval and in the ones before and after
/// it.
fn still(recording: &Recording, events: &[Event], logs: &[Vec<f64>]) -> Still {
    let (width, height) = (recording.width_px as usize, recording.height_px as usize);
    let intervals = recording.frames.len() - 1;
    let quiet: Vec<Vec<bool>> = (0..intervals)
        .map(|k| (0..width * height).map(|p| (logs[k + 1][p] - logs[k][p]).abs() < STILL_LOG).collect())
        .collect();
    let mut still = Still::default();
    for interval in 0..intervals {
        let around = interval.saturating_sub(1)..(interval + 2).min(intervals);
        let stands: Vec<bool> = (0..width * height)
            .map(|p| {
                let (x, y) = (p % width, p / width);
                let rows = y.saturating_sub(1)..(y + 2).min(height);
                let columns = x.saturating_sub(1)..(x + 2).min(width);
                around.clone().all(|k| rows.clone().all(|y| columns.clone().all(|x| quiet[k][y * width + x])))
            })
            .collect();
        let [start, end] = [&recording.frames[interval], &recording.frames[interval + 1]];
        let seconds = (end.middle_ns() - start.middle_ns()) as f64 * 1e-9;
        for (pixel, _) in stands.iter().enumerate().filter(|(_, stands)| **stands) {
            still.pixel_s += seconds;
            let of_white = f64::from(start.pixels[pixel]).clamp(0.0, 1.0);
            still.shot_weighted_s += seconds * (1.0 - SHOT_NOISE_FALL * of_white);
        }
        for event in between(events, start.middle_ns(), end.middle_ns()) {
            if stands[usize::from(event.y) * width + usize::from(event.x)] {
                match event.polarity {
                    Polarity::On => still.on += 1.0,
                    Polarity::Off => still.off += 1.0,
                }
            }
        }
    }
    still
}

/// Pearson's correlation; 0 if one of the two does not vary.
fn correlation(points: &[(f64, f64)]) -> f64 {
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / points.len().max(1) as f64;
    let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
    let sum = |of: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>();
    let (sxx, syy) = (sum(&|p| (p.0 - mx).powi(2)), sum(&|p| (p.1 - my).powi(2)));
    let sxy = sum(&|p| (p.0 - mx) * (p.1 - my));
    if sxx * syy > 0.0 { sxy / (sxx * syy).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_follow_from_counts_with_and_without_shot_noise() {
        let still = |on: f64, off: f64| Still { pixel_s: 1000.0, shot_weighted_s: 500.0, on, off };
        let leak_alone = still(100.0, 0.0).noise().unwrap();
        assert_eq!((leak_alone.leak_rate_hz, leak_alone.shot_noise_rate_hz), (0.1, 0.0));
        // A hertz of each polarity and leak of 2 Hz: 2 / (e - 1) leak events a second.
        let excess = 1000.0 * 2.0 / (1_f64.exp() - 1.0);
        let both = still(1000.0 + excess, 1000.0).noise().unwrap();
        assert!((both.leak_rate_hz - 2.0).abs() < 1e-9, "{both:?}");
        assert_eq!(both.shot_noise_rate_hz, 4.0, "weighted with light");
        assert_eq!(still(500.0, 600.0).noise().unwrap().leak_rate_hz, 0.0);
        assert_eq!(Still { pixel_s: 1.0, ..still(1.0, 1.0) }.noise(), None);
    }

    #[test]
    fn two_sums_give_two_thresholds() {
        let sample = |dl: f64, on: f32, off: f32| Sample { pixel: 0, interval: 0, dl, on, off };
        let samples = [sample(0.8, 5.0, 1.0), sample(-0.6, 0.0, 3.0), sample(0.01, 9.0, 9.0)];
        let (on, off) = thresholds(&samples, 0.3).unwrap();
        assert!((on - 0.2).abs() < 1e-9 && (off - 0.2).abs() < 1e-9, "{on} {off}");
        let error = thresholds(&samples[2..], 0.3).unwrap_err().to_string();
        assert!(
            error.contains("brighter by at most 0.01 log and darker by at most 0.00, expected"),
            "{error}"
        );
        let silent = [sample(0.8, 0.0, 0.0), sample(-0.6, 0.0, 0.0)];
        let error = thresholds(&silent, 0.3).unwrap_err().to_string();
        assert!(error.contains("there are 0 ON and 0 OFF events"), "{error}");
    }

    #[test]
    fn correlation_is_one_on_a_line_and_zero_without_variation() {
        assert!((correlation(&[(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)]) - 1.0).abs() < 1e-12);
        assert_eq!(correlation(&[(0.0, 1.0), (0.0, 3.0)]), 0.0);
    }
}
