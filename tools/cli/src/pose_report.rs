//! The report's part about poses: what was read, and whether it predicts the motion vectors.

use crate::counted::counted;
use esaac_formats::scene_file::FolderScene;
use esaac_model::paths::conventions::{Agreement, ConventionReport, Mistake, Verdict};
use esaac_model::paths::spacing::CoarseTrack;
use serde::Serialize;
use std::collections::BTreeMap;

/// Poses that came with the frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PoseReport {
    /// The file they come from.
    pub file: String,
    /// Poses of the camera.
    pub camera_poses: usize,
    /// Moving instances.
    pub instances: usize,
    /// Intervals.
    pub intervals: usize,
    /// Intervals that poses of the camera and of all instances span.
    pub intervals_spanned: usize,
    /// What the folder lacks for a comparison with motion vectors, if something.
    pub missing: Option<String>,
    /// Whether nothing disagrees. `None` if nothing could be compared.
    pub agree: Option<bool>,
    /// The static world, if enough pixels show it.
    pub world: Option<AgreementReport>,
    /// Instances of which enough pixels are seen, by id.
    pub by_instance: BTreeMap<u32, AgreementReport>,
    /// Pixels of instances without poses among those looked at.
    pub pixels_without_poses: usize,
    /// Tracks whose poses are too far apart in time to tell the paths between them.
    pub coarse: Vec<CoarseReport>,
    /// What the comparison found, in words.
    pub finding: String,
}

/// A track whose poses are too far apart in time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CoarseReport {
    /// The instance; 0 for the camera.
    pub instance: u32,
    /// Median time from pose to pose, nanoseconds.
    pub spacing_ns: i64,
    /// Estimated error of the paths between poses, pixels.
    pub error_px: f64,
}

/// How vectors of some pixels agree with their paths.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AgreementReport {
    /// Pixels compared.
    pub pixels: usize,
    /// Median length of the predicted vectors, pixels.
    pub median_motion_px: f64,
    /// Median distance between predicted and given vectors, pixels.
    pub median_error_px: f64,
    /// What follows from it.
    pub verdict: VerdictName,
    /// Explanations that do equally well, best first. Each lists the mistakes to undo.
    pub causes: Vec<Vec<String>>,
    /// Median distance once the first explanation is undone, pixels.
    pub left_px: Option<f64>,
}

/// [`Verdict`] without what belongs to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum VerdictName {
    /// Depth and poses predict the vectors.
    #[default]
    Agrees,
    /// They agree, but hardly anything moves.
    Still,
    /// Undoing the mistakes in `causes` makes them agree.
    Mistaken,
    /// No known mistake explains the difference.
    Unexplained,
}

impl PoseReport {
    /// The report of `scene`, whose poses span the first of the two numbers of intervals. `missing` is what a comparison
    /// lacks, `coarse` are tracks whose poses are too far apart.
    #[must_use]
    pub fn new(
        scene: &FolderScene,
        (intervals_spanned, intervals): (usize, usize),
        missing: Option<&str>,
        found: Option<&ConventionReport>,
        coarse: &[CoarseTrack],
    ) -> Self {
        let mut report = PoseReport {
            file: scene.file.display().to_string(),
            camera_poses: scene.motion.camera().poses().len(),
            instances: scene.motion.ids().count(),
            intervals,
            intervals_spanned,
            missing: missing.map(str::to_owned),
            coarse: coarse.iter().map(CoarseReport::new).collect(),
            ..PoseReport::default()
        };
        report.finding = match (missing, &found) {
            (Some(missing), _) => format!("not checked: the frames have no {missing}"),
            (None, None) => "not checked: too few pixels have both depth and a motion vector".to_owned(),
            (None, Some(found)) => found.to_string(),
        };
        if let Some(found) = found {
            report.agree = Some(found.agrees());
            report.world = found.world.as_ref().map(AgreementReport::new);
            report.by_instance =
                found.instances.iter().map(|(&id, one)| (id, AgreementReport::new(one))).collect();
            report.pixels_without_poses = found.pixels_without_poses;
        }
        report
    }

    /// Two lines: what was read, and what was found.
    #[must_use]
    pub fn to_text(&self) -> String {
        let read = format!(
            "{}: {} of the camera, {}, for {} of {}",
            self.file,
            counted(self.camera_poses as u64, "pose"),
            counted(self.instances as u64, "moving instance"),
            self.intervals_spanned,
            counted(self.intervals as u64, "interval")
        );
        format!("{read}\n          {}", self.finding)
    }
}

impl CoarseReport {
    fn new(track: &CoarseTrack) -> Self {
        CoarseReport { instance: track.id, spacing_ns: track.spacing_ns, error_px: track.error_px }
    }
}

impl AgreementReport {
    fn new(found: &Agreement) -> Self {
        let (verdict, causes, left_px) = match &found.verdict {
            Verdict::Agrees => (VerdictName::Agrees, Vec::new(), None),
            Verdict::Still => (VerdictName::Still, Vec::new(), None),
            Verdict::Unexplained { .. } => (VerdictName::Unexplained, Vec::new(), None),
            Verdict::Mistaken { causes, left_px } => {
                let words = |cause: &Vec<Mistake>| cause.iter().map(ToString::to_string).collect();
                (VerdictName::Mistaken, causes.iter().map(words).collect(), Some(*left_px))
            }
        };
        AgreementReport {
            pixels: found.pixels,
            median_motion_px: found.median_motion_px,
            median_error_px: found.median_error_px,
            verdict,
            causes,
            left_px,
        }
    }
}
