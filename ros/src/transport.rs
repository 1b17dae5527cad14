//! Where messages go. A transport takes encoded messages, so that the same bytes reach every transport and
//! the bag.

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
    /// It cannot publish this topic.
    #[error("cannot publish `{topic}`: {reason}")]
    Topic {
        /// Topic.
        topic: String,
        /// What stands against it.
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

/// A way to subscribers.
pub trait Transport: Send {
    /// Its name, for people.
    fn name(&self) -> String;

    /// Copies that it has made of a message so far after [`Transport::publish`] was called, before the system's
    /// own.
    fn copies(&self) -> u32;

    /// Announces a topic. Topics are numbered from 0 in this order.
    fn advertise(&mut self, topic: &Topic) -> Result<(), TransportError>;

    /// Sends a message on topic number `topic`; waits no longer than the topic's patience. A small message may
    /// share a datagram with those that follow it on the topic, and leaves with [`Transport::flush`] at the
    /// latest.
    fn publish(&mut self, topic: usize, message: &Arc<Payload>) -> Result<(), TransportError>;

    /// Sends what waits for more messages.
    fn flush(&mut self) {}

    /// Subscribers of topic number `topic` now.
    fn subscribers(&self, topic: usize) -> usize;

    /// What has happened since the last call that people should know, such as subscribers whose quality of
    /// service cannot be met.
    fn notices(&mut self) -> Vec<String>;

    /// Waits until reliable subscribers have all that was sent, at most so long.
    fn drain(&mut self, limit: Duration);

    /// Whether it holds a message until reliable subscribers have it, so that how far they are can be told
    /// without a wait. Others are drained now and then by those who want to lose nothing.
    fn holds_messages(&self) -> bool {
        false
    }
}
