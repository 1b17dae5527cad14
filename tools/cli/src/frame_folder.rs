//! A folder of OpenEXR key frames: which files, at what rate, and whether they agree.

use crate::frame_channels::{AskedChannels, FrameChannels};
use crate::frame_numbers::{gap_warning, keys};
use crate::frame_series::{self, Series};
use crate::motion_convention::{MotionConvention, VerticalAxis};
use anyhow::{Context, Result, bail, ensure};
use esaac_engine::zone;
use esaac_formats::exr_frame::{
    FrameHeader, FrameImages, FrameLayout, channel_names, read_frame, read_header,
};
use esaac_formats::frame_time::frame_time_ns;
use esaac_formats::scene_file::{FolderScene, KeyFrames, SequenceFile};
use glob::Pattern;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, sync_channel};

/// Rate where neither the command line nor the folder says one.
pub const DEFAULT_RATE_HZ: f64 = 30.0;

/// Frames decoded ahead of the simulation.
const FRAMES_AHEAD: usize = 2;

/// What of a folder is read and how.
#[derive(Clone, Debug, PartialEq)]
pub struct FolderOptions {
    /// Name pattern with `*`, `?` and `[...]`; without one `key_*.exr`, else `*.exr`.
    pub pattern: Option<String>,
    /// Rate; without one `sequence.json`'s `key_rate_hz`, else [`DEFAULT_RATE_HZ`].
    pub rate_hz: Option<f64>,
    /// Channels that were named, so that their absence is an error.
    pub channels: AskedChannels,
    /// Meaning of motion vectors; without one [`MotionConvention::Blender`] for Blender's vector pass, else the default.
    pub motion_convention: Option<MotionConvention>,
    /// Direction of a motion vector's y.
    pub motion_y: Option<VerticalAxis>,
}

/// A folder whose headers have been checked.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameFolder {
    /// Frames in order of time.
    pub paths: Vec<PathBuf>,
    /// Frames a second.
    pub rate_hz: f64,
    /// Who says so.
    pub rate_from: &'static str,
    /// Common layout.
    pub layout: FrameLayout,
    /// Channels of the first frame, for messages.
    pub channels: Vec<String>,
    /// The motion of the scene, if the folder has poses.
    pub scene: Option<FolderScene>,
    /// The file that has poses without a lens, so that they are not read, if one has.
    pub poses_without_lens: Option<PathBuf>,
    /// What to tell about the names of the frames.
    pub warnings: Vec<String>,
}

impl FrameFolder {
    /// Lists the folder and checks every frame's header.
    pub fn open(folder: &Path, options: &FolderOptions) -> Result<Self> {
        let Listed { paths, warnings, .. } = list(folder, options.pattern.as_deref())?;
        let sequence = SequenceFile::read(folder)?;
        let of_sequence = sequence.as_ref().and_then(|sequence| sequence.key_rate_hz);
        let (rate_hz, rate_from) = match (options.rate_hz, of_sequence) {
            (Some(rate_hz), _) => (rate_hz, "--rate"),
            (None, Some(rate_hz)) => (rate_hz, SequenceFile::NAME),
            (None, None) => (DEFAULT_RATE_HZ, "the default; --rate tells another"),
        };
        ensure!(
            rate_hz.is_finite() && (1.0..=1e6).contains(&rate_hz),
            "key frame rate is {rate_hz} Hz, expected 1 to 1000000"
        );
        let asked = &options.channels;
        let there = channel_names(&paths[0])?;
        let of_first = || paths[0].display().to_string();
        let channels = FrameChannels::new(&there, asked).with_context(of_first)?;
        let headers: Vec<FrameHeader> =
            paths.iter().map(|path| read_header(path, &channels.names)).collect::<Result<_>>()?;
        let first = headers[0].clone();
        for (path, header) in paths.iter().zip(&headers) {
            agree(&paths[0], &first, path, header)?;
        }
        let listed = first.channels.join(", ");
        if asked.motion.is_some() && !first.has_motion {
            let names = channels.names.motion.join("` and `");
            bail!("{}: no motion channels `{names}`; it has: {listed}", paths[0].display());
        }
        let implied =
            if channels.has_vector_pass() { MotionConvention::Blender } else { MotionConvention::default() };
        let motion_factors = options.motion_convention.unwrap_or(implied).factors(options.motion_y);
        let mut layout = FrameLayout::new(&first, &channels.names, motion_factors);
        if headers.iter().any(|h| !h.half_colour) {
            layout.hdr = esaac_model::HdrFormat::F32x4;
        }
        let size_px = (first.width_px, first.height_px);
        let keys = KeyFrames { paths: &paths, rate_hz, size_px };
        let scene = FolderScene::read(folder, sequence.as_ref(), &keys)?;
        let lacks_lens = sequence.is_some_and(|sequence| sequence.lacks_lens());
        let poses_without_lens = lacks_lens.then(|| folder.join(SequenceFile::NAME));
        // Depth and ids are of use with poses only.
        let wanted = scene.is_some();
        if wanted || asked.depth.is_some() {
            let name = channels.depth().with_context(of_first)?;
            layout.depth = channel("depth", name, asked.depth.is_some(), &paths, &headers)?;
        }
        let mut id_channel = String::new();
        if wanted || asked.ids.is_some() {
            id_channel = channels.ids().with_context(of_first)?;
            layout.ids = channel("id", id_channel.clone(), asked.ids.is_some(), &paths, &headers)?;
        }
        if let Some(scene) = scene.as_ref().filter(|scene| scene.motion.ids().next().is_some()) {
            ensure!(
                layout.ids.is_some(),
                "{} has poses of instances, but the frames have no channel `{id_channel}` that tells where they are; \
                 they have: {listed}",
                scene.file.display()
            );
        }
        Ok(FrameFolder {
            paths,
            rate_hz,
            rate_from,
            layout,
            channels: first.channels,
            scene,
            poses_without_lens,
            warnings,
        })
    }

    /// Time of frame `index`, nanoseconds: `round(index 1e9 / rate)`.
    #[must_use]
    pub fn time_ns(&self, index: usize) -> i64 {
        frame_time_ns(index, self.rate_hz)
    }

    /// Decodes the frames in order on a thread of its own, a few ahead of the receiver. The thread
    /// ends after an error, after the last frame, or when the receiver is dropped.
    #[must_use]
    pub fn decode(&self) -> Receiver<Result<FrameImages>> {
        let (sender, receiver) = sync_channel(FRAMES_AHEAD);
        let (paths, layout) = (self.paths.clone(), self.layout.clone());
        std::thread::spawn(move || {
            for path in paths {
                let frame = {
                    let _zone = zone!("decode");
                    read_frame(&path, &layout)
                };
                let failed = frame.is_err();
                if sender.send(frame).is_err() || failed {
                    break;
                }
            }
        });
        receiver
    }
}

/// The frames of a folder in order.
struct Listed {
    paths: Vec<PathBuf>,
    /// What to tell about their names.
    warnings: Vec<String>,
}

fn list(folder: &Path, pattern: Option<&str>) -> Result<Listed> {
    ensure!(folder.exists(), "there is no folder {}", folder.display());
    ensure!(folder.is_dir(), "{} is a file, expected a folder of OpenEXR frames", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
        let name = entry.with_context(|| format!("cannot list {}", folder.display()))?.file_name();
        files.push((with_small_ending(&name.to_string_lossy()), folder.join(name)));
    }
    let matching = |pattern: &str| -> Result<Vec<(String, PathBuf)>> {
        let pattern = Pattern::new(pattern).with_context(|| format!("--frames is `{pattern}`"))?;
        let is_named = |path: &Path| path.file_name().is_some_and(|n| pattern.matches(&n.to_string_lossy()));
        Ok(files.iter().filter(|(name, path)| pattern.matches(name) || is_named(path)).cloned().collect())
    };
    let (found, sought) = match pattern {
        Some(pattern) => (matching(pattern)?, pattern),
        None => {
            let keys = matching("key_*.exr")?;
            (if keys.is_empty() { matching("*.exr")? } else { keys }, "key_*.exr or *.exr")
        }
    };
    ensure!(
        found.len() >= 2,
        "{} holds {} frames that match {sought}, expected at least 2",
        folder.display(),
        found.len()
    );
    let (names, paths): (Vec<String>, Vec<PathBuf>) = found.into_iter().unzip();
    let mut frames: Vec<_> = keys(&names).into_iter().zip(paths).zip(names).collect();
    frames.sort();
    let (keyed, names): (Vec<_>, Vec<String>) = frames.into_iter().unzip();
    let (keys, paths): (Vec<_>, Vec<PathBuf>) = keyed.into_iter().unzip();
    let of_series = match frame_series::of(&names, &keys) {
        Series::One => None,
        Series::OneAnd(others) => Some(format!(
            "{others}: not named like the other frames, and played with them; --frames chooses others"
        )),
        // Who gives a pattern may mean all that it matches.
        Series::ByNumber(sequences) if pattern.is_some() => {
            Some(format!("the frames seem to be several sequences, and are played as one: {sequences}"))
        }
        Series::ByNumber(sequences) => bail!(
            "{} holds frames of several sequences: {sequences}; choose one with --frames, or all as one with \
             --frames '{}'",
            folder.display(),
            if names[0].starts_with("key_") { "key_*.exr" } else { "*.exr" }
        ),
        Series::ByText(sequences) => bail!(
            "{} holds frames of several sequences: {sequences}; choose one with --frames",
            folder.display()
        ),
    };
    let warnings = of_series.into_iter().chain(gap_warning(&names, &keys)).collect();
    Ok(Listed { paths, warnings })
}

/// The name with `.exr` in place of `.EXR`, which some programs of Windows write.
fn with_small_ending(name: &str) -> String {
    match name.rsplit_once('.') {
        Some((stem, ending)) if ending.eq_ignore_ascii_case("exr") => format!("{stem}.exr"),
        _ => name.to_owned(),
    }
}

/// The channel of `what`, if it is there or `must` be. All frames must have it, or none.
fn channel(
    what: &str,
    name: String,
    must: bool,
    paths: &[PathBuf],
    headers: &[FrameHeader],
) -> Result<Option<String>> {
    let has = |header: &FrameHeader| header.channels.contains(&name);
    if !must && !headers.iter().any(has) {
        return Ok(None);
    }
    if let Some(i) = headers.iter().position(|header| !has(header)) {
        let listed = headers[i].channels.join(", ");
        bail!("{}: no {what} channel `{name}`; it has: {listed}", paths[i].display());
    }
    Ok(Some(name))
}

fn agree(first_path: &Path, first: &FrameHeader, path: &Path, header: &FrameHeader) -> Result<()> {
    ensure!(
        (header.width_px, header.height_px) == (first.width_px, first.height_px),
        "{}: {}x{} px, expected {}x{} px like {}",
        path.display(),
        header.width_px,
        header.height_px,
        first.width_px,
        first.height_px,
        first_path.display()
    );
    if header.has_motion != first.has_motion {
        let (with, without) = if header.has_motion { (path, first_path) } else { (first_path, path) };
        bail!("{} has no motion but {} has; expected all or none", without.display(), with.display());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names in a folder of these files that match, in order.
    fn listed(files: &[&str], pattern: &str) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        files.iter().for_each(|file| std::fs::write(folder.path().join(file), "").unwrap());
        let paths = list(folder.path(), Some(pattern)).unwrap().paths;
        paths.iter().map(|path| path.file_name().unwrap().to_str().unwrap().to_owned()).collect()
    }

    #[test]
    fn patterns_match_whole_names() {
        let files = ["key_0001.exr", "key_0002.exr", "key_0002.exr.bak", "key_10.exr", "a.exr", "b.exr"];
        assert_eq!(listed(&files, "key_*.exr"), ["key_0001.exr", "key_0002.exr", "key_10.exr"]);
        assert_eq!(listed(&files, "?.exr"), ["a.exr", "b.exr"]);
        assert_eq!(listed(&files, "key_000[12].exr"), ["key_0001.exr", "key_0002.exr"]);
        let error = list(Path::new("/"), Some("key_[0.exr")).err().unwrap();
        assert!(format!("{error:#}").contains("--frames is `key_[0.exr`"), "{error:#}");
    }

    #[test]
    fn an_ending_in_capitals_is_one_too() {
        let files = ["f_1.exr", "f_2.EXR", "f_3.Exr", "g_4.txt"];
        assert_eq!(listed(&files, "*.exr"), files[..3]);
        assert_eq!(listed(&["f_1.EXR", "f_2.EXR", "f_3.exr"], "*.EXR"), ["f_1.EXR", "f_2.EXR"]);
    }

    #[test]
    fn a_pattern_of_many_stars_is_matched_at_once() {
        let name = format!("{}.exr", "a".repeat(60));
        let error = |pattern: &str| {
            let folder = tempfile::tempdir().unwrap();
            std::fs::write(folder.path().join(&name), "").unwrap();
            list(folder.path(), Some(pattern)).err().unwrap().to_string()
        };
        assert!(error("*a*a*a*a*a*a*a*a*a*a*a*b").contains("holds 0 frames"));
    }

    #[test]
    fn names_of_one_number_are_in_the_order_of_their_text() {
        assert_eq!(listed(&["f1.exr", "f01.exr", "f001.exr"], "*.exr"), ["f001.exr", "f01.exr", "f1.exr"]);
    }
}
