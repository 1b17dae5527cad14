//! Makes `truth.npz` from frames at a high rate:
//! `cargo run --release -p esaac-benches --example true_events -- DIR OUT.npz`.
//!
//! DIR holds `truth_0000.exr`, `truth_0001.exr`, ... (channels `R G B`, linear radiance) and `sequence.json` with
//! `truth_rate_hz`. The events are those of the oracle's definition of truth: each frame's log luminance,
//! straight in time between frames, at thresholds of .2 and a `log_offset` of .01.

use anyhow::{Context, Result, ensure};
use esaac_formats::exr_frame::{ChannelNames, FrameLayout, read_frame, read_header};
use esaac_formats::truth_file::{self, TruthFile};
use esaac_model::intensity::REC709;
use esaac_model::{HdrFormat, SensorModel, SubstepPolicy, Synthesis};
use esaac_oracle::truth;
use std::path::{Path, PathBuf};

fn main() -> Result<()> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [folder, out] = &arguments[..] else {
        anyhow::bail!("{} arguments, expected 2: a folder of frames and the file to write", arguments.len());
    };
    let truth = true_events(folder)?;
    let file = std::fs::File::create(out).with_context(|| format!("cannot write {}", out.display()))?;
    truth_file::write(std::io::BufWriter::new(file), &truth)?;
    println!("{} events in {} ns to {}", truth.events.len(), truth.end_ns, out.display());
    Ok(())
}

fn true_events(folder: &Path) -> Result<TruthFile> {
    let path = folder.join("sequence.json");
    let text = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let description: serde_json::Value = serde_json::from_str(&text)?;
    let rate_hz = description["truth_rate_hz"]
        .as_f64()
        .with_context(|| format!("{} states no truth_rate_hz", path.display()))?;
    let names = ChannelNames::default();
    let mut size = None;
    let mut frames: Vec<(i64, Vec<f64>)> = Vec::new();
    for k in 0.. {
        let path = folder.join(format!("truth_{k:04}.exr"));
        if !path.is_file() {
            break;
        }
        let header = read_header(&path, &names)?;
        let this = (header.width_px, header.height_px);
        ensure!(*size.get_or_insert(this) == this, "{}: {this:?} px, expected {size:?}", path.display());
        let layout = FrameLayout {
            hdr: HdrFormat::F32x4,
            motion: None,
            ..FrameLayout::new(&header, &names, [1.0; 2])
        };
        let hdr = read_frame(&path, &layout)?.hdr;
        let luminance = |texel: usize| -> f64 {
            let [r, g, b] = HdrFormat::F32x4.decode(&hdr, texel);
            REC709.iter().zip([r, g, b]).map(|(weight, value)| weight * value).sum()
        };
        let pixels = this.0 as usize * this.1 as usize;
        frames.push(((f64::from(k) * 1e9 / rate_hz).round() as i64, (0..pixels).map(luminance).collect()));
    }
    let (width, height) = size.with_context(|| format!("{} has no truth_0000.exr", folder.display()))?;
    let sensor = SensorModel {
        width,
        height,
        contrast_on: 0.2,
        contrast_off: 0.2,
        log_offset: 0.01,
        synthesis: Synthesis::None,
        substep_policy: SubstepPolicy::Fixed,
        ..SensorModel::default()
    };
    let events = truth::events(&sensor, 0, frames.iter().map(|(t_ns, frame)| (*t_ns, &frame[..])))?;
    // The file's sensor is for the simulation, so it has the default synthesis and not the one that made the truth.
    let sensor = SensorModel {
        synthesis: SensorModel::default().synthesis,
        substep_policy: SensorModel::default().substep_policy,
        ..sensor
    };
    let end_ns = frames.last().map_or(0, |(t_ns, _)| *t_ns);
    Ok(TruthFile { sensor, end_ns, events })
}
