"""What events show, over ROS 2: ids beside each message of events, and the table of instances."""

import numpy as np
import pytest
from conftest import FRAME_NS
from listening import assert_ids, assert_packets, domain, listening, recorded
from rigid_scene import BODIES, CAMERA, FRAMES, IMAGES, LENS, SENSOR, TIMES_NS, camera
from test_event_ids import step

import esaac
from esaac import ros


def sent(path, **options):
    """Publishes and records a run. Returns the ids of its events."""
    cam, ids = camera(), []
    told = ros.Camera("eye", cam.sensor, event_ids=True)
    with ros.Publisher([told], network=False, record=path, **options) as publisher:
        for index in range(FRAMES):
            packet = step(cam, index)
            ids.append(cam.event_ids())
            publisher.publish(FRAME_NS * index, {"eye": ros.Frame(packet, ids=ids[-1])})
        assert publisher.notices() == []
        assert sum(topic["failed"] + topic["dropped"] for topic in publisher.summary()["topics"]) == 0
    together = np.concatenate(ids)
    assert len(together) > 500 and {0, 1} == set(together)
    return together


@pytest.fixture
def network(monkeypatch):
    """Loopback, on a domain of this test's own."""
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    return domain(6)


def test_ids_and_instances_are_read_bit_for_bit(network):
    cam, packets, ids = camera(), [], []
    told = ros.Camera("eye", cam.sensor, event_ids=True)
    with ros.Publisher([told], domain=network, policy="lossless") as publisher:
        names = {name: kind for name, kind in publisher.topics.items() if name.startswith("/esaac/eye/")}
        assert names["/esaac/eye/event_ids"] == "esaac_msgs/msg/EventIds"
        assert names["/esaac/eye/instances"] == "esaac_msgs/msg/Instances"
        with listening(network, names) as (wait, came):
            wait()
            box = ros.Instance("/World/box", {"class": ["box", "toy"], "room": ["store"]})
            for index in range(FRAMES):
                packets.append(step(cam, index))
                ids.append(cam.event_ids())
                # The same table twice is sent once.
                publisher.set_instances("eye", {1: box, 0: "/World"} if index < 2 else {1: "/World/box"})
                publisher.publish(FRAME_NS * index, {"eye": ros.Frame(packets[-1], ids=ids[-1])})
            publisher.close()
    assert_packets(came["/esaac/eye/events"], packets, cam.sensor)
    assert_ids(came["/esaac/eye/event_ids"], ids, came["/esaac/eye/events"])
    first, second = (message["instances"] for message in came["/esaac/eye/instances"])
    assert first == [
        {"id": 0, "name": "/World", "kinds": [], "labels": []},
        {
            "id": 1,
            "name": "/World/box",
            "kinds": ["class", "class", "room"],
            "labels": ["box", "toy", "store"],
        },
    ]
    assert second == [{"id": 1, "name": "/World/box", "kinds": [], "labels": []}]


EVENTS_OF = {
    "packed": lambda message: len(message["x"]),
    "plain": lambda message: len(message["events"]),
    "mono": lambda message: len(message["events"]) // 8,
    # Words of 16 bits; the upper 4 bits of an event's are 2.
    "evt3": lambda message: sum(byte >> 4 == 2 for byte in message["events"][1::2]),
}


@pytest.mark.parametrize("events", EVENTS_OF)
def test_ids_are_divided_as_events_are(events, tmp_path):
    path = tmp_path / "run.mcap"
    ids = sent(path, events=events, slice_ns=FRAME_NS // 4, max_bytes=400)
    topics = recorded(path)
    messages, labels = topics["/esaac/eye/events"], topics["/esaac/eye/event_ids"]
    assert len(messages) == len(labels) > 4 * FRAMES
    for message, label in zip(messages, labels):
        assert message["header"] == label["header"]
        assert message["seq" if "seq" in message else "sequence"] == label["sequence"]
        assert len(label["ids"]) == EVENTS_OF[events](message)
    together = np.concatenate([np.array(label["ids"], np.int64) for label in labels])
    np.testing.assert_array_equal(together, ids)


def test_environments_have_those_of_their_events(tmp_path):
    sensor = esaac.SensorModel("dvs128", synthesis="rigid", **SENSOR)
    path, expected = tmp_path / "run.mcap", {"env_0": [], "env_1": []}
    poses = esaac.Poses(TIMES_NS, np.stack([CAMERA] * 2, axis=1), BODIES)
    cameras = [ros.Camera(name, sensor, event_ids=True) for name in expected]
    with esaac.TiledEventCamera(sensor, 2, intrinsics=LENS) as envs:
        with ros.Publisher(cameras, network=False, record=path) as publisher:
            for index in range(FRAMES):
                hdr, depth, ids = (np.stack([image] * 2) for image in IMAGES[index])
                # The other environment's box is what does not move.
                ids[1] = 0
                packet = envs.step(hdr, t_ns=FRAME_NS * index, depth=depth, ids=ids, poses=poses)
                labels, frames = envs.event_ids(), {}
                for env, name in enumerate(expected):
                    own = labels[packet.offsets[env] : packet.offsets[env + 1]]
                    frames[name] = ros.Frame(packet[env], ids=own)
                    expected[name].append(np.array(own))
                publisher.publish(FRAME_NS * index, frames)
    topics = recorded(path)
    for name, ids in expected.items():
        assert_ids(topics[f"/esaac/{name}/event_ids"], ids, topics[f"/esaac/{name}/events"])
    assert 1 in np.concatenate(expected["env_0"]) and 1 not in np.concatenate(expected["env_1"])


def test_ids_that_do_not_fit_are_refused(tmp_path):
    cam = camera()
    step(cam, 0)
    packet = step(cam, 1)
    ids, count = cam.event_ids(), len(packet)
    cameras = [ros.Camera("a", cam.sensor, event_ids=True), ros.Camera("plain", cam.sensor)]
    with ros.Publisher(cameras, network=False, record=tmp_path / "run.mcap") as publisher:
        assert "/esaac/plain/event_ids" not in publisher.topics
        for frame, message in (
            (
                ros.Frame(packet, ids=ids[1:]),
                rf"ids of `a` are int64 \({count - 1},\), expected {count} integers",
            ),
            (ros.Frame(packet, ids=ids * 1.0), "ids of `a` are float64 .*, expected .* one for each event"),
            (ros.Frame(packet, ids=5), rf"ids of `a` are int64 \(\), expected {count} integers"),
            (
                ros.Frame(ids=ids),
                "ids of `a` are given without a packet, expected the packet of their events",
            ),
            (
                ros.Frame(packet, ids=np.full(count, 1 << 63, np.uint64)),
                "ids of `a` have 9223372036854775808, expected at most 9223372036854775807",
            ),
        ):
            with pytest.raises(esaac.ArgumentError, match=message):
                publisher.publish(FRAME_NS, {"a": frame})
        with pytest.raises(esaac.ArgumentError, match="`plain` was announced without event_ids"):
            publisher.publish(FRAME_NS, {"plain": ros.Frame(packet, ids=ids)})
        with pytest.raises(esaac.ArgumentError, match="`plain` has ids or instances, expected none"):
            publisher.set_instances("plain", {1: "/box"})
        with pytest.raises(
            esaac.ArgumentError, match="instance 1 of `a` is a dict, expected a ros.Instance or"
        ):
            publisher.set_instances("a", {1: {"prim": "/box"}})
        with pytest.raises(
            esaac.ArgumentError, match="labels `class` of instance 1 is the text 'box', expected"
        ):
            publisher.set_instances("a", {1: ros.Instance("/box", {"class": "box"})})
        # Any integers are ids, of any library, and a frame without a packet has none.
        publisher.publish(FRAME_NS, {"a": ros.Frame(packet, ids=ids.astype(np.int16).tolist())})
        publisher.publish(FRAME_NS, {"a": ros.Frame()})
        assert publisher.notices() == []


def test_a_packet_without_ids_is_sent_and_told_once(tmp_path):
    cam, path = camera(), tmp_path / "run.mcap"
    with ros.Publisher(
        [ros.Camera("a", cam.sensor, event_ids=True)], network=False, record=path
    ) as publisher:
        for index in range(3):
            packet = step(cam, index)
            ids = cam.event_ids() if index == 2 else None
            publisher.publish(FRAME_NS * index, {"a": ros.Frame(packet, ids=ids)})
        (notice,) = publisher.notices()
        assert "packet of camera `a` came without ids" in notice and "events are sent without ids" in notice
    topics = recorded(path)
    assert [message["sequence"] for message in topics["/esaac/a/events"]] == [0, 1, 2]
    (message,) = topics["/esaac/a/event_ids"]
    assert message["sequence"] == 2 and message["ids"] == ids.tolist()
