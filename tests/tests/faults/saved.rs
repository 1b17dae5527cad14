//! States that are saved by a rig whose buffers have grown.

use crate::driver::{Driver, rig_of, undisturbed};
use crate::operations::{Operation, flashing, operations};
use esaac_model::{Intensity, SensorModel};
use esaac_tests::device::{alone, assert_silent};

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
