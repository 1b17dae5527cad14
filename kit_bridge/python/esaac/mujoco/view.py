"""What MuJoCo's renderer draws for an event camera: averaged colour, depth and ids."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from esaac import ArgumentError
from esaac.checks import UNKNOWN
from esaac.srgb import linear_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

_GEOM, _SITE = int(mujoco.mjtObj.mjOBJ_GEOM), int(mujoco.mjtObj.mjOBJ_SITE)

_LINEAR = linear_of(np.arange(256) / 255).astype(np.float32)
"""Of a byte of sRGB."""


class View:
    """A fixed camera of a model, and its last images.

    The renderer's image is `antialiasing` times as wide and high. Its colours are averaged; depth and ids are those
    of the ray through a pixel's middle.
    """

    colour: NDArray[np.float32]
    depth: NDArray[np.float32]
    ids: NDArray[np.uint32]

    def __init__(
        self, model: Any, camera: int, width: int, height: int, antialiasing: int, option: Any
    ) -> None:
        if antialiasing not in (1, 3, 5, 7):
            raise ArgumentError(f"antialiasing is {antialiasing}, expected 1, 3, 5 or 7")
        self._model, self._camera, self._times, self._option = model, camera, antialiasing, option
        self._renderer = _renderer(model, width * antialiasing, height * antialiasing)

    def draw(self, data: Any) -> None:
        """Draws a state, whose kinematics are done."""
        renderer = self._renderer
        renderer.update_scene(data, self._camera, self._option)
        self.colour = _averaged(renderer.render(), self._times)
        middles = slice(self._times // 2, None, self._times)
        renderer.enable_segmentation_rendering()
        seen = renderer.render()[middles, middles]
        renderer.enable_depth_rendering()
        depth = renderer.render()[middles, middles]
        renderer.disable_depth_rendering()
        self.ids = self._bodies(seen[..., 0], seen[..., 1])
        # What no geometry covers is infinitely far away.
        self.depth = np.where(seen[..., 0] < 0, 0, depth).astype(np.float32)

    def close(self) -> None:
        self._renderer.close()

    def _bodies(self, number: NDArray[np.int32], kind: NDArray[np.int32]) -> NDArray[np.uint32]:
        """Of each pixel's object the body that it is part of. The world is body 0; tendons, skins and flexes have no
        body."""
        ids = np.where(number < 0, 0, UNKNOWN).astype(np.uint32)
        for of, bodies in ((_GEOM, self._model.geom_bodyid), (_SITE, self._model.site_bodyid)):
            seen = (kind == of) & (number >= 0)
            ids[seen] = bodies[number[seen]]
        return ids


def _renderer(model: Any, width: int, height: int) -> Any:
    """A renderer of this size, whatever size the model asks for."""
    buffer = model.vis.global_
    kept = buffer.offwidth, buffer.offheight
    buffer.offwidth, buffer.offheight = max(kept[0], width), max(kept[1], height)
    try:
        return mujoco.Renderer(model, height, width)
    finally:
        buffer.offwidth, buffer.offheight = kept


def _averaged(image: NDArray[np.uint8], times: int) -> NDArray[np.float32]:
    height, width = image.shape[0] // times, image.shape[1] // times
    linear = _LINEAR[image].reshape(height, times, width, times, 3)
    return np.ascontiguousarray(linear.mean(axis=(1, 3), dtype=np.float32))
