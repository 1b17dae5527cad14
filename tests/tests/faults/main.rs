//! Failures of the device: memory that cannot be allocated, a queue that accepts nothing, a wait that times out, a
//! device that is lost. Whichever call fails, the next step is right to the bit or refused. No event comes twice, and
//! none is lost silently.

mod driver;
mod halves;
mod held;
mod hooks;
mod limits;
mod looks;
mod lost;
mod operations;
mod random;
mod saved;
mod strike;
mod sweep;
