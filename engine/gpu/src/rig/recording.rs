//! What a tick's commands were recorded for, and whether they serve again.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::density::dense_queue_per_px;
use super::permutation::{Permutation, permutation};
use super::record::{order, record_tick};
use super::{Recordings, Rig};
use crate::commands::Commands;
use crate::device::Device;
use crate::error::EngineError;
use crate::instance::Validation;
use std::sync::Arc;

/// The commands of a tick that writes one set of packet buffers.
pub(super) struct Recording {
    /// The whole tick.
    pub tick: Commands,
    /// The part of the tick that runs again when events did not fit.
    pub retry: Commands,
    /// Whether the set's descriptors name the current buffers.
    bound: bool,
    /// What each was recorded for; `None` if it must be recorded.
    tick_for: Option<RecordedFor>,
    retry_for: Option<RecordedFor>,
}

/// What recorded commands are good for.
#[derive(PartialEq)]
pub(super) struct RecordedFor {
    permutations: Vec<Permutation>,
    /// Passes of `synthesize` and `cross`.
    pub passes: u32,
    /// Workgroups of the second run of `cross` for each camera; 0 if there is no such run.
    pub second_run: u32,
    /// Whether they work out poses.
    pub poses: bool,
    /// Number of addresses that the device had told; 0 where the validation layer does not look at shaders.
    addresses: u64,
}

impl Recording {
    pub(super) fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        Ok(Recording {
            tick: Commands::new(device)?,
            retry: Commands::new(device)?,
            bound: false,
            tick_for: None,
            retry_for: None,
        })
    }

    /// Marks descriptors and commands as out of date, after buffers have changed.
    pub(super) fn unbind(&mut self) {
        self.bound = false;
        self.forget();
    }

    fn forget(&mut self) {
        self.tick_for = None;
        self.retry_for = None;
    }
}

impl Recordings {
    /// Marks all descriptors and commands as out of date, after buffers have changed.
    pub(super) fn unbind(&mut self) {
        self.ring.iter_mut().for_each(Recording::unbind);
    }

    /// Marks all commands as out of date, after pipelines have changed.
    pub(super) fn forget(&mut self) {
        self.ring.iter_mut().for_each(Recording::forget);
    }
}

impl Rig {
    /// Makes the descriptors of the current set name the current buffers.
    pub(super) fn bind_current(&mut self) {
        if !self.recording().bound {
            // SAFETY: no submission that uses the set is pending, or the rig would be lost. Commands recorded with it
            // are forgotten (`Recording::unbind`), or were recorded for one submission. Whoever replaces buffers
            // unbinds every set that names them.
            unsafe { self.pipelines.bindings.bind(self.arena.shown()) };
            self.recording().bound = true;
        }
    }

    fn recording(&mut self) -> &mut Recording {
        &mut self.recordings.ring[self.arena.current()]
    }

    /// What commands must be recorded for now. For its checks in shaders the validation layer notes which addresses are
    /// valid when commands are recorded, not when they are submitted. So such commands serve only until another buffer
    /// is made.
    pub(super) fn needed_recording(&self, whole: bool) -> RecordedFor {
        let addresses = if self.device.validation() == Validation::On { self.device.addresses() } else { 0 };
        let permutations = self.permutations();
        let policy = self.pipelines.policy;
        let runs_twice = whole && permutations.iter().any(|p| p.second_run(policy).is_some());
        let second_run = if runs_twice { self.second_run.groups() } else { 0 };
        let poses = whole && self.poses_by.device;
        RecordedFor { permutations, passes: self.passes(whole), second_run, poses, addresses }
    }

    /// The permutation of each camera.
    pub(super) fn permutations(&self) -> Vec<Permutation> {
        let (policy, texels) = (self.pipelines.policy, self.arena.shows_all_texels());
        let (queue_per_px, rests) = (self.queue.per_px(), self.rest.rests());
        let pixels = self.cameras.iter().map(|c| u64::from(c.place.pixels)).sum();
        let levels_first = self.density.levels_first(policy.levels_first);
        let dense_queue_per_px = levels_first.then(|| dense_queue_per_px(pixels));
        self.cameras
            .iter()
            .map(|c| permutation(c, self.options, policy, texels, queue_per_px, rests, dense_queue_per_px))
            .collect()
    }

    /// Records the whole tick, or (`whole` false) the part that runs again when events did not fit, unless commands of an
    /// earlier tick will do.
    pub(super) fn record(&mut self, needed: RecordedFor, whole: bool) -> Result<(), EngineError> {
        if self.recorded_for(whole).as_ref() == Some(&needed) {
            return Ok(());
        }
        let permutations = &needed.permutations;
        self.need_kernels(permutations, whole, needed.poses)?;
        if needed.second_run > 0 {
            self.need_second_run(permutations)?;
        }
        // If recording fails, the commands must not be taken for recorded.
        *self.recorded_for(whole) = None;
        let groups = self.groups(permutations, &order(permutations));
        record_tick(self, &groups, &needed, whole)?;
        *self.recorded_for(whole) = Some(needed);
        Ok(())
    }

    fn recorded_for(&mut self, whole: bool) -> &mut Option<RecordedFor> {
        let recording = self.recording();
        if whole { &mut recording.tick_for } else { &mut recording.retry_for }
    }
}
