"""The self-test: draws a scene of known geometry and checks what the renderer hands out.

A renderer's documentation does not say everything: the sign of motion vectors, say. So a cube moves at a known speed
before a known camera. `run` draws it. `judge` compares what was drawn with what geometry says, and needs no Kit. A
failed check switches off what depends on it: wrong motion vectors the synthesis `motion`, wrong depth or ids
poses, a wrong clock publishing. All events depend on the light, so if that is not linear each camera has a problem,
and runs.
"""

import dataclasses
import itertools
import math

import numpy as np

from .frames import HDR, MOTION, TIME, FrameUnusable, find, payload, seconds

ROOT = "/EsaacSelfTest"
CUBE = f"{ROOT}/cube"
"""Paths of prims."""
SIZE_PX = (128, 96)
"""Columns and rows."""
FOCAL_MM, APERTURE_MM = 24.0, 20.955
DISTANCE_M = 4.0
CUBE_M = 1.0
SPEED_M_PER_S = (0.6, 0.3)
"""Of the cube: to the right, and up."""
RIM_PX = 3
"""Pixels at the cube's border that are not looked at."""
RATE_HZ = 60.0
FRAMES = 8
TICK_HZ = 12.0
"""Rate of the camera, as the stage says. `ticks.EveryFrame` must overrule it."""
OLD = 4
"""So many equal images in a row are one: over them the cube moves by more than a pixel."""
RADIANCE = (0.5, 2.0)
"""Of the cube in the first and the second half of the frames: HdrColor follows light, not its square root."""


@dataclasses.dataclass(frozen=True)
class Check:
    """An assumption, whether it holds, and what was seen."""

    name: str
    holds: bool
    message: str
    disables: str = ""


def focal_px():
    return FOCAL_MM / APERTURE_MM * SIZE_PX[0]


def expected_motion_px():
    """Of the cube's front, from this frame to the last one: x right, y down."""
    front_m = DISTANCE_M - CUBE_M / 2
    scale = focal_px() / front_m / RATE_HZ
    # It moves right and up, so it came from the left and from below.
    return -SPEED_M_PER_S[0] * scale, SPEED_M_PER_S[1] * scale


def cube_px():
    """Rows and columns that show the cube's front in every frame, without its rim. It need not be the brightest: a
    dome light of the stage may be brighter."""
    scale = focal_px() / (DISTANCE_M - CUBE_M / 2)
    # It moves right and up from the middle, until the last of `run`'s updates.
    way = [scale * speed * (FRAMES + 1) / RATE_HZ for speed in SPEED_M_PER_S]
    reach = scale * CUBE_M / 2 - RIM_PX
    x, y = (size / 2 for size in SIZE_PX)
    columns = slice(math.ceil(x + way[0] - reach), math.floor(x + reach))
    rows = slice(math.ceil(y - reach), math.floor(y - way[1] + reach))
    return rows, columns


def judge(frames, with_geometry=False):
    """Checks of a list of writer's data, of depth and ids too `with_geometry`. The first frames may be empty, and
    motion of the first is not trusted."""
    if not frames:
        seen = (
            "Replicator handed out no frames while the timeline played: is its capture on play switched off?"
        )
        return [Check("frames", False, seen, disables="everything")]
    drawn, notes = [], []
    for data in frames:
        try:
            drawn.append(_read(data))
        except FrameUnusable as unusable:
            notes.append(str(unusable))
    if len(drawn) < 4:
        seen = f"{len(drawn)} of {len(frames)} frames could be read" + (f": {notes[-1]}" if notes else "")
        return [Check("frames", False, seen, disables="everything")]
    geometry = []
    if with_geometry:
        from . import self_test_geometry

        geometry = self_test_geometry.checks(frames)
    return [
        Check("frames", True, f"{len(drawn)} of {len(frames)} frames; {len(notes)} empty at the start"),
        _motion(drawn),
        _light(drawn),
        _clock(drawn),
        _rate(drawn),
        _memory(frames),
        *geometry,
    ]


def _read(data):
    def image(name):
        array = payload(find(data, name))
        if array is None or 0 in tuple(array.shape):
            raise FrameUnusable(f"{name} is empty")
        return np.asarray(array.numpy() if hasattr(array, "numpy") else array, dtype=np.float64)

    entry = find(data, TIME)
    if entry is None:
        raise FrameUnusable(f"no {TIME}")
    return image(HDR), image(MOTION), seconds(entry)


def _motion(drawn):
    measured = np.median(
        [np.median(motion[cube_px()][..., :2], axis=(0, 1)) for _, motion, _ in drawn[1:]], axis=0
    )
    expected = np.array(expected_motion_px())
    told = f"({measured[0]:+.2f}, {measured[1]:+.2f}) px, expected ({expected[0]:+.2f}, {expected[1]:+.2f})"
    if np.allclose(measured, expected, rtol=0.15, atol=0.1):
        return Check("motion", True, told)
    guesses = {
        "they are negated": -expected,
        "their y points up": expected * (1, -1),
        "they are fractions of the image": expected / SIZE_PX,
        "they are zero: is a subframe setting on?": expected * 0,
    }
    why = [name for name, guess in guesses.items() if np.allclose(measured, guess, rtol=0.15, atol=1e-3)]
    return Check("motion", False, "; ".join([told, *why]), disables="motion")


def _light(drawn):
    half = len(drawn) // 2
    level = [
        np.median([hdr[cube_px()][..., :3].mean() for hdr, _, _ in part])
        for part in (drawn[:half], drawn[half:])
    ]
    ratio, expected = level[1] / max(level[0], 1e-9), RADIANCE[1] / RADIANCE[0]
    told = f"light times {expected:g} draws HdrColor times {ratio:.2f}"
    holds = bool(np.isclose(ratio, expected, rtol=0.1))
    return Check(
        "light",
        holds,
        told if holds else told + ": exposure or a curve is on",
        disables="" if holds else "light",
    )


def _clock(drawn):
    steps = np.diff([t for _, _, t in drawn])
    told = f"frames {1e3 * np.median(steps):.2f} ms apart, expected {1e3 / RATE_HZ:.2f}"
    holds = bool((steps > 0).all() and np.isclose(np.median(steps), 1 / RATE_HZ, rtol=0.05))
    return Check("clock", holds, told, disables="" if holds else "publish")


def _rate(drawn):
    longest = run = 1
    for (before, _, _), (hdr, _, _) in itertools.pairwise(drawn):
        run = run + 1 if np.array_equal(before, hdr) else 1
        longest = max(longest, run)
    told = f"at most {longest} equal images in a row, of a camera with a rate of {TICK_HZ:g} Hz"
    holds = longest < OLD
    told = told if holds else f"{told}, expected less than {OLD}: it is not drawn at every frame"
    return Check("rate", holds, told, disables="" if holds else "rate")


def _memory(frames):
    arrays = [payload(find(data, HDR)) for data in frames[-3:]]
    on_device = all(hasattr(a, "__cuda_array_interface__") or hasattr(a, "__dlpack_device__") for a in arrays)
    kind = type(arrays[-1]).__module__ + "." + type(arrays[-1]).__name__
    strides = getattr(arrays[-1], "strides", None)
    told = f"HdrColor is a {kind}, strides {strides}"
    return Check("memory", on_device, told, disables="" if on_device else "texture")


def disabled(checks):
    """What failed assumptions switch off."""
    return {check.disables for check in checks if not check.holds and check.disables}


async def run(app, stage, with_texture=False, device=None, with_geometry=False):
    """Draws the scene below a root of its own and judges it: depth and ids too `with_geometry`. Afterwards root and
    timeline are as before.

    Raises `TimelineStopped` if somebody stops the timeline meanwhile: then nothing is known of the renderer.
    """
    from .self_test_scene import SelfTestScene
    from .timeline import playing

    scene = SelfTestScene(stage, with_geometry)
    twins = None
    try:
        if with_texture:
            from .self_test_texture import Twins

            twins = scene.twins = Twins(scene.product, device)
        async with playing(app):
            for index in range(FRAMES + 2):
                scene.move(index)
                await app.next_update_async()
        checks = judge(scene.frames[-FRAMES:], with_geometry)
        return checks + ([twins.check()] if twins else [])
    finally:
        scene.remove()
        if twins:
            twins.close()
