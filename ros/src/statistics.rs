//! Counts what the publisher sends and loses. Every lost message is counted here and appears on
//! `/diagnostics`.

use crate::encode::Status;
use crate::histogram::Histogram;
use crate::plan::Plan;
use crate::queue::Dropped;
use crate::transport::Transport;
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

#[derive(Debug, Default)]
struct Counts {
    sent: AtomicU64,
    bytes: AtomicU64,
    failed: AtomicU64,
    dropped: AtomicU64,
    recorded: AtomicU64,
    subscribers: AtomicU64,
}

/// What is known of a camera besides its messages, for `/diagnostics`: what was counted, and what a user should look
/// into.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CameraStatus {
    /// Names and values.
    pub values: Vec<(String, String)>,
    /// A line each; none if all is well.
    pub warnings: Vec<String>,
}

/// Counters that the rig's thread and the publisher's thread share.
#[derive(Debug)]
pub(crate) struct Statistics {
    transport: Option<String>,
    host_copies: AtomicU32,
    wire_copies: AtomicU32,
    records: bool,
    topics: Vec<Counts>,
    dropped_ticks: AtomicU64,
    resets: AtomicU64,
    unannounced_resets: AtomicU64,
    encode_ns: Mutex<Histogram>,
    publish_ns: Mutex<Histogram>,
    tick_ns: Mutex<Histogram>,
    /// Names and states of the cameras of which anything was told.
    cameras: Mutex<BTreeMap<usize, (String, CameraStatus)>>,
}

/// How often a packet's bytes are copied between the device's memory and the system calls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Copies {
    /// Before the publisher gets the packet: 0 if every packet was a view of the device's memory, 1 if some
    /// owned their events.
    pub packet: u32,
    /// By encoding, into the buffer that is sent.
    pub encode: u32,
    /// From that buffer to the system's socket.
    pub wire: u32,
    /// From that buffer into the recording's chunk.
    pub bag: u32,
}

/// Counts of a topic's messages.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct TopicSummary {
    /// Name.
    pub topic: String,
    /// Messages sent.
    pub sent: u64,
    /// Bytes sent.
    pub bytes: u64,
    /// Messages that the transport refused.
    pub failed: u64,
    /// Messages that were dropped because the queue was full.
    pub dropped: u64,
    /// Messages recorded.
    pub recorded: u64,
    /// Subscribers at the last poll, once a second.
    pub subscribers: u64,
}

/// Counts of all messages.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// Name of the transport, if there is one.
    pub transport: Option<String>,
    /// By topic.
    pub topics: Vec<TopicSummary>,
    /// Ticks dropped because the queue was full.
    pub dropped_ticks: u64,
    /// How often the simulation's time went back.
    pub time_resets: u64,
    /// How often a camera's time went back although no reset was announced.
    pub unannounced_resets: u64,
    /// Copies of a packet's bytes.
    pub copies: Copies,
    /// Median time to encode an event message, nanoseconds.
    pub encode_p50_ns: u64,
    /// 99th percentile of the same.
    pub encode_p99_ns: u64,
    /// Median time of the call that publishes a message, nanoseconds.
    pub publish_p50_ns: u64,
    /// 99th percentile of the same.
    pub publish_p99_ns: u64,
    /// Median time from the end of a tick's encoding until it is sent and recorded, nanoseconds.
    pub tick_p50_ns: u64,
    /// 99th percentile of the same.
    pub tick_p99_ns: u64,
}

impl Summary {
    /// Sum over the topics.
    fn sum(&self, of: fn(&TopicSummary) -> u64) -> u64 {
        self.topics.iter().map(of).sum()
    }

    /// Messages sent.
    #[must_use]
    pub fn sent(&self) -> u64 {
        self.sum(|topic| topic.sent)
    }

    /// Messages recorded.
    #[must_use]
    pub fn recorded(&self) -> u64 {
        self.sum(|topic| topic.recorded)
    }

    /// Messages that were dropped because the queue was full.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.sum(|topic| topic.dropped)
    }

    /// Messages that the transport refused.
    #[must_use]
    pub fn failed(&self) -> u64 {
        self.sum(|topic| topic.failed)
    }

    /// Messages that were dropped, or refused by the transport.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.dropped() + self.failed()
    }

    /// What became of the lost messages.
    fn losses(&self) -> String {
        format!("{} dropped in {} ticks, {} failed", self.dropped(), self.dropped_ticks, self.failed())
    }

    /// One line of text.
    #[must_use]
    pub fn to_text(&self) -> String {
        let Copies { packet, encode, wire, bag } = self.copies;
        let way = self.transport.as_deref().unwrap_or("not sent");
        format!(
            "{way}; {} messages sent, {} recorded, {}; copies of a packet after the \
             readback: {packet} before it is encoded, {encode} to encode, {wire} to send, {bag} to record; \
             encoding {:.0} us (p50), {:.0} us (p99), publish call {:.0} us (p50), {:.0} us (p99)",
            self.sent(),
            self.recorded(),
            self.losses(),
            self.encode_p50_ns as f64 * 1e-3,
            self.encode_p99_ns as f64 * 1e-3,
            self.publish_p50_ns as f64 * 1e-3,
            self.publish_p99_ns as f64 * 1e-3,
        )
    }
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn ns(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

impl Statistics {
    pub fn new(plan: &Plan, transport: Option<&dyn Transport>, records: bool) -> Self {
        Statistics {
            transport: transport.map(Transport::name),
            host_copies: AtomicU32::default(),
            wire_copies: AtomicU32::new(transport.map_or(0, Transport::copies)),
            records,
            topics: plan.topics.iter().map(|_| Counts::default()).collect(),
            dropped_ticks: AtomicU64::default(),
            resets: AtomicU64::default(),
            unannounced_resets: AtomicU64::default(),
            encode_ns: Mutex::default(),
            publish_ns: Mutex::default(),
            tick_ns: Mutex::default(),
            cameras: Mutex::default(),
        }
    }

    pub fn set_camera(&self, camera: usize, name: &str, status: CameraStatus) {
        lock(&self.cameras).insert(camera, (name.to_owned(), status));
    }

    pub fn count_packet(&self, host_copies: u32) {
        self.host_copies.fetch_max(host_copies, Relaxed);
    }

    pub fn count_encoded(&self, took: Duration) {
        lock(&self.encode_ns).add(ns(took));
    }

    pub fn set_wire_copies(&self, copies: u32) {
        self.wire_copies.store(copies, Relaxed);
    }

    pub fn count_sent(&self, topic: usize, bytes: usize, took: Duration) {
        let counts = &self.topics[topic];
        counts.sent.fetch_add(1, Relaxed);
        counts.bytes.fetch_add(bytes as u64, Relaxed);
        lock(&self.publish_ns).add(ns(took));
    }

    pub fn count_failed(&self, topic: usize) {
        self.topics[topic].failed.fetch_add(1, Relaxed);
    }

    pub fn count_recorded(&self, topic: usize) {
        self.topics[topic].recorded.fetch_add(1, Relaxed);
    }

    pub fn count_dropped(&self, dropped: &Dropped) {
        self.dropped_ticks.fetch_add(dropped.ticks, Relaxed);
        for message in &dropped.messages {
            self.topics[message.topic].dropped.fetch_add(1, Relaxed);
        }
    }

    pub fn count_tick(&self, since_encoded: Duration) {
        lock(&self.tick_ns).add(ns(since_encoded));
    }

    pub fn set_subscribers(&self, topic: usize, subscribers: usize) {
        self.topics[topic].subscribers.store(subscribers as u64, Relaxed);
    }

    pub fn count_unannounced_reset(&self) {
        self.unannounced_resets.fetch_add(1, Relaxed);
    }

    pub fn set_resets(&self, resets: u64) {
        self.resets.store(resets, Relaxed);
    }

    pub fn summary(&self, plan: &Plan) -> Summary {
        let topics = plan.topics.iter().zip(&self.topics).map(|(topic, counts)| TopicSummary {
            topic: topic.name.clone(),
            sent: counts.sent.load(Relaxed),
            bytes: counts.bytes.load(Relaxed),
            failed: counts.failed.load(Relaxed),
            dropped: counts.dropped.load(Relaxed),
            recorded: counts.recorded.load(Relaxed),
            subscribers: counts.subscribers.load(Relaxed),
        });
        let [encode, publish, tick] =
            [&self.encode_ns, &self.publish_ns, &self.tick_ns].map(|histogram| lock(histogram).clone());
        Summary {
            transport: self.transport.clone(),
            topics: topics.collect(),
            dropped_ticks: self.dropped_ticks.load(Relaxed),
            time_resets: self.resets.load(Relaxed),
            unannounced_resets: self.unannounced_resets.load(Relaxed),
            copies: Copies {
                packet: self.host_copies.load(Relaxed),
                encode: 1,
                wire: self.wire_copies.load(Relaxed),
                bag: self.records.into(),
            },
            encode_p50_ns: encode.quantile(0.5),
            encode_p99_ns: encode.quantile(0.99),
            publish_p50_ns: publish.quantile(0.5),
            publish_p99_ns: publish.quantile(0.99),
            tick_p50_ns: tick.quantile(0.5),
            tick_p99_ns: tick.quantile(0.99),
        }
    }

    /// The counts for `/diagnostics`: of the whole publisher, of each topic that lost messages, and what is known of the
    /// cameras.
    pub fn statuses(&self, plan: &Plan, node: &str) -> Vec<Status> {
        let summary = self.summary(plan);
        let lost = summary.lost();
        let figures = |t: &TopicSummary| {
            named([
                ("sent", t.sent.to_string()),
                ("dropped", t.dropped.to_string()),
                ("failed", t.failed.to_string()),
                ("subscribers", t.subscribers.to_string()),
            ])
        };
        let mut statuses = vec![Status {
            warn: lost > 0 || summary.unannounced_resets > 0,
            name: format!("{node}: publisher"),
            message: match (lost, summary.unannounced_resets) {
                (0, 0) => "nothing lost".to_owned(),
                (0, back) => format!("a camera's time went back {back} times without a restart"),
                (lost, _) => format!("{lost} messages lost: {}", summary.losses()),
            },
            values: named([
                ("sent", summary.sent().to_string()),
                ("recorded", summary.recorded().to_string()),
                ("lost", lost.to_string()),
                ("dropped_ticks", summary.dropped_ticks.to_string()),
                ("time_resets", summary.time_resets.to_string()),
                ("unannounced_resets", summary.unannounced_resets.to_string()),
                ("publish_p50_ns", summary.publish_p50_ns.to_string()),
                ("publish_p99_ns", summary.publish_p99_ns.to_string()),
            ]),
        }];
        let losing = summary.topics.iter().filter(|t| t.dropped + t.failed > 0);
        statuses.extend(losing.map(|topic| Status {
            warn: true,
            name: format!("{node}: {}", topic.topic),
            message: format!("{} messages lost", topic.dropped + topic.failed),
            values: figures(topic),
        }));
        statuses.extend(lock(&self.cameras).values().map(|(name, status)| Status {
            warn: !status.warnings.is_empty(),
            name: format!("{node}: camera {name}"),
            message: match &status.warnings[..] {
                [] => "no warning".to_owned(),
                warnings => warnings.join("; "),
            },
            values: status.values.clone(),
        }));
        statuses
    }
}

fn named<const N: usize>(values: [(&str, String); N]) -> Vec<(String, String)> {
    values.map(|(name, value)| (name.to_owned(), value)).to_vec()
}
