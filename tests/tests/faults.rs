//! Failures of the device: memory that cannot be allocated, a queue that accepts nothing, a wait that times out, a
//! device that is lost. Whichever call fails, the next step is right to the bit or refused. No event comes twice, and
//! none is lost silently.

#![expect(unsafe_code, reason = "commands that are made to fail are recorded by hand")]

use esaac_engine::ash::vk;
use esaac_engine::{
    CameraConfig, Commands, Device, DeviceChoice, EngineError, FaultPoint, FrameBytes, HeldPackets,
    PacketPlace, Representation, Restrictions, Rig, RigOptions, SubmitHooks, Validation,
};
use esaac_layout::Counters;
use esaac_model::{HdrFormat, Intensity, Packet, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{Sequence, gray, intensity_of, times};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Runs tests one at a time: the faults of a device hit every test that uses it.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A sensor that stamps events with the ends of sub-steps. When the light jumps, all events lie in one bin: the event
/// queue of `cross` overflows, event buffers grow, and `merge` sorts the packet.
fn flashing() -> SensorModel {
    SensorModel {
        width: 16,
        height: 16,
        synthesis: Synthesis::Linear,
        substeps: 1,
        timestamps: Timestamps::AtSample,
        contrast_on: 0.2,
        contrast_off: 0.2,
        contrast_mismatch: 0.02,
        aps_exposure_ns: 5_000_000,
        ..SensorModel::default()
    }
}

/// A sensor with noise, and with events deferred to later packets.
fn delayed() -> SensorModel {
    SensorModel {
        width: 19,
        height: 9,
        synthesis: Synthesis::Linear,
        substeps: 4,
        substep_policy: SubstepPolicy::Fixed,
        shot_noise_rate_hz: 40.0,
        latency_ns: 20_000_000,
        latency_jitter_ns: 100_000,
        refractory_ns: 1000,
        ..SensorModel::default()
    }
}

/// One operation on a rig.
#[derive(Clone, Debug)]
enum Operation {
    Step,
    Change(usize, SensorModel),
    Reset(usize),
}

const FRAMES: usize = 8;

fn operations() -> Vec<Operation> {
    let bayer = SensorModel { intensity: Intensity::BayerRggb, ..flashing() };
    let quicker = SensorModel { latency_ns: 3_000_000, contrast_on: 0.15, ..delayed() };
    vec![
        Operation::Step,
        Operation::Step,
        Operation::Change(0, bayer),
        Operation::Step,
        Operation::Step,
        Operation::Change(1, quicker),
        Operation::Step,
        Operation::Change(0, flashing()),
        Operation::Step,
        Operation::Reset(1),
        Operation::Step,
        Operation::Step,
    ]
}

fn sequences() -> [Sequence; 2] {
    // Every other frame is brighter by twenty thresholds.
    let flash = gray(&flashing(), &times(0, FRAMES), |frame, pixel| {
        intensity_of(&flashing(), if frame % 2 == 1 { 0.0 } else { -4.0 } - 0.003 * (pixel % 16) as f64)
    });
    let waves = gray(&delayed(), &times(0, FRAMES), |frame, pixel| {
        intensity_of(&delayed(), -2.0 + (0.9 * frame as f64 + 0.4 * (pixel % 19) as f64).sin())
    });
    [flash, waves]
}

const OPTIONS: RigOptions = RigOptions {
    keep_substeps: false,
    stage_times: false,
    initial_events: 64,
    packets: PacketPlace::InPlace,
    packet_ring: 2,
    policy: None,
};

fn rig_of(sensors: &[SensorModel; 2]) -> Result<Rig, EngineError> {
    let config = |camera: usize| CameraConfig {
        sensor: sensors[camera].clone(),
        camera: camera as u32,
        hdr: HdrFormat::F32x4,
        motion: None,
    };
    Rig::with_options(&DEVICE, &[config(0), config(1)], OPTIONS)
}

/// A step's packets and APS frame.
#[derive(Clone, Debug, PartialEq)]
struct Given {
    packets: Vec<Packet>,
    aps: Vec<u16>,
}

fn given(held: &HeldPackets) -> Given {
    Given {
        packets: (0..held.len()).map(|camera| held.view(camera).to_packet()).collect(),
        aps: held.aps_pixels(0).to_vec(),
    }
}

/// A rig and its progress through the operations.
struct Driver {
    rig: Rig,
    sequences: [Sequence; 2],
    sensors: [SensorModel; 2],
    frame: usize,
    /// The state after the last operation.
    saved: Vec<u8>,
    /// The last step's packets, held while the next one runs.
    held: Option<(HeldPackets, Given)>,
}

impl Driver {
    fn new() -> Self {
        let sensors = [flashing(), delayed()];
        let rig = rig_of(&sensors).expect("a rig of two small cameras");
        let saved = rig.save().expect("a state");
        Driver { rig, sequences: sequences(), sensors, frame: 0, saved, held: None }
    }

    /// A driver that goes on from a saved state.
    fn at(sensors: &[SensorModel; 2], frame: usize, saved: &[u8]) -> Self {
        let mut rig = rig_of(sensors).expect("a rig of two small cameras");
        rig.restore(saved).expect("a state");
        let (sensors, saved) = (sensors.clone(), saved.to_vec());
        Driver { rig, sequences: sequences(), sensors, frame, saved, held: None }
    }

    /// Runs an operation. A step returns its packets.
    fn run(&mut self, operation: &Operation) -> Result<Option<Given>, EngineError> {
        match operation {
            Operation::Step => {
                for (camera, sequence) in self.sequences.iter().enumerate() {
                    let hdr = &sequence.frames[self.frame].hdr;
                    self.rig.upload(camera, &FrameBytes { hdr, motion: None })?;
                }
                let t_ns = self.sequences[0].frames[self.frame].t_ns;
                let tick = self.rig.step(&[t_ns, t_ns])?;
                let held = tick.hold().expect("packets are in place");
                let now = given(&held);
                if let Some((held, before)) = self.held.replace((held, now.clone())) {
                    assert_eq!(given(&held), before, "packets that are held stay as they were");
                }
                self.frame += 1;
                Ok(Some(now))
            }
            Operation::Change(camera, sensor) => {
                self.rig.set_sensor(*camera, sensor.clone())?;
                self.sensors[*camera] = sensor.clone();
                Ok(None)
            }
            Operation::Reset(camera) => self.rig.reset(*camera).map(|()| None),
        }
    }

    /// Replaces a lost rig by a new one, restored to the state saved last.
    fn make_anew(&mut self) {
        self.rig = rig_of(&self.sensors).expect("a new rig");
        self.rig.restore(&self.saved).expect("the state saved last");
    }

    /// Runs an operation while `faults` may strike, and recovers as a user would. The result is that of an undisturbed
    /// run.
    fn run_with(&mut self, operation: &Operation, faults: &Faults) -> Option<Given> {
        let first = faults.strike(|| self.run(operation));
        if let Err(error) = &first {
            let says_lost = matches!(error, EngineError::Lost { .. });
            assert_eq!(says_lost, self.rig.lost().is_some(), "{operation:?}: {error}");
        }
        let is_lost = self.rig.lost().is_some();
        if is_lost {
            let refused = self.rig.reset(0).expect_err("a lost rig refuses everything");
            assert!(matches!(refused, EngineError::Lost { .. }), "{refused}");
            self.make_anew();
        }
        let given = match first {
            Ok(given) if !is_lost => given,
            first => {
                if let Ok(Some(_)) = first {
                    // The tick succeeded and a later call failed. The restored state is that before the tick.
                    self.frame -= 1;
                }
                let again = self.run(operation).unwrap_or_else(|e| panic!("{operation:?}, again: {e}"));
                if let Ok(Some(first)) = first {
                    assert!(again.as_ref() == Some(&first), "the same step gives the same");
                }
                again
            }
        };
        self.saved = faults.strike(|| self.rig.save()).unwrap_or_else(|error| {
            assert!(self.rig.lost().is_none(), "saving changes nothing: {error}");
            self.rig.save().expect("a state")
        });
        given
    }
}

/// Kinds of failures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Allocations, descriptors and submissions fail, and waits time out.
    Refusals,
    /// Submissions and waits report that the device is lost.
    Losses,
}

/// A fault at the n-th of the points at which one may strike.
struct Faults {
    kind: Kind,
    left: Arc<AtomicUsize>,
}

impl Faults {
    fn at(kind: Kind, point: usize) -> Self {
        Faults { kind, left: Arc::new(AtomicUsize::new(point + 1)) }
    }

    /// Runs `something`, during which the fault may strike.
    fn strike<T>(&self, something: impl FnOnce() -> T) -> T {
        let (kind, left) = (self.kind, Arc::clone(&self.left));
        let hook = move |point: FaultPoint| {
            let result = match (kind, point) {
                (Kind::Refusals, FaultPoint::Allocate) => vk::Result::ERROR_OUT_OF_DEVICE_MEMORY,
                (Kind::Refusals, FaultPoint::Descriptors) => vk::Result::ERROR_OUT_OF_POOL_MEMORY,
                (Kind::Refusals, FaultPoint::Record | FaultPoint::Submit) => {
                    vk::Result::ERROR_OUT_OF_HOST_MEMORY
                }
                (Kind::Refusals, FaultPoint::Wait) => vk::Result::TIMEOUT,
                (Kind::Losses, FaultPoint::Submit | FaultPoint::Wait) => vk::Result::ERROR_DEVICE_LOST,
                (Kind::Losses, _) => return None,
            };
            let before = left.load(Ordering::Relaxed);
            left.store(before.saturating_sub(1), Ordering::Relaxed);
            (before == 1).then_some(result)
        };
        DEVICE.set_faults(Some(Arc::new(hook)));
        let given = something();
        DEVICE.set_faults(None);
        given
    }

    fn has_struck(&self) -> bool {
        self.left.load(Ordering::Relaxed) == 0
    }
}

/// Results of the steps when nothing fails.
fn undisturbed() -> Vec<Given> {
    let mut driver = Driver::new();
    let given: Vec<Given> =
        operations().iter().filter_map(|operation| driver.run(operation).expect("no fault")).collect();
    let events: usize = given.iter().flat_map(|step| &step.packets).map(Packet::len).sum();
    assert!(events > 20_000, "{events} events");
    given
}

#[test]
fn the_operations_grow_overflow_merge_and_defer() {
    let _alone = alone();
    let mut driver = Driver::new();
    let mut seen = [false; 4];
    for operation in &operations() {
        driver.run(operation).expect("no fault");
        let tick = driver.rig.last_tick();
        seen[0] |= tick.diagnostics.iter().any(|d| d.regrown > 0);
        seen[1] |= tick.diagnostics[1].deferred_events > 0;
        seen[2] |= tick.aps[0].is_some() && tick.aps_pixels(0).iter().any(|&value| value > 0);
        // More events of one time than `sort` can sort.
        let times = tick.view(0).t_offset_ns;
        seen[3] |= times.last().is_some_and(|last| times.iter().filter(|&t| t == last).count() > 2048);
    }
    assert_eq!(seen, [true; 4], "growth, deferred events, APS, packets for `merge`");
    drop(driver);
    assert_silent();
}

/// State of the driver before each operation: sensors, frame and saved state.
fn stations() -> Vec<([SensorModel; 2], usize, Vec<u8>)> {
    let mut driver = Driver::new();
    let mut station = |operation: &Operation| {
        let before = (driver.sensors.clone(), driver.frame, driver.rig.save().expect("a state"));
        driver.run(operation).expect("no fault");
        before
    };
    operations().iter().map(&mut station).collect()
}

#[test]
fn whichever_call_fails_the_next_step_is_right_or_refused() {
    let _alone = alone();
    let (expected, stations, operations) = (undisturbed(), stations(), operations());
    let mut struck = 0;
    for kind in [Kind::Refusals, Kind::Losses] {
        for (index, (sensors, frame, saved)) in stations.iter().enumerate() {
            for point in 0.. {
                let mut driver = Driver::at(sensors, *frame, saved);
                let faults = Faults::at(kind, point);
                let mut given = driver.run_with(&operations[index], &faults);
                let check = |given: &Option<Given>, steps: usize| {
                    let right = given.as_ref().is_none_or(|given| *given == expected[steps - 1]);
                    assert!(right, "{kind:?} at point {point} of operation {index}");
                };
                check(&given, driver.frame);
                for operation in &operations[index + 1..] {
                    given = driver.run(operation).expect("no fault");
                    check(&given, driver.frame);
                    if given.is_some() {
                        break;
                    }
                }
                if !faults.has_struck() {
                    break;
                }
                struck += 1;
            }
        }
    }
    println!("{struck} faults");
    assert!(struck > 100, "{struck} faults");
    assert_silent();
}

/// A small generator for the choice of faults: SplitMix64.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % bound as u64) as usize
    }
}

#[test]
fn a_thousand_random_faults() {
    let _alone = alone();
    let seed = std::env::var("ESAAC_FAULT_SEED").map_or(20_261_123, |seed| seed.parse().expect("a number"));
    println!("ESAAC_FAULT_SEED={seed}");
    let mut random = Random(seed);
    let expected = undisturbed();
    let mut struck = 0;
    while struck < 1000 {
        let mut driver = Driver::new();
        let mut actual = Vec::new();
        for operation in &operations() {
            let kind = if random.below(4) == 0 { Kind::Losses } else { Kind::Refusals };
            let faults = Faults::at(kind, random.below(12));
            actual.extend(driver.run_with(operation, &faults));
            struck += usize::from(faults.has_struck());
        }
        assert!(actual == expected, "seed {seed}, {struck} faults");
    }
    assert_silent();
}

#[test]
fn a_rig_that_cannot_be_made_leaves_nothing_behind() {
    let _alone = alone();
    let sensors = [flashing(), delayed()];
    let mut points = 0;
    loop {
        let faults = Faults::at(Kind::Refusals, points);
        let made = faults.strike(|| rig_of(&sensors).map(|_| ()));
        if !faults.has_struck() {
            made.expect("no fault");
            break;
        }
        made.expect_err("a rig with a part missing");
        points += 1;
    }
    assert!(points > 20, "{points} points");
    assert_silent();
}

#[test]
fn a_step_that_times_out_loses_the_rig_and_says_what_to_do() {
    let _alone = alone();
    let mut driver = Driver::new();
    driver.run(&Operation::Step).expect("a first frame");
    let faults = |point| match point {
        FaultPoint::Wait => Some(vk::Result::TIMEOUT),
        _ => None,
    };
    DEVICE.set_faults(Some(Arc::new(faults)));
    let error = driver.run(&Operation::Step).expect_err("a wait that times out");
    DEVICE.set_faults(None);
    let words = error.to_string();
    for word in ["did not finish within 60 s", "close it", "restore"] {
        assert!(words.contains(word), "{word} in: {words}");
    }
    let rig = &mut driver.rig;
    let refused = |result: Result<(), EngineError>| {
        assert!(matches!(result, Err(EngineError::Lost { .. })), "{result:?}");
    };
    refused(rig.step(&[1, 1]).map(|_| ()));
    refused(rig.set_sensor(0, flashing()));
    refused(rig.reset(0));
    refused(rig.save().map(|_| ()));
    refused(rig.restore(&driver.saved));
    refused(rig.represent_to_host(Representation::EventFrame).map(|_| ()));
    refused(rig.upload(0, &FrameBytes { hdr: &driver.sequences[0].frames[1].hdr, motion: None }));
    refused(rig.inputs(0).map(|_| ()));
    assert_eq!(rig.last_tick().events, [0, 0], "the failed tick shows no packets");
    assert!(rig.stage_host_times().expect("a lost rig's times").is_none(), "and no times");
    assert!(!rig.kernel_statistics().expect("a lost rig's kernels").is_empty());
    drop(driver);
    assert_silent();
}

#[test]
fn a_rig_that_is_lost_after_a_tick_shows_the_tick() {
    let _alone = alone();
    // After a flash, the bins grow. A failed wait for their copies loses the rig, but not the tick before.
    let is_lost_after_its_tick = |point| {
        let mut driver = Driver::new();
        driver.run(&Operation::Step).expect("a first frame");
        let faults = Faults::at(Kind::Refusals, point);
        let given = faults.strike(|| driver.run(&Operation::Step));
        assert!(faults.has_struck(), "no point at which bins grow");
        (given.is_ok() && driver.rig.lost().is_some()).then_some(driver)
    };
    let driver = (0..).find_map(is_lost_after_its_tick).expect("a failure after the tick");
    let rig = &driver.rig;
    assert!(rig.last_tick().events[0] > 0 && !rig.last_tick().view(0).x.is_empty());
    let times = rig.stage_host_times().expect("times of the last tick");
    assert_eq!(times.is_some(), DEVICE.info().has("VK_EXT_calibrated_timestamps"));
    assert!(matches!(rig.save(), Err(EngineError::Lost { .. })));
    drop(driver);
    assert_silent();
}

#[test]
fn a_state_saved_after_planes_have_grown_is_taken_up_by_any_rig_of_its_sensors() {
    let _alone = alone();
    let mut driver = Driver::new();
    let expected = undisturbed();
    // The eighth operation changes from the sensor with the larger planes back to the one with the smaller ones.
    for operation in &operations()[..8] {
        driver.run(operation).expect("no fault");
    }
    let saved = driver.rig.save().expect("a state");
    driver.rig.restore(&saved).expect("its own state");
    let [grown_step, fresh_step] = [false, true].map(|fresh| {
        if fresh {
            driver.rig = rig_of(&driver.sensors).expect("a rig whose planes have not grown");
            driver.rig.restore(&saved).expect("the state of a rig whose planes have");
            driver.frame -= 1;
        }
        driver.run(&Operation::Step).expect("a step").expect("packets")
    });
    assert_eq!(grown_step, expected[5]);
    assert_eq!(fresh_step, expected[5]);
    let saved = driver.rig.save().expect("a state");
    let mut grown = rig_of(&driver.sensors).expect("a rig");
    let bayer = SensorModel { intensity: Intensity::BayerRggb, ..flashing() };
    grown.set_sensor(0, bayer).expect("planes that grow");
    grown.set_sensor(0, flashing()).expect("planes that stay");
    grown.restore(&saved).expect("the state of a rig whose planes have not");
    drop((driver, grown));
    assert_silent();
}

#[test]
fn held_packets_outlive_the_ring_and_the_rig() {
    let _alone = alone();
    let mut driver = Driver::new();
    let expected = undisturbed();
    let mut held = Vec::new();
    for operation in &operations() {
        if driver.run(operation).expect("no fault").is_some() {
            held.push(driver.rig.last_tick().hold().expect("packets are in place"));
        }
    }
    drop(driver);
    assert!(held.iter().map(given).eq(expected), "every tick's packets, though the ring has two sets");
    drop(held);
    assert_silent();
}

#[test]
fn owned_packets_cannot_be_held() {
    let _alone = alone();
    let config = CameraConfig { sensor: flashing(), camera: 0, hdr: HdrFormat::F32x4, motion: None };
    let rig = Rig::new(&DEVICE, &[config]).expect("a rig");
    assert!(rig.last_tick().hold().is_none());
}

#[test]
fn commands_whose_wait_failed_are_refused() {
    let _alone = alone();
    let (once, around) =
        (Commands::new(&DEVICE).expect("commands"), Commands::new(&DEVICE).expect("commands"));
    for commands in [&once, &around] {
        // SAFETY: the commands were just made; nothing is recorded.
        unsafe { commands.record(|_| {}) }.expect("no fault");
    }
    let after = [&around];
    let hooks = SubmitHooks { after: &after, ..SubmitHooks::default() };
    DEVICE.run_with_hooks(&once, &hooks).expect("no fault");
    let faults = |point| (point == FaultPoint::Wait).then_some(vk::Result::TIMEOUT);
    DEVICE.set_faults(Some(Arc::new(faults)));
    let error = DEVICE.run_with_hooks(&once, &hooks).expect_err("a wait that times out");
    DEVICE.set_faults(None);
    assert!(matches!(error, EngineError::Timeout(60)), "{error}");
    let refused = |result| assert!(matches!(result, Err(EngineError::Abandoned)), "{result:?}");
    refused(DEVICE.run_with_hooks(&once, &SubmitHooks::default()));
    // SAFETY: refused, since the commands may be pending.
    refused(unsafe { once.record(|_| {}) });
    let other = Commands::new(&DEVICE).expect("commands");
    // SAFETY: the commands were just made; nothing is recorded.
    unsafe { other.record(|_| {}) }.expect("no fault");
    refused(DEVICE.run_with_hooks(&other, &hooks));
    DEVICE.run_with_hooks(&other, &SubmitHooks::default()).expect("no fault");
    drop((once, around, other));
    assert_silent();
}

#[test]
fn a_camera_with_more_workgroups_than_the_device_takes_is_refused_with_numbers() {
    let restrictions = Restrictions { most_groups: 3, ..Restrictions::default() };
    let device =
        Device::open_restricted(DeviceChoice::Best, Validation::Off, restrictions).expect("a device");
    let config = |width| CameraConfig {
        sensor: SensorModel { width, height: 8, ..flashing() },
        camera: 0,
        hdr: HdrFormat::F32x4,
        motion: None,
    };
    Rig::new(&device, &[config(32)]).expect("one tile, which `cross` may take in two parts");
    let error = Rig::new(&device, &[config(32), config(64)]).map(|_| ()).unwrap_err();
    let words = error.to_string();
    for word in ["camera 1", "4 workgroups", "at most 3", &device.info().name] {
        assert!(words.contains(word), "{word} in: {words}");
    }
    assert!(matches!(error, EngineError::TooManyGroups { expected: 3, actual: 4, .. }));
}

#[test]
fn a_device_without_a_clock_gives_the_same_events_and_no_times() {
    let _alone = alone();
    let restrictions = Restrictions { no_timestamps: true, ..Restrictions::default() };
    let device = Device::open_restricted(DeviceChoice::Best, Validation::from_env(), restrictions);
    let device = device.expect("a device");
    let steps = |device: &Arc<Device>, stage_times| {
        let sensor = flashing();
        let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None };
        let options = RigOptions { stage_times, initial_events: 64, ..RigOptions::default() };
        let mut rig = Rig::with_options(device, &[config], options).expect("a rig");
        let frames = &sequences()[0].frames[..3];
        let step = |frame: &esaac_tests::frames::Frame| {
            rig.upload(0, &FrameBytes { hdr: &frame.hdr, motion: None }).expect("a frame");
            let tick = rig.step(&[frame.t_ns]).expect("a step");
            (tick.packets.to_vec(), tick.gpu_ns(), tick.stage_ns.len())
        };
        frames.iter().map(step).collect::<Vec<_>>()
    };
    let timed = steps(&DEVICE, true);
    for stage_times in [false, true] {
        let untimed = steps(&device, stage_times);
        for (timed, untimed) in timed.iter().zip(untimed) {
            assert_eq!((timed.0 == untimed.0, untimed.1, untimed.2), (true, None, 0));
            assert!(timed.1.is_some() && timed.2 > 1);
        }
    }
    assert_eq!(device.validation_messages(), [""; 0]);
}

#[test]
fn event_counts_do_not_wrap_at_32_bits() {
    let _alone = alone();
    // Five events per pixel, and twenty, with which the event queue of `cross` overflows. The count starts a little
    // below 2^32, so that the events of the last tiles would wrap it.
    for (contrast, before) in [(0.79, u32::MAX - 700), (0.2, u32::MAX - 3000)] {
        let sensor = SensorModel { contrast_on: contrast, contrast_off: contrast, ..flashing() };
        let config = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion: None };
        let mut rig = Rig::new(&DEVICE, &[config]).expect("a rig");
        let frames = &sequences()[0].frames;
        rig.upload(0, &FrameBytes { hdr: &frames[0].hdr, motion: None }).expect("a frame");
        rig.step(&[frames[0].t_ns]).expect("a first frame");
        // The state ends with two sets of counters. The second is that of the next tick.
        let mut saved = rig.save().expect("a state");
        let second = saved.len() - size_of::<Counters>();
        let mut counters: Counters = bytemuck::pod_read_unaligned(&saved[second..]);
        assert_eq!((counters.emitted, counters.emitted_fit), (0, u32::MAX), "fresh counters");
        counters.emitted = before;
        saved[second..].copy_from_slice(bytemuck::bytes_of(&counters));
        rig.restore(&saved).expect("a state");
        rig.upload(0, &FrameBytes { hdr: &frames[1].hdr, motion: None }).expect("a frame");
        let error = rig.step(&[frames[1].t_ns]).map(|_| ()).expect_err("more events than there is room for");
        let words = error.to_string();
        assert!(words.contains("no device memory") && words.contains("4294967295"), "{words}");
        drop(rig);
    }
    assert_silent();
}
