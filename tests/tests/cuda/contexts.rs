//! What it costs that CUDA and the engine are two contexts of one device, and whether the driver can join them. Prints
//! its figures; the page on contexts in the book has them.

#![expect(unsafe_code, reason = "the device is asked by hand, a fill recorded")]

use crate::present::{cuda_or_a_clear_error, frames};
use esaac_engine::ash::vk;
use esaac_engine::{Commands, MemoryLocation, SubmitHooks};
use esaac_tests::cuda::{CudaSpin, use_device};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::figures::Figures;
use std::time::{Duration, Instant};

/// What a driver that can join them has: a queue for CUDA in a device of Vulkan.
const EXTERNAL_QUEUE: &std::ffi::CStr = c"VK_NV_external_compute_queue";

#[test]
fn that_share_a_device_take_turns() {
    let Some(device) = cuda_or_a_clear_error() else { return };
    use_device(device.ordinal);
    println!("{EXTERNAL_QUEUE:?}: {}", has_external_queue());
    let target =
        DEVICE.allocate("target", 1 << 20, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly).unwrap();
    let commands = Commands::new(&DEVICE).unwrap();
    // SAFETY: `commands` is being recorded; the buffer lives until it has run.
    let fill = |raw| unsafe { DEVICE.raw().cmd_fill_buffer(raw, target.raw(), 0, vk::WHOLE_SIZE, 7) };
    // SAFETY: the commands were just made, and each submission of them is waited for.
    unsafe { commands.record(fill) }.unwrap();
    let vulkan = || DEVICE.run_with_hooks(&commands, &SubmitHooks::default()).unwrap();
    let spin = CudaSpin::new();
    let cuda = |time| {
        spin.start(time);
        spin.finish();
    };
    let short = Duration::from_micros(20);
    let count = frames().min(300);
    let repeat = |figures: &mut Figures, before: &dyn Fn(), body: &dyn Fn()| {
        for _ in 0..count {
            before();
            let started = Instant::now();
            body();
            figures.add(started.elapsed());
        }
    };
    for (what, before, body) in [
        ("Vulkan alone", &(|| ()) as &dyn Fn(), &vulkan as &dyn Fn()),
        ("CUDA alone", &|| (), &|| cuda(short)),
        ("Vulkan after CUDA", &|| cuda(short), &vulkan),
        ("CUDA after Vulkan", &vulkan, &|| cuda(short)),
    ] {
        let mut figures = Figures::default();
        repeat(&mut figures, before, body);
        println!("{what}: {figures}");
    }
    for long in [Duration::from_millis(1), Duration::from_millis(10)] {
        let mut left = Figures::default();
        let mut beside = Figures::default();
        for _ in 0..count.min(30) {
            let began = Instant::now();
            spin.start(long);
            std::thread::sleep(long / 10);
            let started = Instant::now();
            vulkan();
            beside.add(started.elapsed());
            spin.finish();
            assert!(began.elapsed() >= long, "CUDA computed for {:?}, expected {long:?}", began.elapsed());
            left.add(long.saturating_sub(started - began));
        }
        println!("Vulkan beside CUDA, which computes for {long:?} and has {left} left: {beside}");
    }
    assert_silent();
}

fn has_external_queue() -> bool {
    let physical = DEVICE.physical();
    // SAFETY: the device's instance is alive.
    let all = unsafe { DEVICE.instance().enumerate_device_extension_properties(physical) }.unwrap();
    all.iter().any(|extension| extension.extension_name_as_c_str() == Ok(EXTERNAL_QUEUE))
}
