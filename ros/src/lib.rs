//! ROS 2 topics of simulated event cameras, on machines with ROS 2 and without.
//!
//! [`RigPublisher`] takes the results of an engine tick and encodes each message once. Its own thread then
//! sends the bytes with a [`Transport`] and writes the same bytes to a recording ([`BagWriter`]). There are
//! three transports: the built-in [`CycloneTransport`], Zenoh (feature `zenoh`), and a node of the sourced
//! ROS 2 (feature `rclrs`). The parameters of that node ([`SensorParameters`]) change sensors while the rig
//! runs. [`replay`](replay::replay) publishes a recording again.
//!
//! This crate uses packets and sensors (`esaac-model`). It does not use Vulkan or the engine.

pub mod bag;
pub mod cdr;
#[cfg(feature = "embedded")]
pub mod cyclone;
pub mod definition;
pub mod encode;
pub mod events;
pub mod histogram;
pub mod host;
pub mod labels;
pub mod message;
pub mod names;
pub mod parameters;
pub mod payload;
pub mod plan;
pub mod qos;
mod queue;
#[cfg(feature = "rclrs")]
pub mod rclrs;
pub mod replay;
pub mod rig;
pub mod statistics;
pub mod transport;
pub mod type_hash;
mod worker;
#[cfg(feature = "zenoh")]
pub mod zenoh;

pub use bag::{BagError, BagReader, BagWriter};
#[cfg(feature = "embedded")]
pub use cyclone::{CycloneTransport, NetworkOptions};
pub use encode::Imu;
pub use events::{EventFormat, Split};
pub use labels::Instance;
pub use message::MessageType;
pub use parameters::SensorParameters;
pub use payload::Payload;
pub use plan::{CameraPlan, Plan, Policy, RigOptions, Topic};
pub use qos::{Qos, QosChange};
#[cfg(feature = "rclrs")]
pub use rclrs::{NodeOptions, RclrsTransport};
pub use rig::{ApsImage, PublishError, RigPublisher, Sinks, TickMessages};
pub use statistics::{CameraStatus, Summary, TopicSummary};
pub use transport::{Transport, TransportError};
#[cfg(feature = "zenoh")]
pub use zenoh::ZenohTransport;
