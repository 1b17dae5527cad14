//! Signals that ask a command to end: Ctrl-C (SIGINT), and SIGTERM.

use crate::stderr;
use anyhow::{Context, Result};
use signal_hook::consts::{SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether such a signal has come. While there is one of these, the signals do not end the process by themselves.
#[derive(Clone, Debug)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Takes the signals from now on.
    pub fn watch() -> Result<Self> {
        let came = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&came)).context("cannot take signals")?;
        }
        Ok(Interrupt(came))
    }

    /// Whether one has come.
    #[must_use]
    pub fn came(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Says how much of a run there is, if it was interrupted. Returns whether it was.
pub fn tell(intervals: usize, expected: usize) -> bool {
    let interrupted = intervals < expected;
    if interrupted {
        let written = if intervals == 0 { "no events are" } else { "what they gave is" };
        stderr::line(format_args!(
            "interrupted after {intervals} of {expected} intervals: {written} written"
        ));
    }
    interrupted
}
