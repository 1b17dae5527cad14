//! Zones, plots, messages and frame marks for the Tracy profiler. Without the feature `tracy` none of this code is in
//! the program; with it, nothing is sent until a profiler connects from this machine.

/// A zone of the calling thread, which ends when the returned value is dropped.
#[cfg(feature = "tracy")]
#[macro_export]
#[doc(hidden)]
macro_rules! zone {
    ($name:literal) => {
        $crate::profile::tracy_client::span!($name)
    };
}

/// A zone of the calling thread, which ends when the returned value is dropped.
#[cfg(not(feature = "tracy"))]
#[macro_export]
#[doc(hidden)]
macro_rules! zone {
    ($name:literal) => {
        $crate::profile::NoZone
    };
}

#[cfg(not(feature = "tracy"))]
pub use off::*;
#[cfg(feature = "tracy")]
pub use on::*;

#[cfg(not(feature = "tracy"))]
mod off {
    use crate::device::Device;
    use crate::memory::MemoryUse;
    use esaac_model::Packet;

    /// Stands for a zone; does nothing.
    pub struct NoZone;

    /// Stands for the zones of the device; does nothing.
    #[derive(Default)]
    pub struct GpuZones(());

    impl GpuZones {
        pub(crate) fn show(&mut self, _: &Device, _: &[u64], _: &[&'static str]) {}
    }

    pub(crate) fn tick(_: &[u32], _: &[Packet], _: u64, _: impl FnOnce() -> Vec<MemoryUse>) {}
}

#[cfg(feature = "tracy")]
mod on {
    use crate::device::Device;
    use crate::error::EngineError;
    use crate::memory::MemoryUse;
    use esaac_model::Packet;
    use std::time::{Duration, Instant};
    pub use tracy_client;
    use tracy_client::{Client, GpuContext, GpuContextType, plot};

    /// The two clocks drift apart by less than a microsecond in this time.
    const CALIBRATED_FOR: Duration = Duration::from_millis(100);

    /// The device's stages as zones on the host's clock.
    #[derive(Default)]
    pub struct GpuZones {
        context: Option<GpuContext>,
        calibrated: Option<Instant>,
    }

    impl GpuZones {
        /// Shows the stages of a finished tick, from the raw time stamps around them. Shows none if the device cannot
        /// read its clock together with the host's.
        pub(crate) fn show(&mut self, device: &Device, raw: &[u64], stages: &[&'static str]) {
            if !Client::is_connected() {
                return;
            }
            let Ok(Some(context)) = self.context(device) else { return };
            for (&stage, pair) in stages.iter().zip(raw.windows(2)) {
                // Fails only while 32767 zones wait for their times. These get theirs at once.
                if let Ok(mut span) = context.span_alloc(stage, stage, "glsl", 0) {
                    span.end_zone();
                    span.upload_timestamp_start(device.timestamp_ns(pair[0]));
                    span.upload_timestamp_end(device.timestamp_ns(pair[1]));
                }
            }
        }

        /// The device's context, its clock set by the host's; `None` if the device cannot read both clocks together.
        fn context(&mut self, device: &Device) -> Result<Option<GpuContext>, EngineError> {
            if self.context.is_some() && self.calibrated.is_some_and(|at| at.elapsed() < CALIBRATED_FOR) {
                return Ok(self.context.clone());
            }
            let Some(calibration) = device.calibrate()? else { return Ok(None) };
            let since_ns = calibration.host.elapsed().as_nanos() as i64;
            let now_ns = device.timestamp_ns(calibration.stamp) + since_ns;
            match &self.context {
                Some(context) => context.sync_gpu_time(now_ns),
                None => {
                    let name = Some(device.info().name.as_str());
                    self.context =
                        Client::start().new_gpu_context(name, GpuContextType::Vulkan, now_ns, 1.0).ok();
                }
            }
            self.calibrated = Some(Instant::now());
            Ok(self.context.clone())
        }
    }

    /// Ends a tick: a frame mark, plots, and a message if events were dropped.
    pub(crate) fn tick(
        events: &[u32],
        packets: &[Packet],
        latency_ns: u64,
        memory: impl FnOnce() -> Vec<MemoryUse>,
    ) {
        let client = Client::start();
        client.frame_mark();
        if !Client::is_connected() {
            return;
        }
        let dropped: u64 = packets.iter().map(|p| p.dropped).sum();
        plot!("events", events.iter().map(|&e| u64::from(e)).sum::<u64>() as f64);
        plot!("dropped events", dropped as f64);
        plot!("submit to packet, us", latency_ns as f64 * 1e-3);
        let bytes: u64 = memory().iter().filter(|m| !m.on_host).map(|m| m.bytes).sum();
        plot!("device memory, bytes", bytes as f64);
        if dropped > 0 {
            client.message(&format!("{dropped} events dropped"), 0);
        }
    }
}
