//! Publishes on Zenoh in the format of `rmw_zenoh`, whose nodes see an ordinary ROS 2 node. Sessions find
//! each other through a router (`ros2 run rmw_zenoh_cpp rmw_zenohd`) and then exchange messages directly.

mod config;
mod entity;

use crate::cyclone::NetworkOptions;
use crate::names;
use crate::payload::Payload;
use crate::plan::Topic;
use crate::qos::{Durability, Reliability};
use crate::transport::{Transport, TransportError};
use bytes::Bytes;
use entity::{Gid, Node, TopicKey};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::CongestionControl;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};
use zenoh_ext::{AdvancedPublisher, AdvancedPublisherBuilderExt, CacheConfig, MissDetectionConfig};

/// Time between two heartbeats of a latched topic that has new messages. A heartbeat lets subscribers find
/// losses.
const HEARTBEAT: Duration = Duration::from_millis(500);

/// Time without a router or a peer after which there is a notice.
const ALONE: Duration = Duration::from_secs(2);

struct Publisher {
    topic: String,
    key: TopicKey,
    // Dropped before the publisher, so that the topic leaves the graph first.
    _token: LivelinessToken,
    publisher: AdvancedPublisher<'static>,
    gid: Gid,
    sequence: i64,
}

/// Tokens of the domain's subscriptions, and those that no notice has mentioned yet.
#[derive(Default)]
struct Subscriptions {
    here: BTreeSet<String>,
    new: Vec<String>,
}

/// A session with one node and its publishers.
pub struct ZenohTransport {
    publishers: Vec<Publisher>,
    _node_token: LivelinessToken,
    subscriptions: Arc<Mutex<Subscriptions>>,
    node: Node,
    options: NetworkOptions,
    opened: Instant,
    told_alone: bool,
    session: Session,
}

impl ZenohTransport {
    /// Opens a session. It uses `rmw_zenoh`'s environment variables `ZENOH_SESSION_CONFIG_URI` and
    /// `ZENOH_CONFIG_OVERRIDE`, which also choose the network interface. `get` reads a variable.
    pub fn open(
        options: NetworkOptions,
        get: impl Fn(&str) -> Option<String>,
    ) -> Result<Self, TransportError> {
        let unavailable = |reason: String| TransportError::Unavailable(reason);
        names::check_node(&options.node).map_err(|error| unavailable(error.to_string()))?;
        if let Some(name) = &options.interface {
            let instead = "with Zenoh ZENOH_CONFIG_OVERRIDE chooses it, by listen/endpoints";
            return Err(unavailable(format!("interface `{name}`: {instead}")));
        }
        let config = config::configuration(get).map_err(unavailable)?;
        let failed = |error: zenoh::Error| unavailable(error.to_string());
        let session = zenoh::open(config).wait().map_err(failed)?;
        let node =
            Node { domain: options.domain, session: session.zid().to_string(), name: options.node.clone() };
        let node_token = session.liveliness().declare_token(node.node_token()).wait().map_err(failed)?;
        let subscriptions = Arc::<Mutex<Subscriptions>>::default();
        let seen = Arc::clone(&subscriptions);
        session
            .liveliness()
            .declare_subscriber(entity::subscriptions(options.domain))
            .history(true)
            .callback(move |sample| Subscriptions::note(&seen, &sample))
            .background()
            .wait()
            .map_err(failed)?;
        Ok(ZenohTransport {
            publishers: Vec::new(),
            _node_token: node_token,
            subscriptions,
            node,
            options,
            opened: Instant::now(),
            told_alone: false,
            session,
        })
    }

    /// Whether no router and no peer is connected.
    fn is_alone(&self) -> bool {
        let info = self.session.info();
        info.routers_zid().wait().next().is_none() && info.peers_zid().wait().next().is_none()
    }
}

impl Subscriptions {
    fn note(all: &Mutex<Self>, sample: &Sample) {
        let token = sample.key_expr().as_str().to_owned();
        let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
        match sample.kind() {
            SampleKind::Put => {
                if all.here.insert(token.clone()) {
                    all.new.push(token);
                }
            }
            SampleKind::Delete => drop(all.here.remove(&token)),
        }
    }
}

/// A payload that Zenoh reads in place.
struct InPlace(Arc<Payload>);

impl AsRef<[u8]> for InPlace {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

impl Transport for ZenohTransport {
    fn name(&self) -> String {
        format!("Zenoh, domain {}, node /{}", self.options.domain, self.options.node)
    }

    fn copies(&self) -> u32 {
        // Into the link's batches.
        1
    }

    fn advertise(&mut self, topic: &Topic) -> Result<(), TransportError> {
        let fail = |reason: String| TransportError::Topic { topic: topic.name.clone(), reason };
        let failed = |error: zenoh::Error| fail(error.to_string());
        names::check_topic(&topic.name).map_err(|error| fail(error.to_string()))?;
        let key = TopicKey::new(topic, self.options.has_type_hashes()).ok_or_else(|| {
            fail(format!("`{}` is not a message type, expected pkg/msg/Name", topic.type_name))
        })?;
        let reliable = topic.qos.reliability == Reliability::Reliable;
        let mut publisher = self
            .session
            .declare_publisher(key.messages(self.options.domain))
            // Zenoh does not report what it drops. So a reliable message waits for room, and meanwhile the
            // queue of ticks fills up, which counts what it drops.
            .congestion_control(if reliable { CongestionControl::Block } else { CongestionControl::Drop })
            .reliability(if reliable {
                zenoh::qos::Reliability::Reliable
            } else {
                zenoh::qos::Reliability::BestEffort
            })
            .advanced();
        if topic.qos.durability == Durability::TransientLocal {
            let cache = CacheConfig::default().max_samples(topic.qos.depth as usize);
            publisher = publisher.publisher_detection().cache(cache);
            if reliable {
                let misses = MissDetectionConfig::default().sporadic_heartbeat(HEARTBEAT);
                publisher = publisher.sample_miss_detection(misses);
            }
        }
        let publisher = publisher.wait().map_err(failed)?;
        let token = self.node.publisher_token(self.publishers.len() as u32 + 1, &key, topic.qos);
        let gid = entity::gid(&token);
        let token = self.session.liveliness().declare_token(token).wait().map_err(failed)?;
        let topic = topic.name.clone();
        self.publishers.push(Publisher { topic, key, _token: token, publisher, gid, sequence: 1 });
        Ok(())
    }

    fn publish(&mut self, topic: usize, message: &Arc<Payload>) -> Result<(), TransportError> {
        let publisher = &mut self.publishers[topic];
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let attachment = entity::attachment(publisher.sequence, now.as_nanos() as i64, publisher.gid);
        publisher.sequence += 1;
        let payload = Bytes::from_owner(InPlace(Arc::clone(message)));
        publisher.publisher.put(payload).attachment(attachment).wait().map_err(|error| {
            TransportError::Message { topic: publisher.topic.clone(), reason: error.to_string() }
        })
    }

    fn subscribers(&self, topic: usize) -> usize {
        let key = &self.publishers[topic].key;
        let all = self.subscriptions.lock().unwrap_or_else(PoisonError::into_inner);
        all.here.iter().filter(|token| entity::subscribed(token).as_ref() == Some(key)).count()
    }

    fn notices(&mut self) -> Vec<String> {
        let mut all = self.subscriptions.lock().unwrap_or_else(PoisonError::into_inner);
        let new = std::mem::take(&mut all.new);
        drop(all);
        let mut notices = Vec::new();
        for subscribed in new.iter().filter_map(|token| entity::subscribed(token)) {
            // Zenoh matches any quality of service, but not another type.
            let of_name = self.publishers.iter().find(|publisher| publisher.key.has_name_of(&subscribed));
            if let Some(publisher) = of_name.filter(|publisher| publisher.key != subscribed) {
                notices.push(format!(
                    "New subscription discovered on topic '{}' with another type: {subscribed}, expected {}. No \
                     messages will be sent to it",
                    publisher.topic, publisher.key
                ));
            }
        }
        if !self.told_alone && self.opened.elapsed() > ALONE && self.is_alone() {
            self.told_alone = true;
            notices.push(
                "no Zenoh router or peer yet; on this machine: ros2 run rmw_zenoh_cpp rmw_zenohd".to_owned(),
            );
        }
        notices
    }

    fn drain(&mut self, _: Duration) {
        // Zenoh has no acknowledgements. Closing the session sends what waits.
    }

    fn holds_messages(&self) -> bool {
        // Until they are on their way; Zenoh does not tell when they arrive.
        true
    }
}

impl Drop for ZenohTransport {
    fn drop(&mut self) {
        self.publishers.clear();
        // An error means that the session is closed already.
        let _ = self.session.close().wait();
    }
}
