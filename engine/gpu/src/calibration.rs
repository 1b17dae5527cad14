//! The device's clock on the host's: both read at one instant (`VK_EXT_calibrated_timestamps`).

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use ash::{ext, vk};
use std::time::{Duration, Instant};

/// A time stamp of the device and the host's time at that instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Calibration {
    /// Time stamp of the device, raw.
    pub stamp: u64,
    /// The host's time.
    pub host: Instant,
    /// Upper bound of the time between the two readings.
    pub deviation: Duration,
}

impl Device {
    /// Reads both clocks; `None` if the device cannot read them together.
    pub fn calibrate(&self) -> Result<Option<Calibration>, EngineError> {
        let Some(calibrated) = self.calibrated() else { return Ok(None) };
        let infos = [vk::CalibratedTimestampInfoEXT::default().time_domain(vk::TimeDomainEXT::DEVICE)];
        let before = Instant::now();
        // SAFETY: the device is alive and has the extension; every device that has it has this domain.
        let (stamps, deviation_ns) =
            unsafe { calibrated.get_calibrated_timestamps(&infos) }.call("vkGetCalibratedTimestampsEXT")?;
        let half = before.elapsed() / 2;
        let deviation = half + Duration::from_nanos(deviation_ns);
        Ok(Some(Calibration { stamp: stamps[0], host: before + half, deviation }))
    }

    /// The host's time of a raw time stamp that is older than the calibration; `None` if the host's clock cannot
    /// represent it.
    #[must_use]
    pub fn host_time(&self, calibration: &Calibration, stamp: u64) -> Option<Instant> {
        let ago = Duration::from_nanos(self.timestamp_span_ns(stamp, calibration.stamp));
        calibration.host.checked_sub(ago)
    }
}

/// The extension's functions, where the device has them.
pub(crate) fn functions(
    instance: &ash::Instance,
    device: &ash::Device,
    has: bool,
) -> Option<ext::calibrated_timestamps::Device> {
    has.then(|| ext::calibrated_timestamps::Device::new(instance, device))
}
