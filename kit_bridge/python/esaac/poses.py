"""Lenses, poses and their recorder: what synthesis `rigid` knows besides images. See `__init__.pyi`."""

import collections
import dataclasses

import numpy as np

from esaac._native import POSE_NEIGHBOURS
from esaac.checks import MOST_ID, nanoseconds, on_host
from esaac.errors import ArgumentError, FrameError
from esaac.matrices import poses_of

# Camera axes of the engine (x right, y up, looking along -z) in those of each convention: quaternions x y z w.
_AXES = {
    "usd": (0.0, 0.0, 0.0, 1.0),
    "opengl": (0.0, 0.0, 0.0, 1.0),
    "ros": (1.0, 0.0, 0.0, 0.0),
    "opencv": (1.0, 0.0, 0.0, 0.0),
    "world": (0.5, -0.5, -0.5, 0.5),
}
_ORDERS = {"xyzw": (0, 1, 2, 3, 4, 5, 6), "wxyz": (0, 1, 2, 4, 5, 6, 3)}

# Samples beyond either end of an interval that the poses within depend on.
MARGIN = POSE_NEIGHBOURS


@dataclasses.dataclass(frozen=True)
class Intrinsics:
    """A lens without distortion. See `__init__.pyi`."""

    fx: float
    fy: float
    cx: float
    cy: float
    projection: str = "pinhole"
    half_pixel_centres: bool = False

    @classmethod
    def from_matrix(cls, matrix, *, projection="pinhole", half_pixel_centres=False):
        k = on_host(matrix).astype(np.float64)
        if k.shape != (3, 3):
            raise ArgumentError(f"the matrix has shape {k.shape}, expected (3, 3)")
        if k[0, 1] or k[1, 0] or (k[2] != (0, 0, 1)).any():
            raise ArgumentError(f"the matrix is {k.tolist()}, expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        return cls(*map(float, (k[0, 0], k[1, 1], k[0, 2], k[1, 2])), projection, half_pixel_centres)

    @classmethod
    def of(cls, given):
        """What a caller gives for a lens: one, or fx, fy, cx, cy of a pinhole."""
        if given is None or isinstance(given, cls):
            return given
        try:
            fx, fy, cx, cy = map(float, given)
        except (TypeError, ValueError) as error:
            raise ArgumentError(
                f"intrinsics are {given!r}, expected Intrinsics or (fx, fy, cx, cy)"
            ) from error
        return cls(fx, fy, cx, cy)

    def told(self):
        """As the engine counts: the first pixel's centre is at 0."""
        shift = 0.5 if self.half_pixel_centres else 0.0
        return (self.projection, self.fx, self.fy, self.cx - shift, self.cy - shift)

    def ray_lengths(self, width, height):
        if self.projection == "fisheye":
            return np.ones((height, width), np.float32)
        _, fx, fy, cx, cy = self.told()
        across, down = (np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy
        return np.sqrt(1 + across**2 + down[:, None] ** 2).astype(np.float32)


class Poses:
    """Where the camera and the bodies are at some times. See `__init__.pyi`.

    `camera` is `[steps, cameras, 7]` and `bodies` `[steps, environments, bodies, 7]`, float64, in the engine's axes
    with the quaternion's scalar last. `tables` are pairs of arrays: ids, and the body that each is.
    """

    __slots__ = ("__weakref__", "bodies", "camera", "tables", "times_ns")

    def __init__(self, times_ns, camera, bodies=None, *, ids=None, order="xyzw", axes="usd"):
        self.times_ns = _times(times_ns)
        steps = len(self.times_ns)
        camera = _numbers(camera, "camera", "(steps, 7) or (steps, cameras, 7)", steps, (2, 3))
        bodies = np.zeros((steps, 0, 7)) if bodies is None else bodies
        expected = "(steps, bodies, 7) or (steps, environments, bodies, 7)"
        bodies = _numbers(bodies, "bodies", expected, steps, (3, 4))
        camera = _turned(_ordered(camera, order), axes)
        self.camera = camera[:, None] if camera.ndim == 2 else camera
        bodies = _ordered(bodies, order)
        self.bodies = np.ascontiguousarray(bodies[:, None] if bodies.ndim == 3 else bodies)
        self.tables = _tables(ids, self.bodies.shape[2])

    @classmethod
    def from_matrices(cls, times_ns, camera, bodies=None, *, ids=None, axes="opengl"):
        camera = poses_of(on_host(camera), "camera")
        bodies = None if bodies is None else poses_of(on_host(bodies), "bodies")
        return cls(times_ns, camera, bodies, ids=ids, axes=axes)

    def __len__(self):
        return len(self.times_ns)

    def __repr__(self):
        cameras, (environments, bodies) = self.camera.shape[1], self.bodies.shape[1:3]
        span = f"{self.times_ns[0]} to {self.times_ns[-1]} ns"
        return f"<esaac.Poses {len(self)} of {cameras} cameras, {environments} x {bodies} bodies, {span}>"


class PoseRecorder:
    """Keeps the poses of physics steps until the frames that need them have been stepped. See `__init__.pyi`."""

    __slots__ = ("__weakref__", "_samples", "axes", "ids", "order", "tolerance_ns")

    def __init__(self, *, ids=None, order="xyzw", axes="usd", limit=1024, tolerance_ns=1000):
        if limit < 2 * MARGIN + 1:
            raise ArgumentError(f"limit is {limit}, expected at least {2 * MARGIN + 1}")
        self.ids, self.order, self.axes, self.tolerance_ns = ids, order, axes, tolerance_ns
        self._samples = collections.deque(maxlen=limit)

    def __len__(self):
        return len(self._samples)

    def record(self, t_ns, camera, bodies=None):
        sample = _Sample(nanoseconds(t_ns), _kept(camera), None if bodies is None else _kept(bodies))
        if self._samples:
            before = self._samples[-1]
            if sample.t_ns <= before.t_ns:
                expected = f"expected a time after {before.t_ns} ns; call clear() when time is set back"
                raise FrameError(f"poses at {sample.t_ns} ns, {expected}")
            if not sample.goes_on(before):
                raise FrameError(
                    f"poses have shapes {sample.shapes}, expected {before.shapes} as before; bodies may become more"
                )
        self._samples.append(sample)

    def spanning(self, from_ns, to_ns):
        if not self._samples:
            raise FrameError(f"no poses are recorded, expected them to span {from_ns} to {to_ns} ns")
        samples = list(self._samples)
        times = np.array([sample.t_ns for sample in samples], np.int64)
        # Clocks of floats are a few nanoseconds off a frame's time.
        for end_ns, at in ((from_ns, 0), (to_ns, -1)):
            outside = times[0] - end_ns if at == 0 else end_ns - times[-1]
            if 0 < outside <= self.tolerance_ns and (len(times) > 1 or from_ns == to_ns):
                times[at] = end_ns
        if not times[0] <= from_ns <= to_ns <= times[-1]:
            raise FrameError(
                f"poses are recorded from {times[0]} to {times[-1]} ns, expected them to span {from_ns} to {to_ns} ns"
            )
        first = max(int(np.searchsorted(times, from_ns, "right")) - 1 - MARGIN, 0)
        last = int(np.searchsorted(times, to_ns, "left")) + MARGIN
        chosen = samples[first : last + 1]
        _bring([sample for sample in chosen if not sample.on_host])
        bodies = None if chosen[-1].bodies is None else _bodies([sample.bodies for sample in chosen])
        camera = np.stack([sample.camera for sample in chosen])
        return Poses(times[first : last + 1], camera, bodies, ids=self.ids, order=self.order, axes=self.axes)

    def forget_before(self, t_ns):
        dropped = sum(sample.t_ns <= t_ns for sample in self._samples) - 1 - MARGIN
        for _ in range(dropped):
            self._samples.popleft()

    def forget_from(self, t_ns):
        while self._samples and self._samples[-1].t_ns >= t_ns:
            self._samples.pop()

    def clear(self):
        self._samples.clear()


class _Sample:
    """Poses at a time: copies of the simulator's arrays, where they were."""

    def __init__(self, t_ns, camera, bodies):
        self.t_ns, self.camera, self.bodies = t_ns, camera, bodies

    @property
    def shapes(self):
        return tuple(None if part is None else tuple(part.shape) for part in (self.camera, self.bodies))

    def goes_on(self, before):
        """Whether it has the shapes of a sample before, or more bodies."""
        (camera, bodies), (camera_before, before) = self.shapes, before.shapes
        if before is None:
            return camera == camera_before
        more = bodies is not None and len(bodies) == len(before) and bodies[-2] >= before[-2]
        return camera == camera_before and more and bodies[:-2] == before[:-2]

    @property
    def on_host(self):
        return isinstance(self.camera, np.ndarray) and (
            self.bodies is None or isinstance(self.bodies, np.ndarray)
        )


def _bodies(samples):
    """Bodies of all samples as one array. Before a body's first sample it is where it is then."""
    filled = [samples[-1]]
    for bodies in reversed(samples[:-1]):
        known = 0 if bodies is None else bodies.shape[-2]
        later = filled[-1][..., known:, :]
        filled.append(later if bodies is None else np.concatenate([bodies, later], axis=-2))
    return np.stack(filled[::-1])


def _bring(samples):
    """Copies samples to the host: torch's with one copy for all, others' one by one."""
    for part in ("camera", "bodies"):
        arrays = [getattr(sample, part) for sample in samples]
        there = [
            i for i, array in enumerate(arrays) if array is not None and not isinstance(array, np.ndarray)
        ]
        if there and hasattr(arrays[there[0]], "new_empty"):
            import torch

            copies = torch.stack([arrays[i] for i in there]).cpu().numpy()
        else:
            copies = [on_host(arrays[i]) for i in there]
        for i, copy in zip(there, copies):
            setattr(samples[i], part, copy)


def _kept(array):
    """A copy where the array is: the simulator writes to its own again. It is brought to the host later."""
    if _on_device(array):
        for name in ("clone", "copy"):
            if hasattr(array, name):
                return getattr(array, name)()
        import warp

        return warp.clone(array)
    return np.array(on_host(array))


def _on_device(array):
    if isinstance(array, np.ndarray):
        return False
    device = getattr(array, "device", None)
    return device is not None and "cuda" in str(device).lower()


def _times(times_ns):
    times = on_host(times_ns)
    if times.ndim != 1 or len(times) == 0 or times.dtype.kind not in "iu":
        raise FrameError(
            f"times_ns has shape {times.shape} and dtype {times.dtype}, expected (steps,) and int64, nanoseconds"
        )
    most = np.iinfo(np.int64).max
    if times.max() > most:
        raise FrameError(f"times_ns has {times.max()} ns, expected at most {most}")
    # A copy of its own.
    return np.array(times, np.int64)


def _numbers(array, name, expected, steps, axes):
    numbers = on_host(array)
    if numbers.dtype.kind not in "fiu":
        raise FrameError(f"poses: {name} has dtype {numbers.dtype}, expected float32 or float64")
    if numbers.ndim not in axes or numbers.shape[-1] != 7 or len(numbers) != steps:
        raise FrameError(
            f"poses: {name} has shape {numbers.shape}, expected {expected} with the {steps} steps of times_ns"
        )
    # A copy of its own.
    return np.array(numbers, np.float64, order="C")


def _ordered(poses, order):
    if order not in _ORDERS:
        raise ArgumentError(f"order is `{order}`, expected one of {', '.join(_ORDERS)}")
    # Picking columns costs more than all else here.
    return poses if order == "xyzw" else np.ascontiguousarray(poses[..., _ORDERS[order]])


def _turned(poses, axes):
    if axes not in _AXES:
        raise ArgumentError(f"axes are `{axes}`, expected one of {', '.join(_AXES)}")
    x, y, z, w = _AXES[axes]
    if w == 1:
        return poses
    a, b, c, d = np.moveaxis(poses[..., 3:], -1, 0)
    poses[..., 3:] = np.stack(
        [
            a * w + d * x + b * z - c * y,
            b * w + d * y + c * x - a * z,
            c * w + d * z + a * y - b * x,
            d * w - a * x - b * y - c * z,
        ],
        axis=-1,
    )
    return poses


def _tables(ids, bodies):
    if ids is None:
        return [(np.arange(1, bodies + 1, dtype=np.uint32), np.arange(bodies, dtype=np.int64))]
    several = isinstance(ids, (list, tuple)) and len(ids) > 0 and not np.isscalar(ids[0])
    if not several and not isinstance(ids, dict):
        ids = on_host(ids)
        several = ids.ndim == 2
    return [_table(each) for each in ids] if several else [_table(ids)]


def _table(ids):
    if isinstance(ids, dict):
        keys, values = list(ids), [-1 if body is None else body for body in ids.values()]
    else:
        values = on_host(ids)
        keys = np.arange(values.size)
    keys, values = np.asarray(keys), np.asarray(values)
    if values.ndim != 1 or (values.size and (values.dtype.kind not in "iu" or keys.dtype.kind not in "iu")):
        raise FrameError(
            f"poses: a table of ids has shape {values.shape} and dtype {values.dtype}, expected a number of a body "
            "for each id: a dict, or an array"
        )
    below = values < -1
    if below.any():
        raise FrameError(
            f"poses: id {keys[below][0]} is body {values[below][0]}, expected one from 0, or -1 for the static world"
        )
    wrong = (keys < 0) | (keys > MOST_ID)
    if wrong.any():
        raise FrameError(f"poses: id {keys[wrong][0]}, expected 0 to {MOST_ID}")
    return keys.astype(np.uint32), values.astype(np.int64)
