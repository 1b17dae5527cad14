//! Sources of frames: scenes rendered on the device, stored frames, and patterns whose motion, brightness change and
//! moving share can be set one by one.

use crate::throw::Throw;
use anyhow::Result;
use esaac_engine::{FrameBytes, GeometryConfig, InputBuffers, Rig};
use esaac_model::paths::SceneMotion;
use esaac_model::{DepthFormat, IdFormat};
use esaac_scene::{Renderer, Scene, Targets};
use std::cell::RefCell;
use std::rc::Rc;

/// An interval at 30 Hz.
pub const FRAME_NS: i64 = 33_333_333;

/// Frames of every camera of a rig.
pub enum Feed {
    /// A scene, rendered for each camera. The number is the time from frame to frame, in nanoseconds.
    Scene(Rc<RefCell<Renderer>>, Box<Scene>, i64),
    /// Stored frames, the same for every camera, and the motion of what they show, if it is known.
    Stored(Vec<StoredFrame>, Option<SceneMotion>),
    /// A pattern, computed and uploaded by the host, the same for every camera.
    Pattern(Pattern),
    /// A board that slides before a wall, likewise, with depth, ids and poses; without motion vectors.
    Throw(Throw),
}

/// A frame in memory.
#[derive(Clone, Debug)]
pub struct StoredFrame {
    /// Time, nanoseconds.
    pub t_ns: i64,
    /// Colour image, in the format of the feed.
    pub hdr: Vec<u8>,
    /// Motion image, if there is one.
    pub motion: Option<Vec<u8>>,
    /// Depth, f32, if there is one.
    pub depth: Option<Vec<u8>>,
    /// Instance ids, u32, if there are some.
    pub ids: Option<Vec<u8>>,
}

impl Feed {
    /// Number of frames; `None` for a feed without end.
    #[must_use]
    pub fn frames(&self) -> Option<usize> {
        match self {
            Feed::Stored(frames, _) => Some(frames.len()),
            Feed::Scene(..) | Feed::Pattern(_) | Feed::Throw(_) => None,
        }
    }

    /// Whether frames have motion vectors.
    #[must_use]
    pub fn has_motion(&self) -> bool {
        match self {
            Feed::Stored(frames, _) => frames.iter().all(|frame| frame.motion.is_some()),
            Feed::Scene(..) | Feed::Pattern(_) => true,
            Feed::Throw(_) => false,
        }
    }

    /// What cameras can get of the scene's geometry; `None` if it is not known.
    #[must_use]
    pub fn geometry(&self) -> Option<GeometryConfig> {
        let config = |lens| GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U32), lens };
        match self {
            Feed::Scene(_, scene, _) => Some(config(scene.intrinsics())),
            Feed::Stored(_, motion) => motion.as_ref().map(|motion| config(*motion.lens())),
            Feed::Throw(throw) => Some(config(throw.lens())),
            Feed::Pattern(_) => None,
        }
    }

    /// Writes frame `index` into the inputs of every camera of a rig, with the poses up to it if the camera takes
    /// them, and returns its time in nanoseconds.
    pub fn put(&mut self, rig: &mut Rig, index: usize) -> Result<i64> {
        match self {
            Feed::Scene(renderer, scene, step_ns) => {
                let mut renderer = renderer.borrow_mut();
                if renderer.scene() != &**scene {
                    renderer.set_scene((**scene).clone())?;
                }
                let t_ns = index as i64 * *step_ns;
                let previous_ns = (index > 0).then(|| t_ns - *step_ns);
                for camera in 0..rig.len() {
                    let InputBuffers { hdr, motion, depth, ids } = rig.inputs(camera)?;
                    let takes_poses = depth.is_some();
                    renderer.render(t_ns, previous_ns, Targets { hdr, motion, depth, ids })?;
                    if takes_poses {
                        rig.set_scene(camera, scene.scene_motion(&pose_times_ns(t_ns, *step_ns)))?;
                    }
                }
                Ok(t_ns)
            }
            Feed::Stored(frames, motion) => {
                let StoredFrame { t_ns, hdr, motion: vectors, depth, ids } = &frames[index];
                let (motion_image, depth, ids) = (vectors.as_deref(), depth.as_deref(), ids.as_deref());
                for camera in 0..rig.len() {
                    rig.upload(camera, &FrameBytes { hdr, motion: motion_image, depth, ids })?;
                    if let (0, Some(motion), true) = (index, &*motion, rig.inputs(camera)?.depth.is_some()) {
                        rig.set_scene(camera, motion.clone())?;
                    }
                }
                Ok(*t_ns)
            }
            Feed::Pattern(pattern) => {
                let (hdr, motion) = (pattern.hdr(index), pattern.motion());
                for camera in 0..rig.len() {
                    let frame = FrameBytes { hdr: &hdr, motion: Some(&motion), ..FrameBytes::default() };
                    rig.upload(camera, &frame)?;
                }
                Ok(index as i64 * FRAME_NS)
            }
            Feed::Throw(throw) => {
                let t_ns = index as i64 * FRAME_NS;
                let (frame, motion) = (throw.frame(t_ns), throw.motion(t_ns));
                for camera in 0..rig.len() {
                    let takes_poses = rig.inputs(camera)?.depth.is_some();
                    rig.upload(camera, &frame.bytes(takes_poses))?;
                    if takes_poses {
                        rig.set_scene(camera, motion.clone())?;
                    }
                }
                Ok(t_ns)
            }
        }
    }
}

/// Poses from one frame to the next: at 30 Hz a simulator's 960 steps a second.
const POSES: i64 = 32;

/// Times of the poses of the interval that ends at `t_ns`.
pub(crate) fn pose_times_ns(t_ns: i64, step_ns: i64) -> Vec<i64> {
    (0..=POSES).map(|j| t_ns - step_ns + step_ns * j / POSES).collect()
}

/// A sinusoid in log intensity that moves to the right in the upper left part of the image and stands still in the rest.
/// Its colour is f16x4, its motion f32x2.
#[derive(Clone, Copy, Debug)]
pub struct Pattern {
    /// Columns and rows.
    pub size: (u32, u32),
    /// Motion from frame to frame, pixels.
    pub motion_px: f64,
    /// Share of rows that move, 0 to 1, rounded to whole blocks.
    pub moving: f64,
    /// Share of their columns that move.
    pub moving_columns: f64,
    /// Wavelength, pixels.
    pub wavelength_px: f64,
}

/// Rows of a block.
const BLOCK_ROWS: u32 = esaac_model::substeps::BLOCK_PX;

/// Log amplitude of the pattern.
const AMPLITUDE_LOG: f64 = 1.0;

impl Pattern {
    fn moving_rows(&self) -> u32 {
        let blocks = self.size.1.div_ceil(BLOCK_ROWS);
        ((f64::from(blocks) * self.moving).round() as u32 * BLOCK_ROWS).min(self.size.1)
    }

    fn moving_row_columns(&self) -> u32 {
        (f64::from(self.size.0) * self.moving_columns).round() as u32
    }

    fn hdr(&self, index: usize) -> Vec<u8> {
        let row = |shift_px: f64| -> Vec<u8> {
            (0..self.size.0)
                .flat_map(|x| {
                    let shift_px = if x < self.moving_row_columns() { shift_px } else { 0.0 };
                    let turns = (f64::from(x) - shift_px) / self.wavelength_px;
                    let value = (AMPLITUDE_LOG * (std::f64::consts::TAU * turns).sin()).exp();
                    encode(value)
                })
                .collect()
        };
        let rows = self.moving_rows() as usize;
        let mut image = row(self.motion_px * index as f64).repeat(rows);
        image.extend(row(0.0).repeat(self.size.1 as usize - rows));
        image
    }

    fn motion(&self) -> Vec<u8> {
        let (columns, rows) = (self.size.0 as usize, self.moving_rows() as usize);
        let vectors = |x: f32, columns: usize| {
            let texel: Vec<u8> = [x, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
            texel.repeat(columns)
        };
        let moving = self.moving_row_columns() as usize;
        let row = [vectors(-self.motion_px as f32, moving), vectors(0.0, columns - moving)].concat();
        let mut image = row.repeat(rows);
        image.extend(vectors(0.0, columns * (self.size.1 as usize - rows)));
        image
    }
}

/// A gray texel of four f16.
pub(crate) fn encode(value: f64) -> [u8; 8] {
    let half = half::f16::from_f64(value).to_le_bytes();
    let mut texel = [0; 8];
    texel.chunks_exact_mut(2).for_each(|bytes| bytes.copy_from_slice(&half));
    texel
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::{HdrFormat, MotionFormat};

    #[test]
    fn poses_span_the_interval_and_its_ends_are_exact() {
        let times_ns = pose_times_ns(2 * FRAME_NS, FRAME_NS);
        assert_eq!((times_ns.len(), times_ns[0], times_ns[32]), (33, FRAME_NS, 2 * FRAME_NS));
        assert!(times_ns.is_sorted_by(|a, b| a < b));
    }

    #[test]
    fn a_pattern_moves_as_its_vectors_say_and_only_where_it_moves() {
        let pattern =
            Pattern { size: (32, 16), motion_px: 2.0, moving: 0.5, moving_columns: 1.0, wavelength_px: 16.0 };
        let [first, second] = [0, 1].map(|index| pattern.hdr(index));
        let at = |frame: &[u8], x: usize, y: usize| HdrFormat::F16x4.decode(frame, y * 32 + x)[0];
        assert_eq!(at(&second, 10, 3), at(&first, 8, 3));
        assert_eq!(at(&second, 10, 12), at(&first, 10, 12));
        let motion = pattern.motion();
        assert_eq!(MotionFormat::F32x2.decode(&motion, 3 * 32), [-2.0, 0.0]);
        assert_eq!(MotionFormat::F32x2.decode(&motion, 12 * 32), [0.0, 0.0]);
        let narrow = Pattern { moving_columns: 0.25, ..pattern };
        let [first, second] = [0, 1].map(|index| narrow.hdr(index));
        assert_eq!(at(&second, 7, 3), at(&first, 5, 3));
        assert_eq!(at(&second, 8, 3), at(&first, 8, 3));
        let motion = narrow.motion();
        assert_eq!(MotionFormat::F32x2.decode(&motion, 3 * 32 + 7), [-2.0, 0.0]);
        assert_eq!(MotionFormat::F32x2.decode(&motion, 3 * 32 + 8), [0.0, 0.0]);
    }
}
