"""What Newton's tiled camera draws for event cameras: averaged colour, depth and ids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import newton.sensors
import numpy as np
import warp as wp

from esaac.checks import UNKNOWN, whole_number
from esaac.errors import ArgumentError
from esaac.newton.bodies import WorldBodies
from esaac.poses import Intrinsics

if TYPE_CHECKING:
    from numpy.typing import NDArray

_MISS = wp.constant(wp.uint32(0xFFFFFFFF))
"""Newton's shape of a ray that hits nothing."""

_UNKNOWN = wp.constant(wp.uint32(UNKNOWN))


@wp.kernel(enable_backward=False)
def _gather(
    rays: wp.array4d(dtype=wp.vec3f),
    shapes: wp.array4d(dtype=wp.uint32),
    depths: wp.array4d(dtype=wp.float32),
    shape_ids: wp.array(dtype=wp.uint32),
    background: wp.vec3f,
    per_pixel: int,
    first_of_colour: int,
    centre: int,
    colour: wp.array4d(dtype=wp.float32),
    depth: wp.array3d(dtype=wp.float32),
    ids: wp.array3d(dtype=wp.uint32),
):
    world, y, x = wp.tid()
    sum = wp.vec3f(0.0)
    for k in range(first_of_colour, per_pixel):
        ray = x * per_pixel + k
        # Newton draws black where a ray hits nothing.
        if shapes[world, 0, y, ray] == _MISS:
            sum += background
        else:
            sum += rays[world, 0, y, ray]
    sum = sum / float(per_pixel - first_of_colour)
    for channel in range(3):
        colour[world, y, x, channel] = sum[channel]
    shape = shapes[world, 0, y, x * per_pixel + centre]
    if shape == _MISS:
        depth[world, y, x] = 0.0
        ids[world, y, x] = wp.uint32(0)
    else:
        depth[world, y, x] = depths[world, 0, y, x * per_pixel + centre]
        if shape < wp.uint32(shape_ids.shape[0]):
            ids[world, y, x] = shape_ids[int(shape)]
        else:
            ids[world, y, x] = _UNKNOWN


class View:
    """A camera in each world of a model, and its images.

    Newton casts one ray a pixel, so an edge moves by whole pixels. Here each pixel has `antialiasing` times
    `antialiasing` rays, whose colours are averaged, and one through its middle, for depth and id.

    `colour` `(worlds, height, width, 3)`, float32 and linear, `depth` `(worlds, height, width)`, float32, metres
    along the optical axis (0: no hit), and `ids` `(worlds, height, width)`, uint32, are Warp arrays on the model's
    device.
    """

    colour: Any
    depth: Any
    ids: Any

    def __init__(
        self,
        model: Any,
        bodies: WorldBodies,
        lens: Intrinsics | Sequence[float],
        width: int,
        height: int,
        *,
        antialiasing: int = 3,
        background: Sequence[float] = (0.5, 0.5, 0.5),
    ) -> None:
        lens = _lens(lens)
        if lens.projection != "pinhole":
            raise ArgumentError(f"projection is `{lens.projection}`, expected `pinhole`: Newton's rays are")
        antialiasing = whole_number(antialiasing, 1, 8, "antialiasing")
        offsets, self._first_of_colour, self._centre = _pattern(antialiasing)
        self._per_pixel = len(offsets)
        self._model, self._shape_ids = model, bodies.shape_ids
        self._background = wp.vec3f(*map(float, background))
        device, worlds = model.device, model.world_count
        self._rays = wp.array(_rays(lens, width, height, offsets), dtype=wp.vec3f, device=device)
        drawn = (worlds, 1, height, width * self._per_pixel)
        self._colours = wp.zeros(drawn, dtype=wp.vec3f, device=device)
        self._depths = wp.zeros(drawn, dtype=wp.float32, device=device)
        self._shapes = wp.zeros(drawn, dtype=wp.uint32, device=device)
        self.colour = wp.zeros((worlds, height, width, 3), dtype=wp.float32, device=device)
        self.depth = wp.zeros((worlds, height, width), dtype=wp.float32, device=device)
        self.ids = wp.zeros((worlds, height, width), dtype=wp.uint32, device=device)

    def draw(self, sensor: Any, state: Any, cameras: Any, colour: Any = None) -> None:
        """Draws a state as cameras `(1, worlds)` see it, into `colour` or `self.colour`, `self.depth` and `self.ids`.

        `sensor` is a `newton.sensors.SensorCamera` or `SensorTiledCamera`. The model's BVH must fit the state. It
        only launches kernels, so a CUDA graph may capture it."""
        worlds, height, width = self.depth.shape
        images = {
            "hdr_color_image": self._colours,
            "forward_depth_image": self._depths,
            "shape_index_image": self._shapes,
        }
        rays = self._rays
        if _has_views(sensor):
            # A view a world, without an axis for more cameras; and an axis for more rays a pixel.
            across = width * self._per_pixel
            images = {name: image.reshape((worlds, height, across)) for name, image in images.items()}
            cameras, rays = cameras.reshape((worlds,)), rays.reshape((height, across, 1, 2))
        sensor.update(state, cameras, rays, **images)
        wp.launch(
            _gather,
            (worlds, height, width),
            [self._colours, self._shapes, self._depths, self._shape_ids, self._background, self._per_pixel]
            + [self._first_of_colour, self._centre, self.colour if colour is None else colour]
            + [self.depth, self.ids],
            device=self._model.device,
        )


def _has_views(sensor: Any) -> bool:
    """Of Newton's two cameras, whether it is the one that came with 1.7."""
    kind = getattr(newton.sensors, "SensorCamera", None)
    return kind is not None and isinstance(sensor, kind)


def _lens(given: Intrinsics | Sequence[float]) -> Intrinsics:
    lens = Intrinsics.of(given)
    if lens is None:
        raise ArgumentError(f"intrinsics are {given}, expected Intrinsics or (fx, fy, cx, cy)")
    return lens


def _pattern(antialiasing: int) -> tuple[NDArray[np.float64], int, int]:
    """Places of rays in a pixel `(rays, 2)`; the first that counts for colour; the one in the middle."""
    along = (np.arange(antialiasing) + 0.5) / antialiasing - 0.5
    grid = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    if antialiasing % 2:
        return grid, 0, len(grid) // 2
    return np.concatenate([np.zeros((1, 2)), grid]), 1, 0


def _rays(lens: Intrinsics, width: int, height: int, offsets: NDArray[np.float64]) -> NDArray[np.float32]:
    """Starts and directions `(1, height, width * rays, 2, 3)`, the rays of a pixel side by side."""
    _, fx, fy, cx, cy = lens.told()
    x = (np.arange(width)[:, None] + offsets[:, 0] - cx) / fx
    y = (np.arange(height)[:, None] + offsets[:, 1] - cy) / fy
    rays = np.zeros((1, height, width, len(offsets), 2, 3), np.float64)
    rays[0, ..., 1, 0], rays[0, ..., 1, 1], rays[0, ..., 1, 2] = x[None], -y[:, None], -1
    rays[..., 1, :] /= np.linalg.norm(rays[..., 1, :], axis=-1, keepdims=True)
    return rays.reshape(1, height, width * len(offsets), 2, 3).astype(np.float32)
