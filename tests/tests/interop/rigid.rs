//! Depth, instance ids and poses over the link give the events that they give in one process, bit for bit.

use crate::shortage::fails;
use esaac_engine::Rig;
use esaac_interop::wire::{
    ErrorCode, MEMORY_BROUGHT, MEMORY_EXPORTED, MEMORY_HOST, MEMORY_IMAGES, TIMELINE_CARRIED,
};
use esaac_interop::{CameraTerms, Gives, Planes, ProducerOptions, ServerOptions, Service};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::{IdFormat, Packet, Synthesis};
use esaac_tests::device::{DEVICE, assert_device_silent, assert_silent};
use esaac_tests::drivers::in_a_process_of_its_own;
use esaac_tests::exact::{FRAMES, Run, SIZE, config};
use esaac_tests::interop::{Place, Uploader, other_device, trusting, until};
use std::time::Duration;

const SECOND: Duration = Duration::from_secs(1);

/// All images of a frame with these ids.
fn planes<'a>(run: &'a Run, index: usize, ids: &'a [u8]) -> Planes<&'a [u8]> {
    let (_, frame) = &run.frames[index];
    Planes { hdr: &frame.hdr, motion: Some(&frame.motion), depth: Some(&frame.depth), ids: Some(ids) }
}

fn send(run: &Run, uploader: &mut Uploader, index: usize, format: IdFormat) {
    let ids = run.ids(index, format);
    uploader.send_scene(planes(run, index, &ids), run.frames[index].0, &run.motion).unwrap();
}

fn options(camera: u32, memories: u32) -> ProducerOptions {
    ProducerOptions {
        camera,
        memories,
        timelines: TIMELINE_CARRIED,
        geometry: Gives::Geometry,
        timeout: 300 * SECOND,
        ..ProducerOptions::default()
    }
}

#[test]
fn depth_ids_and_poses_give_the_events_of_one_process() {
    let run = Run::default();
    let expected = run.alone(&[0, 1, 2, 3]);
    assert!(expected.iter().map(Packet::len).sum::<usize>() > 500);
    let device = other_device();
    for (memory, ids, copies) in [
        (MEMORY_EXPORTED, IdFormat::U32, 1),
        (MEMORY_BROUGHT, IdFormat::U16, 1),
        // The engine copies the four images of each frame.
        (MEMORY_IMAGES, IdFormat::U32, 5),
        (MEMORY_IMAGES, IdFormat::U16, 5),
        (MEMORY_HOST, IdFormat::U16, 1),
    ] {
        let config = run.config(ids);
        let place = Place::default();
        let rig = Rig::new(&DEVICE, std::slice::from_ref(&config)).unwrap();
        let mut service = Service::open(rig, &place.path(), &[(&config).into()], trusting()).unwrap();
        let mut uploader = Uploader::connect(&device, &place.path(), &options(0, memory)).unwrap();
        for (index, expected) in expected.iter().enumerate() {
            send(&run, &mut uploader, index, ids);
            let tick = service.tick(60 * SECOND).unwrap().expect("a frame");
            assert!(
                tick.tick.packets[0] == *expected,
                "memory {memory}, {ids:?}, frame {index}: other events"
            );
        }
        assert_eq!(service.synthesis(), [Synthesis::Rigid]);
        assert_eq!(uploader.producer.finish().unwrap(), (FRAMES as u64, 0));
        until("its goodbye", || service.counts()[0].finished == 1);
        assert_eq!(service.counts()[0].device_copies, copies * FRAMES as u64);
    }
    assert_device_silent(&device);
    assert_silent();
}

/// The interval of a frame whose predecessors were dropped begins earlier than its poses do. It gets theirs too.
#[test]
fn poses_of_dropped_frames_are_not_lost() {
    let run = Run::default();
    let expected = run.alone(&[0, 3]);
    // Vectors do not span the dropped frames. That is no reason to doubt the poses.
    let config = config(Synthesis::Auto, IdFormat::U32, run.scene.intrinsics());
    let terms = CameraTerms { latest: true, slots: 4, ..(&config).into() };
    let place = Place::default();
    let rig = Rig::new(&DEVICE, &[config]).unwrap();
    let mut service = Service::open(rig, &place.path(), &[terms], ServerOptions::default()).unwrap();
    let device = other_device();
    let mut uploader = Uploader::connect(&device, &place.path(), &options(0, MEMORY_HOST)).unwrap();
    for (frames, expected) in [(0..1, &expected[0]), (1..4, &expected[1])] {
        let last = frames.end;
        frames.for_each(|index| send(&run, &mut uploader, index, IdFormat::U32));
        until("all frames", || service.counts()[0].frames == last as u64);
        let tick = service.tick(60 * SECOND).unwrap().expect("the newest frame");
        assert_eq!(tick.t_ns[0], Some(run.frames[last - 1].0));
        assert!(tick.tick.packets[0] == *expected, "frame {last}: other events");
    }
    assert!(!expected[1].is_empty());
    assert_eq!((service.synthesis(), service.pose_warnings()), (vec![Synthesis::Rigid], &[None][..]));
    assert_eq!(uploader.producer.finish().unwrap(), (2, 2));
    drop(service);
    assert_device_silent(&device);
    assert_silent();
}

/// A service of two cameras. The rig's camera 1 has another lens than the server tells the producer.
fn refusing_camera_1(run: &Run, place: &Place) -> Service {
    let config = run.config(IdFormat::U32);
    let mut other = config.clone();
    other.camera = 1;
    let lens = Intrinsics::pinhole(50.0, 50.0, 20.0, 20.0).unwrap();
    other.geometry.as_mut().unwrap().lens = lens;
    let terms: [CameraTerms; 2] = [(&config).into(), (&config).into()];
    let rig = Rig::new(&DEVICE, &[config, other]).unwrap();
    Service::open(rig, &place.path(), &terms, ServerOptions::default()).unwrap()
}

/// A rig whose camera has another lens than the server told the producer refuses its poses. That ends this link alone.
#[test]
fn poses_that_the_rig_refuses_end_their_own_link() {
    let (run, place) = (Run::default(), Place::default());
    let expected = run.alone(&[0, 1, 2, 3]);
    let mut service = refusing_camera_1(&run, &place);
    let device = other_device();
    let connect = |camera| Uploader::connect(&device, &place.path(), &options(camera, MEMORY_HOST)).unwrap();
    let (mut served, mut refused) = (connect(0), connect(1));
    send(&run, &mut refused, 0, IdFormat::U32);
    for (index, expected) in expected.iter().enumerate() {
        send(&run, &mut served, index, IdFormat::U32);
        until("the frames", || {
            service.counts()[0].frames == index as u64 + 1 && service.counts()[1].frames == 1
        });
        let tick = service.tick(60 * SECOND).unwrap().expect("a frame");
        assert_eq!(tick.t_ns, [Some(run.frames[index].0), None]);
        assert!(tick.tick.packets[0] == *expected, "frame {index}: other events");
    }
    let counts = service.counts();
    assert_eq!((counts[1].lost, counts[1].abandoned, counts[1].stepped), (1, 1, 0));
    let notices = service.server().notices().join("\n");
    assert!(notices.contains("camera 1: the poses are those of a camera with"), "{notices}");
    assert!(!notices.contains("camera 1: camera 1"), "{notices}");
    assert_eq!(served.producer.finish().unwrap(), (FRAMES as u64, 0));
    drop(service);
    assert_device_silent(&device);
    assert_silent();
}

#[test]
fn a_frame_that_is_refused_in_a_tick_that_fails_is_counted_once() {
    let name = "rigid::a_frame_that_is_refused_in_a_tick_that_fails_is_counted_once";
    if !in_a_process_of_its_own(name, None) {
        return;
    }
    let (run, place) = (Run::default(), Place::default());
    let mut service = refusing_camera_1(&run, &place);
    let device = other_device();
    let connect = |camera| Uploader::connect(&device, &place.path(), &options(camera, MEMORY_HOST)).unwrap();
    let (mut served, mut refused) = (connect(0), connect(1));
    // So that the device has taken room for the poses before it fails.
    send(&run, &mut served, 0, IdFormat::U32);
    assert!(service.tick(60 * SECOND).unwrap().is_some());
    send(&run, &mut refused, 0, IdFormat::U32);
    send(&run, &mut served, 1, IdFormat::U32);
    until("the frames", || service.counts().iter().map(|counts| counts.frames).eq([2, 1]));
    fails(&mut service);
    let counts = service.counts();
    assert_eq!([counts[0].dropped, counts[0].abandoned, counts[0].lost], [1, 0, 0]);
    assert_eq!([counts[1].dropped, counts[1].abandoned, counts[1].lost], [0, 1, 1]);
    assert_eq!(served.producer.finish().unwrap(), (1, 1));
    drop(service);
    assert_device_silent(&device);
    assert_silent();
}

/// A producer whose poses do not predict its vectors is told of, and its vectors are followed where that is allowed.
#[test]
fn poses_that_disagree_with_the_vectors_are_told_of_and_left_out() {
    let run = Run::default();
    let turned = |pose: &Pose| pose.inverse();
    let track = |track: &PoseTrack| {
        PoseTrack::new(track.times_ns().to_vec(), track.poses().iter().map(turned).collect()).unwrap()
    };
    let mut wrong = SceneMotion::new(*run.motion.lens(), run.motion.camera().clone());
    for id in run.motion.ids() {
        wrong.insert(id, track(run.motion.instance(id).unwrap())).unwrap();
    }
    let any = config(Synthesis::Auto, IdFormat::U32, run.scene.intrinsics());
    let device = other_device();
    for memory in [MEMORY_EXPORTED, MEMORY_IMAGES, MEMORY_HOST] {
        let place = Place::default();
        let rig = Rig::new(&DEVICE, std::slice::from_ref(&any)).unwrap();
        let mut service = Service::open(rig, &place.path(), &[(&any).into()], trusting()).unwrap();
        let mut uploader = Uploader::connect(&device, &place.path(), &options(0, memory)).unwrap();
        let mut without = Vec::new();
        for index in 0..FRAMES {
            let ids = run.ids(index, IdFormat::U32);
            uploader.send_scene(planes(&run, index, &ids), run.frames[index].0, &wrong).unwrap();
            let tick = service.tick(60 * SECOND).unwrap().expect("a frame");
            without.push(tick.tick.diagnostics[0].without_poses);
        }
        let warning = service.pose_warnings()[0].clone().expect("a warning");
        assert!(warning.contains("body from world, not world from body"), "{warning}");
        assert!(warning.contains("its poses are left out"), "{warning}");
        let notices = service.server().notices();
        assert!(notices.iter().any(|line| line.contains("camera 0: warning: ")), "{notices:?}");
        assert!(without[0] == 0 && without[1..].iter().all(|&pixels| pixels > 64), "{without:?}");
        assert_eq!(uploader.producer.finish().unwrap(), (FRAMES as u64, 0));
    }
    assert_device_silent(&device);
    assert_silent();
}

/// A producer that gives colour and motion alone is served by a camera that can do without depth, by motion vectors.
#[test]
fn a_camera_that_takes_depth_does_without_where_it_may() {
    let run = Run::default();
    let any = config(Synthesis::Auto, IdFormat::U32, run.scene.intrinsics());
    let strict = run.config(IdFormat::U32);
    let terms = [&any, &strict].map(CameraTerms::from);
    let place = Place::default();
    let rig = Rig::new(&DEVICE, &[any, strict]).unwrap();
    let mut service = Service::open(rig, &place.path(), &terms, ServerOptions::default()).unwrap();
    let device = other_device();
    let plain = |camera| ProducerOptions { geometry: Gives::Images, ..options(camera, MEMORY_HOST) };
    let Err(error) = Uploader::connect(&device, &place.path(), &plain(1)) else { panic!("it needs depth") };
    assert_eq!(error.code(), ErrorCode::Unsupported, "{error}");
    let mut uploader = Uploader::connect(&device, &place.path(), &plain(0)).unwrap();
    assert_eq!(uploader.producer.client().images().geometry, None);
    let mut events = 0;
    for index in 0..FRAMES {
        send(&run, &mut uploader, index, IdFormat::U32);
        let tick = service.tick(60 * SECOND).unwrap().expect("a frame");
        events += tick.tick.packets[0].len();
        let without = tick.tick.diagnostics[0].without_depth;
        assert_eq!(without, if index == 0 { without } else { u64::from(SIZE.0 * SIZE.1) }, "frame {index}");
    }
    assert!(events > 200, "{events} events");
    assert_eq!(service.synthesis(), [Synthesis::Motion, Synthesis::Rigid]);
    let notices = service.server().notices().join("\n");
    assert!(!notices.contains("warning"), "no depth is missed: {notices}");
    assert_eq!(uploader.producer.finish().unwrap(), (FRAMES as u64, 0));
    // The next producer gives depth.
    let mut uploader = Uploader::connect(&device, &place.path(), &options(0, MEMORY_HOST)).unwrap();
    send(&run, &mut uploader, 0, IdFormat::U32);
    service.tick(60 * SECOND).unwrap().expect("a frame");
    assert_eq!(service.synthesis(), [Synthesis::Rigid; 2]);
    let warning = service.input_warnings()[0].synthesis.clone().expect("a warning");
    assert!(warning.ends_with("its synthesis is `rigid`; it was `motion`"), "{warning}");
    let agreed = service.server().all_agreements();
    assert_eq!(agreed.iter().map(|agreed| agreed.geometry).collect::<Vec<_>>(), [false, true]);
    assert_eq!(uploader.producer.finish().unwrap(), (1, 0));
    drop(service);
    assert_device_silent(&device);
    assert_silent();
}

/// Sends frames whose colour or depth is replaced by these bytes: `told` is said once.
fn assert_told_once(told: &str, hdr: Option<&[u8]>, depth: Option<&[u8]>) {
    let (run, place) = (Run::default(), Place::default());
    let config = run.config(IdFormat::U32);
    let rig = Rig::new(&DEVICE, std::slice::from_ref(&config)).unwrap();
    let mut service =
        Service::open(rig, &place.path(), &[(&config).into()], ServerOptions::default()).unwrap();
    let device = other_device();
    let mut uploader = Uploader::connect(&device, &place.path(), &options(0, MEMORY_HOST)).unwrap();
    for index in 0..FRAMES {
        let ids = run.ids(index, IdFormat::U32);
        let whole = planes(&run, index, &ids);
        let images = Planes { hdr: hdr.unwrap_or(whole.hdr), depth: depth.or(whole.depth), ..whole };
        uploader.send_scene(images, run.frames[index].0, &run.motion).unwrap();
        service.tick(60 * SECOND).unwrap().expect("a frame");
    }
    let notices = service.server().notices();
    assert_eq!(notices.iter().filter(|line| line.starts_with(told)).count(), 1, "{notices:?}");
    assert_eq!(uploader.producer.finish().unwrap(), (FRAMES as u64, 0));
    drop(service);
    assert_device_silent(&device);
    assert_silent();
}

#[test]
fn depth_that_cannot_be_used_is_told_of_once() {
    let nan = f32::NAN.to_ne_bytes().repeat((SIZE.0 * SIZE.1) as usize);
    assert_told_once(
        "camera 0: warning: 100% of the pixels have a depth that is NaN, negative or too small to invert",
        None,
        Some(&nan),
    );
}

#[test]
fn colour_that_cannot_be_used_is_told_of_once() {
    let nan = vec![0xff; Run::default().frames[0].1.hdr.len()];
    assert_told_once("camera 0: warning: 100% of the pixels have a colour that is NaN", Some(&nan), None);
}

#[test]
fn a_producer_is_told_before_it_sends_poses_that_the_engine_would_refuse() {
    let run = Run::default();
    let config = run.config(IdFormat::U32);
    let terms = CameraTerms { max_instances: 1, ..(&config).into() };
    let place = Place::default();
    let rig = Rig::new(&DEVICE, &[config]).unwrap();
    let service = Service::open(rig, &place.path(), &[terms], ServerOptions::default()).unwrap();
    let device = other_device();
    let wrong = Intrinsics::pinhole(1.0, 2.0, 3.0, 4.0).unwrap();
    let other_lens = ProducerOptions { geometry: Gives::GeometryWith(wrong), ..options(0, MEMORY_HOST) };
    let Err(error) = Uploader::connect(&device, &place.path(), &other_lens) else { panic!("another lens") };
    assert!(error.to_string().contains("the producer renders with pinhole fx=1 fy=2 cx=3 cy=4"), "{error}");
    let right = Gives::GeometryWith(run.scene.intrinsics());
    let options = ProducerOptions { geometry: right, ..options(0, MEMORY_HOST) };
    let mut uploader = Uploader::connect(&device, &place.path(), &options).unwrap();
    let ((t_ns, frame), camera) = (&run.frames[0], run.motion.camera());
    let images = Planes { hdr: &*frame.hdr, motion: None, depth: Some(&*frame.depth), ids: None };
    let mut refused = |t_ns: i64, motion: &SceneMotion, words: &str| {
        let error = uploader.send_scene(images, t_ns, motion).unwrap_err();
        assert_eq!(error.code(), ErrorCode::Poses);
        assert!(error.to_string().contains(words), "{error}");
    };
    refused(*t_ns, &SceneMotion::new(wrong, camera.clone()), "lens pinhole fx=1");
    refused(-1, &run.motion, "expected them to span -1 to -1 ns");
    let mut two = SceneMotion::new(*run.motion.lens(), camera.clone());
    two.insert(1, camera.clone()).unwrap();
    two.insert(2, camera.clone()).unwrap();
    refused(*t_ns, &two, "2 instances have poses, the camera takes at most 1");
    drop((uploader, service));
    assert_device_silent(&device);
    assert_silent();
}
