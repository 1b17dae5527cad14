//! Instances of events: against the oracle, against the scenes themselves, and when they are refused.

use super::levels::{SIZE, sensor};
use esaac_engine::{CameraConfig, EngineError, Representation, Rig, RigOptions};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::{Packet, SensorModel, Synthesis};
use esaac_oracle::synthesize::rigid::Rigid;
use esaac_scene::{Scene, SceneKind};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::geometry::Rendered;

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

/// The oracle's ids of the events between two frames.
fn expected(rendered: &Rendered, sensor: &SensorModel, frames: [usize; 2], packet: &Packet) -> Vec<i64> {
    let planes = frames.map(|index| rendered.frames[index].planes(sensor));
    let inputs = [0, 1].map(|key| rendered.frames[frames[key]].input(rendered.size, &planes[key]));
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
            let share = same_share(ids, &expected(&rendered, &sensor, [index, index + 1], packet));
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
    let samples =
        places.iter().flat_map(|dy| places.map(|dx| view.sample(f64::from(x) + dx, f64::from(y) + dy)));
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

/// A rig of the scene through a pinhole and through a fisheye, of two sizes, beside a camera that is not stepped.
fn different_cameras() -> (Rig, Vec<Rendered>) {
    let rendered = vec![
        Rendered::of(SceneKind::Bounce, SIZE, FRAMES),
        through_fisheye(Rendered::of(SceneKind::Poles, (40, 33), FRAMES)),
        Rendered::of(SceneKind::Propeller, SIZE, FRAMES),
    ];
    // The sensors differ, so that the table of cameras has another order than the rig.
    let contrasts = [0.17, 0.2, 0.17];
    let configs: Vec<CameraConfig> = (0..)
        .zip(rendered.iter().zip(contrasts))
        .map(|(camera, (rendered, contrast_on))| {
            let refractory_ns = if camera == 1 { 100_000 } else { 0 };
            let sensor = SensorModel { contrast_on, refractory_ns, ..sensor_of(rendered) };
            CameraConfig { camera, ..rendered.camera(&sensor) }
        })
        .collect();
    let mut rig = Rig::new(&DEVICE, &configs).expect("a rig");
    for (number, rendered) in rendered.iter().enumerate() {
        rig.set_scene(number, rendered.scene.clone()).expect("poses");
    }
    (rig, rendered)
}

fn sensor_of(rendered: &Rendered) -> SensorModel {
    SensorModel { width: rendered.size.0, height: rendered.size.1, ..sensor() }
}

/// The same images and poses behind another lens: what they show is another scene.
fn through_fisheye(rendered: Rendered) -> Rendered {
    let old = &rendered.scene;
    let (focal_px, centre_px) = (old.lens().focal_px(), old.lens().centre_px());
    let lens = Intrinsics::fisheye(focal_px.x, focal_px.y, centre_px.x, centre_px.y).expect("a lens");
    let mut scene = SceneMotion::new(lens, old.camera().clone());
    for id in old.ids() {
        scene.insert(id, old.instance(id).expect("its poses").clone()).expect("one id");
    }
    Rendered { scene, ..rendered }
}

#[test]
fn each_camera_of_a_rig_has_its_own() {
    let (mut rig, rendered) = different_cameras();
    for index in 0..FRAMES {
        for (number, rendered) in rendered.iter().enumerate() {
            rig.upload(number, &rendered.frames[index].bytes()).expect("a frame");
        }
        let t_ns = rendered[0].frames[index].t_ns;
        // The last one misses a frame.
        let times_ns = [Some(t_ns), Some(t_ns), (index != 1).then_some(t_ns)];
        let packets = rig.step_some(&times_ns).expect("a tick").packets.to_vec();
        let actual = ids(&mut rig);
        let oracle: Vec<i64> = packets
            .iter()
            .enumerate()
            .filter(|(_, packet)| !packet.is_empty())
            .flat_map(|(number, packet)| {
                let before = if number == 2 { index - 2 } else { index - 1 };
                let sensor = sensor_of(&rendered[number]);
                expected(&rendered[number], &sensor, [before, index], packet)
            })
            .collect();
        let share = same_share(&actual, &oracle);
        assert_eq!(actual.len(), oracle.len());
        assert!(index == 0 || (actual.len() > 2000 && share >= SAME_SHARE), "frame {index}: {share}");
    }
    drop(rig);
    assert_silent();
}

#[test]
fn ids_are_those_of_the_poses_and_unknown_without() {
    const BIG: u32 = 0xfffe_fffe;
    let mut rendered = Rendered::of(SceneKind::Bounce, SIZE, FRAMES);
    let old = rendered.scene.ids().next().expect("a body that moves");
    let track = rendered.scene.instance(old).expect("its poses").clone();
    rendered.scene.remove(old);
    rendered.scene.insert(BIG, track).expect("poses of another id");
    let renamed = |to: u32| -> Rendered {
        let mut rendered = rendered.clone();
        for frame in &mut rendered.frames {
            let ids: Vec<u32> = bytemuck::pod_collect_to_vec(&frame.ids);
            let ids: Vec<u32> = ids.into_iter().map(|id| if id == old { to } else { id }).collect();
            frame.ids = bytemuck::pod_collect_to_vec(&ids);
        }
        rendered
    };
    let count = |steps: &[(Packet, Vec<i64>)], id: i64| -> usize {
        steps.iter().flat_map(|(_, ids)| ids).filter(|&&each| each == id).count()
    };
    let known = run(&renamed(BIG), &sensor());
    assert!(count(&known, BIG.into()) > 300 && count(&known, 0) > 300);
    assert_eq!(count(&known, -1), 0);
    // Nobody has told where this one goes.
    let unknown = run(&renamed(77), &sensor());
    assert!(count(&unknown, -1) > 100 && count(&unknown, 77) == 0);
    assert_silent();
}

#[test]
fn what_is_done_to_a_camera_leaves_the_ids_of_the_others() {
    let (mut rig, rendered) = different_cameras();
    let step = |rig: &mut Rig, index: usize| -> (Vec<usize>, Vec<i64>) {
        for (number, rendered) in rendered.iter().enumerate() {
            rig.upload(number, &rendered.frames[index].bytes()).expect("a frame");
        }
        let t_ns = rendered[0].frames[index].t_ns;
        let packets = rig.step(&[t_ns; 3]).expect("a tick").packets;
        let ends = packets.iter().scan(0, |end, packet| {
            *end += packet.len();
            Some(*end)
        });
        (ends.collect(), ids(rig))
    };
    let known = |rig: &mut Rig, (ends, before): &(Vec<usize>, Vec<i64>), known: [bool; 3]| {
        let mut expected = before.clone();
        let mut start = 0;
        for (&end, known) in ends.iter().zip(known) {
            assert!(end - start > 100 && before[start..end].iter().any(|&id| id != -1));
            if !known {
                expected[start..end].fill(-1);
            }
            start = end;
        }
        assert_eq!(ids(rig), expected);
        assert_eq!(rig.knows_event_ids(), known.contains(&true));
    };
    step(&mut rig, 0);
    let all = step(&mut rig, 1);
    rig.reset(1).expect("a reset");
    known(&mut rig, &all, [true, false, true]);
    // Poses of the same instances are for the next step; other instances are another matter.
    rig.set_scene(2, rendered[2].scene.clone()).expect("the same");
    known(&mut rig, &all, [true, false, true]);
    let old = &rendered[2].scene;
    let still = SceneMotion::new(*old.lens(), old.camera().clone());
    rig.set_scene(2, still).expect("fewer");
    known(&mut rig, &all, [true, false, false]);
    rig.reset(0).expect("a reset");
    known(&mut rig, &all, [false; 3]);
    rig.set_scene(2, rendered[2].scene.clone()).expect("poses");
    let all = step(&mut rig, 2);
    assert_eq!(all.0, [0, 0, all.1.len()], "those that were reset have seen one frame");
    assert!(rig.knows_event_ids());
    drop(rig);
    assert_silent();
}

#[test]
fn ids_that_cannot_be_had_are_told_and_the_rig_goes_on() {
    let rendered = Rendered::of(SceneKind::Bounce, SIZE, FRAMES);
    let mut rig = rendered.rig(&sensor(), RigOptions::default());
    let unknown = |rig: &mut Rig, events: usize| {
        assert!(!rig.knows_event_ids());
        assert_eq!(ids(rig), vec![-1; events]);
    };
    unknown(&mut rig, 0);
    let takes_memory = |rig: &Rig| rig.memory().iter().any(|each| each.purpose == "event_ids");
    for index in 0..2 {
        let t_ns = upload(&mut rig, &rendered, index);
        rig.step(&[t_ns]).expect("a tick");
        assert!(!takes_memory(&rig), "nobody has asked yet");
        assert_eq!(ids(&mut rig).is_empty(), index == 0);
    }
    // Poses of the same instances are for the next step; those of one more change what the device knows.
    let before = ids(&mut rig);
    assert!(takes_memory(&rig));
    rig.set_scene(0, rendered.scene.clone()).expect("the same");
    assert_eq!(ids(&mut rig), before);
    let mut more = rendered.scene.clone();
    more.insert(500, PoseTrack::still(Pose::IDENTITY)).expect("one more");
    rig.set_scene(0, more).expect("one more");
    unknown(&mut rig, before.len());
    let t_ns = upload(&mut rig, &rendered, 2);
    let events = rig.step(&[t_ns]).expect("a tick").packets[0].len();
    assert!(events > 100 && rig.knows_event_ids());
    assert!(ids(&mut rig).iter().any(|&id| id != -1));
    rig.reset(0).expect("a reset");
    unknown(&mut rig, events);
    drop(rig);
    let linear = SensorModel { synthesis: Synthesis::Linear, ..sensor() };
    let mut rig = Rig::new(&DEVICE, &[rendered.camera(&linear)]).expect("a rig");
    let error = rig.represent_to_host(Representation::EventIds).unwrap_err();
    assert!(matches!(error, EngineError::NoEventIds(_)), "{error}");
    assert!(error.to_string().contains("camera 0 has synthesis `linear`, expected `rigid`"), "{error}");
    drop(rig);
    assert_silent();
}
