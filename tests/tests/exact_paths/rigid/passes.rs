//! Levels that are synthesised apart from their walks, by the kernels of GPUs: tiles that find no room in `levels` are
//! left to later passes, and no event depends on it.

use super::levels::{SIZE, Step, run, sensor};
use esaac_engine::{KernelPolicy, RigOptions};
use esaac_model::{Pixel, SensorModel, SubstepPolicy};
use esaac_scene::SceneKind;
use esaac_tests::geometry::Rendered;

const POLICY: KernelPolicy = KernelPolicy::gpu();

/// As little room as there may be.
const NARROW: KernelPolicy = KernelPolicy { least_level_rows: 0, ..POLICY };

fn told(steps: &[Step]) -> Vec<(usize, u64, u64)> {
    steps.iter().map(|step| (step.events.len(), step.substeps, step.unseen)).collect()
}

#[test]
fn packets_do_not_depend_on_who_synthesises_nor_on_the_room_for_levels() {
    let noisy =
        SensorModel { leak_rate_hz: 2.0, shot_noise_rate_hz: 20.0, refractory_ns: 1_000_000, ..sensor() };
    let still = SensorModel { substep_policy: SubstepPolicy::Fixed, substeps: 32, ..sensor() };
    let physical = SensorModel { pixel: Pixel::Physical, noise_gain: 0.0, ..sensor() };
    for (sensor, kind) in
        [(noisy, SceneKind::Propeller), (still, SceneKind::Poles), (physical, SceneKind::Foliage)]
    {
        let rendered = Rendered::of(kind, SIZE, 3);
        let own = run(&sensor, &rendered, RigOptions::default(), true);
        assert!(own.iter().map(|step| step.events.len()).sum::<usize>() > 1000, "{kind:?} sends few events");
        for (policy, initial_events) in [(POLICY, 0), (NARROW, 0), (NARROW, 64)] {
            let options = RigOptions { policy: Some(policy), initial_events, ..RigOptions::default() };
            let apart = run(&sensor, &rendered, options, true);
            assert_eq!(told(&own), told(&apart), "{kind:?}, {policy:?}, {initial_events}");
            assert!(own.iter().zip(&apart).all(|(a, b)| a.events == b.events), "{kind:?}, {policy:?}");
        }
    }
}
