"""Writes messages.txt: messages as PyPI's rosbags encodes them, which shares no code with this crate.

generate.py            prints the file
generate.py --check    fails if messages.txt differs

A line holds a message's name and its CDR bytes in hexadecimal. main.rs makes the same messages with this crate.
Event words of `mono` and `evt3` are built here from their specifications: event_camera_msgs' README and
Prophesee's EVT 3.0 format.
"""

import pathlib
import struct
import sys

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

HERE = pathlib.Path(__file__).resolve().parent
ROS = HERE.parent.parent

store = get_typestore(Stores.ROS2_JAZZY)
for folder, package in [("esaac_msgs", "esaac_msgs"), ("definitions/event_camera_msgs", "event_camera_msgs")]:
    for file in sorted((ROS / folder / "msg").glob("*.msg")):
        store.register(get_types_from_msg(file.read_text(), f"{package}/msg/{file.stem}"))


def make(message, /, **fields):
    package, short = message.split("/")
    return store.types[f"{package}/msg/{short}"](**fields)


def time(sec, nanosec):
    return make("builtin_interfaces/Time", sec=sec, nanosec=nanosec)


def header(frame_id, sec=12, nanosec=345_678_901):
    return make("std_msgs/Header", stamp=time(sec, nanosec), frame_id=frame_id)


def image(frame_id, encoding, width, height, pixel_bytes):
    count = width * height * pixel_bytes
    return make(
        "sensor_msgs/Image", header=header(frame_id), height=height, width=width, encoding=encoding,
        is_bigendian=0, step=width * pixel_bytes, data=np.arange(1, count + 1, dtype=np.uint8),
    )


def camera_info(k, p):
    region = make("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    identity = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    numbers = [np.array(values, dtype=np.float64) for values in ([0] * 5, k, identity, p)]
    return make(
        "sensor_msgs/CameraInfo", header=header("abc"), height=24, width=32, distortion_model="plumb_bob",
        d=numbers[0], k=numbers[1], r=numbers[2], p=numbers[3], binning_x=0, binning_y=0, roi=region,
    )


def imu():
    vector = lambda x, y, z: make("geometry_msgs/Vector3", x=x, y=y, z=z)
    zero, absent = np.zeros(9), np.zeros(9)
    absent[0] = -1
    return make(
        "sensor_msgs/Imu", header=header("body", -1, 999_999_999),
        orientation=make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0), orientation_covariance=absent,
        angular_velocity=vector(0.1, -0.2, 0.3), angular_velocity_covariance=zero,
        linear_acceleration=vector(1.5, -2.5, 9.81), linear_acceleration_covariance=zero,
    )


def transforms(pairs):
    turn = make("geometry_msgs/Quaternion", x=-0.5, y=0.5, z=-0.5, w=0.5)
    origin = make("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
    transform = make("geometry_msgs/Transform", translation=origin, rotation=turn)
    stamped = [
        make("geometry_msgs/TransformStamped", header=header(body), child_frame_id=optical, transform=transform)
        for body, optical in pairs
    ]
    return make("tf2_msgs/TFMessage", transforms=stamped)


def diagnostics():
    pair = lambda key, value: make("diagnostic_msgs/KeyValue", key=key, value=value)
    statuses = [
        make("diagnostic_msgs/DiagnosticStatus", level=1, name="node: a", message="2 lost", hardware_id="esaac",
             values=[pair("sent", "7"), pair("dropped", "22")]),
        make("diagnostic_msgs/DiagnosticStatus", level=0, name="", message="good", hardware_id="esaac", values=[]),
    ]
    return make("diagnostic_msgs/DiagnosticArray", header=header(""), status=statuses)


# Values that are texts; every number follows from its field's place.
TEXTS = {
    "name": "golden", "pixel": "physical", "intensity": "bayer_rggb", "synthesis": "linear", "taps": "bilinear",
    "substep_policy": "fixed", "timestamps": "at_sample", "readout": "rows",
}


def sensor_model():
    cls = store.types["esaac_msgs/msg/SensorModel"]
    fields = {"header": header("optical")}
    for place, (name, kind) in enumerate(store.fielddefs["esaac_msgs/msg/SensorModel"][1][1:], 1):
        kind = kind[1] if isinstance(kind[1], str) else kind[1][0]
        numbers = {"float64": place + 0.5, "uint32": 1000 + place, "uint64": (1 << 40) + place}
        fields[name] = TEXTS[name] if kind == "string" else numbers[kind]
    return cls(**fields)


# Column, row, nanoseconds since the base, polarity. The last two differ in the upper half of evt3's time alone.
EVENTS = [
    (3, 2, 1_000, 1), (31, 2, 1_999, 0), (0, 2, 2_000, 1), (1500, 1998, 2_000, 0), (2047, 1998, 4_098_000, 1),
]
BASE_NS, WATERMARK_NS = 8_192_000, 41_525_333


def event_head(frame_id):
    return {"header": header(frame_id), "height": 1999, "width": 2048}


def packed(count):
    events = EVENTS[:count]
    column = lambda place, kind: np.array([event[place] for event in events], dtype=kind)
    return make(
        "esaac_msgs/PackedEventPacket", **event_head("abc"), sequence=(1 << 33) + 5, base_ns=BASE_NS,
        watermark_ns=WATERMARK_NS, sensor_name="davis", dropped=77, x=column(0, np.uint16),
        y=column(1, np.uint16), t_offset_ns=column(2, np.uint32), polarity=column(3, np.uint8),
    )


def plain(count):
    events = [
        make("esaac_msgs/Event", t_ns=BASE_NS + t, x=x, y=y, polarity=p) for x, y, t, p in EVENTS[:count]
    ]
    return make(
        "esaac_msgs/EventPacket", **event_head("abcdef"), sequence=(1 << 33) + 5, base_ns=BASE_NS,
        watermark_ns=WATERMARK_NS, sensor_name="davis", dropped=77, events=events,
    )


def camera_packet(frame_id, encoding, time_base, data):
    return make(
        "event_camera_msgs/EventPacket", **event_head(frame_id), seq=(1 << 33) + 5, time_base=time_base,
        encoding=encoding, is_bigendian=False, events=np.frombuffer(data, dtype=np.uint8),
    )


def mono(count):
    # 32 bits of nanoseconds since the base, 16 of the column, 15 of the row, 1 of the polarity.
    words = [struct.pack("<IHH", t, x, p << 15 | y) for x, y, t, p in EVENTS[:count]]
    return camera_packet("abcdef", "mono", BASE_NS, b"".join(words))


def evt3(count):
    # 4 bits of kind, 12 of value: 8 time's upper half, 6 its lower half, 0 row, 2 polarity and column.
    words, now, row = [], None, None
    events = EVENTS[:count]
    for x, y, t_us, p in [(x, y, (BASE_NS + t) // 1000, p) for x, y, t, p in events]:
        high, low = t_us >> 12 & 0xFFF, t_us & 0xFFF
        if now is None or now[0] != high:
            words += [0x8000 | high, 0x6000 | low]
        elif now[1] != low:
            words.append(0x6000 | low)
        now = (high, low)
        if row != y:
            words.append(y)
        row = y
        words.append(0x2000 | p << 11 | x)
    if not events:
        t_us = WATERMARK_NS // 1000
        words = [0x8000 | t_us >> 12 & 0xFFF, 0x6000 | t_us & 0xFFF]
    return camera_packet("abc", "evt3", 0, struct.pack(f"<{len(words)}H", *words))


def event_ids(frame_id, ids):
    return make(
        "esaac_msgs/EventIds", header=header(frame_id), sequence=(1 << 33) + 5, ids=np.array(ids, dtype=np.int64)
    )


def instances(named):
    several = [
        make("esaac_msgs/Instance", id=number, name=name, kinds=[kind for kind, _ in labels],
             labels=[label for _, label in labels])
        for number, name, labels in named
    ]
    return make("esaac_msgs/Instances", header=header("abc"), instances=several)


MESSAGES = {
    "clock": make("rosgraph_msgs/Clock", clock=time(1, 2)),
    "image rgb8": image("abc", "rgb8", 3, 2, 3),
    "image 32FC1": image("ab", "32FC1", 2, 1, 4),
    "camera_info": camera_info([300, 0, 15.5, 0, 301, 11.5, 0, 0, 1], [300, 0, 15.5, 0, 0, 301, 11.5, 0, 0, 0, 1, 0]),
    "camera_info uncalibrated": camera_info([0] * 9, [0] * 12),
    "imu": imu(),
    "transforms 0": transforms([]),
    "transforms 2": transforms([("left_link", "left_optical_frame"), ("b", "a")]),
    "diagnostics": diagnostics(),
    "sensor_model": sensor_model(),
    "event_ids 0": event_ids("abc", []),
    "event_ids 3": event_ids("abcdef", [-1, 0, 4_000_000_000]),
    "instances 0": instances([]),
    "instances 3": instances([(-5, "", []), (7, "/World/box", [("class", "box"), ("class", "toy"), ("room", "")]),
                              (1 << 40, "ab", [("k", "v")])]),
    **{f"{name} {count}": of(count) for name, of in [("packed", packed), ("plain", plain), ("mono", mono), ("evt3", evt3)]
       for count in (0, 1, 2, 5)},
}


def main():
    lines = [f"{name}: {bytes(store.serialize_cdr(message, message.__msgtype__)).hex()}" for name, message in MESSAGES.items()]
    text = "\n".join(lines) + "\n"
    if "--check" in sys.argv[1:]:
        assert (HERE / "messages.txt").read_text() == text, "messages.txt is not what rosbags writes"
    else:
        sys.stdout.write(text)


main()
