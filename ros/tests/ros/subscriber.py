"""Two readers that share no code with the publisher's encoder.

subscriber.py check BAG                    reads a recording with PyPI's rosbags
subscriber.py listen DOMAIN BAG TOPIC=TYPE[=transient_local] ...
                                           subscribes with PyPI's cyclonedds as well, says `ready` and
                                           `matched TOPIC`, listens until standard input ends, and then
                                           compares what came, field by field, with the recording

For every message of a recording: its schema is parsed, its type hash computed from that, its bytes decoded,
and encoded again to the very same bytes. The answer is one line of JSON: per topic its type, how often it
was read, listened to and found equal, and the first and last message's fields.
"""

import dataclasses
import json
import os
import sys
import threading
import time

import numpy as np
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.base import Nodetype


def plain(value):
    """Numbers, texts, lists and dictionaries of a message, from either library."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if dataclasses.is_dataclass(value):
        # Constants of a message are class variables, and no fields.
        fields = (field.name for field in dataclasses.fields(value) if not field.name.startswith("__"))
        return {name: plain(getattr(value, name)) for name in fields if not name.isupper()}
    return value


def same(a, b):
    """Equal, with a NaN equal to itself."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and (a == b or all(same(x, y) for x, y in zip(a, b)))
    return a == b or (a != a and b != b)


class Recording:
    def __init__(self, path):
        self.store = get_typestore(Stores.EMPTY)
        self.types, self.messages, self.qos = {}, {}, {}
        with Reader(path) as reader:
            for connection in reader.connections:
                # The recording's own definitions and nothing else.
                definition = connection.msgdef.data
                self.store.register(
                    {
                        name: fields
                        for name, fields in get_types_from_msg(definition, connection.msgtype).items()
                        if name not in self.store.fielddefs
                    }
                )
                self.types[connection.topic] = connection.msgtype
                self.qos[connection.topic] = [str(q.reliability.name) for q in connection.ext.offered_qos_profiles]
                self.messages[connection.topic] = []
                computed, stated = self.store.hash_rihs01(connection.msgtype), connection.digest
                known = get_typestore(Stores.ROS2_JAZZY)
                if connection.msgtype in known.fielddefs:
                    assert computed == known.hash_rihs01(connection.msgtype), connection.msgtype
                assert stated in (None, "", computed), (connection.msgtype, stated, computed)
            for connection, stamp, raw in reader.messages():
                message = self.store.deserialize_cdr(raw, connection.msgtype)
                again = bytes(self.store.serialize_cdr(message, connection.msgtype))
                assert again == bytes(raw), (connection.topic, len(again), len(raw))
                self.messages[connection.topic].append((stamp, plain(message)))


PRIMITIVES = {
    "bool": bool, "string": str,
    **{name: name for name in "int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 float64".split()},
    "byte": "uint8", "octet": "uint8", "char": "uint8",
}


def idl(store, name, made):
    """The message as a type of cyclonedds."""
    import cyclonedds.idl.types as types
    from cyclonedds.idl import make_idl_struct

    if name in made:
        return made[name]

    def element(kind, detail):
        if kind == Nodetype.NAME:
            return idl(store, detail, made)
        base = PRIMITIVES[detail[0] if isinstance(detail, tuple) else detail]
        return getattr(types, base) if isinstance(base, str) else base

    fields = {}
    for field, (kind, detail) in store.fielddefs[name][1]:
        if kind == Nodetype.ARRAY:
            (inner, what), length = detail
            fields[field] = types.array[element(inner, what), length]
        elif kind == Nodetype.SEQUENCE:
            (inner, what), _ = detail
            fields[field] = types.sequence[element(inner, what)]
        else:
            fields[field] = element(kind, detail)
    package, _, short = name.split("/")
    made[name] = make_idl_struct(short, f"{package}::msg::dds_::{short}_", fields)
    return made[name]


# This machine only, with receive buffers as large as the system allows.
LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<Peers><Peer address='localhost'/></Peers></Discovery><Internal>"
    "<SocketReceiveBufferSize min='default' max='4MB'/></Internal></Domain></CycloneDDS>"
)


def listen(domain, topics, store):
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    keep = [Domain(domain, LOOPBACK)]
    participant = DomainParticipant(domain)
    made, readers = {}, {}
    for topic, (kind, latched) in topics.items():
        durability = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
        qos = Qos(
            Policy.Reliability.Reliable(duration(seconds=1)), durability, Policy.History.KeepAll,
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        readers[topic] = DataReader(participant, Topic(participant, "rt" + topic, idl(store, kind, made)), qos=qos)
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    print("ready", flush=True)
    came, matched, last = {topic: [] for topic in topics}, set(), time.monotonic()
    while not over.is_set() or time.monotonic() - last < 1.0:
        idle = True
        for topic, reader in readers.items():
            if topic not in matched and reader.get_subscription_matched_status().current_count > 0:
                matched.add(topic)
                print("matched", topic, flush=True)
            for sample in reader.take(100):
                if getattr(sample, "sample_info", None) is None or sample.sample_info.valid_data:
                    came[topic].append(plain(sample))
                    idle = False
                    last = time.monotonic()
        if idle:
            time.sleep(0.002)
    return came


def main():
    mode, arguments = sys.argv[1], sys.argv[2:]
    came = None
    if mode == "listen":
        domain, bag = int(arguments[0]), arguments[1]
        parts = [text.split("=") for text in arguments[2:]]
        topics = {part[0]: (part[1], len(part) > 2) for part in parts}
        # Definitions as ROS has them, and ours from the package that users build.
        store = get_typestore(Stores.ROS2_JAZZY)
        root = os.environ["ESAAC_ROS_SOURCES"]
        for folder, package in [("esaac_msgs", "esaac_msgs"), ("definitions/event_camera_msgs", "event_camera_msgs")]:
            folder = os.path.join(root, folder, "msg")
            for file in sorted(os.listdir(folder)):
                text = open(os.path.join(folder, file)).read()
                store.register(get_types_from_msg(text, f"{package}/msg/{file[:-4]}"))
        came = listen(domain, topics, store)
    else:
        bag = arguments[0]
    recording = Recording(bag)
    answer = {}
    for topic, kind in recording.types.items():
        messages = recording.messages[topic]
        line = {"type": kind, "recorded": len(messages), "qos": recording.qos[topic]}
        if messages:
            line["first"], line["last"] = messages[0][1], messages[-1][1]
        if came is not None and topic in came:
            line["listened"] = len(came[topic])
            line["equal"] = sum(same(a, b) for a, (_, b) in zip(came[topic], messages))
            if line["equal"] < line["listened"]:
                pairs = ((a, b) for a, (_, b) in zip(came[topic], messages) if not same(a, b))
                print("differs", topic, *(str(part)[:600] for part in next(pairs, ())), sep="\n", file=sys.stderr)
        answer[topic] = line
    print(json.dumps(answer, allow_nan=True), flush=True)


if __name__ == "__main__":
    main()
