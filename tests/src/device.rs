//! The device under test. A missing device fails a test; nothing is skipped.

use esaac_engine::{Device, DeviceChoice, Validation};
use std::sync::{Arc, LazyLock};

/// The device that all tests of a process share: the best one, or the one with the index in `ESAAC_DEVICE`. The
/// validation layer is on where `ESAAC_VALIDATION` is set, as by the test script.
pub static DEVICE: LazyLock<Arc<Device>> = LazyLock::new(|| {
    let choice = match std::env::var("ESAAC_DEVICE") {
        Ok(index) => DeviceChoice::Index(index.parse().expect("ESAAC_DEVICE is a device's index")),
        Err(_) => DeviceChoice::Best,
    };
    Device::open(choice, Validation::from_env())
        .expect("a Vulkan device; `esaac doctor` says what is missing")
});

/// Fails if the validation layer has reported anything since the process began.
#[track_caller]
pub fn assert_silent() {
    let messages = DEVICE.validation_messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}
