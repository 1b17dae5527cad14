"""Optical flow by the poses. See `__init__.pyi`."""

import numpy as np

from esaac import _native
from esaac.checks import MOST_ID, check_depth, nanoseconds, on_host
from esaac.errors import ArgumentError, FrameError
from esaac.poses import Intrinsics, PoseRecorder, Poses


def flow(depth, ids=None, *, intrinsics, poses, from_ns, to_ns):
    """Displacements of what each pixel shows, from one time to another. See `__init__.pyi`."""
    depth = on_host(depth)
    check_depth(depth, "depth")
    if depth.ndim not in (2, 3):
        raise FrameError(
            f"depth has shape {depth.shape}, expected (height, width) or (cameras, height, width)"
        )
    images = np.ascontiguousarray(depth if depth.ndim == 3 else depth[None])
    if ids is not None:
        ids = on_host(ids)
        if ids.shape != depth.shape or ids.dtype.kind not in "iu":
            raise FrameError(
                f"ids have shape {ids.shape} and dtype {ids.dtype}, expected {depth.shape} integers"
            )
        if ids.dtype.kind == "i" and ids.dtype.itemsize <= 4:
            # Narrow signed integers are what some renderers have for unsigned ones.
            ids = ids.view(ids.dtype.str.replace("i", "u"))
        if ids.dtype.itemsize > 4 and ids.size and not 0 <= ids.min() <= ids.max() <= MOST_ID:
            raise FrameError(f"ids are {ids.min()} to {ids.max()}, expected 0 to {MOST_ID}")
        ids = np.ascontiguousarray(ids.reshape(images.shape), np.uint32)
    from_ns, to_ns = nanoseconds(from_ns, "from_ns"), nanoseconds(to_ns, "to_ns")
    if isinstance(poses, PoseRecorder):
        poses = poses.spanning(min(from_ns, to_ns), max(from_ns, to_ns))
    elif not isinstance(poses, Poses):
        raise ArgumentError(f"poses are a {type(poses).__name__}, expected esaac.Poses or esaac.PoseRecorder")
    lens = Intrinsics.of(intrinsics)
    if lens is None:
        raise ArgumentError("intrinsics are None, expected Intrinsics or (fx, fy, cx, cy)")
    return _native.flow(lens.told(), poses, images, ids, from_ns, to_ns).reshape(*depth.shape, 2)
