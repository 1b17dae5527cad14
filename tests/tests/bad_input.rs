//! Every input that the engine cannot accept gives an error that names the expected and the actual value.

use esaac_engine::ash::vk;
use esaac_engine::{
    CameraConfig, Commands, Device, DeviceChoice, EngineError, FrameBytes, FrameInput, GeometryConfig,
    InputBuffers, KernelPolicy, MemoryLocation, Representation, Rig, RigOptions, Share, SubmitHooks,
    Timeline, Validation,
};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::{
    DepthFormat, FrameError, HdrFormat, IdFormat, Intensity, MotionFormat, SensorError, SensorModel,
    Synthesis,
};
use esaac_tests::device::{DEVICE, OTHER_SIDE, assert_silent};
use esaac_tests::frames::{Sequence, gray, times};
use esaac_tests::run::{camera, engine, rig, step};
use std::sync::Arc;

fn sensor() -> SensorModel {
    SensorModel { width: 12, height: 9, synthesis: Synthesis::None, ..SensorModel::default() }
}

/// Light that gives a few events each frame.
fn frames(sensor: &SensorModel, count: usize) -> Sequence {
    gray(sensor, &times(0, count), |frame, pixel| (1 + pixel + 40 * (frame % 2)) as f32)
}

/// Asserts that the result is an error whose text contains all given words.
#[track_caller]
fn assert_names<T>(result: Result<T, EngineError>, words: &[&str]) -> EngineError {
    let Err(error) = result else { panic!("no error, expected one that names {words:?}") };
    let text = error.to_string();
    for word in words {
        assert!(text.contains(word), "\"{text}\" does not name {word:?}");
    }
    error
}

#[test]
fn images_of_the_wrong_size() {
    let sensor = sensor();
    let frames = frames(&sensor, 2);
    let mut config = camera(&sensor, 0, &frames);
    config.motion = Some(MotionFormat::F16x2);
    let mut rig = Rig::new(&DEVICE, &[config.clone(), config]).unwrap();
    let (hdr, motion) = (vec![0; 12 * 9 * 16], vec![0; 12 * 9 * 4]);
    let upload = |rig: &mut Rig, hdr: &[u8], motion: Option<&[u8]>| {
        rig.upload(1, &FrameBytes { hdr, motion, ..FrameBytes::default() })
    };
    let short = upload(&mut rig, &hdr[1..], Some(&motion));
    assert_names(short, &["camera 1", "hdr", "1727", "1728", "12x9"]);
    assert_names(upload(&mut rig, &[], Some(&motion)), &["hdr", "0 bytes", "1728"]);
    let long = vec![0; 12 * 9 * 4 + 1];
    assert_names(upload(&mut rig, &hdr, Some(&long)), &["camera 1", "motion", "433", "432"]);
    let missing = assert_names(upload(&mut rig, &hdr, None), &["motion", "432"]);
    assert!(matches!(missing, EngineError::Frame(FrameError::Size { image: "motion", actual: 0, .. })));
    upload(&mut rig, &hdr, Some(&motion)).unwrap();
    drop(rig);
    assert_silent();
}

#[test]
fn buffers_of_others_that_are_too_small() {
    let sensor = sensor();
    let frames = frames(&sensor, 1);
    let mut config = camera(&sensor, 0, &frames);
    config.motion = Some(MotionFormat::F16x2);
    let mut rig = Rig::new(&DEVICE, &[config]).unwrap();
    let buffer = |bytes| {
        DEVICE.allocate("given", bytes, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly).unwrap()
    };
    let (whole, short) = (buffer(12 * 9 * 16), buffer(160));
    let mut step = |hdr, motion| {
        let inputs = Some(InputBuffers { hdr, motion, depth: None, ids: None });
        rig.step_frames(&[Some(FrameInput { t_ns: 0, inputs })], &SubmitHooks::default()).map(|_| ())
    };
    assert_names(step(&short, Some(&whole)), &["camera 0", "hdr", "160 bytes", "1728"]);
    assert_names(step(&whole, Some(&short)), &["camera 0", "motion", "160 bytes", "432"]);
    assert_names(step(&whole, None), &["camera 0", "motion", "0 bytes", "432"]);
    drop(rig);
    assert_silent();
}

#[test]
fn depth_and_ids_that_are_too_small_or_on_another_device() {
    let sensor = SensorModel { synthesis: Synthesis::Rigid, ..sensor() };
    let lens = Intrinsics::pinhole(10.0, 10.0, 5.5, 4.0).unwrap();
    let geometry = GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U16), lens };
    let config =
        CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: Some(geometry) };
    let mut rig = Rig::new(&DEVICE, &[config]).unwrap();
    rig.set_scene(0, SceneMotion::new(lens, PoseTrack::still(Pose::IDENTITY))).unwrap();
    let buffer = |device: &Arc<Device>, bytes| {
        device.allocate("given", bytes, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly).unwrap()
    };
    let (whole, short) = (buffer(&DEVICE, 12 * 9 * 16), buffer(&DEVICE, 160));
    let elsewhere = buffer(&OTHER_SIDE, 12 * 9 * 16);
    let mut step = |depth, ids| {
        let inputs = Some(InputBuffers { hdr: &whole, motion: None, depth, ids });
        rig.step_frames(&[Some(FrameInput { t_ns: 0, inputs })], &SubmitHooks::default()).map(|_| ())
    };
    assert_names(step(Some(&short), Some(&whole)), &["camera 0", "depth", "160 bytes", "432"]);
    assert_names(step(Some(&whole), Some(&short)), &["camera 0", "ids", "160 bytes", "216"]);
    assert_names(step(None, Some(&whole)), &["camera 0", "depth", "0 bytes", "432"]);
    let error =
        assert_names(step(Some(&whole), Some(&elsewhere)), &["camera 0", "ids", "another open device"]);
    assert!(matches!(error, EngineError::OtherDevice { .. }), "{error}");
    assert_names(step(Some(&elsewhere), Some(&whole)), &["camera 0", "depth", "another open device"]);
    step(Some(&whole), Some(&whole)).unwrap();
    drop(rig);
    assert_silent();
}

#[test]
fn motion_missing_where_it_was_asked_for() {
    for (synthesis, name) in [(Synthesis::Motion, "motion"), (Synthesis::Paper, "paper")] {
        let sensor = SensorModel { synthesis, ..sensor() };
        let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: None };
        assert_names(Rig::new(&DEVICE, &[config]), &["camera 0", name, "linear"]);
    }
    let base = sensor();
    let frames = frames(&base, 1);
    let mut rig = rig(&base, &frames, RigOptions::default());
    let asked = rig.set_sensor(0, SensorModel { synthesis: Synthesis::Motion, ..base.clone() });
    assert!(matches!(
        assert_names(asked, &["motion", "linear"]),
        EngineError::Frame(FrameError::MissingMotion { camera: 0, synthesis: "motion" })
    ));
    assert_eq!(rig.sensor(0).unwrap(), &base);
    assert_silent();
}

#[test]
fn time_that_does_not_advance_or_jumps() {
    let sensor = sensor();
    let frames = frames(&sensor, 3);
    let mut rig = rig(&sensor, &frames, RigOptions::default());
    step(&mut rig, &frames, 0);
    let first = step(&mut rig, &frames, 1);
    assert!(!first.packet.is_empty());
    let latest_ns = frames.frames[1].t_ns;
    for (t_ns, words) in [
        (latest_ns, ["33333333 ns is not after", "33333333"]),
        (latest_ns - 1, ["33333332", "33333333"]),
        (i64::MIN, ["-9223372036854775808", "within +-4611686018427387904"]),
        (latest_ns + 1_000_000_001, ["gap of 1000000001", "at most 1000000000"]),
        (i64::MAX, ["9223372036854775807", "within +-4611686018427387904"]),
    ] {
        assert_names(rig.step(&[t_ns]).map(|_| ()), &words);
    }
    assert_names(rig.step(&[1, 2]).map(|_| ()), &["2 frames for 1 cameras"]);
    assert_names(rig.step(&[]).map(|_| ()), &["0 frames for 1 cameras"]);
    // The refused call must leave no trace.
    let second = step(&mut rig, &frames, 2);
    assert_eq!(second.packet, engine(&sensor, &frames)[2].packet);
    assert_silent();
}

#[test]
fn sensors_out_of_range() {
    let base = sensor();
    let frames = frames(&base, 1);
    let bad = [
        ("contrast_on", SensorModel { contrast_on: 0.0, ..base.clone() }, "is 0"),
        ("contrast_on", SensorModel { contrast_on: f64::NAN, ..base.clone() }, "is NaN"),
        ("contrast_off", SensorModel { contrast_off: -0.2, ..base.clone() }, "is -0.2"),
        ("substeps", SensorModel { substeps: 0, ..base.clone() }, "1 to 64"),
        ("substeps", SensorModel { substeps: 65, ..base.clone() }, "is 65"),
        ("width", SensorModel { width: 0, ..base.clone() }, "1 to 16384"),
        ("timestamp_quantum_ns", SensorModel { timestamp_quantum_ns: 0, ..base.clone() }, "is 0"),
        ("log_offset", SensorModel { log_offset: 0.0, ..base.clone() }, "is 0"),
        ("aps_bits", SensorModel { aps_bits: 17, ..base.clone() }, "1 to 16"),
        ("latency_ns", SensorModel { latency_ns: 1_000_000_001, ..base.clone() }, "1000000001"),
    ];
    let mut rig = rig(&base, &frames, RigOptions::default());
    for (parameter, sensor, actual) in bad {
        let words = ["camera 0", parameter, actual, "expected"];
        let error = assert_names(Rig::new(&DEVICE, &[camera(&sensor, 0, &frames)]), &words);
        assert!(matches!(error, EngineError::Sensor { source: SensorError::Range { .. }, .. }));
        assert_names(rig.set_sensor(0, sensor), &words);
        assert_eq!(rig.sensor(0).unwrap(), &base);
    }
    drop(rig);
    assert_silent();
}

#[test]
fn a_size_that_changes() {
    let base = sensor();
    let mut rig = rig(&base, &frames(&base, 1), RigOptions::default());
    let wider = rig.set_sensor(0, SensorModel { width: 13, ..base.clone() });
    let error = assert_names(wider, &["camera 0", "12x9", "13x9", "new rig"]);
    assert!(matches!(error, EngineError::SizeChange { expected_width: 12, actual_width: 13, .. }));
    assert_eq!(rig.sensor(0).unwrap(), &base);
    assert_silent();
}

#[test]
fn cameras_that_are_not_there() {
    let base = sensor();
    let frames = frames(&base, 1);
    let mut rig = rig(&base, &frames, RigOptions::default());
    let words = ["1 cameras", "camera 7"];
    let bytes = FrameBytes { hdr: &frames.frames[0].hdr, motion: None, ..FrameBytes::default() };
    assert_names(rig.sensor(7).map(|_| ()), &words);
    assert_names(rig.inputs(7).map(|_| ()), &words);
    assert_names(rig.upload(7, &bytes), &words);
    assert_names(rig.set_sensor(7, base), &words);
    assert_names(rig.reset(7), &words);
    assert!(rig.substeps_q24(7).is_none());
    drop(rig);
    assert_silent();
}

#[test]
fn devices_that_are_not_there() {
    let name = DEVICE.info().name.clone();
    let by_index = Device::open(DeviceChoice::Index(99), Validation::Off);
    assert!(matches!(assert_names(by_index, &["99", &name]), EngineError::NoSuchDevice { .. }));
    let by_uuid = Device::open(DeviceChoice::Uuid([0xab; 16]), Validation::Off);
    assert!(matches!(assert_names(by_uuid, &["abab", &name]), EngineError::NoSuchDevice { .. }));
    assert_silent();
}

#[test]
fn memory_that_cannot_be_had() {
    let bytes = 1 << 50;
    let buffer = DEVICE.allocate("a petabyte", bytes, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly);
    let error = assert_names(buffer, &["memory", "1125899906842624 bytes", "a petabyte"]);
    assert!(matches!(error, EngineError::OutOfMemory { .. }), "{error:?}");
}

#[test]
fn cameras_that_are_too_much_for_one_rig() {
    let sensor = SensorModel {
        width: 2048,
        height: 2048,
        intensity: Intensity::BayerRggb,
        synthesis: Synthesis::Motion,
        ..SensorModel::default()
    };
    let config = CameraConfig {
        sensor,
        hdr: HdrFormat::F16x4,
        motion: Some(MotionFormat::F16x2),
        ..camera(&self::sensor(), 0, &frames(&self::sensor(), 1))
    };
    let error =
        assert_names(Rig::new(&DEVICE, &vec![config; 12]), &["`planes`", "4294967295", "rigs of their own"]);
    assert!(matches!(error, EngineError::OutOfMemory { .. }), "{error:?}");
}

#[test]
fn saved_states_that_do_not_fit() {
    let base = sensor();
    let frames = frames(&base, 6);
    let mut one = rig(&base, &frames, RigOptions::default());
    for index in 0..3 {
        step(&mut one, &frames, index);
    }
    let saved = one.save().unwrap();
    let expected = step(&mut one, &frames, 3).packet;

    let mut flipped = saved.clone();
    flipped[20] ^= 0xff;
    let mut version = saved.clone();
    let digit = saved.windows(10).position(|w| w == b"\"version\":").expect("the header is JSON") + 10;
    version[digit] = b'2';
    let garbage: Vec<u8> = (0..5000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let mut endless = saved[..16].to_vec();
    endless[8..16].copy_from_slice(&u64::MAX.to_le_bytes());
    let longer = [&saved[..], &[0; 4]].concat();
    let bad: [(&str, &[u8], &[&str]); 9] = [
        ("nothing", &[], &["saved state", "not a saved rig"]),
        ("garbage", &garbage, &["not a saved rig"]),
        ("only a mark", &saved[..8], &["truncated"]),
        ("half a header", &saved[..60], &["truncated"]),
        ("a header without end", &endless, &["truncated"]),
        ("a broken header", &flipped, &["saved state"]),
        ("another version", &version, &["version", "2", "expected"]),
        ("a truncated body", &saved[..saved.len() - 5], &["damaged", "CRC-32", "expected"]),
        ("a longer body", &longer, &["damaged", "CRC-32", "expected"]),
    ];
    for (what, bytes, words) in bad {
        println!("{what}");
        assert_names(one.restore(bytes), words);
    }

    // Restoring into other rigs fails, and each error names the difference.
    let other_sensor = SensorModel { seed: 5, ..base.clone() };
    let mut other = rig(&other_sensor, &frames, RigOptions::default());
    assert_names(other.restore(&saved), &["camera 0", "another sensor", "`seed = 5`", "expected `seed = "]);
    let config = camera(&base, 0, &frames);
    let mut two = Rig::new(&DEVICE, &[config.clone(), config]).unwrap();
    assert_names(two.restore(&saved), &["1 cameras, expected 2"]);

    // After the refused states, a valid one is restored.
    one.restore(&saved).unwrap();
    assert_eq!(step(&mut one, &frames, 3).packet, expected);
    assert!(!expected.is_empty());
    drop((one, other, two));
    assert_silent();
}

#[test]
fn shares_that_end_beyond_all_memory() {
    let sensor = sensor();
    let frames = frames(&sensor, 2);
    let mut rig = rig(&sensor, &frames, RigOptions::default());
    (0..2).for_each(|index| _ = step(&mut rig, &frames, index));
    let buffer = |device: &Arc<Device>| {
        device.allocate("target", 1 << 16, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly).unwrap()
    };
    let (target, elsewhere) = (buffer(&DEVICE), buffer(&OTHER_SIDE));
    for what in [Representation::EventFrame, Representation::Gathered] {
        for (before, all) in [(u64::MAX, 0), (1 << 62, 0), (1 << 60, 0), (0, u64::MAX)] {
            let error = rig.represent(what, &target, Share { before, all });
            assert!(matches!(assert_names(error, &["target", "65536"]), EngineError::OutOfMemory { .. }));
        }
        let error = rig.represent(what, &elsewhere, Share::default());
        assert_names(error, &["target", "another open device"]);
        rig.represent(what, &target, Share::default()).unwrap();
    }
    drop((rig, target, elsewhere));
    assert_silent();
}

#[test]
fn options_that_no_rig_can_have() {
    let sensor = sensor();
    let config = camera(&sensor, 0, &frames(&sensor, 1));
    let with = |options| Rig::with_options(&DEVICE, std::slice::from_ref(&config), options);
    let own = KernelPolicy { sort_threads: 0, ..KernelPolicy::gpu() };
    let refused = with(RigOptions { policy: Some(own), ..RigOptions::default() });
    assert_names(refused, &["sort_threads", "is 0", "a power of two"]);
    let refused = with(RigOptions { packet_ring: u32::MAX, ..RigOptions::default() });
    assert_names(refused, &["packet_ring", "4294967295", "at most 64"]);
    assert_silent();
}

#[test]
fn hooks_that_a_submission_cannot_have() {
    let sensor = sensor();
    let frames = frames(&sensor, 1);
    let mut rig = rig(&sensor, &frames, RigOptions::default());
    let on = |device| Timeline::new(device, vk::ExternalSemaphoreHandleTypeFlags::empty()).unwrap();
    let (own, other) = (on(&DEVICE), on(&OTHER_SIDE));
    let commands = Commands::new(&OTHER_SIDE).unwrap();
    own.signal(10).unwrap();
    let none = SubmitHooks::default();
    let mut step = |hooks: &SubmitHooks<'_>| rig.step_frames(&[None], hooks).map(|_| ());
    for value in [5, 10] {
        let error = assert_names(step(&SubmitHooks { signals: &[(&own, value)], ..none }), &["above 10"]);
        assert!(matches!(error, EngineError::TimelineValue { expected_above: 10, .. }), "{error}");
    }
    let words = &["a timeline", "another open device"];
    assert_names(step(&SubmitHooks { waits: &[(&other, 0)], ..none }), words);
    assert_names(step(&SubmitHooks { signals: &[(&other, 1)], ..none }), words);
    assert_names(step(&SubmitHooks { before: &[&commands], ..none }), &["commands", "another open device"]);
    assert_names(DEVICE.run_with_hooks(&commands, &none), &["commands", "another open device"]);
    assert_eq!(own.value().unwrap(), 10);
    step(&SubmitHooks { waits: &[(&own, 10)], signals: &[(&own, 11)], ..none }).unwrap();
    assert_eq!(own.value().unwrap(), 11);
    drop((rig, own, other, commands));
    assert_silent();
}

#[test]
fn timelines_that_would_not_grow() {
    let timeline = Timeline::new(&DEVICE, vk::ExternalSemaphoreHandleTypeFlags::empty()).unwrap();
    assert_names(timeline.signal(0), &["above 0", "to 0"]);
    timeline.signal(5).unwrap();
    for value in [0, 4, 5] {
        let error = assert_names(timeline.signal(value), &["above 5", &format!("to {value}")]);
        assert!(matches!(error, EngineError::TimelineValue { expected_above: 5, actual } if actual == value));
    }
    assert_eq!(timeline.value().unwrap(), 5);
    timeline.signal(6).unwrap();
    drop(timeline);
    assert_silent();
}
