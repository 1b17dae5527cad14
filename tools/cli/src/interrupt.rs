//! Signals that ask a command to end: Ctrl-C (SIGINT), SIGTERM, and SIGHUP, which comes when its terminal goes.

use crate::stderr;
use anyhow::{Context, Result};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether such a signal has come. Once there is one of these, the signals never again end the process by themselves:
/// whatever takes long looks here.
#[derive(Clone, Debug)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Takes the signals from now on.
    pub fn watch() -> Result<Self> {
        let came = Arc::new(AtomicBool::new(false));
        // Who starts a program with `nohup` wants it to outlive the terminal.
        let hangup = (!is_ignored(SIGHUP)).then_some(SIGHUP);
        for signal in [SIGINT, SIGTERM].into_iter().chain(hangup) {
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

/// Whether this process ignores a signal.
fn is_ignored(signal: i32) -> bool {
    // Without /proc nobody can tell, and ending in order is better than being killed.
    std::fs::read_to_string("/proc/self/status").is_ok_and(|status| ignores(&status, signal))
}

/// Whether `/proc/PID/status` says that the process ignores a signal.
fn ignores(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_that_is_ignored_is_known() {
        let status =
            "Name:\tesaac\nSigBlk:\t0000000000000001\nSigIgn:\t0000000000001001\nSigCgt:\t0000000000000002\n";
        assert!(ignores(status, SIGHUP) && ignores(status, 13));
        assert!(!ignores(status, SIGINT) && !ignores("SigIgn:\t", SIGHUP) && !ignores("", SIGHUP));
        assert!(is_ignored(13), "Rust's programs ignore SIGPIPE");
    }
}
