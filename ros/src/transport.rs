//! The interface of transports. A transport sends encoded messages, so that every transport and the recording
//! get the same bytes.

use crate::payload::Payload;
use crate::plan::Topic;
use std::sync::Arc;
use std::time::Duration;
use thiserror::Error;

/// Why a transport cannot do something.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum TransportError {
    /// It cannot be opened at all.
    #[error("no ROS 2 network: {0}")]
    Unavailable(String),
    /// This transport, or this build, does not have what is asked for.
    #[error("{0}")]
    Unsupported(String),
    /// It cannot publish this topic.
    #[error("cannot publish `{topic}`: {reason}")]
    Topic {
        /// Topic.
        topic: String,
        /// Why.
        reason: String,
    },
    /// A message was not sent.
    #[error("a message on `{topic}` was not sent: {reason}")]
    Message {
        /// Topic.
        topic: String,
        /// Why.
        reason: String,
    },
}

/// Sends messages to subscribers.
pub trait Transport: Send {
    /// Its name, for the report.
    fn name(&self) -> String;

    /// How often a message's bytes are copied between [`Transport::publish`] and the system call, as far as
    /// known.
    fn copies(&self) -> u32;

    /// Announces a topic. Topics are numbered from 0 in this order.
    fn advertise(&mut self, topic: &Topic) -> Result<(), TransportError>;

    /// Sends a message on topic number `topic`. Waits no longer than the topic's patience. A small message
    /// may wait for others to share its datagram; [`Transport::flush`] sends it at the latest.
    fn publish(&mut self, topic: usize, message: &Arc<Payload>) -> Result<(), TransportError>;

    /// Sends messages that wait for others.
    fn flush(&mut self) {}

    /// Subscribers of topic number `topic` now.
    fn subscribers(&self, topic: usize) -> usize;

    /// Messages for the user since the last call, for example about a subscriber whose quality of service
    /// cannot be met.
    fn notices(&mut self) -> Vec<String>;

    /// Waits until reliable subscribers have all messages, at most `limit`.
    fn drain(&mut self, limit: Duration);

    /// Whether it keeps a message's buffer until reliable subscribers have the message. A lossless rig then
    /// sees how far they are without waiting; other transports it has to drain.
    fn holds_messages(&self) -> bool {
        false
    }
}
