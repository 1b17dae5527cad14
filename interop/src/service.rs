//! A rig fed by producers in other processes.

use crate::error::InteropError;
use crate::server::{CameraTerms, LinkCounts, Outcome, Ready, Server, ServerOptions};
use esaac_engine::{Around, FrameInput, Rig, Tick, zone};
use esaac_model::MAX_INTERVAL_NS;
use std::time::Duration;

/// What one tick gave, and which cameras had a frame in it.
pub struct ServiceTick<'a> {
    /// The engine's.
    pub tick: Tick<'a>,
    /// Time of each camera's frame.
    pub t_ns: Vec<Option<i64>>,
    /// Whether the frame was a camera's first, or first after a break: it ends no interval.
    pub first: Vec<bool>,
}

/// Steps a rig with the frames that a server hands over.
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

    /// Opens a server for a rig at `path`: `slots` a camera, and each camera's choice for frames that come
    /// faster than they are stepped.
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

    /// How often a camera started anew: another producer, or a gap in time that dropped frames have left.
    #[must_use]
    pub fn resets(&self) -> u64 {
        self.resets
    }

    /// Steps the cameras whose frames are there; `None` if none came within `limit`.
    pub fn tick(&mut self, limit: Duration) -> Result<Option<ServiceTick<'_>>, InteropError> {
        self.tick_checked(limit, |_| {})
    }

    /// As [`Service::tick`], with a look at each frame before it is stepped.
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

    /// Takes note of frames that are there: which are a camera's first, or its first after a break.
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

/// Steps a rig with frames that are there: takes their buffers over, waits for their timelines on the
/// device too, and signals that they are read.
fn step<'a>(
    rig: &'a mut Rig,
    ready: &[Ready],
    frames: &[Option<FrameInput<'_>>],
) -> Result<Tick<'a>, InteropError> {
    let before: Vec<_> = ready.iter().map(|frame| frame.slot().acquire()).collect();
    let after: Vec<_> = ready.iter().map(|frame| frame.slot().release()).collect();
    let waits: Vec<_> =
        ready.iter().map(|frame| (frame.slot().timeline().timeline(), frame.value())).collect();
    let signals: Vec<_> =
        ready.iter().map(|frame| (frame.slot().timeline().timeline(), frame.value() + 1)).collect();
    let around = Around { before: &before, after: &after, waits: &waits, signals: &signals };
    Ok(rig.step_frames(frames, &around)?)
}
