//! Stepping a rig: from frames and their times to a tick. [`super::submit`] has the first half.

use super::geometry;
use super::machine::{self, Merge, Retry, TickDevice, TickEnd};
use super::passes::rows_used;
use super::queue::Load;
use super::rest::RestLoad;
use super::sensor::has_bus;
use super::submit::Submitted;
use super::timing::MOST_STAMPS;
use super::transfer::{Write, Writes};
use super::{CameraState, FrameInput, InputBuffers, Rig, StageSpan, Tick};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use crate::policy::KernelPolicy;
use crate::profile;
use esaac_layout::{self as layout, Counters};
use std::time::Duration;

/// Bins grow if more than one event in this many of a packet overflows, or more than half of what `sort` searches.
const OVERFLOW_SHARE: u32 = 8;

impl Rig {
    /// Steps every camera to its frame's time (nanoseconds) with the frame in its input buffers, and waits.
    ///
    /// A step is refused if its input is wrong, if there is no memory, or if the queue does not take it. Then nothing
    /// has happened, there are no packets, and the same step may be tried again. If a step fails after the device has
    /// begun it, the rig is lost: the error is [`EngineError::Lost`], and further steps give the same error.
    ///
    /// [`Rig::submit_frames`] and [`Rig::wait`] are its two halves, for a caller that has something else to do meanwhile.
    pub fn step(&mut self, t_ns: &[i64]) -> Result<Tick<'_>, EngineError> {
        let times: Vec<Option<i64>> = t_ns.iter().copied().map(Some).collect();
        self.step_some(&times)
    }

    /// As [`Rig::step`], for the cameras that have a time; `None` for a camera without a new frame.
    pub fn step_some(&mut self, t_ns: &[Option<i64>]) -> Result<Tick<'_>, EngineError> {
        let frames: Vec<_> =
            t_ns.iter().map(|t_ns| t_ns.map(|t_ns| FrameInput { t_ns, inputs: None })).collect();
        self.step_frames(&frames, &SubmitHooks::default())
    }

    /// As [`Rig::step_some`], with the output of a tiled renderer: the images of all cameras, which are of one size,
    /// lie one after the other in one buffer for colour, one for motion and so on.
    pub fn step_tiles(
        &mut self,
        t_ns: &[Option<i64>],
        tiles: InputBuffers<'_>,
        hooks: &SubmitHooks<'_>,
    ) -> Result<Tick<'_>, EngineError> {
        self.submit_tiles(t_ns, tiles, hooks)?;
        self.wait()
    }

    /// As [`Rig::step_some`], with frames in buffers of the caller, and with commands and timelines around the
    /// submission that reads them. The device has finished reading the buffers when this returns, unless the rig is
    /// lost; then the buffers are kept until the device has finished.
    pub fn step_frames(
        &mut self,
        frames: &[Option<FrameInput<'_>>],
        hooks: &SubmitHooks<'_>,
    ) -> Result<Tick<'_>, EngineError> {
        self.submit_frames(frames, hooks)?;
        self.wait()
    }

    /// Waits for the step that was submitted, and gives its packets: the second half of a step. It runs what is left of
    /// the step: once more what did not fit, and the sorting of heavy packets. Errors: no step was submitted
    /// ([`EngineError::NotSubmitted`]), or it has failed and the rig is lost ([`EngineError::Lost`]).
    pub fn wait(&mut self) -> Result<Tick<'_>, EngineError> {
        self.check_lost()?;
        let submitted = self.submitted.take().ok_or(EngineError::NotSubmitted)?;
        let Submitted { t_ns, started, .. } = &submitted;
        let in_tick = t_ns.iter().map(Option::is_some).collect();
        let end = match machine::finish(&mut RigTick { rig: self, submitted: &submitted }, in_tick) {
            Ok(end) => end,
            Err(error) => {
                self.results.clear();
                return Err(self.lose(error));
            }
        };
        {
            let _zone = zone!("publish");
            self.take(t_ns, &end);
        }
        self.grow_bins(&end);
        let most_per_px = self.pipelines.policy.most_queue_per_px;
        let length = self.queue.per_px();
        let load = Load::of(&self.cameras, &end);
        self.queue.follow(load, most_per_px);
        let length_changes = self.queue.per_px() != length;
        self.second_run.follow(load, end.most_crowded, length_changes);
        self.density.follow(load);
        let words = u64::from(layout::LEVEL_ROW_WORDS * layout::BINDINGS[layout::LEVELS].stride);
        let rows = self.arena.buffer(layout::LEVELS).bytes() / words;
        if let Some(used) = rows_used(&end) {
            self.passes.follow(used, rows);
        }
        let KernelPolicy { resting, rest_together, .. } = self.pipelines.policy;
        self.rest.follow(RestLoad::of(&self.cameras, &end, rest_together), resting);
        self.results.submit_to_packet_ns = started.elapsed().as_nanos() as u64;
        self.cameras.iter_mut().for_each(|camera| camera.has_paths = true);
        let results = &self.results;
        profile::tick(&results.events, &results.packets, results.submit_to_packet_ns, || self.memory());
        Ok(Tick::of(self))
    }

    /// Stores the results of a finished tick, and advances the cameras.
    fn take(&mut self, t_ns: &[Option<i64>], end: &TickEnd) {
        for (number, (counters, t_ns)) in end.counters.iter().zip(t_ns).enumerate() {
            let (Some(counters), Some(t_ns)) = (counters, t_ns) else { continue };
            let counters = match &end.outlets[number] {
                None => *counters,
                Some(outlet) => behind_bus(counters, outlet),
            };
            self.cameras[number].sends_from_outlet = end.outlets[number].is_some();
            self.results.take(number, &self.cameras[number], *t_ns, &counters, end.regrown[number]);
        }
        self.results.copy_out(self.options.packets, &self.cameras, &self.arena);
        let rests = self.rest.rests();
        for (camera, (counters, t_ns)) in self.cameras.iter_mut().zip(end.counters.iter().zip(t_ns)) {
            let (Some(counters), Some(t_ns)) = (counters, t_ns) else { continue };
            camera.advance(*t_ns, counters, rests);
        }
    }

    /// Takes more bins for cameras whose bins were crowded, or makes those larger whose packets overflowed much. If there is
    /// no memory, the bins stay as they are. If the device does not finish the copies, this tick's packets are valid, but
    /// the rig is lost.
    fn grow_bins(&mut self, end: &TickEnd) {
        let all = end.counters.iter().chain(&end.outlets).enumerate();
        let counted = || all.clone().filter_map(|(number, counters)| Some((number, counters.as_ref()?)));
        // An outlet has as many bins as its camera.
        let camera_of = |number: usize| number % self.cameras.len();
        let is_crowded = |number, counters: &Counters| {
            self.cameras[camera_of(number)].place.is_crowded(counters.largest_bin, counters.packet)
        };
        if !counted().any(|(number, counters)| is_crowded(number, counters) || overflowed_much(counters)) {
            return;
        }
        let before = self.places();
        let mut places = before.clone();
        for (number, counters) in counted() {
            if is_crowded(number, counters) {
                let camera = camera_of(number);
                places[camera] = before[camera].with_more_bins().with_bins_of(counters.largest_bin / 2);
            } else if overflowed_much(counters) {
                places[number] = places[number].with_bins_of(counters.largest_bin);
            }
        }
        // The bins may be as large as they get.
        if places == before {
            return;
        }
        geometry::follow_cameras(&mut places);
        let bin_counts: Vec<u32> = places[..self.cameras.len()].iter().map(|place| place.bin_count).collect();
        let Ok(planned) = self.arena.plan(&self.device, &before, places) else { return };
        if self.follow_bins(&bin_counts).is_err() {
            return;
        }
        let device = &self.device;
        let moved = device.run_once(|commands| self.arena.record_move(device, commands, &before, &planned));
        // Whether buffers have moved or not, kernels may have changed.
        self.recordings.unbind();
        match moved {
            Ok(()) => self.arena.commit(&mut self.cameras, planned),
            Err(error) if error.leaves_work() => {
                self.lose(error);
            }
            Err(_) => {}
        }
    }

    /// When each stage of the last tick ran on the device, by the host's clock, and the largest error of these times;
    /// `None` if there was no such tick (see [`Rig::last_tick`]), or the device has no times or cannot read both clocks
    /// at once. Call before the next tick.
    pub fn stage_host_times(&self) -> Result<Option<(Vec<StageSpan>, Duration)>, EngineError> {
        let spans = self.timing.spans();
        if self.results.stage_ns.is_empty() {
            return Ok(None);
        }
        let Some(calibration) = self.device.calibrate()? else { return Ok(None) };
        let Some(raw) = self.timing.timer.read_raw::<MOST_STAMPS>(0, spans.len() + 1)? else {
            return Ok(None);
        };
        let at = |stamp| self.device.host_time(&calibration, stamp);
        let spans = spans
            .iter()
            .zip(raw.windows(2))
            .filter_map(|(&stage, pair)| Some(StageSpan { stage, start: at(pair[0])?, end: at(pair[1])? }));
        Ok(Some((spans.collect(), calibration.deviation)))
    }
}

/// The counters of a camera, with those of its outlet for what comes after the bus.
fn behind_bus(camera: &Counters, outlet: &Counters) -> Counters {
    Counters {
        packet: outlet.packet,
        deferred: camera.deferred + outlet.waiting + outlet.deferred,
        lost: outlet.lost,
        capped: outlet.capped,
        ..*camera
    }
}

/// Whether more events of a camera's packet were beyond their bins than [`OVERFLOW_SHARE`] allows.
fn overflowed_much(counters: &Counters) -> bool {
    let many = (counters.packet / OVERFLOW_SHARE).min(layout::SEARCHED_EVENTS / 2);
    counters.overflow.saturating_sub(counters.deferred) > many
}

/// A rig in a tick, as the state machine sees it.
struct RigTick<'a> {
    rig: &'a mut Rig,
    submitted: &'a Submitted,
}

impl RigTick<'_> {
    /// The times of some of the tick's cameras.
    fn times_of(&self, cameras: impl Iterator<Item = usize>) -> Vec<Option<i64>> {
        let mut times_ns = vec![None; self.submitted.t_ns.len()];
        for camera in cameras {
            times_ns[camera] = self.submitted.t_ns[camera];
        }
        times_ns
    }
}

impl TickDevice for RigTick<'_> {
    fn wait(&mut self) -> Result<(), EngineError> {
        self.rig.timing.wait().inspect_err(|_| self.submitted.abandon())?;
        self.rig.timing.take_tick(&self.rig.device, &mut self.rig.results);
        Ok(())
    }

    fn counters(&self, camera: usize) -> Counters {
        let slot = self.rig.cameras[camera].place.slot as usize;
        self.rig.arena.buffer(layout::REPORT).read::<Counters>(slot, 1)[0]
    }

    fn retry(&mut self, retry: &Retry) -> Result<(), EngineError> {
        let rig = &mut *self.rig;
        if retry.grows() {
            let wanted = retry.wanted_events.iter();
            let mut places = rig.places();
            for (place, &wanted) in places.iter_mut().zip(wanted) {
                *place = place.with_events(wanted);
            }
            rig.change(places, Vec::new(), &[])?;
        }
        let resumed = retry.resumed.iter().map(|(camera, counters)| {
            let camera = &rig.cameras[*camera];
            let set = u64::from(2 * camera.place.slot + camera.frame_slot);
            let bytes = bytemuck::bytes_of(counters).to_vec();
            Write { slot: layout::COUNTERS, offset: set * size_of::<Counters>() as u64, bytes }
        });
        Writes::new(&rig.device, resumed.collect())?.run(&rig.device, &rig.arena)?;
        let times_ns = self.times_of(retry.resumed.iter().map(|(camera, _)| *camera));
        let rig = &mut *self.rig;
        rig.prepare_retry(&times_ns)?;
        let recording = &rig.recordings.ring[rig.arena.current()];
        rig.timing.submit(&rig.device, &recording.retry, &SubmitHooks::default())?;
        rig.timing.wait()?;
        rig.timing.add_retry(&mut rig.results);
        Ok(())
    }

    fn merge(&mut self, merge: &Merge) -> Result<(), EngineError> {
        let times_ns = self.times_of(merge.cameras.iter().copied());
        self.rig.merge(&times_ns, merge)
    }

    fn outlet(&self, camera: usize) -> Option<Counters> {
        let state = &self.rig.cameras[camera];
        let slot = state.outlet.slot as usize;
        has_bus(&state.config.sensor)
            .then(|| self.rig.arena.buffer(layout::REPORT).read::<Counters>(slot, 1)[0])
    }

    fn readout(&mut self, cameras: &[usize], is_first: bool) -> Result<(), EngineError> {
        let times_ns = self.times_of(cameras.iter().copied());
        self.rig.continue_readout(&times_ns, is_first)
    }
}

impl CameraState {
    /// Advances to the next interval, after a tick to time `t_ns` in which pixels rested that can (`rests`) or not.
    fn advance(&mut self, t_ns: i64, counters: &Counters, rests: bool) {
        self.may_be_unarmed = counters.unarmed_pixels > 0;
        let busy_blocks = self.place.blocks - counters.skipped_blocks.min(self.place.blocks);
        self.many_substeps = (counters.substeps + counters.substeps / 4) / busy_blocks.max(1);
        self.last_start_ns = self.last_ns.unwrap_or(t_ns);
        self.last_interval_ns = (t_ns - self.last_start_ns) as u32;
        self.longest_interval_ns = self.longest_interval_ns.max(self.last_interval_ns);
        match self.last_ns {
            None => self.epoch_ns = t_ns,
            Some(_) => {
                self.note_rest(rests, self.last_interval_ns);
                self.note_meetings(counters);
            }
        }
        self.complete_ns = Some(self.watermark_ns(t_ns));
        self.last_ns = Some(t_ns);
        self.deferred_events = counters.deferred;
        self.frame_slot = 1 - self.frame_slot;
        self.frames += 1;
        self.sequence += 1;
        self.changed = false;
        self.vectors_span = true;
    }
}
