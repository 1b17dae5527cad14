//! The laboratory: the device, its clock, and the options of a run.

use crate::amount::Amount;
use crate::clock::Clock;
use crate::floor::{FORMATS, Rates};
use crate::scenes::{FRAME_NS, Feed};
use anyhow::Result;
use clap::ValueEnum;
use esaac_engine::Device;
use esaac_model::HdrFormat;
use esaac_scene::{Renderer, SceneKind};
use indicatif::ProgressBar;
use serde::Serialize;
use std::cell::{Ref, RefCell};
use std::collections::BTreeSet;
use std::path::PathBuf;
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
    /// What poses cost the host
    Host,
    /// Cost of each sensor effect
    Effects,
    /// Cost of each sensor's bus
    Readout,
    /// Effects of the physical pixel in bright and dim scenes
    Light,
    /// Packets into ROS messages, from where the device wrote them
    Encode,
    /// A simulated day: time stamps, references and random numbers at its end
    Day,
    /// Against a recording of a real sensor
    RealSensor,
    /// The bench itself: noise band, comparators
    Stability,
}

/// The parts that [`Options::only`] selects rows of.
const OF_ROWS: [Part; 5] = [Part::Frontier, Part::Time, Part::Scale, Part::Readout, Part::Encode];

impl Part {
    /// Name on the command line and of its files.
    #[must_use]
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// Options of a run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Measure less of everything, for a software driver.
    pub quick: bool,
    /// Parts to run, in order. If empty, all parts run.
    pub parts: Vec<Part>,
    /// Only rows whose name contains this.
    pub only: String,
    /// Folder of a rendered sequence with its true events. Without it, part `frontier` uses analytic scenes only.
    pub sequence: Option<PathBuf>,
    /// Recording of a real sensor. Without it, part `real-sensor` is an error if it is named, and else measures nothing
    /// and says so.
    pub recording: Option<PathBuf>,
}

impl Options {
    /// Fails if rows are to be selected and no part that runs has any to select from, or if a part that is named lacks
    /// its input.
    fn check(&self) -> Result<()> {
        let is_of_rows = |part| OF_ROWS.contains(part);
        anyhow::ensure!(
            self.only.is_empty() || self.parts.is_empty() || self.parts.iter().any(is_of_rows),
            "only rows whose name contains `{}` are to run, expected one of the parts that have such: {}",
            self.only,
            OF_ROWS.map(Part::name).join(", ")
        );
        anyhow::ensure!(
            self.recording.is_some() || !self.parts.contains(&Part::RealSensor),
            "part `{}` has no recording to compare with, expected --recording FILE.aedat4",
            Part::RealSensor.name()
        );
        Ok(())
    }
}

/// The device and the options of a run.
pub struct Laboratory {
    device: Arc<Device>,
    clock: RefCell<Clock>,
    rates: Rates,
    options: Options,
    progress: ProgressBar,
    /// One renderer for each format, kept because a software driver takes seconds to compile one.
    renderers: RefCell<Vec<(HdrFormat, Rc<RefCell<Renderer>>)>>,
    asked: RefCell<Asked>,
}

/// Rows that parts have asked for.
#[derive(Default)]
struct Asked {
    rows: BTreeSet<String>,
    /// Whether [`Options::only`] selected one of them.
    wanted: bool,
}

impl Laboratory {
    /// A laboratory on a device. It draws progress bars on standard error.
    pub fn new(device: Arc<Device>, options: Options) -> Result<Self> {
        options.check()?;
        let mut clock = Clock::new(&device)?;
        clock.heat()?;
        clock.watch()?;
        let rates = Rates { bytes_per_s: clock.bytes_per_s()?, operations_per_s: clock.operations_per_s()? };
        let progress = ProgressBar::no_length();
        let (renderers, asked) = (RefCell::default(), RefCell::default());
        Ok(Laboratory { device, clock: RefCell::new(clock), rates, options, progress, renderers, asked })
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

    /// Its highest rates.
    #[must_use]
    pub fn rates(&self) -> Rates {
        self.rates
    }

    /// The options of the run.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Whether the device is a processor.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.device.is_software()
    }

    /// A scene with `step_ns` from frame to frame and colour in `hdr`. Motion has the format of [`FORMATS`].
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

    /// Whether the options select a row of this name.
    #[must_use]
    pub fn wants(&self, row: &str) -> bool {
        let wants = row.contains(&self.options.only);
        let mut asked = self.asked.borrow_mut();
        asked.wanted |= wants;
        asked.rows.insert(row.to_owned());
        wants
    }

    /// Fails if parts have asked for rows, and [`Options::only`] has selected none of them.
    pub(crate) fn check_only(&self) -> Result<()> {
        let asked = self.asked.borrow();
        let rows = asked.rows.iter().map(|row| format!("`{row}`")).collect::<Vec<_>>();
        anyhow::ensure!(
            asked.wanted || rows.is_empty(),
            "no row's name contains `{}`; there are: {}",
            self.options.only,
            rows.join(", ")
        );
        Ok(())
    }

    /// Number of intervals of a timing: many on a GPU, few on a software device, where an interval takes a tenth of a
    /// second.
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

    /// Measures the clock anew.
    pub(crate) fn watch_clock(&self) -> Result<()> {
        self.clock.borrow_mut().watch()
    }

    /// Removes the progress bar.
    pub(crate) fn finish(&self) {
        self.progress.finish_and_clear();
    }

    /// Measures rows one after another and shows a progress bar.
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
