//! Lines on standard error: warnings, notices and the error that ends the program.

use std::fmt::Display;
use std::io::Write;

/// Writes a line. If standard error cannot be written (it is closed, or its disk is full), the line is lost and the
/// program goes on: its results matter more.
pub fn line(text: impl Display) {
    write_line(&mut std::io::stderr().lock(), text);
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
}
