//! What a command leaves behind: text for standard output and an exit code.

/// How a command that did not fail has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// As asked.
    Complete,
    /// Something that is needed is missing (`doctor`, `devices`).
    Wanting,
    /// Finished, but events were dropped.
    EventsDropped,
}

impl Ending {
    /// Exit code: 0 complete, 1 wanting, 3 events dropped. A failure is 1 and a usage error 2.
    #[must_use]
    pub fn exit_code(self) -> u8 {
        match self {
            Ending::Complete => 0,
            Ending::Wanting => 1,
            Ending::EventsDropped => 3,
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
    /// A command that did as asked.
    #[must_use]
    pub fn complete(text: String) -> Self {
        Outcome { text, ending: Ending::Complete }
    }
}
