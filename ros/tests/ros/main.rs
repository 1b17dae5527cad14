//! Publishing as subscribers see it. The subscribers are Fast DDS and PyPI's cyclonedds and rosbags, which
//! share no code with this crate; all traffic is on this machine's loopback.

mod bad_input;
mod bags;
mod exchange;
mod faults;
mod graph;
mod load;
mod receivers;
mod world;
#[cfg(feature = "zenoh")]
mod zenoh;
