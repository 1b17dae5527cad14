//! Frames of another process: the same events as in one, and whatever a peer does, an answer.
//!
//! `ESAAC_LINK_FRAMES` is the number of frames of the long runs; on a GPU 2000 take seconds.

mod c_producer;
mod connections;
mod drivers;
mod faults;
mod latency;
mod same_events;
mod two_devices;

/// Frames of a long run, `usual` if nobody says.
fn frames(usual: usize) -> usize {
    std::env::var("ESAAC_LINK_FRAMES").map_or(usual, |n| n.parse().expect("ESAAC_LINK_FRAMES is a number"))
}
