"""Optical flow by the poses. See `__init__.pyi`."""

import numpy as np

from esaac import _native
from esaac.checks import nanoseconds
from esaac.errors import FrameError
from esaac.poses import Intrinsics, PoseRecorder, on_host


def flow(depth, ids=None, *, intrinsics, poses, from_ns, to_ns):
    depth = np.ascontiguousarray(on_host(depth), np.float32)
    if depth.ndim not in (2, 3):
        raise FrameError(
            f"depth has shape {depth.shape}, expected (height, width) or (cameras, height, width)"
        )
    images = depth if depth.ndim == 3 else depth[None]
    if ids is not None:
        ids = on_host(ids)
        if ids.shape != depth.shape or ids.dtype.kind not in "iu":
            raise FrameError(
                f"ids have shape {ids.shape} and dtype {ids.dtype}, expected {depth.shape} integers"
            )
        ids = np.ascontiguousarray(ids.reshape(images.shape), np.uint32)
    from_ns, to_ns = nanoseconds(from_ns), nanoseconds(to_ns)
    if isinstance(poses, PoseRecorder):
        poses = poses.spanning(min(from_ns, to_ns), max(from_ns, to_ns))
    lens = Intrinsics.of(intrinsics).told()
    return _native.flow(lens, poses, images, ids, from_ns, to_ns).reshape(*depth.shape, 2)
