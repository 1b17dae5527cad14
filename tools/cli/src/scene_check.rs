//! Checks the poses, depth and ids of a folder against its motion vectors before its frames are simulated, so that all
//! intervals get one synthesis.

use crate::frame_folder::FrameFolder;
use crate::pose_report::PoseReport;
use anyhow::{Context, Result};
use esaac_formats::exr_frame::read_frame;
use esaac_formats::scene_file::FolderScene;
use esaac_model::MotionFormat;
use esaac_model::paths::conventions::{ConventionCheck, ConventionReport, KeyFrame, Trust};

/// Frames that are compared. Conventions do not change from frame to frame.
const COMPARED_FRAMES: usize = 16;

/// What was found in a folder with poses.
pub struct SceneCheck {
    /// The report's part.
    pub report: PoseReport,
    /// What was compared.
    pub found: Option<ConventionReport>,
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
        let report = PoseReport::new(scene, (spanned.len(), intervals), missing, found.as_ref());
        Ok(Some(SceneCheck { report, found }))
    }

    /// The poses that `auto` follows.
    #[must_use]
    pub fn trust(&self) -> Trust {
        self.found.as_ref().map_or(Trust::All, ConventionReport::trust)
    }
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
