//! Adaptive sub-steps compared with the largest number everywhere: how far events may differ.

use esaac_model::{HdrFormat, Intensity, MotionFormat, SensorModel, SubstepPolicy};
use esaac_oracle::metrics::compare;
use esaac_scene::SceneKind;
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{scene, times};
use esaac_tests::run::{Step, engine_of_many, events};

const SIZE: (u32, u32) = (75, 61);

/// Largest differences allowed on a scene.
struct Bound {
    scene: SceneKind,
    /// Victor-Purpura distance per event, 1 ms of shift costing as much as an event.
    victor_purpura: f64,
    /// 99th percentile of the time error of matched events.
    time_p99_us: f64,
    /// Sub-steps taken, as a share of the fixed ones: the saving.
    substeps: f64,
}

/// Adaptive sub-steps are half a pixel of motion each, or longer where the light hardly curves, and log intensity is
/// linear within one. Where the light curves within a sub-step, the level is off by up to an eighth of its second
/// difference over the sub-step. On these scenes that moves events by two tenths of a millisecond on average, of an
/// interval of 33 ms, and their number stays the same. (Events of 32 sub-steps are no nearer to the scene's own: the
/// laboratory's part `frontier` has both.) A change without motion is blended in the log, where the number of sub-steps
/// changes nothing but rounding.
const BOUNDS: [Bound; 4] = [
    Bound { scene: SceneKind::Flight, victor_purpura: 0.25, time_p99_us: 900.0, substeps: 0.2 },
    Bound { scene: SceneKind::Edge, victor_purpura: 0.12, time_p99_us: 550.0, substeps: 0.3 },
    Bound { scene: SceneKind::Lamp, victor_purpura: 1e-4, time_p99_us: 1.0, substeps: 0.05 },
    Bound { scene: SceneKind::Still, victor_purpura: 0.0, time_p99_us: 0.0, substeps: 0.0 },
];

#[test]
fn adaptive_substeps_stay_within_their_bound() {
    let base = SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        intensity: Intensity::Luminance,
        substeps: 32,
        ..SensorModel::default()
    };
    let cameras: Vec<_> = BOUNDS
        .iter()
        .flat_map(|bound| {
            let frames = scene(bound.scene, SIZE, &times(0, 5), HdrFormat::F32x4, MotionFormat::F32x2);
            [SubstepPolicy::Fixed, SubstepPolicy::Adaptive]
                .map(|substep_policy| (SensorModel { substep_policy, ..base.clone() }, frames.clone()))
        })
        .collect();
    let runs = engine_of_many(&cameras, Default::default());
    let mut beyond = Vec::new();
    for (pair, bound) in runs.chunks(2).zip(&BOUNDS) {
        let [fixed, adaptive] = [&pair[0], &pair[1]];
        let got = compare(SIZE, events(fixed), events(adaptive));
        let substeps = |run: &[Step]| run.iter().map(|step| step.diagnostics.substeps).sum::<u64>() as f64;
        // Skipped blocks take no sub-steps under either policy.
        let share = substeps(adaptive) / substeps(fixed).max(1.0);
        println!("{:?}: {share:.3} of the sub-steps, {got:?}", bound.scene);
        let within = got.victor_purpura <= bound.victor_purpura
            && got.matched.p99_us <= bound.time_p99_us
            && share <= bound.substeps;
        if !within {
            beyond.push(format!("{:?}: {share} of the sub-steps, {got:?}", bound.scene));
        }
    }
    assert!(beyond.is_empty(), "{}", beyond.join("\n"));
    assert_silent();
}
