"""Poses of all bodies at every physics substep, kept on the device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from esaac.errors import FrameError
from esaac.poses import Poses

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from esaac.newton.bodies import WorldBodies


@wp.kernel(enable_backward=False)
def _keep(
    body_q: wp.array(dtype=wp.transformf),
    count: wp.array(dtype=wp.int64),
    log: wp.array2d(dtype=wp.transformf),
):
    body = wp.tid()
    log[int(count[0] % wp.int64(log.shape[0])), body] = body_q[body]


@wp.kernel(enable_backward=False)
def _advance(count: wp.array(dtype=wp.int64)):
    count[0] = count[0] + wp.int64(1)


class SubstepLog:
    """The last `limit` states of a `newton.Model` that substeps of `substep_s` seconds began with, on its device.

    State k is that after k substeps, so the present one is not in it.
    """

    # Samples before an interval, from which the velocity at its start comes.
    MARGIN = 2

    def __init__(self, model: Any, substep_s: float, limit: int = 256) -> None:
        self._model, self._substep_s, self._limit = model, substep_s, limit
        # A row of one body more keeps the arrays from being empty.
        self._log = wp.zeros((limit, model.body_count + 1), dtype=wp.transformf, device=model.device)
        self._count = wp.zeros(1, dtype=wp.int64, device=model.device)

    def record(self, state: Any) -> None:
        """Keeps a state that a substep begins with. It only launches kernels, so a CUDA graph may capture it."""
        if self._model.body_count:
            inputs = [state.body_q, self._count, self._log]
            wp.launch(_keep, self._model.body_count, inputs, device=self._model.device)
        wp.launch(_advance, 1, [self._count], device=self._model.device)

    def substeps(self) -> int:
        """How many there have been."""
        return int(self._count.numpy()[0])

    def time_ns(self, substep: int) -> int:
        """When a substep ends, by the number that there have been; 0 is the start."""
        # Of the whole number, so that rounding does not add up.
        return round(substep * self._substep_s * 1e9)

    def since(self, first: int, now: int, state: Any) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Bodies at substeps `first - MARGIN` (or 0) to `now`: numbers of the substeps, and `(steps, bodies, 7)`.

        `state` is the present one. More than `limit` substeps raise `esaac.FrameError`."""
        if now - first > self._limit:
            raise FrameError(
                f"{now - first} substeps since the last frame, expected at most {self._limit}: "
                "let the camera see more frames, or make limit= larger"
            )
        # A Python number: Warp takes no other in a slice.
        start = int(max(first - self.MARGIN, now - self._limit, 0))
        steps = np.arange(start, now + 1)
        parts = [self._rows(a, b) for a, b in _runs(start, now, self._limit)]
        present = state.body_q.numpy() if self._model.body_count else np.zeros((0, 7), np.float32)
        return steps, np.concatenate([*parts, present[None]])

    def poses(self, first: int, now: int, state: Any, bodies: WorldBodies, mounts: Mounts) -> Poses:
        """What `step` needs for frames at substep `now` whose last ones were at `first` or later."""
        steps, states = self.since(first, now, state)
        times_ns = np.array([self.time_ns(step) for step in steps], np.int64)
        return Poses(times_ns, mounts.poses(states), bodies.arranged(states))

    def _rows(self, start: int, end: int) -> Any:
        return self._log[start:end].numpy()[:, : self._model.body_count]


def _runs(start: int, end: int, limit: int) -> list[tuple[int, int]]:
    """Slots of substeps `start` to `end - 1` in a ring, in at most two runs."""
    if start == end:
        return []
    a, b = start % limit, (end - 1) % limit + 1
    return [(a, b)] if a < b else [(a, limit), (0, b)]


class Mounts:
    """Where each world's camera sits: on a body (or -1, the world), at a place in its axes."""

    def __init__(self, bodies: ArrayLike, places: ArrayLike) -> None:
        self._bodies = np.asarray(bodies, np.int64)
        self._places = np.array(places, np.float64).reshape(len(self._bodies), 7)

    def poses(self, states: NDArray[Any]) -> NDArray[np.float64]:
        """Cameras `(steps, cameras, 7)` of bodies `(steps, bodies, 7)`."""
        cameras = np.repeat(self._places[None], len(states), axis=0)
        on = self._bodies >= 0
        if on.any():
            cameras[:, on] = _product(states[:, self._bodies[on]].astype(np.float64), self._places[on])
        return cameras


def _product(a, b):
    """Transforms `x y z, qx qy qz qw`, one after the other: first b, then a."""
    u, w = a[..., 3:6], a[..., 6:]
    v, s = b[..., 3:6], b[..., 6:]
    turn = lambda p: p + 2 * np.cross(u, np.cross(u, p) + w * p)
    axis = w * v + s * u + np.cross(u, np.broadcast_to(v, np.broadcast_shapes(u.shape, v.shape)))
    angle = w * s - np.sum(u * v, axis=-1, keepdims=True)
    place = a[..., :3] + turn(np.broadcast_to(b[..., :3], u.shape))
    return np.concatenate([place, axis, angle], axis=-1)
