//! What a folder of frames says about the motion of its scene: poses in `sequence.json`, or those of a still scene in
//! nerfstudio's `transforms.json`. The former is written, too.

use crate::frame_time::frame_time_ns;
use anyhow::{Context, Result, anyhow, bail, ensure};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, Projection, SceneMotion};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A pose this near to a key frame, in frames, is at its time.
const AT_KEY_FRAME: f64 = 1e-6;

/// Part of a pose's step by which the last pose may be before the last key frame, whose time it then has: what moves is off by
/// that part of its motion from pose to pose.
const AT_END: f64 = 0.01;

/// `sequence.json`. Keys that are not listed are ignored, but for slips of those that are.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct SequenceFile {
    /// Key frames a second.
    pub key_rate_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    intrinsics: Option<LensEntry>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pose_rate_hz: Option<f64>,
    // Read only where there are intrinsics: without them nobody said what is meant.
    #[serde(skip_serializing_if = "Option::is_none")]
    camera_to_world: Option<serde_json::Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    instances: Option<BTreeMap<String, serde_json::Value>>,
}

/// A lens as `sequence.json` has it. The centre of pixel (i, j) is at (i, j).
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct LensEntry {
    /// [`Projection::Pinhole`] unless it is there.
    #[serde(skip_serializing_if = "Option::is_none")]
    projection: Option<Projection>,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
}

/// `transforms.json`. Its pixels' centres are at halves. Files of NeRF's own have an angle of view, radians, in place of focal
/// lengths.
#[derive(Clone, Debug, Deserialize)]
struct TransformsFile {
    camera_model: Option<String>,
    /// instant-ngp's, which draws such a lens as a pinhole where it has no distortion.
    is_fisheye: Option<bool>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    camera_angle_x: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    frames: Vec<TransformsFrame>,
    #[serde(flatten)]
    others: BTreeMap<String, serde_json::Value>,
}

#[derive(Clone, Debug, Deserialize)]
struct TransformsFrame {
    file_path: String,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    others: BTreeMap<String, serde_json::Value>,
}

/// Parameters of lens distortion in `transforms.json`.
const DISTORTION: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];

/// Parameters that may differ from frame to frame in `transforms.json`, and may not here.
const OF_ALL_FRAMES: [&str; 7] = ["fl_x", "fl_y", "cx", "cy", "camera_model", "camera_angle_x", "is_fisheye"];

/// The motion of a folder's scene.
#[derive(Clone, Debug, PartialEq)]
pub struct FolderScene {
    /// The file it comes from.
    pub file: PathBuf,
    /// Poses.
    pub motion: SceneMotion,
}

/// What the poses must fit.
#[derive(Clone, Copy, Debug)]
pub struct KeyFrames<'a> {
    /// Files, in order of time.
    pub paths: &'a [PathBuf],
    /// Frames a second.
    pub rate_hz: f64,
    /// Width and height.
    pub size_px: (u32, u32),
}

impl KeyFrames<'_> {
    fn time_ns(&self, index: usize) -> i64 {
        frame_time_ns(index, self.rate_hz)
    }
}

/// Puts the last pose to `end_ns` if it is nearly there. Rates are written with some digits, so that an end that was at a frame is
/// told as a little before it.
fn end_at(end_ns: i64, times_ns: &mut [i64]) {
    if let [.., before_ns, last_ns] = times_ns {
        let (missing_ns, step_ns) = (end_ns - *last_ns, *last_ns - *before_ns);
        if missing_ns > 0 && missing_ns as f64 <= AT_END * step_ns as f64 {
            *last_ns = end_ns;
        }
    }
}

/// Time of a pose that is taken `position` key frames after the first.
fn pose_time_ns(position: f64, key_rate_hz: f64) -> i64 {
    let nearest = position.round();
    // Poses at a key frame have its time to the nanosecond, so that they span its interval.
    if (position - nearest).abs() < AT_KEY_FRAME {
        frame_time_ns(nearest as usize, key_rate_hz)
    } else {
        (position * 1e9 / key_rate_hz).round() as i64
    }
}

/// Times of the fewest poses at `pose_rate_hz` that span `keys` key frames.
#[must_use]
pub fn pose_times_ns(keys: usize, key_rate_hz: f64, pose_rate_hz: f64) -> Vec<i64> {
    let keys_per_pose = key_rate_hz / pose_rate_hz;
    let last_key = keys.saturating_sub(1) as f64;
    let last = (last_key / keys_per_pose - AT_KEY_FRAME).ceil().max(0.0) as usize;
    (0..=last).map(|j| pose_time_ns(j as f64 * keys_per_pose, key_rate_hz)).collect()
}

impl SequenceFile {
    /// Reads the folder's file, if there is one.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(Self::NAME);
        let Some(text) = read_text(&path)? else { return Ok(None) };
        let file: Self = parsed(&text).with_context(|| path.display().to_string())?;
        let keys: BTreeMap<String, serde::de::IgnoredAny> = parsed(&text)?;
        let keys: Vec<&str> = keys.keys().map(String::as_str).collect();
        no_slip(&keys)
            .and_then(|()| nothing_beside(&file, &keys))
            .with_context(|| path.display().to_string())?;
        Ok(Some(file))
    }

    /// Keys of the file that are read.
    const KEYS: [&str; 5] = ["key_rate_hz", "intrinsics", "pose_rate_hz", "camera_to_world", "instances"];

    /// Name of the file.
    pub const NAME: &str = "sequence.json";

    /// The file of key frames whose scene moves like `motion`, with poses at [`pose_times_ns`].
    #[must_use]
    pub fn new(motion: &SceneMotion, key_rate_hz: f64, pose_rate_hz: f64) -> Self {
        let matrices = |track: &PoseTrack| {
            let rows: Vec<[[f64; 4]; 4]> = track.poses().iter().map(Pose::to_rows).collect();
            serde_json::json!(rows)
        };
        let lens = motion.lens();
        let (focal_px, centre_px) = (lens.focal_px(), lens.centre_px());
        let (fx, fy, cx, cy) = (focal_px.x, focal_px.y, centre_px.x, centre_px.y);
        let instances = motion.ids().filter_map(|id| Some((id.to_string(), matrices(motion.instance(id)?))));
        SequenceFile {
            key_rate_hz: Some(key_rate_hz),
            intrinsics: Some(LensEntry { projection: Some(lens.projection()), fx, fy, cx, cy }),
            pose_rate_hz: Some(pose_rate_hz),
            camera_to_world: Some(matrices(motion.camera())),
            instances: Some(instances.collect()),
        }
    }

    /// Whether there are poses of a camera without a lens. They are not read: nobody said what they mean.
    #[must_use]
    pub fn lacks_lens(&self) -> bool {
        self.intrinsics.is_none() && self.camera_to_world.is_some()
    }

    /// The poses, if there are any.
    fn motion(&self, keys: &KeyFrames<'_>) -> Result<Option<SceneMotion>> {
        let Some(lens) = &self.intrinsics else {
            ensure!(self.instances.is_none(), "`instances` without `intrinsics`, expected both");
            return Ok(None);
        };
        let projection = lens.projection.unwrap_or_default();
        let lens = Intrinsics::new(projection, lens.fx, lens.fy, lens.cx, lens.cy).context("`intrinsics`")?;
        let camera = self.camera_to_world.as_ref().context("`intrinsics` without `camera_to_world`")?;
        let camera = poses("camera_to_world", camera)?;
        let pose_rate_hz = self.pose_rate_hz.context("`camera_to_world` without `pose_rate_hz`")?;
        ensure!(
            pose_rate_hz.is_finite() && pose_rate_hz > 0.0,
            "`pose_rate_hz` is {pose_rate_hz}, expected a positive number"
        );
        // A sequence that is played at another rate takes its poses along.
        let keys_per_pose = self.key_rate_hz.unwrap_or(keys.rate_hz) / pose_rate_hz;
        let track = |poses: Vec<Pose>| {
            let time_ns = |j| pose_time_ns(j as f64 * keys_per_pose, keys.rate_hz);
            let mut times_ns: Vec<i64> = (0..poses.len()).map(time_ns).collect();
            end_at(keys.time_ns(keys.paths.len().saturating_sub(1)), &mut times_ns);
            PoseTrack::new(times_ns, poses)
        };
        let count = camera.len();
        let mut motion = SceneMotion::new(lens, track(camera).context("`camera_to_world`")?);
        for (name, matrices) in self.instances.iter().flatten() {
            let id = name.parse().map_err(|_| anyhow!("instance `{name}`, expected an id from 1"))?;
            let poses = poses(&format!("instances.{name}"), matrices)?;
            ensure!(
                poses.len() == count || poses.len() == 1 || count == 1,
                "instance {name} has {} poses, expected {count} like `camera_to_world`, or 1",
                poses.len()
            );
            motion.insert(id, track(poses).with_context(|| format!("instance {name}"))?)?;
        }
        Ok(Some(motion))
    }
}

impl TransformsFile {
    const NAME: &str = "transforms.json";

    fn motion(&self, keys: &KeyFrames<'_>) -> Result<SceneMotion> {
        let projection = self.projection()?;
        no_distortion(&self.others)?;
        let (width_px, height_px) = keys.size_px;
        for (name, given, expected) in [("w", self.w, width_px), ("h", self.h, height_px)] {
            if let Some(given) = given {
                ensure!(
                    given == f64::from(expected),
                    "`{name}` is {given}, expected {expected} like the frames"
                );
            }
        }
        let mut by_stem: BTreeMap<&str, &TransformsFrame> = BTreeMap::new();
        for frame in &self.frames {
            if let Some(before) = by_stem.insert(stem(&frame.file_path), frame) {
                bail!(
                    "frames {} and {} have one name, expected each once",
                    before.file_path,
                    frame.file_path
                );
            }
        }
        let (mut times_ns, mut poses) = (Vec::new(), Vec::new());
        for (index, path) in keys.paths.iter().enumerate() {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let frame = by_stem.get(stem(&name)).with_context(|| {
                format!("no frame is named like {name}, expected one in `frames` (whatever its ending)")
            })?;
            if let Some(own) = OF_ALL_FRAMES.iter().find(|own| frame.others.contains_key(**own)) {
                bail!("frame {} has its own `{own}`, expected one lens for all frames", frame.file_path);
            }
            no_distortion(&frame.others).with_context(|| format!("frame {}", frame.file_path))?;
            let rows = &frame.transform_matrix;
            let shape = || {
                let lengths = rows.iter().map(Vec::len).collect::<Vec<_>>();
                format!("frame {}: `transform_matrix` has rows of {lengths:?} numbers", frame.file_path)
            };
            // Some writers leave out the last row.
            ensure!(
                matches!(rows.len(), 3 | 4) && rows.iter().all(|row| row.len() == 4),
                "{}, expected 4 rows of 4",
                shape()
            );
            let mut matrix = [[0.0, 0.0, 0.0, 1.0]; 4];
            for (to, from) in matrix.iter_mut().zip(rows) {
                to.copy_from_slice(from);
            }
            let pose = Pose::from_rows(&matrix)
                .with_context(|| format!("frame {}: `transform_matrix`", frame.file_path))?;
            times_ns.push(keys.time_ns(index));
            poses.push(pose);
        }
        let lens = self.lens(projection, keys.size_px)?;
        Ok(SceneMotion::new(lens, PoseTrack::new(times_ns, poses)?))
    }

    fn projection(&self) -> Result<Projection> {
        let is_fisheye = self.is_fisheye == Some(true);
        match self.camera_model.as_deref() {
            Some("OPENCV_FISHEYE") => Ok(Projection::Fisheye),
            None | Some("OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE") if is_fisheye => bail!(
                "`is_fisheye` is true and `camera_model` is {}, expected OPENCV_FISHEYE for an equidistant fisheye, or no \
                 `is_fisheye` for a pinhole",
                self.camera_model.as_deref().unwrap_or("missing")
            ),
            None | Some("OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE") => Ok(Projection::Pinhole),
            Some(model) => bail!("`camera_model` is {model}, expected OPENCV, OPENCV_FISHEYE or PINHOLE"),
        }
    }

    /// What is left out is that of square pixels around the middle of the image.
    fn lens(&self, projection: Projection, size_px: (u32, u32)) -> Result<Intrinsics> {
        let (width_px, height_px) = (f64::from(size_px.0), f64::from(size_px.1));
        let angle = self.camera_angle_x.filter(|_| projection == Projection::Pinhole);
        let by_angle = angle.map(|angle| 0.5 * width_px / (0.5 * angle).tan());
        let fx_px =
            self.fl_x.or(by_angle).context("no `fl_x`, expected it or, of a pinhole, `camera_angle_x`")?;
        let (cx_px, cy_px) = (self.cx.unwrap_or(0.5 * width_px), self.cy.unwrap_or(0.5 * height_px));
        Ok(Intrinsics::new(projection, fx_px, self.fl_y.unwrap_or(fx_px), cx_px - 0.5, cy_px - 0.5)?)
    }
}

/// Fails if a lens has distortion that is not 0.
fn no_distortion(parameters: &BTreeMap<String, serde_json::Value>) -> Result<()> {
    for (name, value) in DISTORTION.iter().filter_map(|name| Some((name, parameters.get(*name)?))) {
        ensure!(
            value.as_f64() == Some(0.0),
            "the lens has distortion ({name} is {value}), expected none: undistort the frames first"
        );
    }
    Ok(())
}

impl FolderScene {
    /// The poses of the folder's frames, if it has any. `sequence` is its `sequence.json`.
    pub fn read(
        folder: &Path,
        sequence: Option<&SequenceFile>,
        keys: &KeyFrames<'_>,
    ) -> Result<Option<Self>> {
        let sequence_path = folder.join(SequenceFile::NAME);
        let of_sequence = match sequence {
            Some(sequence) => sequence.motion(keys).with_context(|| sequence_path.display().to_string())?,
            None => None,
        };
        let transforms_path = folder.join(TransformsFile::NAME);
        let transforms: Option<TransformsFile> = read_json(&transforms_path)?;
        let scene = match (of_sequence, transforms) {
            (None, None) => return Ok(None),
            (Some(motion), None) => FolderScene { file: sequence_path, motion },
            (None, Some(transforms)) => {
                let motion =
                    transforms.motion(keys).with_context(|| transforms_path.display().to_string())?;
                FolderScene { file: transforms_path, motion }
            }
            (Some(_), Some(_)) => bail!(
                "{} and {} both have the camera's poses, expected one of them",
                sequence_path.display(),
                transforms_path.display()
            ),
        };
        let (start_ns, end_ns) = (keys.time_ns(0), keys.time_ns(1));
        let first = scene.motion.check_span(start_ns, end_ns);
        first.with_context(|| format!("{}: the first interval has no poses", scene.file.display()))?;
        Ok(Some(scene))
    }
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    let Some(text) = read_text(path)? else { return Ok(None) };
    parsed(&text).map(Some).with_context(|| path.display().to_string())
}

/// The file's text, if there is one.
fn read_text(path: &Path) -> Result<Option<String>> {
    if !path.exists() {
        return Ok(None);
    }
    std::fs::read_to_string(path).map(Some).with_context(|| format!("cannot read {}", path.display()))
}

fn parsed<T: DeserializeOwned>(text: &str) -> Result<T> {
    let bytes = text.len();
    // A list could be taken for the values of the keys.
    if let Some(first) = text.trim_start().chars().next().filter(|first| *first != '{') {
        bail!("the file begins with `{}`, expected a JSON object, `{{...}}`", first.escape_debug());
    }
    serde_json::from_str(text).map_err(|error| {
        let (cut, no_number) = (error.is_eof(), no_number_at(text, error.line(), error.column()));
        let error = anyhow::Error::new(error);
        match no_number {
            Some(word) => error.context(format!("`{word}` is no JSON, expected a number")),
            None if cut => error.context(format!("the file ends too early, after {bytes} bytes")),
            None => error,
        }
    })
}

/// What Python writes for a number that JSON does not have, if it stands at a line and a column, which count from 1.
fn no_number_at(text: &str, line: usize, column: usize) -> Option<&'static str> {
    let rest = text.lines().nth(line.checked_sub(1)?)?.get(column.checked_sub(1)?..)?;
    ["NaN", "Infinity"].into_iter().find(|word| rest.starts_with(word))
}

/// Fails if a key is nearly one of [`SequenceFile::KEYS`] that is missing: without it, frames would silently have another
/// rate, or no poses.
fn no_slip(keys: &[&str]) -> Result<()> {
    let is_known = |key: &&&str| SequenceFile::KEYS.contains(*key);
    for key in keys.iter().filter(|key| !is_known(key)) {
        let meant = SequenceFile::KEYS.iter().filter(|known| !keys.contains(*known));
        let meant = meant.min_by_key(|known| strsim::damerau_levenshtein(key, known));
        let near = |known: &&&str| strsim::damerau_levenshtein(key, known) <= MOST_SLIPS;
        if let Some(known) = meant.filter(near) {
            bail!("`{key}` is no key that is read; `{known}` is missing, and is probably meant");
        }
    }
    Ok(())
}

/// Fails if the lens's projection stands beside the lens, whose default would silently take its place.
fn nothing_beside(file: &SequenceFile, keys: &[&str]) -> Result<()> {
    let says_projection = file.intrinsics.as_ref().is_none_or(|lens| lens.projection.is_some());
    let beside = keys.iter().find(|key| strsim::damerau_levenshtein(key, "projection") <= MOST_SLIPS_BESIDE);
    match beside {
        Some(key) if !says_projection => {
            bail!("`{key}` stands beside `intrinsics`, where it is not read; expected `projection` in it")
        }
        _ => Ok(()),
    }
}

/// As [`MOST_SLIPS`], of a key that may be another's, such as `projector`.
const MOST_SLIPS_BESIDE: usize = 1;

/// So many letters wrong, missing or too many make a key a slip of another. `key_rate` lacks three of `key_rate_hz`.
const MOST_SLIPS: usize = 3;

/// Poses from a list of 4x4 matrices.
fn poses(name: &str, matrices: &serde_json::Value) -> Result<Vec<Pose>> {
    let list: Vec<serde_json::Value> =
        Deserialize::deserialize(matrices).with_context(|| format!("`{name}`"))?;
    let pose = |matrix| -> Result<Pose> {
        let rows: [[f64; 4]; 4] = serde_json::from_value(matrix)?;
        Ok(Pose::from_rows(&rows)?)
    };
    list.into_iter()
        .enumerate()
        .map(|(j, matrix)| {
            pose(matrix).with_context(|| format!("`{name}[{j}]`, expected a rigid 4x4 matrix"))
        })
        .collect()
}

/// The name of a file without folder and ending.
fn stem(path: &str) -> &str {
    let name = path.rsplit(['/', '\\']).next().unwrap_or(path);
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}
