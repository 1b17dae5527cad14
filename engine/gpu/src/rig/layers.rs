//! How many surfaces a pixel may show where motions meet. A camera can leave that to its scene: kernels for several take
//! longer, and most scenes need them nowhere.
//!
//! `ingest` counts the blocks that motions that meet pass, and the next interval follows. Before a camera's first interval
//! its vectors are read back.

use super::look::Given;
use super::sensor::may_have_layers;
use super::transfer::Part;
use super::{CameraState, Rig};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use esaac_layout::Counters;
use esaac_model::synthesis::is_usable;
use esaac_model::synthesis::layers::layers_for_scene;
use esaac_model::synthesis::layers::pairs::Pairs;
use glam::DVec2;

impl CameraState {
    /// Most surfaces that a pixel may show in the next interval.
    pub(super) fn layers(&self) -> u32 {
        let sensor = &self.config.sensor;
        match may_have_layers(sensor) {
            _ if self.is_left_to_scene() => self.layers_for_scene,
            true => sensor.layers,
            false => 1,
        }
    }

    /// Takes note of where motions met in an interval.
    pub(super) fn note_meetings(&mut self, counters: &Counters) {
        let before = self.layers_for_scene;
        let (meeting, blocks) = (counters.meeting_blocks.into(), self.place.blocks.into());
        self.layers_for_scene =
            if self.is_left_to_scene() { layers_for_scene(before, meeting, blocks) } else { 1 };
    }

    fn is_left_to_scene(&self) -> bool {
        may_have_layers(&self.config.sensor) && self.config.sensor.layers == 0
    }

    /// The motion image of the frame that ends its first interval; none if that is another, or nobody asks.
    fn first_vectors<'a>(&'a self, given: &Given<'a>) -> Vec<Part<'a>> {
        let is_first = self.frames == 1;
        let format = self.config.motion.filter(|_| is_first && self.is_left_to_scene());
        let buffer = given.inputs.unwrap_or_else(|| self.input_buffers()).motion;
        let (Some(format), Some(buffer)) = (format, buffer) else { return Vec::new() };
        let bytes = u64::from(self.place.pixels) * format.texel_bytes() as u64;
        vec![Part { buffer, offset: given.images_before as u64 * bytes, bytes }]
    }

    /// Takes its motion image off `bytes`, and takes note of where motions meet.
    fn note_first_vectors(&mut self, bytes: &mut &[u8]) {
        let (sensor, format) = (&self.config.sensor, self.config.motion.expect("its vectors were read"));
        let (own, rest) = bytes.split_at(self.place.pixels as usize * format.texel_bytes());
        *bytes = rest;
        let (width, height) = (sensor.width as usize, sensor.height as usize);
        // Each is looked up three times, and takes longer to decode than to compare.
        let vectors: Vec<[f32; 2]> =
            (0..width * height).map(|pixel| format.decode(own, pixel).map(|v| v as f32)).collect();
        let vector = |x: usize, y: usize| Some(DVec2::from(vectors[y * width + x].map(f64::from)));
        let pairs = Pairs::new((width, height), |x, y| vector(x, y).filter(|v| is_usable([v.x, v.y])));
        self.layers_for_scene = layers_for_scene(1, pairs.meeting_blocks(), self.place.blocks.into());
    }
}

impl Rig {
    /// Looks where motions meet in the frames of a tick that end first intervals.
    pub(super) fn look_for_meetings(
        &mut self,
        frames: &[Option<Given<'_>>],
        hooks: &mut SubmitHooks<'_>,
    ) -> Result<(), EngineError> {
        let take =
            |camera: &mut CameraState, _: &Given<'_>, bytes: &mut &[u8]| camera.note_first_vectors(bytes);
        self.look_at_frames(frames, hooks, CameraState::first_vectors, take)
    }

    /// Makes room for levels in cameras that have gone over to several surfaces. On an error nothing has changed.
    pub(super) fn make_room_for_layers(&mut self) -> Result<(), EngineError> {
        let needs_room = |camera: &CameraState| camera.layers() > 1 && camera.place.level_rows == 0;
        if !self.cameras.iter().any(needs_room) {
            return Ok(());
        }
        let mut places = self.places();
        for (place, camera) in places.iter_mut().zip(&self.cameras).filter(|(_, camera)| needs_room(camera)) {
            *place = place.with_levels_of(&camera.config.sensor);
        }
        self.change(places, Vec::new(), &[])
    }
}
