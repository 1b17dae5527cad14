//! ROS 2 topics of simulated event cameras, on machines with ROS 2 and without.
//!
//! [`RigPublisher`] takes what a tick of the engine gave, encodes each message once, straight into the
//! buffer that is sent and recorded, and hands the tick to a thread of its own. The thread sends by a
//! [`Transport`] and writes a recording ([`BagWriter`]) from the same bytes. [`CycloneTransport`] is the
//! embedded one; with the feature `zenoh` there is a second, and with `rclrs` a node of the sourced ROS 2, whose
//! parameters ([`SensorParameters`]) change sensors live. [`replay`](replay::replay) sends a recording again.
//!
//! Knows packets and sensors (`esaac-model`), and neither Vulkan nor the engine.

pub mod bag;
pub mod cdr;
#[cfg(feature = "embedded")]
pub mod cyclone;
pub mod definition;
pub mod encode;
pub mod events;
pub mod histogram;
pub mod host;
pub mod message;
pub mod names;
pub mod parameters;
pub mod payload;
pub mod plan;
pub mod qos;
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
pub use encode::{Imu, Intrinsics};
pub use events::{EventFormat, Split};
pub use message::MessageType;
pub use parameters::SensorParameters;
pub use payload::Payload;
pub use plan::{CameraPlan, Plan, Policy, RigOptions, Topic};
pub use qos::{Qos, QosChange};
#[cfg(feature = "rclrs")]
pub use rclrs::{NodeOptions, RclrsTransport};
pub use rig::{ApsImage, PublishError, RigPublisher, Sinks, TickMessages};
pub use statistics::{Summary, TopicSummary};
pub use transport::{Transport, TransportError};
#[cfg(feature = "zenoh")]
pub use zenoh::ZenohTransport;
