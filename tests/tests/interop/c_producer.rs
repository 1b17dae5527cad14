//! Builds and runs the example producer in C as a user would.

use esaac_engine::{RigOptions, Validation};
use esaac_interop::ServerOptions;
use esaac_interop::wire::{
    Brought, FrameNotice, Header, Hello, ImageMemory, MEMORY_EXPORTED, MEMORY_HOST, Refusal, Released,
    RingOffer,
};
use esaac_model::{HdrFormat, MotionFormat, SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{Frame, Sequence};
use esaac_tests::interop::{Place, service, trusting, until};
use esaac_tests::run::engine_with;
use half::f16;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

const FRAMES: usize = 40;

fn interop() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../interop")
}

fn built(folder: &Path) -> PathBuf {
    let program = folder.join("producer");
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let output = Command::new(compiler)
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-I"])
        .arg(interop().join("include"))
        .arg(interop().join("examples/producer.c"))
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
    its_frames_arrive(trusting(), MEMORY_EXPORTED);
    let by_host = ServerOptions { memories: MEMORY_HOST, ..ServerOptions::default() };
    its_frames_arrive(by_host, MEMORY_HOST);
}

fn its_frames_arrive(options: ServerOptions, memory: u32) {
    let sensor = SensorModel { width: 21, height: 13, synthesis: Synthesis::None, ..SensorModel::default() };
    let sequence = frames(&sensor);
    let expected = engine_with(&sensor, &sequence, RigOptions::default());
    let place = Place::default();
    let mut service = service(&place.path(), &[(sensor.clone(), &sequence)], false, options);
    let program = built(place.path().parent().unwrap());
    let mut command = Command::new(program);
    command.arg(place.path()).args([FRAMES.to_string(), "0".to_owned(), DEVICE.info().index.to_string()]);
    if Validation::from_env() == Validation::On {
        command.env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation");
    }
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut events = 0;
    for (index, step) in expected.iter().enumerate() {
        let tick = service.tick(Duration::from_secs(30)).unwrap().expect("the next frame");
        assert_eq!(tick.t_ns[0], Some(sequence.frames[index].t_ns));
        assert!(tick.tick.packets[0] == step.packet, "frame {index}");
        events += step.packet.len();
    }
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    let done = format!("40 frames by memory {memory}");
    assert!(output.status.success() && said.contains(&done), "{said}");
    assert!(!said.contains("Validation"), "{said}");
    assert!(events > FRAMES * sensor.pixels(), "{events} events");
    until("its goodbye", || service.counts()[0].finished == 1);
    drop(service);
    assert_silent();
}

#[test]
fn a_refusal_is_printed() {
    let place = Place::default();
    let sensor = SensorModel { width: 9, height: 9, synthesis: Synthesis::None, ..SensorModel::default() };
    let _service =
        service(&place.path(), &[(sensor.clone(), &frames(&sensor))], false, ServerOptions::default());
    let output = Command::new(built(place.path().parent().unwrap()))
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
        ("hello", size_of::<Hello>()),
        ("ring", size_of::<RingOffer>()),
        ("brought", size_of::<Brought>()),
        ("frame", size_of::<FrameNotice>()),
        ("released", size_of::<Released>()),
        ("error", size_of::<Refusal>()),
    ] {
        let line = format!("_Static_assert(sizeof(struct esaac_{name}) == {bytes},");
        assert!(header.contains(&line), "no `{line}`");
    }
}
