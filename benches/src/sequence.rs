//! A rendered sequence: key frames with motion vectors and the true events of the same camera.
//!
//! A folder holds `key_0000.exr`, `key_0001.exr`, ..., `sequence.json` with `key_rate_hz`, and `truth.npz`, compact
//! ([`truth_file`]) or a recording's columns. A key frame has the channels `R G B motion.X motion.Y`; the motion of a pixel added to its position
//! is its previous position, y down. With poses in `sequence.json` ([`scene_file`](esaac_formats::scene_file)) it has
//! `depth.Z`, and `id` if something moves. `tests/data/tumble` is a sequence without poses; `esaac render --truth`
//! writes some with poses. The example `true_events` makes `truth.npz` from frames at a high rate.

use crate::scenes::StoredFrame;
use anyhow::{Context, Result, bail, ensure};
use esaac_formats::exr_frame::{
    ChannelNames, DEPTH_CHANNEL, FrameHeader, FrameLayout, ID_CHANNEL, read_frame, read_header,
};
use esaac_formats::frame_time::frame_time_ns;
use esaac_formats::scene_file::{FolderScene, KeyFrames, SequenceFile};
use esaac_formats::truth_file::{self, TruthFile};
use esaac_model::paths::{PoseTrack, SceneMotion, TrackError};
use esaac_model::{HdrFormat, SensorModel};
use std::path::{Path, PathBuf};

/// A sequence's folder, with its truth read into memory.
pub struct Sequence {
    /// Name of the folder.
    pub name: String,
    /// Sensor, true events, and the time up to which they are known.
    pub truth: TruthFile,
    /// Format of its colour: half floats, or floats if a frame has some.
    pub hdr: HdrFormat,
    keys: Vec<(i64, PathBuf)>,
    motion: Option<SceneMotion>,
}

impl Sequence {
    /// Reads the rate and the truth, lists the key frames within the truth, and checks their headers.
    pub fn open(folder: &Path) -> Result<Self> {
        ensure!(folder.is_dir(), "there is no folder {}", folder.display());
        let path = folder.join(SequenceFile::NAME);
        let file = SequenceFile::read(folder)?.with_context(|| format!("there is no {}", path.display()))?;
        let key_rate_hz =
            file.key_rate_hz.with_context(|| format!("{} has no key_rate_hz", path.display()))?;
        ensure!(
            (1.0..=1e6).contains(&key_rate_hz),
            "{}: key_rate_hz is {key_rate_hz}, expected 1 to 1000000",
            path.display()
        );
        let mut keys: Vec<(i64, PathBuf)> = (0..)
            .map(|k| (frame_time_ns(k, key_rate_hz), folder.join(format!("key_{k:04}.exr"))))
            .take_while(|(_, path)| path.is_file())
            .collect();
        let (last_ns, first_path) = match (keys.first(), keys.last()) {
            (Some((_, first)), Some((last_ns, _))) => (*last_ns, first.clone()),
            _ => bail!("{} has no key frames, expected key_0000.exr and so on", folder.display()),
        };
        let first = read_header(&first_path, &ChannelNames::default())?;
        let size_px = (first.width_px, first.height_px);
        let truth = truth_file::read_of_frames(&folder.join("truth.npz"), size_px, last_ns)?;
        keys.retain(|(t_ns, _)| *t_ns <= truth.end_ns);
        ensure!(
            keys.len() >= 2,
            "{} has {} key frames within the truth's {} ns, expected at least 2",
            folder.display(),
            keys.len(),
            truth.end_ns
        );
        let mut hdr = HdrFormat::F16x4;
        for (_, path) in &keys {
            if !checked_header(path, &truth.sensor)?.half_colour {
                hdr = HdrFormat::F32x4;
            }
        }
        let name = folder.canonicalize()?.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let paths: Vec<PathBuf> = keys.iter().map(|(_, path)| path.clone()).collect();
        let described = KeyFrames { paths: &paths, rate_hz: key_rate_hz, size_px };
        let motion = FolderScene::read(folder, Some(&file), &described)?.map(|scene| scene.motion);
        if let Some(motion) = &motion {
            let last_ns = keys[keys.len() - 1].0;
            motion.check_span(0, last_ns).with_context(|| path.display().to_string())?;
        }
        Ok(Sequence { name, truth, hdr, keys, motion })
    }

    /// The motion of what it shows, with every `step`-th of its poses. `None` if it has no poses, or if those do not
    /// span the key frames.
    #[must_use]
    pub fn motion(&self, step: usize) -> Option<SceneMotion> {
        let thinned = |track: &PoseTrack| -> Result<PoseTrack, TrackError> {
            let times_ns = track.times_ns().iter().step_by(step).copied().collect();
            PoseTrack::new(times_ns, track.poses().iter().step_by(step).copied().collect())
        };
        let motion = self.motion.as_ref()?;
        let mut all = SceneMotion::new(*motion.lens(), thinned(motion.camera()).ok()?);
        for id in motion.ids() {
            all.insert(id, thinned(motion.instance(id)?).ok()?).ok()?;
        }
        let last_ns = self.keys[self.keys.len() - 1].0;
        all.check_span(0, last_ns).is_ok().then_some(all)
    }

    /// Poses of the camera a second, if there are some.
    #[must_use]
    pub fn pose_rate_hz(&self) -> Option<f64> {
        let times_ns = self.motion.as_ref()?.camera().times_ns();
        let span_ns = times_ns.last()? - times_ns.first()?;
        (span_ns > 0).then(|| (times_ns.len() - 1) as f64 * 1e9 / span_ns as f64)
    }

    /// Intervals between key frames.
    #[must_use]
    pub fn intervals(&self) -> usize {
        self.keys.len() - 1
    }

    /// Decodes the key frames, with colour in `hdr` (its own format or floats) and motion as f32x2; with depth as f32 and
    /// ids as u32 if there are poses.
    pub fn frames(&self, hdr: HdrFormat) -> Result<Vec<StoredFrame>> {
        let names = ChannelNames::default();
        self.keys
            .iter()
            .map(|(t_ns, path)| {
                let header = checked_header(path, &self.truth.sensor)?;
                let with_ids = header.channels.iter().any(|channel| channel == ID_CHANNEL);
                let layout = FrameLayout {
                    hdr,
                    depth: self.motion.as_ref().map(|_| DEPTH_CHANNEL.to_owned()),
                    ids: self.motion.as_ref().filter(|_| with_ids).map(|_| ID_CHANNEL.to_owned()),
                    ..FrameLayout::new(&header, &names, [1.0; 2])
                };
                let images = read_frame(path, &layout)?;
                let bytes = |depth: Vec<f32>| depth.into_iter().flat_map(f32::to_le_bytes).collect();
                // Without ids all is the static world.
                let none = vec![0; header.width_px as usize * header.height_px as usize];
                let ids = images.ids.unwrap_or(none).into_iter().flat_map(u32::to_le_bytes).collect();
                Ok(StoredFrame {
                    t_ns: *t_ns,
                    hdr: images.hdr,
                    motion: images.motion,
                    depth: images.depth.map(bytes),
                    ids: self.motion.as_ref().map(|_| ids),
                })
            })
            .collect()
    }
}

/// The header of a key frame, which must have the sensor's size, and motion.
fn checked_header(path: &Path, sensor: &SensorModel) -> Result<FrameHeader> {
    let header = read_header(path, &ChannelNames::default())?;
    ensure!(
        (header.width_px, header.height_px) == (sensor.width, sensor.height) && header.has_motion,
        "{}: {}x{} px, motion {}; expected {}x{} px with motion",
        path.display(),
        header.width_px,
        header.height_px,
        header.has_motion,
        sensor.width,
        sensor.height
    );
    Ok(header)
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_formats::event_file::{EventColumns, write_npz};
    use esaac_formats::exr_frame::FrameImages;
    use esaac_formats::exr_writer::write_frame;
    use esaac_formats::scene_file::pose_times_ns;
    use esaac_model::MotionFormat;
    use esaac_scene::{SceneKind, render_cpu};

    fn tumble() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/tumble")
    }

    #[test]
    fn a_sequence_has_the_key_frames_that_its_truth_covers() {
        let sequence = Sequence::open(&tumble()).unwrap();
        assert_eq!((sequence.name.as_str(), sequence.intervals()), ("tumble", 3));
        assert_eq!(sequence.truth.events.len(), 732_132);
        let pixels = sequence.truth.sensor.pixels();
        for hdr in [HdrFormat::F16x4, HdrFormat::F32x4] {
            let frames = sequence.frames(hdr).unwrap();
            let times_ns: Vec<i64> = frames.iter().map(|frame| frame.t_ns).collect();
            assert_eq!(times_ns, [0, 33_333_333, 66_666_667, 100_000_000]);
            for frame in &frames {
                assert_eq!(frame.hdr.len(), pixels * hdr.texel_bytes());
                assert_eq!(frame.motion.as_ref().map(Vec::len), Some(8 * pixels));
            }
        }
    }

    /// A scene of three frames with poses at 960 Hz, with colour in `hdr`.
    fn posed(hdr: HdrFormat) -> tempfile::TempDir {
        let scene = SceneKind::Propeller.scene(24, 18);
        let folder = tempfile::tempdir().unwrap();
        let create = |name: &str| std::fs::File::create(folder.path().join(name)).unwrap();
        let layout = FrameLayout {
            width_px: 24,
            height_px: 18,
            names: ChannelNames::default(),
            hdr,
            motion: Some(MotionFormat::F32x2),
            motion_factors: [1.0; 2],
            depth: Some(DEPTH_CHANNEL.to_owned()),
            ids: Some(ID_CHANNEL.to_owned()),
        };
        for k in 0..3 {
            let t_ns = frame_time_ns(k, 30.0);
            let frame = render_cpu(&scene, t_ns, Some(t_ns - 33_333_333), layout.hdr, MotionFormat::F32x2);
            let images = FrameImages {
                depth: Some(bytemuck::pod_collect_to_vec(&frame.depth)),
                ids: Some(bytemuck::pod_collect_to_vec(&frame.ids)),
                hdr: frame.hdr,
                motion: Some(frame.motion),
            };
            write_frame(create(&format!("key_{k:04}.exr")), &layout, &images).unwrap();
        }
        let motion = scene.scene_motion(&pose_times_ns(3, 30.0, 960.0));
        let text = serde_json::to_string(&SequenceFile::new(&motion, 30.0, 960.0)).unwrap();
        std::fs::write(folder.path().join("sequence.json"), text).unwrap();
        let sensor = SensorModel { width: 24, height: 18, ..SensorModel::default() };
        let truth = TruthFile { sensor, end_ns: 66_666_667, events: Vec::new() };
        truth_file::write(create("truth.npz"), &truth).unwrap();
        folder
    }

    #[test]
    fn a_sequence_with_poses_has_depth_ids_and_as_many_poses_as_are_asked_for() {
        let folder = posed(HdrFormat::F16x4);
        let sequence = Sequence::open(folder.path()).unwrap();
        assert!((sequence.pose_rate_hz().unwrap() - 960.0).abs() < 1e-3);
        let poses = |step| sequence.motion(step).map(|motion| motion.camera().poses().len());
        // Every seventh of 65 ends before the last frame.
        assert_eq!([1, 4, 16, 7].map(poses), [Some(65), Some(17), Some(5), None]);
        let frames = sequence.frames(HdrFormat::F16x4).unwrap();
        for frame in &frames {
            let bytes = |image: &Option<Vec<u8>>| image.as_ref().map(Vec::len);
            assert_eq!((bytes(&frame.depth), bytes(&frame.ids)), (Some(24 * 18 * 4), Some(24 * 18 * 4)));
        }
        let blades = |ids: &Option<Vec<u8>>| ids.as_ref().is_some_and(|ids| ids.iter().any(|&id| id > 0));
        assert!(frames.iter().all(|frame| blades(&frame.ids)));
        let tumble = Sequence::open(&tumble()).unwrap();
        assert_eq!((tumble.motion(1), tumble.pose_rate_hz()), (None, None));
        assert!(tumble.frames(HdrFormat::F16x4).unwrap().iter().all(|frame| frame.depth.is_none()));
    }

    #[test]
    fn a_sequence_of_floats_is_read_as_floats() {
        let folder = posed(HdrFormat::F32x4);
        let sequence = Sequence::open(folder.path()).unwrap();
        assert_eq!(
            (sequence.hdr, Sequence::open(&tumble()).unwrap().hdr),
            (HdrFormat::F32x4, HdrFormat::F16x4)
        );
        let frames = sequence.frames(sequence.hdr).unwrap();
        assert!(frames.iter().all(|frame| frame.hdr.len() == 24 * 18 * 16));
        // A single frame of half floats does not make the others so.
        let halves = posed(HdrFormat::F16x4);
        std::fs::copy(halves.path().join("key_0001.exr"), folder.path().join("key_0001.exr")).unwrap();
        let sequence = Sequence::open(folder.path()).unwrap();
        assert_eq!(sequence.hdr, HdrFormat::F32x4);
        assert!(sequence.frames(sequence.hdr).is_ok());
    }

    #[test]
    fn a_truth_from_elsewhere_needs_the_columns_of_events_alone() {
        let folder = posed(HdrFormat::F16x4);
        let path = folder.path().join("truth.npz");
        let columns =
            EventColumns { x: vec![3], y: vec![17], t_ns: vec![40_000_000], sign: vec![1], ids: None };
        let write = |sensor: &SensorModel| {
            write_npz(std::fs::File::create(&path).unwrap(), &columns, &sensor.to_toml()).unwrap();
        };
        write(&SensorModel { width: 24, height: 18, contrast_on: 0.3, ..SensorModel::default() });
        let truth = Sequence::open(folder.path()).unwrap().truth;
        assert_eq!((truth.events.len(), truth.end_ns, truth.sensor.contrast_on), (1, 66_666_667, 0.3));
        write(&SensorModel { width: 24, height: 20, ..SensorModel::default() });
        let error = format!("{:#}", Sequence::open(folder.path()).err().expect("another size"));
        assert!(error.contains("key_0000.exr: 24x18 px") && error.contains("expected 24x20 px"), "{error}");
    }

    #[test]
    fn a_folder_that_is_no_sequence_is_an_error_that_says_why() {
        let error = |folder: &Path| format!("{:#}", Sequence::open(folder).err().expect("no sequence"));
        assert!(error(Path::new("/nonesuch")).contains("there is no folder /nonesuch"));
        let folder = tempfile::tempdir().unwrap();
        assert!(error(folder.path()).contains("sequence.json"));
        std::fs::write(folder.path().join("sequence.json"), "{}").unwrap();
        assert!(error(folder.path()).contains("sequence.json has no key_rate_hz"));
        let describe = |text: &str| std::fs::write(folder.path().join("sequence.json"), text).unwrap();
        describe("{\"key_rate_hz\": 0}");
        assert!(error(folder.path()).contains("key_rate_hz is 0, expected 1 to 1000000"));
        describe("{\"key_rate_hz\": 30}");
        assert!(error(folder.path()).contains("has no key frames, expected key_0000.exr"));
        let copy = |name: &str| std::fs::copy(tumble().join(name), folder.path().join(name)).unwrap();
        copy("key_0000.exr");
        assert!(error(folder.path()).contains("truth.npz"));
        copy("truth.npz");
        assert!(error(folder.path()).contains("1 key frames within the truth's 100000000 ns"));
    }
}
