"""Still scenes that a neural renderer draws: Gaussian splats, radiance fields. Nothing but the camera moves.

Such a renderer gives colour and depth, and its camera's path is known. That is all that synthesis `rigid` needs.
Depth and poses must have one unit; it need not be metres.
"""

from __future__ import annotations

import json
import os
import pathlib
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
        their names.

        * `dataparser`: a trained model's `dataparser_transforms.json`. nerfstudio turns, moves and scales a scene
          before it trains, so a model that it trained is drawn with poses in those units.

        Raises `esaac.ArgumentError` for a lens with distortion, frames with lenses of their own and missing keys, and
        `esaac.FrameError` for poses that are not rigid. The message names the file.
        """
        path = pathlib.Path(path)
        path = path / "transforms.json" if path.is_dir() else path
        told = json.loads(path.read_text())
        frames = sorted(told.get("frames", []), key=lambda frame: frame["file_path"])
        if not frames:
            raise ArgumentError(f"{path} has no frames, expected at least one")
        lens = _lens(told, frames, path)
        matrices = np.array([_square(frame["transform_matrix"], path) for frame in frames])
        try:
            poses_of(matrices, "transform_matrix")
        except FrameError as error:
            raise FrameError(f"{path}: {error}") from error
        if dataparser is not None:
            matrices = _as_trained(matrices, told, pathlib.Path(dataparser))
        names = tuple(frame["file_path"] for frame in frames)
        return cls(lens, int(told["w"]), int(told["h"]), matrices, names)

    def __len__(self) -> int:
        return len(self.world_from_camera)

    def poses(self, times_ns: ArrayLike) -> Poses:
        """What `EventCamera.step` takes as `poses`. `times_ns`: when the camera is at each of them."""
        return Poses.from_matrices(times_ns, self.world_from_camera, axes="opengl")

    def views(self) -> NDArray[np.float64]:
        """Camera from world `(n, 4, 4)`, in OpenCV's axes: what gsplat takes as `viewmats`."""
        return view_of(self.world_from_camera)


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


def _lens(told: dict[str, Any], frames: list[dict[str, Any]], path: pathlib.Path) -> Intrinsics:
    for frame in frames:
        own = [name for name in (*LENS, *DISTORTION) if name in frame]
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
    projection = "pinhole" if model in PINHOLES else "fisheye"
    return Intrinsics(*(float(told[name]) for name in LENS[:4]), projection, half_pixel_centres=True)


def _square(rows: Any, path: pathlib.Path) -> NDArray[np.float64]:
    """4x4; some writers leave out the last row."""
    matrix = np.array(rows, np.float64)
    if matrix.shape not in ((3, 4), (4, 4)):
        raise ArgumentError(f"{path}: `transform_matrix` has shape {matrix.shape}, expected (4, 4)")
    return np.concatenate([matrix[:3], [[0, 0, 0, 1]]]) if len(matrix) == 3 else matrix


def _as_trained(
    matrices: NDArray[np.float64], told: dict[str, Any], path: pathlib.Path
) -> NDArray[np.float64]:
    """Poses in the units of a trained model. Its file begins at the reconstruction, before `applied_transform`."""
    trained = json.loads(path.read_text())
    turn = _square(trained["transform"], path)
    applied = _square(told.get("applied_transform", np.eye(4)), path)
    moved: NDArray[np.float64] = turn @ np.linalg.inv(applied) @ matrices
    moved[:, :3, 3] *= trained["scale"] / told.get("applied_scale", 1.0)
    return moved
