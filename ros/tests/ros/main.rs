//! Tests publishing with independent subscribers: Fast DDS, and PyPI's cyclonedds and rosbags. They share no
//! code with this crate. All traffic stays on loopback.

mod bad_input;
mod bags;
mod event_ids;
mod exchange;
mod faults;
mod graph;
mod latched;
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
