"""The ROS graph as tools of ROS 2 see it, read with PyPI's cyclonedds, which shares no code with the publisher.

graph.py DOMAIN GID_BYTES WRITERS

Waits until a node with so many writers is told on `ros_discovery_info`, and says what `ros2 node list` and
`ros2 topic info -v` are made of, in a line of JSON: each participant's key and user data, the nodes with their
writers' identities, and each writer that DDS itself has discovered, by its identity.
"""

import json
import sys
import time

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant, BuiltinTopicDcpsPublication
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from subscriber import LOOPBACK, idl

PATIENCE_S = 20


def discovery_info(gid_bytes):
    """`ParticipantEntitiesInfo` of a distribution whose identities have so many bytes."""
    store = get_typestore(Stores.ROS2_JAZZY)
    if gid_bytes != 16:
        package = "rmw_dds_common/msg"
        store = get_typestore(Stores.EMPTY)
        for name, text in [
            ("Gid", f"char[{gid_bytes}] data"),
            ("NodeEntitiesInfo", "string node_namespace\nstring node_name\nGid[] reader_gid_seq\nGid[] writer_gid_seq"),
            ("ParticipantEntitiesInfo", "Gid gid\nNodeEntitiesInfo[] node_entities_info_seq"),
        ]:
            store.register(get_types_from_msg(text, f"{package}/{name}"))
    return idl(store, "rmw_dds_common/msg/ParticipantEntitiesInfo", {})


def user_data(qos):
    return bytes(qos[Policy.Userdata].data).decode() if Policy.Userdata in qos else ""


def hexadecimal(gid):
    return bytes(gid.data).hex()


def main():
    domain, gid_bytes, writers = (int(word) for word in sys.argv[1:4])
    keep = Domain(domain, LOOPBACK)
    participant = DomainParticipant(domain)
    qos = Qos(
        Policy.Reliability.Reliable(duration(seconds=1)),
        Policy.Durability.TransientLocal,
        Policy.History.KeepLast(1),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
    graph = DataReader(participant, Topic(participant, "ros_discovery_info", discovery_info(gid_bytes)), qos=qos)
    participants = BuiltinDataReader(participant, BuiltinTopicDcpsParticipant)
    publications = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    answer = {"participants": {}, "graph": {}, "writers": {}}
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        for sample in participants.take(100):
            answer["participants"][sample.key.bytes.hex()] = user_data(sample.qos)
        for sample in publications.take(100):
            answer["writers"][sample.key.bytes.hex()] = {
                "participant": sample.participant_key.bytes.hex(),
                "topic": sample.topic_name,
                "type": sample.type_name,
                "user_data": user_data(sample.qos),
                "reliable": isinstance(sample.qos[Policy.Reliability], Policy.Reliability.Reliable),
                "latched": sample.qos[Policy.Durability] == Policy.Durability.TransientLocal,
            }
        for sample in graph.take(10):
            answer["graph"][hexadecimal(sample.gid)] = [
                {
                    "namespace": node.node_namespace,
                    "name": node.node_name,
                    "readers": [hexadecimal(gid) for gid in node.reader_gid_seq],
                    "writers": [hexadecimal(gid) for gid in node.writer_gid_seq],
                }
                for node in sample.node_entities_info_seq
            ]
        nodes = [node for told in answer["graph"].values() for node in told]
        # Every writer of a topic, and that of the graph itself.
        if len(answer["writers"]) > writers and any(len(node["writers"]) >= writers for node in nodes):
            break
        time.sleep(0.02)
    del keep
    print(json.dumps(answer), flush=True)


main()
