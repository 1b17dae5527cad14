"""Runs `ros_listener.py` beside a test and reads recordings, in the environment that has cyclonedds and rosbags."""

import contextlib
import json
import os
import pathlib
import subprocess
import time

import numpy as np

HERE = pathlib.Path(__file__).parent
LATCHED = ("/tf_static", "/sensor", "/instances")


def python():
    fallback = HERE.parents[1] / "target/ros-python/bin/python"
    found = pathlib.Path(os.environ.get("ESAAC_ROS_PYTHON", fallback))
    assert found.exists(), f"{found} is not there; tools/test.sh makes it"
    return found


def domain(number):
    """A domain that no other test has, and with some luck no other program."""
    return 101 + os.getpid() % 12 * 10 + number


@contextlib.contextmanager
def listening(domain, topics):
    """Listens to topics (types by name) once the block's publisher is there: call the given function when it is.
    What came is in the list given, by topic, after the block."""
    came = {}
    names = [
        f"{name}={kind}" + ("=transient_local" if name.endswith(LATCHED) else "")
        for name, kind in topics.items()
    ]
    environment = {key: value for key, value in os.environ.items() if key != "CYCLONEDDS_URI"}
    child = subprocess.Popen(
        [python(), HERE / "ros_listener.py", str(domain), *names],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    try:
        assert child.stdout.readline() == "ready\n"

        def wait():
            matched, started = set(), time.monotonic()
            while len(matched) < len(topics):
                assert time.monotonic() - started < 30, f"only {sorted(matched)}"
                word, _, topic = child.stdout.readline().strip().partition(" ")
                assert word == "matched", word
                matched.add(topic)

        yield wait, came
        child.stdin.close()
        said = child.stdout.read().splitlines()
        assert child.wait(timeout=30) == 0, said
        came.update(json.loads(said[-1]))
    finally:
        child.kill()
        child.wait()


def recorded(path):
    """Messages of an MCAP file, by topic."""
    command = [python(), HERE / "ros_recording.py", path]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout)


def stamp_ns(message):
    return message["header"]["stamp"]["sec"] * 10**9 + message["header"]["stamp"]["nanosec"]


def assert_ids(messages, ids, packets):
    """For each message of packets there is one of its events' ids."""
    assert len(messages) == len(packets) == len(ids)
    for message, expected, packet in zip(messages, ids, packets):
        np.testing.assert_array_equal(np.array(message["ids"], np.int64), expected)
        assert (message["header"], message["sequence"]) == (packet["header"], packet["sequence"])


def assert_packets(messages, packets, sensor):
    """Every message is a packet's, bit for bit."""
    assert len(messages) == len(packets)
    for number, (message, packet) in enumerate(zip(messages, packets)):
        t_ns = message["base_ns"] + np.array(message["t_offset_ns"], np.int64)
        for column, expected in (("x", packet.x), ("y", packet.y), ("polarity", packet.p)):
            np.testing.assert_array_equal(message[column], expected)
        np.testing.assert_array_equal(t_ns, packet.t_ns)
        assert (message["width"], message["height"]) == (sensor.width, sensor.height)
        assert (message["sequence"], message["watermark_ns"]) == (number, packet.watermark_ns)
        assert stamp_ns(message) == packet.watermark_ns
