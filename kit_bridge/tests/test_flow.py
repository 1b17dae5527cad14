"""Optical flow by the poses, against what moves a renderer's pixels."""

import numpy as np
import pytest
from conftest import FRAME_NS
from test_rigid import BODIES, CAMERA, HEIGHT, IMAGES, LENS, TIMES_NS, WIDTH

import esaac

POSES = esaac.Poses(TIMES_NS, CAMERA, BODIES)
LAST_NS = (len(IMAGES) - 1) * FRAME_NS


def flow(index, to_ns, poses=POSES, ids=None, depth=None):
    _, own_depth, own_ids = IMAGES[index]
    depth, ids = own_depth if depth is None else depth, own_ids if ids is None else ids
    return esaac.flow(depth, ids, intrinsics=LENS, poses=poses, from_ns=index * FRAME_NS, to_ns=to_ns)


def test_what_flow_leads_to_is_the_same_thing():
    away = flow(0, 2 * FRAME_NS)
    assert away.shape == (HEIGHT, WIDTH, 2) and away.dtype == np.float32
    _, depth, ids = IMAGES[0]
    _, there_depth, there_ids = IMAGES[2]
    rows, columns = np.indices((HEIGHT, WIDTH))
    x = np.rint(columns + away[..., 0]).astype(int)
    y = np.rint(rows + away[..., 1]).astype(int)
    inside = (x >= 0) & (x < WIDTH) & (y >= 0) & (y < HEIGHT)
    same = there_ids[y[inside], x[inside]] == ids[inside]
    assert inside.mean() > 0.8 and same.mean() > 0.95 and np.abs(away).max() > 1
    # Back again by the poses, from where the first led to.
    back = flow(2, 0)
    returned = away[inside] + back[y[inside], x[inside]]
    assert np.median(np.linalg.norm(returned, axis=-1)) < 0.1


def test_times_between_frames_and_several_cameras_are_as_good():
    parts = [flow(0, t_ns) for t_ns in (0, FRAME_NS // 2, FRAME_NS)]
    assert not parts[0].any()
    np.testing.assert_allclose(parts[1] * 2, parts[2], atol=0.4)
    assert not np.allclose(parts[1] * 2, parts[2], atol=1e-3)
    two = esaac.Poses(TIMES_NS, np.stack([CAMERA, CAMERA[::-1]], axis=1), BODIES)
    _, depth, ids = IMAGES[0]
    both = flow(0, FRAME_NS, two, np.stack([ids] * 2), np.stack([depth] * 2))
    np.testing.assert_array_equal(both[0], parts[2])
    assert np.abs(both[1] - parts[2]).max() > 0.1
    recorder = esaac.PoseRecorder()
    for t_ns, camera, bodies in zip(TIMES_NS, CAMERA, BODIES):
        recorder.record(t_ns, camera, bodies)
    np.testing.assert_allclose(flow(0, FRAME_NS, recorder), parts[2], atol=1e-5)


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
