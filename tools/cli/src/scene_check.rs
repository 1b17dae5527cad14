//! Checks the poses, depth and ids of a folder against its motion vectors while its frames are simulated.

use crate::frame_folder::FrameFolder;
use crate::pose_report::PoseReport;
use anyhow::{Context, Result};
use esaac_formats::exr_frame::FrameImages;
use esaac_formats::scene_file::FolderScene;
use esaac_model::MotionFormat;
use esaac_model::paths::conventions::{ConventionCheck, KeyFrame};

/// Frames that are compared. Conventions do not change from frame to frame.
const COMPARED_FRAMES: usize = 16;

/// The check of one folder.
pub struct SceneCheck<'a> {
    folder: &'a FrameFolder,
    check: ConventionCheck,
    compared_frames: usize,
}

impl<'a> SceneCheck<'a> {
    /// A check of `folder`, which does nothing if it has no poses.
    #[must_use]
    pub fn new(folder: &'a FrameFolder) -> Self {
        SceneCheck { folder, check: ConventionCheck::default(), compared_frames: 0 }
    }

    /// Takes the frame `index`, if it can be compared: there are vectors, depth, and poses since the frame before.
    pub fn add(&mut self, index: usize, images: &FrameImages) -> Result<()> {
        let Some(scene) = self.folder.scene.as_ref().filter(|scene| self.spans(scene, index)) else {
            return Ok(());
        };
        let (Some(depth), Some(motion)) = (&images.depth, &images.motion) else { return Ok(()) };
        if self.compared_frames == COMPARED_FRAMES {
            return Ok(());
        }
        self.compared_frames += 1;
        let layout = &self.folder.layout;
        let format = layout.motion.unwrap_or(MotionFormat::F32x2);
        let vectors: Vec<[f32; 2]> = (0..motion.len() / format.texel_bytes())
            .map(|i| format.decode(motion, i).map(|v| v as f32))
            .collect();
        let times_ns = (self.folder.time_ns(index - 1), self.folder.time_ns(index));
        let size_px = (layout.width_px, layout.height_px);
        let frame =
            KeyFrame::new(size_px, times_ns, depth, images.ids.as_deref(), &vectors).with_context(|| {
                format!("{} with {}", self.folder.paths[index].display(), scene.file.display())
            })?;
        self.check.add(&frame);
        Ok(())
    }

    /// What was found, if the folder has poses.
    #[must_use]
    pub fn report(&self) -> Option<PoseReport> {
        let scene = self.folder.scene.as_ref()?;
        let intervals = self.folder.paths.len() - 1;
        let spanned = (1..=intervals).filter(|&index| self.spans(scene, index)).count();
        let layout = &self.folder.layout;
        let missing = match (&layout.depth, layout.motion) {
            (None, _) => Some("depth"),
            (_, None) => Some("motion vectors"),
            _ => None,
        };
        Some(PoseReport::new(scene, (spanned, intervals), missing, self.check.report(&scene.motion)))
    }

    /// Whether poses span the interval that ends with frame `index`.
    fn spans(&self, scene: &FolderScene, index: usize) -> bool {
        index > 0
            && scene.motion.check_span(self.folder.time_ns(index - 1), self.folder.time_ns(index)).is_ok()
    }
}
