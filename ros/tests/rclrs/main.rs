//! A node of the sourced ROS 2 as others see it. The subscribers are Fast DDS and PyPI's cyclonedds and
//! rosbags; parameters are set by a client of their services, as `ros2 param set` does.
//!
//! They need a ROS 2 with `esaac_msgs` and `event_camera_msgs`, `RMW_IMPLEMENTATION` of a middleware on DDS,
//! and an environment that keeps it on loopback. `tools/test.sh` sees to the latter.

mod cost;
#[path = "../ros/exchange.rs"]
mod exchange;
mod node;
mod parameters;
mod topics;
#[path = "../ros/world.rs"]
#[allow(dead_code, reason = "the embedded transport's tests use more of it")]
mod world;

use esaac_ros::Transport;

/// The transport under test.
fn open(domain: u32) -> Box<dyn Transport> {
    Box::new(node::open(domain, &[]).expect("a node"))
}

/// Copies of a message that it makes.
const WIRE_COPIES: u32 = 2;
