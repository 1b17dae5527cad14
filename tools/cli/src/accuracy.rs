//! Compares simulated events with the exact events of an analytic scene.

use crate::report::AccuracyReport;
use esaac_benches::truth::Truth;
use esaac_formats::event_file::EventColumns;
use esaac_model::SensorModel;
use esaac_scene::Scene;

/// Most pixels that are compared: enough for stable results, few enough to be quick.
const PIXELS: usize = 1200;

/// Compares the events in `(t0_ns, t1_ns]` on an even subset of the pixels. `None` if `stop` ends it.
pub fn against_exact(
    scene: &Scene,
    sensor: &SensorModel,
    events: &EventColumns,
    span_ns: (i64, i64),
    stop: impl Fn() -> bool,
) -> Option<AccuracyReport> {
    let truth = Truth::of_scene_unless(scene, sensor, PIXELS, span_ns, stop)?;
    let comparison = truth.compare(events.iter());
    Some(AccuracyReport {
        pixels: truth.pixels(),
        events: comparison.tested_on_off.0 + comparison.tested_on_off.1,
        exact_events: comparison.truth_on_off.0 + comparison.truth_on_off.1,
        exact_sequences: comparison.same_sequence,
        f1: comparison.f1,
        match_window_us: esaac_benches::truth::MATCH_WINDOW_US,
        time_error_median_us: comparison.matched.p50_us,
        time_error_p99_us: comparison.matched.p99_us,
        victor_purpura: comparison.victor_purpura,
    })
}
