//! A descriptor that is given to a driver. If the import succeeds the driver owns it. If the import fails the
//! driver must not close it, but some drivers do. Closing it a second time could then close another file that
//! has got the same number.

#![expect(unsafe_code, reason = "a descriptor whose owner is a driver's to decide")]

use crate::error::InteropError;
use rustix::fd::{AsFd, BorrowedFd, FromRawFd, IntoRawFd, OwnedFd, RawFd};
use rustix::fs::fstat;

/// A copy of a descriptor that is lent to a driver.
pub(crate) struct Lent {
    original: OwnedFd,
    number: Option<RawFd>,
}

impl Lent {
    pub(crate) fn new(original: OwnedFd) -> Result<Self, InteropError> {
        let copy = rustix::io::fcntl_dupfd_cloexec(&original, 0)
            .map_err(InteropError::system("fcntl F_DUPFD_CLOEXEC"))?;
        Ok(Lent { number: Some(copy.into_raw_fd()), original })
    }

    /// The number to give to the driver.
    pub(crate) fn number(&self) -> RawFd {
        self.number.expect("lent until it is taken")
    }

    /// The driver has taken it.
    pub(crate) fn taken(mut self) {
        self.number = None;
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        let Some(number) = self.number else { return };
        // SAFETY: only asked what it is of; if it is closed the answer is an error.
        let lent = unsafe { BorrowedFd::borrow_raw(number) };
        let same = match (fstat(lent), fstat(self.original.as_fd())) {
            (Ok(lent), Ok(original)) => (lent.st_dev, lent.st_ino) == (original.st_dev, original.st_ino),
            _ => false,
        };
        if same {
            // SAFETY: it is still the copy that was made here, and no driver has it.
            drop(unsafe { OwnedFd::from_raw_fd(number) });
        }
    }
}
