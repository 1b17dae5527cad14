//! The device under test. A missing device fails a test; nothing is skipped.

use esaac_engine::{Device, DeviceChoice, KernelPolicy, Validation};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

/// The device that all tests of a process share: the best one, or the one with the index in `ESAAC_DEVICE`. The
/// validation layer is on where `ESAAC_VALIDATION` is set, as by the test script.
pub static DEVICE: LazyLock<Arc<Device>> = LazyLock::new(|| Arc::clone(&OPENED[0]));

/// The same device opened a second time, as another process would: for tests with two sides.
pub static OTHER_SIDE: LazyLock<Arc<Device>> = LazyLock::new(|| Arc::clone(&OPENED[1]));

/// Both are opened before either is used. The validation layer keeps its devices in a table that it does not lock: a
/// call on one device may crash while another is opened or dropped (KhronosGroup/Vulkan-ValidationLayers, issue 4391).
static OPENED: LazyLock<[Arc<Device>; 2]> = LazyLock::new(|| {
    let choice = match std::env::var("ESAAC_DEVICE") {
        Ok(index) => DeviceChoice::Index(index.parse().expect("ESAAC_DEVICE is a device's index")),
        Err(_) => DeviceChoice::Best,
    };
    let open = |choice| {
        Device::open(choice, Validation::from_env())
            .expect("a Vulkan device; `esaac doctor` says what is missing")
    };
    let first = open(choice);
    let again = open(DeviceChoice::Uuid(first.info().uuid));
    [first, again]
});

/// How kernels are run on [`DEVICE`] where the validation layer is off.
#[must_use]
pub fn policy() -> KernelPolicy {
    if DEVICE.is_software() { KernelPolicy::software_driver() } else { KernelPolicy::gpu() }
}

/// Runs tests of a process one at a time: those with faults of the device that they share, or with devices of their own.
pub fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What the layer of Ubuntu 24.04 (1.3.275) says of imported memory: it knows exported memory by the number of its
/// descriptor, also after that was closed and the number given to another. Sizes are compared by the link itself.
const OF_AN_EARLIER_DESCRIPTOR: [&str; 2] =
    ["VUID-VkMemoryAllocateInfo-allocationSize-01742", "VUID-VkMemoryDedicatedAllocateInfo-buffer-01879"];

/// Fails if the validation layer has reported anything since the process began.
#[track_caller]
pub fn assert_silent() {
    assert_device_silent(&DEVICE);
}

/// Fails if the validation layer has reported anything about `device`.
#[track_caller]
pub fn assert_device_silent(device: &Device) {
    let of_an_earlier = |message: &String| {
        message.contains("<VkImportMemoryFdInfoKHR>.fd (")
            && OF_AN_EARLIER_DESCRIPTOR.iter().any(|id| message.contains(id))
    };
    let messages: Vec<_> =
        device.validation_messages().into_iter().filter(|message| !of_an_earlier(message)).collect();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}
