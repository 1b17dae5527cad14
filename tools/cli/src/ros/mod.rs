//! ROS 2 in the commands: flags, the network, and publishing and recording what a command simulates.

mod arguments;
mod camera;
mod network;
mod output;
mod rviz;
mod status;

pub use arguments::{RosArguments, RosMode};
pub use camera::{add_camera, camera, depth_along_axis, imu_samples};
pub use network::{Joined, NetworkArguments};
pub use output::{Published, RosOutput};
