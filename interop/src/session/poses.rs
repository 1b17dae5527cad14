//! The poses that a peer sends for a frame. Each number of them is checked before it is used.

use super::refused;
use crate::error::InteropError;
use crate::frame_scene::FrameScene;
use crate::wire::{ErrorCode, MAX_POSES, MAX_SAMPLES, Track};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use std::collections::BTreeMap;

/// Largest coordinate of a translation, metres. With it, and samples a nanosecond apart, no velocity overflows.
const MAX_TRANSLATION_M: f64 = 1e9;

/// Poses that have come for the next frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Poses {
    max_instances: u32,
    /// By instance; the camera's by `None`.
    tracks: BTreeMap<Option<u32>, PoseTrack>,
    samples: usize,
}

impl Poses {
    /// None yet. The camera takes poses of at most so many instances.
    pub(super) fn new(max_instances: u32) -> Self {
        Poses { max_instances, ..Poses::default() }
    }

    /// How many samples have come.
    pub(super) fn samples(&self) -> usize {
        self.samples
    }

    /// Adds the tracks of a message.
    pub(super) fn add(&mut self, tracks: &[Track]) -> Result<(), InteropError> {
        for track in tracks {
            let body = name(track.instance);
            let bad = |text: String| refused(ErrorCode::Poses, format!("{body}: {text}"));
            let samples = track.samples.len();
            if samples > MAX_SAMPLES {
                return Err(bad(format!("a track of {samples} poses, expected at most {MAX_SAMPLES}")));
            }
            self.samples += samples;
            if self.samples > MAX_POSES {
                let text = format!("{} poses for a frame, expected at most {MAX_POSES}", self.samples);
                return Err(refused(ErrorCode::Poses, text));
            }
            let poses = track.samples.iter().enumerate().map(|(index, sample)| {
                let [x, y, z, ..] = sample.xyz_qxyzw;
                let far = [x, y, z].into_iter().find(|coordinate| coordinate.abs() > MAX_TRANSLATION_M);
                match (far, Pose::from_xyz_qxyzw(&sample.xyz_qxyzw)) {
                    (_, Err(error)) => Err(bad(format!("pose {index}: {error}"))),
                    (Some(far), _) => Err(bad(format!(
                        "pose {index}: a coordinate is {far} m, expected within +-{MAX_TRANSLATION_M} m"
                    ))),
                    (None, Ok(pose)) => Ok(pose),
                }
            });
            let poses = poses.collect::<Result<Vec<Pose>, _>>()?;
            let times_ns = track.samples.iter().map(|sample| sample.t_ns).collect();
            let poses = PoseTrack::new(times_ns, poses).map_err(|error| bad(error.to_string()))?;
            if self.tracks.insert(track.instance, poses).is_some() {
                return Err(bad("it has two tracks, expected one".to_owned()));
            }
            let instances = self.tracks.len() - usize::from(self.tracks.contains_key(&None));
            if instances > self.max_instances as usize {
                let most = self.max_instances;
                let text = format!("poses of {instances} instances, the camera takes at most {most}");
                return Err(refused(ErrorCode::Poses, text));
            }
        }
        Ok(())
    }

    /// What came, for a frame at `to_ns` whose interval begins at `from_ns`; then there is none again.
    pub(super) fn take(
        &mut self,
        lens: Intrinsics,
        from_ns: i64,
        to_ns: i64,
    ) -> Result<FrameScene, InteropError> {
        let bad = |text: String| refused(ErrorCode::Poses, text);
        let mut tracks = std::mem::take(&mut self.tracks);
        self.samples = 0;
        let camera = tracks.remove(&None).ok_or_else(|| {
            bad("the frame has no poses of the camera, expected a track of instance 0".to_owned())
        })?;
        let mut motion = SceneMotion::new(lens, camera);
        for (instance, track) in tracks {
            let id = instance.expect("the camera's was taken");
            motion.insert(id, track).map_err(|error| bad(error.to_string()))?;
        }
        motion.check_span(from_ns, to_ns).map_err(|error| bad(error.to_string()))?;
        Ok(FrameScene { motion, from_ns, to_ns, vectors_to_ns: from_ns })
    }
}

fn name(instance: Option<u32>) -> String {
    instance.map_or("camera".to_owned(), |id| format!("instance {id}"))
}
