//! A folder of OpenEXR key frames: which files, at what rate, and whether they agree.

use anyhow::{Context, Result, bail, ensure};
use esaac_engine::zone;
use esaac_formats::exr_frame::{
    ChannelNames, DEPTH_CHANNEL, FrameHeader, FrameImages, FrameLayout, ID_CHANNEL, read_frame, read_header,
};
use esaac_formats::frame_time::frame_time_ns;
use esaac_formats::scene_file::{FolderScene, KeyFrames, SequenceFile};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, sync_channel};

/// Rate where neither the command line nor the folder says one.
pub const DEFAULT_RATE_HZ: f64 = 30.0;

/// Frames decoded ahead of the simulation.
const FRAMES_AHEAD: usize = 2;

/// What of a folder is read and how.
#[derive(Clone, Debug, PartialEq)]
pub struct FolderOptions {
    /// Name pattern with `*` and `?`; without one `key_*.exr`, else `*.exr`.
    pub pattern: Option<String>,
    /// Rate; without one `sequence.json`'s `key_rate_hz`, else [`DEFAULT_RATE_HZ`].
    pub rate_hz: Option<f64>,
    /// Channels.
    pub names: ChannelNames,
    /// Whether motion channels were named, so that their absence is an error.
    pub motion_named: bool,
    /// Factors that turn the motion into the engine's convention.
    pub motion_factors: [f32; 2],
    /// Channel of depth that was named, so that its absence is an error. Without one [`DEPTH_CHANNEL`], if it is there.
    pub depth: Option<String>,
    /// Channel of instance ids that was named. Without one [`ID_CHANNEL`], if it is there.
    pub ids: Option<String>,
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
}

impl FrameFolder {
    /// Lists the folder and checks every frame's header.
    pub fn open(folder: &Path, options: &FolderOptions) -> Result<Self> {
        let paths = list(folder, options.pattern.as_deref())?;
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
        let headers: Vec<FrameHeader> =
            paths.iter().map(|path| read_header(path, &options.names)).collect::<Result<_>>()?;
        let first = headers[0].clone();
        for (path, header) in paths.iter().zip(&headers) {
            agree(&paths[0], &first, path, header)?;
        }
        let listed = first.channels.join(", ");
        if options.motion_named && !first.has_motion {
            let names = options.names.motion.join("` and `");
            bail!("{}: no motion channels `{names}`; it has: {listed}", paths[0].display());
        }
        let mut layout = FrameLayout::new(&first, &options.names, options.motion_factors);
        if headers.iter().any(|h| !h.half_colour) {
            layout.hdr = esaac_model::HdrFormat::F32x4;
        }
        let size_px = (first.width_px, first.height_px);
        let keys = KeyFrames { paths: &paths, rate_hz, size_px };
        let scene = FolderScene::read(folder, sequence.as_ref(), &keys)?;
        // Depth and ids are of use with poses only.
        let wanted = scene.is_some();
        layout.depth = channel("depth", options.depth.as_deref(), DEPTH_CHANNEL, &paths, &headers, wanted)?;
        layout.ids = channel("id", options.ids.as_deref(), ID_CHANNEL, &paths, &headers, wanted)?;
        if let Some(scene) = scene.as_ref().filter(|scene| scene.motion.ids().next().is_some()) {
            ensure!(
                layout.ids.is_some(),
                "{} has poses of instances, but the frames have no channel `{ID_CHANNEL}` that tells where they are; \
                 they have: {listed}",
                scene.file.display()
            );
        }
        Ok(FrameFolder { paths, rate_hz, rate_from, layout, channels: first.channels, scene })
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

fn list(folder: &Path, pattern: Option<&str>) -> Result<Vec<PathBuf>> {
    ensure!(folder.exists(), "there is no folder {}", folder.display());
    ensure!(folder.is_dir(), "{} is a file, expected a folder of OpenEXR frames", folder.display());
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
        names.push(entry.with_context(|| format!("cannot list {}", folder.display()))?.file_name());
    }
    names.sort_by_key(|name| natural(&name.to_string_lossy()));
    let matching = |pattern: &str| -> Vec<PathBuf> {
        names.iter().filter(|n| glob(pattern, &n.to_string_lossy())).map(|n| folder.join(n)).collect()
    };
    let (found, sought) = match pattern {
        Some(pattern) => (matching(pattern), pattern.to_owned()),
        None => {
            let keys = matching("key_*.exr");
            let found = if keys.is_empty() { matching("*.exr") } else { keys };
            (found, "key_*.exr or *.exr".to_owned())
        }
    };
    ensure!(
        found.len() >= 2,
        "{} holds {} frames that match {sought}, expected at least 2",
        folder.display(),
        found.len()
    );
    Ok(found)
}

/// Sort key under which `f10` follows `f9`: text and numbers in turn.
fn natural(name: &str) -> Vec<(String, u128)> {
    let mut parts = vec![(String::new(), 0_u128)];
    let mut in_number = false;
    for c in name.chars() {
        if let Some(digit) = c.to_digit(10) {
            let number = &mut parts.last_mut().expect("never empty").1;
            *number = number.saturating_mul(10).saturating_add(u128::from(digit));
            in_number = true;
        } else {
            if in_number {
                parts.push((String::new(), 0));
                in_number = false;
            }
            parts.last_mut().expect("never empty").0.push(c);
        }
    }
    parts
}

/// Whether `name` matches `pattern`, in which `*` stands for any text and `?` for one character.
fn glob(pattern: &str, name: &str) -> bool {
    let mut characters = pattern.chars();
    match characters.next() {
        None => name.is_empty(),
        Some('*') => {
            let rest = characters.as_str();
            glob(rest, name) || name.chars().next().is_some_and(|c| glob(pattern, &name[c.len_utf8()..]))
        }
        Some(wanted) => name.chars().next().is_some_and(|c| {
            (wanted == '?' || wanted == c) && glob(characters.as_str(), &name[c.len_utf8()..])
        }),
    }
}

/// The channel of `what`: the one named, else the usual one if `wanted` and there. All frames must have it, or none.
fn channel(
    what: &str,
    named: Option<&str>,
    usual: &str,
    paths: &[PathBuf],
    headers: &[FrameHeader],
    wanted: bool,
) -> Result<Option<String>> {
    let name = named.unwrap_or(usual);
    let has = |header: &FrameHeader| header.channels.iter().any(|channel| channel == name);
    if named.is_none() && !(wanted && headers.iter().any(has)) {
        return Ok(None);
    }
    if let Some(i) = headers.iter().position(|header| !has(header)) {
        let listed = headers[i].channels.join(", ");
        bail!("{}: no {what} channel `{name}`; it has: {listed}", paths[i].display());
    }
    Ok(Some(name.to_owned()))
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

    #[test]
    fn frame_nine_comes_before_frame_ten() {
        let mut names = ["f10.exr", "f9.exr", "f009b.exr", "f0001.exr"];
        names.sort_by_key(|name| natural(name));
        assert_eq!(names, ["f0001.exr", "f9.exr", "f009b.exr", "f10.exr"]);
    }

    #[test]
    fn patterns_match_whole_names() {
        assert!(glob("key_*.exr", "key_0001.exr"));
        assert!(!glob("key_*.exr", "key_0001.exr.bak"));
        assert!(glob("?.exr", "a.exr") && !glob("?.exr", "ab.exr"));
        assert!(glob("*", "") && !glob("?", ""));
    }
}
