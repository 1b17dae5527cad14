//! The text of a part: paragraphs, tables and plots, as Markdown.

/// A part's text.
#[derive(Clone, Debug, Default)]
pub struct Document {
    text: String,
    plots: Vec<(String, String)>,
}

impl Document {
    /// Starts a document with a heading.
    #[must_use]
    pub fn new(heading: &str) -> Self {
        Document { text: format!("## {heading}\n"), plots: Vec::new() }
    }

    /// Adds a paragraph.
    pub fn say(&mut self, paragraph: &str) {
        self.text.push_str(&format!("\n{paragraph}\n"));
    }

    /// Adds a heading one level below the document's own.
    pub fn heading(&mut self, heading: &str) {
        self.text.push_str(&format!("\n### {heading}\n"));
    }

    /// Adds a table. The first row is its head.
    pub fn table(&mut self, rows: &[Vec<String>]) {
        let Some(head) = rows.first() else { return };
        let line = |row: &[String]| format!("| {} |\n", row.join(" | "));
        self.text.push_str(&format!("\n{}|{}\n", line(head), "---|".repeat(head.len())));
        for row in &rows[1..] {
            self.text.push_str(&line(row));
        }
    }

    /// Adds a plot, which goes to its own file `NAME.svg`.
    pub fn plot(&mut self, name: &str, title: &str, svg: String) {
        let file = format!("{name}.svg");
        self.text.push_str(&format!("\n![{title}]({file})\n"));
        self.plots.push((file, svg));
    }

    /// File names and contents of the plots.
    pub fn plots(&self) -> impl Iterator<Item = &(String, String)> {
        self.plots.iter()
    }

    /// The whole document.
    #[must_use]
    pub fn markdown(&self) -> String {
        self.text.clone()
    }
}

/// The result of a part.
pub struct Outcome {
    /// Its figures.
    pub figures: serde_json::Value,
    /// Its text, tables and plots.
    pub document: Document,
}

/// A row of cells.
#[macro_export]
#[doc(hidden)]
macro_rules! cells {
    ($($cell:expr),* $(,)?) => { vec![$($cell.to_string()),*] };
}

/// Formats a figure with three significant digits.
#[must_use]
pub fn short(value: f64) -> String {
    if !value.is_finite() {
        return "-".to_owned();
    }
    match value.abs() {
        0.0 => "0".to_owned(),
        magnitude if magnitude >= 100.0 => format!("{value:.0}"),
        magnitude if magnitude >= 10.0 => format!("{value:.1}"),
        magnitude if magnitude >= 1.0 => format!("{value:.2}"),
        magnitude if magnitude >= 0.001 => format!("{value:.3}"),
        _ => format!("{value:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_document_is_markdown() {
        let mut document = Document::new("Part");
        document.say("Words.");
        document.table(&[cells!["a", "b"], cells![1, short(0.25)]]);
        document.plot("a_plot", "A plot", "<svg/>".to_owned());
        let text = document.markdown();
        assert_eq!(
            text,
            "## Part\n\nWords.\n\n| a | b |\n|---|---|\n| 1 | 0.250 |\n\n![A plot](a_plot.svg)\n"
        );
        assert_eq!(document.plots().next().unwrap().0, "a_plot.svg");
    }

    #[test]
    fn figures_are_short() {
        assert_eq!(
            [0.0, 1234.5, 12.345, 1.2345, 0.0123, 1e-5, f64::NAN].map(short),
            ["0", "1234", "12.3", "1.23", "0.012", "1.0e-5", "-"]
        );
    }
}
