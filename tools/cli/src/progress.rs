//! The progress bar.

use indicatif::{ProgressBar, ProgressStyle};

/// A progress bar on standard error. It is hidden if standard error is not a terminal.
#[must_use]
pub fn bar(frames: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} frames, {per_sec}, {eta} left")
        .expect("the template is well formed");
    ProgressBar::new(frames as u64).with_style(style)
}
