//! The check of poses against motion vectors, in the first intervals of a camera that gets both.
//!
//! A few rows of the images are read back before the tick that uses them, so that no event follows a pose that is
//! doubted. With synthesis `auto` the instances of doubted poses then have none, and their pixels follow their motion
//! vectors; the equations are in the model crate's `paths::conventions`.

use super::sensor::is_rigid;
use super::transfer::{Part, read_back_after};
use super::{CameraState, InputBuffers, Rig};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use crate::memory::Buffer;
use esaac_model::paths::conventions::{ConventionReport, KeyFrame, Trust};
use esaac_model::{IdFormat, MotionFormat, Synthesis};

/// Most rows of an image that are compared, evenly spread.
const ROWS: u32 = 48;

/// A frame that a tick is to take.
#[derive(Clone, Copy)]
pub(super) struct Given<'a> {
    pub t_ns: i64,
    /// Buffers that hold it; `None` for the camera's own.
    pub inputs: Option<InputBuffers<'a>>,
    /// Images of the same size before it in each buffer.
    pub images_before: usize,
}

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
        let disagreement = report.and_then(ConventionReport::disagreement);
        Ok(disagreement.map(|text| match state.asked {
            Synthesis::Auto => format!("{text}; synthesis auto: {}", state.trust()),
            _ => format!("{text}; the poses are followed, as synthesis rigid was asked for"),
        }))
    }

    /// The motion vectors of a camera's next frame do not lead to its last one, as after frames that were dropped: they
    /// are not compared with its poses.
    pub fn skip_convention_check(&mut self, camera: usize) -> Result<(), EngineError> {
        self.check_health()?;
        self.camera(camera)?;
        self.cameras[camera].vectors_span = false;
        Ok(())
    }

    /// Compares the vectors of a tick's frames with their poses, while that tells something new.
    pub(super) fn check_conventions(
        &mut self,
        frames: &[Option<Given<'_>>],
        hooks: &SubmitHooks<'_>,
    ) -> Result<(), EngineError> {
        let mut looks = Vec::new();
        for (number, (camera, given)) in self.cameras.iter().zip(frames).enumerate() {
            let look = given.as_ref().and_then(|given| Look::of(camera, given));
            looks.extend(look.map(|look| (number, look)));
        }
        if looks.is_empty() {
            return Ok(());
        }
        let parts: Vec<Part<'_>> =
            looks.iter().flat_map(|(number, look)| look.parts(&self.cameras[*number])).collect();
        // The hooks' timelines are signalled by the tick.
        let hooks = SubmitHooks { signals: &[], ..*hooks };
        let bytes = match read_back_after(&self.device, &parts, &hooks) {
            Ok(bytes) => bytes,
            Err(error) => return Err(if error.leaves_work() { self.lose(error) } else { error }),
        };
        let mut rest = &bytes[..];
        let times_and_rows: Vec<_> =
            looks.into_iter().map(|(number, look)| (number, look.t_ns, look.rows)).collect();
        for (number, t_ns, rows) in times_and_rows {
            self.cameras[number].compare(t_ns, &rows, &mut rest);
        }
        Ok(())
    }
}

/// The rows of a frame that are compared.
struct Look<'a> {
    t_ns: i64,
    inputs: Option<InputBuffers<'a>>,
    images_before: usize,
    rows: Vec<u32>,
}

impl<'a> Look<'a> {
    /// `None` if the camera's check is over, or there is nothing to compare.
    fn of(camera: &CameraState, given: &Given<'a>) -> Option<Self> {
        let sensor = &camera.config.sensor;
        let has_both = is_rigid(sensor) && camera.config.motion.is_some() && camera.scene.is_some();
        if !has_both || camera.last_ns.is_none() || !camera.vectors_span || camera.check.is_over() {
            return None;
        }
        let stride = sensor.height.div_ceil(ROWS);
        let rows = (stride / 2..sensor.height).step_by(stride as usize).collect();
        Some(Look { t_ns: given.t_ns, inputs: given.inputs, images_before: given.images_before, rows })
    }

    /// The rows of each image: depth, motion, ids.
    fn parts<'b>(&self, camera: &'b CameraState) -> Vec<Part<'b>>
    where
        'a: 'b,
    {
        let inputs = self.inputs.unwrap_or_else(|| camera.input_buffers());
        let geometry = camera.config.geometry;
        let planes = [
            (inputs.depth, geometry.map(|geometry| geometry.depth.texel_bytes())),
            (inputs.motion, camera.config.motion.map(MotionFormat::texel_bytes)),
            (inputs.ids, geometry.and_then(|geometry| geometry.ids).map(IdFormat::texel_bytes)),
        ];
        let sensor = &camera.config.sensor;
        let image =
            |(buffer, texel_bytes): (Option<&'b Buffer>, Option<usize>)| Some((buffer?, texel_bytes?));
        let rows_of = |(buffer, texel_bytes): (&'b Buffer, usize)| {
            let row_bytes = sensor.width as usize * texel_bytes;
            let first_row = self.images_before * sensor.height as usize;
            self.rows.iter().map(move |row| Part {
                buffer,
                offset: ((first_row + *row as usize) * row_bytes) as u64,
                bytes: row_bytes as u64,
            })
        };
        planes.into_iter().filter_map(image).flat_map(rows_of).collect()
    }
}

impl CameraState {
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
    fn compare(&mut self, t_ns: i64, rows: &[u32], bytes: &mut &[u8]) {
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
            KeyFrame::of_rows(size_px, (last_ns, t_ns), Some(rows), &depth_m, ids.as_deref(), &motion_px)
                .expect("rows of the images that were read");
        let before = self.check.trust().clone();
        self.check.add(&frame, scene);
        if *self.check.trust() != before {
            self.apply_trust();
        }
    }
}
