//! What a caller lends to a step that was submitted. The caller has it back once somebody has waited for the step.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The part of an object by which it knows whether a submitted step uses it.
#[derive(Default)]
pub(crate) struct Lent {
    /// Whether a wait for a submission that uses the object has failed.
    abandoned: Arc<AtomicBool>,
}

/// A submitted step's use of an object. It ends when this is dropped.
pub(crate) struct Loan {
    abandoned: Arc<AtomicBool>,
}

impl Lent {
    pub(crate) fn lend(&self) -> Loan {
        Loan { abandoned: Arc::clone(&self.abandoned) }
    }

    /// Whether a submitted step uses the object.
    pub(crate) fn is_lent(&self) -> bool {
        Arc::strong_count(&self.abandoned) > 1
    }

    pub(crate) fn is_abandoned(&self) -> bool {
        self.abandoned.load(Ordering::Acquire)
    }

    pub(crate) fn abandon(&self) {
        self.abandoned.store(true, Ordering::Release);
    }
}

impl Loan {
    /// Marks the object as abandoned: the wait for the step has failed.
    pub(crate) fn abandon(&self) {
        self.abandoned.store(true, Ordering::Release);
    }
}
