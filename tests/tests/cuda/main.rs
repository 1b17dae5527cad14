//! A CUDA producer: it gives the same events as one process, and the suite measures what the link costs. Without CUDA
//! on the engine's device, every test asserts instead that the error says so clearly.
//!
//! `ESAAC_CUDA_FRAMES` sets the number of frames (2000 by default). `--nocapture` shows the figures.

mod contexts;
mod latency;
mod present;
mod rigid;
mod same_events;
mod two_gpus;
mod waits;
