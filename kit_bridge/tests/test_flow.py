"""Optical flow by the poses, against what moves a renderer's pixels."""

import numpy as np
import pytest
from conftest import FRAME_NS
from rigid_scene import BODIES, CAMERA, HEIGHT, IMAGES, LENS, TIMES_NS, WIDTH, scene

import esaac

POSES = esaac.Poses(TIMES_NS, CAMERA, BODIES)


def flow(index, to_ns, poses=POSES, ids=None, depth=None):
    _, own_depth, own_ids = IMAGES[index]
    depth, ids = own_depth if depth is None else depth, own_ids if ids is None else ids
    return esaac.flow(depth, ids, intrinsics=LENS, poses=poses, from_ns=index * FRAME_NS, to_ns=to_ns)


def by_hand(step):
    """The flow from the first frame to a time of `TIMES_NS`, by matrices."""
    first = int(np.flatnonzero(TIMES_NS == 0)[0])
    rows, columns = np.indices((HEIGHT, WIDTH))
    _, depth, ids = IMAGES[0]
    across, up = (columns - LENS.cx) / LENS.fx, (LENS.cy - rows) / LENS.fy
    points = np.stack([across, up, -np.ones_like(across)], axis=-1) * depth[..., None]
    world = points @ scene.matrix(CAMERA[first, 3:]).T + CAMERA[first, :3]
    (before, after), centres = (scene.matrix(BODIES[k, 0, 3:]) for k in (first, step)), BODIES[:, 0, :3]
    moved = (world - centres[first]) @ before @ after.T + centres[step]
    world = np.where(ids[..., None] == 1, moved, world)
    seen = (world - CAMERA[step, :3]) @ scene.matrix(CAMERA[step, 3:])
    x = LENS.cx - LENS.fx * seen[..., 0] / seen[..., 2]
    y = LENS.cy + LENS.fy * seen[..., 1] / seen[..., 2]
    return np.stack([x - columns, y - rows], axis=-1)


def test_flow_is_that_of_the_poses_at_any_time():
    largest = 0
    for step, t_ns in enumerate(TIMES_NS.tolist()):
        away = flow(0, t_ns)
        assert away.shape == (HEIGHT, WIDTH, 2) and away.dtype == np.float32
        np.testing.assert_allclose(away, by_hand(step), atol=1e-3)
        largest = max(largest, np.abs(away).max())
    assert largest > 3


def test_several_cameras_and_a_recorder_are_as_good():
    alone = flow(0, FRAME_NS)
    two = esaac.Poses(TIMES_NS, np.stack([CAMERA, CAMERA[::-1]], axis=1), BODIES)
    _, depth, ids = IMAGES[0]
    both = flow(0, FRAME_NS, two, np.stack([ids] * 2), np.stack([depth] * 2))
    np.testing.assert_array_equal(both[0], alone)
    assert np.abs(both[1] - alone).max() > 0.1
    recorder = esaac.PoseRecorder()
    for t_ns, camera, bodies in zip(TIMES_NS, CAMERA, BODIES):
        recorder.record(t_ns, camera, bodies)
    np.testing.assert_allclose(flow(0, FRAME_NS, recorder), alone, atol=1e-5)


def test_there_is_none_without_a_path_and_wrong_arguments_are_named():
    _, depth, ids = IMAGES[0]
    holes, strange = depth.copy(), ids.copy()
    holes[3, 4], strange[5, 6] = np.nan, 99
    lacking = np.isnan(flow(0, FRAME_NS, ids=strange, depth=holes)).all(axis=-1)
    assert [tuple(at) for at in np.argwhere(lacking)] == [(3, 4), (5, 6)]
    with pytest.raises(esaac.FrameError, match="span"):
        flow(0, int(TIMES_NS[-1]) + 1)
    with pytest.raises(esaac.FrameError, match=r"depth has shape \(24,\)"):
        flow(0, FRAME_NS, depth=depth[:, 0])
    with pytest.raises(esaac.FrameError, match=r"ids have shape \(24, 3\)"):
        flow(0, FRAME_NS, ids=ids[:, :3])
    with pytest.raises(esaac.FrameError, match="1 cameras, expected 2"):
        flow(0, FRAME_NS, ids=np.stack([ids] * 2), depth=np.stack([depth] * 2))
    with pytest.raises(esaac.FrameError, match="ids are 4294967296 to 4294967297, expected 0 to 4294967295"):
        flow(0, FRAME_NS, ids=ids.astype(np.int64) + (1 << 32))
    with pytest.raises(esaac.ArgumentError, match="poses are a NoneType, expected esaac.Poses or"):
        esaac.flow(depth, ids, intrinsics=LENS, poses=None, from_ns=0, to_ns=FRAME_NS)
    with pytest.raises(esaac.ArgumentError, match="intrinsics are None, expected Intrinsics or"):
        esaac.flow(depth, ids, intrinsics=None, poses=POSES, from_ns=0, to_ns=FRAME_NS)
    with pytest.raises(TypeError, match="to_ns is 0.1, expected an integer, nanoseconds"):
        flow(0, 0.1)


@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.bool_, np.float16, np.float64])
def test_depth_is_of_the_type_that_a_step_takes(dtype):
    depth = IMAGES[0][1].astype(dtype)
    with pytest.raises(esaac.FrameError) as by_step:
        esaac.EventCamera("dvs128", width=WIDTH, height=HEIGHT, intrinsics=LENS).step(
            IMAGES[0][0], t_ns=0, depth=depth, poses=POSES
        )
    with pytest.raises(esaac.FrameError) as by_flow:
        flow(0, FRAME_NS, depth=depth)
    assert str(by_flow.value) == str(by_step.value) == f"depth has dtype {depth.dtype.str}, expected float32"


def test_ids_of_any_integers_are_the_same():
    ids = IMAGES[0][2]
    expected = flow(0, FRAME_NS)
    for dtype in (np.uint8, np.int16, np.uint16, np.int32, np.int64, np.uint64):
        np.testing.assert_array_equal(flow(0, FRAME_NS, ids=ids.astype(dtype)), expected)
    # The upper half of 16 bits, in both types.
    high = esaac.Poses(TIMES_NS, CAMERA, BODIES, ids={40_000: 0})
    for dtype in (np.uint16, np.int16, np.dtype(">i2")):
        told = np.where(ids == 1, 40_000, ids).astype(np.uint16).view(np.int16).astype(np.int64)
        told = told.astype(dtype) if np.dtype(dtype).kind == "i" else (told & 0xFFFF).astype(dtype)
        np.testing.assert_array_equal(flow(0, FRAME_NS, high, told), expected)
    # A number that 16 bits do not hold.
    far = esaac.Poses(TIMES_NS, CAMERA, BODIES, ids={4_000_000_000: 0})
    many = np.where(ids == 1, np.uint32(4_000_000_000), ids)
    np.testing.assert_array_equal(flow(0, FRAME_NS, far, many), expected)
