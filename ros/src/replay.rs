//! Publishes a recording again, with its timing.

use crate::bag::{BagError, BagReader};
use crate::payload::Payload;
use crate::transport::{Transport, TransportError};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};
use thiserror::Error;

/// Time between two polls for notices.
const NOTICES: Duration = Duration::from_secs(1);

/// Longest sleep between two looks whether to stop.
const NAP: Duration = Duration::from_millis(50);

/// Lowest speed. A recording of all times that its format has then still ends at a time that a clock has.
const LEAST_RATE: f64 = 1e-6;

/// Why a recording cannot be published.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// The recording.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// The network.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The rate is too low or no number.
    #[error("rate {0}, expected a number of {LEAST_RATE} or more")]
    Rate(f64),
}

/// How a recording is published.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReplayOptions {
    /// Speed; 2 is twice as fast. At least 0.000001.
    pub rate: f64,
    /// Time that subscribers have to find the topics before the first message.
    pub delay: Duration,
}

impl Default for ReplayOptions {
    fn default() -> Self {
        ReplayOptions { rate: 1.0, delay: Duration::from_millis(500) }
    }
}

/// What was published.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Replayed {
    /// Topics with their types and messages.
    pub topics: Vec<(String, String, u64)>,
    /// Messages sent.
    pub sent: u64,
    /// Messages that the transport refused.
    pub failed: u64,
    /// Recorded time from the first to the last message, nanoseconds.
    pub recorded_ns: u64,
    /// Messages that were recorded before others that stand before them in the file. They were sent late, in the file's order.
    pub out_of_order: u64,
    /// Whether the recording's end is missing, because its writer was stopped.
    pub truncated: bool,
    /// Channels that were skipped because their messages are not ROS 2's.
    pub foreign: Vec<String>,
}

/// How long after the first message one is sent that was recorded `since_ns` after it.
fn wait(since_ns: u64, rate: f64) -> Duration {
    Duration::from_nanos(since_ns).div_f64(rate)
}

/// Publishes `bag` until its end or until `stop` returns true. `watch` gets every notice.
pub fn replay(
    mut bag: BagReader,
    transport: &mut dyn Transport,
    options: ReplayOptions,
    mut stop: impl FnMut() -> bool,
    mut watch: impl FnMut(String),
) -> Result<Replayed, ReplayError> {
    if !(options.rate.is_finite() && options.rate >= LEAST_RATE) {
        return Err(ReplayError::Rate(options.rate));
    }
    let mut replayed = Replayed::default();
    let (mut told, mut refused) = (Instant::now(), BTreeSet::new());
    let mut start: Option<(Instant, u64)> = None;
    let mut latest_ns = 0;
    while let Some(message) = bag.next_message()? {
        for topic in &bag.topics()[replayed.topics.len()..] {
            transport.advertise(topic)?;
            replayed.topics.push((topic.name.clone(), topic.type_name.clone(), 0));
        }
        let (began, first_ns) = *start.get_or_insert_with(|| (Instant::now(), message.log_ns));
        let since_ns = message.log_ns.saturating_sub(first_ns);
        replayed.recorded_ns = replayed.recorded_ns.max(since_ns);
        replayed.out_of_order += u64::from(message.log_ns < latest_ns);
        latest_ns = latest_ns.max(message.log_ns);
        let due = options.delay.saturating_add(wait(since_ns, options.rate));
        let left = || due.saturating_sub(began.elapsed());
        while !left().is_zero() && !stop() {
            std::thread::sleep(left().min(NAP));
        }
        if stop() {
            break;
        }
        let topic = message.topic;
        match transport.publish(topic, &Arc::new(Payload::new(message.bytes))) {
            Ok(()) => {
                replayed.sent += 1;
                replayed.topics[topic].2 += 1;
            }
            Err(error) => {
                replayed.failed += 1;
                if refused.insert(topic) {
                    watch(format!("{error}; others of this topic are counted alone"));
                }
            }
        }
        transport.flush();
        if told.elapsed() >= NOTICES {
            told = Instant::now();
            transport.notices().into_iter().for_each(&mut watch);
        }
    }
    transport.drain(Duration::from_secs(2));
    (replayed.truncated, replayed.foreign) = (bag.is_truncated(), bag.foreign());
    if let Some(error) = bag.without_messages().filter(|_| replayed.topics.is_empty()) {
        return Err(error.into());
    }
    Ok(replayed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bag::BagWriter;
    use crate::plan::Topic;
    use crate::qos::Qos;

    /// A network without subscribers.
    struct Nobody;

    impl Transport for Nobody {
        fn name(&self) -> String {
            "nobody".to_owned()
        }
        fn copies(&self) -> u32 {
            0
        }
        fn advertise(&mut self, _: &Topic) -> Result<(), TransportError> {
            Ok(())
        }
        fn publish(&mut self, _: usize, _: &Arc<Payload>) -> Result<(), TransportError> {
            Ok(())
        }
        fn subscribers(&self, _: usize) -> usize {
            0
        }
        fn notices(&mut self) -> Vec<String> {
            Vec::new()
        }
        fn drain(&mut self, _: Duration) {}
    }

    #[test]
    fn messages_that_come_too_late_in_the_file_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut bag = BagWriter::create(&path).unwrap();
        bag.add_topic(&Topic {
            name: "/chat".to_owned(),
            type_name: "std_msgs/msg/String".to_owned(),
            type_hash: None,
            schema: "string data".to_owned(),
            qos: Qos::sensor_data(10),
            patience: Duration::ZERO,
        })
        .unwrap();
        for log_ns in [5, 5, 9, 3, 8, 10] {
            bag.write(0, log_ns, &[0, 1, 0, 0]).unwrap();
        }
        bag.finish().unwrap();
        let options = ReplayOptions { delay: Duration::ZERO, ..ReplayOptions::default() };
        let bag = BagReader::open(&path).unwrap();
        let replayed = replay(bag, &mut Nobody, options, || false, |_| ()).unwrap();
        assert_eq!((replayed.sent, replayed.out_of_order, replayed.recorded_ns), (6, 2, 5));
    }

    #[test]
    fn the_lowest_rate_is_one_that_clocks_can_wait_for() {
        let longest = wait(u64::MAX, LEAST_RATE);
        assert!(Instant::now().checked_add(longest).is_some(), "{longest:?}");
        assert_eq!(wait(3_000, 2.0), Duration::from_nanos(1_500));
    }
}
