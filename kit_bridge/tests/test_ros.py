"""Topics of ROS 2 from Python, read by a subscriber that shares no code with the publisher."""

import os
import threading
import types

import numpy as np
import pytest
from conftest import FRAME_NS, bars
from listening import assert_packets, domain, listening

import esaac
from esaac import ros

SENSOR = {"width": 40, "height": 24, "contrast_on": 0.15, "contrast_off": 0.15}


@pytest.fixture(autouse=True)
def loopback(monkeypatch):
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)


def test_all_that_a_camera_has_is_read_bit_for_bit(tmp_path):
    camera = esaac.EventCamera("dvs128", **SENSOR, aps_exposure_ns=8_000_000, aps_bits=10)
    told = ros.Camera(
        "eye", camera.sensor, focal_px=50, rgb=True, depth=True, imu=True, frame_id="sim_camera"
    )
    packets, images, depths, aps = [], [], [], []
    bag = tmp_path / "run.mcap"
    with ros.Publisher([told], domain=domain(0), record=bag) as publisher:
        topics = publisher.topics
        assert topics["/esaac/eye/events"] == "esaac_msgs/msg/PackedEventPacket"
        with listening(domain(0), topics) as (wait, came):
            wait()
            for index in range(6):
                t_ns = FRAME_NS * index
                packet = camera.step(*bars(40, 24, index), t_ns=t_ns)
                packets.append(packet)
                aps.append(camera.aps)
                images.append(np.random.default_rng(index).integers(0, 256, (24, 40, 4), np.uint8))
                depths.append(np.linspace(1, 5 + index, 24 * 40, dtype=np.float32).reshape(24, 40))
                imu = [ros.Imu(t_ns + k, (0.0, 0.1, float(index)), (0.0, 0.0, 9.81)) for k in (-1, 0)]
                frame = ros.Frame(packet, camera.aps, images[-1], depths[-1], imu)
                publisher.publish(t_ns, {"eye": frame})
            publisher.set_status("eye", camera.statistics, ["too dark"])
            summary = publisher.close()
    assert summary["dropped_ticks"] == 0 and bag.stat().st_size > 1000
    assert sum(map(len, packets)) > 500
    assert_packets(came["/esaac/eye/events"], packets, camera.sensor)
    for index, message in enumerate(came["/esaac/eye/image_raw"]):
        assert message["encoding"] == "rgb8" and message["header"]["frame_id"] == "sim_camera"
        np.testing.assert_array_equal(message["data"], images[index][..., :3].ravel())
    for index, message in enumerate(came["/esaac/eye/depth/image_raw"]):
        assert bytes(message["data"]) == depths[index].tobytes()
    expected = [frame.pixels.astype("<u2").tobytes() for frame in aps if frame]
    assert [bytes(m["data"]) for m in came["/esaac/eye/aps/image_raw"]] == expected and len(expected) >= 5
    assert len(came["/esaac/eye/image_raw"]) == len(came["/esaac/eye/depth/image_raw"]) == 6
    info = came["/esaac/eye/camera_info"][0]
    assert info["k"] == [50, 0, 19.5, 0, 50, 11.5, 0, 0, 1]
    assert [m["angular_velocity"]["z"] for m in came["/esaac/eye/imu"]] == [
        i for i in range(6) for _ in (0, 1)
    ]
    assert came["/esaac/eye/imu"][0]["header"]["frame_id"] == "sim_camera_link"
    clock = [m["clock"]["sec"] * 10**9 + m["clock"]["nanosec"] for m in came["/clock"]]
    assert clock == [FRAME_NS * index for index in range(6)]
    assert came["/esaac/eye/sensor"][0]["contrast_on"] == 0.15
    status = came["/diagnostics"][-1]["status"][-1]
    assert status["name"] == "esaac: camera eye" and status["message"] == "too dark"
    values = {value["key"]: value["value"] for value in status["values"]}
    assert values["substeps"] == str(camera.statistics["substeps"])


def test_environments_are_cameras_of_one_publisher():
    sensor = esaac.SensorModel("dvs128", **SENSOR)
    camera = esaac.TiledEventCamera(sensor, 2)
    packets = {"env_0": [], "env_1": []}
    cameras = [ros.Camera(name, sensor) for name in packets]
    with ros.Publisher(cameras, namespace="/lab", domain=domain(1), policy="lossless") as publisher:
        names = [f"/lab/{name}/events" for name in packets]
        with listening(domain(1), {name: publisher.topics[name] for name in names}) as (wait, came):
            wait()
            for index in range(4):
                pairs = [bars(40, 24, index + 0.3 * env) for env in range(2)]
                hdr, motion = (np.stack(images) for images in zip(*pairs))
                packet = camera.step(hdr, motion, t_ns=FRAME_NS * index)
                for env, name in enumerate(packets):
                    packets[name].append(packet[env])
                with pytest.raises(esaac.ArgumentError, match=r"publish packet\[i\]"):
                    publisher.publish(FRAME_NS * index, {"env_0": ros.Frame(packet)})
                frames = {name: ros.Frame(packet[env]) for env, name in enumerate(packets)}
                publisher.publish(FRAME_NS * index, frames)
            publisher.close()
    for name, expected in packets.items():
        assert sum(map(len, expected)) > 500
        assert_packets(came[f"/lab/{name}/events"], expected, sensor)


@pytest.mark.parametrize(
    ("cameras", "options", "error", "message"),
    [
        (["a-b"], {}, esaac.ArgumentError, "a-b"),
        (["a", "a"], {}, esaac.ArgumentError, "two cameras are named `a`"),
        (["a"], {"namespace": "esaac"}, esaac.ArgumentError, "does not start with a slash"),
        (["a"], {"events": "csv"}, esaac.ArgumentError, "`csv`, expected one of packed, plain, evt3, mono"),
        (["a"], {"policy": "drop"}, esaac.ArgumentError, "`drop`, expected latest or lossless"),
        (["a"], {"time": "utc"}, esaac.ArgumentError, "`utc`, expected sim or wall"),
        (
            ["a"],
            {"qos": {"event": "reliable"}},
            esaac.ArgumentError,
            "quality of service for `event`, expected one of the topics: all, clock",
        ),
        (["a"], {"qos": {"events": "quick"}}, esaac.ArgumentError, "`quick` is not one of"),
        (
            ["a"],
            {"slice_ns": 1},
            esaac.ArgumentError,
            "slices of 1 ns for camera `a`, expected 0, or 1000 to",
        ),
        (["a"], {"domain": 999}, esaac.RosError, "999"),
        (["a"], {"interface": "nonesuch0"}, esaac.RosError, "nonesuch0"),
        (["a"], {"network": False, "record": "/nonexistent/run.mcap"}, esaac.RosError, "/nonexistent"),
    ],
)
def test_what_cannot_be_is_said_at_once(cameras, options, error, message):
    options = {"domain": domain(2), **options}
    with pytest.raises(error, match=message):
        ros.Publisher([ros.Camera(name, "dvs128") for name in cameras], **options)


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        ({"focal_px": float("nan")}, r"focal_px of `a` is \[NaN, NaN\], expected finite numbers above 0"),
        ({"focal_px": 0.0}, r"focal_px of `a` is \[0.0, 0.0\], expected finite numbers above 0"),
        ({"focal_px": (50.0, -50.0)}, r"focal_px of `a` is \[50.0, -50.0\], expected"),
        ({"focal_px": float("inf")}, "focal_px of `a` is"),
        ({"focal_px": 50.0, "centre_px": (float("nan"), 3.0)}, r"centre_px of `a` is \[NaN, 3.0\], expected"),
    ],
)
def test_a_lens_that_cannot_be_is_said_at_once(lens, message):
    with pytest.raises(esaac.ArgumentError, match=message):
        ros.Publisher([ros.Camera("a", "dvs128", **lens)], network=False)


def test_what_is_no_camera_no_frame_or_no_recording_is_said(tmp_path):
    told = ros.Camera("a", "dvs128", rgb=True)
    for cameras, message in (
        (["a"], "a camera is a str, expected a ros.Camera"),
        ("a", "cameras is a str, expected a list"),
        (told, "cameras is a Camera, expected a list"),
    ):
        with pytest.raises(esaac.ArgumentError, match=message):
            ros.Publisher(cameras, network=False)
    with pytest.raises(esaac.ArgumentError, match="run.bag`, expected a name that ends in .mcap"):
        ros.Publisher([told], network=False, record=tmp_path / "run.bag")
    with ros.Publisher([told], network=False) as publisher:
        with pytest.raises(esaac.ArgumentError, match="the frame of `a` is a ndarray, expected a ros.Frame"):
            publisher.publish(0, {"a": np.zeros((128, 128, 3), np.uint8)})


def test_an_old_recording_stays_without_a_message(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(b"old")
    with pytest.raises(esaac.RosError, match="nonesuch0"):
        ros.Publisher([ros.Camera("a", "dvs128")], domain=domain(2), interface="nonesuch0", record=path)
    ros.Publisher([ros.Camera("a", "dvs128")], network=False, record=path).close()
    assert path.read_bytes() == b"old"


def test_an_environment_that_waits_is_published_at_its_own_time():
    camera = esaac.TiledEventCamera("dvs128", 2, **SENSOR)
    for index in range(13):
        hdr, motion = (np.stack([image] * 2) for image in bars(40, 24, index))
        packet = camera.step(hdr, motion, t_ns=[500_000_000 * index, None if index else 0])
    part = packet[0]
    events = ros._events(part)
    assert len(part) > 100
    np.testing.assert_array_equal(events.base_ns + events.t_offset_ns.astype(np.int64), part.t_ns)


def test_times_that_a_message_cannot_hold_are_refused():
    packet = types.SimpleNamespace(
        offsets=None, t_offset_ns=None, t_ns=np.array([0, 6_000_000_000]), base_ns=0
    )
    with pytest.raises(
        esaac.ArgumentError, match="are 0 to 6000000000 ns after .*, expected 0 to 4294967295"
    ):
        ros._events(packet)
    packet.base_ns = 5
    with pytest.raises(esaac.ArgumentError, match="are -5 to"):
        ros._events(packet)


def test_frames_that_do_not_fit_are_refused_and_the_publisher_goes_on(tmp_path):
    camera = esaac.EventCamera("dvs128", **SENSOR)
    publisher = ros.Publisher(
        [ros.Camera("a", camera.sensor, rgb=True)], network=False, record=tmp_path / "run.mcap"
    )
    for frame, message in (
        ({"a": ros.Frame(rgb=np.zeros((3, 4, 3), np.uint8))}, r"rgb of `a` has shape \[3, 4, 3\]"),
        ({"a": ros.Frame(rgb=np.zeros((24, 40, 3), np.float32))}, "float32, expected uint8"),
        ({"a": ros.Frame(depth=np.zeros((24, 40), np.float32))}, "announced without depth"),
        ({"a": ros.Frame(imu=[ros.Imu(0, (0, 0, 0), (0, 0, 0))])}, "announced without imu"),
        ({"b": ros.Frame()}, "no camera `b`, expected one of a"),
    ):
        with pytest.raises(esaac.EsaacError, match=message):
            publisher.publish(0, frame)
    for wrong in (0.5, 3.3e7, "0"):
        with pytest.raises(TypeError, match="t_ns is .*, expected an integer, nanoseconds"):
            publisher.publish(wrong, {"a": ros.Frame()})
    with esaac.EventCamera("dvs128", **{**SENSOR, "width": 48}) as wider:
        packet = wider.step(*bars(48, 24, 0), t_ns=0)
    with pytest.raises(esaac.FrameError, match="packet of `a` is 48x24 px, expected 40x24 px"):
        publisher.publish(0, {"a": ros.Frame(packet)})
    publisher.publish(0, {"a": ros.Frame(rgb=np.zeros((24, 40, 3), np.uint8))})
    # Any thread may publish.
    packet = camera.step(*bars(40, 24, 0), t_ns=FRAME_NS)
    thread = threading.Thread(target=publisher.publish, args=(FRAME_NS, {"a": ros.Frame(packet)}))
    thread.start()
    thread.join()
    summary = publisher.close()
    recorded = {topic["topic"]: topic["recorded"] for topic in summary["topics"]}
    assert recorded["/esaac/a/image_raw"] == 1 and recorded["/esaac/a/events"] == 1
    assert publisher.close() is None
    with pytest.raises(esaac.ClosedError, match="the publisher is closed"):
        publisher.publish(2, {})


@pytest.mark.parametrize(
    ("frame", "error", "message"),
    [
        (
            {"rgb": np.zeros((24, 40), np.uint8)},
            esaac.FrameError,
            r"rgb of `a` has shape \[24, 40\], expected \(height, width, 3 or 4\)",
        ),
        ({"rgb": np.zeros((24, 40, 1), np.uint8)}, esaac.FrameError, r"rgb of `a` has shape \[24, 40, 1\]"),
        ({"rgb": np.zeros((24, 40, 5), np.uint8)}, esaac.FrameError, r"rgb of `a` has shape \[24, 40, 5\]"),
        (
            {"depth": np.zeros((24, 40), np.uint16)},
            esaac.FrameError,
            "depth of `a` has dtype <u2, expected float32",
        ),
        ({"depth": np.zeros((24, 40))}, esaac.FrameError, "depth of `a` has dtype <f8, expected float32"),
        (
            {"depth": np.zeros((24, 40, 3), np.float32)},
            esaac.FrameError,
            r"depth of `a` has shape \[24, 40, 3\], expected \(height, width\)",
        ),
        (
            {"imu": [ros.Imu(0, (0, 0), (0, 0, 9.81))]},
            esaac.ArgumentError,
            r"angular_rate_rad_s of `a` has shape \[2\], expected \[3\]: x, y, z",
        ),
        (
            {"imu": [ros.Imu(0, np.zeros(3), 9.81)]},
            esaac.ArgumentError,
            r"specific_force_m_s2 of `a` has shape \[\], expected \[3\]",
        ),
        (
            {"imu": [ros.Imu(0, ("x", "y", "z"), np.zeros(3))]},
            esaac.ArgumentError,
            r"angular_rate_rad_s of `a` is \('x', 'y', 'z'\), expected three numbers",
        ),
        (
            {"imu": ros.Imu(0, (0, 0, 0), (0, 0, 9.81))},
            esaac.ArgumentError,
            "imu of `a` is a ros.Imu, expected a list of them",
        ),
        ({"imu": [(0, (0, 0, 0), (0, 0, 9))]}, esaac.ArgumentError, "sample of `a` is a tuple, expected a"),
    ],
)
def test_images_and_samples_of_another_kind_are_named(tmp_path, frame, error, message):
    told = ros.Camera("a", esaac.SensorModel("dvs128", **SENSOR), rgb=True, depth=True, imu=True)
    with ros.Publisher([told], network=False, record=tmp_path / "run.mcap") as publisher:
        with pytest.raises(error, match=message):
            publisher.publish(0, {"a": ros.Frame(**frame)})
        sample = ros.Imu(0, np.zeros(3, np.float32), [0, 0, 9.81])
        depth = np.ones((24, 40, 1), np.float32)
        publisher.publish(0, {"a": ros.Frame(depth=depth, imu=[sample])})
        with pytest.raises(AttributeError, match="has no attribute 'domain'"):
            publisher.domain = 3


def test_a_camera_that_was_reset_is_told_unless_the_publisher_is_restarted(tmp_path):
    camera = esaac.EventCamera("dvs128", **SENSOR)

    def run(publisher):
        camera.reset()
        for index in range(3):
            packet = camera.step(*bars(40, 24, index), t_ns=FRAME_NS * index)
            publisher.publish(FRAME_NS * index, {"a": ros.Frame(packet)})

    options = {"network": False, "record": tmp_path / "run.mcap"}
    with ros.Publisher([ros.Camera("a", camera.sensor)], **options) as publisher:
        run(publisher)
        publisher.restart()
        run(publisher)
        assert publisher.notices() == [] and publisher.summary()["time_resets"] == 1
        run(publisher)
        (notice,) = publisher.notices()
        assert f"camera `a` went back from {2 * FRAME_NS} to 0 ns, and `restart` was not called" in notice
        assert publisher.summary()["unannounced_resets"] == 1


def test_mono_refuses_times_before_zero(tmp_path):
    camera = esaac.EventCamera("dvs128", **SENSOR)
    options = {"network": False, "record": tmp_path / "run.mcap", "events": "mono"}
    with ros.Publisher([ros.Camera("a", camera.sensor)], **options) as publisher:
        camera.step(*bars(40, 24, 0), t_ns=-2 * FRAME_NS)
        packet = camera.step(*bars(40, 24, 1), t_ns=-FRAME_NS)
        with pytest.raises(
            esaac.ArgumentError, match=f"`a` count from {packet.base_ns} ns, expected 0 or later"
        ):
            publisher.publish(-FRAME_NS, {"a": ros.Frame(packet)})


def test_a_forked_child_is_told():
    with ros.Publisher([ros.Camera("a", "dvs128")], network=False) as publisher:
        child = os.fork()
        if child == 0:
            try:
                publisher.publish(0, {})
            except esaac.ForkError:
                os._exit(0)
            os._exit(1)
        assert os.waitpid(child, 0)[1] == 0
