//! A fault at each point in turn.

use crate::driver::{Driver, Given, Station, rig_of, undisturbed};
use crate::operations::{Operation, delayed, flashing, operations};
use crate::strike::{Faults, Kind};
use esaac_tests::device::{alone, assert_silent};

/// State of the driver before each operation.
fn stations() -> Vec<Station> {
    let mut driver = Driver::new();
    let mut station = |operation: &Operation| {
        let before = Station {
            sensors: driver.sensors.clone(),
            frame: driver.frame,
            instances: driver.instances,
            saved: driver.rig.save().expect("a state"),
        };
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
        for (index, station) in stations.iter().enumerate() {
            for point in 0.. {
                let mut driver = Driver::at(station);
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
