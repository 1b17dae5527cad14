"""What is new in Isaac Sim 6: cameras with rates of their own, motion of two channels, and their sensor classes."""

import asyncio
import itertools

import carb.settings
import numpy as np
import pytest
from isaacsim.sensors.experimental.rtx import CameraSensor, RtxCamera
from kit_stage import APP, bridge, camera, fresh_stage, move
from omni.replicator import core as rep
from pxr import Sdf, Usd

from esaac_sim.bridge import SETTINGS
from esaac_sim.frames import FrameUnusable, frame_of
from esaac_sim.rtx import events_of
from esaac_sim.schema import SchemaError

RATE = "omni:sensor:tickRate"


@pytest.fixture
def stage():
    with fresh_stage() as stage:
        yield stage


def sent(stage, frames=14):
    """Events of a camera that a bridge attaches: times and columns."""
    running, packets = bridge(), []
    assert running.attach(stage) == 1 and not running.problems
    (feed,) = running.feeds
    feed.sinks.append(lambda feed, packet: packets.append((packet.t_ns.copy(), packet.x.copy())))
    move(stage, frames)
    assert feed.frames == frames - 2 and not feed.faults, feed.message
    running.detach()
    rep.reset()
    return [np.concatenate(part) for part in zip(*packets)]


def test_a_camera_with_a_rate_is_drawn_at_every_frame_while_it_is_attached(stage):
    expected = sent(stage)
    rate = stage.GetPrimAtPath("/camera").CreateAttribute(RATE, Sdf.ValueTypeNames.Float)
    rate.Set(20.0)
    before = stage.GetRootLayer().ExportToString()
    for actual, same in zip(sent(stage), expected):
        np.testing.assert_array_equal(actual, same)
    assert len(expected[0]) > 100
    assert rate.Get() == 20.0 and stage.GetSessionLayer().empty
    cube = "xformOp:translate"
    assert stage.GetRootLayer().ExportToString().split(cube)[0] == before.split(cube)[0]


def test_what_the_session_says_of_a_rate_holds_again(stage):
    rate = stage.GetPrimAtPath("/camera").CreateAttribute(RATE, Sdf.ValueTypeNames.Float)
    rate.Set(0.0)
    with Usd.EditContext(stage, Usd.EditTarget(stage.GetSessionLayer())):
        rate.Set(30.0)
    running = bridge()
    running.attach(stage)
    assert rate.Get() == 0.0
    running.detach()
    assert rate.Get() == 30.0


def test_a_renderer_that_keeps_its_rate_fails_the_self_test(stage):
    carb.settings.get_settings().set(SETTINGS + "self_test", True)
    stage.GetPrimAtPath("/camera").CreateAttribute(RATE, Sdf.ValueTypeNames.Float).Set(30.0)
    camera(stage, "/every_frame", sensor="dvs128", overrides="width = 32\nheight = 24")
    rep.faults.keeps_rate = True
    running = bridge()
    assert asyncio.run(running.self_test(APP, stage))
    (rate,) = (check for check in running.checks if check.name == "rate")
    assert not rate.holds and "it is not drawn at every frame" in rate.message
    assert running.attach(stage) == 1 and running.feeds[0].spec.path == "/every_frame"
    assert "/camera: omni:sensor:tickRate is 30, and the self-test saw" in running.problems[0]
    running.detach()
    assert stage.GetSessionLayer().empty and not stage.GetPrimAtPath("/EsaacSelfTest")


def test_stale_images_would_come_in_bursts(stage):
    """The trap itself: what a renderer with a rate hands out to those who do not know."""
    stage.GetPrimAtPath("/camera").CreateAttribute(RATE, Sdf.ValueTypeNames.Float).Set(20.0)
    images = []
    product = rep.create.render_product("/camera", (64, 48))
    rep.faults.empty_frames = 0
    writer = rep.Writer()
    writer.annotators = [rep.AnnotatorRegistry.get_annotator("HdrColor")]
    writer.write = lambda data: images.append(next(iter(data.values())).numpy().copy())
    writer.attach([product])
    move(stage, 6, speed=0.2)
    assert [bool((a == b).all()) for a, b in itertools.pairwise(images)] == [True, True, False, True, True]


def test_motion_of_two_channels_gives_the_same_events(stage):
    expected = sent(stage)
    rep.faults.motion_channels = 2
    for actual, same in zip(sent(stage), expected):
        np.testing.assert_array_equal(actual, same)
    image = np.zeros((4, 5, 4), np.float16)
    data = {"HdrColor": image, "IsaacReadSimulationTime": 0.5}
    assert frame_of({**data, "motion_vectors": image[..., :2].astype(np.float32)}, 5, 4).motion.shape[-1] == 2
    with pytest.raises(FrameUnusable, match=r"expected \(4, 5, 4\) or \(4, 5, 2\)"):
        frame_of({**data, "motion_vectors": image[..., :3]}, 5, 4)


@pytest.mark.parametrize("mode", ["motion", "rigid"])
def test_a_camera_sensor_of_a_script_sends_events_of_its_own_images(stage, mode):
    prim = stage.GetPrimAtPath("/camera")
    prim.GetAttribute("esaac:mode").Set(mode)
    expected = sent(stage)
    sensor = CameraSensor(RtxCamera("/camera", tick_rate=20.0), resolution=(48, 64), render_vars=["HdrColor"])
    packets = []
    with events_of(sensor, stage) as feed:
        feed.sinks.append(lambda feed, packet: packets.append((packet.t_ns.copy(), packet.x.copy())))
        move(stage, 14)
        assert feed.frames == 12 and feed.camera.synthesis == mode and not feed.faults, feed.message
        assert prim.GetAttribute(RATE).Get() == 0.0
        assert carb.settings.get_settings().get("/rtx/post/histogram/enabled") is False
    for actual, same in zip([np.concatenate(part) for part in zip(*packets)], expected):
        np.testing.assert_array_equal(actual, same)
    # The script's own sensor stays.
    assert feed.camera.closed and prim.GetAttribute(RATE).Get() == 20.0
    (product,) = rep._PRODUCTS
    assert not product.writers
    tall = CameraSensor(RtxCamera("/camera"), resolution=(64, 48))
    with pytest.raises(SchemaError, match=r"\(64, 48\), expected the sensor's \(48, 64\)"):
        with events_of(tall, stage):
            pass
