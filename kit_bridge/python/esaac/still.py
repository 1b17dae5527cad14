"""Still scenes that a neural renderer draws: Gaussian splats, radiance fields. Nothing but the camera moves.

Such a renderer gives colour and depth, and its camera's path is known. That is all that synthesis `rigid` needs.
Depth and poses must have one unit; it need not be metres.
"""

from __future__ import annotations

import json
import math
import os
import pathlib
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from esaac.errors import ArgumentError, FrameError
from esaac.matrices import poses_of
from esaac.poses import Intrinsics, Poses

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE")
DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
FISHEYE = "is_fisheye"
"""A key of instant-ngp's."""
LENS = ("fl_x", "fl_y", "cx", "cy", "w", "h", "camera_model")

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""From axes that look along -z with y up to those that look along z with y down, and back."""


@dataclass(frozen=True)
class CameraPath:
    """A lens, an image's size, and the camera's poses one after the other.

    `world_from_camera` is `(n, 4, 4)`, in OpenGL's axes: the camera looks along -z, x right, y up. `names` has a name
    for each.
    """

    lens: Intrinsics
    width: int
    height: int
    world_from_camera: NDArray[np.float64]
    names: tuple[str, ...]

    @classmethod
    def read(
        cls, path: str | os.PathLike[str], dataparser: str | os.PathLike[str] | None = None
    ) -> CameraPath:
        """Reads nerfstudio's `transforms.json`: the file, or the folder that it is in. Frames are in the order of
        their names, in which numbers count as such: `frame_10` follows `frame_9`.

        * `dataparser`: a trained model's `dataparser_transforms.json`. nerfstudio turns, moves and scales a scene
          before it trains, so a model that it trained is drawn with poses in those units.

        Raises `esaac.ArgumentError` for a lens with distortion, frames with lenses of their own, and keys that are
        missing or have something else, and `esaac.FrameError` for poses that are not rigid. The message names the
        file.
        """
        path = pathlib.Path(path)
        path = path / "transforms.json" if path.is_dir() else path
        told = _object(path)
        frames = sorted(_frames(told, path), key=lambda frame: _natural(frame["file_path"]))
        lens = _lens(told, frames, path)
        width, height = (_size_px(told, name, path) for name in ("w", "h"))
        matrices = np.array([_matrix_of(frame, path) for frame in frames])
        try:
            poses_of(matrices, "transform_matrix")
        except FrameError as error:
            raise FrameError(f"{path}: {error}") from error
        if dataparser is not None:
            matrices = _as_trained(matrices, told, path, pathlib.Path(dataparser))
        names = tuple(frame["file_path"] for frame in frames)
        return cls(lens, width, height, matrices, names)

    def __len__(self) -> int:
        return len(self.world_from_camera)

    def poses(self, times_ns: ArrayLike) -> Poses:
        """What `EventCamera.step` takes as `poses`. `times_ns`: when the camera is at each of them."""
        return Poses.from_matrices(times_ns, self.world_from_camera, axes="opengl")

    def views(self) -> NDArray[np.float64]:
        """Camera from world `(n, 4, 4)`, in OpenCV's axes: what gsplat takes as `viewmats`."""
        return view_of(self.world_from_camera)


def _natural(name: str) -> list[tuple[str, int, str]]:
    """Sort key under which `f10` follows `f9`: text and numbers in turn, as the command sorts frames."""
    parts = re.findall("([^0-9]*)([0-9]*)", name)
    # Numbers of any length: the one with more digits is larger.
    stripped = ((text, digits.lstrip("0")) for text, digits in parts if text or digits)
    return [(text, len(digits), digits) for text, digits in stripped]


def view_of(world_from_camera: ArrayLike) -> NDArray[np.float64]:
    """Camera from world in OpenCV's axes (along z, y down), of world from camera in OpenGL's (along -z, y up)."""
    view: NDArray[np.float64] = np.linalg.inv(np.asarray(world_from_camera, np.float64) @ _FLIP)
    return view


def visible_depth(
    depth: Any, *, opacity: Any = None, least_opacity: float = 0.5, rays_of: Intrinsics | None = None
) -> Any:
    """Depth for `EventCamera.step`, of the depth that a neural renderer gives: `(height, width)`, of NumPy or torch.

    * `opacity`: how much of each pixel is covered, 0 to 1. Where it is below `least_opacity` there is no surface, and
      depth becomes 0: a background at infinity.
    * `rays_of`: the lens, where depth is the distance from the camera's centre (nerfacto). Leave it out where depth
      is along the optical axis (gsplat, splatfacto).
    """
    if rays_of is not None:
        lengths = rays_of.ray_lengths(depth.shape[1], depth.shape[0])
        depth = depth / (depth.new_tensor(lengths) if hasattr(depth, "new_tensor") else lengths)
    if opacity is not None:
        there = opacity >= least_opacity
        # Not a product: where there is no surface, depth may be NaN.
        if hasattr(depth, "new_zeros"):
            depth = depth.where(there, depth.new_zeros(()))
        else:
            depth = np.where(there, depth, depth.dtype.type(0))
    return depth


def _object(path: pathlib.Path) -> dict[str, Any]:
    """What a file of JSON tells."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ArgumentError(f"{path} is no JSON: {error}") from error
    if not isinstance(told, dict):
        raise ArgumentError(f"{path} holds a {type(told).__name__}, expected an object")
    return told


def _frames(told: dict[str, Any], path: pathlib.Path) -> list[dict[str, Any]]:
    frames = told.get("frames", [])
    if not isinstance(frames, list):
        raise ArgumentError(f"{path}: `frames` is a {type(frames).__name__}, expected a list")
    if not frames:
        raise ArgumentError(f"{path} has no frames, expected at least one")
    for number, frame in enumerate(frames):
        if not isinstance(frame, dict):
            raise ArgumentError(
                f"{path}: frame {number} is a {type(frame).__name__}, expected an object with `file_path` and "
                "`transform_matrix`"
            )
        if not isinstance(frame.get("file_path"), str):
            actual = repr(frame["file_path"]) if "file_path" in frame else "missing"
            raise ArgumentError(f"{path}: `file_path` of frame {number} is {actual}, expected a text")
    return frames


def _lens(told: dict[str, Any], frames: list[dict[str, Any]], path: pathlib.Path) -> Intrinsics:
    for frame in frames:
        own = [name for name in (*LENS, *DISTORTION, FISHEYE) if name in frame]
        if own:
            raise ArgumentError(
                f"{path}: frame {frame['file_path']} has its own `{own[0]}`, expected one lens for all frames"
            )
    missing = [name for name in LENS[:6] if name not in told]
    if missing:
        raise ArgumentError(f"{path} has no `{missing[0]}`, expected {', '.join(LENS[:6])}")
    bent = [name for name in DISTORTION if told.get(name, 0) != 0]
    if bent:
        raise ArgumentError(
            f"{path}: the lens has distortion ({bent[0]} is {told[bent[0]]}), expected none: draw without it"
        )
    model = told.get("camera_model", "OPENCV")
    if model not in (*PINHOLES, "OPENCV_FISHEYE"):
        raise ArgumentError(f"{path}: `camera_model` is {model}, expected OPENCV, OPENCV_FISHEYE or PINHOLE")
    # instant-ngp draws such a lens as a pinhole where it has no distortion, in spite of the key.
    if told.get(FISHEYE) and model in PINHOLES:
        actual = told.get("camera_model", "missing")
        raise ArgumentError(
            f"{path}: `{FISHEYE}` is {told[FISHEYE]} and `camera_model` is {actual}, expected OPENCV_FISHEYE for "
            f"an equidistant fisheye, or no `{FISHEYE}` for a pinhole"
        )
    projection = "pinhole" if model in PINHOLES else "fisheye"
    return Intrinsics(*(_number(told, name, path) for name in LENS[:4]), projection, half_pixel_centres=True)


def _number(told: dict[str, Any], name: str, path: pathlib.Path) -> float:
    value = told[name]
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not math.isfinite(value):
        raise ArgumentError(f"{path}: `{name}` is {value!r}, expected a finite number")
    return float(value)


def _size_px(told: dict[str, Any], name: str, path: pathlib.Path) -> int:
    size = _number(told, name, path)
    if size < 1 or size != int(size):
        raise ArgumentError(
            f"{path}: `{name}` is {told[name]}, expected a whole number of pixels, at least 1"
        )
    return int(size)


def _matrix_of(frame: dict[str, Any], path: pathlib.Path) -> NDArray[np.float64]:
    if "transform_matrix" not in frame:
        raise ArgumentError(f"{path}: frame {frame['file_path']} has no `transform_matrix`, expected (4, 4)")
    return _square(frame["transform_matrix"], f"{path}: `transform_matrix` of frame {frame['file_path']}")


def _square(rows: Any, name: str) -> NDArray[np.float64]:
    """4x4; some writers leave out the last row. `name` is its name in errors."""
    try:
        matrix = np.array(rows, np.float64)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name} is {rows!r}, expected 4 rows of 4 numbers") from error
    if matrix.shape not in ((3, 4), (4, 4)):
        raise ArgumentError(f"{name} has shape {matrix.shape}, expected (4, 4)")
    return np.concatenate([matrix[:3], [[0, 0, 0, 1]]]) if len(matrix) == 3 else matrix


def _as_trained(
    matrices: NDArray[np.float64], told: dict[str, Any], source: pathlib.Path, path: pathlib.Path
) -> NDArray[np.float64]:
    """Poses in the units of a trained model. Its file begins at the reconstruction, before `applied_transform`, which
    `source` tells."""
    trained = _object(path)
    for name in ("transform", "scale"):
        if name not in trained:
            raise ArgumentError(f"{path} has no `{name}`, expected transform, scale")
    turn = _square(trained["transform"], f"{path}: `transform`")
    applied = _square(told.get("applied_transform", np.eye(4)), f"{source}: `applied_transform`")
    moved: NDArray[np.float64] = turn @ np.linalg.inv(applied) @ matrices
    applied_scale = _number({"applied_scale": 1.0, **told}, "applied_scale", source)
    moved[:, :3, 3] *= _number(trained, "scale", path) / applied_scale
    return moved
