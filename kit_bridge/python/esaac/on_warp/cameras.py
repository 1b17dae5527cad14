"""An event camera in each world of a simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from esaac import ArgumentError, ClosedError, TiledEventCamera
from esaac.attributes import KnownAttributes
from esaac.checks import indices_of
from esaac.on_warp.frames import Frames, Images

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from esaac import Intrinsics, Packet, Poses, SensorModel
    from esaac.on_warp.substeps import Bodies, Mounts, SubstepLog


class WorldCameras(KnownAttributes):
    """The event cameras of all worlds. Classes that inherit from it draw `view`, record substeps and tell the poses.

    `events` is the `esaac.TiledEventCamera`, with `event_frames()`, `voxel_grids()` and `statistics`.
    """

    events: TiledEventCamera
    view: Images

    _OWN = ("events", "view")
    _CHANGE = "cameras.events.set_sensor(world, cameras.events.sensors[world].replace({name}=...))"

    def __init__(
        self,
        sensor: SensorModel | str | None,
        worlds: int,
        intrinsics: Intrinsics | Sequence[float],
        log: SubstepLog,
        bodies: Bodies,
        options: Mapping[str, Any],
    ) -> None:
        """`options` are more arguments of `esaac.TiledEventCamera`. On a GPU it has the log's device, and packets
        there, if they do not say otherwise."""
        device: dict[str, Any] = {}
        if log.device.is_cuda:
            device = {"device": str(log.device), "packets": "cuda"}
        self.events = TiledEventCamera(sensor, worlds, intrinsics=intrinsics, **{**device, **options})
        self._log = log
        self._frames = Frames(self.events, log, bodies)
        self._closed = False

    @property
    def held_counts(self) -> NDArray[np.int64]:
        """How many frames each world has missed because its poses were not finite."""
        return self._frames.held_counts.copy()

    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Lets worlds, given by their numbers or a mask, or all begin anew: their next frame is the first."""
        self._check_open()
        self._frames.reset(self._chosen(worlds))

    def close(self) -> None:
        """Frees the memory of the event cameras. A second call does nothing; any other call raises
        `esaac.ClosedError`."""
        self._closed = True
        self.events.close()

    def _check_open(self) -> None:
        if self._closed:
            raise ClosedError("the cameras are closed")

    def _step(
        self, state: Any, worlds: ArrayLike | None, mounts: Mounts, draw: Callable[[Poses], None]
    ) -> Packet:
        """Draws the present state, and steps these worlds."""
        self._check_open()
        now = self._log.substeps()
        stepped = self._chosen(worlds)
        late = stepped & self._frames.drawn_at(now)
        if late.any():
            raise ArgumentError(
                f"world {np.flatnonzero(late)[0]} has had its frame at substep {now}, expected record() in between"
            )
        poses = self._frames.poses(stepped, now, state, mounts)
        stepped &= ~self._frames.hold(stepped, now, poses)
        draw(poses)
        return self._frames.step(stepped, now, self.view, poses)

    def _chosen(self, worlds: ArrayLike | None) -> NDArray[np.bool_]:
        count = len(self.events)
        if worlds is None:
            return np.ones(count, np.bool_)
        chosen = np.zeros(count, np.bool_)
        chosen[indices_of(worlds, count, "world")] = True
        return chosen
