//! Events produced against the exact events of an analytic scene.

use crate::event_file::EventColumns;
use crate::report::AccuracyReport;
use esaac_model::packet::Event;
use esaac_model::{Polarity, SensorModel};
use esaac_oracle::metrics::{MATCH_WINDOW_NS, compare};
use esaac_scene::{Scene, exact_events};

/// Pixels compared at most: enough for stable figures, few enough for a short wait.
const PIXELS: usize = 1200;

/// Compares the events in `(t0_ns, t1_ns]` on an even subset of the pixels.
#[must_use]
pub fn against_exact(
    scene: &Scene,
    sensor: &SensorModel,
    events: &EventColumns,
    (t0_ns, t1_ns): (i64, i64),
) -> AccuracyReport {
    let pixels = subset(sensor.width, sensor.height);
    let exact = exact_events(scene, sensor, &pixels, t0_ns, t1_ns);
    // A comparison of pixels in a row, one for each of the subset.
    let mut column_of = vec![None; sensor.pixels()];
    for (column, &(x, y)) in (0_u16..).zip(&pixels) {
        column_of[(y * sensor.width + x) as usize] = Some(column);
    }
    let exact =
        (0_u16..).zip(exact).flat_map(|(x, events)| events.into_iter().map(move |e| Event { x, y: 0, ..e }));
    let produced = (0..events.len()).filter_map(|i| {
        let x = column_of[usize::from(events.y[i]) * sensor.width as usize + usize::from(events.x[i])]?;
        let polarity = if events.sign[i] > 0 { Polarity::On } else { Polarity::Off };
        Some(Event { t_ns: events.t_ns[i], y: 0, x, polarity })
    });
    let comparison = compare((pixels.len() as u32, 1), exact, produced);
    AccuracyReport {
        pixels: pixels.len(),
        events: comparison.tested_on_off.0 + comparison.tested_on_off.1,
        exact_events: comparison.truth_on_off.0 + comparison.truth_on_off.1,
        exact_sequences: comparison.same_sequence,
        f1: comparison.f1,
        match_window_us: MATCH_WINDOW_NS as f64 * 1e-3,
        time_error_median_us: comparison.matched.p50_us,
        time_error_p99_us: comparison.matched.p99_us,
        victor_purpura: comparison.victor_purpura,
    }
}

/// At most [`PIXELS`] pixels, evenly spread; the step is coprime to no size in particular, so rows are
/// shifted against each other.
fn subset(width: u32, height: u32) -> Vec<(u32, u32)> {
    let all = width as usize * height as usize;
    let count = all.min(PIXELS);
    (0..count)
        .map(|i| {
            let pixel = (i * all / count) as u32;
            (pixel % width, pixel / width)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_scene::SceneKind;

    const SPAN_NS: (i64, i64) = (0, 100_000_000);

    fn exact_columns(scene: &Scene, sensor: &SensorModel) -> EventColumns {
        let pixels: Vec<(u32, u32)> = esaac_scene::exact::all_pixels(scene).collect();
        let mut columns = EventColumns::default();
        for event in exact_events(scene, sensor, &pixels, SPAN_NS.0, SPAN_NS.1).into_iter().flatten() {
            columns.x.push(event.x);
            columns.y.push(event.y);
            columns.t_ns.push(event.t_ns);
            columns.sign.push(event.polarity.sign());
        }
        columns
    }

    #[test]
    fn exact_events_are_exact_and_faults_are_seen() {
        let sensor = SensorModel { width: 47, height: 31, ..SensorModel::default() };
        let scene = SceneKind::Sinusoid.scene(47, 31);
        let exact = exact_columns(&scene, &sensor);
        let same = against_exact(&scene, &sensor, &exact, SPAN_NS);
        assert!(same.exact_events > 100, "{same:?}");
        assert_eq!((same.f1, same.exact_sequences, same.events), (1.0, 1.0, same.exact_events));
        let mut shifted = exact.clone();
        shifted.x.iter_mut().for_each(|x| *x = (*x + 1) % 47);
        let bad = against_exact(&scene, &sensor, &shifted, SPAN_NS);
        assert!(bad.victor_purpura > 0.1, "{bad:?}");
    }

    #[test]
    fn the_subset_is_inside_and_without_repetition() {
        for (width, height) in [(1, 1), (37, 23), (346, 260), (1280, 720)] {
            let mut pixels = subset(width, height);
            assert!(pixels.iter().all(|&(x, y)| x < width && y < height));
            pixels.dedup();
            assert_eq!(pixels.len(), (width * height).min(PIXELS as u32) as usize);
        }
    }
}
