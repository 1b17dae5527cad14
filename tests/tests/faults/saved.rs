//! States that are saved by a rig whose buffers have grown, and states that are damaged.

use crate::driver::{Driver, rig_of, undisturbed};
use crate::operations::{Operation, delayed, flashing, operations, sequences};
use esaac_engine::{EngineError, Rig, RigOptions};
use esaac_model::{Intensity, SensorModel};
use esaac_tests::device::{alone, assert_silent};
use esaac_tests::run;
use esaac_tests::saved::{with_header, with_value};

#[test]
fn a_state_saved_after_planes_have_grown_is_taken_up_by_any_rig_of_its_sensors() {
    let _alone = alone();
    let mut driver = Driver::new();
    let expected = undisturbed();
    // Up to the change from a sensor with larger planes back to the one with the smallest.
    let shrinks = |o: &Operation| matches!(o, Operation::Change(0, sensor) if **sensor == flashing());
    let last = operations().iter().position(shrinks).expect("a change back");
    for operation in &operations()[..=last] {
        driver.run(operation).expect("no fault");
    }
    let next = driver.frame;
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
    assert_eq!(grown_step, expected[next]);
    assert_eq!(fresh_step, expected[next]);
    let saved = driver.rig.save().expect("a state");
    let mut grown = rig_of(&driver.sensors).expect("a rig");
    let bayer = SensorModel { intensity: Intensity::BayerRggb, ..flashing() };
    grown.set_sensor(0, bayer).expect("planes that grow");
    grown.set_sensor(0, flashing()).expect("planes that stay");
    grown.restore(&saved).expect("the state of a rig whose planes have not");
    drop((driver, grown));
    assert_silent();
}

/// A rig whose events wait for later packets, and its state.
fn waiting() -> (Rig, Vec<u8>) {
    let sequence = &sequences()[1];
    let mut rig = run::rig(&delayed(), sequence, RigOptions::default());
    let deferred = |index| run::step(&mut rig, sequence, index).diagnostics.deferred_events;
    assert!((0..3).map(deferred).last() > Some(10));
    let saved = rig.save().expect("a state");
    (rig, saved)
}

#[test]
fn a_state_with_a_damaged_byte_is_refused_and_changes_nothing() {
    let _alone = alone();
    let (mut rig, saved) = waiting();
    let expected = run::step(&mut rig, &sequences()[1], 3).packet;
    let header_bytes = u64::from_le_bytes(saved[8..16].try_into().expect("eight bytes")) as usize;
    rig.restore(&saved).expect("its own state");
    // All of the header, and of the events at the end; each part of the pixels' state between them.
    let all_of = |index: &usize| *index < 16 + header_bytes || *index + 1000 > saved.len();
    let damaged = (0..saved.len()).filter(|index| all_of(index) || index % 37 == 0);
    let mut flipped = saved.clone();
    for index in damaged {
        flipped[index] ^= 1 << (index % 8);
        let refused = rig.restore(&flipped);
        assert!(matches!(refused, Err(EngineError::Snapshot(_))), "byte {index}: {refused:?}");
        flipped[index] = saved[index];
    }
    assert!(run::step(&mut rig, &sequences()[1], 3).packet == expected && expected.len() > 10);
    drop(rig);
    assert_silent();
}

#[test]
fn a_state_that_claims_more_waiting_events_than_it_has_is_refused() {
    let _alone = alone();
    let (mut rig, saved) = waiting();
    assert!(with_header(&saved, str::to_owned) == saved);
    for events in ["0", "4294967295"] {
        let made_up = with_value(&saved, "deferred_events", events);
        let refused = rig.restore(&made_up).expect_err("other events than there are").to_string();
        assert!(refused.contains("bytes of buffers, expected"), "{refused}");
    }
    drop(rig);
    assert_silent();
}
