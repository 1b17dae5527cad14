"""Where cameras are: on bodies, or in the world."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from esaac.poses import MARGIN

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


class Mounts:
    """Where each world's camera sits: on a body (or -1, the world), at a place in its axes.

    `places` are those of the present. With `before` and `since` each camera was at the place `before` at substep
    `since`, and has moved from there at a steady speed."""

    def __init__(
        self,
        bodies: ArrayLike,
        places: ArrayLike,
        before: ArrayLike | None = None,
        since: ArrayLike | None = None,
    ) -> None:
        self._bodies = np.asarray(bodies, np.int64)
        self._places = np.array(places, np.float64).reshape(len(self._bodies), 7)
        self._before = self._places if before is None else np.asarray(before, np.float64)
        self._since = np.asarray(np.zeros(len(self._bodies)) if since is None else since, np.int64)

    def poses(self, steps: NDArray[np.int64], states: NDArray[Any]) -> NDArray[np.float64]:
        """Cameras `(steps, cameras, 7)` of bodies `(steps, bodies, 7)` at these substeps, of which the last is the
        present."""
        cameras = np.repeat(self._places[None], len(states), axis=0)
        moved = (self._before != self._places).any(axis=1) & (self._since < steps[-1])
        if moved.any():
            since = self._since[moved]
            ago = np.maximum(steps[:, None] - since, -MARGIN)
            share = ago / (steps[-1] - since)
            cameras[:, moved] = _between(self._before[moved], self._places[moved], share[..., None])
        on = self._bodies >= 0
        if on.any():
            cameras[:, on] = _product(states[:, self._bodies[on]].astype(np.float64), cameras[:, on])
        return cameras


def _between(a, b, share):
    """Transforms on the way from `a` (share 0) to `b` (1) at a steady speed, and beyond, by the shorter turn."""
    place = a[..., :3] + share * (b[..., :3] - a[..., :3])
    start, end = (turns / np.linalg.norm(turns, axis=-1, keepdims=True) for turns in (a[..., 3:], b[..., 3:]))
    cosine = np.sum(start * end, axis=-1, keepdims=True)
    end, cosine = np.where(cosine < 0, -end, end), np.abs(cosine)
    # The part of the end that is across the start, and the angle between both in the space of quaternions.
    across = end - cosine * start
    sine = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.arctan2(sine, cosine)
    unit = np.divide(across, sine, out=np.zeros_like(across), where=sine > 0)
    turn = np.cos(share * angle) * start + np.sin(share * angle) * unit
    return np.concatenate([place, turn], axis=-1)


def _product(a, b):
    """Transforms `x y z, qx qy qz qw`, one after the other: first b, then a."""
    u, w = a[..., 3:6], a[..., 6:]
    v, s = b[..., 3:6], b[..., 6:]
    turn = lambda p: p + 2 * np.cross(u, np.cross(u, p) + w * p)
    axis = w * v + s * u + np.cross(u, np.broadcast_to(v, np.broadcast_shapes(u.shape, v.shape)))
    angle = w * s - np.sum(u * v, axis=-1, keepdims=True)
    place = a[..., :3] + turn(np.broadcast_to(b[..., :3], u.shape))
    return np.concatenate([place, axis, angle], axis=-1)
