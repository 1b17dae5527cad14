//! Failures of the device: memory that cannot be allocated, a queue that accepts nothing, a wait that times out, a
//! device that is lost. Whichever call fails, the next step is right to the bit or refused. No event comes twice, and
//! none is lost silently.

mod driver;
mod held;
mod limits;
mod lost;
mod operations;
mod random;
mod saved;
mod strike;
mod sweep;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Runs tests one at a time: the faults of a device hit every test that uses it.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}
