//! What is measured, on what, and what comes of it.

use crate::clock::{Clock, ClockReport};
use crate::document::Document;
use crate::floor::{FORMATS, Rates};
use crate::measure::Amount;
use crate::parts;
use crate::scenes::{FRAME_NS, Feed};
use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use esaac_engine::Device;
use esaac_model::HdrFormat;
use esaac_scene::{Renderer, SceneKind};
use indicatif::ProgressBar;
use serde::Serialize;
use std::cell::{Ref, RefCell};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// A part of the laboratory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// Speed against error of every choice
    Frontier,
    /// Error against the number of sub-steps
    Convergence,
    /// Memory per resolution, beside the paper's
    Memory,
    /// Time per interval, beside the paper's and the floor
    Time,
    /// Time against cameras, pixels, sub-steps, events, motion
    Scale,
    /// Cost of each sensor effect
    Effects,
    /// Packets into ROS messages, from where the device wrote them
    Encode,
    /// Hard cases and a simulated day
    HardCases,
    /// Against a recording of a real sensor
    RealSensor,
    /// The bench itself: noise band, comparators
    Stability,
}

impl Part {
    /// Name on the command line and of its files.
    #[must_use]
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// What is asked for.
#[derive(Clone, Debug)]
pub struct Options {
    /// Less of everything: ends in minutes on a software driver.
    pub quick: bool,
    /// Parts, in order; all if empty.
    pub parts: Vec<Part>,
    /// Only rows whose name contains this.
    pub only: String,
    /// Folder of the path-traced sequence.
    pub tumble: PathBuf,
    /// Recording of a real sensor.
    pub recording: PathBuf,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            quick: false,
            parts: Vec::new(),
            only: String::new(),
            tumble: "../shared/sequences/tumble".into(),
            recording: "../shared/recordings/davis346_emlb_demo01.aedat4".into(),
        }
    }
}

/// The device and what is asked for.
pub struct Laboratory {
    device: Arc<Device>,
    clock: RefCell<Clock>,
    rates: Rates,
    options: Options,
    progress: ProgressBar,
    /// One a format: a software driver takes seconds to compile one.
    renderers: RefCell<Vec<(HdrFormat, Rc<RefCell<Renderer>>)>>,
}

/// What a part gives.
pub struct Outcome {
    /// Its figures.
    pub figures: serde_json::Value,
    /// Its text, tables and plots.
    pub document: Document,
}

/// Figures of a run.
#[derive(Serialize)]
pub struct Report {
    /// Device name.
    pub device: String,
    /// Its kind.
    pub kind: String,
    /// Driver name and version.
    pub driver: String,
    /// Whether less was measured.
    pub quick: bool,
    /// Whether zones for a profiler are built in.
    pub tracy: bool,
    /// What the device can do at most.
    pub rates: Rates,
    /// Whether its clock was steady.
    pub clock: ClockReport,
    /// Figures of each part by name.
    pub parts: serde_json::Map<String, serde_json::Value>,
    /// Document of each part.
    #[serde(skip)]
    pub documents: Vec<(Part, Document)>,
}

impl Laboratory {
    /// A laboratory on a device; bars go to standard error.
    pub fn new(device: Arc<Device>, options: Options) -> Result<Self> {
        let mut clock = Clock::new(&device)?;
        clock.heat()?;
        clock.watch()?;
        let rates = Rates { bytes_per_s: clock.bytes_per_s()?, operations_per_s: clock.operations_per_s()? };
        let progress = ProgressBar::no_length();
        let renderers = RefCell::default();
        Ok(Laboratory { device, clock: RefCell::new(clock), rates, options, progress, renderers })
    }

    /// The device.
    #[must_use]
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Its clock.
    pub fn clock(&self) -> Ref<'_, Clock> {
        self.clock.borrow()
    }

    /// What it can do at most.
    pub fn rates(&self) -> Result<Rates> {
        Ok(self.rates)
    }

    /// What is asked for.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Whether the device is a processor.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.device.is_software()
    }

    /// A scene at 30 Hz, or at another step from frame to frame; motion is [`FORMATS`]'s.
    pub fn feed(&self, kind: SceneKind, size: (u32, u32), hdr: HdrFormat, step_ns: i64) -> Result<Feed> {
        let scene = kind.scene(size.0, size.1);
        let mut renderers = self.renderers.borrow_mut();
        let found = renderers.iter().find(|(of, _)| *of == hdr).map(|(_, renderer)| Rc::clone(renderer));
        let renderer = match found {
            Some(renderer) => renderer,
            None => {
                let made = Renderer::new(&self.device, scene.clone(), hdr, FORMATS.1)?;
                renderers.push((hdr, Rc::new(RefCell::new(made))));
                Rc::clone(&renderers[renderers.len() - 1].1)
            }
        };
        Ok(Feed::Scene(renderer, Box::new(scene), step_ns))
    }

    /// A scene at 30 Hz in [`FORMATS`].
    pub fn scene(&self, kind: SceneKind, size: (u32, u32)) -> Result<Feed> {
        self.feed(kind, size, FORMATS.0, FRAME_NS)
    }

    /// Whether a row of this name is asked for.
    #[must_use]
    pub fn wants(&self, row: &str) -> bool {
        row.contains(&self.options.only)
    }

    /// Intervals for a timing: many on a GPU, few where an interval takes a tenth of a second.
    #[must_use]
    pub fn amount(&self) -> Amount {
        let (warm_up, timed) = match (self.is_software(), self.options.quick) {
            (true, true) => (1, 3),
            (true, false) => (2, 12),
            (false, true) => (6, 20),
            (false, false) => (8, 60),
        };
        Amount { frames: 1 + warm_up + timed, warm_up, passes: 1, keep: 0 }
    }

    /// Goes through rows with a bar.
    pub fn rows<T, R>(
        &self,
        what: &str,
        rows: Vec<T>,
        mut measure: impl FnMut(T) -> Result<R>,
    ) -> Result<Vec<R>> {
        let style = indicatif::ProgressStyle::with_template("{prefix:14} {bar:40} {pos}/{len}, {eta} left")
            .expect("the template is well formed");
        self.progress.set_style(style);
        self.progress.set_length(rows.len() as u64);
        self.progress.set_position(0);
        self.progress.set_prefix(what.to_owned());
        rows.into_iter()
            .map(|row| {
                let measured = measure(row);
                self.progress.inc(1);
                measured
            })
            .collect()
    }
}

/// Runs the parts that are asked for. `after` is given the report after each, so that what is measured is
/// kept whatever becomes of the rest.
pub fn run(laboratory: &Laboratory, mut after: impl FnMut(&Report) -> Result<()>) -> Result<Report> {
    let asked = &laboratory.options.parts;
    let parts: Vec<Part> = match asked.is_empty() {
        true => Part::value_variants().to_vec(),
        false => asked.clone(),
    };
    let info = laboratory.device.info();
    let mut report = Report {
        device: info.name.clone(),
        kind: info.kind.to_owned(),
        driver: info.driver.clone(),
        quick: laboratory.options.quick,
        tracy: cfg!(feature = "tracy"),
        rates: laboratory.rates,
        clock: laboratory.clock().report(),
        parts: serde_json::Map::new(),
        documents: Vec::new(),
    };
    for part in parts {
        let outcome = parts::run(laboratory, part).with_context(|| format!("part `{}`", part.name()))?;
        report.parts.insert(part.name(), outcome.figures);
        report.documents.push((part, outcome.document));
        laboratory.clock.borrow_mut().watch()?;
        report.clock = laboratory.clock().report();
        after(&report)?;
    }
    laboratory.progress.finish_and_clear();
    let messages = laboratory.device.validation_messages();
    ensure!(messages.is_empty(), "the validation layer objects:\n{}", messages.join("\n"));
    Ok(report)
}

/// Writes `bench.json`, `bench.md` and the plots into a folder and gives their paths.
pub fn write(report: &Report, folder: &Path) -> Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make folder {}", folder.display()))?;
    let mut files = vec![
        (folder.join("bench.json"), serde_json::to_string_pretty(report)?),
        (folder.join("bench.md"), markdown(report)),
    ];
    for (_, document) in &report.documents {
        files.extend(document.plots().map(|(name, svg)| (folder.join(name), svg.clone())));
    }
    for (path, text) in &files {
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(files.into_iter().map(|(path, _)| path).collect())
}

/// The whole report as Markdown.
#[must_use]
pub fn markdown(report: &Report) -> String {
    let clock = &report.clock;
    let mut text = format!(
        "# Laboratory\n\n{}, {}{}. Memory {:.0} GB/s, arithmetic {:.2} TFLOP/s (both measured). The clock {} \
         (the same work took {:.1} to {:.1} us).\n",
        report.device,
        report.driver,
        if report.quick { ", quick" } else { "" },
        report.rates.bytes_per_s / 1e9,
        report.rates.operations_per_s / 1e12,
        if clock.steady { "was steady" } else { "WAS NOT STEADY: figures of different parts do not compare" },
        clock.reference_us.iter().copied().fold(f64::INFINITY, f64::min),
        clock.reference_us.iter().copied().fold(0.0, f64::max),
    );
    for (_, document) in &report.documents {
        text.push('\n');
        text.push_str(&document.markdown());
    }
    text
}
