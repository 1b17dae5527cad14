//! Instances of events: against the oracle, against the scenes themselves, and when they are refused.

use super::levels::sensor;
use esaac_engine::{Representation, Rig, RigOptions};
use esaac_model::{Packet, SensorModel};
use esaac_oracle::synthesize::rigid::Rigid;
use esaac_scene::{Scene, SceneKind};
use esaac_tests::device::assert_silent;
use esaac_tests::geometry::Rendered;

const SIZE: (u32, u32) = (75, 53);

const FRAMES: usize = 3;

/// Least share of events with the oracle's instance. The others lie at a silhouette to a rounding.
const SAME_SHARE: f64 = 0.999;

const SCENES: [SceneKind; 5] =
    [SceneKind::Shake, SceneKind::Poles, SceneKind::Foliage, SceneKind::Propeller, SceneKind::Bounce];

fn upload(rig: &mut Rig, rendered: &Rendered, index: usize) -> i64 {
    let frame = &rendered.frames[index];
    rig.upload(0, &frame.bytes()).expect("a frame");
    frame.t_ns
}

/// The ids of the last tick's events.
fn ids(rig: &mut Rig) -> Vec<i64> {
    bytemuck::pod_collect_to_vec(&rig.represent_to_host(Representation::EventIds).expect("ids"))
}

/// The packet of each interval, with the ids of its events.
fn run(rendered: &Rendered, sensor: &SensorModel) -> Vec<(Packet, Vec<i64>)> {
    let mut rig = rendered.rig(sensor, RigOptions::default());
    let mut steps = Vec::new();
    for index in 0..rendered.frames.len() {
        let t_ns = upload(&mut rig, rendered, index);
        let packet = rig.step(&[t_ns]).expect("a tick").packets[0].clone();
        let ids = ids(&mut rig);
        assert_eq!(ids.len(), packet.len());
        steps.push((packet, ids));
    }
    steps.remove(0);
    steps
}

/// The oracle's ids of the events of an interval.
fn expected(rendered: &Rendered, sensor: &SensorModel, index: usize, packet: &Packet) -> Vec<i64> {
    let planes = [0, 1].map(|key| rendered.frames[index + key].planes(sensor));
    let inputs = [0, 1].map(|key| rendered.frames[index + key].input(rendered.size, &planes[key]));
    Rigid::new(&rendered.scene, inputs, sensor.log_offset, (sensor.taps, 1), None).event_ids(packet)
}

fn same_share(actual: &[i64], expected: &[i64]) -> f64 {
    actual.iter().zip(expected).filter(|(a, b)| a == b).count() as f64 / expected.len() as f64
}

#[test]
fn ids_are_the_oracles() {
    for kind in SCENES {
        let (rendered, sensor) = (Rendered::of(kind, SIZE, FRAMES), sensor());
        for (index, (packet, ids)) in run(&rendered, &sensor).iter().enumerate() {
            let share = same_share(ids, &expected(&rendered, &sensor, index, packet));
            println!("{kind:?}, interval {index}: {} events, {share:.5} the same", packet.len());
            assert!(packet.len() > 300 && share >= SAME_SHARE, "{kind:?}, interval {index}: {share}");
        }
    }
    assert_silent();
}

/// What is in front in a pixel at a time: of all that covers a part of it the nearest. Objects are in order.
fn in_front(scene: &Scene, x: u16, y: u16, t_ns: i64) -> i64 {
    let view = scene.view(t_ns as f64 * 1e-9);
    let places = [-0.45, -0.15, 0.15, 0.45];
    let samples = places.iter().flat_map(|dy| places.map(|dx| view.sample(f64::from(x) + dx, f64::from(y) + dy)));
    samples.min_by_key(|sample| sample.object).map_or(-1, |sample| i64::from(sample.instance))
}

#[test]
fn ids_are_of_what_is_there_when_the_event_is_sent() {
    for (kind, least) in [(SceneKind::Poles, 0.93), (SceneKind::Propeller, 0.95), (SceneKind::Bounce, 0.97)] {
        let (rendered, scene) = (Rendered::of(kind, SIZE, FRAMES), kind.scene(SIZE.0, SIZE.1));
        let (mut events, mut right, mut right_in_frame) = (0, 0, 0);
        for (index, (packet, ids)) in run(&rendered, &sensor()).iter().enumerate() {
            let in_frame: Vec<u32> = bytemuck::pod_collect_to_vec(&rendered.frames[index + 1].ids);
            for (event, &id) in packet.iter().zip(ids) {
                let truth = in_front(&scene, event.x, event.y, event.t_ns);
                let pixel = usize::from(event.y) * SIZE.0 as usize + usize::from(event.x);
                events += 1;
                right += usize::from(id == truth);
                right_in_frame += usize::from(i64::from(in_frame[pixel]) == truth);
            }
        }
        let share = |count: usize| count as f64 / events as f64;
        println!("{kind:?}: {:.3} right, by the frame's ids {:.3}", share(right), share(right_in_frame));
        assert!(share(right) >= least, "{kind:?}: {}", share(right));
        assert!(2 * (events - right) < events - right_in_frame, "{kind:?}: {}", share(right_in_frame));
    }
    assert_silent();
}
