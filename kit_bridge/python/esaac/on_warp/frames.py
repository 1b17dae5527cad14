"""Which worlds have a frame when, and the step that takes their cameras there."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import warp as wp

from esaac.errors import PoseWarning

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from esaac import Packet, Poses, TiledEventCamera
    from esaac.on_warp.substeps import Asked, Bodies, Mounts, SubstepLog

_NEVER = -1


class Images(Protocol):
    """What is drawn of all worlds: Warp arrays `(worlds, height, width)`, `colour` with three channels."""

    colour: Any
    depth: Any
    ids: Any


class Frames:
    """The substep of each world's last frame. Worlds that are not stepped wait, and keep theirs.

    `held_counts` says how many frames each world has missed because its poses were not finite.
    """

    def __init__(self, events: TiledEventCamera, log: SubstepLog, bodies: Bodies) -> None:
        self._events, self._log, self._bodies = events, log, bodies
        self._last = np.full(len(events), _NEVER, np.int64)
        self.held_counts = np.zeros(len(events), np.int64)
        self._begun = False

    def reset(self, worlds: NDArray[np.bool_]) -> None:
        """The next frame of these worlds is the first of an episode."""
        if worlds.any():
            self._events.reset(np.flatnonzero(worlds))
            self._last[worlds] = _NEVER

    def drawn_at(self, now: int) -> NDArray[np.bool_]:
        """Worlds that have had their frame at this substep."""
        return self._last == now

    @property
    def last(self) -> NDArray[np.int64]:
        """The substep of each world's last frame; that of a world without one is below 0."""
        return self._last.copy()

    def ask(self, stepped: NDArray[np.bool_], now: int, state: Any, others: Sequence[Any] = ()) -> Asked:
        """Sends for what `poses` of these worlds reads, and for other Warp arrays; see `SubstepLog.ask`."""
        return self._log.ask(self._first(stepped, now), now, state, others)

    def poses(
        self,
        stepped: NDArray[np.bool_],
        now: int,
        state: Any,
        mounts: Mounts,
        asked: Asked | None = None,
    ) -> Poses:
        """Of all substeps since the last frames of these worlds. A first frame needs its own alone."""
        return self._log.poses(self._first(stepped, now), now, state, self._bodies, mounts, asked)

    def hold(self, stepped: NDArray[np.bool_], now: int, poses: Poses) -> NDArray[np.bool_]:
        """Those of these worlds that have a pose which is not finite since their last frames, as a simulation that
        diverges has. They are to miss this frame. They begin anew: their next frame is the first."""
        held = np.zeros(len(stepped), np.bool_)
        # The very first frame is needed of every world, and the error names the pose.
        if not self._begun or (np.isfinite(poses.camera).all() and np.isfinite(poses.bodies).all()):
            return held
        finite = np.isfinite(poses.camera).all(axis=2) & np.isfinite(poses.bodies).all(axis=(2, 3))
        steps = np.arange(now + 1 - len(poses), now + 1)
        needed = steps[:, None] >= np.where(self._last == _NEVER, now, self._last)
        held = stepped & (needed & ~finite).any(axis=0)
        self.reset(held & (self._last != _NEVER))
        if held.any() and not self.held_counts.any():
            first, others = np.flatnonzero(held)[0], held.sum() - 1
            more = f" (and {others} others)" if others else ""
            warnings.warn(
                f"world {first}{more}: poses are not finite. Until they are, it has no frame; then it begins anew",
                PoseWarning,
                stacklevel=4,
            )
        self.held_counts[held] += 1
        return held

    def _first(self, stepped: NDArray[np.bool_], now: int) -> int:
        return int(np.where(self._last == _NEVER, now, self._last)[stepped].min(initial=now))

    def step(
        self, stepped: NDArray[np.bool_], now: int, images: Images, poses: Poses, colour: Any = None
    ) -> Packet:
        """Events of these worlds, whose frame at this substep is drawn."""
        packet = self._events.step(
            images.colour if colour is None else colour,
            t_ns=times_of(stepped, self._log.time_ns(now)),
            depth=images.depth,
            ids=images.ids,
            poses=poses,
            stream=stream_of(images.depth.device),
        )
        self._last[stepped], self._begun = now, True
        return packet


def times_of(stepped: NDArray[np.bool_], t_ns: int) -> int | list[int | None]:
    """What `TiledEventCamera.step` takes as the time where some environments wait."""
    return t_ns if stepped.all() else [t_ns if one else None for one in stepped]


def stream_of(device: Any) -> int | None:
    """The stream in which Warp draws; None on the host."""
    return int(wp.get_stream(device).cuda_stream) if device.is_cuda else None
