"""Tests what exact paths need of the renderer: depth, and which prim each pixel shows. Nothing of it is needed for
cameras in modes that follow motion vectors."""

import numpy as np

from .frames import DEPTH, IDS, FrameUnusable, image_of, labels_of
from .self_test import CUBE, CUBE_M, DISTANCE_M, SIZE_PX, Check, cube_px

ENOUGH = 4
"""Frames that must be read at least."""
LEAST_SHARE = 0.99
"""Of the cube's pixels that must have depth, and its id."""
FRONT_M = DISTANCE_M - CUBE_M / 2
TOLERANCE = 0.02
"""Of the depth: a sample lies anywhere in its pixel, and half floats have three digits."""


def checks(frames):
    """Checks of depth and ids in a list of writer's data, of which the first may be empty."""
    return [_check("depth", frames, _depth, _judged_depth), _check("ids", frames, _ids, _judged_ids)]


def _check(name, frames, read, judged):
    """One of the two: `read` gives what is seen in a frame, and `judged` whether all of it is as expected, in words
    too."""
    seen, why = [], ""
    for data in frames:
        try:
            seen.append(read(data))
        except FrameUnusable as unusable:
            why = str(unusable)
    if len(seen) < ENOUGH:
        holds, told = False, f"{len(seen)} of {len(frames)} frames could be read: {why}"
    else:
        holds, told = judged(*map(np.array, zip(*seen)))
    return Check(name, holds, told, disables="" if holds else "geometry")


def _image(data, name):
    width, height = SIZE_PX
    array = image_of(data, name, height, width, channels=((),))
    return np.asarray(array.numpy() if hasattr(array, "numpy") else array)


def _border(image):
    """Pixels that never show the cube."""
    return np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])


def _depth(data):
    """Depth of the cube, the share of its pixels that have some, and the share of the border that is as far away."""
    depth = _image(data, DEPTH).astype(np.float64)
    cube = depth[cube_px()]
    has_depth = np.isfinite(cube) & (cube > 0)
    depth_m = np.median(cube[has_depth]) if has_depth.any() else np.nan
    return depth_m, has_depth.mean(), _is_front(_border(depth)).mean()


def _is_front(depth_m):
    return np.isclose(depth_m, FRONT_M, rtol=TOLERANCE)


def _judged_depth(depth_m, share, border):
    depth_m = np.median(depth_m)
    told = f"{depth_m:.4g} m at the cube, expected {FRONT_M:g}; {share.min():.0%} of its pixels have depth"
    if share.min() < LEAST_SHARE:
        return False, f"{told}, expected {LEAST_SHARE:.0%}"
    if not _is_front(depth_m):
        guesses = {"it is the inverse": 1 / FRONT_M, "it is in centimetres": 100 * FRONT_M}
        why = [name for name, guess in guesses.items() if np.isclose(depth_m, guess, rtol=TOLERANCE)]
        return False, "; ".join([told, *why])
    if border.any():
        return False, f"{told}; {border.max():.0%} of the image's border is as far away, expected none"
    return True, told


def _ids(data):
    """Shares of the cube and of the border that are the cube by their ids."""
    ids, labels = _image(data, IDS), labels_of(data)
    if ids.dtype.kind not in "iu":
        raise FrameUnusable(f"{IDS} is {ids.dtype}, expected whole numbers")
    named = [int(number) for number, label in labels.items() if f"{label}/".startswith(f"{CUBE}/")]
    of_cube = np.isin(ids, named)
    return of_cube[cube_px()].mean(), _border(of_cube).mean()


def _judged_ids(share, border):
    told = f"{share.min():.0%} of the cube's pixels and {border.max():.0%} of the image's border have the cube's id"
    holds = bool(share.min() >= LEAST_SHARE and not border.any())
    return holds, told if holds else f"{told}, expected at least {LEAST_SHARE:.0%} and none"
