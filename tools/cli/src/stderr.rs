//! Lines on standard error: warnings, notices and the error that ends the program.

use anyhow::Error;
use std::fmt::Display;
use std::io::Write;

/// Writes a line. If standard error cannot be written (it is closed, or its disk is full), the line is lost and the
/// program goes on: its results matter more.
pub fn line(text: impl Display) {
    write_line(&mut std::io::stderr().lock(), text);
}

/// An error and its causes in one sentence. Many errors have their cause in their own text already; it is said once.
pub fn sentence(error: &Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
    }
    text
}

fn write_line(out: &mut impl Write, text: impl Display) {
    // There is no other place that could tell of the failure.
    let _ = out.write_all(format!("{text}\n").as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_cannot_be_written_is_lost() {
        let mut written = Vec::new();
        write_line(&mut written, format_args!("{} warnings", 2));
        assert_eq!(written, b"2 warnings\n");
        let mut full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        write_line(&mut full, "lost");
    }

    #[derive(Debug, thiserror::Error)]
    #[error("recording a.mcap: {source}")]
    struct WithCause {
        source: std::io::Error,
    }

    #[test]
    fn a_cause_is_said_once() {
        let io = || std::io::Error::from(std::io::ErrorKind::NotFound);
        let told = Error::from(WithCause { source: io() }).context("the recording is incomplete");
        assert_eq!(sentence(&told), format!("the recording is incomplete: recording a.mcap: {}", io()));
        let untold = Error::from(io()).context("cannot read b.toml");
        assert_eq!(sentence(&untold), format!("cannot read b.toml: {}", io()));
    }
}
