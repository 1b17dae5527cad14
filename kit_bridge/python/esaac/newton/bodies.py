"""Which body of a world is which: ids of pixels, and poses of bodies in their order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

if TYPE_CHECKING:
    from numpy.typing import NDArray

_STILL = np.array([0, 0, 0, 0, 0, 0, 1], np.float64)


class WorldBodies:
    """Numbers the bodies of each world of a `newton.Model`, from 0. Those of no world are in each of them, after its
    own.

    `shape_ids` is a Warp array on the model's device: of each shape the id of its body, 0 if it is static.
    """

    shape_ids: Any

    def __init__(self, model: Any) -> None:
        world_of = model.body_world.numpy() if model.body_count else np.zeros(0, np.int32)
        shared = np.flatnonzero(world_of < 0)
        own = [np.flatnonzero(world_of == world) for world in range(model.world_count)]
        most = max((len(bodies) for bodies in own), default=0)
        self._of_world = np.full((model.world_count, most + len(shared)), -1, np.int64)
        number = np.full(model.body_count, -1, np.int64)
        for world, bodies in enumerate(own):
            self._of_world[world, : len(bodies)] = bodies
            number[bodies] = np.arange(len(bodies))
        self._of_world[:, most:] = shared
        number[shared] = most + np.arange(len(shared))
        self._lacking = self._of_world < 0
        shape_body = model.shape_body.numpy() if model.shape_count else np.zeros(0, np.int32)
        # 0 is the static world, and what is in it has body -1.
        ids = np.array([0 if body < 0 else number[body] + 1 for body in shape_body], np.uint32)
        self.shape_ids = wp.array(ids, dtype=wp.uint32, device=model.device)

    def arranged(self, poses: NDArray[Any]) -> NDArray[Any]:
        """Poses `(steps, bodies of the model, 7)` as `(steps, worlds, bodies of a world, 7)`."""
        if self._of_world.size == 0:
            return np.zeros((len(poses), *self._of_world.shape, 7))
        arranged = poses[:, self._of_world]
        # A world may have fewer bodies than another.
        if self._lacking.any():
            arranged[:, self._lacking] = _STILL
        return arranged
