//! The check of poses against motion vectors, in the first intervals of a camera that gets both.
//!
//! A few rows of the images are read back before the tick that uses them, so that no event follows a pose that is
//! doubted. With synthesis `auto` the instances of doubted poses then have none, and their pixels follow their motion
//! vectors; the equations are in the model crate's `paths::conventions`.

use super::look::{Given, parts_of_rows, spread_rows};
use super::sensor::is_rigid;
use super::transfer::Part;
use super::{CameraState, Rig};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use crate::memory::Buffer;
use esaac_model::input::{InvalidInput, WithoutPath};
use esaac_model::paths::conventions::{ConventionReport, KeyFrame, Trust};
use esaac_model::{IdFormat, MotionFormat, Synthesis};

/// Most rows of an image that are compared, evenly spread.
const ROWS: u32 = 48;

impl Rig {
    /// What a camera's brightness between two frames is made by: `motion` if its synthesis is `auto` and its poses do
    /// not predict its motion vectors; else that of its sensor.
    pub fn synthesis(&self, camera: usize) -> Result<Synthesis, EngineError> {
        let state = self.camera(camera)?;
        let doubted = is_rigid(&state.config.sensor) && *state.trust() == Trust::Nothing;
        Ok(if doubted { Synthesis::Motion } else { state.config.sensor.synthesis })
    }

    /// How a camera's depth and poses predict its motion vectors, as far as its first intervals tell; `None` if nothing
    /// could be compared.
    pub fn convention_report(&self, camera: usize) -> Result<Option<&ConventionReport>, EngineError> {
        Ok(self.camera(camera)?.check.report())
    }

    /// What to tell the user, if a camera's depth and poses do not predict its motion vectors: by how much, why, and
    /// what follows.
    pub fn convention_warning(&self, camera: usize) -> Result<Option<String>, EngineError> {
        let state = self.camera(camera)?;
        let report = state.check.report().filter(|report| !report.agrees());
        let disagreement = report.and_then(|report| Some((report, report.disagreement()?)));
        Ok(disagreement.map(|(report, text)| match state.asked {
            Synthesis::Auto => format!("{text}; synthesis auto: {}", report.consequence(state.trust())),
            _ => format!("{text}; the poses are followed, as synthesis rigid was asked for"),
        }))
    }

    /// What to tell the user, if so many pixels of a camera's last frame have no exact path that it looks like a mistake, or
    /// if the poses of its first intervals are too far apart to tell how it turns between them.
    pub fn path_warning(&self, camera: usize) -> Result<Option<String>, EngineError> {
        let CameraState { config, spacing, .. } = self.camera(camera)?;
        let found = self.results.diagnostics[camera];
        let pixels = config.sensor.pixels() as u64;
        let without = WithoutPath { pixels, depth: found.without_depth, poses: found.without_poses };
        Ok(without.warning(config.motion.is_some()).or_else(|| spacing.warning()))
    }

    /// What to tell the user, if so many pixels of a camera's last frame have a colour, or a motion vector that its
    /// synthesis would follow, that cannot be used that it looks like a mistake. A first frame's vectors lead nowhere.
    pub fn frame_warning(&self, camera: usize) -> Result<Option<String>, EngineError> {
        let follows = self.synthesis(camera)?.needs_motion();
        let state = self.camera(camera)?;
        let found = self.results.diagnostics[camera];
        let motion = if follows && state.frames > 1 { found.invalid_motion } else { 0 };
        let pixels = state.config.sensor.pixels() as u64;
        Ok(InvalidInput { pixels, colour: found.invalid_pixels, motion }.warning())
    }

    /// The motion vectors of a camera's next frame do not lead to its last one, as after frames that were dropped: they
    /// are not compared with its poses.
    pub fn skip_convention_check(&mut self, camera: usize) -> Result<(), EngineError> {
        self.check_ready()?;
        self.camera(camera)?;
        self.cameras[camera].vectors_span = false;
        Ok(())
    }

    /// Compares the vectors of a tick's frames with their poses, while that tells something new.
    pub(super) fn check_conventions(
        &mut self,
        frames: &[Option<Given<'_>>],
        hooks: &mut SubmitHooks<'_>,
    ) -> Result<(), EngineError> {
        let take = |camera: &mut CameraState, given: &Given<'_>, bytes: &mut &[u8]| {
            camera.compare(given.t_ns, bytes)
        };
        self.look_at_frames(frames, hooks, CameraState::compared_parts, take)
    }
}

impl CameraState {
    /// Whether its next frame is compared: its check is not over, and there is something to compare.
    fn compares(&self) -> bool {
        let has_both = is_rigid(&self.config.sensor) && self.config.motion.is_some() && self.scene.is_some();
        has_both && self.last_ns.is_some() && self.vectors_span && !self.check.is_over()
    }

    fn compared_rows(&self) -> Vec<u32> {
        spread_rows(self.config.sensor.height, ROWS).collect()
    }

    /// The rows of each image that are compared: depth, motion, ids; none if nothing is.
    fn compared_parts<'a>(&'a self, given: &Given<'a>) -> Vec<Part<'a>> {
        if !self.compares() {
            return Vec::new();
        }
        let inputs = given.inputs.unwrap_or_else(|| self.input_buffers());
        let geometry = self.config.geometry;
        let planes = [
            (inputs.depth, geometry.map(|geometry| geometry.depth.texel_bytes())),
            (inputs.motion, self.config.motion.map(MotionFormat::texel_bytes)),
            (inputs.ids, geometry.and_then(|geometry| geometry.ids).map(IdFormat::texel_bytes)),
        ];
        let (sensor, rows) = (&self.config.sensor, self.compared_rows());
        let image =
            |(buffer, texel_bytes): (Option<&'a Buffer>, Option<usize>)| Some((buffer?, texel_bytes?));
        let rows_of = |(buffer, texel_bytes): (&'a Buffer, usize)| {
            parts_of_rows(sensor, given, buffer, texel_bytes, rows.iter().copied())
        };
        planes.into_iter().filter_map(image).flat_map(rows_of).collect()
    }

    /// The poses that are followed: all, unless `auto` has doubts.
    pub(super) fn trust(&self) -> &Trust {
        if self.asked == Synthesis::Auto { self.check.trust() } else { &Trust::All }
    }

    /// Gives rows to the instances whose poses are followed.
    pub(super) fn apply_trust(&mut self) {
        if let Some(scene) = &self.scene {
            self.instances = self.instances.with(scene, self.trust(), self.frames);
        }
    }

    /// Takes its rows off `bytes` and compares them with its poses.
    fn compare(&mut self, t_ns: i64, bytes: &mut &[u8]) {
        let rows = self.compared_rows();
        let (sensor, config) = (&self.config.sensor, &self.config);
        let pixels = sensor.width as usize * rows.len();
        let mut take = |texel_bytes: usize| {
            let all = *bytes;
            let (own, rest) = all.split_at(pixels * texel_bytes);
            *bytes = rest;
            own
        };
        let (Some(geometry), Some(format), Some(scene), Some(last_ns)) =
            (config.geometry, config.motion, &self.scene, self.last_ns)
        else {
            return;
        };
        let (depth, motion) = (take(geometry.depth.texel_bytes()), take(format.texel_bytes()));
        let depth_m: Vec<f32> = (0..pixels).map(|i| geometry.depth.decode(depth, i)).collect();
        let motion_px: Vec<[f32; 2]> =
            (0..pixels).map(|i| format.decode(motion, i).map(|component| component as f32)).collect();
        let ids = geometry.ids.map(|format| {
            let ids = take(format.texel_bytes());
            (0..pixels).map(|i| format.decode(ids, i)).collect::<Vec<u32>>()
        });
        let size_px = (sensor.width, sensor.height);
        let frame =
            KeyFrame::of_rows(size_px, (last_ns, t_ns), Some(&rows), &depth_m, ids.as_deref(), &motion_px)
                .expect("rows of the images that were read");
        let before = self.check.trust().clone();
        self.check.add(&frame, scene);
        if *self.check.trust() != before {
            self.apply_trust();
        }
    }
}
