//! Checks the poses, depth and ids of a folder before its frames are simulated: against its motion vectors, so that all
//! intervals get one synthesis, and whether poses are close enough in time.

use crate::frame_folder::FrameFolder;
use crate::pose_report::PoseReport;
use anyhow::{Context, Result};
use esaac_formats::exr_frame::{FrameImages, read_frame};
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
        let compared = if missing.is_none() { &spanned[..spanned.len().min(COMPARED_FRAMES)] } else { &[] };
        let (mut check, mut spacing) = (ConventionCheck::default(), SpacingCheck::default());
        let (is_seen, stride) = (shows_paths(folder, scene), folder.paths.len().div_ceil(FRAMES_OF_POINTS));
        for index in 0..folder.paths.len() {
            let (is_compared, has_points) = (compared.contains(&index), is_seen && index % stride == 0);
            if !is_compared && !has_points {
                continue;
            }
            let images = read_frame(&folder.paths[index], layout)?;
            if is_compared {
                add(&mut check, &images, folder, scene, index)?;
            }
            if let Some(depth_m) = images.depth.as_ref().filter(|_| has_points) {
                spacing.add(layout.width_px, folder.time_ns(index), depth_m, images.ids.as_deref());
            }
        }
        let (found, coarse) = (check.report(&scene.motion), spacing.coarse(&scene.motion));
        let report = PoseReport::new(scene, (spanned.len(), intervals), missing, found.as_ref(), &coarse);
        Ok(Some(SceneCheck { report, found, coarse }))
    }

    /// The poses that `auto` follows.
    #[must_use]
    pub fn trust(&self) -> Trust {
        self.found.as_ref().map_or(Trust::All, ConventionReport::trust)
    }
}

/// Whether a folder's depth tells what the camera sees of paths.
fn shows_paths(folder: &FrameFolder, scene: &FolderScene) -> bool {
    folder.layout.depth.is_some() && scene.motion.moving_tracks() > 0
}

/// Takes the images of the frame `index`.
fn add(
    check: &mut ConventionCheck,
    images: &FrameImages,
    folder: &FrameFolder,
    scene: &FolderScene,
    index: usize,
) -> Result<()> {
    let (path, layout) = (&folder.paths[index], &folder.layout);
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
