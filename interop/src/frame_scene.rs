//! Poses on the link: the part of a scene's motion that an interval needs, and the poses of frames that were dropped.

use crate::error::InteropError;
use crate::wire::{MAX_SAMPLES, Sample, Track};
use esaac_model::MAX_INTERVAL_NS;
use esaac_model::paths::{NEIGHBOURS, Pose, PoseTrack, SceneMotion};

/// The poses that came with a frame, and the interval that they are for.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameScene {
    /// Lens and poses.
    pub motion: SceneMotion,
    /// Time of the frame before; of the frame itself if it is the first.
    pub from_ns: i64,
    /// Time of the frame.
    pub to_ns: i64,
    /// Time of the frame that the producer sent before, to which motion vectors lead.
    pub vectors_to_ns: i64,
}

impl FrameScene {
    /// The poses of the interval from before a frame that was dropped to this frame. An instance that has no poses in
    /// one of the two has none.
    pub(crate) fn after(&self, dropped: &FrameScene) -> FrameScene {
        let joined = |before: &PoseTrack, now: &PoseTrack| {
            // Two poses that stand still are one, whose time says nothing.
            if before.poses() == now.poses() && now.poses().len() == 1 {
                return now.clone();
            }
            let now = samples(now, self.from_ns, self.to_ns);
            let before = samples(before, dropped.from_ns, dropped.to_ns);
            let first_ns = now[0].0;
            // A longer interval than this is none: the camera starts anew.
            let oldest_ns = self.to_ns.saturating_sub(MAX_INTERVAL_NS);
            let kept = before.iter().rposition(|&(t_ns, _)| t_ns <= oldest_ns).unwrap_or(0);
            let before = before[kept..].iter().copied().filter(|&(t_ns, _)| t_ns < first_ns);
            let (times_ns, poses) = before.chain(now.iter().copied()).unzip();
            PoseTrack::new(times_ns, poses).expect("times that ascend in each, and from one to the other")
        };
        let camera = joined(dropped.motion.camera(), self.motion.camera());
        let mut motion = SceneMotion::new(*self.motion.lens(), camera);
        for id in self.motion.ids() {
            if let Some((before, now)) = dropped.motion.instance(id).zip(self.motion.instance(id)) {
                motion.insert(id, joined(before, now)).expect("each id is there once");
            }
        }
        FrameScene { motion, from_ns: dropped.from_ns, to_ns: self.to_ns, vectors_to_ns: self.vectors_to_ns }
    }
}

/// Times and poses of a track. One that stands still does so throughout its interval.
fn samples(track: &PoseTrack, from_ns: i64, to_ns: i64) -> Vec<(i64, Pose)> {
    match track.poses() {
        [still] if from_ns < to_ns => vec![(from_ns, *still), (to_ns, *still)],
        [still] => vec![(to_ns, *still)],
        poses => track.times_ns().iter().copied().zip(poses.iter().copied()).collect(),
    }
}

/// What a producer sends of a scene's motion for an interval: enough that each pose within is the same.
pub(crate) fn tracks(motion: &SceneMotion, from_ns: i64, to_ns: i64) -> Result<Vec<Track>, InteropError> {
    motion.check_span(from_ns, to_ns).map_err(|error| InteropError::Scene { reason: error.to_string() })?;
    let instances = motion.ids().map(|id| (Some(id), motion.instance(id).expect("an id of this motion")));
    [(None, motion.camera())]
        .into_iter()
        .chain(instances)
        .map(|(instance, track)| {
            let samples = part(track, from_ns, to_ns);
            if samples.len() > MAX_SAMPLES {
                let body = instance.map_or("camera".to_owned(), |id| format!("instance {id}"));
                let reason = format!(
                    "{body}: {} poses from {from_ns} to {to_ns} ns, expected at most {MAX_SAMPLES}",
                    samples.len()
                );
                return Err(InteropError::Scene { reason });
            }
            Ok(Track { instance, samples })
        })
        .collect()
}

/// The samples that the poses from `from_ns` to `to_ns` depend on.
fn part(track: &PoseTrack, from_ns: i64, to_ns: i64) -> Vec<Sample> {
    let times_ns = track.times_ns();
    let before = times_ns.partition_point(|&t_ns| t_ns <= from_ns).saturating_sub(1);
    let after = times_ns.partition_point(|&t_ns| t_ns < to_ns);
    let range = before.saturating_sub(NEIGHBOURS)..(after + 1 + NEIGHBOURS).min(times_ns.len());
    let sample = |(&t_ns, pose): (&i64, &Pose)| {
        let ([x, y, z], [qx, qy, qz, qw]) = (pose.translation_m().to_array(), pose.rotation().to_array());
        Sample { t_ns, xyz_qxyzw: [x, y, z, qx, qy, qz, qw] }
    };
    times_ns[range.clone()].iter().zip(&track.poses()[range]).map(sample).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::paths::Intrinsics;

    const MS: i64 = 1_000_000;

    /// A body that shakes, at every millisecond of `from_ms` to `to_ms`.
    fn shaking(from_ms: i64, to_ms: i64) -> PoseTrack {
        let pose = |ms: i64| {
            let (s, c) = (ms as f64 * 0.31).sin_cos();
            let turn = (0.2 * s).sin_cos();
            Pose::from_xyz_qxyzw(&[s, 0.5 * c, s * c, 0.0, turn.0, 0.0, turn.1]).unwrap()
        };
        let times_ms: Vec<i64> = (from_ms..=to_ms).collect();
        PoseTrack::new(times_ms.iter().map(|ms| ms * MS).collect(), times_ms.into_iter().map(pose).collect())
            .unwrap()
    }

    fn scene(camera: PoseTrack, from_ms: i64, to_ms: i64) -> FrameScene {
        let motion = SceneMotion::new(Intrinsics::pinhole(10.0, 10.0, 5.0, 5.0).unwrap(), camera);
        FrameScene { motion, from_ns: from_ms * MS, to_ns: to_ms * MS, vectors_to_ns: from_ms * MS }
    }

    fn track(samples: &[Sample]) -> PoseTrack {
        let poses = samples.iter().map(|sample| Pose::from_xyz_qxyzw(&sample.xyz_qxyzw).unwrap()).collect();
        PoseTrack::new(samples.iter().map(|sample| sample.t_ns).collect(), poses).unwrap()
    }

    #[test]
    fn the_part_of_a_track_that_is_sent_has_the_same_poses_in_its_interval() {
        for length_ms in [1, 2, 5, 40] {
            let whole = shaking(0, length_ms);
            for (from, to) in
                [(0, length_ms * MS), (0, MS), (MS / 3, MS / 2), (length_ms * MS - 7, length_ms * MS)]
            {
                let sent = track(&part(&whole, from, to));
                assert!(sent.times_ns().len() as i64 <= (to - from) / MS + 3 + 2 * NEIGHBOURS as i64);
                for k in 0..=64 {
                    let t_ns = from + (to - from) * k / 64;
                    assert_eq!(sent.at(t_ns).unwrap(), whole.at(t_ns).unwrap(), "{length_ms} {t_ns}");
                }
            }
        }
        let still = PoseTrack::still(Pose::IDENTITY);
        assert_eq!(part(&still, 5 * MS, 6 * MS).len(), 1);
        assert_eq!(part(&still, -6 * MS, -5 * MS).len(), 1);
    }

    #[test]
    fn what_does_not_span_its_interval_or_is_too_long_is_not_sent() {
        let lens = Intrinsics::pinhole(10.0, 10.0, 5.0, 5.0).unwrap();
        let motion = SceneMotion::new(lens, shaking(0, 20));
        let error = tracks(&motion, 0, 21 * MS).unwrap_err().to_string();
        assert!(error.contains("camera: poses from 0 to 20000000 ns, expected them to span"), "{error}");
        let mut many = motion.clone();
        let times_ns: Vec<i64> = (0..1001).map(|k| k * MS / 1000).collect();
        many.insert(4, PoseTrack::new(times_ns, vec![Pose::IDENTITY; 1001]).unwrap()).unwrap();
        let error = tracks(&many, 0, MS).unwrap_err().to_string();
        assert!(
            error.contains("instance 4: 1001 poses from 0 to 1000000 ns, expected at most 1000"),
            "{error}"
        );
    }

    #[test]
    fn poses_of_a_dropped_frame_and_the_next_one_span_both_intervals() {
        // The second began some samples earlier than its interval.
        let (dropped, next) = (scene(shaking(0, 10), 0, 10), scene(shaking(7, 20), 10, 20));
        let joined = next.after(&dropped);
        assert_eq!((joined.from_ns, joined.to_ns), (0, 20 * MS));
        assert_eq!(*joined.motion.camera(), shaking(0, 20));
        // Once more.
        assert_eq!(*scene(shaking(20, 30), 20, 30).after(&joined).motion.camera(), shaking(0, 30));
    }

    #[test]
    fn what_stands_still_in_one_of_two_intervals_is_joined_too() {
        let still = |t_ns| PoseTrack::new(vec![t_ns], vec![Pose::IDENTITY]).unwrap();
        let moved = scene(shaking(10, 20), 10, 20).after(&scene(still(99), 0, 10));
        moved.motion.check_span(0, 20 * MS).unwrap();
        assert_eq!(moved.motion.camera().at(0).unwrap(), Pose::IDENTITY);
        let stopped = scene(still(-3), 10, 20).after(&scene(shaking(0, 10), 0, 10));
        stopped.motion.check_span(0, 20 * MS).unwrap();
        assert_eq!(stopped.motion.camera().at(10 * MS).unwrap(), Pose::IDENTITY);
        let both = scene(still(3), 10, 20).after(&scene(still(5), 0, 10));
        assert_eq!(both.motion.camera().poses().len(), 1);
        let first = scene(shaking(0, 5), 0, 5).after(&scene(still(5), 0, 0));
        first.motion.check_span(0, 5 * MS).unwrap();
    }

    #[test]
    fn instances_that_have_poses_in_one_of_two_intervals_alone_have_none() {
        let mut scenes = [scene(shaking(0, 10), 0, 10), scene(shaking(10, 20), 10, 20)];
        for (scene, ids) in scenes.iter_mut().zip([[3, 5], [5, 8]]) {
            for id in ids {
                scene.motion.insert(id, PoseTrack::still(Pose::IDENTITY)).unwrap();
            }
        }
        let [dropped, next] = scenes;
        assert_eq!(next.after(&dropped).motion.ids().collect::<Vec<_>>(), [5]);
    }

    #[test]
    fn poses_of_many_dropped_frames_do_not_pile_up() {
        let mut joined = scene(shaking(0, 100), 0, 100);
        for frame in 1..50 {
            let (from, to) = (frame * 100, frame * 100 + 100);
            joined = scene(shaking(from, to), from, to).after(&joined);
        }
        let count = joined.motion.camera().times_ns().len();
        assert!((1000..1110).contains(&count), "{count}");
    }
}
