//! Devices that are opened again and again, in a process that has no other.

use esaac_engine::{Device, DeviceChoice, Validation};

/// NVIDIA's driver can be loaded about thirty times.
const TIMES: usize = 100;

#[test]
fn a_device_may_be_opened_and_dropped_any_number_of_times() {
    for time in 0..TIMES {
        let device = Device::open(DeviceChoice::Best, Validation::from_env());
        assert!(device.is_ok(), "time {time}: {}", device.err().map_or_else(String::new, |e| e.to_string()));
    }
}
