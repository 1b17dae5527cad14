"""Cameras: one (`EventCamera`), several of different sensors (`Rig`), many alike (`TiledEventCamera`)."""

import dataclasses
import itertools
import json
import numbers
import warnings
import zlib
from collections.abc import Iterable

import numpy as np

from esaac._native import Engine, SensorModel
from esaac.attributes import KnownAttributes
from esaac.checks import bins_of, index_of, indices_of, listed, nanoseconds, whole_number
from esaac.errors import (
    ArgumentError,
    FrameError,
    InputWarning,
    LightWarning,
    PoseWarning,
    SynthesisWarning,
)
from esaac.poses import Intrinsics, PoseRecorder, Poses

# A saved state: these eight bytes, of which the last is the version; length and CRC-32 of the header; the header, as
# JSON; the banks' states, which have checksums of their own.
_MAGIC = b"ESAACPY5"
_BEGIN = len(_MAGIC) + 8 + 4

# The engine's kinds of warnings.
_WARNINGS = {
    "poses": PoseWarning,
    "synthesis": SynthesisWarning,
    "input": InputWarning,
    "light": LightWarning,
    "flicker": LightWarning,
}


@dataclasses.dataclass(frozen=True)
class ApsFrame:
    """A grayscale (or mosaic) frame: `pixels` u16 `[row, column]` of `bits` significant bits, ended at `t_ns`."""

    t_ns: int
    bits: int
    pixels: np.ndarray


class _Cameras(KnownAttributes):
    """Methods of every kind of camera."""

    def __init__(self, sensors, lenses, device, packets, packet_ring, tiled):
        lenses = [lens and lens.told() for lens in lenses]
        self._engine = Engine(sensors, lenses, device, packets, packet_ring, tiled)

    def close(self):
        """Frees device memory. A second call does nothing; any other call raises `ClosedError`."""
        self._engine.close()

    @property
    def closed(self):
        return self._engine.closed

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    @property
    def device(self):
        """Name, kind, UUID and driver of the device."""
        return self._engine.device

    def memory(self):
        """Memory in use: a list of `{camera, purpose, bytes, on_host}`; `camera` is None for what all share."""
        return self._engine.memory()

    def _step_together(self, frame, t_ns, poses, stream, submits=False):
        if not isinstance(t_ns, list):
            t_ns = nanoseconds(t_ns)
        _check_poses(poses)
        if not isinstance(poses, PoseRecorder):
            packet = self._engine.step_tiles(frame, t_ns, poses, stream, submits)
            if not submits:
                self._warn(4)
            return packet
        last = self._engine.last_ns
        times = list(t_ns) if isinstance(t_ns, list) else [t_ns] * len(last)
        stepped = [(t, before) for t, before in zip(times, last) if t is not None]
        given = poses.spanning(*_span(*zip(*stepped))) if stepped else None
        packet = self._engine.step_tiles(frame, times, given, stream, submits)
        if not submits:
            self._warn(4)
        # Cameras that wait need what came after their last frame.
        needed = [t if t is not None else before for t, before in zip(times, last)]
        known = [t for t in needed if t is not None]
        if known:
            poses.forget_before(min(known))
        return packet

    def _warn(self, stacklevel):
        """Says what the last step has found out, each kind of it once for all cameras."""
        told = {}
        for kind, camera, text in self._engine.new_warnings():
            told.setdefault(kind, []).append((camera, text))
        for kind, [(camera, text), *others] in told.items():
            more = f" (and {len(others)} others)" if others else ""
            warnings.warn(f"camera {camera}{more}: {text}", _WARNINGS[kind], stacklevel=stacklevel)

    @property
    def pose_warnings(self):
        return self._engine.pose_warnings()

    @property
    def light(self):
        return self._engine.light()

    @property
    def light_warnings(self):
        return self._engine.light_warnings()

    def _last_packet(self):
        packets = self._engine.last
        return packets[0] if packets else None

    def save(self):
        """The state that the next step depends on, as bytes for `restore`."""
        parts = self._engine.save()
        banks = parts.pop("banks")
        header = json.dumps({**parts, "banks": [len(bank) for bank in banks]}).encode()
        length, checksum = len(header).to_bytes(8, "little"), zlib.crc32(header).to_bytes(4, "little")
        return b"".join([_MAGIC, length, checksum, header, *banks])

    def restore(self, state):
        """Continues from a state that cameras with the same sensors have saved."""
        header, rest = _checked_header(state)
        try:
            header = json.loads(bytes(header))
            lengths = header["banks"]
            ends = [sum(lengths[:bank]) for bank in range(len(lengths) + 1)]
            formats = [tuple(plane and tuple(plane) for plane in planes) for planes in header["formats"]]
            times, left_out = (header["last_ns"], header["first_ns"]), header["left_out"]
        except (ValueError, KeyError, TypeError) as error:
            raise ArgumentError(f"saved state that cannot be read: {error!r}") from error
        if len(rest) != ends[-1]:
            raise ArgumentError(f"saved state has {len(rest)} bytes of rigs, expected {ends[-1]}")
        banks = [bytes(rest[begin:end]) for begin, end in itertools.pairwise(ends)]
        self._engine.restore(formats, times, left_out, banks)

    def _all_aps(self):
        return [None if frame is None else ApsFrame(*frame) for frame in self._engine.aps()]


def _checked_header(state):
    """The header of a saved state, whose checksum is right, and what is behind it."""
    try:
        state = memoryview(state).cast("B")
    except TypeError:
        raise ArgumentError(f"saved state is a {type(state).__name__}, expected bytes") from None
    magic = bytes(state[: len(_MAGIC)])
    if len(state) < _BEGIN or magic[:-1] != _MAGIC[:-1]:
        raise ArgumentError("this is no saved state of cameras")
    if magic != _MAGIC:
        raise ArgumentError(f"saved state of format {magic!r}, expected {_MAGIC!r}")
    end = _BEGIN + int.from_bytes(state[len(_MAGIC) : _BEGIN - 4], "little")
    header = state[_BEGIN:end]
    checksum, expected = zlib.crc32(header), int.from_bytes(state[_BEGIN - 4 : _BEGIN], "little")
    if checksum != expected:
        raise ArgumentError(
            f"saved state is damaged: its header's CRC-32 is {checksum:08x}, expected {expected:08x}"
        )
    return header, state[end:]


def _check_poses(poses):
    if not (poses is None or isinstance(poses, (Poses, PoseRecorder))):
        raise ArgumentError(f"poses are a {type(poses).__name__}, expected esaac.Poses or esaac.PoseRecorder")


def _poses_of_each(poses):
    """Poses of each camera of a rig, as a list."""
    if isinstance(poses, (Poses, PoseRecorder)) or not isinstance(poses, Iterable):
        raise ArgumentError(
            f"poses are a {type(poses).__name__}, expected a list with esaac.Poses, esaac.PoseRecorder or None for "
            "each camera"
        )
    return list(poses)


def _span(times_ns, last_ns):
    """From the earliest frame before to the latest of these."""
    return min(t if last is None else last for t, last in zip(times_ns, last_ns)), max(times_ns)


def _lenses(intrinsics):
    """A lens of each camera of a rig."""
    expected = "expected a list with Intrinsics, (fx, fy, cx, cy) or None for each camera"
    if isinstance(intrinsics, Intrinsics) or not isinstance(intrinsics, Iterable):
        raise ArgumentError(f"intrinsics are a {type(intrinsics).__name__}, {expected}")
    intrinsics = list(intrinsics)
    if any(isinstance(lens, numbers.Number) for lens in intrinsics):
        raise ArgumentError(f"intrinsics are {intrinsics}, {expected}")
    return [Intrinsics.of(lens) for lens in intrinsics]


def _images(frame, camera):
    """Colour, motion, depth and ids of a camera's frame; None if it waits."""
    if frame is None:
        return None
    if not isinstance(frame, (tuple, list)):
        return (frame, None, None, None)
    if not 1 <= len(frame) <= 4:
        raise FrameError(
            f"the frame of camera {camera} has {len(frame)} entries, expected 1 to 4: hdr, motion, depth, ids"
        )
    return (*frame, None, None, None)[:4]


class EventCamera(_Cameras):
    """One event camera. See `__init__.pyi`."""

    _CHANGE = "camera.sensor = camera.sensor.replace({name}=...)"

    def __init__(
        self,
        sensor=None,
        *,
        profile=None,
        intrinsics=None,
        device=None,
        packets="host",
        packet_ring=None,
        **parameters,
    ):
        sensor, lens = SensorModel(sensor, profile=profile, **parameters), Intrinsics.of(intrinsics)
        super().__init__([sensor], [lens], device, packets, packet_ring, tiled=False)

    def step(self, hdr, motion=None, *, t_ns, depth=None, ids=None, poses=None, stream=None):
        return self._step_together((hdr, motion, depth, ids), t_ns, poses, stream)

    def submit(self, hdr, motion=None, *, t_ns, depth=None, ids=None, poses=None, stream=None):
        self._step_together((hdr, motion, depth, ids), t_ns, poses, stream, submits=True)

    def packet(self):
        packet = self._engine.packet()
        self._warn(3)
        return packet

    @property
    def synthesis(self):
        return self._engine.syntheses[0]

    @property
    def last_packet(self):
        return self._last_packet()

    @property
    def sensor(self):
        return self._engine.sensors[0]

    @sensor.setter
    def sensor(self, sensor):
        self._engine.set_sensor(0, sensor)

    def reset(self):
        self._engine.reset([0])

    def event_frame(self):
        return self._engine.form(None)[0]

    def voxel_grid(self, bins=5):
        return self._engine.form(bins_of(bins))[0]

    def event_ids(self):
        return self._engine.event_ids()[0]

    @property
    def aps(self):
        frames = self._all_aps()
        return frames[0] if frames else None

    @property
    def statistics(self):
        cameras, shared = self._engine.statistics()
        return {**(cameras[0] if cameras else {}), **shared}


class _Several(_Cameras):
    """Methods of cameras that step together."""

    def __init__(self, sensors, lenses, device, packets, packet_ring, tiled):
        super().__init__(sensors, lenses, device, packets, packet_ring, tiled)
        self._count = len(sensors)

    def __len__(self):
        return self._count

    def _reset(self, chosen, what):
        every = range(self._count)
        self._engine.reset(list(every) if chosen is None else indices_of(chosen, self._count, what))

    @property
    def aps(self):
        return self._all_aps()

    @property
    def statistics(self):
        cameras, shared = self._engine.statistics()
        return {"cameras": cameras, **shared}


class Rig(_Several):
    """Cameras of different sensors that step together. See `__init__.pyi`."""

    _CHANGE = "rig.set_sensor(camera, rig.sensors[camera].replace({name}=...))"

    def __init__(self, sensors, *, intrinsics=None, device=None, packets="host", packet_ring=None):
        if isinstance(sensors, (str, SensorModel)):
            raise ArgumentError(f"sensors is a {type(sensors).__name__}, expected a list of sensors")
        sensors = [SensorModel(sensor) for sensor in sensors]
        lenses = [None] * len(sensors) if intrinsics is None else _lenses(intrinsics)
        super().__init__(sensors, lenses, device, packets, packet_ring, tiled=False)

    def step(self, frames, t_ns, *, poses=None, stream=None):
        return self._step_each(frames, t_ns, poses, stream)

    def submit(self, frames, t_ns, *, poses=None, stream=None):
        self._step_each(frames, t_ns, poses, stream, submits=True)

    def packets(self):
        packets = self._engine.packets()
        self._warn(3)
        return packets

    def _step_each(self, frames, t_ns, poses, stream, submits=False):
        given = [_images(frame, index) for index, frame in enumerate(frames)]
        times = listed(t_ns)
        if isinstance(times, list):
            times = [None if t is None else nanoseconds(t) for t in times]
        else:
            times = [nanoseconds(times)] * len(given)
        times = [None if frame is None else t for frame, t in zip(given, times)] + times[len(given) :]
        given = [None if t is None else frame for frame, t in zip(given, times)] + given[len(times) :]
        poses = [None] * self._count if poses is None else _poses_of_each(poses)
        for each in poses:
            _check_poses(each)
        recorders = [
            (index, each)
            for index, (each, t) in enumerate(zip(poses, times))
            if isinstance(each, PoseRecorder) and t is not None
        ]
        last = self._engine.last_ns if recorders else None
        spanning = [None if isinstance(each, PoseRecorder) else each for each in poses]
        for index, recorder in recorders:
            spanning[index] = recorder.spanning(*_span(times[index : index + 1], last[index : index + 1]))
        packets = self._engine.step(given, times, spanning, stream, submits)
        if not submits:
            self._warn(4)
        for index, recorder in recorders:
            recorder.forget_before(times[index])
        return packets

    @property
    def syntheses(self):
        return self._engine.syntheses

    @property
    def last_packets(self):
        return self._engine.last

    @property
    def sensors(self):
        return self._engine.sensors

    def set_sensor(self, camera, sensor):
        self._engine.set_sensor(index_of(camera, self._count, "camera"), sensor)

    def reset(self, cameras=None):
        self._reset(cameras, "camera")

    def event_frames(self):
        return self._engine.form(None)

    def voxel_grids(self, bins=5):
        return self._engine.form(bins_of(bins))

    def event_ids(self):
        return self._engine.event_ids()


class TiledEventCamera(_Several):
    """Many cameras alike, one for each environment. See `__init__.pyi`."""

    _CHANGE = "cameras.set_sensor(env, cameras.sensors[env].replace({name}=...))"

    def __init__(
        self,
        sensor=None,
        num_envs=1,
        *,
        profile=None,
        intrinsics=None,
        device=None,
        packets="host",
        packet_ring=None,
        **parameters,
    ):
        num_envs = whole_number(num_envs, 1, 65536, "num_envs")
        sensor, lens = SensorModel(sensor, profile=profile, **parameters), Intrinsics.of(intrinsics)
        super().__init__([sensor] * num_envs, [lens] * num_envs, device, packets, packet_ring, tiled=True)

    def step(self, hdr, motion=None, *, t_ns, depth=None, ids=None, poses=None, stream=None):
        return self._step_together((hdr, motion, depth, ids), listed(t_ns), poses, stream)

    def submit(self, hdr, motion=None, *, t_ns, depth=None, ids=None, poses=None, stream=None):
        self._step_together((hdr, motion, depth, ids), listed(t_ns), poses, stream, submits=True)

    def packet(self):
        packet = self._engine.packet()
        self._warn(3)
        return packet

    @property
    def synthesis(self):
        return self._engine.syntheses[0]

    @property
    def last_packet(self):
        return self._last_packet()

    @property
    def sensor(self):
        return self._engine.sensors[0]

    @property
    def sensors(self):
        return self._engine.sensors

    def set_sensor(self, env, sensor):
        self._engine.set_sensor(index_of(env, self._count, "environment"), sensor)

    def reset(self, envs=None):
        self._reset(envs, "environment")

    def event_frames(self):
        return self._engine.form(None)[0]

    def voxel_grids(self, bins=5):
        return self._engine.form(bins_of(bins))[0]

    def event_ids(self):
        return self._engine.event_ids()[0]
