//! Frames from another process give the same events as in one process, and the engine answers whatever a peer does.
//!
//! `ESAAC_LINK_FRAMES` sets the number of frames of the long runs. On a GPU 2000 take seconds.

mod c_producer;
mod connections;
mod drivers;
mod faults;
mod handshake;
mod hostile;
mod latency;
mod logs;
mod rigid;
mod same_events;
mod shortage;
mod told;
mod two_devices;
mod versions;

/// Number of frames of a long run: that of `ESAAC_LINK_FRAMES`, or `usual`.
fn frames(usual: usize) -> usize {
    std::env::var("ESAAC_LINK_FRAMES").map_or(usual, |n| n.parse().expect("ESAAC_LINK_FRAMES is a number"))
}
