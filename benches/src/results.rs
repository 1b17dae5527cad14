//! The results file: a page of Markdown with a section for each device. Runs of the bench rewrite it part by part.
//!
//! A section begins with `## DEVICE`, a part of it with `### HEADING`. A run replaces the parts that it measured on its
//! device. Everything else stays as it is, to the byte.

use crate::document::Document;
use crate::laboratory::Part;
use crate::report::Report;
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The first lines of a new file.
const HEAD: &str =
    "# Results\n\nWritten by `esaac bench --write-results`, device by device and part by part.\n";

/// Where figures come from.
#[derive(Clone, Debug)]
pub struct Provenance {
    /// The command that measured them.
    pub command: String,
    /// Commit of the program.
    pub commit: String,
    /// Day of the measurement, UTC.
    pub date: String,
}

impl Provenance {
    /// The provenance of a command that runs today. `commit` is `None` if the program was not built from a git
    /// checkout.
    #[must_use]
    pub fn now(command: &str, commit: Option<&str>) -> Self {
        let instant = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
        let date = instant.split('T').next().unwrap_or_default().to_owned();
        Provenance { command: command.to_owned(), commit: commit.unwrap_or("unknown").to_owned(), date }
    }
}

/// Puts a report into a results file and its plots into `results/DEVICE/` beside it. Creates the file if it is missing.
/// Returns the paths of the files it wrote.
pub fn write(report: &Report, path: &Path, provenance: &Provenance) -> Result<Vec<PathBuf>> {
    let before = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => HEAD.to_owned(),
        Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
    };
    let folder = PathBuf::from("results").join(folder_name(&report.device));
    let place = path.parent().unwrap_or(Path::new(""));
    let mut files = vec![(path.to_owned(), updated(&before, report, provenance, &folder))];
    for (_, document) in &report.documents {
        files.extend(document.plots().map(|(name, svg)| (place.join(&folder).join(name), svg.clone())));
    }
    for (file, text) in &files {
        let parent = file.parent().unwrap_or(Path::new(""));
        std::fs::create_dir_all(parent)
            .with_context(|| format!("cannot make folder {}", parent.display()))?;
        std::fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))?;
    }
    Ok(files.into_iter().map(|(file, _)| file).collect())
}

/// The page with the parts of a report in the section of its device.
fn updated(page: &str, report: &Report, provenance: &Provenance, plots: &Path) -> String {
    let mut sections = split(page, "## ");
    let title = format!("## {}\n", report.device);
    if !sections.iter().any(|section| section.starts_with(&title)) {
        end_with_a_blank_line(&mut sections);
        sections.push(format!("{title}\n"));
    }
    let at = sections.iter().position(|section| section.starts_with(&title)).unwrap_or(0);
    let last = at + 1 == sections.len();

    let mut parts = split(&sections[at], "### ");
    for (part, document) in &report.documents {
        let text = part_text(report, provenance, *part, document, plots);
        let heading = text.lines().next().unwrap_or_default().to_owned() + "\n";
        match parts.iter_mut().find(|known| known.starts_with(&heading)) {
            Some(known) => *known = text + "\n",
            None => {
                end_with_a_blank_line(&mut parts);
                parts.push(text + "\n");
            }
        }
    }
    let mut section = parts.concat();
    if last {
        section.truncate(section.trim_end().len());
        section.push('\n');
    }
    sections[at] = section;
    sections.concat()
}

/// Cuts a page before each line that begins with `mark`. Lines in fenced blocks do not count.
fn split(page: &str, mark: &str) -> Vec<String> {
    let mut pieces = vec![String::new()];
    let mut fenced = false;
    for line in page.split_inclusive('\n') {
        fenced ^= line.starts_with("```");
        if !fenced && line.starts_with(mark) {
            pieces.push(String::new());
        }
        if let Some(piece) = pieces.last_mut() {
            piece.push_str(line);
        }
    }
    pieces
}

fn end_with_a_blank_line(pieces: &mut [String]) {
    if let Some(piece) = pieces.last_mut() {
        piece.truncate(piece.trim_end().len());
        piece.push_str("\n\n");
    }
}

/// A part's document, with its headings one level deeper and its provenance below the first heading.
fn part_text(
    report: &Report,
    provenance: &Provenance,
    part: Part,
    document: &Document,
    plots: &Path,
) -> String {
    let Provenance { command, commit, date } = provenance;
    let quick = if report.quick { ", `--quick`" } else { "" };
    let unsteady =
        if report.clock.steady { "" } else { " **The clock was not steady: rows do not compare well.**" };
    let source = format!(
        "Commit {commit}, {}, {date}{quick}, part `{}` of `{command}`.{unsteady}",
        report.driver,
        part.name()
    );
    let mut text = String::new();
    for line in document.markdown().lines() {
        let deeper = if line.starts_with("##") { "#" } else { "" };
        text.push_str(&format!("{deeper}{line}\n"));
        if line.starts_with("## ") {
            text.push_str(&format!("\n{source}\n"));
        }
    }
    for (name, _) in document.plots() {
        text = text.replace(&format!("]({name})"), &format!("]({}/{name})", plots.display()));
    }
    text
}

/// A device's name as the name of a folder.
fn folder_name(device: &str) -> String {
    let words: Vec<String> = device
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|word| !word.is_empty())
        .map(str::to_ascii_lowercase)
        .collect();
    words.join("-")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cells;
    use crate::clock::ClockReport;
    use crate::floor::Rates;

    fn report(device: &str, parts: &[(Part, &str, &str)]) -> Report {
        let documents = parts.iter().map(|(part, heading, figure)| {
            let mut document = Document::new(heading);
            document.table(&[cells!["a"], cells![figure]]);
            document.heading("More");
            document.plot("time", "Time", "<svg/>".to_owned());
            (*part, document)
        });
        Report {
            device: device.to_owned(),
            kind: "discrete".to_owned(),
            driver: "driver 1".to_owned(),
            quick: true,
            tracy: false,
            rates: Rates { bytes_per_s: 1.0, operations_per_s: 1.0 },
            clock: ClockReport { steady: true, ..ClockReport::default() },
            parts: serde_json::Map::new(),
            documents: documents.collect(),
        }
    }

    fn provenance() -> Provenance {
        Provenance {
            command: "esaac bench".to_owned(),
            commit: "abc".to_owned(),
            date: "2026-01-02".to_owned(),
        }
    }

    fn update(page: &str, device: &str, parts: &[(Part, &str, &str)]) -> String {
        updated(page, &report(device, parts), &provenance(), Path::new("results/x"))
    }

    #[test]
    fn a_part_says_where_it_comes_from_and_where_its_plots_are() {
        let page = update(HEAD, "GPU 1", &[(Part::Time, "Time", "7")]);
        let expected = "## GPU 1\n\n### Time\n\nCommit abc, driver 1, 2026-01-02, `--quick`, part `time` of `esaac \
                        bench`.\n\n| a |\n|---|\n| 7 |\n\n#### More\n\n![Time](results/x/time.svg)\n";
        assert_eq!(page, format!("{HEAD}\n{expected}"));
    }

    #[test]
    fn a_run_replaces_its_own_parts_on_its_own_device_and_nothing_else() {
        let mut page = update(HEAD, "GPU 1", &[(Part::Time, "Time", "7"), (Part::Memory, "Memory", "8")]);
        page = update(&page, "GPU 12", &[(Part::Time, "Time", "9")]);
        let again = update(&page, "GPU 1", &[(Part::Time, "Time", "70")]);
        assert_eq!(again, page.replacen("| 7 |", "| 70 |", 1));
        assert_eq!(
            update(&again, "GPU 1", &[(Part::Time, "Time", "70")]),
            again,
            "writing twice changes nothing"
        );
        let other = update(&again, "GPU 12", &[(Part::Time, "Time", "90")]);
        assert_eq!(other, again.replacen("| 9 |", "| 90 |", 1));
    }

    #[test]
    fn a_new_part_joins_the_section_of_its_device() {
        let page = update(HEAD, "GPU 1", &[(Part::Time, "Time", "7")]);
        let page = update(&page, "GPU 2", &[(Part::Time, "Time", "8")]);
        let page = update(&page, "GPU 1", &[(Part::Memory, "Memory", "9")]);
        let places: Vec<usize> = ["## GPU 1\n", "| 7 |", "### Memory", "| 9 |", "## GPU 2\n", "| 8 |"]
            .iter()
            .map(|part| page.find(part).unwrap_or_else(|| panic!("no {part} in {page}")))
            .collect();
        assert!(places.is_sorted(), "{page}");
        assert!(!page.contains("\n\n\n"), "{page}");
    }

    #[test]
    fn headings_in_fenced_blocks_are_no_sections() {
        let page = "# Results\n\n```text\n## GPU 1\n```\n\n## GPU 2\n\nBy hand.\n";
        let written = update(page, "GPU 1", &[(Part::Time, "Time", "7")]);
        assert!(written.starts_with(page) && written.ends_with("time.svg)\n"), "{written}");
    }

    #[test]
    fn a_file_and_its_plots_are_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("RESULTS.md");
        let report = report("NVIDIA H200 (x)", &[(Part::Time, "Time", "7")]);
        let files = write(&report, &path, &provenance()).unwrap();
        let plot = folder.path().join("results/nvidia-h200-x/time.svg");
        assert_eq!(files, [path.clone(), plot.clone()]);
        assert_eq!(std::fs::read_to_string(plot).unwrap(), "<svg/>");
        assert!(std::fs::read_to_string(&path).unwrap().contains("(results/nvidia-h200-x/time.svg)"));
        let error = write(&report, folder.path(), &provenance()).unwrap_err();
        assert!(format!("{error:#}").contains("cannot read"), "{error:#}");
    }

    #[test]
    fn today_is_a_day_and_an_unknown_commit_is_told() {
        let now = Provenance::now("x", None);
        assert_eq!(now.date.split('-').map(str::len).collect::<Vec<_>>(), [4, 2, 2]);
        assert!(now.date.as_str() > "2026-01-01", "{}", now.date);
        assert_eq!((now.commit.as_str(), now.command.as_str()), ("unknown", "x"));
    }
}
