//! The ROS graph on DDS: the message that lists a node's writers. `ros2 node list` and the node names of
//! `ros2 topic info -v` need it; `ros2 topic echo` does not.

use crate::cdr::CdrWriter;
use crate::definition::Texts;
use crate::message::texts;
use crate::type_hash::type_hash;

/// Topic on DDS. Only topics of users have the prefix `rt`.
pub(super) const TOPIC: &str = "ros_discovery_info";
/// Type on DDS.
pub(super) const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";

/// Bytes of an entity's identity on DDS.
pub(super) type Guid = [u8; 16];

/// Type hash of the message.
pub(super) fn hash() -> String {
    let all: &Texts = texts();
    type_hash("rmw_dds_common/msg/ParticipantEntitiesInfo", all)
        .expect("the built-in definitions are complete")
}

/// `ParticipantEntitiesInfo` of a participant with one node. An identity has 24 bytes in ROS 2 Humble and 16
/// in later distributions.
pub(super) fn entities(
    out: &mut Vec<u8>,
    participant: &Guid,
    node: &str,
    writers: &[Guid],
    gid_bytes: usize,
) {
    let mut cdr = CdrWriter::new(out);
    let gid = |cdr: &mut CdrWriter<'_>, guid: &Guid| {
        cdr.raw(guid);
        cdr.raw(&vec![0; gid_bytes - guid.len()]);
    };
    gid(&mut cdr, participant);
    cdr.u32(1).string("/").string(node);
    // No readers.
    cdr.u32(0).u32(writers.len() as u32);
    writers.iter().for_each(|writer| gid(&mut cdr, writer));
}
