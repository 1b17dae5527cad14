//! Levels that are synthesised apart from their walks, by the kernels of GPUs: tiles that find no room in `levels` are
//! left to later passes, and no event depends on it.

use super::levels::{SIZE, Step, run, sensor};
use esaac_engine::{KernelPolicy, Resting, Rig, RigOptions};
use esaac_model::packet::Event;
use esaac_model::paths::{PoseTrack, SceneMotion};
use esaac_model::substeps::MAX_SUBSTEPS;
use esaac_model::{Pixel, SensorModel, SubstepPolicy};
use esaac_scene::SceneKind;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::FRAME_NS;
use esaac_tests::geometry::{KeyFrame, Rendered};
use esaac_tests::run::ran_again;

const POLICY: KernelPolicy = KernelPolicy::gpu();

/// Pixels rest where they can.
const RESTING: KernelPolicy = KernelPolicy { resting: Resting::Always, ..POLICY };

/// As little room as there may be.
const NARROW: KernelPolicy = KernelPolicy { least_level_rows: 0, ..POLICY };

fn told(steps: &[Step]) -> Vec<(usize, u64, u64)> {
    steps.iter().map(|step| (step.events.len(), step.substeps, step.unseen)).collect()
}

#[test]
fn packets_do_not_depend_on_who_synthesises_nor_on_the_room_for_levels() {
    let noisy =
        SensorModel { leak_rate_hz: 2.0, shot_noise_rate_hz: 20.0, refractory_ns: 1_000_000, ..sensor() };
    let still = SensorModel { substep_policy: SubstepPolicy::Fixed, substeps: MAX_SUBSTEPS, ..sensor() };
    let physical = SensorModel { pixel: Pixel::Physical, noise_gain: 0.0, ..sensor() };
    for (sensor, kind) in
        [(noisy, SceneKind::Propeller), (still, SceneKind::Poles), (physical, SceneKind::Foliage)]
    {
        let rendered = Rendered::of(kind, SIZE, 3);
        let own = run(&sensor, &rendered, RigOptions::default(), true);
        assert!(own.iter().map(|step| step.events.len()).sum::<usize>() > 1000, "{kind:?} sends few events");
        for (policy, initial_events) in [(POLICY, 0), (RESTING, 0), (NARROW, 0), (NARROW, 64)] {
            let options = RigOptions { policy: Some(policy), initial_events, ..RigOptions::default() };
            let apart = run(&sensor, &rendered, options, true);
            assert_eq!(told(&own), told(&apart), "{kind:?}, {policy:?}, {initial_events}");
            assert!(own.iter().zip(&apart).all(|(a, b)| a.events == b.events), "{kind:?}, {policy:?}");
        }
    }
}

/// A camera that stands for an interval and then shakes.
fn stands_then_shakes() -> Rendered {
    let Rendered { size, scene, mut frames } = Rendered::of(SceneKind::Shake, SIZE, 2);
    let mut stood = frames[0].clone();
    stood.t_ns = -FRAME_NS;
    frames.insert(0, stood);
    let track = scene.camera();
    // Poses are joined by smooth curves: the camera stands where those around have one pose.
    const STOOD: usize = 32;
    let times_ns = (-(STOOD as i64)..0).map(|k| FRAME_NS * k / STOOD as i64).chain(track.times_ns().to_vec());
    let poses = [&[track.poses()[0]; STOOD][..], track.poses()].concat();
    let camera = PoseTrack::new(times_ns.collect(), poses).expect("poses in order");
    Rendered { size, scene: SceneMotion::new(*scene.lens(), camera), frames }
}

/// Events of each interval for a sensor whose queues have room for them, and whether a part of it ran again.
fn events_and_retries(rendered: &Rendered, policy: Option<KernelPolicy>) -> Vec<(Vec<Event>, bool)> {
    let options = RigOptions { policy, stage_times: true, initial_events: 1 << 20, ..RigOptions::default() };
    let sensor = SensorModel { contrast_on: 0.6, contrast_off: 0.6, ..sensor() };
    let mut rig = Rig::with_options(&DEVICE, &[rendered.camera(&sensor)], options).expect("a rig");
    rig.set_scene(0, rendered.scene.clone()).expect("poses of its lens");
    let step = |frame: &KeyFrame| {
        rig.upload(0, &frame.bytes()).expect("a frame that fits");
        let events = rig.step(&[frame.t_ns]).expect("a frame in time").packets[0].iter().collect();
        (events, ran_again(&rig))
    };
    let steps = rendered.frames.iter().map(step).collect();
    assert_silent();
    steps
}

/// The interval in which the camera stands needs one pass, so the next begins with one.
#[test]
fn an_interval_that_needs_more_passes_than_the_ones_before_it_loses_nothing() {
    let rendered = stands_then_shakes();
    let [own, wide, narrow] =
        [None, Some(POLICY), Some(NARROW)].map(|policy| events_and_retries(&rendered, policy));
    assert!(own[2].0.len() > 1000, "{} events", own[2].0.len());
    let again = |steps: &[(Vec<Event>, bool)]| steps.iter().map(|step| step.1).collect::<Vec<_>>();
    assert_eq!((again(&wide), again(&narrow)), (vec![false; 3], vec![false, false, true]));
    for (name, steps) in [("wide", &wide), ("narrow", &narrow)] {
        assert!(own.iter().zip(steps).all(|(own, other)| own.0 == other.0), "{name}: other events");
    }
}
