"""The self-test of the extension `esaac.sim` and what follows from it, on real USD stages with stand-ins for Kit (see
`stand_ins`)."""

import asyncio
import re

import carb
import carb.settings
import numpy as np
import omni.kit.menu.utils
import omni.syntheticdata
import omni.ui
import omni.usd
import pytest
import warp as wp
from kit_stage import APP, EXTENSION, TIMELINE, bridge, fresh_stage, move
from omni.replicator import core as rep
from pxr import Sdf, Usd

from esaac_sim import self_test, sinks
from esaac_sim.bridge import SETTINGS
from esaac_sim.extension import Extension
from esaac_sim.standalone import begin


@pytest.fixture
def stage():
    with fresh_stage() as stage:
        yield stage


def checked(stage, **faults):
    carb.settings.get_settings().set(SETTINGS + "self_test", True)
    rep.faults.__dict__.update(faults)
    running = bridge()
    before = TIMELINE.is_playing(), TIMELINE.is_stopped(), TIMELINE.get_current_time()
    assert asyncio.run(running.self_test(APP, stage))
    assert not stage.GetPrimAtPath("/EsaacSelfTest") and not rep._PRODUCTS
    assert (TIMELINE.is_playing(), TIMELINE.is_stopped()) == before[:2]
    assert TIMELINE.is_playing() or TIMELINE.get_current_time() == before[2]
    return running, {check.name: check for check in running.checks}


def test_the_self_test_passes_on_a_renderer_that_keeps_its_word(stage):
    running, checks = checked(stage)
    assert set(checks) == {"frames", "motion", "light", "clock", "rate", "memory"}
    assert all(check.holds for check in checks.values()), checks
    asyncio.run(running.self_test(APP, stage))
    assert running.attach(stage) == 1 and not running.problems
    running.detach()


@pytest.mark.parametrize("before", ["stopped", "paused", "playing"])
def test_the_self_test_plays_the_timeline_and_leaves_it_as_it_was(stage, before):
    if before != "stopped":
        move(stage, 3)
    if before == "paused":
        TIMELINE.pause()
        APP.update()
        assert not TIMELINE.is_playing() and TIMELINE.get_current_time() > 0
    _, checks = checked(stage)
    assert len(checks) == 6 and all(check.holds for check in checks.values()), checks


def test_a_self_test_that_somebody_stops_is_made_again(stage):
    carb.settings.get_settings().set(SETTINGS + "self_test", True)
    running = bridge()
    updates = iter(range(1000))

    class Impatient:
        async def next_update_async(self):
            if next(updates) == 4:
                TIMELINE.stop()
            APP.update()

    assert not asyncio.run(running.self_test(Impatient(), stage))
    assert TIMELINE.is_stopped() and not running.checks and "stopped" in carb.LINES[-1][1]
    assert not stage.GetPrimAtPath("/EsaacSelfTest") and not rep._PRODUCTS
    assert asyncio.run(running.self_test(APP, stage))
    assert len(running.checks) == 6 and all(check.holds for check in running.checks)


def test_a_replicator_that_does_not_capture_on_play_is_told(stage):
    rep.orchestrator.set_capture_on_play(False)
    running, checks = checked(stage)
    assert "capture on play" in checks["frames"].message and running.attach(stage) == 0


def test_standalone_scripts_begin_with_a_passed_self_test_and_a_stopped_timeline(stage):
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    try:
        rep.orchestrator.set_capture_on_play(False)
        running, begun = begin(lambda: loop.run_until_complete(asyncio.sleep(0)), self_test=True)
    finally:
        asyncio.set_event_loop(None)
        loop.close()
    assert len(running.checks) == 6 and all(check.holds for check in running.checks), running.checks
    assert begun is stage and TIMELINE.is_stopped()
    assert running.attach(stage) == 1 and not running.problems
    move(stage, 6)
    assert running.feeds[0].frames == 4
    running.detach()


def test_wrong_motion_vectors_switch_the_synthesis(stage):
    running, checks = checked(stage, negate_motion=True)
    assert not checks["motion"].holds and "they are negated" in checks["motion"].message
    assert running.attach(stage) == 1
    assert "mode `linear` is used" in running.problems[0]
    assert running.feeds[0].spec.sensor.synthesis == "linear"
    running.detach()


def test_the_texture_path_is_taken_only_where_the_self_test_has_passed(stage):
    settings = carb.settings.get_settings()
    settings.set(SETTINGS + "path", "texture")
    # The self-test is off: nobody knows.
    running = bridge()
    assert running.attach(stage) == 1 and running.feeds[0].texture is None
    assert "has not passed the self-test, so the annotator's array is used" in running.problems[0]
    running.detach()
    if wp.is_cuda_available():
        # Tests of `on_cuda` go on from here.
        return
    running, checks = checked(stage)
    assert checks["texture"].message == "HdrColorPtr lies on the host, expected a CUDA device"
    assert not checks["texture"].holds and all(c.holds for n, c in checks.items() if n != "texture")
    assert running.attach(stage) == 1 and running.feeds[0].texture is None and len(running.problems) == 1
    move(stage, 6)
    assert running.feeds[0].frames == 4
    running.detach()


def test_a_curve_a_stopped_clock_and_empty_frames_are_told(stage):
    running, checks = checked(stage, gamma=True)
    assert not checks["light"].holds and "exposure or a curve" in checks["light"].message
    assert running.attach(stage) == 1 and len(running.problems) == 1
    assert "/camera: the renderer's light failed the self-test" in running.problems[0]
    running.detach()
    running, checks = checked(stage, gamma=False, stopped_clock=True)
    assert not checks["clock"].holds
    stage.GetPrimAtPath("/camera").CreateAttribute("esaac:publish", Sdf.ValueTypeNames.Bool).Set(True)
    running.attach(stage)
    assert "nothing is published" in running.problems[0]
    running.detach()
    running, checks = checked(stage, stopped_clock=False, empty_frames=1000)
    assert not checks["frames"].holds and running.attach(stage) == 0
    assert "no camera is attached" in running.problems[0]


def test_a_self_test_ends_when_its_stage_closes(stage, monkeypatch):
    async def later(app):
        await asyncio.sleep(0)
        app.update()

    monkeypatch.setattr(type(APP), "next_update_async", later)

    async def session():
        carb.settings.get_settings().set(SETTINGS + "self_test", True)
        extension = Extension()
        extension.on_startup("esaac.sim")
        task = extension.attach()
        for _ in range(4):
            await asyncio.sleep(0)
        assert stage.GetPrimAtPath("/EsaacSelfTest")
        omni.usd.get_context().open(Usd.Stage.CreateInMemory())
        with pytest.raises(asyncio.CancelledError):
            await task
        assert not stage.GetPrimAtPath("/EsaacSelfTest") and TIMELINE.is_stopped() and not rep._PRODUCTS
        extension.on_shutdown()

    asyncio.run(session())


@pytest.mark.parametrize("background", [0.0, 1.0, 500.0])
def test_the_self_test_knows_the_cube_before_any_background(stage, monkeypatch, background):
    monkeypatch.setattr(rep, "BACKGROUND", background)
    _, checks = checked(stage)
    assert all(check.holds for check in checks.values()), checks
    _, checks = checked(stage, gamma=True, negate_motion=True)
    assert {name for name, check in checks.items() if not check.holds} == {"light", "motion"}, checks


def test_the_cube_is_judged_where_it_is_drawn():
    width, height = self_test.SIZE_PX
    rows, columns = self_test.cube_px()
    assert 20 < rows.stop - rows.start < 42 and 20 < columns.stop - columns.start < 42
    frames = []
    for index in range(self_test.FRAMES):
        hdr, motion = np.full((height, width, 4), 500.0), np.full((height, width, 4), 9.0)
        hdr[rows, columns] = self_test.RADIANCE[index >= self_test.FRAMES // 2]
        motion[rows, columns, :2] = self_test.expected_motion_px()
        # Something that is not at rest, so that images differ.
        hdr[0, 0] += index
        time = {"simulationTime": index / self_test.RATE_HZ}
        frames.append({"HdrColor": hdr, "motion_vectors": motion, "IsaacReadSimulationTime": time})
    assert not [check for check in self_test.judge(frames) if not check.holds]


def test_every_check_says_what_it_switches_off():
    frames = [{}]
    (check,) = self_test.judge(frames)
    assert not check.holds and self_test.disabled([check]) == {"everything"}
    assert sinks.Recorder.name == "recorder"
    # What a check switches off, the bridge looks at.
    package = EXTENSION / "esaac_sim"
    tests = "".join(path.read_text() for path in package.glob("self_test*.py"))
    given = re.findall(r"disables=([^,)]+)", tests)
    named = {name for value in given for name in re.findall(r'"(\w+)"', value)}
    assert {"everything", "motion", "light", "publish", "rate", "texture", "geometry"} <= named
    bridge_py = (package / "bridge.py").read_text()
    assert named == {name for name in named if f'"{name}" in off' in bridge_py}
