"""Scripts: what of them needs no Isaac Sim, and that the others are Python that an interpreter takes."""

import ast
import pathlib
import sys
import types

import numpy as np
import pytest
from conftest import FRAME_NS, bars

SCRIPTS = pathlib.Path(__file__).parents[1] / "scripts"
sys.path.insert(0, str(SCRIPTS))

from isaac_lab_env import EventObservation, Restarts, stale_images


def isaac_lab_2(hdr, motion):
    """What its tiled camera gives: bytes of colour, four channels of motion."""
    rgb = (255 * hdr[..., :3]).astype(np.uint8)
    return {"rgb": rgb, "motion_vectors": np.concatenate([motion, 0 * motion], axis=-1)}


def isaac_lab_3(hdr, motion):
    """What its cameras give: linear colour, two channels of motion, both wrapped."""
    output = {"rgb_hdr": np.ascontiguousarray(hdr[..., :3]), "motion_vectors": motion}
    return {name: types.SimpleNamespace(torch=array) for name, array in output.items()}


@pytest.mark.parametrize("given", [isaac_lab_2, isaac_lab_3])
def test_an_observation_of_events_for_every_environment(given):
    def camera(index):
        pairs = [bars(24, 16, index + 0.3 * env) for env in range(4)]
        output = given(*(np.stack(images) for images in zip(*pairs)))
        return types.SimpleNamespace(data=types.SimpleNamespace(output=output))

    observe = EventObservation(
        4, 16, 24, bins=3, device=None, packets="host", contrast_on=0.1, contrast_off=0.1
    )
    for index in range(3):
        grids = observe(camera(index), FRAME_NS * index)
    assert grids.shape == (4, 3, 16, 24) and (np.abs(grids).sum(axis=(1, 2, 3)) > 50).all()
    observe.reset(np.array([2]))
    grids = observe(camera(3), FRAME_NS * 3)
    assert np.abs(grids[2]).sum() == 0 and (np.abs(grids[[0, 1, 3]]).sum(axis=(1, 2, 3)) > 50).all()
    observe.close()


def observation():
    return EventObservation(2, 16, 24, bins=3, device=None, packets="host", contrast_on=0.1, contrast_off=0.1)


def changes(observe, index, phases_px):
    """Votes of two environments whose bars have moved on to these places."""
    pairs = [bars(24, 16, 1, shift_px=place) for place in phases_px]
    output = {
        "rgb": np.stack([(255 * hdr[..., :3]).astype(np.uint8) for hdr, _ in pairs]),
        "motion_vectors": np.stack([0 * np.concatenate([motion, motion], axis=-1) for _, motion in pairs]),
    }
    camera = types.SimpleNamespace(data=types.SimpleNamespace(output=output))
    return np.abs(observe(camera, FRAME_NS * index)).sum(axis=(1, 2, 3))


def test_a_reset_sends_no_burst_though_the_next_image_is_the_old_episodes():
    observe = observation()
    changes(observe, 0, (0, 0))
    usual = changes(observe, 1, (0.5, 0.5))
    assert (usual > 0).all()
    # Environment 1 is reset after its image was drawn: that one comes now, and then one of the new episode.
    observe.reset(np.array([1]), stale=1)
    old = changes(observe, 2, (1.0, 1.0))
    new = changes(observe, 3, (1.5, 9.0))
    on = changes(observe, 4, (2.0, 9.5))
    assert old[0] > 0 and new[0] > 0 and old[1] == new[1] == 0
    assert 0 < on[1] < 3 * usual[1]
    observe.close()
    # One that begins with the old episode's image takes the step to the new one for motion.
    observe = observation()
    changes(observe, 0, (0, 0))
    observe.reset([1])
    changes(observe, 2, (1.0, 1.0))
    assert changes(observe, 3, (1.5, 9.0))[1] > 3 * usual[1]
    observe.close()


def test_environments_restart_until_an_image_of_the_new_episode_has_come():
    restarts = Restarts(4)
    assert restarts.before_image().tolist() == []
    restarts.reset([1], stale=1)
    restarts.reset(np.array([3]), stale=0)
    assert [restarts.before_image().tolist() for _ in range(3)] == [[1, 3], [1], []]
    restarts.reset(None, stale=1)
    restarts.before_image()
    # Reset once more while the old image is waited for.
    restarts.reset([2], stale=1)
    assert [restarts.before_image().tolist() for _ in range(3)] == [[0, 1, 2, 3], [2], []]


@pytest.mark.parametrize(
    ("cfg", "expected"),
    [
        ({}, 1),
        ({"rerender_on_reset": False}, 1),
        ({"rerender_on_reset": True}, 0),
        ({"num_rerenders_on_reset": 0, "rerender_on_reset": False}, 1),
        ({"num_rerenders_on_reset": 2}, 0),
    ],
)
def test_isaac_lab_shows_the_old_episode_once_unless_it_renders_after_the_reset(cfg, expected):
    assert stale_images(types.SimpleNamespace(**cfg)) == expected


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda path: path.name)
def test_scripts_say_what_they_are_and_what_was_not_run(script):
    tree = ast.parse(script.read_text())
    words = ast.get_docstring(tree)
    assert script.name in words
    needs_kit = "isaacsim" in script.read_text() or "isaaclab" in script.read_text()
    assert needs_kit == ("Not run where this project is built" in words)
