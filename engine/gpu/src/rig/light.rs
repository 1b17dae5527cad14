//! How much light falls on cameras with physical pixels, and what to tell about it.
//!
//! Some rows of a frame's colour image are read back before the tick that takes it: of few frames, so that it costs next
//! to nothing, and of the same frames in every run.

use super::look::{Given, parts_of_rows, spread_rows};
use super::sensor::is_physical;
use super::transfer::Part;
use super::{CameraState, Rig};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use esaac_model::physical::{LightReport, lux_of};

/// Most rows of an image that are looked at, evenly spread.
const ROWS: u32 = 16;

/// About as many pixels of a row are looked at.
const COLUMNS: u32 = 256;

/// One frame in so many is looked at, and of those before the 1st, 2nd, 4th and so on.
const EVERY: u64 = 256;

impl Rig {
    /// The light on a camera's focal plane, in the frames that were looked at; `None` for a camera without physical pixels,
    /// and before its first frame.
    pub fn light(&self, camera: usize) -> Result<Option<LightReport>, EngineError> {
        Ok(self.camera(camera)?.light.report())
    }

    /// What to tell the user about a camera's light: that its preset is used beyond the light that it was fitted for, and
    /// that its intervals have too few sub-steps for the flicker of its lamp.
    pub fn light_warnings(&self, camera: usize) -> Result<Vec<String>, EngineError> {
        let (of_fit, of_flicker) = (self.fit_warning(camera)?, self.flicker_warning(camera)?);
        Ok(of_fit.into_iter().chain(of_flicker).collect())
    }

    /// The first of [`Rig::light_warnings`]: light beyond that which a camera's preset was fitted for.
    pub fn fit_warning(&self, camera: usize) -> Result<Option<String>, EngineError> {
        let state = self.camera(camera)?;
        Ok(state.light.fit_warning(&state.config.sensor))
    }

    /// The second of [`Rig::light_warnings`]: a lamp that flickers too fast for the sub-steps of a camera's intervals.
    pub fn flicker_warning(&self, camera: usize) -> Result<Option<String>, EngineError> {
        let state = self.camera(camera)?;
        Ok(state.config.sensor.flicker_warning(state.longest_interval_ns))
    }

    /// Looks at the light of a tick's frames, if it is their turn.
    pub(super) fn look_at_light(
        &mut self,
        frames: &[Option<Given<'_>>],
        hooks: &mut SubmitHooks<'_>,
    ) -> Result<(), EngineError> {
        let take = |camera: &mut CameraState, _: &Given<'_>, bytes: &mut &[u8]| camera.add_light(bytes);
        self.look_at_frames(frames, hooks, CameraState::light_parts, take)
    }
}

impl CameraState {
    fn looks_at_light(&self) -> bool {
        let frame = self.sequence;
        let is_due =
            if frame < EVERY { frame == 0 || frame.is_power_of_two() } else { frame.is_multiple_of(EVERY) };
        is_physical(&self.config.sensor) && self.lit != Some(frame) && (is_due || self.light.is_empty())
    }

    fn light_rows(&self) -> impl Iterator<Item = u32> + use<> {
        spread_rows(self.config.sensor.height, ROWS)
    }

    /// The rows that are looked at; none if it is not their turn.
    fn light_parts<'a>(&'a self, given: &Given<'a>) -> Vec<Part<'a>> {
        if !self.looks_at_light() {
            return Vec::new();
        }
        let buffer = given.inputs.unwrap_or_else(|| self.input_buffers()).hdr;
        let (sensor, hdr) = (&self.config.sensor, self.config.hdr);
        parts_of_rows(sensor, given, buffer, hdr.texel_bytes(), self.light_rows()).collect()
    }

    /// Takes its rows off `bytes`.
    fn add_light(&mut self, bytes: &mut &[u8]) {
        let (sensor, hdr) = (&self.config.sensor, self.config.hdr);
        let rows: Vec<u32> = self.light_rows().collect();
        let (own, rest) = bytes.split_at(rows.len() * sensor.width as usize * hdr.texel_bytes());
        *bytes = rest;
        let stride = sensor.width.div_ceil(COLUMNS) as usize;
        let lux = (0..).zip(rows).flat_map(|(index, y)| {
            let first = index * sensor.width as usize;
            (0..sensor.width)
                .step_by(stride)
                .filter_map(move |x| lux_of(sensor, (x, y), hdr.decode(own, first + x as usize)))
        });
        self.light.add_frame(lux);
        self.lit = Some(self.sequence);
    }
}
