//! Checks the poses, depth and ids of a folder before its frames are simulated: against its motion vectors, so that all
//! intervals get one synthesis, and whether poses are close enough in time.

use crate::frame_folder::FrameFolder;
use crate::pose_report::PoseReport;
use anyhow::{Context, Result};
use esaac_formats::exr_frame::read_frame;
use esaac_formats::scene_file::FolderScene;
use esaac_model::MotionFormat;
use esaac_model::paths::conventions::{ConventionCheck, ConventionReport, KeyFrame, Trust};
use esaac_model::paths::spacing::{CoarseTrack, SpacingCheck};

/// Frames that are compared. Conventions do not change from frame to frame.
const COMPARED_FRAMES: usize = 16;

/// Frames whose points tell how far poses are apart in pixels.
const FRAMES_OF_POINTS: usize = 4;

/// What was found in a folder with poses.
pub struct SceneCheck {
    /// The report's part.
    pub report: PoseReport,
    /// What was compared.
    pub found: Option<ConventionReport>,
    /// The tracks whose poses are too far apart in time.
    pub coarse: Vec<CoarseTrack>,
}

impl SceneCheck {
    /// The check of a folder; `None` if it has no poses.
    ///
    /// # Errors
    /// If a frame cannot be read.
    pub fn of(folder: &FrameFolder) -> Result<Option<Self>> {
        let Some(scene) = &folder.scene else { return Ok(None) };
        let intervals = folder.paths.len() - 1;
        let spanned: Vec<usize> = (1..=intervals).filter(|&index| spans(folder, scene, index)).collect();
        let layout = &folder.layout;
        let missing = match (&layout.depth, layout.motion) {
            (None, _) => Some("depth"),
            (_, None) => Some("motion vectors"),
            _ => None,
        };
        let mut check = ConventionCheck::default();
        if missing.is_none() {
            spanned
                .iter()
                .take(COMPARED_FRAMES)
                .try_for_each(|&index| add(&mut check, folder, scene, index))?;
        }
        let found = check.report(&scene.motion);
        let coarse = coarse_tracks(folder, scene)?;
        let report = PoseReport::new(scene, (spanned.len(), intervals), missing, found.as_ref(), &coarse);
        Ok(Some(SceneCheck { report, found, coarse }))
    }

    /// The poses that `auto` follows.
    #[must_use]
    pub fn trust(&self) -> Trust {
        self.found.as_ref().map_or(Trust::All, ConventionReport::trust)
    }
}

/// The tracks of a folder with depth whose poses are too far apart in time.
fn coarse_tracks(folder: &FrameFolder, scene: &FolderScene) -> Result<Vec<CoarseTrack>> {
    let layout = &folder.layout;
    let mut check = SpacingCheck::default();
    if layout.depth.is_none() || scene.motion.moving_tracks() == 0 {
        return Ok(Vec::new());
    }
    let stride = folder.paths.len().div_ceil(FRAMES_OF_POINTS);
    for index in (0..folder.paths.len()).step_by(stride) {
        let images = read_frame(&folder.paths[index], layout)?;
        if let Some(depth_m) = &images.depth {
            check.add(layout.width_px, folder.time_ns(index), depth_m, images.ids.as_deref());
        }
    }
    Ok(check.coarse(&scene.motion))
}

/// Takes the frame `index`.
fn add(check: &mut ConventionCheck, folder: &FrameFolder, scene: &FolderScene, index: usize) -> Result<()> {
    let (path, layout) = (&folder.paths[index], &folder.layout);
    let images = read_frame(path, layout)?;
    let (Some(depth), Some(motion)) = (&images.depth, &images.motion) else { return Ok(()) };
    let format = layout.motion.unwrap_or(MotionFormat::F32x2);
    let vectors: Vec<[f32; 2]> = (0..motion.len() / format.texel_bytes())
        .map(|i| format.decode(motion, i).map(|component| component as f32))
        .collect();
    let times_ns = (folder.time_ns(index - 1), folder.time_ns(index));
    let size_px = (layout.width_px, layout.height_px);
    let frame = KeyFrame::new(size_px, times_ns, depth, images.ids.as_deref(), &vectors)
        .with_context(|| format!("{} with {}", path.display(), scene.file.display()))?;
    check.add(&frame);
    Ok(())
}

/// Whether poses span the interval that ends with frame `index`.
fn spans(folder: &FrameFolder, scene: &FolderScene, index: usize) -> bool {
    scene.motion.check_span(folder.time_ns(index - 1), folder.time_ns(index)).is_ok()
}
