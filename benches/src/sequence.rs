//! A rendered sequence: key frames with motion vectors and the true events of the same camera.
//!
//! A folder holds `key_0000.exr`, `key_0001.exr`, ..., `sequence.json` with `key_rate_hz`, and `truth.npz`
//! ([`truth_file`]). A key frame has the channels `R G B motion.X motion.Y`; the motion of a pixel added to its position
//! is its previous position, y down. `tests/data/tumble` is one. The example `true_events` makes `truth.npz` from frames
//! at a high rate.

use crate::scenes::StoredFrame;
use anyhow::{Context, Result, ensure};
use esaac_formats::exr_frame::{ChannelNames, FrameHeader, FrameLayout, read_frame, read_header};
use esaac_formats::truth_file::{self, TruthFile};
use esaac_model::HdrFormat;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A sequence's folder, with its truth read into memory.
pub struct Sequence {
    /// Name of the folder.
    pub name: String,
    /// Sensor, true events, and the time up to which they are known.
    pub truth: TruthFile,
    keys: Vec<(i64, PathBuf)>,
}

#[derive(Deserialize)]
struct SequenceFile {
    key_rate_hz: f64,
}

impl Sequence {
    /// Reads the rate and the truth, and lists the key frames within the truth.
    pub fn open(folder: &Path) -> Result<Self> {
        ensure!(folder.is_dir(), "there is no folder {}", folder.display());
        let path = folder.join("sequence.json");
        let text =
            std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let SequenceFile { key_rate_hz } =
            serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        ensure!(
            (1.0..=1e6).contains(&key_rate_hz),
            "{}: key_rate_hz is {key_rate_hz}, expected 1 to 1000000",
            path.display()
        );
        let truth = truth_file::read(&folder.join("truth.npz"))?;
        let keys: Vec<(i64, PathBuf)> = (0..)
            .map(|k| {
                ((f64::from(k) * 1e9 / key_rate_hz).round() as i64, folder.join(format!("key_{k:04}.exr")))
            })
            .take_while(|(t_ns, path)| *t_ns <= truth.end_ns && path.is_file())
            .collect();
        ensure!(
            keys.len() >= 2,
            "{} has {} key frames within the truth's {} ns, expected at least 2",
            folder.display(),
            keys.len(),
            truth.end_ns
        );
        let name = folder.canonicalize()?.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Sequence { name, truth, keys })
    }

    /// Intervals between key frames.
    #[must_use]
    pub fn intervals(&self) -> usize {
        self.keys.len() - 1
    }

    /// Decodes the key frames, with colour in `hdr` and motion as f32x2.
    pub fn frames(&self, hdr: HdrFormat) -> Result<Vec<StoredFrame>> {
        let names = ChannelNames {
            colour: ["R", "G", "B"].map(str::to_owned),
            motion: ["motion.X", "motion.Y"].map(str::to_owned),
        };
        let sensor = &self.truth.sensor;
        self.keys
            .iter()
            .map(|(t_ns, path)| {
                let header: FrameHeader = read_header(path, &names)?;
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
                let layout = FrameLayout { hdr, ..FrameLayout::new(&header, &names, [1.0; 2]) };
                let images = read_frame(path, &layout)?;
                Ok(StoredFrame { t_ns: *t_ns, hdr: images.hdr, motion: images.motion })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn a_folder_that_is_no_sequence_is_an_error_that_says_why() {
        let error = |folder: &Path| format!("{:#}", Sequence::open(folder).err().expect("no sequence"));
        assert!(error(Path::new("/nonesuch")).contains("there is no folder /nonesuch"));
        let folder = tempfile::tempdir().unwrap();
        assert!(error(folder.path()).contains("sequence.json"));
        let describe = |text: &str| std::fs::write(folder.path().join("sequence.json"), text).unwrap();
        describe("{\"key_rate_hz\": 0}");
        assert!(error(folder.path()).contains("key_rate_hz is 0, expected 1 to 1000000"));
        describe("{\"key_rate_hz\": 30}");
        assert!(error(folder.path()).contains("truth.npz"));
        std::fs::copy(tumble().join("truth.npz"), folder.path().join("truth.npz")).unwrap();
        assert!(error(folder.path()).contains("0 key frames within the truth's 100000000 ns"));
    }
}
