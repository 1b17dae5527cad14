//! Packets that are held for longer than the rig keeps them.

use crate::driver::{Driver, given, undisturbed};
use crate::operations::{flashing, operations};
use esaac_engine::{CameraConfig, Rig};
use esaac_model::HdrFormat;
use esaac_tests::device::{DEVICE, alone, assert_silent};

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
    let config =
        CameraConfig { sensor: flashing(), camera: 0, hdr: HdrFormat::F32x4, motion: None, geometry: None };
    let rig = Rig::new(&DEVICE, &[config]).expect("a rig");
    assert!(rig.last_tick().hold().is_none());
}
