//! A rig whose frames come from producers in other processes.

use crate::error::InteropError;
use crate::server::{CameraTerms, LinkCounts, Outcome, Ready, Server, ServerOptions};
use esaac_engine::{FrameInput, Rig, SubmitHooks, Tick, zone};
use esaac_model::MAX_INTERVAL_NS;
use std::time::Duration;

/// The result of one tick, and which cameras had a frame in it.
pub struct ServiceTick<'a> {
    /// The engine's.
    pub tick: Tick<'a>,
    /// Time of each camera's frame.
    pub t_ns: Vec<Option<i64>>,
    /// Whether the frame was a camera's first, or its first after a break. Such a frame gives no events.
    pub first: Vec<bool>,
}

/// Steps a rig with the frames that a server receives.
pub struct Service {
    rig: Rig,
    server: Server,
    last_ns: Vec<Option<i64>>,
    resets: u64,
}

impl Service {
    /// A rig and the server that was opened for its cameras.
    #[must_use]
    pub fn new(rig: Rig, server: Server) -> Self {
        Service { last_ns: vec![None; rig.len()], rig, server, resets: 0 }
    }

    /// Opens a server at `path` for a rig. `cameras` has the terms of each of its cameras.
    pub fn open(
        rig: Rig,
        path: &std::path::Path,
        cameras: &[CameraTerms],
        options: ServerOptions,
    ) -> Result<Self, InteropError> {
        let server = Server::open(rig.device(), path, cameras, options)?;
        Ok(Service::new(rig, server))
    }

    /// The rig.
    #[must_use]
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The rig, to change sensors between two ticks.
    pub fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }

    /// The server.
    #[must_use]
    pub fn server(&self) -> &Server {
        &self.server
    }

    /// What was counted for each camera's link.
    #[must_use]
    pub fn counts(&self) -> Vec<LinkCounts> {
        self.server.counts()
    }

    /// How often a camera started anew: for another producer, or after dropped frames had left a gap in time.
    #[must_use]
    pub fn resets(&self) -> u64 {
        self.resets
    }

    /// Steps the cameras whose frames are written. Returns `None` if no frame came within `limit`.
    pub fn tick(&mut self, limit: Duration) -> Result<Option<ServiceTick<'_>>, InteropError> {
        self.tick_checked(limit, |_| {})
    }

    /// As [`Service::tick`], and calls `look` for each frame before it is stepped.
    pub fn tick_checked(
        &mut self,
        limit: Duration,
        look: impl FnMut(&Ready),
    ) -> Result<Option<ServiceTick<'_>>, InteropError> {
        let ready = {
            let _zone = zone!("wait for frames");
            self.server.wait(limit)?
        };
        if ready.is_empty() {
            return Ok(None);
        }
        ready.iter().for_each(look);
        let first = self.ingest(&ready)?;
        let mut frames = vec![None; self.rig.len()];
        for frame in &ready {
            frames[frame.camera] = Some(FrameInput { t_ns: frame.t_ns, inputs: Some(frame.slot().inputs()) });
        }
        let t_ns = frames.iter().map(|frame| frame.map(|f| f.t_ns)).collect();
        let tick = step(&mut self.rig, &ready, &frames)?;
        let _zone = zone!("release");
        for frame in &ready {
            self.server.release(frame, Outcome::Stepped)?;
        }
        Ok(Some(ServiceTick { tick, t_ns, first }))
    }

    /// Resets the cameras that start anew, and returns for which cameras the frame is the first.
    fn ingest(&mut self, ready: &[Ready]) -> Result<Vec<bool>, InteropError> {
        let _zone = zone!("ingest");
        let mut first = vec![false; self.rig.len()];
        for frame in ready {
            let last_ns = &mut self.last_ns[frame.camera];
            let gap = |last: i64| frame.t_ns.saturating_sub(last) > MAX_INTERVAL_NS;
            if last_ns.is_some_and(|last| frame.first || gap(last)) {
                self.rig.reset(frame.camera)?;
                self.resets += 1;
                *last_ns = None;
            }
            first[frame.camera] = last_ns.is_none();
            *last_ns = Some(frame.t_ns);
        }
        Ok(first)
    }
}

/// Steps a rig with frames that are there: takes their buffers over and hands them back. The submission
/// neither waits for nor signals a timeline that a producer can set: the server has seen that the frames are
/// written, and signals that they are read once the device is done.
fn step<'a>(
    rig: &'a mut Rig,
    ready: &[Ready],
    frames: &[Option<FrameInput<'_>>],
) -> Result<Tick<'a>, InteropError> {
    let before: Vec<_> = ready.iter().map(|frame| frame.slot().acquire()).collect();
    let after: Vec<_> = ready.iter().map(|frame| frame.slot().release()).collect();
    let hooks = SubmitHooks { before: &before, after: &after, ..SubmitHooks::default() };
    Ok(rig.step_frames(frames, &hooks)?)
}
