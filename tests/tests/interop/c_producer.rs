//! Builds and runs the example producer in C as a user would.

use esaac_engine::{FrameBytes, Rig, RigOptions, Validation};
use esaac_interop::wire::{
    Brought, ErrorCode, FrameNotice, Header, Hello, ImageMemory, Lens, MAX_BYTES, MAX_POSES, MAX_SAMPLES,
    MEMORY_EXPORTED, MEMORY_HOST, Message, Refusal, Released, RingOffer, Sample, Version,
};
use esaac_interop::{ServerOptions, Service};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::{HdrFormat, IdFormat, MotionFormat, SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::exact;
use esaac_tests::frames::{Frame, Sequence};
use esaac_tests::interop::{Place, service, trusting, until};
use esaac_tests::run::engine_with;
use half::f16;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

const FRAMES: usize = 40;

fn interop() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../interop")
}

/// The example, in the header's newest version.
fn example() -> PathBuf {
    interop().join("examples/producer.c")
}

/// The example as it was in version 1.
fn of_version_1() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/producers/version_1.c")
}

fn built(source: &Path, folder: &Path) -> PathBuf {
    let program = folder.join("producer");
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let output = Command::new(compiler)
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-I"])
        .arg(interop().join("include"))
        .arg(source)
        .args(["-lvulkan", "-o"])
        .arg(&program)
        .output()
        .expect("a C compiler");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}\nVulkan's headers: apt-get install libvulkan-dev");
    program
}

/// The frames that the example renders.
fn frames(sensor: &SensorModel) -> Sequence {
    let frames = (0..FRAMES)
        .map(|index| {
            let gray = match index % 4 {
                0 | 2 => 1.0,
                1 => 2.0,
                _ => 4.0,
            };
            let texel = f16::from_f64(gray).to_le_bytes();
            Frame {
                t_ns: index as i64 * 10_000_000,
                hdr: texel.repeat(4 * sensor.pixels()),
                motion: Some(vec![0; 4 * sensor.pixels()]),
            }
        })
        .collect();
    Sequence { hdr: HdrFormat::F16x4, motion: Some(MotionFormat::F16x2), frames }
}

#[test]
fn its_frames_give_the_events_that_they_must() {
    // Device memory, and host memory, which is what a software driver shares with a producer that it does not trust.
    its_frames_arrive(&example(), trusting(), MEMORY_EXPORTED);
    its_frames_arrive(&example(), by_host(), MEMORY_HOST);
}

/// A producer that was written for version 1 compiles with the header as it is now, and is served.
#[test]
fn a_producer_of_version_1_goes_on_as_it_is() {
    its_frames_arrive(&of_version_1(), by_host(), MEMORY_HOST);
}

fn by_host() -> ServerOptions {
    ServerOptions { memories: MEMORY_HOST, ..ServerOptions::default() }
}

/// Runs the producer against a service of camera 0.
fn run(source: &Path, place: &Place) -> Child {
    let program = built(source, place.path().parent().unwrap());
    let mut command = Command::new(program);
    command.arg(place.path()).args([FRAMES.to_string(), "0".to_owned(), DEVICE.info().index.to_string()]);
    if Validation::from_env() != Validation::Off {
        command.env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation");
    }
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Its last words, after a run without fault.
fn finished(child: Child) -> String {
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !said.contains("Validation"), "{said}");
    said.into_owned()
}

fn its_frames_arrive(source: &Path, options: ServerOptions, memory: u32) {
    let sensor = SensorModel { width: 21, height: 13, synthesis: Synthesis::None, ..SensorModel::default() };
    let sequence = frames(&sensor);
    let expected = engine_with(&sensor, &sequence, RigOptions::default());
    let place = Place::default();
    let mut service = service(&place.path(), &[(sensor.clone(), &sequence)], false, options);
    let child = run(source, &place);
    let mut events = 0;
    for (index, step) in expected.iter().enumerate() {
        let tick = service.tick(Duration::from_secs(30)).unwrap().expect("the next frame");
        assert_eq!(tick.t_ns[0], Some(sequence.frames[index].t_ns));
        assert!(tick.tick.packets[0] == step.packet, "frame {index}");
        events += step.packet.len();
    }
    let said = finished(child);
    assert!(said.contains(&format!("40 frames by memory {memory}")), "{said}");
    assert!(events > FRAMES * sensor.pixels(), "{events} events");
    until("its goodbye", || service.counts()[0].finished == 1);
    drop(service);
    assert_silent();
}

/// A camera that takes depth gets it, and where the example's camera was.
#[test]
fn its_depth_and_poses_give_the_events_that_they_must() {
    let lens = Intrinsics::pinhole(20.0, 20.0, 10.0, 6.0).unwrap();
    let config = exact::config(Synthesis::Rigid, IdFormat::U16, lens);
    let sensor = &config.sensor;
    let (depth, ids) = (2.0_f32.to_le_bytes().repeat(sensor.pixels()), vec![0; 2 * sensor.pixels()]);
    let sequence = frames(sensor);
    let mut alone = Rig::new(&DEVICE, std::slice::from_ref(&config)).unwrap();
    let place = Place::default();
    let rig = Rig::new(&DEVICE, std::slice::from_ref(&config)).unwrap();
    let mut service = Service::open(rig, &place.path(), &[(&config).into()], by_host()).unwrap();
    let child = run(&example(), &place);
    let mut events = 0;
    for (index, frame) in sequence.frames.iter().enumerate() {
        let from_ns = index.checked_sub(1).map_or(frame.t_ns, |before| sequence.frames[before].t_ns);
        let times_ns: Vec<i64> = (from_ns..=frame.t_ns).step_by(1_000_000).collect();
        let poses = times_ns
            .iter()
            .map(|&t_ns| Pose::from_xyz_qxyzw(&[1e-9 * t_ns as f64, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).unwrap());
        let camera = PoseTrack::new(times_ns.clone(), poses.collect()).unwrap();
        alone.set_scene(0, SceneMotion::new(lens, camera)).unwrap();
        let motion = frame.motion.as_deref();
        alone
            .upload(0, &FrameBytes { hdr: &frame.hdr, motion, depth: Some(&depth), ids: Some(&ids) })
            .unwrap();
        let expected = alone.step(&[frame.t_ns]).unwrap().packets[0].clone();
        let tick = service.tick(Duration::from_secs(60)).unwrap().expect("the next frame");
        assert_eq!(tick.t_ns[0], Some(frame.t_ns));
        assert!(tick.tick.packets[0] == expected, "frame {index}");
        events += expected.len();
    }
    let said = finished(child);
    assert!(said.contains("40 frames by memory 2, with poses"), "{said}");
    assert!(events > FRAMES * sensor.pixels(), "{events} events");
    drop((service, alone));
    assert_silent();
}

#[test]
fn a_refusal_is_printed() {
    let place = Place::default();
    let sensor = SensorModel { width: 9, height: 9, synthesis: Synthesis::None, ..SensorModel::default() };
    let _service =
        service(&place.path(), &[(sensor.clone(), &frames(&sensor))], false, ServerOptions::default());
    let output = Command::new(built(&example(), place.path().parent().unwrap()))
        .arg(place.path())
        .args(["1", "5", &DEVICE.info().index.to_string()])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("camera 5, the rig has 1"), "{said}");
}

/// The C header asserts its sizes when it is compiled. This test asserts that its numbers are those of Rust.
#[test]
fn header_and_rust_have_the_same_sizes() {
    let header = std::fs::read_to_string(interop().join("include/esaac_interop.h")).unwrap();
    for (name, bytes) in [
        ("header", size_of::<Header>()),
        ("image_memory", size_of::<ImageMemory>()),
        ("hello_2", size_of::<Hello>()),
        ("ring_2", size_of::<RingOffer>()),
        ("brought_2", size_of::<Brought>()),
        ("frame_2", size_of::<FrameNotice>()),
        ("lens", size_of::<Lens>()),
        ("sample", size_of::<Sample>()),
        ("released", size_of::<Released>()),
        ("error", size_of::<Refusal>()),
    ] {
        let line = format!("_Static_assert(sizeof(struct esaac_{name}) == {bytes},");
        assert!(header.contains(&line), "no `{line}`");
    }
    for (name, message) in [
        ("hello", Message::Hello(Hello::default())),
        ("ring", Message::Ring(RingOffer::default())),
        ("brought", Message::Brought(Brought::default())),
        ("frame", Message::Frame(FrameNotice::default())),
    ] {
        let bytes = message.to_bytes(Version::One, 0).len();
        let line = format!("_Static_assert(sizeof(struct esaac_{name}) == {bytes},");
        assert!(header.contains(&line), "no `{line}`");
    }
    let codes: Vec<&str> = header.lines().filter(|line| line.trim().starts_with("ESAAC_ERROR_")).collect();
    assert_eq!(codes.len(), ErrorCode::ALL.len());
    for code in ErrorCode::ALL {
        let line = format!("ESAAC_ERROR_{} = {},", format!("{code:?}").to_uppercase(), code as u32);
        assert!(codes.iter().any(|known| known.trim().starts_with(&line)), "no `{line}`");
    }
    for (name, number) in [("BYTES", MAX_BYTES), ("SAMPLES", MAX_SAMPLES), ("POSES", MAX_POSES)] {
        let line = format!("#define ESAAC_MAX_{name} {number}u");
        assert!(header.contains(&line), "no `{line}`");
    }
}
