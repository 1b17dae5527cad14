//! The waits and GPU times of a tick.

use super::record::STAMPS;
use super::results::Results;
use crate::commands::{Commands, SubmitHooks};
use crate::device::Device;
use crate::error::EngineError;
use crate::profile::GpuZones;
use crate::timing::{Fence, StageTimer};
use esaac_layout::{TICK_STAGES, TICK_STAGES_WITH_BUS};
use std::sync::Arc;

/// Most time stamps of a tick.
pub(super) const MOST_STAMPS: usize = STAMPS as usize;

/// The stages that run in passes, by their places among those of a tick.
const PASS_STAGES: std::ops::Range<usize> = 3..5;

/// The fence that a rig waits for, and its timer.
pub(super) struct Timing {
    pub timer: StageTimer,
    fence: Fence,
    gpu_zones: GpuZones,
    by_stage: bool,
    /// Whether the tick has a bus.
    pub with_bus: bool,
    /// Passes of `synthesize` and `cross`.
    pub passes: u32,
}

impl Timing {
    pub(super) fn new(device: &Arc<Device>, by_stage: bool) -> Result<Self, EngineError> {
        Ok(Timing {
            timer: StageTimer::new(device, STAMPS + 2)?,
            fence: Fence::new(device)?,
            gpu_zones: GpuZones::default(),
            by_stage,
            with_bus: false,
            passes: 1,
        })
    }

    /// Submits commands, which run until [`Timing::wait`]. After an error none of them run.
    pub(super) fn submit(
        &self,
        device: &Device,
        commands: &Commands,
        hooks: &SubmitHooks<'_>,
    ) -> Result<(), EngineError> {
        let _zone = zone!("submit");
        device.submit(commands.raw(), hooks, self.fence.raw())?;
        device.leave_running(self.fence.raw());
        Ok(())
    }

    /// Whether a wait for the last submission would return at once.
    pub(super) fn is_done(&self) -> bool {
        self.fence.is_done()
    }

    /// Waits for the last submission.
    pub(super) fn wait(&self) -> Result<(), EngineError> {
        let _zone = zone!("wait");
        self.fence.wait()
    }

    /// Names of the spans between time stamps, in order.
    pub(super) fn spans(&self) -> Vec<&'static str> {
        if !self.by_stage {
            return vec!["tick"];
        }
        let stages = if self.with_bus { TICK_STAGES_WITH_BUS } else { TICK_STAGES };
        let (before, from_passes) = stages.split_at(PASS_STAGES.start);
        let (of_pass, after) = from_passes.split_at(PASS_STAGES.len());
        [before, &of_pass.repeat(self.passes as usize), after].concat()
    }

    /// Stores the times of the tick's first submission. If they cannot be read, they are absent: that is no reason to
    /// lose a tick.
    pub(super) fn take_tick(&mut self, device: &Device, results: &mut Results) {
        let spans = self.spans();
        results.stage_ns.clear();
        let Ok(Some(raw)) = self.timer.read_raw::<MOST_STAMPS>(0, spans.len() + 1) else { return };
        for (stage, pair) in spans.iter().zip(raw.windows(2)) {
            let span_ns = device.timestamp_span_ns(pair[0], pair[1]);
            match results.stage_ns.iter_mut().find(|(known, _)| known == stage) {
                Some((_, sum_ns)) => *sum_ns += span_ns,
                None => results.stage_ns.push((stage, span_ns)),
            }
        }
        self.gpu_zones.show(device, &raw[..spans.len() + 1], &spans);
        if self.by_stage {
            results.stage_ns.push(("retry", 0));
        }
    }

    /// Adds the time of a submission that follows the tick's first.
    pub(super) fn add_retry(&self, results: &mut Results) {
        match (self.timer.span_ns(STAMPS), results.stage_ns.last_mut()) {
            (Ok(Some(retry_ns)), Some(last)) => last.1 += retry_ns,
            _ => results.stage_ns.clear(),
        }
    }
}
