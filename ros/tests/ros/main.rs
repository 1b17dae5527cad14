//! Publishing as subscribers see it. The subscribers are Fast DDS and PyPI's cyclonedds and rosbags, which
//! share no code with this crate; all traffic is on this machine's loopback.

mod bad_input;
mod bags;
mod exchange;
mod faults;
mod graph;
mod load;
mod pace;
mod world;
#[cfg(feature = "zenoh")]
mod zenoh;

use esaac_ros::Transport;

/// The transport under test.
fn open(domain: u32) -> Box<dyn Transport> {
    Box::new(world::transport(domain))
}

/// Copies of a message that it makes.
const WIRE_COPIES: u32 = 0;
