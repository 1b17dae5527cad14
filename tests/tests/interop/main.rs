//! Frames of another process: the same events as in one, and whatever a peer does, an answer.

mod c_producer;
mod connections;
mod faults;
mod latency;
mod same_events;
