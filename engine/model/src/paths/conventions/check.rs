//! The check of a running camera: its first intervals tell whether its poses are to be followed.
//!
//! An interval in which nothing moves says nothing and does not count. A doubt stays, so that a camera does not go to
//! and fro between two syntheses; it is a function of the frames alone, so that runs repeat.

use super::{ConventionCheck, ConventionReport, KeyFrame, Trust, Verdict};
use crate::paths::{Pose, PoseTrack, STATIC_WORLD, SceneMotion};
use std::collections::BTreeMap;

/// Intervals in which something moves that are compared. Conventions do not change from frame to frame.
const COMPARED_INTERVALS: usize = 4;

/// Intervals that are looked at for some in which something moves.
const MOST_INTERVALS: usize = 32;

/// The check of one camera since its first frame.
#[derive(Clone, Debug, Default)]
pub struct PoseCheck {
    looked: usize,
    compared: usize,
    last_ns: Option<i64>,
    check: ConventionCheck,
    scene: Option<SceneMotion>,
    report: Option<ConventionReport>,
    trust: Trust,
}

impl PoseCheck {
    /// A check that begins with what an earlier one has found, and whether that was over. One that was not looks at as many
    /// intervals as a new one.
    #[must_use]
    pub fn resumed(trust: Trust, was_over: bool) -> Self {
        let compared = if was_over { COMPARED_INTERVALS } else { 0 };
        PoseCheck { trust, compared, ..PoseCheck::default() }
    }

    /// Whether it has seen enough and takes no more frames.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.compared == COMPARED_INTERVALS || self.looked == MOST_INTERVALS
    }

    /// Takes the frame that ends an interval, with the poses of that interval; the same one again is left out.
    pub fn add(&mut self, frame: &KeyFrame<'_>, scene: &SceneMotion) {
        if self.is_over() || self.last_ns == Some(frame.t_ns) {
            return;
        }
        self.last_ns = Some(frame.t_ns);
        self.looked += 1;
        let mut interval = ConventionCheck::default();
        interval.add(frame);
        let Some(found) = interval.compare(scene, false) else { return };
        let is_still =
            found.world.iter().chain(found.instances.values()).all(|f| f.verdict == Verdict::Still);
        if is_still {
            self.report.get_or_insert(found);
            return;
        }
        self.compared += 1;
        self.check.append(interval);
        let poses = match self.scene.take() {
            Some(before) if before != *scene => joined(&before, scene, frame),
            _ => scene.clone(),
        };
        let report = self.check.compare(&poses, false).unwrap_or(found);
        self.trust = std::mem::take(&mut self.trust).and(report.trust());
        // Figures alone are no news.
        let is_known = self.report.as_ref().is_some_and(|before| causes(before) == causes(&report));
        if !is_known || report.agrees() {
            self.report = Some(report);
        }
        if self.is_over() {
            self.check = ConventionCheck::default();
        } else {
            self.scene = Some(poses);
        }
    }

    /// What was found so far, with the figures of when it was; `None` if nothing could be compared.
    #[must_use]
    pub fn report(&self) -> Option<&ConventionReport> {
        self.report.as_ref()
    }

    /// The poses that `auto` follows.
    #[must_use]
    pub fn trust(&self) -> &Trust {
        &self.trust
    }
}

/// What disagrees, the static world or instances, and why. Which of several causes does best, and which is nearest if none
/// explains it, changes with the figures and is no news.
fn causes(report: &ConventionReport) -> BTreeMap<u32, Vec<String>> {
    let world = report.world.iter().map(|world| (STATIC_WORLD, world));
    let all = world.chain(report.instances.iter().map(|(&id, one)| (id, one)));
    let wrong = all.filter_map(|(id, found)| match &found.verdict {
        Verdict::Agrees | Verdict::Still => None,
        Verdict::Mistaken { causes, .. } => {
            let mut causes: Vec<String> = causes.iter().map(|cause| format!("{cause:?}")).collect();
            causes.sort();
            Some((id, causes))
        }
        Verdict::Unexplained { .. } => Some((id, Vec::new())),
    });
    wrong.collect()
}

/// The poses of two intervals. A shift in time shows in poses before and after an interval.
fn joined(before: &SceneMotion, now: &SceneMotion, frame: &KeyFrame<'_>) -> SceneMotion {
    let of = |track: &PoseTrack| -> Vec<(i64, Pose)> {
        match track.poses() {
            [still] => vec![(frame.previous_ns, *still), (frame.t_ns, *still)],
            poses => track.times_ns().iter().copied().zip(poses.iter().copied()).collect(),
        }
    };
    let join = |before: Option<&PoseTrack>, now: &PoseTrack| {
        // One pose stands still at all times.
        if now.poses().len() == 1 && before.is_none_or(|before| before.poses() == now.poses()) {
            return now.clone();
        }
        let samples: BTreeMap<i64, Pose> = before.into_iter().flat_map(of).chain(of(now)).collect();
        let (times_ns, poses) = samples.into_iter().unzip();
        PoseTrack::new(times_ns, poses).expect("times of a map ascend, and there is one at least")
    };
    let mut scene = SceneMotion::new(*now.lens(), join(Some(before.camera()), now.camera()));
    for id in now.ids() {
        let track = join(before.instance(id), now.instance(id).expect("an id of this scene"));
        scene.insert(id, track).expect("each id is there once");
    }
    scene
}
