//! Exact events of a scene, and the distance of a stream from them.

use esaac_model::SensorModel;
use esaac_model::packet::Event;
use esaac_oracle::metrics::{Comparison, MATCH_WINDOW_NS, compare};
use esaac_scene::{Scene, exact_events};

/// Two events of the same pixel and polarity match if their times differ by no more than this.
pub const MATCH_WINDOW_US: f64 = MATCH_WINDOW_NS as f64 * 1e-3;

/// Pixels between two looks whether to stop.
const AT_ONCE: usize = 128;

/// Exact events of some pixels of a scene.
pub struct Truth {
    pixels: usize,
    width: u32,
    column_of: Vec<Option<u16>>,
    events: Vec<Event>,
}

impl Truth {
    /// Computes the exact events of at most `pixels` pixels, evenly spread, in `(t0_ns, t1_ns]`.
    #[must_use]
    pub fn of_scene(scene: &Scene, sensor: &SensorModel, pixels: usize, span_ns: (i64, i64)) -> Self {
        Truth::of_scene_unless(scene, sensor, pixels, span_ns, || false).expect("nobody stops it")
    }

    /// The same; `None` as soon as `stop` says so, which is asked now and then.
    pub fn of_scene_unless(
        scene: &Scene,
        sensor: &SensorModel,
        pixels: usize,
        (t0_ns, t1_ns): (i64, i64),
        stop: impl Fn() -> bool,
    ) -> Option<Self> {
        let pixels = subset(sensor.width, sensor.height, pixels);
        let mut exact = Vec::with_capacity(pixels.len());
        for some in pixels.chunks(AT_ONCE) {
            if stop() {
                return None;
            }
            exact.extend(exact_events(scene, sensor, some, t0_ns, t1_ns));
        }
        // The comparison sees the subset as one row of pixels.
        let mut column_of = vec![None; sensor.pixels()];
        for (column, &(x, y)) in (0_u16..).zip(&pixels) {
            column_of[(y * sensor.width + x) as usize] = Some(column);
        }
        let in_row = |(x, events): (u16, Vec<Event>)| events.into_iter().map(move |e| Event { x, y: 0, ..e });
        let events = (0_u16..).zip(exact).flat_map(in_row).collect();
        Some(Truth { pixels: pixels.len(), width: sensor.width, column_of, events })
    }

    /// Number of compared pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.pixels
    }

    /// Number of exact events of the compared pixels.
    #[must_use]
    pub fn events(&self) -> usize {
        self.events.len()
    }

    /// Compares a camera's events with the truth. Events of other pixels do not count.
    #[must_use]
    pub fn compare(&self, events: impl IntoIterator<Item = Event>) -> Comparison {
        let tested = events.into_iter().filter_map(|event| {
            let pixel = usize::from(event.y) * self.width as usize + usize::from(event.x);
            Some(Event { x: self.column_of[pixel]?, y: 0, ..event })
        });
        compare((self.pixels as u32, 1), self.events.iter().copied(), tested)
    }
}

/// At most `pixels` pixels, evenly spread in row-major order. The step is rarely a divisor of the width, so most rows
/// get other columns than the row above.
fn subset(width: u32, height: u32, pixels: usize) -> Vec<(u32, u32)> {
    let all = width as usize * height as usize;
    let count = all.min(pixels);
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

    #[test]
    fn exact_events_are_exact_and_faults_are_seen() {
        let sensor = SensorModel { width: 47, height: 31, ..SensorModel::default() };
        let scene = SceneKind::Sinusoid.scene(47, 31);
        let span_ns = (0, 100_000_000);
        let truth = Truth::of_scene(&scene, &sensor, 1200, span_ns);
        let pixels: Vec<(u32, u32)> = esaac_scene::exact::all_pixels(&scene).collect();
        let exact: Vec<Event> =
            exact_events(&scene, &sensor, &pixels, span_ns.0, span_ns.1).into_iter().flatten().collect();
        assert!(truth.events() > 100 && truth.events() < exact.len());
        let same = truth.compare(exact.iter().copied());
        assert_eq!((same.f1, same.same_sequence, same.victor_purpura), (1.0, 1.0, 0.0));
        let shifted = exact.iter().map(|e| Event { x: (e.x + 1) % 47, ..*e });
        assert!(truth.compare(shifted).victor_purpura > 0.1);
    }

    #[test]
    fn it_stops_when_it_is_told_to() {
        let sensor = SensorModel { width: 47, height: 31, ..SensorModel::default() };
        let scene = SceneKind::Sinusoid.scene(47, 31);
        let looks = std::cell::Cell::new(0);
        let stopped = |at: usize| {
            looks.set(0);
            let stop = || looks.replace(looks.get() + 1) == at;
            Truth::of_scene_unless(&scene, &sensor, 1200, (0, 20_000_000), stop).is_none()
        };
        assert!(stopped(0) && stopped(3));
        assert_eq!(looks.get(), 4);
        assert!(!stopped(usize::MAX));
    }

    #[test]
    fn the_subset_is_inside_and_without_repetition() {
        for (width, height) in [(1, 1), (37, 23), (346, 260), (1280, 720)] {
            let mut pixels = subset(width, height, 1200);
            assert!(pixels.iter().all(|&(x, y)| x < width && y < height));
            pixels.dedup();
            assert_eq!(pixels.len(), (width * height).min(1200) as usize);
        }
    }
}
