"""A rendered scene with depth, ids and poses, and events of cameras that look at it."""

import pathlib
import sys

import numpy as np
from conftest import FRAME_NS, join

import esaac

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "scripts"))

import rigid_numpy as scene

WIDTH, HEIGHT = 40, 24
FRAMES, STEPS = 4, 8
"""Frames of a run, and physics steps a frame."""
# The middle of the image that the scene renders is the middle of the lens.
LENS = esaac.Intrinsics(scene.FOCAL_PX, scene.FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
SENSOR = {"width": WIDTH, "height": HEIGHT, "contrast_on": 0.1, "contrast_off": 0.1}


def camera(**options):
    options = {"intrinsics": LENS, "synthesis": "rigid", **options}
    return esaac.EventCamera("dvs128", **SENSOR, **options)


def box_pose(shift_s=0.0):
    return lambda t: scene.box_pose(t + shift_s)


def frame(index, shift_s=0.0):
    """Colour, depth and ids; the box is ahead of its time by `shift_s`."""
    return scene.render(index * FRAME_NS * 1e-9, WIDTH, HEIGHT, samples=1, box=box_pose(shift_s))


IMAGES = [frame(index) for index in range(FRAMES)]
HDR, DEPTH, IDS = IMAGES[0]
TIMES_NS = np.arange(-STEPS, (FRAMES + 1) * STEPS) * FRAME_NS // STEPS


def numbers(shift_s=0.0):
    """Poses of the camera and of the box at all physics steps."""
    camera_poses = np.stack([scene.camera_pose(t) for t in TIMES_NS * 1e-9])
    return camera_poses, np.stack([scene.box_pose(t + shift_s) for t in TIMES_NS * 1e-9])[:, None]


CAMERA, BODIES = numbers()


def run(cam, poses=None, images=IMAGES, change=lambda array: array, **given):
    poses = esaac.Poses(TIMES_NS, CAMERA, BODIES) if poses is None else poses
    packets = []
    for index, (hdr, depth, ids) in enumerate(images):
        arrays = {"depth": change(depth), "ids": change(ids), **given}
        packets.append(cam.step(change(hdr), t_ns=index * FRAME_NS, poses=poses, **arrays))
    return join(packets)
