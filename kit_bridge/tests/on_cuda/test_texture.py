"""Textures of CUDA as frames, and the Kit extension's texture path: stand-ins for Kit, CUDA's own mipmapped arrays.

Run by name, as all of `on_cuda`.
"""

import asyncio

import carb.settings
import numpy as np
import omni.syntheticdata
import omni.usd
import pytest
import torch
from conftest import FRAME_NS, assert_same, bars, run
from kit_stage import APP, TIMELINE, move
from omni.replicator import core as rep
from omni.syntheticdata import MipmappedArray
from pxr import Gf, Sdf, Usd, UsdGeom

import esaac
from esaac_sim.bridge import SETTINGS, Bridge
from esaac_sim.extension import Log

SIZE = {"width": 40, "height": 24, "contrast_on": 0.15, "contrast_off": 0.15}


def camera(**parameters):
    return esaac.EventCamera("dvs128", **{"device": "cuda:0", **SIZE, **parameters})


@pytest.mark.parametrize("packets", ["host", "cuda"])
def test_a_texture_gives_the_events_of_its_pixels_with_one_copy(packets):
    half = lambda hdr, motion: (hdr.astype(np.float16), motion)
    expected = run(camera(), count=5, change=half)
    cam, texture, parts = camera(packets=packets), MipmappedArray(40, 24), []
    for index in range(5):
        hdr, motion = half(*bars(40, 24, index))
        texture.draw(hdr)
        image = esaac.CudaTexture(texture.handle.value, 40, 24)
        packet = cam.step(image, torch.from_numpy(motion).cuda(), t_ns=FRAME_NS * index)
        host = lambda column: column.numpy() if hasattr(column, "numpy") else column
        parts.append([host(getattr(packet, name)) for name in ("x", "y", "t_ns", "p")])
    assert_same([np.concatenate(columns) for columns in zip(*parts)], expected)
    assert cam.statistics["host_copies"] == 0 and cam.statistics["device_copies"] == 10


def test_a_texture_of_another_size_or_format_is_told():
    texture = MipmappedArray(40, 24)
    other = MipmappedArray(41, 24)
    motion = torch.zeros(24, 40, 2, device="cuda")
    for handle, dtype, message in (
        (other, "float16", "texture of `hdr` is 41x24 px of 4 x CU_AD_FORMAT_HALF, expected 40x24"),
        (texture, "float32", "expected 40x24 px of 4 x CU_AD_FORMAT_FLOAT"),
    ):
        with pytest.raises(esaac.FrameError, match=message):
            camera().step(esaac.CudaTexture(handle.handle.value, 40, 24, dtype=dtype), motion, t_ns=0)
    with pytest.raises(esaac.FrameError, match="motion is a texture, expected an array"):
        image = torch.zeros(24, 40, 4, device="cuda").half()
        camera().step(image, esaac.CudaTexture(texture.handle.value, 40, 24), t_ns=0)
    many = esaac.TiledEventCamera("dvs128", 1, device="cuda:0", **SIZE)
    with pytest.raises(esaac.FrameError, match="expected an array of all environments|has shape"):
        many.step(esaac.CudaTexture(texture.handle.value, 40, 24), motion[None], t_ns=0)
    with pytest.raises(esaac.ArgumentError, match="handle is 0"):
        esaac.CudaTexture(0, 40, 24)


@pytest.fixture
def stage():
    rep.reset()
    TIMELINE.reset()
    omni.syntheticdata.faults.__dict__.update(wrong_size=False, stale=False)
    settings = carb.settings.get_settings()
    settings.clear()
    settings.set(SETTINGS + "device", "cuda:0")
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.Cube.Define(stage, "/cube").AddTranslateOp().Set(Gf.Vec3d(-0.5, 0.2, 0))
    eye = UsdGeom.Camera.Define(stage, "/camera")
    eye.AddTranslateOp().Set(Gf.Vec3d(0, 0, 8))
    eye.GetPrim().CreateAttribute("esaac:sensor", Sdf.ValueTypeNames.Token).Set("dvs128")
    omni.usd.get_context().stage = stage
    yield stage
    omni.usd.get_context().stage = None


def seen(stage, path):
    """Events of a moving cube by a path, and the feed's copies."""
    carb.settings.get_settings().set(SETTINGS + "path", path)
    TIMELINE.reset()
    rep._FRAME = 0
    bridge = Bridge(carb.settings.get_settings(), Log())
    asyncio.run(bridge.self_test(APP, stage))
    rep._FRAME = 0
    assert bridge.attach(stage) == 1
    (feed,) = bridge.feeds
    packets = []
    feed.sinks.append(lambda feed, packet: packets.append(packet))
    move(stage, 12)
    assert packets, (feed.message, bridge.problems)
    told = (
        feed.texture is not None,
        feed.message,
        feed.camera.statistics["host_copies"],
        list(bridge.problems),
    )
    checks = {check.name: check for check in bridge.checks}
    bridge.detach()
    return (
        [np.concatenate([getattr(p, name) for p in packets]) for name in ("x", "y", "t_ns", "p")],
        told,
        checks,
    )


def test_the_extension_feeds_by_the_texture_once_the_self_test_has_passed(stage):
    expected, (by_texture, message, copies, _), checks = seen(stage, "annotator")
    assert not by_texture and message == "running" and copies == 0 and "texture" not in checks
    actual, (by_texture, message, copies, problems), checks = seen(stage, "texture")
    assert all(check.holds for check in checks.values()) and not problems, checks
    assert by_texture and message == "running" and copies == 0, (message, checks["texture"])
    assert_same(actual, expected)
    print(checks["texture"].message)


@pytest.mark.parametrize(
    ("fault", "message"),
    [("wrong_size", "129x96 px, expected 128x96"), ("stale", "other events|another APS frame")],
)
def test_a_texture_that_is_not_what_it_should_be_is_not_used(stage, fault, message):
    import re

    expected, _, _ = seen(stage, "annotator")
    omni.syntheticdata.faults.__dict__[fault] = True
    actual, (by_texture, _, _, problems), checks = seen(stage, "texture")
    assert not by_texture and re.search(message, checks["texture"].message), checks["texture"]
    assert "annotator's array is used" in problems[0]
    assert_same(actual, expected)
