//! The validation layer finds each kind of fault that the suites rely on it for. Each test commits one such fault on a
//! device of its own, and asserts that the layer reports it. The same code without the fault is silent. So is a rig whose
//! images come to lie where others were.

#![expect(unsafe_code, reason = "faults that the engine's own interface does not let one commit")]

use esaac_engine::ash::vk;
use esaac_engine::{
    Buffer, CameraConfig, Device, DeviceChoice, FrameInput, InputBuffers, Kernel, MemoryLocation, Rig,
    SubmitHooks, Validation,
};
use esaac_kernels::{Optimise, compile};
use esaac_model::{HdrFormat, SensorModel, Synthesis};
use esaac_tests::device::{DEVICE, alone};
use std::path::Path;
use std::sync::Arc;

/// Opens the device under test again, always with the validation layer.
fn watched() -> Arc<Device> {
    watched_by(Validation::On)
}

fn watched_by(validation: Validation) -> Arc<Device> {
    let device = Device::open(DeviceChoice::Uuid(DEVICE.info().uuid), validation)
        .expect("the validation layer, which is a package of the test set-up");
    assert_silent(&device);
    device
}

fn assert_silent(device: &Device) {
    assert_eq!(device.validation_messages(), [""; 0], "before any fault");
}

/// Fails unless the layer has reported one of `words`.
#[track_caller]
fn assert_reported(device: &Device, words: &[&str]) {
    let messages = device.validation_messages();
    let found = messages.iter().any(|message| words.iter().any(|word| message.contains(word)));
    assert!(found, "expected a message with one of {words:?}, the layer says {messages:#?}");
}

fn buffer(device: &Arc<Device>, name: &str) -> Buffer {
    device.allocate(name, 16, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly).expect("sixteen bytes")
}

fn kernel(device: &Arc<Device>, name: &str, buffers: &[&Buffer], push_bytes: u32) -> Kernel {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl").join(format!("{name}.comp"));
    let words = compile(&source, &[], &[], Optimise::Yes).expect("a kernel that compiles");
    // SAFETY: glslc has just compiled it; the tests name its buffers and push constants.
    let kernel = unsafe { Kernel::new(device, name, &words, buffers.len() as u32, push_bytes, &[]) }
        .expect("a kernel that builds");
    // SAFETY: the kernel was just made, so nothing uses it; the buffers outlive it.
    unsafe { kernel.bind(buffers) };
    kernel
}

const ONE: [u32; 3] = [1, 1, 1];

#[test]
fn a_misused_call_is_reported() {
    let _alone = alone();
    for validation in [Validation::On, Validation::Calls] {
        misuse_a_call(&watched_by(validation));
    }
}

fn misuse_a_call(device: &Arc<Device>) {
    let nothing = vk::BufferCreateInfo::default().usage(vk::BufferUsageFlags::STORAGE_BUFFER);
    // SAFETY: not valid, on purpose: a buffer of no bytes. The driver makes a handle of it or refuses;
    // nothing reads or writes it.
    let made = unsafe { device.raw().create_buffer(&nothing, None) };
    if let Ok(buffer) = made {
        // SAFETY: the buffer was just made by this device and is used nowhere.
        unsafe { device.raw().destroy_buffer(buffer, None) };
    }
    assert_reported(device, &["VUID-VkBufferCreateInfo-size-00912"]);
}

/// Writes a buffer and copies it in one submission, with or without a barrier between.
fn write_then_copy(device: &Arc<Device>, with_barrier: bool) {
    let (between, last) = (buffer(device, "between"), buffer(device, "last"));
    let write = kernel(device, "write", &[&between], 4);
    let copy = kernel(device, "copy", &[&between, &last], 0);
    let record = |commands| {
        // SAFETY: the buffers outlive the submission, which is waited for.
        unsafe { write.record(commands, &0_u32.to_le_bytes(), ONE) };
        if with_barrier {
            let barriers = [vk::MemoryBarrier2::default()
                .src_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
                .src_access_mask(vk::AccessFlags2::SHADER_STORAGE_WRITE)
                .dst_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
                .dst_access_mask(vk::AccessFlags2::SHADER_STORAGE_READ)];
            let info = vk::DependencyInfo::default().memory_barriers(&barriers);
            // SAFETY: `commands` is being recorded on this device.
            unsafe { device.raw().cmd_pipeline_barrier2(commands, &info) };
        }
        // SAFETY: as above.
        unsafe { copy.record(commands, &[], ONE) };
    };
    device.run_once(record).expect("two dispatches of one thread");
}

#[test]
fn a_missing_barrier_is_reported() {
    let _alone = alone();
    for validation in [Validation::On, Validation::Calls] {
        let device = watched_by(validation);
        write_then_copy(&device, true);
        assert_silent(&device);
        write_then_copy(&device, false);
        assert_reported(&device, &["SYNC-HAZARD-READ-AFTER-WRITE", "SYNC-HAZARD-READ_AFTER_WRITE"]);
    }
}

#[test]
fn a_write_out_of_bounds_is_reported() {
    let _alone = alone();
    let device = watched();
    let small = buffer(&device, "small");
    let write = kernel(&device, "write", &[&small], 4);
    let write_at = |index: u32| {
        // SAFETY: the buffer outlives the submission, which is waited for. A write beyond it is what is tested; it
        // hits the rest of the buffer's own memory block.
        let record = |commands| unsafe { write.record(commands, &index.to_le_bytes(), ONE) };
        device.run_once(record).expect("one thread");
    };
    write_at(3);
    assert_silent(&device);
    // Writes the first element past the buffer's end. The rest of the buffer's own memory block lies there.
    write_at(4);
    assert_reported(&device, &["out of bounds", "OOB", "highest byte accessed"]);
}

/// The layer keeps, with recorded commands, which addresses were valid then. An image may come to lie where an earlier
/// one was freed, and the commands may have been recorded in between.
#[test]
fn an_image_at_the_address_of_a_freed_one_is_within_bounds() {
    let _alone = alone();
    let device = watched();
    let sensor =
        SensorModel { width: 16, height: 16, synthesis: Synthesis::Linear, ..SensorModel::default() };
    let bytes = sensor.pixels() * HdrFormat::F32x4.texel_bytes();
    let config = CameraConfig {
        sensor: sensor.clone(),
        camera: 0,
        hdr: HdrFormat::F32x4,
        motion: None,
        geometry: None,
    };
    let mut rig = Rig::new(&device, &[config]).expect("a small rig");
    let image = || {
        let mut image = device
            .allocate("image", bytes as u64, vk::BufferUsageFlags::empty(), MemoryLocation::CpuToGpu)
            .expect("a small buffer");
        image.write(0, &vec![0_u8; bytes]);
        image
    };
    let mut t_ns = 0;
    let mut step = |rig: &mut Rig, hdr: &Buffer| {
        t_ns += 1_000_000;
        let inputs = Some(InputBuffers { hdr, motion: None, depth: None, ids: None });
        rig.step_frames(&[Some(FrameInput { t_ns, inputs })], &SubmitHooks::default()).expect("in time");
    };
    let (first, other) = (image(), image());
    let address = first.address();
    step(&mut rig, &first);
    step(&mut rig, &other);
    drop(first);
    // With leak there are other kernels, so the commands are recorded again.
    rig.set_sensor(0, SensorModel { leak_rate_hz: 1.0, ..sensor }).expect("a valid sensor");
    step(&mut rig, &other);
    let again = image();
    assert_eq!(again.address(), address, "the allocator gives freed memory away again");
    step(&mut rig, &again);
    assert_silent(&device);
}
