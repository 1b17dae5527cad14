"""The self-test's checks of depth and ids, which modes that follow poses need, and what follows from them, with
stand-ins for Kit."""

import asyncio
import re

import carb.settings
import numpy as np
import pytest
from kit_stage import APP, bridge, camera, fresh_stage, move
from omni.replicator import core as rep
from pxr import Sdf

from esaac_sim import self_test, self_test_geometry
from esaac_sim.bridge import SETTINGS

FAULTS = {
    "inverse_depth": (
        "depth",
        "0.2857 m at the cube, expected 3.5; 100% of its pixels have depth; it is the inverse",
    ),
    "holes": ("depth", "3.5 m at the cube, expected 3.5; 8.% of its pixels have depth, expected 99%"),
    "one_id": (
        "ids",
        "100% of the cube's pixels and 100% of the image's border have the cube's id, expected at least 99%",
    ),
    "no_labels": ("ids", "0 of 8 frames could be read: instance_id_segmentation has no `idToLabels`"),
}


@pytest.fixture
def stage():
    with fresh_stage() as stage:
        carb.settings.get_settings().set(SETTINGS + "self_test", True)
        yield stage


def set_mode(stage, mode):
    stage.GetPrimAtPath("/camera").GetAttribute("esaac:mode").Set(mode)


def checked(running, stage):
    assert asyncio.run(running.self_test(APP, stage))
    assert not stage.GetPrimAtPath(self_test.ROOT) and not rep._PRODUCTS
    return {check.name: check for check in running.checks}


@pytest.mark.parametrize("mode", ["rigid", "auto"])
def test_a_renderer_that_keeps_its_word_passes(stage, mode):
    set_mode(stage, mode)
    running = bridge()
    checks = checked(running, stage)
    assert set(checks) == {"frames", "motion", "light", "clock", "rate", "memory", "depth", "ids"}
    assert all(check.holds for check in checks.values()), checks
    assert running.attach(stage) == 1 and running.feeds[0].spec.with_geometry
    running.detach()


def test_only_cameras_that_need_them_have_them_tested(stage):
    running = bridge()
    assert not {"depth", "ids"} & set(checked(running, stage))
    before = running.checks
    checked(running, stage)
    assert running.checks is before
    set_mode(stage, "auto")
    assert {"depth", "ids"} < set(checked(running, stage))
    before = running.checks
    set_mode(stage, "motion")
    checked(running, stage)
    assert running.checks is before


@pytest.mark.parametrize("fault", FAULTS)
def test_wrong_depth_or_ids_switch_poses_off(stage, fault):
    rep.faults.__dict__[fault] = True
    set_mode(stage, "auto")
    running, (name, expected) = bridge(), FAULTS[fault]
    checks = checked(running, stage)
    assert {each for each, check in checks.items() if not check.holds} == {name}, checks
    assert re.match(expected, checks[name].message), checks[name]
    assert running.attach(stage) == 1
    assert "/camera: the renderer's depth or instance ids failed the self-test" in running.problems[0]
    assert "mode `auto` does without poses" in running.problems[0]
    move(stage, 6, speed=0.3)
    feed = running.feeds[0]
    assert feed.frames == 4 and feed.events > 0 and feed.camera.synthesis == "motion"
    running.detach()


def test_a_camera_that_cannot_do_without_is_not_attached(stage):
    rep.faults.one_id = True
    set_mode(stage, "rigid")
    running = bridge()
    checked(running, stage)
    assert running.attach(stage) == 0
    assert "failed the self-test, and mode `rigid` needs them" in running.problems[0]
    set_mode(stage, "auto")
    outputs = Sdf.ValueTypeNames.TokenArray
    stage.GetPrimAtPath("/camera").CreateAttribute("esaac:outputs", outputs).Set(["events", "event_ids"])
    camera(stage, "/other", sensor="dvs128", mode="motion", overrides="width = 64\nheight = 48")
    assert running.attach(stage) == 1 and running.feeds[0].spec.path == "/other"
    assert "and `event_ids` of esaac:outputs needs them" in running.problems[0]
    running.detach()


def frames(depth=3.5, behind=np.inf, ids=7, label=self_test.CUBE, count=8, dtype=np.uint32):
    """What a renderer hands out of the scene."""
    height, width = reversed(self_test.SIZE_PX)
    depths, numbers = np.full((height, width), behind), np.zeros((height, width), dtype)
    depths[self_test.cube_px()], numbers[self_test.cube_px()] = depth, ids
    labels = {"0": "BACKGROUND", "7": label, "9": f"{self_test.CUBE}s"}
    entry = {"data": numbers, "info": {"idToLabels": labels}}
    return [{"distance_to_image_plane": depths, "instance_id_segmentation": entry}] * count


@pytest.mark.parametrize(
    "drawn, wrong, expected",
    [
        ({}, None, ""),
        ({"behind": 0.0}, None, ""),
        ({"depth": 3.44}, None, ""),
        ({"label": f"{self_test.CUBE}/mesh"}, None, ""),
        ({"depth": 3.4}, "depth", "3.4 m at the cube, expected 3.5"),
        ({"depth": 350.0}, "depth", "it is in centimetres"),
        ({"depth": np.nan}, "depth", "0% of its pixels have depth"),
        ({"behind": 3.5}, "depth", "100% of the image's border is as far away, expected none"),
        ({"ids": 0}, "ids", "0% of the cube's pixels"),
        ({"ids": 9}, "ids", "0% of the cube's pixels"),
        ({"dtype": np.float32}, "ids", "is float32, expected whole numbers"),
    ],
)
def test_what_is_drawn_is_judged(drawn, wrong, expected):
    for check in self_test_geometry.checks(frames(**drawn)):
        assert check.holds == (check.name != wrong), check
        assert check.holds or expected in check.message, check
        assert check.disables == ("" if check.holds else "geometry")


def test_images_that_are_missing_or_of_another_shape_are_told():
    (data, *_), needed = frames(), self_test_geometry.ENOUGH
    for name, of in (("distance_to_image_plane", "depth"), ("instance_id_segmentation", "ids")):
        narrow = data[name]["data"][:, :9] if of == "ids" else data[name][:, :9]
        for image, expected in (
            (None, f"no {name}"),
            (narrow, f"{name} has shape (96, 9), expected (96, 128)"),
        ):
            broken = {**data, name: image}
            (check,) = [c for c in self_test_geometry.checks([broken] * 8) if not c.holds]
            assert check.name == of and f"0 of 8 frames could be read: {expected}" in check.message
            # Some frames at the start may be unreadable.
            enough = [broken] * 3 + [data] * needed
            assert all(check.holds for check in self_test_geometry.checks(enough))
            assert not all(check.holds for check in self_test_geometry.checks(enough[:-1]))
