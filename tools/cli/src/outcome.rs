//! A command's result: text for standard output and an exit code.

use crate::stderr;
use anyhow::Result;

/// How a command ended that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Everything was done.
    Complete,
    /// This machine lacks something that is required (`doctor`, `devices`).
    Wanting,
    /// Everything was done, but events were dropped.
    EventsDropped,
    /// Everything was done, but the recording is not whole.
    NotRecorded,
    /// A signal ended it before its end. What was done until then is written.
    Interrupted,
}

impl Ending {
    /// Exit code: 0 complete, 1 wanting or not recorded, 3 events dropped, 130 interrupted. A failure is 1 and a usage error 2.
    #[must_use]
    pub fn exit_code(self) -> u8 {
        match self {
            Ending::Complete => 0,
            Ending::Wanting | Ending::NotRecorded => 1,
            Ending::EventsDropped => 3,
            Ending::Interrupted => 130,
        }
    }
}

/// A command's result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// For standard output.
    pub text: String,
    /// For the exit code.
    pub ending: Ending,
}

impl Outcome {
    /// The result of a command that did everything.
    #[must_use]
    pub fn complete(text: String) -> Self {
        Outcome { text, ending: Ending::Complete }
    }

    /// The result of a run whose other results are safe, and which may have failed to record: it tells of them all the same.
    #[must_use]
    pub fn with_recording(mut self, recorded: Result<()>) -> Self {
        if let Err(error) = recorded {
            stderr::line(format_args!("error: {}", stderr::sentence(&error)));
            self.ending = Ending::NotRecorded;
        }
        self
    }
}
