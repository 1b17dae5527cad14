//! A step in two halves: the caller is free between them, each reports what fails in it, and the events are those of a step
//! in one call.

#![expect(unsafe_code, reason = "commands around a step are recorded by hand")]

use crate::driver::{Driver, undisturbed};
use crate::operations::{delayed, flashing, operations, sequences};
use esaac_engine::ash::vk;
use esaac_engine::{
    Buffer, CameraConfig, Commands, EngineError, FaultPoint, FrameBytes, FrameInput, InputBuffers,
    MemoryLocation, Representation, Rig, SubmitHooks, Timeline,
};
use esaac_model::{FrameError, HdrFormat, Packet};
use esaac_tests::device::{DEVICE, alone, assert_silent};
use esaac_tests::frames::Frame;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

fn rig() -> Rig {
    let config =
        CameraConfig { sensor: flashing(), camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: None };
    Rig::new(&DEVICE, &[config]).expect("a rig")
}

/// A caller's buffer with a frame.
fn buffer(frame: &Frame) -> Buffer {
    let (bytes, usage) = (frame.hdr.len() as u64, vk::BufferUsageFlags::empty());
    let mut buffer = DEVICE.allocate("a frame", bytes, usage, MemoryLocation::CpuToGpu).expect("memory");
    buffer.write(0, &frame.hdr);
    buffer
}

fn input(t_ns: i64, hdr: &Buffer) -> [Option<FrameInput<'_>>; 1] {
    let inputs = InputBuffers { hdr, motion: None, depth: None, ids: None };
    [Some(FrameInput { t_ns, inputs: Some(inputs) })]
}

/// Packets of the first frames, each stepped in one call.
fn in_one_call(frames: &[Frame]) -> Vec<Packet> {
    let mut rig = rig();
    let step = |frame: &Frame| {
        let hdr = buffer(frame);
        let tick = rig.step_frames(&input(frame.t_ns, &hdr), &SubmitHooks::default()).expect("a step");
        tick.packets[0].clone()
    };
    frames.iter().map(step).collect()
}

fn until_done(rig: &Rig) {
    let started = Instant::now();
    while !rig.is_done() {
        assert!(started.elapsed() < Duration::from_secs(60), "the device never finishes");
        std::thread::yield_now();
    }
}

/// Makes the device fail at each `point` with `result`.
fn fail(point: FaultPoint, result: vk::Result) {
    DEVICE.set_faults(Some(Arc::new(move |at| (at == point).then_some(result))));
}

/// A rig with a step that was submitted refuses everything, until the device is done and after.
fn refuses_everything(rig: &mut Rig) {
    fn refused(result: Result<(), EngineError>) {
        assert!(matches!(result, Err(EngineError::Submitted)), "{result:?}");
    }
    for _ in 0..2 {
        refused(rig.step(&[i64::MAX; 2]).map(|_| ()));
        refused(rig.submit_frames(&[None; 2], &SubmitHooks::default()));
        refused(rig.set_sensor(1, delayed()));
        refused(rig.reset(0));
        refused(rig.upload(0, &FrameBytes::default()));
        refused(rig.inputs(0).map(|_| ()));
        refused(rig.set_scenes(Vec::new()).map(|_| ()));
        refused(rig.save().map(|_| ()));
        refused(rig.restore(&[]));
        refused(rig.represent_to_host(Representation::EventFrame).map(|_| ()));
        // There are no events to gather, which is no answer either.
        refused(rig.represent_to_host(Representation::Gathered).map(|_| ()));
        assert_eq!(rig.last_tick().events, [0, 0]);
        assert!(rig.stage_host_times().expect("no times").is_none());
        until_done(rig);
    }
}

#[test]
fn two_halves_give_what_one_call_gives_and_refuse_all_else_between_them() {
    let _alone = alone();
    let expected = undisturbed();
    let mut driver = Driver::new();
    driver.meanwhile = Some(refuses_everything);
    let given: Vec<_> =
        operations().iter().filter_map(|operation| driver.run(operation).expect("no fault")).collect();
    assert!(given == expected);
    let rig = &mut driver.rig;
    assert!(!rig.is_done() && matches!(rig.wait().map(|_| ()), Err(EngineError::NotSubmitted)));
    drop(driver);
    assert_silent();
}

#[test]
fn the_caller_is_free_while_a_step_waits_for_its_timeline_and_may_drop_what_it_reads() {
    let _alone = alone();
    let frames = &sequences()[0].frames[..3];
    let expected = in_one_call(frames);
    let mut rig = rig();
    let [given, taken] = [(); 2]
        .map(|()| Timeline::new(&DEVICE, vk::ExternalSemaphoreHandleTypeFlags::empty()).expect("a timeline"));
    let mut next = buffer(&frames[0]);
    let mut packets = Vec::new();
    for (frame, value) in frames.iter().zip(1..) {
        let commands = Commands::new(&DEVICE).expect("commands");
        // SAFETY: the commands were just made; nothing is recorded.
        unsafe { commands.record(|_| {}) }.expect("no fault");
        let (before, waits, signals) = ([&commands], [(&given, value)], [(&taken, value)]);
        let hooks = SubmitHooks { before: &before, after: &[], waits: &waits, signals: &signals };
        rig.submit_frames(&input(frame.t_ns, &next), &hooks).expect("a frame in time");
        // The device has not begun, and cannot: the caller alone moves the timeline.
        assert!(!rig.is_done());
        assert!(matches!(commands.check(), Err(EngineError::InUse)));
        let write = std::panic::AssertUnwindSafe(|| next.write(0, &[0_u8]));
        let panic = std::panic::catch_unwind(write).expect_err("a step reads the buffer");
        assert!(
            panic
                .downcast_ref::<String>()
                .expect("words")
                .contains("a step that was submitted reads `a frame`")
        );
        // The next frame is made meanwhile; this one goes.
        next = buffer(frames.get(value as usize).unwrap_or(frame));
        drop(commands);
        given.signal(value).expect("a larger value");
        until_done(&rig);
        assert_eq!(taken.value().expect("a value"), value);
        packets.extend_from_slice(rig.wait().expect("a step").packets);
    }
    assert!(packets == expected && packets[2].len() > 1000, "{} events", packets[2].len());
    drop((rig, next, given, taken));
    assert_silent();
}

#[test]
fn a_step_without_frames_signals_its_timelines() {
    let _alone = alone();
    let mut rig = rig();
    let timeline = Timeline::new(&DEVICE, vk::ExternalSemaphoreHandleTypeFlags::empty()).expect("a timeline");
    let signals = [(&timeline, 5)];
    rig.submit_frames(&[None], &SubmitHooks { signals: &signals, ..SubmitHooks::default() })
        .expect("no frame");
    assert_eq!(rig.wait().expect("a step").events, [0]);
    assert_eq!(timeline.value().expect("a value"), 5);
    drop((rig, timeline));
    assert_silent();
}

#[test]
fn a_rig_that_is_dropped_with_a_step_waits_for_it() {
    let _alone = alone();
    let frame = &sequences()[0].frames[0];
    let timeline = Timeline::new(&DEVICE, vk::ExternalSemaphoreHandleTypeFlags::empty()).expect("a timeline");
    let timeline = Arc::new(timeline);
    let mut rig = rig();
    let (hdr, waits) = (buffer(frame), [(&*timeline, 1)]);
    rig.submit_frames(&input(frame.t_ns, &hdr), &SubmitHooks { waits: &waits, ..SubmitHooks::default() })
        .expect("a frame in time");
    // The device has not begun when the wait does.
    let (gate, waited) = (Arc::clone(&timeline), Arc::new(AtomicU32::new(0)));
    let waits = Arc::clone(&waited);
    let hook = move |point| {
        if point == FaultPoint::Wait && waits.fetch_add(1, Ordering::Relaxed) == 0 {
            gate.signal(1).expect("a larger value");
        }
        None
    };
    DEVICE.set_faults(Some(Arc::new(hook)));
    drop((hdr, rig));
    DEVICE.set_faults(None);
    assert_eq!(waited.load(Ordering::Relaxed), 1, "one wait");
    assert!(DEVICE.settle(Duration::ZERO), "nothing is left behind");
    drop(timeline);
    assert_silent();
}

#[test]
fn what_is_dropped_while_a_step_runs_is_destroyed_when_somebody_has_waited() {
    let _alone = alone();
    let timeline = Timeline::new(&DEVICE, vk::ExternalSemaphoreHandleTypeFlags::empty()).expect("a timeline");
    let mut rig = rig();
    let waits = [(&timeline, 1)];
    rig.submit_frames(&[None], &SubmitHooks { waits: &waits, ..SubmitHooks::default() }).expect("no frame");
    let destroyed = Arc::new(AtomicU32::new(0));
    let count = Arc::clone(&destroyed);
    DEVICE.retire(move |_| count.store(1, Ordering::Relaxed));
    assert_eq!(destroyed.load(Ordering::Relaxed), 0);
    timeline.signal(1).expect("a larger value");
    rig.wait().expect("a step");
    assert_eq!(destroyed.load(Ordering::Relaxed), 1);
    drop((rig, timeline));
    assert_silent();
}

#[test]
fn a_refused_first_half_leaves_the_rig_as_it_was() {
    let _alone = alone();
    let frames = &sequences()[0].frames[..2];
    let expected = in_one_call(frames);
    let mut rig = rig();
    let none = SubmitHooks::default();
    let hdr = buffer(&frames[0]);
    rig.step_frames(&input(frames[0].t_ns, &hdr), &none).expect("a first frame");
    let hdr = buffer(&frames[1]);
    let early = rig.submit_frames(&input(frames[0].t_ns, &hdr), &none).expect_err("a time that is past");
    assert!(matches!(early, EngineError::Frame(FrameError::Time { .. })), "{early}");
    let count = rig.submit_frames(&[], &none).expect_err("no frames");
    assert!(matches!(count, EngineError::Frame(FrameError::Count { .. })), "{count}");
    fail(FaultPoint::Submit, vk::Result::ERROR_OUT_OF_HOST_MEMORY);
    let full =
        rig.submit_frames(&input(frames[1].t_ns, &hdr), &none).expect_err("a queue that takes nothing");
    DEVICE.set_faults(None);
    assert!(matches!(full, EngineError::Vulkan { call: "vkQueueSubmit", .. }), "{full}");
    assert!(matches!(rig.wait().map(|_| ()), Err(EngineError::NotSubmitted)));
    let tick = rig.step_frames(&input(frames[1].t_ns, &hdr), &none).expect("the same step");
    assert!(tick.packets[0] == expected[1]);
    drop((rig, hdr));
    assert_silent();
}

#[test]
fn after_a_refused_step_the_last_tick_is_empty() {
    let _alone = alone();
    let frames = &sequences()[0].frames[..2];
    let mut rig = rig();
    let (none, late_ns) = (SubmitHooks::default(), frames[1].t_ns);
    let next = frames.iter().map(buffer).collect::<Vec<_>>();
    type Step = fn(&mut Rig, &Buffer, i64) -> Result<(), EngineError>;
    let steps: [(&str, Step); 3] = [
        ("a time that is past", |rig, hdr, t_ns| {
            rig.submit_frames(&input(t_ns, hdr), &SubmitHooks::default())
        }),
        ("too few frames", |rig, _, _| rig.submit_frames(&[], &SubmitHooks::default())),
        ("tiles of a time that is past", |rig, hdr, t_ns| {
            let tiles = InputBuffers { hdr, motion: None, depth: None, ids: None };
            rig.submit_tiles(&[Some(t_ns)], tiles, &SubmitHooks::default())
        }),
    ];
    for (what, step) in steps {
        rig.reset(0).expect("a camera");
        for (frame, hdr) in frames.iter().zip(&next) {
            rig.step_frames(&input(frame.t_ns, hdr), &none).expect("a frame in time");
        }
        assert!(rig.last_tick().events[0] > 0);
        step(&mut rig, &next[1], late_ns).expect_err(what);
        let tick = rig.last_tick();
        assert_eq!((tick.events[0], tick.packets[0].len()), (0, 0), "{what}");
    }
    drop((rig, next));
    assert_silent();
}

#[test]
fn each_half_reports_what_fails_in_it() {
    let _alone = alone();
    let is_lost = |result: Result<(), EngineError>| matches!(result, Err(EngineError::Lost { .. }));
    let frame = &sequences()[0].frames[0];
    let own = [Some(FrameInput { t_ns: frame.t_ns, inputs: None })];
    let mut gone = rig();
    fail(FaultPoint::Submit, vk::Result::ERROR_DEVICE_LOST);
    assert!(is_lost(gone.submit_frames(&own, &SubmitHooks::default())));
    DEVICE.set_faults(None);
    assert!(is_lost(gone.wait().map(|_| ())));

    let commands = Commands::new(&DEVICE).expect("commands");
    // SAFETY: the commands were just made; nothing is recorded.
    unsafe { commands.record(|_| {}) }.expect("no fault");
    let after = [&commands];
    for dropped in [false, true] {
        let mut late = rig();
        let hooks = if dropped {
            SubmitHooks::default()
        } else {
            SubmitHooks { after: &after, ..SubmitHooks::default() }
        };
        fail(FaultPoint::Wait, vk::Result::TIMEOUT);
        late.submit_frames(&own, &hooks).expect("nothing waits in the first half");
        if dropped {
            drop(late);
        } else {
            assert!(is_lost(late.wait().map(|_| ())));
            assert!(is_lost(late.step(&[1]).map(|_| ())) && is_lost(late.wait().map(|_| ())));
            assert!(matches!(commands.check(), Err(EngineError::Abandoned)));
        }
        DEVICE.set_faults(None);
        assert!(DEVICE.settle(Duration::from_secs(60)), "the device finishes all the same");
    }
    drop((gone, commands));
    assert_silent();
}
