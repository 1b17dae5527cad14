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

from isaac_lab_env import EventObservation


def tiled_camera(count, index, wrapped=False):
    """What Isaac Lab's tiled camera gives: bytes of colour, four channels of motion; its version 3 wraps them."""
    pairs = [bars(24, 16, index + 0.3 * env) for env in range(count)]
    rgb = np.stack([(255 * hdr[..., :3]).astype(np.uint8) for hdr, _ in pairs])
    motion = np.stack([np.concatenate([motion, 0 * motion], axis=-1) for _, motion in pairs])
    output = {"rgb": rgb, "motion_vectors": motion}
    if wrapped:
        output = {name: types.SimpleNamespace(torch=array) for name, array in output.items()}
    return types.SimpleNamespace(data=types.SimpleNamespace(output=output))


def test_an_observation_of_events_for_every_environment():
    observe = EventObservation(
        4, 16, 24, bins=3, device=None, packets="host", contrast_on=0.1, contrast_off=0.1
    )
    for index in range(3):
        grids = observe(tiled_camera(4, index, wrapped=index == 2), FRAME_NS * index)
    assert grids.shape == (4, 3, 16, 24) and (np.abs(grids).sum(axis=(1, 2, 3)) > 50).all()
    observe.reset(np.array([2]))
    grids = observe(tiled_camera(4, 3), FRAME_NS * 3)
    assert np.abs(grids[2]).sum() == 0 and (np.abs(grids[[0, 1, 3]]).sum(axis=(1, 2, 3)) > 50).all()
    observe.close()


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda path: path.name)
def test_scripts_say_what_they_are_and_what_was_not_run(script):
    tree = ast.parse(script.read_text())
    words = ast.get_docstring(tree)
    assert script.name in words
    needs_kit = "isaacsim" in script.read_text() or "isaaclab" in script.read_text()
    assert needs_kit == ("Not run where this project is built" in words)
