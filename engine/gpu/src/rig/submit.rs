//! The first half of a step: what is checked, prepared and submitted before anybody waits. [`Rig::wait`] is the second.

use super::look::Given;
use super::{Addresses, FrameInput, InputBuffers, Rig};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use crate::loan::Loan;
use esaac_model::{FrameError, frame};
use std::time::Instant;

/// A step that was submitted and that nobody has waited for.
pub(super) struct Submitted {
    /// Times of the cameras that take part.
    pub t_ns: Vec<Option<i64>>,
    pub started: Instant,
    loans: Vec<Loan>,
}

impl Submitted {
    /// Marks what was lent to the step as abandoned: the wait for it has failed.
    pub(super) fn abandon(&self) {
        self.loans.iter().for_each(Loan::abandon);
    }
}

impl Rig {
    /// The first half of [`Rig::step_frames`]: returns as soon as the device has the step. [`Rig::wait`] is the other
    /// half and gives the packets. Whatever the caller does in between, such as drawing the next frame, hides the time that the
    /// device takes.
    ///
    /// The rig remembers the step, as a queue does; there is no value to keep until the wait. So an application can keep
    /// its rig in a struct and submit in one call of its render loop and wait in the next. The price is that the compiler does
    /// not see what may be called in between. Until `wait`, every call that needs the cameras at rest is refused with
    /// [`EngineError::Submitted`] and changes nothing, also the next `submit_frames`: no step is lost or overtaken.
    ///
    /// The step orders itself by the timelines of `hooks` alone; the host signals nothing. It reads `frames`'
    /// buffers and uses the commands of `hooks` until `wait`, also if they are dropped before: their memory is freed
    /// after the step. [`Buffer::write`](crate::Buffer::write) panics for such a buffer, and such commands are refused.
    /// Who writes the buffers on the device waits for a timeline that `hooks` signals.
    ///
    /// Errors are those of a refused step: nothing has happened, no timeline is signalled, and the same step may be tried
    /// again. [`EngineError::Lost`] if the device is gone. Three kinds of frames are looked at on the host before they are
    /// submitted: those whose poses are checked against motion vectors, some of cameras with physical pixels, and some of
    /// those with layers. Then the call waits for the timelines of `hooks`, runs the commands before the step and reads a part
    /// of the frame back. If the step is refused after that, these commands have run, and run again with the next try.
    pub fn submit_frames(
        &mut self,
        frames: &[Option<FrameInput<'_>>],
        hooks: &SubmitHooks<'_>,
    ) -> Result<(), EngineError> {
        self.begin(frames.len())?;
        let mut inputs = Vec::new();
        for (number, (camera, frame)) in self.cameras.iter().zip(frames).enumerate() {
            inputs.push(match frame {
                Some(frame) => {
                    frame::check_time(number as u32, camera.last_ns, frame.t_ns)?;
                    camera.check_scene(number, frame.t_ns)?;
                    Some((frame.t_ns, camera.addresses(number, frame.inputs, 0)?))
                }
                None => None,
            });
        }
        let given = frames
            .iter()
            .map(|frame| frame.map(|FrameInput { t_ns, inputs }| Given { t_ns, inputs, images_before: 0 }));
        let given: Vec<_> = given.collect();
        let lent = frames.iter().flatten().filter_map(|frame| frame.inputs);
        self.submit_tick(&inputs, &given, lent, hooks)
    }

    /// The first half of [`Rig::step_tiles`], as [`Rig::submit_frames`] is of `step_frames`.
    pub fn submit_tiles(
        &mut self,
        t_ns: &[Option<i64>],
        tiles: InputBuffers<'_>,
        hooks: &SubmitHooks<'_>,
    ) -> Result<(), EngineError> {
        self.begin(t_ns.len())?;
        let mut inputs = Vec::new();
        for ((number, camera), t_ns) in self.cameras.iter().enumerate().zip(t_ns) {
            inputs.push(match *t_ns {
                Some(t_ns) => {
                    frame::check_time(number as u32, camera.last_ns, t_ns)?;
                    camera.check_scene(number, t_ns)?;
                    Some((t_ns, camera.addresses(number, Some(tiles), number)?))
                }
                None => None,
            });
        }
        let given = t_ns.iter().enumerate().map(|(number, t_ns)| {
            t_ns.map(|t_ns| Given { t_ns, inputs: Some(tiles), images_before: number })
        });
        let given: Vec<_> = given.collect();
        self.submit_tick(&inputs, &given, std::iter::once(tiles), hooks)
    }

    /// Whether a step was submitted and the device is through with it, or lost. [`Rig::wait`] then does not wait for the
    /// device, unless events did not fit or a packet is heavy: the rest of such a step runs in `wait`. Never blocks.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.submitted.is_some() && self.timing.is_done()
    }

    /// Begins a step with frames of this number of cameras: from here on there is no last tick, also if the step is refused.
    fn begin(&mut self, actual: usize) -> Result<(), EngineError> {
        self.check_ready()?;
        self.results.clear();
        let expected = self.cameras.len();
        if actual == expected { Ok(()) } else { Err(FrameError::Count { expected, actual }.into()) }
    }

    /// Submits a step of the cameras that have a frame. `lent` are the buffers of callers that it reads.
    fn submit_tick<'a>(
        &mut self,
        frames: &[Option<(i64, Addresses)>],
        given: &[Option<Given<'_>>],
        lent: impl Iterator<Item = InputBuffers<'a>>,
        hooks: &SubmitHooks<'_>,
    ) -> Result<(), EngineError> {
        // Commands that are refused are so before the first look runs some of them.
        hooks.check(&self.device).map_err(|error| self.refused(error))?;
        let mut left = *hooks;
        self.check_conventions(given, &mut left)?;
        self.look_at_light(given, &mut left)?;
        self.look_for_meetings(given, &mut left)?;
        for (camera, frame) in self.cameras.iter_mut().zip(frames) {
            if let Some((_, addresses)) = frame {
                camera.inputs = *addresses;
            }
        }
        let t_ns: Vec<Option<i64>> = frames.iter().map(|frame| frame.map(|(t_ns, _)| t_ns)).collect();
        self.forget_paths();
        self.end_rest()?;
        self.make_room_for_layers()?;
        self.next_packet_set()?;
        self.prepare(&t_ns)?;
        let started = Instant::now();
        let Rig { device, timing, recordings, arena, .. } = self;
        if let Err(error) = timing.submit(device, &recordings.ring[arena.current()].tick, &left) {
            return Err(self.refused(error));
        }
        let loans = lent.flat_map(InputBuffers::lend).chain(hooks.lend()).collect();
        self.submitted = Some(Submitted { t_ns, started, loans });
        // Freed while the device works.
        self.past_scenes.clear();
        Ok(())
    }

    /// The error of a submission that was not taken. A device that is gone has lost the cameras' state.
    fn refused(&mut self, error: EngineError) -> EngineError {
        if error.is_device_lost() { self.lose(error) } else { error }
    }

    /// Advances to a packet set that nobody holds.
    fn next_packet_set(&mut self) -> Result<(), EngineError> {
        let is_new = self.arena.next_packet_set(&self.device)?;
        let current = self.arena.current();
        self.pipelines.bindings.select(current);
        if is_new {
            self.recordings.ring[current].unbind();
        }
        Ok(())
    }
}
