//! Runs the parts and writes their results.

use crate::clock::ClockReport;
use crate::document::Document;
use crate::floor::Rates;
use crate::laboratory::{Laboratory, Part};
use crate::parts;
use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Figures of a run.
#[derive(Serialize)]
pub struct Report {
    /// Device name.
    pub device: String,
    /// Kind of the device.
    pub kind: String,
    /// Driver name and version.
    pub driver: String,
    /// Whether the run had `--quick`.
    pub quick: bool,
    /// Whether zones for a profiler are built in.
    pub tracy: bool,
    /// The device's highest rates.
    pub rates: Rates,
    /// The device's clock over the run.
    pub clock: ClockReport,
    /// Figures of each part by name.
    pub parts: serde_json::Map<String, serde_json::Value>,
    /// Document of each part.
    #[serde(skip)]
    pub documents: Vec<(Part, Document)>,
}

/// Runs the parts that the options select. Calls `after` with the report after each part, so that a failure later does
/// not lose what is already measured.
pub fn run(laboratory: &Laboratory, mut after: impl FnMut(&Report) -> Result<()>) -> Result<Report> {
    let asked = &laboratory.options().parts;
    let parts: Vec<Part> = match asked.is_empty() {
        true => Part::value_variants().to_vec(),
        false => asked.clone(),
    };
    let info = laboratory.device().info();
    let mut report = Report {
        device: info.name.clone(),
        kind: info.kind.to_owned(),
        driver: info.driver.clone(),
        quick: laboratory.options().quick,
        tracy: cfg!(feature = "tracy"),
        rates: laboratory.rates(),
        clock: laboratory.clock().report(),
        parts: serde_json::Map::new(),
        documents: Vec::new(),
    };
    for part in parts {
        let outcome = parts::run(laboratory, part).with_context(|| format!("part `{}`", part.name()))?;
        report.parts.insert(part.name(), outcome.figures);
        report.documents.push((part, outcome.document));
        laboratory.watch_clock()?;
        report.clock = laboratory.clock().report();
        after(&report)?;
    }
    laboratory.finish();
    laboratory.check_only()?;
    let messages = laboratory.device().validation_messages();
    ensure!(messages.is_empty(), "the validation layer objects:\n{}", messages.join("\n"));
    Ok(report)
}

/// Writes `bench.json`, `bench.md` and the plots into a folder and returns their paths.
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
