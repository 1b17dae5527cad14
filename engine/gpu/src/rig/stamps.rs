//! The clock of a camera's packets: up to when each is complete, and which time stamps that leaves to the next.

use super::CameraState;
use esaac_model::substeps::quantise_ns;

impl CameraState {
    /// Up to when the packets before that of a frame at `t_ns` were said to be complete. A first frame before that time
    /// begins a new clock.
    fn complete_before_ns(&self, t_ns: i64) -> Option<i64> {
        self.complete_ns.filter(|&complete_ns| complete_ns <= t_ns)
    }

    /// Up to when the packet of a frame at `t_ns` is complete. The next event is after that; its stamp may be floored to
    /// the start of the quantum that contains `t_ns + 1`, but not to what the packets before are complete up to.
    pub(super) fn watermark_ns(&self, t_ns: i64) -> i64 {
        let quantum_ns = i64::from(self.config.sensor.timestamp_quantum_ns);
        let watermark_ns = quantise_ns(t_ns + 1, quantum_ns) - 1;
        self.complete_before_ns(t_ns).map_or(watermark_ns, |complete_ns| complete_ns.max(watermark_ns))
    }

    /// Earliest time stamp in the packet of a frame at `t_ns`, from its base on.
    pub(super) fn first_stamp_ns(&self, base_ns: i64, t_ns: i64) -> u32 {
        self.complete_before_ns(t_ns).map_or(0, |complete_ns| (complete_ns + 1 - base_ns).max(0) as u32)
    }
}
