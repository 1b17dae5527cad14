"""Synthesis `auto` where something is missing for exact paths: it takes the next best and says why, once."""

import warnings

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, bars, join

import esaac

WIDTH, HEIGHT, FRAMES = 40, 24, 4
LENS = esaac.Intrinsics(30.0, 30.0, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
DEPTH = np.full((HEIGHT, WIDTH), 2.0, np.float32)
IDS = np.zeros((HEIGHT, WIDTH), np.uint32)
POSES = esaac.Poses(np.array([0, FRAMES * FRAME_NS]), np.tile([0.0, 0, 0, 0, 0, 0, 1], (2, 1)))


def camera(synthesis="auto", intrinsics=LENS):
    return esaac.EventCamera(
        "dvs128", width=WIDTH, height=HEIGHT, synthesis=synthesis, intrinsics=intrinsics, contrast_on=0.1
    )


def step(cam, index, with_motion, **given):
    hdr, motion = bars(WIDTH, HEIGHT, index)
    return cam.step(hdr, motion if with_motion else None, t_ns=index * FRAME_NS, **given)


def run(cam, with_motion, first=0, last=FRAMES, **given):
    """Events, and what was warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        packets = [step(cam, index, with_motion, **given) for index in range(first, last)]
    return join(packets), [w for w in caught if w.category is esaac.SynthesisWarning]


MISSING = [
    ({"depth": DEPTH, "ids": IDS}, LENS, "no poses", "depth and ids are"),
    ({"depth": DEPTH}, LENS, "no poses", "depth is"),
    ({"ids": IDS}, LENS, "no poses", "ids are"),
    ({"poses": POSES}, LENS, "poses without depth", "poses are"),
    ({"ids": IDS, "poses": POSES}, LENS, "poses without depth", "ids and poses are"),
    ({"depth": DEPTH, "ids": IDS, "poses": POSES}, None, "depth without a lens", "depth, ids and poses are"),
]


@pytest.mark.parametrize(("given", "lens", "missing", "left_out"), MISSING)
@pytest.mark.parametrize("with_motion", [True, False])
def test_the_next_best_is_taken_and_told_once(given, lens, missing, left_out, with_motion):
    synthesis = "motion" if with_motion else "linear"
    reason = "there are motion vectors, but " if with_motion else "there are no motion vectors, and "
    cam = camera(intrinsics=lens)
    events, (warning,) = run(cam, with_motion, **given)
    expected = f"camera 0: synthesis `{synthesis}` (auto: {reason}{missing}); {left_out} left out"
    assert (str(warning.message), warning.filename) == (expected, __file__)
    assert cam.synthesis == synthesis and cam.sensor.synthesis == "auto"
    assert_same(events, run(camera(synthesis), with_motion)[0])
    assert all(use["purpose"] not in ("input depth", "input ids") for use in cam.memory())
    # By name nothing else is taken.
    with pytest.raises(esaac.FrameError, match=f"{missing}|without depth|needs depth, a lens and poses"):
        step(camera("rigid", lens), 0, with_motion, **given)


@pytest.mark.parametrize(("bodies", "noun"), [(1, "1 body"), (2, "2 bodies")])
def test_bodies_that_no_ids_tell_of_are_told_once(bodies, noun):
    still = np.tile([0.0, 0, 0, 0, 0, 0, 1], (2, bodies, 1))
    poses = esaac.Poses(np.array([0, FRAMES * FRAME_NS]), still[:, 0], still)
    cam = camera()
    _, (warning,) = run(cam, False, depth=DEPTH, poses=poses)
    text = (
        f"camera 0: the poses have {noun}, but the frames no ids: all pixels are taken for the static world"
    )
    assert str(warning.message) == text and cam.synthesis == "rigid"
    assert run(camera(), False, depth=DEPTH, ids=IDS, poses=poses)[1] == []


def test_nothing_is_told_where_nothing_is_left_out():
    for with_motion in (True, False):
        assert run(camera(), with_motion)[1] == []
    whole = {"depth": DEPTH, "ids": IDS, "poses": POSES}
    cam = camera()
    assert run(cam, False, **whole)[1] == [] and cam.synthesis == "rigid"


def test_the_first_frame_decides_and_the_others_are_like_it():
    cam = camera()
    run(cam, True, last=2, depth=DEPTH)
    _, warned = run(cam, True, first=2, depth=DEPTH, poses=POSES)
    assert cam.synthesis == "motion" and not warned
    with pytest.raises(
        esaac.FrameError, match="with 2 channels of F32 motion, expected .* with depth as in its"
    ):
        step(cam, FRAMES, True)
    with pytest.raises(esaac.FrameError, match="`rigid` needs depth, a lens and poses"):
        cam.sensor = cam.sensor.replace(synthesis="rigid")
    followed = camera()
    step(followed, 0, True, depth=DEPTH, poses=POSES)
    with pytest.raises(esaac.FrameError, match="no poses, expected poses= at every step"):
        step(followed, 1, True, depth=DEPTH)
    assert followed.synthesis == "rigid"


def test_a_first_frame_that_is_refused_tells_and_decides_nothing():
    rig, frame = esaac.Rig([camera().sensor] * 2, intrinsics=[LENS] * 2), (*bars(WIDTH, HEIGHT, 0), DEPTH)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(esaac.FrameError, match="the first step needs a frame of every camera"):
            rig.step([frame, None], 0)
        assert rig.syntheses == [None, None]
        rig.step([frame, frame], 0, poses=[POSES] * 2)
    assert rig.syntheses == ["rigid", "rigid"]


def test_a_saved_run_goes_on_as_one():
    whole, _ = run(camera(), True, depth=DEPTH, ids=IDS)
    first, second = camera(), camera()
    before, _ = run(first, True, last=2, depth=DEPTH, ids=IDS)
    second.restore(first.save())
    after, warned = run(second, True, first=2, depth=DEPTH, ids=IDS)
    assert second.synthesis == "motion" and not warned
    assert_same([np.concatenate(pair) for pair in zip(before, after)], whole)


def test_environments_are_told_together_and_steps_ahead_at_their_packets():
    sensor = camera().sensor
    with (
        esaac.TiledEventCamera(sensor, 3, intrinsics=LENS) as envs,
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("always")
        for index in range(2):
            hdr, motion = (np.stack([plane] * 3) for plane in bars(WIDTH, HEIGHT, index))
            envs.submit(hdr, motion, t_ns=index * FRAME_NS, depth=np.stack([DEPTH] * 3))
            assert len(caught) == index
            events = envs.packet()
        assert envs.synthesis == "motion" and len(events) > 100
    (warning,) = caught
    assert str(warning.message).startswith(
        "camera 0 (and 2 others): synthesis `motion` (auto: there are motion"
    )
    rig = esaac.Rig([sensor, sensor], intrinsics=[LENS, None])
    with pytest.warns(esaac.SynthesisWarning, match="camera 1: .* depth without a lens"):
        hdr, motion = bars(WIDTH, HEIGHT, 0)
        rig.step([(hdr, motion, DEPTH)] * 2, 0, poses=[POSES, POSES])
    assert rig.syntheses == ["rigid", "motion"]
