"""Poses of all bodies at every physics substep, kept on the device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import warp as wp

from esaac.errors import ArgumentError, FrameError
from esaac.poses import MARGIN, Poses

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Bodies(Protocol):
    """Which body of a world is which."""

    def arranged(self, poses: NDArray[Any]) -> NDArray[Any]:
        """Poses `(steps, bodies of the model, 7)` as `(steps, worlds, bodies of a world, 7)`."""


class Mounts(Protocol):
    """Where the cameras are."""

    def poses(self, steps: NDArray[np.int64], states: NDArray[Any]) -> NDArray[np.float64]:
        """Cameras `(steps, cameras, 7)` of bodies `(steps, bodies of the model, 7)` at these substeps."""


@wp.kernel(enable_backward=False)
def _keep(
    body_q: wp.array(dtype=wp.transformf),
    count: wp.array(dtype=wp.int64),
    log: wp.array2d(dtype=wp.transformf),
):
    body = wp.tid()
    log[int(count[0] % wp.int64(log.shape[0])), body] = body_q[body]


@wp.kernel(enable_backward=False)
def _latest(
    log: wp.array2d(dtype=wp.transformf),
    count: wp.array(dtype=wp.int64),
    rows: wp.array2d(dtype=wp.transformf),
):
    row, body = wp.tid()
    step = count[0] - wp.int64(rows.shape[0] - row)
    if step >= wp.int64(0):
        rows[row, body] = log[int(step % wp.int64(log.shape[0])), body]


@wp.kernel(enable_backward=False)
def _advance(count: wp.array(dtype=wp.int64)):
    count[0] = count[0] + wp.int64(1)


class SubstepLog:
    """The last `limit` states of a model that substeps of `substep_s` seconds began with, on its device.

    `model` is a `newton.Model`, or what has a `device`, a `body_count` and states with poses `body_q` like it.

    State k is that after k substeps, so the present one is not in it.
    """

    def __init__(
        self,
        model: Any,
        substep_s: float,
        limit: int = 256,
        advice: str = "let the camera see more frames, or make limit= larger",
        begun: int = 0,
    ) -> None:
        """`advice` says in errors what to do where there were more substeps. `begun` is how many substeps the clock
        has had before. A wrong `substep_s` or `limit` raises `esaac.ArgumentError`."""
        if not 0 < substep_s < np.inf:
            raise ArgumentError(f"substep_s is {substep_s}, expected seconds above 0")
        if limit < 1:
            raise ArgumentError(f"limit is {limit}, expected at least 1 substep")
        self._advice, self._begun = advice, begun
        self._model, self._substep_s, self._limit = model, substep_s, limit
        # A row of one body more keeps the arrays from being empty.
        self._log = wp.zeros((limit, model.body_count + 1), dtype=wp.transformf, device=model.device)
        self._count = wp.zeros(1, dtype=wp.int64, device=model.device)
        # What `ask` copies from and to. The sizes are the same from frame to frame, most often.
        self._asked_rows = self._log[:0]
        self._on_host: list[Any] = []

    @property
    def device(self) -> Any:
        """The model's."""
        return self._model.device

    def record(self, state: Any) -> None:
        """Keeps a state that a substep begins with. It only launches kernels, so a CUDA graph may capture it."""
        poses = self._poses_of(state)
        if self._model.body_count:
            inputs = [poses, self._count, self._log]
            wp.launch(_keep, self._model.body_count, inputs, device=self._model.device)
        wp.launch(_advance, 1, [self._count], device=self._model.device)

    def substeps(self) -> int:
        """How many there have been."""
        return int(self._count.numpy()[0])

    def time_ns(self, substep: int) -> int:
        """When a substep ends, by the number that there have been here; 0 is the start."""
        # Of the whole number, so that rounding does not add up.
        return round((self._begun + substep) * self._substep_s * 1e9)

    def since(self, first: int, now: int, state: Any) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Bodies at substeps `first - MARGIN` (or 0) to `now`: numbers of the substeps, and `(steps, bodies, 7)`.

        `state` is the present one. More than `limit` substeps raise `esaac.FrameError`."""
        if now - first > self._limit:
            raise FrameError(
                f"{now - first} substeps since the last frame, expected at most {self._limit}: {self._advice}"
            )
        start = self._start(first, now)
        steps = np.arange(start, now + 1)
        parts = [self._rows(a, b) for a, b in _runs(start, now, self._limit)]
        poses = self._poses_of(state)
        present = poses.numpy() if self._model.body_count else np.zeros((0, 7), np.float32)
        return steps, np.concatenate([*parts, present[None]])

    def ask(self, first: int, now: int, state: Any, others: Sequence[Any] = ()) -> Asked:
        """Sends for what `since` gives and for other Warp arrays, behind all that the device has been told to do so
        far, and does not wait for them.

        `now` is the number of substeps that is expected. The next call may overwrite what this one brings."""
        start = self._start(first, now)
        count = self._model.body_count
        rows = (max(now - start, 0), count + 1)
        if self._asked_rows.shape != rows:
            self._asked_rows = wp.empty(rows, dtype=wp.transformf, device=self._model.device)
        arrays = [self._count, *others]
        if count:
            inputs = [self._log, self._count, self._asked_rows]
            wp.launch(_latest, (rows[0], count), inputs, device=self._model.device)
            arrays += [self._asked_rows, self._poses_of(state)]
        if [(array.shape, array.dtype) for array in arrays] != [(a.shape, a.dtype) for a in self._on_host]:
            pinned = self._model.device.is_cuda
            self._on_host = [
                wp.empty(array.shape, dtype=array.dtype, device="cpu", pinned=pinned) for array in arrays
            ]
        for array, on_host in zip(arrays, self._on_host):
            wp.copy(on_host, array)
        there = wp.get_stream(self._model.device).record_event() if self._model.device.is_cuda else None
        return Asked(np.arange(start, now + 1), self._on_host, len(others), there)

    def poses(
        self,
        first: int,
        now: int,
        state: Any,
        bodies: Bodies,
        mounts: Mounts,
        asked: Asked | None = None,
    ) -> Poses:
        """What `step` needs for frames at substep `now` whose last ones were at `first` or later. `asked` spares the
        wait for the device, if it was sent for with the same numbers."""
        known = None if asked is None or now - first > self._limit else asked.since(self._start(first, now))
        steps, states = self.since(first, now, state) if known is None else known
        times_ns = np.array([self.time_ns(step) for step in steps], np.int64)
        # Of a world that has diverged they are not finite.
        with np.errstate(invalid="ignore", over="ignore"):
            cameras = mounts.poses(steps, states)
        return Poses(times_ns, cameras, bodies.arranged(states))

    def _poses_of(self, state: Any) -> Any:
        """A state's bodies, which must be those of the model."""
        count = 0 if state.body_q is None else len(state.body_q)
        if count != self._model.body_count:
            raise ArgumentError(
                f"the state has {count} bodies, expected {self._model.body_count}, those of the cameras' model"
            )
        return state.body_q

    def _start(self, first: int, now: int) -> int:
        # A Python number: Warp takes no other in a slice.
        return int(max(first - MARGIN, now - self._limit, 0))

    def _rows(self, start: int, end: int) -> Any:
        return self._log[start:end].numpy()[:, : self._model.body_count]


class Asked:
    """What `SubstepLog.ask` has sent for. Whatever is read of it waits until all is there."""

    def __init__(self, steps: NDArray[np.int64], arrays: list[Any], others: int, there: Any) -> None:
        self._steps, self._arrays, self._others, self._there = steps, arrays, others, there

    @property
    def now(self) -> int:
        """How many substeps there had been."""
        return int(self._read()[0][0])

    @property
    def others(self) -> list[NDArray[Any]]:
        """The other arrays."""
        return self._read()[1 : 1 + self._others]

    def since(self, start: int) -> tuple[NDArray[np.int64], NDArray[np.float32]] | None:
        """Numbers of the substeps from `start` on and the bodies then; None if others were asked for."""
        if self._steps[0] != start or self._steps[-1] != self.now:
            return None
        states = self._read()[1 + self._others :]
        if not states:
            return self._steps, np.zeros((len(self._steps), 0, 7), np.float32)
        rows, present = states
        return self._steps, np.concatenate([rows[:, : len(present)], present[None]])

    def _read(self) -> list[NDArray[Any]]:
        if self._there is not None:
            wp.synchronize_event(self._there)
            self._there = None
        return [array.numpy() for array in self._arrays]


def _runs(start: int, end: int, limit: int) -> list[tuple[int, int]]:
    """Slots of substeps `start` to `end - 1` in a ring, in at most two runs."""
    if start == end:
        return []
    a, b = start % limit, (end - 1) % limit + 1
    return [(a, b)] if a < b else [(a, limit), (0, b)]
