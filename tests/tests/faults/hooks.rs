//! Commands and timelines around a step, where parts of its frames are read back before the tick.

#![expect(unsafe_code, reason = "commands around a step are recorded by hand")]

use esaac_engine::ash::vk;
use esaac_engine::{
    Buffer, CameraConfig, Commands, FaultPoint, FrameBytes, FrameInput, InputBuffers, MemoryLocation, Rig,
    SubmitHooks, Timeline,
};
use esaac_model::{IdFormat, Packet, Pixel, SensorModel, Synthesis};
use esaac_scene::Frame;
use esaac_tests::device::{DEVICE, alone, assert_silent};
use esaac_tests::exact::{FRAMES, Run, config};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A camera whose poses and light are looked at, and one whose motion vectors are.
fn rig(run: &Run) -> Rig {
    let mut exact = config(Synthesis::Auto, IdFormat::U32, run.scene.intrinsics());
    (exact.sensor.pixel, exact.sensor.lux_per_unit) = (Pixel::Physical, 100.0);
    let layered = CameraConfig {
        sensor: SensorModel { synthesis: Synthesis::Motion, layers: 0, ..exact.sensor.clone() },
        camera: 1,
        geometry: None,
        ..exact.clone()
    };
    let mut rig = Rig::new(&DEVICE, &[exact, layered]).expect("a rig");
    rig.set_scene(0, run.motion.clone()).expect("poses of its lens");
    rig
}

fn buffer(bytes: u64, location: MemoryLocation) -> Buffer {
    DEVICE.allocate("around a step", bytes, vk::BufferUsageFlags::empty(), location).expect("memory")
}

/// Everything recorded before comes before everything recorded after, the host's readings too.
fn barrier(commands: vk::CommandBuffer) {
    let everything = vk::PipelineStageFlags2::ALL_COMMANDS;
    let memory = [vk::MemoryBarrier2::default()
        .src_stage_mask(everything)
        .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
        .dst_stage_mask(everything | vk::PipelineStageFlags2::HOST)
        .dst_access_mask(
            vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE | vk::AccessFlags2::HOST_READ,
        )];
    let info = vk::DependencyInfo::default().memory_barriers(&memory);
    // SAFETY: `commands` is being recorded.
    unsafe { DEVICE.raw().cmd_pipeline_barrier2(commands, &info) };
}

fn copy(commands: vk::CommandBuffer, from: &Buffer, to: &Buffer, dst_offset: u64, size: u64) {
    let region = [vk::BufferCopy { src_offset: 0, dst_offset, size }];
    // SAFETY: `commands` is being recorded; the test keeps both buffers until every step is done.
    unsafe { DEVICE.raw().cmd_copy_buffer(commands, from.raw(), to.raw(), &region) };
}

/// Counts how often commands run: each time a row of ones grows by one.
struct Count {
    ones: Arc<Buffer>,
    copied: Buffer,
}

impl Count {
    const WORDS: usize = 64;

    fn new() -> Self {
        let bytes = 4 * Self::WORDS as u64;
        let mut ones = buffer(bytes, MemoryLocation::GpuToCpu);
        let first: [u32; Self::WORDS] = std::array::from_fn(|word| u32::from(word == 0));
        ones.write(0, &first);
        Count { ones: Arc::new(ones), copied: buffer(bytes, MemoryLocation::GpuOnly) }
    }

    fn record(&self, commands: vk::CommandBuffer) {
        let bytes = 4 * (Self::WORDS as u64 - 1);
        copy(commands, &self.ones, &self.copied, 0, bytes);
        barrier(commands);
        copy(commands, &self.copied, &self.ones, 4, bytes);
        barrier(commands);
    }
}

fn runs(ones: &Buffer) -> u32 {
    ones.read::<u32>(0, Count::WORDS).iter().sum::<u32>() - 1
}

fn images(frame: &Frame) -> [&[u8]; 4] {
    [&frame.hdr, &frame.motion, &frame.depth, &frame.ids]
}

/// Packets of a run without anything around its steps.
fn alone_in_its_submission(run: &Run) -> Vec<Vec<Packet>> {
    let mut rig = rig(run);
    let step = |(t_ns, frame): &(i64, Frame)| {
        let (motion, depth, ids) = (Some(&*frame.motion), Some(&*frame.depth), Some(&*frame.ids));
        rig.upload(0, &FrameBytes { hdr: &frame.hdr, motion, depth, ids }).expect("a frame that fits");
        rig.upload(1, &FrameBytes { hdr: &frame.hdr, motion, ..FrameBytes::default() }).expect("a frame");
        rig.step(&[*t_ns; 2]).expect("a step").packets.to_vec()
    };
    run.frames.iter().map(step).collect()
}

/// The frame is there from `before` to `after` alone.
#[test]
fn commands_around_a_step_run_once_and_those_after_it_when_it_has_read_the_frame() {
    let _alone = alone();
    let run = Run::default();
    let expected = alone_in_its_submission(&run);
    let mut rig = rig(&run);
    let bytes = images(&run.frames[0].1).map(|image| image.len() as u64);
    let mut drawn = bytes.map(|bytes| buffer(bytes, MemoryLocation::CpuToGpu));
    let shown = bytes.map(|bytes| buffer(bytes, MemoryLocation::GpuOnly));
    let counts = [Count::new(), Count::new()];
    let [draw, wipe] = [(); 2].map(|()| Commands::new(&DEVICE).expect("commands"));
    let record_draw = |commands| {
        barrier(commands);
        counts[0].record(commands);
        for ((from, to), &bytes) in drawn.iter().zip(&shown).zip(&bytes) {
            copy(commands, from, to, 0, bytes);
        }
        barrier(commands);
    };
    let record_wipe = |commands| {
        barrier(commands);
        counts[1].record(commands);
        for image in &shown {
            // SAFETY: `commands` is being recorded; the buffer lives until every step is done.
            unsafe { DEVICE.raw().cmd_fill_buffer(commands, image.raw(), 0, vk::WHOLE_SIZE, 0) };
        }
        barrier(commands);
    };
    // SAFETY: the commands were just made, so they are not pending. What they use outlives the rig, which has waited for
    // every step.
    unsafe { draw.record(record_draw).and_then(|()| wipe.record(record_wipe)) }.expect("no fault");
    let [given, taken] = [(); 2].map(|()| {
        Arc::new(Timeline::new(&DEVICE, vk::ExternalSemaphoreHandleTypeFlags::empty()).expect("a timeline"))
    });
    let mut most_submissions = 0;
    for (index, (t_ns, frame)) in run.frames.iter().enumerate() {
        let value = index as u64 + 1;
        for (buffer, image) in drawn.iter_mut().zip(images(frame)) {
            buffer.write(0, image);
        }
        let [hdr, motion, depth, ids] = &shown;
        let inputs = InputBuffers { hdr, motion: Some(motion), depth: Some(depth), ids: Some(ids) };
        let layered = InputBuffers { depth: None, ids: None, ..inputs };
        let frames = [inputs, layered].map(|inputs| Some(FrameInput { t_ns: *t_ns, inputs: Some(inputs) }));
        let (before, after) = ([&draw], [&wipe]);
        let (waits, signals) = ([(&*given, value)], [(&*taken, value)]);
        let hooks = SubmitHooks { before: &before, after: &after, waits: &waits, signals: &signals };
        let submissions = Arc::new(Mutex::new(Vec::new()));
        let (seen, signalled) = (Arc::clone(&submissions), Arc::clone(&taken));
        let (gate, drawn_ones) = (Arc::clone(&given), Arc::clone(&counts[0].ones));
        DEVICE.set_faults(Some(Arc::new(move |point| {
            if point == FaultPoint::Submit {
                seen.lock().expect("no panic").push(signalled.value().expect("a value"));
            }
            // The first wait moves the timeline: not another thread, whose call the validation layer of Debian 12 may
            // hold back until this wait is over (KhronosGroup/Vulkan-ValidationLayers, issue 4649).
            if point == FaultPoint::Wait && gate.value().expect("a value") < value {
                // So late that commands that do not wait for the timeline have run.
                std::thread::sleep(Duration::from_millis(20));
                assert_eq!(runs(&drawn_ones), index as u32, "frame {index}: drawn before its timeline");
                gate.signal(value).expect("a larger value");
            }
            None
        })));
        rig.submit_frames(&frames, &hooks).expect("a frame in time");
        // The tick is the last submission; those before it have been waited for.
        let looked = submissions.lock().expect("no panic").len() > 1;
        assert_eq!(given.value().expect("a value") == value, looked, "frame {index}");
        let tick = rig.wait().expect("a step");
        DEVICE.set_faults(None);
        let submissions = submissions.lock().expect("no panic");
        assert!(submissions.iter().all(|&signalled| signalled < value), "frame {index}: {submissions:?}");
        most_submissions = most_submissions.max(submissions.len());
        assert!(tick.packets == expected[index], "frame {index}");
        assert_eq!(taken.value().expect("a value"), value);
        assert_eq!(counts.each_ref().map(|count| runs(&count.ones)), [index as u32 + 1; 2], "frame {index}");
    }
    assert!(most_submissions > 3, "{most_submissions}: poses, light, motion vectors and the tick");
    assert!(expected[FRAMES - 1].iter().all(|packet| packet.len() > 100));
    drop((rig, drawn, shown, counts, draw, wipe, given, taken));
    assert_silent();
}
