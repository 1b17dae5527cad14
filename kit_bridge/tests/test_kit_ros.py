"""What the Kit extension publishes, read by a subscriber that shares no code with it."""

import sys

import numpy as np
import pytest
from kit_stage import bridge, camera, fresh_stage, move
from listening import assert_packets, domain, listening
from pxr import Sdf

import esaac
from esaac_sim.imu import Imu


@pytest.fixture
def stage():
    with fresh_stage() as stage:
        yield stage


def publishes(stage, path, **attributes):
    prim = stage.GetPrimAtPath(path)
    prim.CreateAttribute("esaac:publish", Sdf.ValueTypeNames.Bool).Set(True)
    for name, value in attributes.items():
        kind = Sdf.ValueTypeNames.TokenArray if isinstance(value, list) else Sdf.ValueTypeNames.String
        prim.CreateAttribute(f"esaac:{name}", kind).Set(value)


@pytest.mark.parametrize("older", [False, True])
def test_the_imu_of_isaac_sim_6_and_of_those_before_it(older, monkeypatch):
    if older:
        monkeypatch.setitem(sys.modules, "isaacsim.sensors.experimental.physics", None)
    imu = Imu("/robot/imu")
    (sample,) = imu.samples()
    assert sample.angular_rate_rad_s == (0.0, 0.0, 0.25) and not imu.samples()
    assert sample.specific_force_m_s2 == pytest.approx((0.0, 0.0, 9.81))
    monkeypatch.setitem(sys.modules, "isaacsim.sensors.experimental.physics", None)
    monkeypatch.setitem(sys.modules, "isaacsim.sensors.physics", None)
    with pytest.raises(esaac.RosError, match="esaac:imu names /robot/imu, and neither"):
        Imu("/robot/imu")


@pytest.fixture
def network(monkeypatch):
    """Loopback, on a domain of this test's own."""
    number = domain(5)
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    return number


def test_what_cameras_publish_is_read_bit_for_bit_by_an_independent_subscriber(stage, network):
    camera(stage, "/plain", sensor="dvs128", overrides="width = 32\nheight = 24")
    publishes(stage, "/plain")
    publishes(
        stage,
        "/camera",
        topic="/robot/davis/events",
        frameId="sim_camera",
        imu="/robot/imu",
        outputs=["events", "aps", "rgb", "depth"],
    )
    running = bridge()
    assert running.attach(stage) == 2 and not running.problems, running.problems
    first, second = running.feeds
    packets, images = {"/robot/davis": [], "/plain": []}, []

    def keep(feed, packet):
        # What the first frame gives is the beginning and is not told.
        if feed.frames > 1:
            packets[feed.spec.topic].append(packet)
        if feed is first:
            images.append((feed.frame.rgb.numpy().copy(), feed.frame.depth.numpy().copy(), feed.camera.aps))

    first.sinks.append(keep), second.sinks.append(keep)
    topics = running.publisher.topics
    with listening(network, topics) as (wait, came):
        wait()
        move(stage, 12)
        assert first.frames == 10 and first.message == "running" and second.faults == 0, first.message
        running.detach()
    assert sum(map(len, packets["/robot/davis"])) > 100
    for topic, feed in (("/robot/davis", first), ("/plain", second)):
        assert_packets(came[f"{topic}/events"], packets[topic], feed.spec.sensor)
    rgb, depth, aps = (came[f"/robot/davis/{name}image_raw"] for name in ("", "depth/", "aps/"))
    assert len(rgb) == len(depth) == 10 and rgb[0]["header"]["frame_id"] == "sim_camera"
    for (colours, metres, _), image, far in zip(images, rgb, depth):
        np.testing.assert_array_equal(image["data"], colours[..., :3].ravel())
        expected = np.where(np.isfinite(metres), metres, np.nan).astype(np.float32)
        np.testing.assert_array_equal(np.frombuffer(bytes(far["data"]), np.float32), expected.ravel())
    frames = [frame.pixels.astype("u1").tobytes() for _, _, frame in images if frame]
    assert [bytes(message["data"]) for message in aps] == frames and len(frames) == 9
    assert came["/robot/davis/camera_info"][0]["k"][0] == pytest.approx(24.0 / 20.955 * 64)
    imu = came["/robot/davis/imu"]
    assert len(imu) == 10 and imu[0]["linear_acceleration"]["z"] == pytest.approx(9.81)
    clock = [m["clock"]["sec"] * 10**9 + m["clock"]["nanosec"] for m in came["/clock"]]
    assert clock == [round(index / 60 * 1e9) for index in range(2, 12)]


def test_topics_and_networks_that_cannot_be_are_problems_and_cameras_run(stage, network, monkeypatch):
    camera(stage, "/wrong", sensor="dvs128", overrides="width = 32\nheight = 24")
    publishes(stage, "/wrong", topic="robot/my camera")
    publishes(stage, "/camera")
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    running = bridge()
    assert running.attach(stage) == 1
    (topic, transport) = running.problems
    assert "/wrong" in topic and "does not start with a slash" in topic
    assert "/camera" in transport and "ROS_DOMAIN_ID is `many`" in transport
    move(stage, 6)
    assert running.feeds[0].frames == 4 and running.publisher is None
    running.detach()
