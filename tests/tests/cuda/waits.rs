//! Cost of waiting for a CUDA stream: the time until the host learns that the stream has signalled an exported
//! timeline, for each way of waiting, and the time until the device works for the engine again. Prints its figures.

#![expect(unsafe_code, reason = "the driver's own wait is called by hand, a copy recorded")]

use crate::present::{cuda_or_a_clear_error, frames};
use esaac_engine::ash::vk;
use esaac_engine::{Commands, MemoryLocation, SubmitHooks, Timeline};
use esaac_interop::{ExportedTimeline, SharedTimeline, Support};
use esaac_tests::cuda::{CudaImage, CudaSignal, use_device};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::figures::Figures;
use std::time::{Duration, Instant};

const MINUTE: Duration = Duration::from_secs(60);

type Wait<'a> = &'a dyn Fn(&Timeline, u64);

#[test]
fn for_a_signal_of_cuda() {
    let Some(device) = cuda_or_a_clear_error() else { return };
    if !Support::of(&DEVICE).share_timeline {
        return;
    }
    use_device(device.ordinal);
    let commands = Commands::new(&DEVICE).unwrap();
    // SAFETY: the buffer was just made; nothing is recorded.
    unsafe { commands.record(|_| {}) }.unwrap();
    let spin = |timeline: &Timeline, value| while timeline.value().unwrap() < value {};
    let block = |timeline: &Timeline, value| {
        let (semaphores, values) = ([timeline.raw()], [value]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore is alive.
        unsafe { DEVICE.raw().wait_semaphores(&info, MINUTE.as_nanos() as u64) }.unwrap();
    };
    let queue = |timeline: &Timeline, value| {
        let around = SubmitHooks { waits: &[(timeline, value)], ..SubmitHooks::default() };
        DEVICE.run_with_hooks(&commands, &around).unwrap();
    };
    let count = frames().min(500);
    for (what, wait) in [
        ("counter in a loop", &spin as Wait<'_>),
        ("vkWaitSemaphores", &block),
        ("a submission that waits", &queue),
    ] {
        let shared = ExportedTimeline::new(&DEVICE).unwrap();
        let timeline = shared.timeline();
        let signal = CudaSignal::import(shared.export().unwrap().expect("it is exported"));
        let slept = slept_so_far();
        let (mut late, mut idle) = (Figures::default(), Figures::default());
        for value in 1..=count as u64 {
            let started = Instant::now();
            signal.signal(value);
            wait(timeline, value);
            late.add(started.elapsed());
            let started = Instant::now();
            wait(timeline, value);
            idle.add(started.elapsed());
            std::thread::sleep(Duration::from_micros(200));
        }
        // Subtracts one for the pause between two rounds.
        let slept = (slept_so_far() - slept) as f64 / count as f64 - 1.0;
        println!(
            "{what}: from the signal's enqueueing {late}; of a value that is there {idle}; the thread slept \
             {slept:.2} times a wait"
        );
        drop(signal);
    }
    assert_silent();
}

/// CUDA and the engine are two contexts, of which the device runs one at a time. Measures what that costs: a submission
/// alone, one after CUDA has written, and one that is queued before CUDA writes and waits for it on the device.
#[test]
fn for_the_other_context_to_leave_the_device() {
    let Some(device) = cuda_or_a_clear_error() else { return };
    if !Support::of(&DEVICE).share_timeline {
        return;
    }
    use_device(device.ordinal);
    let target =
        DEVICE.allocate("target", 1 << 20, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly).unwrap();
    let commands = Commands::new(&DEVICE).unwrap();
    // SAFETY: `commands` is being recorded; the buffer lives until it has run.
    let fill = |raw| unsafe { DEVICE.raw().cmd_fill_buffer(raw, target.raw(), 0, vk::WHOLE_SIZE, 7) };
    // SAFETY: the commands were just made, and each submission of them is waited for.
    unsafe { commands.record(fill) }.unwrap();
    let shared = ExportedTimeline::new(&DEVICE).unwrap();
    let signal = CudaSignal::import(shared.export().unwrap().expect("it is exported"));
    let image = CudaImage::new(&vec![0; 1 << 20], 1024, 0);
    let (mut alone, mut after, mut ahead) = (Figures::default(), Figures::default(), Figures::default());
    let pause = || std::thread::sleep(Duration::from_micros(300));
    for value in 1..=frames().min(300) as u64 {
        let started = Instant::now();
        DEVICE.run_with_hooks(&commands, &SubmitHooks::default()).unwrap();
        alone.add(started.elapsed());
        signal.write(&image, None);
        signal.finish();
        let started = Instant::now();
        DEVICE.run_with_hooks(&commands, &SubmitHooks::default()).unwrap();
        after.add(started.elapsed());
        std::thread::scope(|scope| {
            let queued = scope.spawn(|| {
                let waits = [(shared.timeline(), value)];
                DEVICE
                    .run_with_hooks(&commands, &SubmitHooks { waits: &waits, ..SubmitHooks::default() })
                    .unwrap();
                Instant::now()
            });
            pause();
            signal.write(&image, Some(value));
            signal.finish();
            let written = Instant::now();
            ahead.add(queued.join().unwrap().saturating_duration_since(written));
        });
        DEVICE.run_with_hooks(&commands, &SubmitHooks::default()).unwrap();
    }
    println!(
        "a submission of 1 MiB to its end: alone {alone}; after CUDA has written {after}; queued ahead, from CUDA's \
         end {ahead}"
    );
    drop(image);
    assert_silent();
}

/// Voluntary context switches of this thread so far.
fn slept_so_far() -> u64 {
    let status = std::fs::read_to_string("/proc/thread-self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
    line.expect("Linux counts them").trim().parse().unwrap()
}
