//! What is left after a failed wait: a lost rig, and commands that may still run.

#![expect(unsafe_code, reason = "commands that are made to fail are recorded by hand")]

use crate::driver::Driver;
use crate::operations::{Operation, flashing};
use crate::strike::{Faults, Kind};
use esaac_engine::ash::vk;
use esaac_engine::{Commands, EngineError, FaultPoint, FrameBytes, Representation, SubmitHooks};
use esaac_tests::device::{DEVICE, alone, assert_silent};
use std::sync::Arc;

/// The longest wait, seconds.
fn limit_s() -> u64 {
    if DEVICE.is_software() { 600 } else { 60 }
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
    let late = format!("did not finish within {} s", limit_s());
    for word in [&late, "close it", "restore"] {
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
    refused(rig.represent_to_host(Representation::Gathered).map(|_| ()));
    refused(rig.upload(
        0,
        &FrameBytes { hdr: &driver.sequences[0].frames[1].hdr, motion: None, ..FrameBytes::default() },
    ));
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
    assert!(matches!(error, EngineError::Timeout(s) if s == limit_s()), "{error}");
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
