//! Stepping: frames and their times in, a tick out.

use super::{CameraState, FrameInput, InputBuffers, Rig, StageSpan, Tick, record};
use crate::commands::{Around, Commands};
use crate::error::EngineError;
use crate::memory::Buffer;
use crate::profile;
use esaac_model::{FrameError, frame};
use std::time::{Duration, Instant};

impl Rig {
    /// Steps every camera to its frame's time with what its input buffers hold, and waits.
    pub fn step(&mut self, t_ns: &[i64]) -> Result<Tick<'_>, EngineError> {
        let times: Vec<Option<i64>> = t_ns.iter().copied().map(Some).collect();
        self.step_some(&times)
    }

    /// As [`Rig::step`], for the cameras that have a new frame.
    pub fn step_some(&mut self, t_ns: &[Option<i64>]) -> Result<Tick<'_>, EngineError> {
        let frames: Vec<_> =
            t_ns.iter().map(|t_ns| t_ns.map(|t_ns| FrameInput { t_ns, inputs: None })).collect();
        self.step_frames(&frames, &Around::default())
    }

    /// As [`Rig::step`], with the frames of all cameras, which are of one size, one after the other in
    /// one buffer an image: what a tiled renderer draws.
    pub fn step_tiles(
        &mut self,
        t_ns: &[i64],
        tiles: InputBuffers<'_>,
        around: &Around<'_>,
    ) -> Result<Tick<'_>, EngineError> {
        if t_ns.len() != self.cameras.len() {
            return Err(FrameError::Count { expected: self.cameras.len(), actual: t_ns.len() }.into());
        }
        for (number, camera) in self.cameras.iter_mut().enumerate() {
            frame::check_time(number as u32, camera.last_ns, t_ns[number])?;
            camera.inputs = camera.addresses(number, Some(tiles), number)?;
        }
        let t_ns: Vec<Option<i64>> = t_ns.iter().copied().map(Some).collect();
        self.tick(&t_ns, around)
    }

    /// As [`Rig::step_some`], with frames read where they lie, and commands and timelines around the
    /// submission that reads them. The buffers are read before this returns, and not after.
    pub fn step_frames(
        &mut self,
        frames: &[Option<FrameInput<'_>>],
        around: &Around<'_>,
    ) -> Result<Tick<'_>, EngineError> {
        if frames.len() != self.cameras.len() {
            return Err(FrameError::Count { expected: self.cameras.len(), actual: frames.len() }.into());
        }
        for (number, (camera, frame)) in self.cameras.iter_mut().zip(frames).enumerate() {
            if let Some(frame) = frame {
                frame::check_time(number as u32, camera.last_ns, frame.t_ns)?;
                camera.inputs = camera.addresses(number, frame.inputs, 0)?;
            }
        }
        let t_ns: Vec<Option<i64>> = frames.iter().map(|frame| frame.map(|f| f.t_ns)).collect();
        self.tick(&t_ns, around)
    }

    /// Steps the cameras that have a time, whose frames are at their addresses.
    fn tick(&mut self, t_ns: &[Option<i64>], around: &Around<'_>) -> Result<Tick<'_>, EngineError> {
        self.prepare(t_ns)?;
        let started = Instant::now();
        self.submit(&self.commands, around)?;
        let stamped = self.stamped();
        self.timer.read(&mut self.stage_ns[..stamped])?;
        self.gpu_zones.show(&self.device, &self.timer, &self.stage_ns[..stamped])?;
        if let Some(("again", ns)) = self.stage_ns.last_mut() {
            *ns = 0;
        }
        self.collect(t_ns)?;
        self.submit_to_packet_ns = started.elapsed().as_nanos() as u64;
        profile::tick(&self.events, &self.packets, self.submit_to_packet_ns, || self.memory());
        Ok(Tick::of(self))
    }

    /// Spans with a time stamp at each end.
    fn stamped(&self) -> usize {
        if self.options.stage_times { record::STAGES.len() } else { 1 }
    }

    /// When each stage of the last tick ran on the device, by the host's clock, and how far that may be off;
    /// `None` where the device does not tell both clocks at once. Only before the next tick.
    pub fn stage_host_times(&self) -> Result<Option<(Vec<StageSpan>, Duration)>, EngineError> {
        let Some(calibration) = self.device.calibrate()? else { return Ok(None) };
        let stamped = self.stamped();
        let mut raw = [0_u64; 16];
        self.timer.read_raw(0, &mut raw[..stamped + 1])?;
        let at = |stamp| self.device.host_time(&calibration, stamp);
        let spans = self.stage_ns[..stamped].iter().zip(raw.windows(2)).filter_map(|(&(stage, _), pair)| {
            Some(StageSpan { stage, start: at(pair[0])?, end: at(pair[1])? })
        });
        Ok(Some((spans.collect(), calibration.deviation)))
    }

    pub(super) fn submit(&self, commands: &Commands, around: &Around<'_>) -> Result<(), EngineError> {
        {
            let _zone = zone!("submit");
            self.device.submit(commands.raw(), around, self.fence.raw())?;
        }
        let _zone = zone!("wait");
        self.fence.wait()
    }
}

impl CameraState {
    /// Where the kernels find a frame: its buffers hold whole images, of which it is the one after
    /// `images_before`.
    fn addresses(
        &self,
        number: usize,
        inputs: Option<InputBuffers<'_>>,
        images_before: usize,
    ) -> Result<[u64; 2], EngineError> {
        let inputs = inputs.unwrap_or(InputBuffers { hdr: &self.hdr, motion: self.motion.as_ref() });
        let sensor = &self.config.sensor;
        let holds = |image, buffer: Option<&Buffer>, texel_bytes: usize| {
            let needed = sensor.pixels() * texel_bytes;
            let before = images_before * needed;
            let actual = (buffer.map_or(0, Buffer::bytes) as usize).saturating_sub(before);
            let size = (sensor.width, sensor.height);
            // A buffer may be longer than its image.
            frame::check_size(number as u32, image, size, texel_bytes, actual.min(needed))?;
            Ok::<u64, EngineError>(buffer.map_or(0, Buffer::address) + before as u64)
        };
        let hdr = holds("hdr", Some(inputs.hdr), self.config.hdr.texel_bytes())?;
        let motion = match self.config.motion {
            Some(format) => holds("motion", inputs.motion, format.texel_bytes())?,
            None => 0,
        };
        Ok([hdr, motion])
    }
}
