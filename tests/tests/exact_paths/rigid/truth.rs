//! Events of hard scenes along exact paths, against exact ones.

use super::levels::{run, sensor};
use esaac_engine::RigOptions;
use esaac_model::packet::Event;
use esaac_model::{SensorModel, Synthesis};
use esaac_oracle::metrics::{Comparison, compare};
use esaac_scene::{SceneKind, exact_events};
use esaac_tests::geometry::Rendered;

const SIZE: (u32, u32) = (160, 120);

/// Every so many pixels is compared.
const STRIDE: u32 = 7;

/// Events of three intervals at 30 Hz against exact ones, by each synthesis.
fn judged(kind: SceneKind, syntheses: [Synthesis; 2]) -> [Comparison; 2] {
    let sensor = SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        contrast_on: 0.2,
        contrast_off: 0.2,
        substeps: 32,
        ..sensor()
    };
    let rendered = Rendered::of(kind, SIZE, 4);
    let is_compared = |x: u32, y: u32| (y * SIZE.0 + x).is_multiple_of(STRIDE);
    let pixels: Vec<(u32, u32)> = (0..SIZE.1)
        .flat_map(|y| (0..SIZE.0).map(move |x| (x, y)))
        .filter(|&(x, y)| is_compared(x, y))
        .collect();
    let [first, .., last] = &rendered.frames[..] else { panic!("four frames") };
    let truth = exact_events(&kind.scene(SIZE.0, SIZE.1), &sensor, &pixels, first.t_ns, last.t_ns);
    syntheses.map(|synthesis| {
        let sensor = SensorModel { synthesis, ..sensor.clone() };
        let steps = run(&sensor, &rendered, RigOptions::default(), synthesis == Synthesis::Motion);
        let events = steps.into_iter().flat_map(|step| step.events);
        let compared: Vec<Event> = events.filter(|e| is_compared(e.x.into(), e.y.into())).collect();
        compare(SIZE, truth.iter().flatten().copied(), compared)
    })
}

#[test]
fn hard_scenes_are_near_the_truth_and_nearer_than_along_vectors() {
    for (kind, f1) in [
        (SceneKind::Shake, 0.95),
        (SceneKind::Poles, 0.74),
        (SceneKind::Foliage, 0.65),
        (SceneKind::Propeller, 0.80),
        (SceneKind::Bounce, 0.92),
    ] {
        let [rigid, motion] = judged(kind, [Synthesis::Rigid, Synthesis::Motion]);
        let told = [&rigid, &motion].map(|c| (c.f1, c.victor_purpura, c.count_ratio));
        println!("{kind:?}: {told:.3?}");
        assert!(rigid.f1 >= f1 && rigid.f1 > motion.f1, "{kind:?}: {told:.3?}");
        assert!(rigid.victor_purpura < motion.victor_purpura, "{kind:?}: {told:.3?}");
        assert!((0.85..=1.15).contains(&rigid.count_ratio), "{kind:?}: {told:.3?}");
    }
}
