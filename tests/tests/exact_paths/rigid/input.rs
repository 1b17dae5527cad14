//! Input of synthesis `rigid` that is wrong, missing or changes: each is a clear error that changes nothing, or is
//! counted.

use esaac_engine::{CameraConfig, EngineError, FrameBytes, Rig, RigOptions};
use esaac_model::paths::{Intrinsics, MotionError, Pose, PoseTrack, SceneMotion};
use esaac_model::{FrameError, HdrFormat, MotionFormat, SensorModel, Synthesis, Taps};
use esaac_oracle::synthesize::rigid::Rigid;
use esaac_scene::SceneKind;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::geometry::{KeyFrame, Rendered};
use esaac_tests::saved::with_value;
use glam::DVec3;

const SIZE: (u32, u32) = (45, 29);

fn sensor() -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis: Synthesis::Rigid,
        log_offset: 0.01,
        substeps: 8,
        ..SensorModel::default()
    }
}

fn rendered() -> Rendered {
    Rendered::of(SceneKind::Propeller, SIZE, 4)
}

fn bare_rig(rendered: &Rendered) -> Rig {
    Rig::new(&DEVICE, &[rendered.camera(&sensor())]).expect("a rig")
}

fn step(rig: &mut Rig, frame: &KeyFrame) -> Result<esaac_model::Packet, EngineError> {
    rig.upload(0, &frame.bytes())?;
    Ok(rig.step(&[frame.t_ns])?.packets[0].clone())
}

/// The packets of a rig that is fed without mistakes.
fn packets(rendered: &Rendered) -> Vec<esaac_model::Packet> {
    let mut rig = rendered.rig(&sensor(), RigOptions::default());
    let packets = rendered.frames.iter().map(|frame| step(&mut rig, frame).expect("a frame"));
    let packets: Vec<_> = packets.collect();
    assert!(packets[1].len() > 100, "there are events");
    packets
}

/// A scene of the same lens whose camera stands still from `from_ns` to `to_ns`.
fn still(rendered: &Rendered, from_ns: i64, to_ns: i64) -> SceneMotion {
    let track = PoseTrack::new(vec![from_ns, to_ns], vec![Pose::IDENTITY; 2]).expect("a track");
    SceneMotion::new(*rendered.scene.lens(), track)
}

/// As [`still`], with the instances of the sequence, which stand still too.
fn still_with_instances(rendered: &Rendered, from_ns: i64, to_ns: i64) -> SceneMotion {
    let mut scene = still(rendered, from_ns, to_ns);
    for id in rendered.scene.ids() {
        scene.insert(id, PoseTrack::still(Pose::IDENTITY)).expect("one id");
    }
    scene
}

#[test]
fn rigid_without_geometry_is_refused_and_auto_takes_the_best_that_there_is() {
    let rendered = rendered();
    let plain = CameraConfig { geometry: None, ..rendered.camera(&sensor()) };
    let error = Rig::new(&DEVICE, std::slice::from_ref(&plain)).err().expect("no geometry");
    assert!(matches!(error, EngineError::Frame(FrameError::MissingGeometry { camera: 0 })), "{error}");
    let auto = |geometry: bool, motion: bool| {
        let config = CameraConfig {
            sensor: SensorModel { synthesis: Synthesis::Auto, ..sensor() },
            motion: motion.then_some(MotionFormat::F32x2),
            geometry: rendered.camera(&sensor()).geometry.filter(|_| geometry),
            ..plain.clone()
        };
        let rig = Rig::new(&DEVICE, &[config]).expect("auto needs nothing");
        rig.sensor(0).expect("a camera").synthesis
    };
    assert_eq!(auto(true, true), Synthesis::Rigid);
    assert_eq!(auto(false, true), Synthesis::Motion);
    assert_eq!(auto(false, false), Synthesis::Linear);
    let linear = CameraConfig { sensor: SensorModel { synthesis: Synthesis::Linear, ..sensor() }, ..plain };
    let mut rig = Rig::new(&DEVICE, &[linear]).expect("linear needs nothing");
    let error = rig.set_sensor(0, sensor()).expect_err("no geometry");
    assert!(matches!(error, EngineError::Frame(FrameError::MissingGeometry { .. })), "{error}");
    assert_eq!(rig.sensor(0).expect("a camera").synthesis, Synthesis::Linear);
    let error = rig.set_scene(0, rendered.scene.clone()).expect_err("no geometry");
    assert!(matches!(error, EngineError::NoGeometry { camera: 0 }), "{error}");
    let error = rig.set_scene(3, rendered.scene.clone()).expect_err("one camera");
    assert!(matches!(error, EngineError::NoSuchCamera { .. }), "{error}");
    assert_silent();
}

#[test]
fn poses_that_are_refused_change_nothing() {
    let rendered = rendered();
    let expected = packets(&rendered);
    let mut rig = bare_rig(&rendered);
    let error = step(&mut rig, &rendered.frames[0]).expect_err("no poses");
    assert!(matches!(error, EngineError::NoScene { camera: 0 }), "{error}");
    // The first frame needs poses at its own time only, whatever they are.
    rig.set_scene(0, still_with_instances(&rendered, 0, 1)).expect("a scene of this lens");
    assert!(step(&mut rig, &rendered.frames[0]).expect("poses at its time") == expected[0]);
    let error = step(&mut rig, &rendered.frames[1]).expect_err("the poses end at once");
    let EngineError::Poses { camera: 0, source } = &error else { panic!("{error}") };
    assert!(matches!(**source, MotionError::Camera(_)), "{error}");
    assert!(error.to_string().contains("expected them to span 0 to 33333333 ns"), "{error}");
    let other = Intrinsics::pinhole(50.0, 50.0, 20.0, 10.0).expect("a lens");
    let scene = SceneMotion::new(other, PoseTrack::still(Pose::IDENTITY));
    let error = rig.set_scene(0, scene).expect_err("another lens");
    assert!(matches!(error, EngineError::Lens { camera: 0, .. }), "{error}");
    rig.set_scene(0, rendered.scene.clone()).expect("a scene of this lens");
    for (frame, expected) in rendered.frames.iter().zip(&expected).skip(1) {
        assert!(step(&mut rig, frame).expect("a frame") == *expected);
    }
    assert_silent();
}

#[test]
fn poses_of_several_cameras_are_set_together_or_not_at_all() {
    let rendered = rendered();
    let expected = packets(&rendered);
    let configs = [0, 1].map(|camera| CameraConfig { camera, ..rendered.camera(&sensor()) });
    let mut rig = Rig::new(&DEVICE, &configs).expect("a rig");
    let other = Intrinsics::pinhole(50.0, 50.0, 20.0, 10.0).expect("a lens");
    let wrong = SceneMotion::new(other, PoseTrack::still(Pose::IDENTITY));
    let error = rig.set_scenes(vec![(0, rendered.scene.clone()), (1, wrong)]).expect_err("another lens");
    assert!(matches!(error, EngineError::Lens { camera: 1, .. }), "{error}");
    let error = rig.step(&[0, 0]).err().expect("no camera has poses");
    assert!(matches!(error, EngineError::NoScene { camera: 0 }), "{error}");
    rig.set_scenes(vec![(0, rendered.scene.clone()), (1, rendered.scene.clone())]).expect("their lens");
    for (frame, expected) in rendered.frames.iter().zip(&expected) {
        for camera in 0..2 {
            rig.upload(camera, &frame.bytes()).expect("a frame");
        }
        let packets = rig.step(&[frame.t_ns; 2]).expect("a frame").packets;
        assert!(packets[0] == *expected && packets[1].len() == expected.len());
    }
    assert_silent();
}

#[test]
fn images_that_are_missing_or_of_the_wrong_size_are_named() {
    let rendered = rendered();
    let expected = packets(&rendered);
    let mut rig = rendered.rig(&sensor(), RigOptions::default());
    let frame = &rendered.frames[0];
    let bad = [
        (FrameBytes { depth: None, ..frame.bytes() }, "depth has 0 bytes"),
        (
            FrameBytes { depth: Some(&frame.depth[4..]), ..frame.bytes() },
            "depth has 5216 bytes, expected 5220",
        ),
        (FrameBytes { ids: None, ..frame.bytes() }, "ids has 0 bytes"),
        (FrameBytes { ids: Some(&frame.ids[1..]), ..frame.bytes() }, "ids has 5219 bytes, expected 5220"),
    ];
    for (bytes, what) in bad {
        let error = rig.upload(0, &bytes).expect_err(what).to_string();
        assert!(error.contains(what), "{error}, expected {what}");
    }
    for (frame, expected) in rendered.frames.iter().zip(&expected) {
        assert!(step(&mut rig, frame).expect("a frame") == *expected);
    }
    assert_silent();
}

/// A frame whose depth and ids are changed pixel by pixel.
pub(super) fn changed(frame: &KeyFrame, change: impl Fn(usize, &mut f32, &mut u32)) -> KeyFrame {
    let mut depth: Vec<f32> = bytemuck::pod_collect_to_vec(&frame.depth);
    let mut ids: Vec<u32> = bytemuck::pod_collect_to_vec(&frame.ids);
    for (pixel, (depth, id)) in depth.iter_mut().zip(&mut ids).enumerate() {
        change(pixel, depth, id);
    }
    let (depth, ids) = (bytemuck::cast_slice(&depth).to_vec(), bytemuck::cast_slice(&ids).to_vec());
    KeyFrame::new(frame.t_ns, frame.hdr.clone(), frame.motion.clone(), depth, ids)
}

#[test]
fn pixels_without_a_path_are_counted_by_their_reason() {
    let rendered = rendered();
    let bad_depths = [f32::NAN, -1.0, f32::NEG_INFINITY, f32::from_bits(1), f32::from_bits(0xffc0_0001)];
    let frames: Vec<KeyFrame> = rendered.frames[..2]
        .iter()
        .map(|frame| {
            changed(frame, |pixel, depth, id| match pixel % 31 {
                3 => *depth = bad_depths[pixel % bad_depths.len()],
                // An instance without poses, whatever its depth.
                8 => (*id, *depth) = (0x0001_0007, f32::NAN),
                9 => *id = u32::MAX,
                // Background, either way.
                11 => *depth = f32::INFINITY,
                12 => *depth = -0.0,
                _ => {}
            })
        })
        .collect();
    let planes: Vec<_> = frames.iter().map(|frame| frame.planes(&sensor())).collect();
    let mut rig = rendered.rig(&sensor(), RigOptions::default());
    let input = |frame: usize| frames[frame].input(SIZE, &planes[frame]);
    let oracle = Rigid::new(&rendered.scene, [input(0), input(1)], 0.01, (Taps::Cubic, 1), None);
    for (key, frame) in frames.iter().enumerate() {
        rig.upload(0, &frame.bytes()).expect("a frame");
        let found = rig.step(&[frame.t_ns]).expect("a frame").diagnostics[0];
        let expected = oracle.without_path(key);
        assert_eq!(
            (found.without_depth, found.without_poses, found.without_lens),
            (expected.depth, expected.poses, expected.lens),
            "frame {key}"
        );
        assert!(expected.depth > 30 && expected.poses > 60, "{expected:?}");
    }
    assert_silent();
}

#[test]
fn a_narrow_fisheye_counts_what_it_does_not_show() {
    let mut rendered = rendered();
    let lens = Intrinsics::fisheye(6.0, 6.0, 22.0, 14.0).expect("a lens");
    rendered.scene = SceneMotion::new(lens, PoseTrack::still(Pose::IDENTITY));
    let planes: Vec<_> = rendered.frames.iter().map(|frame| frame.planes(&sensor())).collect();
    let frames: Vec<KeyFrame> =
        rendered.frames.iter().map(|frame| changed(frame, |_, _, id| *id = 0)).collect();
    let input = |frame: usize| frames[frame].input(SIZE, &planes[frame]);
    let oracle = Rigid::new(&rendered.scene, [input(0), input(1)], 0.01, (Taps::Cubic, 1), None);
    let mut rig = rendered.rig(&sensor(), RigOptions::default());
    for (key, frame) in frames.iter().enumerate().take(2) {
        rig.upload(0, &frame.bytes()).expect("a frame");
        let found = rig.step(&[frame.t_ns]).expect("a frame").diagnostics[0];
        assert_eq!(found.without_lens, oracle.without_path(key).lens);
        assert!(found.without_lens > 100, "the corners lie behind the camera: {}", found.without_lens);
    }
    assert_silent();
}

fn after_two_frames(rendered: &Rendered) -> Rig {
    let mut rig = rendered.rig(&sensor(), RigOptions::default());
    for frame in &rendered.frames[..2] {
        step(&mut rig, frame).expect("a frame");
    }
    rig
}

#[test]
fn a_saved_rig_goes_on_as_if_it_had_not_stopped() {
    let rendered = rendered();
    let expected = packets(&rendered);
    let saved = after_two_frames(&rendered).save().expect("a rig that is well");
    // Rows of instances come from the saved state, whatever this rig has had.
    let mut other = bare_rig(&rendered);
    let mut strange = still(&rendered, 0, 1 << 40);
    strange.insert(77, PoseTrack::still(Pose::IDENTITY)).expect("one id");
    other.set_scene(0, strange).expect("a scene of this lens");
    step(&mut other, &rendered.frames[0]).expect("a frame");
    other.restore(&saved).expect("a state of this camera");
    other.set_scene(0, rendered.scene.clone()).expect("a scene of this lens");
    for (index, frame) in rendered.frames.iter().enumerate().skip(2) {
        assert!(step(&mut other, frame).expect("a frame") == expected[index], "frame {index}");
    }
    let lens = Intrinsics::pinhole(50.0, 50.0, 20.0, 10.0).expect("a lens");
    let wide =
        Rendered { scene: SceneMotion::new(lens, PoseTrack::still(Pose::IDENTITY)), ..rendered.clone() };
    let error = bare_rig(&wide).restore(&saved).expect_err("another lens").to_string();
    assert!(error.contains("another lens"), "{error}");
    let no_geometry = CameraConfig {
        geometry: None,
        sensor: SensorModel { synthesis: Synthesis::Linear, ..sensor() },
        ..rendered.camera(&sensor())
    };
    assert!(Rig::new(&DEVICE, &[no_geometry]).expect("a rig").restore(&saved).is_err());
    assert_silent();
}

/// Surfaces have 16 bits for the row of their instance.
#[test]
fn a_saved_state_with_too_many_instances_is_refused() {
    let rendered = rendered();
    let expected = packets(&rendered);
    let mut rig = after_two_frames(&rendered);
    let saved = rig.save().expect("a rig that is well");
    let most = 0xffff_u32;
    // None of these is of the scene, so its instances need rows of their own.
    let others: Vec<u32> = std::iter::once(0).chain(1_000_001..1_000_000 + most).collect();
    let refused = |rig: &mut Rig, ids: &[u32]| {
        rig.restore(&with_value(&saved, "instances", &format!("{ids:?}"))).expect_err("not such instances")
    };
    let own = rendered.scene.ids().count();
    match refused(&mut rig, &others) {
        EngineError::TooManyInstances { camera: 0, expected, actual } => {
            assert_eq!((expected, actual), (most as usize, most as usize + own));
        }
        error => panic!("{error}"),
    }
    let too_many: Vec<u32> = (0..=most).collect();
    assert!(matches!(refused(&mut bare_rig(&rendered), &too_many), EngineError::TooManyInstances { .. }));
    let error = refused(&mut rig, &[0, 7, 7]).to_string();
    assert!(error.contains("2 different ids in 3 rows"), "{error}");
    // The rig has not changed.
    for (index, frame) in rendered.frames.iter().enumerate().skip(2) {
        assert!(step(&mut rig, frame).expect("a frame") == expected[index], "frame {index}");
    }
    assert_silent();
}

#[test]
fn reset_and_a_change_of_synthesis_begin_anew() {
    let rendered = rendered();
    let expected = packets(&rendered);
    let mut rig = bare_rig(&rendered);
    // As `linear` first, with room for `rigid` made later.
    let linear = SensorModel { synthesis: Synthesis::Linear, ..sensor() };
    rig.set_sensor(0, linear.clone()).expect("any synthesis");
    step(&mut rig, &rendered.frames[0]).expect("no poses needed");
    step(&mut rig, &rendered.frames[1]).expect("no poses needed");
    rig.set_sensor(0, sensor()).expect("a camera with geometry");
    assert!(rig.is_at_start(0).expect("a camera"));
    rig.set_scene(0, rendered.scene.clone()).expect("a scene of this lens");
    for round in 0..2 {
        for (index, frame) in rendered.frames.iter().enumerate() {
            let packet = step(&mut rig, frame).expect("a frame");
            assert_eq!(packet.len(), expected[index].len(), "round {round}, frame {index}");
            assert!(packet.iter().eq(expected[index].iter()), "round {round}, frame {index}");
        }
        rig.reset(0).expect("a camera");
    }
    // Adding sub-steps makes room for their instants.
    let fine = SensorModel { substeps: 64, ..sensor() };
    rig.set_sensor(0, fine.clone()).expect("more sub-steps");
    let mut fresh = rendered.rig(&fine, RigOptions::default());
    for frame in &rendered.frames {
        let (changed, own) =
            (step(&mut rig, frame).expect("a frame"), step(&mut fresh, frame).expect("a frame"));
        assert!(changed.iter().eq(own.iter()));
    }
    assert_silent();
}

#[test]
fn instances_may_come_and_go() {
    let rendered = rendered();
    let expected = packets(&rendered);
    let mut rig = rendered.rig(&sensor(), RigOptions::default());
    for (index, frame) in rendered.frames.iter().enumerate() {
        // Instances that no pixel shows, more of them at every frame: the tables grow, and rows are taken again.
        let mut scene = rendered.scene.clone();
        for id in 0..8 << index {
            let pose = Pose::new(glam::DQuat::IDENTITY, DVec3::new(f64::from(id), 0.0, 0.0)).expect("a pose");
            scene.insert(1000 + 100 * index as u32 + id, PoseTrack::still(pose)).expect("one id");
        }
        rig.set_scene(0, scene).expect("a scene of this lens");
        assert!(step(&mut rig, frame).expect("a frame") == expected[index], "frame {index}");
    }
    // Without the poses of what the last frame shows, its pixels have no path.
    rig.set_scene(0, still(&rendered, 0, 1 << 40)).expect("a scene of this lens");
    let last = rendered.frames.last().expect("frames");
    let next = KeyFrame::new(
        last.t_ns + 33_333_333,
        last.hdr.clone(),
        last.motion.clone(),
        last.depth.clone(),
        last.ids.clone(),
    );
    rig.upload(0, &next.bytes()).expect("a frame");
    let found = rig.step(&[next.t_ns]).expect("a frame").diagnostics[0];
    let moving = bytemuck::pod_collect_to_vec::<u8, u32>(&last.ids).iter().filter(|&&id| id != 0).count();
    assert_eq!(found.without_poses, moving as u64);
    assert!(moving > 20, "the scene has a body");
    assert_silent();
}

#[test]
fn each_of_many_cameras_has_its_own_poses() {
    let rendered = rendered();
    let expected = packets(&rendered);
    let cameras = 16;
    let mut rig = Rig::new(&DEVICE, &vec![rendered.camera(&sensor()); cameras]).expect("a rig");
    for camera in 0..cameras {
        // More instances at each, so that threads share them out unevenly.
        let mut scene = rendered.scene.clone();
        for id in 0..camera as u32 {
            scene.insert(1000 + id, PoseTrack::still(Pose::IDENTITY)).expect("one id");
        }
        rig.set_scene(camera, scene).expect("a scene of this lens");
    }
    // One of them is wrong: nothing moves.
    rig.set_scene(7, still_with_instances(&rendered, 0, 1 << 40)).expect("a scene of this lens");
    for (index, frame) in rendered.frames.iter().enumerate() {
        for camera in 0..cameras {
            rig.upload(camera, &frame.bytes()).expect("a frame");
        }
        let tick = rig.step(&vec![frame.t_ns; cameras]).expect("a frame");
        for (camera, packet) in tick.packets.iter().enumerate() {
            let same = packet.iter().eq(expected[index].iter());
            assert_eq!(same, camera != 7 || index == 0, "camera {camera}, frame {index}");
        }
    }
    assert_silent();
}

#[test]
fn memory_is_reported_by_purpose_and_only_where_it_is_used() {
    let rendered = rendered();
    let purposes = |synthesis: Synthesis| {
        let sensor = SensorModel { synthesis, ..sensor() };
        let rig = Rig::new(&DEVICE, &[rendered.camera(&sensor)]).expect("a rig");
        let of_camera = rig.memory().into_iter().filter(|m| m.camera == Some(0) && m.bytes > 0);
        of_camera.map(|m| (m.purpose, m.bytes)).collect::<std::collections::BTreeMap<_, _>>()
    };
    let (rigid, linear) = (purposes(Synthesis::Rigid), purposes(Synthesis::Linear));
    let pixels = u64::from(SIZE.0 * SIZE.1);
    for purpose in ["surfaces", "slopes", "representatives", "passing", "poses", "paths"] {
        assert!(rigid.contains_key(purpose), "{purpose}");
        assert!(!linear.contains_key(purpose), "{purpose}");
    }
    assert_eq!((rigid["surfaces"], rigid["slopes"]), (16 * pixels, 8 * pixels));
    for image in ["input depth", "input ids"] {
        assert_eq!(rigid[image], (4 * pixels).next_multiple_of(16), "{image}");
    }
    assert_silent();
}

#[test]
fn a_colour_only_camera_beside_a_rigid_one_is_untouched() {
    let rendered = rendered();
    let expected = packets(&rendered);
    let linear = CameraConfig {
        sensor: SensorModel { synthesis: Synthesis::Linear, ..sensor() },
        hdr: HdrFormat::F32x4,
        geometry: None,
        ..rendered.camera(&sensor())
    };
    let mut alone = Rig::new(&DEVICE, std::slice::from_ref(&linear)).expect("a rig");
    let mut both = Rig::new(&DEVICE, &[linear, rendered.camera(&sensor())]).expect("a rig");
    both.set_scene(1, rendered.scene.clone()).expect("a scene of this lens");
    for (index, frame) in rendered.frames.iter().enumerate() {
        let colour = FrameBytes { hdr: &frame.hdr, ..FrameBytes::default() };
        alone.upload(0, &colour).expect("a frame");
        both.upload(0, &colour).expect("a frame");
        both.upload(1, &frame.bytes()).expect("a frame");
        let own = alone.step(&[frame.t_ns]).expect("a frame").packets[0].clone();
        let tick = both.step(&[frame.t_ns; 2]).expect("a frame");
        assert!(tick.packets[0] == own, "frame {index}");
        assert!(tick.packets[1] == expected[index], "frame {index}");
    }
    assert_silent();
}
