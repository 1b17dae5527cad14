//! A node of the sourced ROS 2, with `rclrs`. It uses the middleware of that ROS 2, has every sensor
//! parameter as a node parameter, and accepts `--ros-args`.
//!
//! `rclrs` cannot send encoded bytes. So each message is filled from them ([`DynamicPublisher`]) and encoded
//! again by the middleware: two copies. Types are looked up by name in the sourced ROS 2; no generated code
//! is compiled in.

mod executor;
mod fill;
mod parameters;
mod read;
mod structure;

use crate::names;
use crate::parameters::SensorParameters;
use crate::payload::Payload;
use crate::plan::{CameraPlan, Topic};
use crate::qos::{Durability, Qos, Reliability};
use crate::transport::{Transport, TransportError};
use ::rclrs::{
    Context, CreateBasicExecutor, DynamicMessageError, DynamicMessageMetadata, DynamicPublisher, InitOptions,
    IntoPrimitiveOptions, MessageTypeName, Node, QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy,
};
use executor::Spinning;
use read::CdrReader;
use std::error::Error;
use std::sync::Arc;
use std::time::Duration;

/// Where and how the node starts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NodeOptions {
    /// Domain id. `None`: the environment's.
    pub domain: Option<u32>,
    /// Name of the node.
    pub node: String,
    /// ROS 2's part of a command line: `--ros-args` and what follows.
    pub arguments: Vec<String>,
}

struct Writer {
    qos: Qos,
    publisher: DynamicPublisher,
    kind: DynamicMessageMetadata,
    /// Number of subscribers with incompatible quality of service that notices have mentioned.
    refused: usize,
    /// Whether the last query of its subscribers failed.
    is_unknown: bool,
}

/// A node with its publishers.
pub struct RclrsTransport {
    // Dropped in this order: publishers before their node, and the node's thread last.
    writers: Vec<Writer>,
    node: Node,
    spinning: Spinning,
}

/// Time for the last messages to reach subscribers. `rclrs` cannot ask whether they arrived.
const LINGER: Duration = Duration::from_millis(100);

impl RclrsTransport {
    /// Starts the node.
    pub fn open(options: &NodeOptions) -> Result<Self, TransportError> {
        let unavailable = |error: &dyn Error| TransportError::Unavailable(explain(error));
        names::check_node(&options.node).map_err(|error| unavailable(&error))?;
        let domain = InitOptions::new().with_domain_id(options.domain.map(|domain| domain as usize));
        let program = std::iter::once("esaac".to_owned());
        let context = Context::new(program.chain(options.arguments.iter().cloned()), domain)
            .map_err(|error| unavailable(&error))?;
        let executor = context.create_basic_executor();
        let node = executor.create_node(options.node.as_str()).map_err(|error| unavailable(&error))?;
        let spinning = Spinning::start(executor).map_err(|error| unavailable(&error))?;
        Ok(RclrsTransport { writers: Vec::new(), node, spinning })
    }

    /// Declares every parameter of the cameras' sensors as a node parameter.
    pub fn declare_sensors(&self, cameras: &[CameraPlan]) -> Result<SensorParameters, TransportError> {
        parameters::declare(&self.node, cameras)
    }
}

/// An error and its causes, in one line.
fn explain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text += &format!(": {error}");
        cause = error.source();
    }
    text
}

fn profile(qos: Qos) -> QoSProfile {
    let profile = QoSProfile::topics_default().keep_last(qos.depth);
    let profile = match qos.reliability {
        Reliability::Reliable => profile.reliable(),
        Reliability::BestEffort => profile.best_effort(),
    };
    match qos.durability {
        Durability::TransientLocal => profile.transient_local(),
        Durability::Volatile => profile.volatile(),
    }
}

/// The policy in which a subscriber asks for more than is offered.
fn incompatible(offered: Qos, wanted: &QoSProfile) -> Option<&'static str> {
    if offered.reliability == Reliability::BestEffort && wanted.reliability == QoSReliabilityPolicy::Reliable
    {
        Some("RELIABILITY")
    } else if offered.durability == Durability::Volatile
        && wanted.durability == QoSDurabilityPolicy::TransientLocal
    {
        Some("DURABILITY")
    } else {
        None
    }
}

fn message_type(name: &str) -> Result<DynamicMessageMetadata, String> {
    let type_name = MessageTypeName::try_from(name).map_err(|error| error.to_string())?;
    DynamicMessageMetadata::new(type_name).map_err(|error| match error {
        DynamicMessageError::RequiredPrefixNotSourced { package } => {
            format!(
                "package `{package}` is not in the sourced ROS 2; build or install it there, and source it"
            )
        }
        DynamicMessageError::InvalidMessageType => format!("the sourced ROS 2 has no message `{name}`"),
        error => explain(&error),
    })
}

impl Transport for RclrsTransport {
    fn name(&self) -> String {
        format!("rclrs, domain {}, node {}", self.node.domain_id(), self.node.fully_qualified_name())
    }

    fn copies(&self) -> u32 {
        2
    }

    fn advertise(&mut self, topic: &Topic) -> Result<(), TransportError> {
        let fail = |reason: String| TransportError::Topic { topic: topic.name.clone(), reason };
        names::check_topic(&topic.name).map_err(|error| fail(error.to_string()))?;
        let kind = message_type(&topic.type_name).map_err(fail)?;
        structure::check(kind.structure(), &topic.type_name, &topic.schema)
            .map_err(|reason| fail(format!("the sourced ROS 2 has another definition: {reason}")))?;
        let type_name = MessageTypeName::try_from(topic.type_name.as_str());
        let type_name = type_name.map_err(|error| fail(error.to_string()))?;
        let options = topic.name.as_str().qos(profile(topic.qos));
        let publisher = self.node.create_dynamic_publisher(type_name, options);
        let publisher = publisher.map_err(|error| fail(explain(&error)))?;
        self.writers.push(Writer { qos: topic.qos, publisher, kind, refused: 0, is_unknown: false });
        Ok(())
    }

    fn publish(&mut self, topic: usize, message: &Arc<Payload>) -> Result<(), TransportError> {
        let writer = &self.writers[topic];
        let fail = |reason: String| TransportError::Message { topic: writer.publisher.topic_name(), reason };
        let mut filled = writer.kind.create().map_err(|error| fail(explain(&error)))?;
        CdrReader::new(message)
            .and_then(|mut cdr| fill::fill(filled.view_mut(), &mut cdr))
            .map_err(|error| fail(error.to_string()))?;
        writer.publisher.publish(filled).map_err(|error| fail(explain(&error)))
    }

    fn subscribers(&self, topic: usize) -> usize {
        // `notices` tells a failure, and asks again.
        self.writers[topic].publisher.get_subscription_count().unwrap_or(0)
    }

    fn notices(&mut self) -> Vec<String> {
        let mut notices: Vec<String> = self.spinning.errors.try_iter().collect();
        for writer in &mut self.writers {
            let name = writer.publisher.topic_name();
            let counted = writer.publisher.get_subscription_count();
            let listed = counted.and_then(|_| self.node.get_subscriptions_info_by_topic(&name));
            let subscriptions = match listed {
                Ok(subscriptions) => subscriptions,
                Err(error) => {
                    if !std::mem::replace(&mut writer.is_unknown, true) {
                        let reason = explain(&error);
                        notices.push(format!("subscribers of topic '{name}' are not known: {reason}"));
                    }
                    continue;
                }
            };
            writer.is_unknown = false;
            let policies: Vec<&str> =
                subscriptions.iter().filter_map(|s| incompatible(writer.qos, &s.qos_profile)).collect();
            if policies.len() > std::mem::replace(&mut writer.refused, policies.len()) {
                notices.push(format!(
                    "New subscription discovered on topic '{name}', requesting incompatible QoS. No messages \
                     will be sent to it. Last incompatible policy: {}",
                    policies.last().unwrap_or(&"")
                ));
            }
        }
        notices
    }

    fn drain(&mut self, limit: Duration) {
        if (0..self.writers.len()).any(|topic| self.subscribers(topic) > 0) {
            std::thread::sleep(limit.min(LINGER));
        }
    }
}
