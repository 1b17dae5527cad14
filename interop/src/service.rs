//! A rig whose frames come from producers in other processes.

use crate::error::InteropError;
use crate::server::{CameraTerms, LinkCounts, Outcome, Ready, Server, ServerOptions};
use crate::session::Agreement;
use crate::stand_in::StandIn;
use esaac_engine::{EngineError, FrameInput, Rig, SubmitHooks, Tick, zone};
use esaac_model::{MAX_INTERVAL_NS, Synthesis};
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

/// What a service first warned of each kind about a camera's frames. All its warnings are among [`Server::notices`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct InputWarnings {
    /// Depth and poses that do not predict the motion vectors.
    pub poses: Option<String>,
    /// Pixels that cannot be used.
    pub frame: Option<String>,
    /// Pixels without a path though there is depth.
    pub paths: Option<String>,
    /// Dropped frames that left a gap in time for which the camera started anew.
    pub gap: Option<String>,
    /// A producer by whose frames the camera has another synthesis than by those of the one before.
    pub synthesis: Option<String>,
}

impl InputWarnings {
    /// All there are.
    pub fn texts(&self) -> impl Iterator<Item = &String> {
        let InputWarnings { poses, frame, paths, gap, synthesis } = self;
        [poses, frame, paths, gap, synthesis].into_iter().flatten()
    }
}

/// Steps a rig with the frames that a server receives.
pub struct Service {
    rig: Rig,
    server: Server,
    last_ns: Vec<Option<i64>>,
    /// Whether frames of a camera were lost to a step that failed: the next one does not follow its last.
    broken: Vec<bool>,
    /// Of each camera whose producer gives no depth though it takes some.
    stand_ins: Vec<Option<StandIn>>,
    /// By what each camera's last frame was simulated.
    stepped_by: Vec<Option<Synthesis>>,
    resets: u64,
    /// What was last said about each camera's poses.
    warnings: Vec<Option<String>>,
    /// Cameras that were told to have pixels that cannot be used, and pixels without a path, since they began.
    told: Vec<[bool; 2]>,
    first_warnings: Vec<InputWarnings>,
}

impl Service {
    /// A rig and the server that was opened for its cameras.
    #[must_use]
    pub fn new(rig: Rig, server: Server) -> Self {
        let stand_ins = (0..rig.len()).map(|_| None).collect();
        let (last_ns, warnings) = (vec![None; rig.len()], vec![None; rig.len()]);
        let (broken, stepped_by) = (vec![false; rig.len()], vec![None; rig.len()]);
        let told = vec![[false; 2]; rig.len()];
        let first_warnings = vec![InputWarnings::default(); rig.len()];
        Service {
            last_ns,
            broken,
            stand_ins,
            stepped_by,
            rig,
            server,
            resets: 0,
            warnings,
            told,
            first_warnings,
        }
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

    /// For each camera what to tell the user, if the depth and poses of its producer do not predict its motion vectors. It
    /// is among [`Server::notices`] too.
    #[must_use]
    pub fn pose_warnings(&self) -> &[Option<String>] {
        &self.warnings
    }

    /// For each camera what was first told about its frames, whichever producer they came from.
    #[must_use]
    pub fn input_warnings(&self) -> &[InputWarnings] {
        &self.first_warnings
    }

    /// How often a camera started anew: for another producer, or after dropped frames had left a gap in time.
    #[must_use]
    pub fn resets(&self) -> u64 {
        self.resets
    }

    /// The synthesis of each camera by what its producer gives, or its last one. A camera that takes depth and gets none
    /// is simulated by motion vectors, or without; so is one with synthesis `auto` whose poses do not predict its motion
    /// vectors.
    ///
    /// # Panics
    /// If the server has more cameras than the rig.
    #[must_use]
    pub fn synthesis(&self) -> Vec<Synthesis> {
        let agreements = self.server.agreements();
        let of = |(camera, agreed): (usize, &Option<Agreement>)| {
            let lacks = agreed.is_some_and(|agreed| !agreed.geometry);
            self.synthesis_with(camera, !lacks).expect("the server was opened for this rig")
        };
        agreements.iter().enumerate().map(of).collect()
    }

    /// The synthesis of a camera whose producer gives depth, or does not though the camera may take some.
    fn synthesis_with(&self, camera: usize, gives_depth: bool) -> Result<Synthesis, EngineError> {
        let own = self.rig.synthesis(camera)?;
        if own == Synthesis::Rigid && !gives_depth {
            return Ok(Synthesis::Auto.resolve(false, self.server.images(camera).motion.is_some()));
        }
        Ok(own)
    }

    /// Ends all connections. Frames that have come and were not stepped count as abandoned.
    pub fn close(&self) {
        self.server.close();
    }

    /// Steps the cameras whose frames are written. Returns `None` if no frame came within `limit`.
    ///
    /// A producer whose poses the rig refuses is turned away; the others go on. If the step fails, its frames count as dropped,
    /// their producers have their slots back, and their cameras start anew.
    pub fn tick(&mut self, limit: Duration) -> Result<Option<ServiceTick<'_>>, InteropError> {
        self.tick_checked(limit, |_| {})
    }

    /// As [`Service::tick`], and calls `look` for each frame before it is stepped.
    pub fn tick_checked(
        &mut self,
        limit: Duration,
        look: impl FnMut(&Ready),
    ) -> Result<Option<ServiceTick<'_>>, InteropError> {
        let mut ready = {
            let _zone = zone!("wait for frames");
            self.server.wait(limit)?
        };
        if ready.is_empty() {
            return Ok(None);
        }
        ready.iter().for_each(look);
        let stepped = self.step_ready(&mut ready);
        let _zone = zone!("release");
        for frame in &ready {
            if stepped.is_ok() {
                self.server.release(frame, Outcome::Stepped);
                self.last_ns[frame.camera] = Some(frame.t_ns);
                let gives_depth = frame.slot().inputs().depth.is_some();
                self.warn_of_change(frame, gives_depth)?;
                self.warn_of_input(frame.camera, gives_depth)?;
            } else {
                self.server.release(frame, Outcome::Dropped);
                self.broken[frame.camera] = true;
            }
        }
        let (t_ns, first) = stepped?;
        Ok(Some(ServiceTick { tick: self.rig.last_tick(), t_ns, first }))
    }

    /// Steps the rig with frames, and returns each camera's time, and for which cameras the frame is the first. Takes frames
    /// whose producers were turned away out of `ready`.
    fn step_ready(&mut self, ready: &mut Vec<Ready>) -> Result<(Vec<Option<i64>>, Vec<bool>), InteropError> {
        let first = self.ingest(ready)?;
        let mut frames = vec![None; self.rig.len()];
        for frame in &*ready {
            let inputs = frame.slot().inputs();
            let inputs = match &self.stand_ins[frame.camera] {
                Some(stand_in) if inputs.depth.is_none() => stand_in.complete(inputs),
                _ => inputs,
            };
            frames[frame.camera] = Some(FrameInput { t_ns: frame.t_ns, inputs: Some(inputs) });
        }
        step(&mut self.rig, ready, &frames)?;
        let t_ns = frames.iter().map(|frame| frame.map(|frame| frame.t_ns)).collect();
        Ok((t_ns, first))
    }

    /// Says what is new about a camera's poses, and once that many of its pixels cannot be used, or have no path though it
    /// gives depth.
    fn warn_of_input(&mut self, camera: usize, gives_depth: bool) -> Result<(), InteropError> {
        let warning = self.rig.convention_warning(camera)?;
        let is_new = warning.is_some() && warning != self.warnings[camera];
        if let Some(text) = warning.as_ref().filter(|_| is_new) {
            self.server.say(format!("camera {camera}: warning: {text}"));
            self.first_warnings[camera].poses.get_or_insert_with(|| text.clone());
        }
        self.warnings[camera] = warning;
        let of_paths = if gives_depth { self.rig.path_warning(camera)? } else { None };
        for (kind, text) in [self.rig.frame_warning(camera)?, of_paths].into_iter().enumerate() {
            if let Some(text) = text.filter(|_| !self.told[camera][kind]) {
                self.server.say(format!("camera {camera}: warning: {text}"));
                self.told[camera][kind] = true;
                let first = &mut self.first_warnings[camera];
                [&mut first.frame, &mut first.paths][kind].get_or_insert(text);
            }
        }
        Ok(())
    }

    /// Says that a camera's new producer changes its synthesis.
    fn warn_of_change(&mut self, frame: &Ready, gives_depth: bool) -> Result<(), InteropError> {
        let camera = frame.camera;
        let now = self.synthesis_with(camera, gives_depth)?;
        let before = self.stepped_by[camera].replace(now).filter(|before| frame.first && *before != now);
        if let Some(before) = before {
            let text = format!(
                "from {} ns on it has another producer, by whose frames its synthesis is `{}`; it was `{}`",
                frame.t_ns,
                now.name(),
                before.name()
            );
            self.server.say(format!("camera {camera}: warning: {text}"));
            self.first_warnings[camera].synthesis.get_or_insert(text);
        }
        Ok(())
    }

    /// Says that a camera starts anew because of the frames that were dropped before its next one.
    fn warn_of_gap(&mut self, camera: usize, gap_ns: i64) {
        let text = format!(
            "dropped frames left a gap of {gap_ns} ns, expected at most {MAX_INTERVAL_NS} ns; the camera starts anew and \
             has no events of that time"
        );
        self.server.say(format!("camera {camera}: warning: {text}"));
        self.first_warnings[camera].gap.get_or_insert(text);
    }

    /// Resets the cameras that start anew and hands over poses. Returns for each camera whether it has a frame that is its
    /// first. A frame whose producer is turned away leaves `ready`: it is counted already, and nobody waits for its slot.
    fn ingest(&mut self, ready: &mut Vec<Ready>) -> Result<Vec<bool>, InteropError> {
        let _zone = zone!("ingest");
        let mut first = vec![false; self.rig.len()];
        let mut index = 0;
        while let Some(frame) = ready.get(index) {
            let camera = frame.camera;
            let gap = |last: i64| frame.t_ns.saturating_sub(last) > MAX_INTERVAL_NS;
            let was_broken = std::mem::take(&mut self.broken[camera]);
            let anew = frame.first || was_broken;
            if let Some(last) = self.last_ns[camera].filter(|&last| anew || gap(last)) {
                if !anew {
                    self.warn_of_gap(camera, frame.t_ns.saturating_sub(last));
                }
                self.rig.reset(camera)?;
                self.resets += 1;
                self.told[camera] = [false; 2];
                self.last_ns[camera] = None;
            }
            match self.hand_over_poses(frame) {
                Ok(()) => {
                    first[camera] = self.last_ns[camera].is_none();
                    index += 1;
                }
                Err(InteropError::Engine(error)) if !matches!(error, EngineError::Lost { .. }) => {
                    self.server.turn_away(&ready.remove(index), &InteropError::Engine(error));
                }
                Err(error) => return Err(error),
            }
        }
        Ok(first)
    }

    fn hand_over_poses(&mut self, frame: &Ready) -> Result<(), InteropError> {
        if let Some(scene) = &frame.scene {
            self.rig.set_scene(frame.camera, scene.motion.clone())?;
            if scene.from_ns != scene.vectors_to_ns {
                self.rig.skip_convention_check(frame.camera)?;
            }
        } else if let Some(stand_in) = self.stand_in(frame.camera)? {
            let scene = stand_in.scene();
            self.rig.set_scene(frame.camera, scene)?;
        }
        Ok(())
    }

    /// What stands in for the depth of a camera that takes some.
    fn stand_in(&mut self, camera: usize) -> Result<Option<&StandIn>, InteropError> {
        let stand_in = &mut self.stand_ins[camera];
        if stand_in.is_none() {
            *stand_in = StandIn::new(self.rig.device(), camera, self.server.images(camera))?;
        }
        Ok(stand_in.as_ref())
    }
}

/// Steps a rig with frames that are there: takes their buffers over and hands them back. The submission
/// neither waits for nor signals a timeline that a producer can set: the server has seen that the frames are
/// written, and signals that they are read once the device is done.
fn step(rig: &mut Rig, ready: &[Ready], frames: &[Option<FrameInput<'_>>]) -> Result<(), InteropError> {
    let before: Vec<_> = ready.iter().map(|frame| frame.slot().acquire()).collect();
    let after: Vec<_> = ready.iter().map(|frame| frame.slot().release()).collect();
    let hooks = SubmitHooks { before: &before, after: &after, ..SubmitHooks::default() };
    rig.step_frames(frames, &hooks)?;
    Ok(())
}
