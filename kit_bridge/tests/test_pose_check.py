"""Poses that do not predict the motion vectors: what is said of them, and what `auto` follows."""

import warnings

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, join
from rigid_scene import (
    BODIES,
    CAMERA,
    FRAMES,
    HEIGHT,
    IMAGES,
    LENS,
    STEPS,
    TIMES_NS,
    WIDTH,
    scene,
)

import esaac


def vectors(index):
    """From each pixel to where its surface was a frame before."""
    _, depth, ids = IMAGES[index]
    now, before = index * FRAME_NS * 1e-9, (index - 1) * FRAME_NS * 1e-9
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    seen = np.stack([(x - LENS.cx) / LENS.fx, -(y - LENS.cy) / LENS.fy, -np.ones_like(x)], -1)
    eye = scene.camera_pose(now)
    world = (seen * depth[..., None]) @ scene.matrix(eye[3:]).T + eye[:3]
    to, of = scene.box_pose(before), scene.box_pose(now)
    moved = (world - of[:3]) @ scene.matrix(of[3:]) @ scene.matrix(to[3:]).T + to[:3]
    world = np.where((ids == scene.BOX)[..., None], moved, world)
    eye = scene.camera_pose(before)
    there = (world - eye[:3]) @ scene.matrix(eye[3:])
    columns = LENS.cx + LENS.fx * there[..., 0] / -there[..., 2]
    rows = LENS.cy - LENS.fy * there[..., 1] / -there[..., 2]
    return np.stack([columns - x, rows - y], -1).astype(np.float32)


MOTION = [vectors(index) for index in range(FRAMES)]


def camera(synthesis):
    return esaac.EventCamera(
        "dvs128",
        width=WIDTH,
        height=HEIGHT,
        contrast_on=0.1,
        contrast_off=0.1,
        synthesis=synthesis,
        intrinsics=LENS,
    )


def run(cam, poses=None, change=lambda motion: motion, depth_unit=1.0):
    """Events, and what was warned of."""
    poses = poses or esaac.Poses(TIMES_NS, CAMERA, BODIES)
    packets = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for index, (hdr, depth, ids) in enumerate(IMAGES):
            images = {"depth": depth * np.float32(depth_unit), "ids": ids, "poses": poses}
            packets.append(cam.step(hdr, change(MOTION[index]), t_ns=index * FRAME_NS, **images))
    return join(packets), [w for w in caught if w.category is esaac.PoseWarning]


def inverted(poses):
    """Body from world of world from body."""
    other = poses.copy()
    for at in np.ndindex(poses.shape[:-1]):
        other[(*at, slice(3, 6))] = -poses[(*at, slice(3, 6))]
        other[(*at, slice(0, 3))] = -scene.matrix(poses[at][3:]).T @ poses[at][:3]
    return other


@pytest.fixture(scope="module")
def expected():
    return run(camera("rigid"))[0]


def test_right_poses_are_followed_without_a_word(expected):
    cam = camera("auto")
    events, warned = run(cam)
    assert not warned and cam.synthesis == "rigid" and cam.pose_warnings == [None]
    assert_same(events, expected)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda motion: -motion, "the vectors' sign is flipped"),
        (lambda motion: motion / np.float32([WIDTH, HEIGHT]), "fractions of the image's size"),
    ],
)
def test_wrong_vectors_are_told_and_the_poses_are_followed(expected, change, cause):
    cam = camera("auto")
    events, warned = run(cam, change=change)
    (warning,) = warned
    assert cause in str(warning.message) and "are right by that and are followed" in str(warning.message)
    assert warning.filename == __file__ and cam.synthesis == "rigid"
    assert_same(events, expected)


SHIFTED = TIMES_NS + FRAME_NS


@pytest.mark.parametrize(
    ("given", "cause"),
    [
        ({"poses": esaac.Poses(TIMES_NS, inverted(CAMERA), BODIES)}, "camera from world, not world from"),
        ({"poses": esaac.Poses(TIMES_NS, CAMERA, BODIES, axes="ros")}, "camera's pose is one that looks"),
        ({"poses": esaac.Poses(SHIFTED[: -STEPS + 1], CAMERA[: -STEPS + 1], BODIES[: -STEPS + 1])}, "static"),
        ({"depth_unit": 0.001}, "static world"),
    ],
)
def test_wrong_poses_are_told_and_the_vectors_are_followed(expected, given, cause):
    cam = camera("auto")
    events, warned = run(cam, **given)
    assert warned and cause in str(warned[-1].message), warned
    assert "synthesis auto: all poses are left out" in cam.pose_warnings[0]
    assert cam.synthesis == "motion" and cam.sensor.synthesis == "auto"
    by_motion = camera("motion")
    reference = join(
        [by_motion.step(hdr, MOTION[index], t_ns=index * FRAME_NS) for index, (hdr, *_) in enumerate(IMAGES)]
    )
    assert abs(len(events[0]) / len(reference[0]) - 1) < 0.15
    assert cam.statistics["without_poses"] == WIDTH * HEIGHT
    assert_same(run(camera("auto"), **given)[0], events)
    # Asked for by name, poses are followed.
    named = camera("rigid")
    _, warned = run(named, **given)
    assert named.synthesis == "rigid" and "as synthesis rigid was asked for" in str(warned[-1].message)


def test_wrong_poses_of_a_body_are_left_out_alone():
    cam = camera("auto")
    _, warned = run(cam, poses=esaac.Poses(TIMES_NS, CAMERA, inverted(BODIES)))
    assert "instance 1: its poses are left out" in str(warned[-1].message)
    assert cam.synthesis == "rigid"
    assert cam.statistics["without_poses"] == int((IMAGES[-1][2] == scene.BOX).sum())


def test_environments_are_told_together_and_doubted_apart():
    cameras = np.stack([CAMERA, inverted(CAMERA), inverted(CAMERA)], axis=1)
    poses = esaac.Poses(TIMES_NS, cameras, BODIES)
    sensor = camera("auto").sensor
    with (
        esaac.TiledEventCamera(sensor, 3, intrinsics=LENS) as envs,
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("always")
        for index in range(2):
            hdr, depth, ids = (np.stack([plane] * 3) for plane in IMAGES[index])
            motion = np.stack([MOTION[index]] * 3)
            envs.step(hdr, motion, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=poses)
        assert envs.pose_warnings[0] is None and envs.pose_warnings[1] == envs.pose_warnings[2]
    (warning,) = [w for w in caught if w.category is esaac.PoseWarning]
    assert str(warning.message).startswith("camera 1 (and 1 others): depth and poses do not predict")
    rig = esaac.Rig([sensor] * 2, intrinsics=[LENS] * 2)
    for index in range(2):
        hdr, depth, ids = IMAGES[index]
        frames = [(hdr, MOTION[index], depth, ids)] * 2
        of_each = [esaac.Poses(TIMES_NS, each, BODIES) for each in (CAMERA, inverted(CAMERA))]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", esaac.PoseWarning)
            rig.step(frames, index * FRAME_NS, poses=of_each)
    assert rig.syntheses == ["rigid", "motion"]
