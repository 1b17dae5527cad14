//! Poses that do not predict the motion vectors: what is said of them, and what synthesis `auto` follows.

use super::input::changed;
use esaac_engine::ash::vk;
use esaac_engine::{Buffer, CameraConfig, FrameBytes, InputBuffers, MemoryLocation, Rig, SubmitHooks};
use esaac_model::paths::{Pose, PoseTrack, SceneMotion};
use esaac_model::{MotionFormat, Packet, SensorModel, Synthesis};
use esaac_scene::SceneKind;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::geometry::{KeyFrame, Rendered};

const SIZE: (u32, u32) = (45, 29);

/// Frames of a camera that shakes and of bodies.
fn shaken() -> Rendered {
    Rendered::of(SceneKind::Shake, SIZE, 5)
}

fn camera(rendered: &Rendered, synthesis: Synthesis) -> CameraConfig {
    let sensor = SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        log_offset: 0.01,
        substeps: 8,
        synthesis,
        ..SensorModel::default()
    };
    CameraConfig { motion: Some(MotionFormat::F32x2), ..rendered.camera(&sensor) }
}

/// What a rig of one camera says and sends.
#[derive(Debug, PartialEq)]
struct Outcome {
    packets: Vec<Packet>,
    /// After each frame.
    synthesis: Vec<Synthesis>,
    /// Pixels of each frame whose instance has no poses.
    without_poses: Vec<u64>,
    warning: Option<String>,
}

impl Outcome {
    fn events(&self) -> usize {
        self.packets.iter().map(Packet::len).sum()
    }
}

fn upload(rig: &mut Rig, frame: &KeyFrame) {
    rig.upload(0, &FrameBytes { motion: Some(&frame.motion), ..frame.bytes() }).expect("a frame");
}

fn run_on(rig: &mut Rig, frames: &[KeyFrame]) -> Outcome {
    let mut outcome =
        Outcome { packets: Vec::new(), synthesis: Vec::new(), without_poses: Vec::new(), warning: None };
    for frame in frames {
        upload(rig, frame);
        let tick = rig.step(&[frame.t_ns]).expect("a frame");
        outcome.packets.push(tick.packets[0].clone());
        outcome.without_poses.push(tick.diagnostics[0].without_poses);
        outcome.synthesis.push(rig.synthesis(0).expect("a camera"));
    }
    outcome.warning = rig.convention_warning(0).expect("a camera");
    outcome
}

fn rig(rendered: &Rendered, synthesis: Synthesis) -> Rig {
    let mut rig = Rig::new(&DEVICE, &[camera(rendered, synthesis)]).expect("a rig");
    if synthesis != Synthesis::Motion {
        rig.set_scene(0, rendered.scene.clone()).expect("a scene of this lens");
    }
    rig
}

fn run(rendered: &Rendered, synthesis: Synthesis) -> Outcome {
    run_on(&mut rig(rendered, synthesis), &rendered.frames)
}

fn with_poses(rendered: &Rendered, camera: fn(Pose) -> Pose, bodies: impl Fn(u32, Pose) -> Pose) -> Rendered {
    let track = |track: &PoseTrack, change: &dyn Fn(Pose) -> Pose| {
        let poses = track.poses().iter().map(|&pose| change(pose)).collect();
        PoseTrack::new(track.times_ns().to_vec(), poses).expect("the same times")
    };
    let mut scene = SceneMotion::new(*rendered.scene.lens(), track(rendered.scene.camera(), &camera));
    for id in rendered.scene.ids() {
        let poses = rendered.scene.instance(id).expect("an id of this scene");
        scene.insert(id, track(poses, &|pose| bodies(id, pose))).expect("one id");
    }
    Rendered { scene, ..rendered.clone() }
}

fn with_vectors(rendered: &Rendered, change: impl Fn([f32; 2]) -> [f32; 2]) -> Rendered {
    let frames = rendered.frames.iter().map(|frame| {
        let motion: Vec<[f32; 2]> = bytemuck::pod_collect_to_vec(&frame.motion);
        let motion: Vec<[f32; 2]> = motion.into_iter().map(&change).collect();
        let (depth, ids) = (frame.depth.clone(), frame.ids.clone());
        KeyFrame::new(frame.t_ns, frame.hdr.clone(), bytemuck::cast_slice(&motion).to_vec(), depth, ids)
    });
    Rendered { frames: frames.collect(), ..rendered.clone() }
}

#[test]
fn poses_that_predict_the_vectors_are_followed() {
    let rendered = shaken();
    let (auto, rigid) = (run(&rendered, Synthesis::Auto), run(&rendered, Synthesis::Rigid));
    assert!(auto.events() > 500 && auto == rigid, "{} and {} events", auto.events(), rigid.events());
    assert_eq!((auto.synthesis, auto.warning), (vec![Synthesis::Rigid; 5], None));
    assert_silent();
}

#[test]
fn wrong_poses_of_the_camera_are_told_and_each_pixel_follows_its_vector() {
    let rendered = shaken();
    let motion = run(&rendered, Synthesis::Motion);
    let shifted = Rendered {
        frames: rendered.frames[1..].to_vec(),
        scene: with_times(&rendered.scene, |t_ns| t_ns + 33_333_333),
        ..rendered.clone()
    };
    for (what, wrong, cause) in [
        (
            "inverted",
            with_poses(&rendered, |pose| pose.inverse(), |_, pose| pose),
            "camera from world, not world from camera",
        ),
        ("transposed", with_poses(&rendered, transposed, |_, pose| pose), "rotation is transposed"),
        ("a frame late", shifted, "frame"),
    ] {
        let auto = run(&wrong, Synthesis::Auto);
        let warning = auto.warning.as_deref().unwrap_or("nothing");
        assert!(warning.contains("motion vectors of the static world"), "{what}: {warning}");
        assert!(warning.contains(cause), "{what}: {warning}");
        assert!(warning.contains("synthesis auto: all poses are left out"), "{what}: {warning}");
        // From the first interval on, and in all of them.
        let frames = wrong.frames.len();
        assert_eq!(auto.synthesis[1..], vec![Synthesis::Motion; frames - 1], "{what}");
        assert_eq!(auto.without_poses[1..], vec![u64::from(SIZE.0 * SIZE.1); frames - 1], "{what}");
        assert!(run(&wrong, Synthesis::Auto) == auto, "{what}: another run sends other events");
        if what != "a frame late" {
            let (sent, expected) = (auto.events() as f64, motion.events() as f64);
            assert!((sent / expected - 1.0).abs() < 0.1, "{what}: {sent} events, by motion {expected}");
        }
        // By name, poses are followed.
        let named = run(&wrong, Synthesis::Rigid);
        assert_eq!(named.synthesis, vec![Synthesis::Rigid; frames]);
        assert!(
            named.warning.as_deref().is_some_and(|text| text.contains("as synthesis rigid was asked for"))
        );
        assert!(named != auto, "{what}");
    }
    assert_silent();
}

fn transposed(pose: Pose) -> Pose {
    let rows = pose.to_rows();
    let mut other = rows;
    for i in 0..3 {
        for j in 0..3 {
            other[i][j] = rows[j][i];
        }
    }
    Pose::from_rows(&other).expect("a rotation")
}

#[test]
fn depth_in_another_unit_than_the_poses_is_told() {
    let rendered = Rendered::of(SceneKind::Bounce, SIZE, 3);
    let frames = rendered.frames.iter().map(|frame| changed(frame, |_, depth, _| *depth *= 100.0));
    let wrong = Rendered { frames: frames.collect(), ..rendered.clone() };
    let auto = run(&wrong, Synthesis::Auto);
    let warning = auto.warning.as_deref().unwrap_or("nothing");
    assert!(warning.contains("the depth is 100 times too large for the poses' unit"), "{warning}");
    assert_eq!(auto.synthesis[1..], [Synthesis::Motion; 2]);
    assert_silent();
}

fn with_times(scene: &SceneMotion, change: impl Fn(i64) -> i64) -> SceneMotion {
    let track = |track: &PoseTrack| {
        let times_ns = track.times_ns().iter().map(|&t_ns| change(t_ns)).collect();
        PoseTrack::new(times_ns, track.poses().to_vec()).expect("ascending times")
    };
    let mut shifted = SceneMotion::new(*scene.lens(), track(scene.camera()));
    for id in scene.ids() {
        shifted.insert(id, track(scene.instance(id).expect("an id of this scene"))).expect("one id");
    }
    shifted
}

#[test]
fn wrong_vectors_are_told_and_the_poses_are_followed() {
    let rendered = shaken();
    let (width, height) = (SIZE.0 as f32, SIZE.1 as f32);
    for (wrong, cause) in [
        (with_vectors(&rendered, |[x, y]| [-x, -y]), "sign is flipped"),
        (with_vectors(&rendered, |[x, y]| [x, -y]), "y counts upwards"),
        (with_vectors(&rendered, |[x, y]| [x / width, y / height]), "fractions of the image's size"),
    ] {
        let auto = run(&wrong, Synthesis::Auto);
        let warning = auto.warning.as_deref().unwrap_or("nothing");
        assert!(warning.contains(cause), "{cause}: {warning}");
        assert!(warning.contains("depth and poses are right by that and are followed"), "{warning}");
        assert_eq!(auto.synthesis, [Synthesis::Rigid; 5], "{cause}");
        assert!(auto.packets == run(&wrong, Synthesis::Rigid).packets, "{cause}: other poses are followed");
    }
    assert_silent();
}

#[test]
fn wrong_poses_of_a_body_are_left_out_alone() {
    let rendered = Rendered::of(SceneKind::Bounce, SIZE, 5);
    let body = rendered.scene.ids().next().expect("a ball");
    let wrong = with_poses(&rendered, |pose| pose, |id, pose| if id == body { pose.inverse() } else { pose });
    let auto = run(&wrong, Synthesis::Auto);
    let warning = auto.warning.as_deref().unwrap_or("nothing");
    assert!(warning.contains(&format!("motion vectors of instance {body}: ")), "{warning}");
    assert!(warning.contains("body from world, not world from body"), "{warning}");
    assert!(warning.contains(&format!("instance {body}: its poses are left out")), "{warning}");
    assert_eq!(auto.synthesis, [Synthesis::Rigid; 5]);
    for (frame, without) in rendered.frames.iter().zip(&auto.without_poses).skip(1) {
        let ids: Vec<u32> = bytemuck::pod_collect_to_vec(&frame.ids);
        assert_eq!(*without, ids.iter().filter(|&&id| id == body).count() as u64, "at {} ns", frame.t_ns);
    }
    assert_silent();
}

#[test]
fn a_doubt_lasts_until_a_reset_and_in_a_saved_state() {
    let rendered = shaken();
    let wrong = with_poses(&rendered, |pose| pose.inverse(), |_, pose| pose);
    let expected = run(&wrong, Synthesis::Auto);
    let mut first = rig(&wrong, Synthesis::Auto);
    run_on(&mut first, &wrong.frames[..3]);
    let saved = first.save().expect("a rig that is well");
    // Poses that come anew for each interval change nothing, nor do those of more instances.
    let mut scene = wrong.scene.clone();
    scene.insert(4711, PoseTrack::still(Pose::IDENTITY)).expect("one id");
    first.set_scene(0, scene).expect("a scene of this lens");
    let rest = run_on(&mut first, &wrong.frames[3..]);
    assert!(rest.packets == expected.packets[3..]);
    let mut second = rig(&rendered, Synthesis::Auto);
    second.restore(&saved).expect("a state of this camera");
    assert_eq!(second.synthesis(0).expect("a camera"), Synthesis::Motion);
    second.set_scene(0, wrong.scene.clone()).expect("a scene of this lens");
    assert!(run_on(&mut second, &wrong.frames[3..]).packets == expected.packets[3..]);
    // After a reset poses are followed again, as long as they are right.
    first.reset(0).expect("a camera");
    first.set_scene(0, rendered.scene.clone()).expect("a scene of this lens");
    let again = run_on(&mut first, &rendered.frames);
    assert_eq!((again.synthesis, again.warning), (vec![Synthesis::Rigid; 5], None));
    assert!(
        again
            .packets
            .iter()
            .zip(&run(&rendered, Synthesis::Rigid).packets)
            .all(|(a, b)| a.iter().eq(b.iter()))
    );
    assert_silent();
}

/// Poses that turn wrong after the check is over are followed, whether the rig was saved in between or not.
#[test]
fn a_check_that_is_over_is_over_in_a_saved_state() {
    let rendered = shaken();
    let mut first = rig(&rendered, Synthesis::Auto);
    run_on(&mut first, &rendered.frames);
    let saved = first.save().expect("a rig that is well");
    let mut second = rig(&rendered, Synthesis::Auto);
    second.restore(&saved).expect("a state of this camera");
    // The same frames again, later, with vectors that lead the other way.
    let shift_ns = rendered.frames.last().expect("frames").t_ns + 33_333_333;
    let flipped = with_vectors(&rendered, |[x, y]| [-x, -y]);
    let shifted = |frame: &KeyFrame| {
        let [hdr, motion, depth, ids] =
            [&frame.hdr, &frame.motion, &frame.depth, &frame.ids].map(Clone::clone);
        KeyFrame::new(frame.t_ns + shift_ns, hdr, motion, depth, ids)
    };
    let later: Vec<KeyFrame> = flipped.frames.iter().map(shifted).collect();
    let twice = |track: &PoseTrack| {
        let times_ns = track.times_ns().iter().map(|t_ns| t_ns + shift_ns);
        let all = track.times_ns().iter().copied().chain(times_ns).collect();
        PoseTrack::new(all, [track.poses(), track.poses()].concat()).expect("a track")
    };
    let mut scene = SceneMotion::new(*rendered.scene.lens(), twice(rendered.scene.camera()));
    for id in rendered.scene.ids() {
        let track = rendered.scene.instance(id).expect("an id of this scene");
        let track = if track.poses().len() == 1 { track.clone() } else { twice(track) };
        scene.insert(id, track).expect("one id");
    }
    for rig in [&mut first, &mut second] {
        rig.set_scene(0, scene.clone()).expect("a scene of this lens");
    }
    let [expected, got] = [run_on(&mut first, &later), run_on(&mut second, &later)];
    assert_eq!(expected.synthesis, vec![Synthesis::Rigid; later.len()]);
    assert_eq!(got.synthesis, expected.synthesis);
    assert!(got.packets == expected.packets);
    assert_silent();
}

#[test]
fn vectors_of_frames_that_were_dropped_are_not_compared() {
    let rendered = shaken();
    let frames = [rendered.frames[0].clone(), rendered.frames[3].clone()];
    let mut auto = rig(&rendered, Synthesis::Auto);
    run_on(&mut auto, &frames[..1]);
    auto.skip_convention_check(0).expect("a camera");
    let after = run_on(&mut auto, &frames[1..]);
    assert_eq!((after.synthesis, after.warning), (vec![Synthesis::Rigid], None));
    assert!(auto.convention_report(0).expect("a camera").is_none());
    // The next frame is compared again.
    let next = run_on(&mut auto, &rendered.frames[4..]);
    assert_eq!(next.warning, None);
    assert!(auto.convention_report(0).expect("a camera").is_some_and(|report| report.agrees()));
    assert_silent();
}

/// Frames in buffers of others, for three cameras, one image after the other.
#[test]
fn tiles_in_buffers_of_others_are_compared_too() {
    let rendered = shaken();
    let wrong = with_poses(&rendered, |pose| pose.inverse(), |_, pose| pose);
    let flipped = with_vectors(&rendered, |[x, y]| [-x, -y]);
    let cameras = [&rendered, &wrong, &flipped];
    let mut rig = Rig::new(&DEVICE, &vec![camera(&rendered, Synthesis::Auto); 3]).expect("a rig");
    for (number, of_camera) in cameras.iter().enumerate() {
        rig.set_scene(number, of_camera.scene.clone()).expect("a scene of this lens");
    }
    let buffer = |index: usize, image: fn(&KeyFrame) -> &[u8]| -> Buffer {
        let tiles = cameras.map(|of_camera| image(&of_camera.frames[index])).concat();
        let usage = vk::BufferUsageFlags::empty();
        let mut buffer =
            DEVICE.allocate("tiles", tiles.len() as u64, usage, MemoryLocation::CpuToGpu).expect("memory");
        buffer.write(0, &tiles);
        buffer
    };
    let expected = cameras.map(|of_camera| run(of_camera, Synthesis::Auto));
    for (index, frame) in rendered.frames.iter().enumerate() {
        let images: [fn(&KeyFrame) -> &[u8]; 4] =
            [|frame| &frame.hdr, |frame| &frame.motion, |frame| &frame.depth, |frame| &frame.ids];
        let [hdr, motion, depth, ids] = images.map(|image| buffer(index, image));
        let inputs = InputBuffers { hdr: &hdr, motion: Some(&motion), depth: Some(&depth), ids: Some(&ids) };
        let times_ns = [Some(frame.t_ns); 3];
        let tick = rig.step_tiles(&times_ns, inputs, &SubmitHooks::default()).expect("a frame");
        for (camera, (packet, expected)) in tick.packets.iter().zip(&expected).enumerate() {
            assert!(packet.iter().eq(expected.packets[index].iter()), "camera {camera}, frame {index}");
        }
    }
    for (number, expected) in expected.iter().enumerate() {
        assert_eq!(Some(&rig.synthesis(number).expect("a camera")), expected.synthesis.last());
        assert_eq!(rig.convention_warning(number).expect("a camera"), expected.warning, "camera {number}");
    }
    assert!(expected[2].warning.as_deref().is_some_and(|text| text.contains("sign is flipped")));
    assert_silent();
}
