//! Depth and poses: who gives them, and what of a peer's poses is let through.

use esaac_engine::GeometryConfig;
use esaac_interop::session::{Action, Agreement, Session, Terms, agree};
use esaac_interop::wire::{
    self, Brought, ErrorCode, FrameNotice, Hello, ImageMemory, Lens, MAX_POSES, MAX_SAMPLES, Message, Sample,
    Track, Version,
};
use esaac_interop::{FrameScene, Images, InteropError};
use esaac_model::paths::Intrinsics;
use esaac_model::{DepthFormat, HdrFormat, IdFormat, MotionFormat};
use proptest::prelude::*;

const MS: i64 = 1_000_000;

const LENS: Lens =
    Lens { projection: wire::LENS_PINHOLE, reserved: 0, fx_px: 20.0, fy_px: 21.0, cx_px: 5.5, cy_px: 4.0 };

fn terms() -> Terms {
    let lens = Intrinsics::pinhole(20.0, 21.0, 5.5, 4.0).unwrap();
    let geometry = GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U16), lens };
    Terms {
        camera: 2,
        images: Images {
            width_px: 12,
            height_px: 9,
            hdr: HdrFormat::F16x4,
            motion: Some(MotionFormat::F16x2),
            geometry: Some(geometry),
        },
        requires_geometry: false,
        max_instances: 3,
        slots: 3,
        backpressure: wire::LOSSLESS,
        device_uuid: [1; 16],
        driver_uuid: [2; 16],
        memories: wire::MEMORY_HOST | wire::MEMORY_BROUGHT,
        host_refused: None,
        timelines: wire::TIMELINE_CARRIED,
    }
}

fn producer(gives: u32, lens: Lens) -> Hello {
    Hello { gives, lens, memories: wire::MEMORY_HOST, timelines: wire::TIMELINE_CARRIED, ..Hello::default() }
}

fn agreement(memory: u32) -> Agreement {
    Agreement { version: Version::Two, memory, timeline: wire::TIMELINE_CARRIED, geometry: true }
}

fn session() -> Session {
    Session::new(&terms(), agreement(wire::MEMORY_HOST))
}

/// A body that moves along x, sampled at these times.
fn track(instance: Option<u32>, times_ns: &[i64]) -> Track {
    let sample = |&t_ns: &i64| Sample { t_ns, xyz_qxyzw: [1e-9 * t_ns as f64, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] };
    Track { instance, samples: times_ns.iter().map(sample).collect() }
}

fn frame(slot: u32, t_ns: i64, poses: usize) -> Message {
    Message::Frame(FrameNotice { slot, value: 1, t_ns, poses: poses as u32, ..FrameNotice::default() })
}

fn poses_of(tracks: &[Track]) -> usize {
    tracks.iter().map(|track| track.samples.len()).sum()
}

/// Sends tracks and a frame at `t_ns` after a first frame at 0.
fn second_frame(tracks: Vec<Track>, t_ns: i64) -> Result<FrameScene, InteropError> {
    let mut session = session();
    session.receive(&Message::Poses(vec![track(None, &[0])]), 0).unwrap();
    session.receive(&frame(0, 0, 1), 0).unwrap();
    let poses = poses_of(&tracks);
    assert_eq!(session.receive(&Message::Poses(tracks), 0)?, Action::Nothing);
    match session.receive(&frame(1, t_ns, poses), 0)? {
        Action::Queue(_, Some(scene)) => Ok(scene),
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn refused(tracks: Vec<Track>, words: &str) {
    let error = second_frame(tracks, 10 * MS).expect_err(words);
    assert_eq!(error.code(), ErrorCode::Poses, "{error}");
    assert!(error.to_string().contains(words), "no `{words}` in: {error}");
    assert!(error.words().len() <= 256, "{} bytes", error.words().len());
}

#[test]
fn depth_and_poses_come_if_the_camera_takes_them_and_the_producer_gives_them() {
    let without = Terms { images: Images { geometry: None, ..terms().images }, ..terms() };
    let required = Terms { requires_geometry: true, ..terms() };
    for (terms, version, gives, expected) in [
        (&terms(), Version::Two, wire::GIVES_GEOMETRY, true),
        (&required, Version::Two, wire::GIVES_GEOMETRY, true),
        (&terms(), Version::Two, 0, false),
        (&terms(), Version::One, 0, false),
        (&without, Version::Two, wire::GIVES_GEOMETRY, false),
        (&without, Version::One, 0, false),
    ] {
        let agreed = agree(version, &producer(gives, Lens::default()), terms).unwrap();
        assert_eq!((agreed.geometry, agreed.version), (expected, version));
        let images = terms.images_by(agreed);
        assert_eq!(images.count(), if expected { 4 } else { 2 });
    }
    let error = agree(Version::One, &producer(0, Lens::default()), &required).unwrap_err();
    assert_eq!(error.code(), ErrorCode::Unsupported);
    assert!(error.to_string().contains("camera 2 needs depth and poses by its synthesis"), "{error}");
}

#[test]
fn a_producer_renders_with_the_lens_of_the_rig() {
    let by = |lens: Lens| agree(Version::Two, &producer(wire::GIVES_GEOMETRY, lens), &terms());
    assert!(by(LENS).unwrap().geometry);
    // As a renderer has it that computes in single precision.
    assert!(by(Lens { fx_px: 20.000_01, ..LENS }).is_ok());
    for lens in [
        Lens { fx_px: 20.02, ..LENS },
        Lens { fy_px: -21.0, ..LENS },
        Lens { cx_px: 6.0, ..LENS },
        Lens { cy_px: f64::NAN, ..LENS },
        Lens { projection: wire::LENS_FISHEYE, ..LENS },
        Lens { projection: 77, ..LENS },
    ] {
        let error = by(lens).unwrap_err();
        assert_eq!(error.code(), ErrorCode::Camera, "{error}");
        assert!(error.to_string().contains("pinhole fx=20 fy=21 cx=5.5 cy=4 in the rig"), "{error}");
    }
    // Who gives no depth may have any.
    assert!(agree(Version::Two, &producer(0, Lens { fx_px: 1.0, ..LENS }), &terms()).is_ok());
}

#[test]
fn a_frame_comes_with_the_poses_of_its_interval() {
    let times_ns: Vec<i64> = (-2..=12).map(|ms| ms * MS).collect();
    let tracks = vec![track(None, &times_ns), track(Some(9), &times_ns), track(Some(70_000), &[3])];
    let scene = second_frame(tracks, 10 * MS).unwrap();
    assert_eq!((scene.from_ns, scene.to_ns), (0, 10 * MS));
    assert_eq!(scene.motion.ids().collect::<Vec<_>>(), [9, 70_000]);
    assert_eq!(scene.motion.camera().times_ns(), times_ns);
    assert!((scene.motion.camera().at(5 * MS).unwrap().translation_m().x - 0.005).abs() < 1e-12);
    // The first frame needs its own time alone, in one message or in many.
    let mut session = session();
    for instance in [Some(1), None, Some(2)] {
        session.receive(&Message::Poses(vec![track(instance, &[-5, 0, 5])]), 0).unwrap();
    }
    assert!(matches!(session.receive(&frame(0, 0, 9), 0), Ok(Action::Queue(_, Some(_)))));
}

#[test]
fn poses_that_are_none_are_refused() {
    let times_ns = [0, 5 * MS, 10 * MS];
    let with = |change: &dyn Fn(&mut Sample)| {
        let mut bad = track(Some(4), &times_ns);
        change(&mut bad.samples[1]);
        vec![track(None, &times_ns), bad]
    };
    refused(with(&|s| s.xyz_qxyzw[6] = 2.0), "instance 4: pose 1: the quaternion has length 2, expected 1");
    refused(with(&|s| s.xyz_qxyzw[3..].fill(0.0)), "instance 4: pose 1: the quaternion has length 0");
    refused(with(&|s| s.xyz_qxyzw[0] = f64::NAN), "instance 4: pose 1: x is NaN");
    refused(with(&|s| s.xyz_qxyzw[5] = f64::INFINITY), "instance 4: pose 1: qz is inf");
    refused(with(&|s| s.xyz_qxyzw[2] = -2e9), "instance 4: pose 1: a coordinate is -2000000000 m");
    refused(with(&|s| s.t_ns = 0), "instance 4: pose 1 is at 0 ns, expected after pose 0");
    refused(with(&|s| s.t_ns = i64::MIN), "instance 4: pose 1 is at -9223372036854775808 ns");
    refused(with(&|s| s.t_ns = i64::MAX), "expected after pose 1 at 9223372036854775807 ns");
}

#[test]
fn poses_that_do_not_span_the_interval_are_refused() {
    let whole = track(None, &[0, 10 * MS]);
    refused(vec![track(None, &[1, 10 * MS])], "camera: poses from 1 to 10000000 ns");
    refused(vec![track(None, &[0, 10 * MS - 1])], "expected them to span 0 to 10000000 ns");
    refused(vec![whole.clone(), track(Some(7), &[0, MS])], "instance 7: poses from 0 to 1000000 ns");
    refused(vec![track(Some(7), &[0, 10 * MS])], "no poses of the camera");
    refused(vec![whole.clone(), track(Some(7), &[])], "instance 7: a track of 0 poses");
    refused(vec![whole.clone(), whole.clone()], "camera: it has two tracks");
    refused(vec![whole, track(Some(7), &[0]), track(Some(7), &[0])], "instance 7: it has two tracks");
}

#[test]
fn poses_are_no_more_than_there_may_be() {
    let many = |samples: i64| -> Vec<i64> { (0..samples).map(|k| k * 10 * MS / (samples - 1)).collect() };
    let most = MAX_SAMPLES as i64;
    second_frame(vec![track(None, &many(most))], 10 * MS).unwrap();
    refused(vec![track(None, &many(most + 1))], "camera: a track of 1001 poses, expected at most 1000");
    let ids = |count: u32| (1..=count).map(|id| track(Some(id), &[0])).chain([track(None, &[0])]).collect();
    second_frame(ids(3), 10 * MS).unwrap();
    refused(ids(4), "poses of 4 instances, the camera takes at most 3");
    // Over many messages, which are kept until a frame comes.
    let mut session = Session::new(&Terms { max_instances: 4096, ..terms() }, agreement(wire::MEMORY_HOST));
    let full = MAX_POSES / MAX_SAMPLES;
    for id in 1..=full as u32 {
        session.receive(&Message::Poses(vec![track(Some(id), &many(most))]), 0).unwrap();
    }
    let error = session.receive(&Message::Poses(vec![track(None, &many(most))]), 0).unwrap_err();
    assert!(error.to_string().contains("66000 poses for a frame, expected at most 65536"), "{error}");
}

#[test]
fn poses_come_when_they_may_and_are_counted() {
    let protocol = |session: &mut Session, message: &Message, fds: usize, words: &str| {
        let error = session.receive(message, fds).unwrap_err();
        assert_eq!(error.code(), ErrorCode::Protocol);
        assert!(error.to_string().contains(words), "{error}");
    };
    let poses = Message::Poses(vec![track(None, &[0, MS])]);
    protocol(&mut session(), &poses, 1, "POSES with 1 descriptors, expected 0");
    protocol(&mut session(), &frame(0, 0, 1), 0, "FRAME says that 1 poses came for it, 0 did");
    let mut lost = session();
    lost.receive(&poses, 0).unwrap();
    protocol(&mut lost, &frame(0, 0, 0), 0, "FRAME says that 0 poses came for it, 2 did");
    let mut brings = Session::new(&terms(), agreement(wire::MEMORY_BROUGHT));
    protocol(&mut brings, &poses, 0, "POSES came while BROUGHT was awaited");
    let plain = Agreement { geometry: false, ..agreement(wire::MEMORY_HOST) };
    protocol(&mut Session::new(&terms(), plain), &poses, 0, "camera 2 takes no depth and poses");
    protocol(&mut Session::new(&terms(), plain), &frame(0, 0, 3), 0, "0 did");
    // Without poses a frame is none, and poses are for one frame.
    let mut twice = session();
    let error = session().receive(&frame(0, 0, 0), 0).unwrap_err();
    assert_eq!(error.code(), ErrorCode::Poses);
    twice.receive(&poses, 0).unwrap();
    twice.receive(&frame(0, 0, 2), 0).unwrap();
    assert_eq!(twice.receive(&frame(1, MS, 0), 0).unwrap_err().code(), ErrorCode::Poses);
}

#[test]
fn memory_is_brought_for_every_image() {
    let bytes = terms().images.bytes().all();
    assert_eq!(bytes, [864, 432, 432, 224]);
    let brought = |bytes: [u64; 4]| {
        let [hdr, motion, depth, ids] =
            bytes.map(|bytes| ImageMemory { bytes, allocation_bytes: 4096, ..ImageMemory::default() });
        Message::Brought(Brought { hdr, motion, depth, ids, ..Brought::default() })
    };
    let receive =
        |bytes, fds| Session::new(&terms(), agreement(wire::MEMORY_BROUGHT)).receive(&brought(bytes), fds);
    assert!(receive(bytes, 12).is_ok());
    assert_eq!(receive(bytes, 6).unwrap_err().code(), ErrorCode::Protocol);
    for (image, name) in [(2, "depth: 431 bytes"), (3, "ids: 223 bytes")] {
        let mut wrong = bytes;
        wrong[image] -= 1;
        let error = receive(wrong, 12).unwrap_err();
        assert_eq!(error.code(), ErrorCode::Memory);
        assert!(error.to_string().contains(name), "{error}");
    }
}

/// Any number.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => Just(0.0),
        2 => Just(1.0),
        2 => -2.0..2.0_f64,
        1 => any::<f64>(),
        1 => proptest::sample::select(vec![f64::NAN, f64::INFINITY, f64::MIN_POSITIVE, f64::MAX, 1e9]),
    ]
}

fn any_track() -> impl Strategy<Value = Track> {
    let t_ns = prop_oneof![6 => -2 * MS..12 * MS, 1 => any::<i64>()];
    let turn = prop_oneof![
        6 => Just([0.0, 0.0, 0.0, 1.0]),
        1 => [number(), number(), number(), number()],
    ];
    let sample = (t_ns, [number(), number(), number()], turn)
        .prop_map(|(t_ns, [x, y, z], [a, b, c, d])| Sample { t_ns, xyz_qxyzw: [x, y, z, a, b, c, d] });
    let instance =
        prop_oneof![3 => Just(None), 2 => (1_u32..5).prop_map(Some), 1 => (1..u32::MAX).prop_map(Some)];
    (instance, proptest::collection::vec(sample, 0..4), any::<bool>()).prop_map(
        |(instance, mut samples, sort)| {
            if sort {
                samples.sort_by_key(|sample| sample.t_ns);
            }
            Track { instance, samples }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4096, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever tracks a peer sends, what is let through has a finite pose at every time of its interval.
    #[test]
    fn poses_that_get_through_are_finite_and_span_their_interval(
        tracks in proptest::collection::vec(any_track(), 0..4),
        t_ns in prop_oneof![4 => Just(10 * MS), 1 => any::<i64>()],
    ) {
        let bytes = Message::Poses(tracks.clone()).to_bytes(Version::Two, 0);
        let Ok(Message::Poses(read)) = Message::parse(Version::Two, &bytes, 0) else {
            panic!("a message that was written");
        };
        // NaN is not equal to itself.
        prop_assert_eq!(format!("{:?}", &read), format!("{:?}", &tracks));
        if t_ns <= 0 || t_ns > 1_000_000_000 {
            prop_assert!(second_frame(read, t_ns).is_err());
        } else if let Ok(FrameScene { motion, from_ns, to_ns, .. }) = second_frame(read, t_ns) {
            prop_assert_eq!((from_ns, to_ns), (0, t_ns));
            let instances = motion.ids().map(|id| motion.instance(id).unwrap());
            for track in instances.chain([motion.camera()]) {
                for k in 0..=8 {
                    let pose = track.at(t_ns * k / 8).unwrap();
                    prop_assert!(pose.translation_m().is_finite() && pose.rotation().is_finite(), "{:?}", track);
                }
            }
        }
    }
}
