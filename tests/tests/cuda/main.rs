//! A CUDA producer: the same events as in one process, and what the link to it costs. Where there is no
//! CUDA, or not on the engine's device, every test asserts that this is said clearly instead.
//!
//! `ESAAC_CUDA_FRAMES` is the number of frames (2000); the figures are printed with `--nocapture`.

mod latency;
mod present;
mod same_events;
mod two_gpus;
mod waits;
