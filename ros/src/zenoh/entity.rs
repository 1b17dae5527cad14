//! Names on Zenoh, as the design document of `rmw_zenoh` defines them: keys of topics, liveliness tokens that
//! make up the ROS graph, and the identities that follow from the tokens.

use crate::names;
use crate::plan::Topic;
use crate::qos::{Durability, Qos, Reliability};
use twox_hash::XxHash3_128;

/// Identity of a publisher on the ROS graph.
pub(super) type Gid = [u8; 16];

/// The first part of a token's key. Wildcards of topics never match it.
const ADMIN_SPACE: &str = "@ros2_lv";

/// `rmw_zenoh`'s default history, which tokens leave out.
const DEFAULT_DEPTH: u32 = 42;

/// Stands for an unknown type hash, as in ROS 2 Humble.
const NO_HASH: &str = "TypeHashNotSupported";

/// A topic's name and type in keys.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct TopicKey {
    name: String,
    kind: String,
    hash: String,
}

impl TopicKey {
    /// `None` if the topic's type name is not one. `has_hashes`: whether the distribution's types have
    /// hashes.
    pub fn new(topic: &Topic, has_hashes: bool) -> Option<Self> {
        let hash = topic.type_hash.clone().filter(|_| has_hashes);
        Some(TopicKey {
            name: topic.name.clone(),
            kind: names::dds_type(&topic.type_name)?,
            hash: hash.unwrap_or_else(|| NO_HASH.to_owned()),
        })
    }

    /// The key of the topic's messages: `<domain>/<topic>/<type>/<type hash>`.
    pub fn messages(&self, domain: u32) -> String {
        format!("{domain}/{}/{}/{}", self.name.trim_matches('/'), self.kind, self.hash)
    }
}

/// A node. It is the only one of its session and has no namespace.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub domain: u32,
    pub session: String,
    pub name: String,
}

impl Node {
    /// Number of the node in its session.
    const NUMBER: u32 = 0;

    fn token(&self, entity: u32, kind: &str) -> String {
        let Node { domain, session, name } = self;
        // No enclave, no namespace.
        format!("{ADMIN_SPACE}/{domain}/{session}/{}/{entity}/{kind}/%/%/{name}", Self::NUMBER)
    }

    /// The token of the node itself.
    pub fn node_token(&self) -> String {
        self.token(Self::NUMBER, "NN")
    }

    /// The token of its publisher number `entity`, counted from 1.
    pub fn publisher_token(&self, entity: u32, topic: &TopicKey, qos: Qos) -> String {
        let name = topic.name.replace('/', "%");
        format!("{}/{name}/{}/{}/{}", self.token(entity, "MP"), topic.kind, topic.hash, quality(qos))
    }
}

/// A key that matches the tokens of all subscriptions of a domain.
pub(super) fn subscriptions(domain: u32) -> String {
    format!("{ADMIN_SPACE}/{domain}/*/*/*/MS/**")
}

/// The topic of a subscription's token. `None` for other tokens.
pub(super) fn subscribed(token: &str) -> Option<TopicKey> {
    let parts: Vec<&str> = token.split('/').collect();
    match parts[..] {
        [ADMIN_SPACE, _, _, _, _, "MS", _, _, _, name, kind, hash, _] => {
            Some(TopicKey { name: name.replace('%', "/"), kind: kind.to_owned(), hash: hash.to_owned() })
        }
        _ => None,
    }
}

impl TopicKey {
    /// Whether both have the same name.
    pub fn has_name_of(&self, other: &TopicKey) -> bool {
        self.name == other.name
    }
}

impl std::fmt::Display for TopicKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({})", self.kind, self.hash)
    }
}

/// Quality of service in rmw's numbers, without those that are defaults:
/// `reliability:durability:history,depth:deadline:lifespan:liveliness,lease`.
fn quality(qos: Qos) -> String {
    let reliability = if qos.reliability == Reliability::BestEffort { "2" } else { "" };
    let durability = if qos.durability == Durability::TransientLocal { "1" } else { "" };
    let depth = if qos.depth == DEFAULT_DEPTH { String::new() } else { qos.depth.to_string() };
    format!("{reliability}:{durability}:,{depth}:,:,:,,")
}

/// The identity of the entity with this token: the token's hash, lower half first.
pub(super) fn gid(token: &str) -> Gid {
    XxHash3_128::oneshot(token.as_bytes()).to_le_bytes()
}

/// The attachment of a message: its number counted from 1, the time at which it was sent, and the publisher's
/// identity.
pub(super) fn attachment(sequence: i64, sent_ns: i64, gid: Gid) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(33);
    bytes.extend(sequence.to_le_bytes());
    bytes.extend(sent_ns.to_le_bytes());
    // Zenoh's serialisation writes an array's length first.
    bytes.push(gid.len() as u8);
    bytes.extend(gid);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn chatter(depth: u32) -> (TopicKey, Qos) {
        let hash = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
        let topic = Topic {
            name: "/chatter".to_owned(),
            type_name: "std_msgs/msg/String".to_owned(),
            type_hash: Some(hash.to_owned()),
            schema: String::new(),
            qos: Qos::sensor_data(depth),
            patience: Duration::ZERO,
        };
        (TopicKey::new(&topic, true).unwrap(), topic.qos)
    }

    #[test]
    fn keys_and_tokens_are_those_of_the_design_document() {
        let (topic, qos) = chatter(7);
        let end = "std_msgs::msg::dds_::String_/\
                   RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
        assert_eq!(topic.messages(0), format!("0/chatter/{end}"));
        let session = "8b20917502ee955ac4476e0266340d5c".to_owned();
        let node = Node { domain: 2, session, name: "talker".to_owned() };
        let start = "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0";
        assert_eq!(node.node_token(), format!("{start}/0/NN/%/%/talker"));
        let expected = format!("{start}/10/MP/%/%/talker/%chatter/{end}/::,7:,:,:,,");
        assert_eq!(node.publisher_token(10, &topic, qos), expected);
        let token = format!("{start}/10/MS/%/%/listener/%chatter/{end}/::,10:,:,:,,");
        assert_eq!(subscribed(&token), Some(topic));
        assert_eq!(subscribed(&expected), None);
    }

    #[test]
    fn qualities_say_what_is_no_default() {
        assert_eq!(quality(Qos::sensor_data(42)), "::,:,:,:,,");
        assert_eq!(quality(Qos::latched()), ":1:,1:,:,:,,");
        let best_effort = Qos { reliability: Reliability::BestEffort, ..Qos::sensor_data(5) };
        assert_eq!(quality(best_effort), "2::,5:,:,:,,");
    }

    #[test]
    fn an_identity_is_the_tokens_xxh3_lower_half_first() {
        // XXH3's own value for the empty text, 99aa06d3014798d8 6001c324468d497f.
        let expected = [0x7f, 0x49, 0x8d, 0x46, 0x24, 0xc3, 0x01, 0x60, 0xd8, 0x98, 0x47, 0x01, 0xd3];
        assert_eq!(gid("")[..13], expected);
        assert_eq!(attachment(1, -1, gid("")).len(), 33);
    }
}
