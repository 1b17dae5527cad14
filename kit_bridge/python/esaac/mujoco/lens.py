"""Which camera of a MuJoCo model, and its lens."""

from __future__ import annotations

from typing import Any

import numpy as np

from esaac import ArgumentError, Intrinsics


def camera_number(model: Any, camera: str | int) -> int:
    """The number of a camera that is given by its name or number."""
    names = [model.camera(number).name for number in range(model.ncam)]
    if isinstance(camera, str):
        if camera not in names:
            raise ArgumentError(f"camera is `{camera}`, expected one of {', '.join(names) or 'none'}")
        return names.index(camera)
    if not 0 <= camera < model.ncam:
        raise ArgumentError(f"camera is {camera}, expected 0 to {model.ncam - 1}")
    return int(camera)


def lens_of(model: Any, camera: int, width: int, height: int, *, cropped: bool = False) -> Intrinsics:
    """A fixed camera's pinhole. Where its sensor and the image have other aspect ratios, MuJoCo stretches the image;
    with `cropped` only the part of the sensor with the image's aspect ratio is seen, as `mujoco_warp` has it."""
    if _orthographic(model, camera):
        raise ArgumentError(f"camera {camera} is orthographic, expected a perspective one")
    across_m, down_m = (float(value) for value in model.cam_sensorsize[camera])
    if across_m > 0 and down_m > 0:
        if cropped:
            across_m, down_m = min(across_m, down_m * width / height), min(down_m, across_m * height / width)
        fx_m, fy_m, right_m, up_m = (float(value) for value in model.cam_intrinsic[camera])
        # The sensor's middle is off the axis, so the axis is off the image's middle to the other side.
        cx, cy = (0.5 - right_m / across_m) * width, (0.5 - up_m / down_m) * height
        fx, fy = fx_m / across_m * width, fy_m / down_m * height
        return Intrinsics(fx, fy, cx, cy, half_pixel_centres=True)
    focal_px = float(height / 2 / np.tan(np.radians(model.cam_fovy[camera]) / 2))
    return Intrinsics(focal_px, focal_px, width / 2, height / 2, half_pixel_centres=True)


def _orthographic(model: Any, camera: int) -> bool:
    # Its name has changed.
    flags = getattr(model, "cam_projection", None)
    return bool((model.cam_orthographic if flags is None else flags)[camera])
