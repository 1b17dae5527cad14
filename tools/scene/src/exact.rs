//! Exact events: the crossings of a pixel's log intensity, found on the closed form itself.
//!
//! The crossing rule is the model's, without sub-steps and without noise. The reference starts at the log intensity of
//! the start time, moves by one threshold per event, and is set to the current log intensity at the end of a refractory
//! period. Times are within [`TIME_ERROR_S`] of the crossing of the closed form.

use crate::scene::{Scene, seconds};
use crate::view::View;
use esaac_model::packet::{Event, Polarity};
use esaac_model::{SensorModel, intensity};
use std::thread;

/// Largest error of an event's time, seconds.
pub const TIME_ERROR_S: f64 = 2e-9;

/// Samples per second of the time grid that all pixels share. Between two samples the texture moves by a fraction of a
/// cycle. Halving finds finer structure.
const GRID_HZ: f64 = 960.0;

/// A piece of the curve is halved while its middle differs from its chord by more than this, nepers.
const CURVATURE_LOG: f64 = 0.01;

/// Shortest piece that is halved, seconds.
const SHORTEST_S: f64 = 1e-6;

/// Log intensity of a pixel of `sensor` in a view, nepers: `L = ln(S + log_offset)`.
#[must_use]
pub fn log_intensity(view: &View, sensor: &SensorModel, x: u32, y: u32) -> f64 {
    let rgb = view.radiance(f64::from(x), f64::from(y));
    let weights = intensity::weights(sensor.intensity, x, y);
    let sum: f64 = rgb.iter().zip(weights).map(|(c, w)| c * w).sum();
    (sum * sensor.exposure_gain + sensor.log_offset).ln()
}

/// Every pixel `(x, y)` of a scene, row by row.
pub fn all_pixels(scene: &Scene) -> impl Iterator<Item = (u32, u32)> + use<> {
    let (width_px, height_px) = (scene.width_px, scene.height_px);
    (0..height_px).flat_map(move |y| (0..width_px).map(move |x| (x, y)))
}

/// Events of each pixel in `(t0_ns, t1_ns]`, in time order. The reference starts at the log intensity of `t0_ns`.
/// Thresholds, intensity, gain, offset and refractory period are the sensor's. Noise, mismatch, latency and
/// quantisation are left out. Times are rounded up to whole nanoseconds.
#[must_use]
pub fn exact_events(
    scene: &Scene,
    sensor: &SensorModel,
    pixels: &[(u32, u32)],
    t0_ns: i64,
    t1_ns: i64,
) -> Vec<Vec<Event>> {
    let (t0_s, t1_s) = (seconds(t0_ns), seconds(t1_ns));
    let pieces = ((t1_s - t0_s) * GRID_HZ).ceil().max(1.0) as usize;
    let grid: Vec<(f64, View)> = (0..=pieces)
        .map(|i| t0_s + (t1_s - t0_s) * i as f64 / pieces as f64)
        .map(|t_s| (t_s, scene.view(t_s)))
        .collect();
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let share = pixels.len().div_ceil(threads).max(1);
    let events_of = |&(x, y): &(u32, u32)| {
        let curve = Curve { scene, sensor, x, y };
        curve
            .events(&grid)
            .into_iter()
            .map(|(t_s, polarity)| Event {
                t_ns: t0_ns + ((t_s - t0_s) * 1e9).ceil() as i64,
                y: y as u16,
                x: x as u16,
                polarity,
            })
            .collect()
    };
    thread::scope(|scope| {
        let workers: Vec<_> = pixels
            .chunks(share)
            .map(|chunk| scope.spawn(move || chunk.iter().map(events_of).collect::<Vec<Vec<Event>>>()))
            .collect();
        workers.into_iter().flat_map(|w| w.join().expect("root finding is plain arithmetic")).collect()
    })
}

/// Log intensity of one pixel over time.
struct Curve<'a> {
    scene: &'a Scene,
    sensor: &'a SensorModel,
    x: u32,
    y: u32,
}

type Point = (f64, f64);

impl Curve<'_> {
    fn at(&self, t_s: f64) -> f64 {
        log_intensity(&self.scene.view(t_s), self.sensor, self.x, self.y)
    }

    fn events(&self, grid: &[(f64, View)]) -> Vec<(f64, Polarity)> {
        let coarse: Vec<Point> =
            grid.iter().map(|(t_s, view)| (*t_s, log_intensity(view, self.sensor, self.x, self.y))).collect();
        let first = coarse[0].1;
        // A flat curve has no events. In a still scene the grid suffices to see that, which saves the refinement.
        if coarse.iter().all(|&(_, log)| log == first) {
            return Vec::new();
        }
        let points = self.with_extrema(&self.refined(&coarse));
        let refractory_s = f64::from(self.sensor.refractory_ns) * 1e-9;
        let mut events = Vec::new();
        let mut reference = first;
        let mut held_until_s = f64::NEG_INFINITY;
        for pair in points.windows(2) {
            let (mut start, end) = (pair[0], pair[1]);
            loop {
                if held_until_s > start.0 {
                    if held_until_s > end.0 {
                        break;
                    }
                    start = (held_until_s, self.at(held_until_s));
                    reference = start.1;
                    held_until_s = f64::NEG_INFINITY;
                }
                let (level, polarity) = if end.1 >= reference + self.sensor.contrast_on {
                    (reference + self.sensor.contrast_on, Polarity::On)
                } else if end.1 <= reference - self.sensor.contrast_off {
                    (reference - self.sensor.contrast_off, Polarity::Off)
                } else {
                    break;
                };
                let t_s = self.crossing(start, end, level);
                events.push((t_s, polarity));
                reference = level;
                start = (t_s, level);
                if refractory_s > 0.0 {
                    held_until_s = t_s + refractory_s;
                }
            }
        }
        events
    }

    /// Halves pieces until each is nearly straight.
    fn refined(&self, coarse: &[Point]) -> Vec<Point> {
        let mut points = vec![coarse[0]];
        let mut pending = Vec::new();
        for (i, &point) in coarse.iter().enumerate().skip(1) {
            pending.push(point);
            while let Some(&(end_s, end)) = pending.last() {
                let &(start_s, start) = points.last().expect("starts with one point");
                let middle_s = 0.5 * (start_s + end_s);
                if end_s - start_s > SHORTEST_S && self.may_bend(coarse, i, (start_s, start), (end_s, end)) {
                    let middle = self.at(middle_s);
                    let bend = (middle - 0.5 * (start + end)).abs();
                    if bend > CURVATURE_LOG {
                        pending.push((middle_s, middle));
                        continue;
                    }
                    points.push((middle_s, middle));
                }
                points.push((end_s, end));
                pending.pop();
            }
        }
        points
    }

    /// Whether the curve may bend noticeably in piece `i`, judging by the grid around it. Pixels at rest need no
    /// halving.
    fn may_bend(&self, coarse: &[Point], i: usize, start: Point, end: Point) -> bool {
        let around = &coarse[i.saturating_sub(3)..(i + 3).min(coarse.len())];
        let (low, high) = around
            .iter()
            .chain([&start, &end])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p.1), high.max(p.1)));
        high - low > CURVATURE_LOG
    }

    /// Adds the extremum next to every point that lies above or below both of its neighbours. Between neighbouring
    /// points the curve is then monotonic.
    fn with_extrema(&self, points: &[Point]) -> Vec<Point> {
        let mut all = vec![points[0]];
        for triple in points.windows(3) {
            let [before, peak, after] = [triple[0], triple[1], triple[2]];
            let sign = (peak.1 - before.1).signum();
            let turns = (peak.1 - before.1) * (peak.1 - after.1) > 0.0;
            let rise = (peak.1 - before.1).abs().max((peak.1 - after.1).abs());
            if turns && rise > 1e-7 {
                let extremum = self.extremum(before.0, after.0, sign);
                if extremum.0 < peak.0 {
                    all.push(extremum);
                    all.push(peak);
                } else {
                    all.push(peak);
                    all.push(extremum);
                }
            } else {
                all.push(peak);
            }
        }
        if points.len() > 1 {
            all.extend(points.last());
        }
        all
    }

    /// Golden-section search for the maximum of `sign L`.
    fn extremum(&self, mut low_s: f64, mut high_s: f64, sign: f64) -> Point {
        const RATIO: f64 = 0.618_033_988_749_894_9;
        let at = |t_s: f64| sign * self.at(t_s);
        let (mut a_s, mut b_s) = (high_s - RATIO * (high_s - low_s), low_s + RATIO * (high_s - low_s));
        let (mut a, mut b) = (at(a_s), at(b_s));
        while high_s - low_s > 1e-7 {
            if a > b {
                (high_s, b_s, b) = (b_s, a_s, a);
                a_s = high_s - RATIO * (high_s - low_s);
                a = at(a_s);
            } else {
                (low_s, a_s, a) = (a_s, b_s, b);
                b_s = low_s + RATIO * (high_s - low_s);
                b = at(b_s);
            }
        }
        let (t_s, log) = if a > b { (a_s, a) } else { (b_s, b) };
        (t_s, sign * log)
    }

    /// Time at which a monotonic piece reaches `level`, by the Illinois variant of the false-position method.
    fn crossing(&self, start: Point, end: Point, level: f64) -> f64 {
        let (mut low_s, mut low) = (start.0, start.1 - level);
        let (mut high_s, mut high) = (end.0, end.1 - level);
        if high == 0.0 {
            return high_s;
        }
        let mut side = 0;
        for _ in 0..200 {
            if high_s - low_s <= TIME_ERROR_S {
                break;
            }
            let t_s = (low_s * high - high_s * low) / (high - low);
            let t_s = t_s.clamp(low_s + 0.25 * TIME_ERROR_S, high_s - 0.25 * TIME_ERROR_S);
            let value = self.at(t_s) - level;
            if value == 0.0 {
                return t_s;
            }
            if value * high > 0.0 {
                (high_s, high) = (t_s, value);
                if side == 1 {
                    low *= 0.5;
                }
                side = 1;
            } else {
                (low_s, low) = (t_s, value);
                if side == -1 {
                    high *= 0.5;
                }
                side = -1;
            }
        }
        0.5 * (low_s + high_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneKind;
    use crate::closed_form::sinusoid_events;

    /// Both root finders have errors below [`TIME_ERROR_S`], and both round up to a nanosecond.
    const CLOSED_FORM_TOLERANCE_NS: i64 = 5;

    fn sensor(refractory_ns: u32) -> SensorModel {
        SensorModel { refractory_ns, ..SensorModel::default() }
    }

    #[test]
    fn sinusoid_agrees_with_its_closed_form() {
        let scene = SceneKind::Sinusoid.scene(31, 23);
        let pixels: Vec<_> = all_pixels(&scene).step_by(7).collect();
        let (t0_ns, t1_ns) = (100_000_000, 1_433_333_333);
        for (contrast_on, contrast_off, log_offset) in
            [(0.2, 0.2, 0.01), (0.31, 0.17, 1.0), (0.9, 0.05, 0.001)]
        {
            let sensor = SensorModel { contrast_on, contrast_off, log_offset, ..sensor(0) };
            let found = exact_events(&scene, &sensor, &pixels, t0_ns, t1_ns);
            for (&(x, y), found) in pixels.iter().zip(&found) {
                let exact = sinusoid_events(&scene, &sensor, x, y, t0_ns, t1_ns).expect("a sinusoid");
                assert_eq!(found.len(), exact.len(), "({x}, {y})");
                assert!(exact.len() > 10);
                for (a, b) in found.iter().zip(&exact) {
                    assert_eq!(a.polarity, b.polarity);
                    assert!((a.t_ns - b.t_ns).abs() <= CLOSED_FORM_TOLERANCE_NS, "{a:?} {b:?}");
                }
            }
        }
    }

    /// Compares counts with those on a grid so dense that linear interpolation is as good as the curve.
    #[test]
    fn every_scene_agrees_with_dense_sampling() {
        let (t0_ns, t1_ns) = (1_000_000_000, 1_100_000_000);
        let steps = 20_000;
        for kind in SceneKind::ALL {
            let scene = kind.scene(87, 65);
            let pixels: Vec<_> = all_pixels(&scene).step_by(173).collect();
            let sensor = SensorModel { log_offset: 0.001, ..sensor(0) };
            let found = exact_events(&scene, &sensor, &pixels, t0_ns, t1_ns);
            let mut reference = Vec::new();
            let mut events: Vec<Vec<(f64, Polarity)>> = vec![Vec::new(); pixels.len()];
            let mut last = Vec::new();
            for step in 0..=steps {
                let t_s = seconds(t0_ns) + seconds(t1_ns - t0_ns) * f64::from(step) / f64::from(steps);
                let view = scene.view(t_s);
                let logs: Vec<f64> =
                    pixels.iter().map(|&(x, y)| log_intensity(&view, &sensor, x, y)).collect();
                if step == 0 {
                    (reference, last) = (logs.clone(), logs.clone());
                }
                for (i, &log) in logs.iter().enumerate() {
                    let dt_s = seconds(t1_ns - t0_ns) / f64::from(steps);
                    loop {
                        let (level, polarity) = if log >= reference[i] + sensor.contrast_on {
                            (reference[i] + sensor.contrast_on, Polarity::On)
                        } else if log <= reference[i] - sensor.contrast_off {
                            (reference[i] - sensor.contrast_off, Polarity::Off)
                        } else {
                            break;
                        };
                        events[i].push((t_s - dt_s * (log - level) / (log - last[i]), polarity));
                        reference[i] = level;
                    }
                }
                last = logs;
            }
            for (i, (found, dense)) in found.iter().zip(&events).enumerate() {
                assert_eq!(found.len(), dense.len(), "{kind:?} {:?}", pixels[i]);
                for (a, b) in found.iter().zip(dense) {
                    assert_eq!(a.polarity, b.1);
                    assert!((seconds(a.t_ns) - b.0).abs() < 2e-7, "{kind:?} {a:?} {b:?}");
                }
            }
            let total: usize = found.iter().map(Vec::len).sum();
            assert_eq!(total == 0, kind == SceneKind::Still, "{kind:?}: {total}");
        }
    }

    #[test]
    fn a_refractory_pixel_is_held_and_starts_anew() {
        let scene = SceneKind::Sinusoid.scene(5, 5);
        let sensor = sensor(3_000_000);
        let events = &exact_events(&scene, &sensor, &[(2, 2)], 0, 1_000_000_000)[0];
        assert!(events.len() > 20);
        for pair in events.windows(2) {
            let held_until_ns = pair[0].t_ns + 3_000_000;
            assert!(pair[1].t_ns > held_until_ns);
            let log = |t_ns: i64| log_intensity(&scene.view(seconds(t_ns)), &sensor, 2, 2);
            let change = log(pair[1].t_ns) - log(held_until_ns);
            let threshold = 0.2 * f64::from(pair[1].polarity.sign());
            assert!((change - threshold).abs() < 1e-6, "{change}");
        }
    }

    #[test]
    fn a_still_scene_has_no_events_even_after_an_hour() {
        let scene = SceneKind::Still.scene(9, 7);
        let pixels: Vec<_> = all_pixels(&scene).collect();
        let hour_ns = 3_600_000_000_000;
        for events in exact_events(&scene, &sensor(0), &pixels, hour_ns, hour_ns + 100_000_000) {
            assert!(events.is_empty());
        }
    }
}
