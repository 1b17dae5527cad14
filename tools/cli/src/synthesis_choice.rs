//! Which synthesis a folder of frames gets: the one that was asked for, or the best that its frames allow.

use crate::frame_folder::FrameFolder;
use crate::scene_check::SceneCheck;
use anyhow::{Context, Result, bail};
use esaac_model::input::{auto_reason, missing_paths};
use esaac_model::paths::conventions::Trust;
use esaac_model::paths::spacing::{CoarseTrack, coarse_warning};
use esaac_model::{FrameError, Synthesis};
use serde::Serialize;

/// The report's part about it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SynthesisChoice {
    /// What the sensor says.
    pub asked: Synthesis,
    /// What was used.
    pub used: Synthesis,
    /// Why, if `auto` was asked for.
    pub reason: Option<String>,
    /// The poses that are followed.
    #[serde(skip)]
    pub trust: Trust,
    /// What to tell on the standard error, if the folder's poses are left out for something that is missing.
    #[serde(skip)]
    pub left_out: Option<String>,
    /// What mends events that are false for want of exact paths, if depth and poses are there and not followed.
    #[serde(skip)]
    pub advice: Option<&'static str>,
}

impl SynthesisChoice {
    /// The choice for the frames of a folder whose poses have been checked.
    ///
    /// # Errors
    /// If the synthesis is asked for by name and the frames lack something that it needs.
    pub fn new(asked: Synthesis, folder: &FrameFolder, check: Option<&SceneCheck>) -> Result<Self> {
        let is_auto = asked == Synthesis::Auto;
        let trust = check.filter(|_| is_auto).map_or(Trust::All, SceneCheck::trust);
        let doubted = (trust == Trust::Nothing)
            .then(|| "depth and poses do not predict them, so that the poses are left out".to_owned());
        let (lack, no_motion) = (lacks_geometry(folder), lacks_motion(folder));
        let file = folder.scene.as_ref().map(|scene| &scene.file).or(folder.poses_without_lens.as_ref());
        let left_out = file.filter(|_| is_auto).zip(lack.as_ref());
        let left_out =
            left_out.map(|(file, lack)| format!("{}: the poses are left out: {lack}", file.display()));
        let is_wrong = lack.is_some() || check.is_some_and(|check| check.trust() == Trust::Nothing);
        let no_geometry = lack.or(doubted);
        let used = asked.resolve(no_geometry.is_none(), no_motion.is_none());
        if let Some(lack) = no_motion.as_ref().filter(|_| used.needs_motion()) {
            return Err(FrameError::MissingMotion { camera: 0, synthesis: used.name() })
                .with_context(|| format!("{lack}; the frames have: {}", folder.channels.join(", ")));
        }
        if let Some(lack) = no_geometry.as_ref().filter(|_| used == Synthesis::Rigid) {
            bail!(
                "synthesis `rigid` needs depth and poses for every interval, and there are {lack}; give them or use \
                 `auto`, which takes the best that there is"
            );
        }
        let reason = is_auto.then(|| {
            let reason = auto_reason(no_geometry.as_deref(), no_motion.as_deref());
            let leaves_some_out = no_geometry.is_none() && matches!(trust, Trust::Without(_));
            if leaves_some_out { format!("{reason}; {trust}") } else { reason }
        });
        let has_both = folder.scene.is_some() && folder.layout.depth.is_some();
        let advice = match (has_both && used != Synthesis::Rigid, is_wrong) {
            (false, _) => None,
            (true, true) => Some("mend depth and poses, which are there and cannot be followed"),
            (true, false) => Some("synthesis `rigid` follows depth and poses, which are there"),
        };
        Ok(SynthesisChoice { asked, used, reason, trust, left_out, advice })
    }

    /// What to tell on the standard error, if poses and vectors disagree: by how much, why, and what follows.
    #[must_use]
    pub fn warning(&self, check: &SceneCheck) -> Option<String> {
        let found = check.found.as_ref()?;
        let disagreement = found.disagreement()?;
        let follows = match (self.asked, self.used) {
            (Synthesis::Auto, _) => format!("; synthesis auto: {}", found.consequence(&self.trust)),
            (_, Synthesis::Rigid) => "; the poses are followed, as synthesis rigid was asked for".to_owned(),
            _ => String::new(),
        };
        Some(format!("{}: {disagreement}{follows}", check.report.file))
    }

    /// What to tell on the standard error, if poses that are followed are too far apart in time.
    #[must_use]
    pub fn coarse_warning(&self, check: &SceneCheck) -> Option<String> {
        let follows = |track: &&CoarseTrack| self.used == Synthesis::Rigid && self.trust.follows(track.id);
        let coarse: Vec<CoarseTrack> = check.coarse.iter().filter(follows).copied().collect();
        coarse_warning(&coarse).map(|warning| format!("{}: {warning}", check.report.file))
    }

    /// One line.
    #[must_use]
    pub fn to_text(&self) -> String {
        match &self.reason {
            Some(reason) => format!("{} ({}: {reason})", self.used.name(), self.asked.name()),
            None => self.used.name().to_owned(),
        }
    }
}

fn lacks_motion(folder: &FrameFolder) -> Option<String> {
    let wanted = folder.layout.names.motion.join("` and `");
    folder.layout.motion.is_none().then(|| format!("no channels `{wanted}`"))
}

/// What is missing for exact paths through all intervals.
fn lacks_geometry(folder: &FrameFolder) -> Option<String> {
    if folder.scene.is_none() && folder.poses_without_lens.is_some() {
        return Some("poses without `intrinsics`".to_owned());
    }
    // Poses of a folder come with a lens.
    let missing = missing_paths(folder.layout.depth.is_some(), true, folder.scene.is_some());
    let (None, Some(scene)) = (missing, &folder.scene) else {
        return missing.map(str::to_owned);
    };
    let last = folder.paths.len() - 1;
    let spanned = scene.motion.check_span(folder.time_ns(0), folder.time_ns(last));
    spanned.err().map(|error| format!("no poses for all intervals ({error})"))
}
