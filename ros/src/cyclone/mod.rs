//! The embedded transport: Cyclone DDS, a C library that ROS 2 itself uses, linked into the program.
//! Subscribers see an ordinary ROS 2 node, and this machine needs no ROS.

#![expect(unsafe_code, reason = "Cyclone DDS's edge")]

mod config;
mod entity;
mod graph;
mod log;
mod sertype;

pub use config::{MAX_DOMAIN, NetworkOptions};

use crate::names;
use crate::payload::Payload;
use crate::plan::Topic;
use crate::qos::{Durability, Qos, Reliability};
use crate::transport::{Transport, TransportError};
use entity::{Entity, QosHandle, text_of};
use graph::Guid;
use std::ffi::CString;
use std::sync::Arc;
use std::time::{Duration, Instant};

struct Writer {
    topic: String,
    qos: Qos,
    entity: Entity,
    sertype: *const cyclors::ddsi_sertype,
    guid: Guid,
    incompatible: u32,
}

// SAFETY: Cyclone's entities may be used from any thread, and `sertype` is only passed back to Cyclone.
unsafe impl Send for Writer {}

/// A participant with its writers.
pub struct CycloneTransport {
    // Dropped in this order: the domain is last, deletes what is left, and frees the types that writers refer to.
    writers: Vec<Writer>,
    graph: Writer,
    participant: Entity,
    participant_guid: Guid,
    graph_is_stale: bool,
    /// The writer that has begun a datagram, if any.
    unsent: Option<usize>,
    _domain: Entity,
    options: NetworkOptions,
}

impl CycloneTransport {
    /// Joins the domain. The user's `CYCLONEDDS_URI` overrides the built-in configuration.
    pub fn open(options: NetworkOptions) -> Result<Self, TransportError> {
        let unavailable = |reason: String| TransportError::Unavailable(reason);
        names::check_node(&options.node).map_err(|error| unavailable(error.to_string()))?;
        if options.domain > MAX_DOMAIN {
            let expected = format!("expected 0 to {MAX_DOMAIN}");
            return Err(unavailable(format!("domain id {}, {expected}", options.domain)));
        }
        log::take_over();
        let user = std::env::var("CYCLONEDDS_URI").ok();
        let xml = options.xml(user.as_deref());
        let xml = CString::new(xml)
            .map_err(|_| unavailable("CYCLONEDDS_URI contains a zero character".to_owned()))?;
        // SAFETY: the text outlives the call.
        let domain = unsafe { cyclors::dds_create_domain(options.domain, xml.as_ptr()) };
        let domain = Entity::new(domain).map_err(|code| {
            unavailable(match code {
                cyclors::DDS_RETCODE_PRECONDITION_NOT_MET => {
                    format!("domain {} is open in this process already", options.domain)
                }
                code => format!("domain {}: {}", options.domain, log::explain(options.domain, code)),
            })
        })?;
        let qos = QosHandle::new();
        qos.set_user_data("enclave=/;");
        // SAFETY: the call copies the quality of service, which outlives it.
        let participant =
            unsafe { cyclors::dds_create_participant(options.domain, qos.as_ptr(), std::ptr::null()) };
        let participant = Entity::new(participant).map_err(|code| {
            unavailable(format!("domain {}: {}", options.domain, log::explain(options.domain, code)))
        })?;
        let participant_guid = participant.guid();
        let qos = (Qos::latched(), Duration::ZERO);
        let graph = create_writer(&participant, graph::TOPIC, graph::TYPE, Some(&graph::hash()), qos)?;
        let mut transport = CycloneTransport {
            writers: Vec::new(),
            graph,
            participant,
            participant_guid,
            graph_is_stale: false,
            unsent: None,
            _domain: domain,
            options,
        };
        transport.tell_graph();
        Ok(transport)
    }

    /// Publishes the list of the node's writers.
    fn tell_graph(&mut self) {
        let writers: Vec<Guid> = self.writers.iter().map(|writer| writer.guid).collect();
        let mut bytes = Vec::new();
        let gid_bytes = self.options.gid_bytes();
        graph::entities(&mut bytes, &self.participant_guid, &self.options.node, &writers, gid_bytes);
        // Tools show the graph. Messages are delivered without it.
        let _ = write(&self.graph, &Arc::new(Payload::new(bytes)));
        self.graph.entity.flush();
        self.graph_is_stale = false;
    }
}

/// Creates a topic on DDS and its writer.
fn create_writer(
    participant: &Entity,
    dds_topic: &str,
    dds_type: &str,
    type_hash: Option<&str>,
    (qos, patience): (Qos, Duration),
) -> Result<Writer, TransportError> {
    let fail = |code| TransportError::Topic { topic: dds_topic.to_owned(), reason: text_of(code) };
    let invalid = |_| fail(cyclors::DDS_RETCODE_BAD_PARAMETER);
    let (name, kind) = (CString::new(dds_topic).map_err(invalid)?, CString::new(dds_type).map_err(invalid)?);
    let handle = QosHandle::new();
    handle.set(qos, patience);
    if let Some(hash) = type_hash {
        handle.set_user_data(&format!("typehash={hash};"));
    }
    let mut sertype = sertype::new_sertype(&kind);
    // SAFETY: the calls copy all texts and qualities of service, which outlive them. The topic takes over the
    // type, and replaces the pointer if it already has an equal one.
    let writer = unsafe {
        let topic = cyclors::dds_create_topic_sertype(
            participant.id(),
            name.as_ptr(),
            &raw mut sertype,
            std::ptr::null(),
            std::ptr::null(),
            std::ptr::null(),
        );
        let topic = Entity::new(topic).map_err(|code| {
            // It was not taken over.
            cyclors::ddsi_sertype_unref(sertype);
            fail(code)
        })?;
        let writer =
            cyclors::dds_create_writer(participant.id(), topic.id(), handle.as_ptr(), std::ptr::null());
        // The writer keeps its topic alive, so this handle can go.
        drop(topic);
        Entity::new(writer).map_err(fail)?
    };
    let guid = writer.guid();
    Ok(Writer { topic: dds_topic.to_owned(), qos, entity: writer, sertype, guid, incompatible: 0 })
}

fn write(writer: &Writer, message: &Arc<Payload>) -> Result<(), i32> {
    let sample = sertype::new_sample(writer.sertype, message);
    // SAFETY: writer and type belong together, and the call takes over the sample's only reference.
    match unsafe { cyclors::dds_writecdr(writer.entity.id(), sample) } {
        0 => Ok(()),
        code => Err(code),
    }
}

impl Transport for CycloneTransport {
    fn name(&self) -> String {
        format!("Cyclone DDS, domain {}, node /{}", self.options.domain, self.options.node)
    }

    fn copies(&self) -> u32 {
        sertype::copies()
    }

    fn advertise(&mut self, topic: &Topic) -> Result<(), TransportError> {
        let fail = |reason: String| TransportError::Topic { topic: topic.name.clone(), reason };
        names::check_topic(&topic.name).map_err(|error| fail(error.to_string()))?;
        let kind = names::dds_type(&topic.type_name).ok_or_else(|| {
            fail(format!("`{}` is not a message type, expected pkg/msg/Name", topic.type_name))
        })?;
        let dds_topic = names::dds_topic(&topic.name);
        let (hash, qos) = (topic.type_hash.as_deref(), (topic.qos, topic.patience));
        let writer = create_writer(&self.participant, &dds_topic, &kind, hash, qos)?;
        self.writers.push(Writer { topic: topic.name.clone(), ..writer });
        self.graph_is_stale = true;
        Ok(())
    }

    fn publish(&mut self, topic: usize, message: &Arc<Payload>) -> Result<(), TransportError> {
        if self.graph_is_stale {
            self.tell_graph();
        }
        if self.unsent.is_some_and(|unsent| unsent != topic) {
            self.flush();
        }
        self.unsent = Some(topic);
        let writer = &self.writers[topic];
        write(writer, message).map_err(|code| TransportError::Message {
            topic: writer.topic.clone(),
            reason: match code {
                cyclors::DDS_RETCODE_TIMEOUT => {
                    "its history is full of messages that a subscriber has not fetched".to_owned()
                }
                code => text_of(code),
            },
        })
    }

    fn flush(&mut self) {
        if let Some(topic) = self.unsent.take() {
            self.writers[topic].entity.flush();
        }
    }

    fn subscribers(&self, topic: usize) -> usize {
        self.writers[topic].entity.matched()
    }

    fn notices(&mut self) -> Vec<String> {
        if self.graph_is_stale {
            self.tell_graph();
        }
        let mut notices = log::take(self.options.domain);
        for writer in &mut self.writers {
            let (count, policy) = writer.entity.incompatible();
            if count > std::mem::replace(&mut writer.incompatible, count) {
                notices.push(format!(
                    "New subscription discovered on topic '{}', requesting incompatible QoS. No messages will \
                     be sent to it. Last incompatible policy: {policy}",
                    writer.topic
                ));
            }
        }
        notices
    }

    fn drain(&mut self, limit: Duration) {
        self.flush();
        let until = Instant::now() + limit;
        for writer in self.writers.iter().filter(|w| w.qos.reliability == Reliability::Reliable) {
            writer.entity.wait_for_acks(until.saturating_duration_since(Instant::now()));
        }
    }

    fn holds_messages(&self) -> bool {
        true
    }
}

impl QosHandle {
    /// A topic's quality of service in Cyclone's terms.
    fn set(&self, qos: Qos, patience: Duration) {
        let reliability = match qos.reliability {
            Reliability::Reliable => cyclors::dds_reliability_kind_DDS_RELIABILITY_RELIABLE,
            Reliability::BestEffort => cyclors::dds_reliability_kind_DDS_RELIABILITY_BEST_EFFORT,
        };
        let durability = match qos.durability {
            Durability::TransientLocal => cyclors::dds_durability_kind_DDS_DURABILITY_TRANSIENT_LOCAL,
            Durability::Volatile => cyclors::dds_durability_kind_DDS_DURABILITY_VOLATILE,
        };
        let depth = i32::try_from(qos.depth).unwrap_or(i32::MAX);
        let xcdr1 = cyclors::DDS_DATA_REPRESENTATION_XCDR1 as cyclors::dds_data_representation_id_t;
        let keep_last = cyclors::dds_history_kind_DDS_HISTORY_KEEP_LAST;
        let q = self.as_ptr();
        // SAFETY: the handle is alive; the list of representations is copied.
        unsafe {
            cyclors::dds_qset_reliability(q, reliability, patience.as_nanos() as i64);
            cyclors::dds_qset_durability(q, durability);
            cyclors::dds_qset_history(q, keep_last, depth);
            cyclors::dds_qset_durability_service(q, 0, keep_last, depth, -1, -1, -1);
            cyclors::dds_qset_data_representation(q, 1, &raw const xcdr1);
            cyclors::dds_qset_writer_data_lifecycle(q, false);
            cyclors::dds_qset_writer_batching(q, true);
        }
    }
}
