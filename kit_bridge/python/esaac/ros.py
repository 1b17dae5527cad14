"""Publishes event cameras on ROS 2, on machines with ROS 2 and without. An embedded Cyclone DDS sends; `record`
writes an MCAP file like rosbag2's. See `ros.pyi`."""

import dataclasses
import json
import os

import numpy as np

from esaac._native import RosPublisher, SensorModel, check_ros_names
from esaac.checks import check_depth, ids_column, nanoseconds, on_host
from esaac.errors import ArgumentError, FrameError, RosError

__all__ = ["Camera", "Frame", "Imu", "Instance", "Publisher", "RosError", "check_names"]

check_names = check_ros_names


@dataclasses.dataclass(frozen=True)
class Camera:
    """A camera to be published, and which of its topics."""

    name: str
    sensor: SensorModel
    focal_px: object = None
    centre_px: object = None
    rgb: bool = False
    depth: bool = False
    imu: bool = False
    frame_id: object = None
    event_ids: bool = False

    def __post_init__(self):
        if isinstance(self.sensor, str):
            object.__setattr__(self, "sensor", SensorModel(self.sensor))
        if isinstance(self.focal_px, (int, float)):
            object.__setattr__(self, "focal_px", (self.focal_px, self.focal_px))


@dataclasses.dataclass(frozen=True)
class Imu:
    """A sample of an IMU: x forward, y left, z up."""

    t_ns: int
    angular_rate_rad_s: tuple
    specific_force_m_s2: tuple


@dataclasses.dataclass(frozen=True)
class Frame:
    """A camera's data at one time."""

    packet: object = None
    aps: object = None
    rgb: object = None
    depth: object = None
    imu: tuple = ()
    ids: object = None


@dataclasses.dataclass(frozen=True)
class Instance:
    """A thing that events show."""

    name: str
    labels: dict = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class _Options:
    namespace: str
    node: str
    events: str
    lossless: bool
    sim_time: bool
    qos: list
    slice_ns: int
    max_bytes: int
    network: bool
    domain: object
    interface: object
    record: object


@dataclasses.dataclass(frozen=True)
class _Events:
    x: np.ndarray
    y: np.ndarray
    t_offset_ns: np.ndarray
    p: np.ndarray
    base_ns: int
    watermark_ns: int
    sequence: int
    dropped: int
    width: int
    height: int
    host_copies: int


@dataclasses.dataclass(frozen=True)
class _Part:
    camera: int
    events: object
    ids: object
    aps: object
    rgb: object
    depth: object
    imu: list


class Publisher:
    """Publishes cameras."""

    __slots__ = ("__weakref__", "_numbers", "_publisher")

    def __init__(
        self,
        cameras,
        *,
        namespace="/esaac",
        node="esaac",
        events="packed",
        policy=None,
        time="sim",
        qos=None,
        slice_ns=0,
        max_bytes=0,
        network=True,
        domain=None,
        interface=None,
        record=None,
    ):
        if policy not in (None, "latest", "lossless"):
            raise ArgumentError(f"policy is `{policy}`, expected latest or lossless")
        if time not in ("sim", "wall"):
            raise ArgumentError(f"time is `{time}`, expected sim or wall")
        if isinstance(cameras, (str, Camera)):
            raise ArgumentError(f"cameras is a {type(cameras).__name__}, expected a list of ros.Camera")
        cameras = list(cameras)
        for camera in cameras:
            if not isinstance(camera, Camera):
                raise ArgumentError(f"a camera is a {type(camera).__name__}, expected a ros.Camera")
        if record is not None and not os.fspath(record).endswith(".mcap"):
            raise ArgumentError(f"record is `{os.fspath(record)}`, expected a name that ends in .mcap")
        self._numbers = {camera.name: number for number, camera in enumerate(cameras)}
        self._publisher = RosPublisher(
            cameras,
            _Options(
                namespace=namespace,
                node=node,
                events=events,
                # A recording must be complete, so publishing waits for it.
                lossless=policy == "lossless" or (policy is None and record is not None),
                sim_time=time == "sim",
                qos=list((qos or {}).items()),
                slice_ns=slice_ns,
                max_bytes=max_bytes,
                network=network,
                domain=domain,
                interface=interface,
                record=None if record is None else os.fspath(record),
            ),
        )

    @property
    def topics(self):
        return dict(self._publisher.topics)

    def publish(self, t_ns, frames):
        self._publisher.publish(
            nanoseconds(t_ns), [self._part(name, frame) for name, frame in frames.items()]
        )

    def set_sensor(self, name, sensor):
        self._publisher.set_sensor(self._number(name), sensor)

    def set_instances(self, name, instances):
        told = []
        for number, instance in instances.items():
            if isinstance(instance, str):
                instance = Instance(instance)
            if not isinstance(instance, Instance):
                raise ArgumentError(
                    f"instance {number} of `{name}` is a {type(instance).__name__}, expected a ros.Instance or a name"
                )
            told.append((int(number), instance.name, _labels(number, instance.labels)))
        self._publisher.set_instances(self._number(name), told)

    def set_status(self, name, values=None, warnings=()):
        if isinstance(warnings, str):
            raise TypeError(f"warnings is the text {warnings!r}, expected a list of texts")
        values = [(str(key), str(value)) for key, value in (values or {}).items()]
        self._publisher.set_status(self._number(name), values, [str(warning) for warning in warnings])

    def restart(self):
        self._publisher.restart()

    def notices(self):
        return self._publisher.notices()

    def summary(self):
        return json.loads(self._publisher.summary())

    def close(self):
        told = self._publisher.close()
        return None if told is None else json.loads(told)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def _number(self, name):
        if name not in self._numbers:
            raise ArgumentError(f"no camera `{name}`, expected one of {', '.join(self._numbers)}")
        return self._numbers[name]

    def _part(self, name, frame):
        if not isinstance(frame, Frame):
            raise ArgumentError(f"the frame of `{name}` is a {type(frame).__name__}, expected a ros.Frame")
        aps = frame.aps
        if aps is not None:
            aps = dataclasses.replace(aps, pixels=np.ascontiguousarray(aps.pixels, np.uint16))
        return _Part(
            camera=self._number(name),
            events=None if frame.packet is None else _events(frame.packet),
            ids=None if frame.ids is None else _ids(frame, name),
            aps=aps,
            rgb=None if frame.rgb is None else _image_of_colour(on_host(frame.rgb), f"rgb of `{name}`"),
            depth=None
            if frame.depth is None
            else _image_of_depth(on_host(frame.depth), f"depth of `{name}`"),
            imu=_samples(frame.imu, name),
        )


def _events(packet):
    if packet.offsets is not None:
        raise ArgumentError("this packet is of several cameras; publish packet[i], one a camera")
    offsets = packet.t_offset_ns
    if offsets is None:
        offsets = _offsets(on_host(packet.t_ns), packet.base_ns)
    # Mapped packets are where the device wrote them; others have been copied once.
    mapped = isinstance(packet.x, np.ndarray) and not packet.x.flags.writeable
    place = lambda column: np.ascontiguousarray(on_host(column)).view(np.uint16)
    return _Events(
        x=place(packet.x),
        y=place(packet.y),
        t_offset_ns=np.ascontiguousarray(offsets),
        p=np.ascontiguousarray(on_host(packet.p)),
        base_ns=packet.base_ns,
        watermark_ns=packet.watermark_ns,
        sequence=packet.sequence,
        dropped=packet.dropped,
        width=packet.width,
        height=packet.height,
        host_copies=0 if mapped else 1,
    )


def _ids(frame, name):
    """Ids of a frame's events, where they are if that is the host."""
    if frame.packet is None:
        raise ArgumentError(
            f"ids of `{name}` are given without a packet, expected the packet of their events"
        )
    return ids_column(on_host(frame.ids), len(frame.packet), f"ids of `{name}`")


def _labels(number, labels):
    """Pairs of kind and label; a kind may have several."""
    pairs = []
    for kind, several in labels.items():
        if isinstance(several, str):
            raise ArgumentError(
                f"labels `{kind}` of instance {number} is the text {several!r}, expected a list of texts"
            )
        pairs += [(kind, label) for label in several]
    return pairs


def _offsets(t_ns, base_ns):
    """Times after `base_ns`, as a message has them."""
    offsets, most = t_ns - base_ns, np.iinfo(np.uint32).max
    if len(offsets) and not 0 <= offsets.min() <= offsets.max() <= most:
        raise ArgumentError(
            f"events are {offsets.min()} to {offsets.max()} ns after the packet's base_ns, expected 0 to {most}"
        )
    return offsets.astype(np.uint32)


def _image_of_colour(rgb, name):
    """The first three channels; `name` is the image's name in errors."""
    if rgb.dtype != np.uint8:
        raise FrameError(f"{name} has dtype {rgb.dtype}, expected uint8")
    if rgb.ndim != 3 or rgb.shape[-1] not in (3, 4):
        raise FrameError(f"{name} has shape {list(rgb.shape)}, expected (height, width, 3 or 4)")
    return np.ascontiguousarray(rgb[..., :3])


def _image_of_depth(depth, name):
    check_depth(depth, name)
    if depth.ndim == 3 and depth.shape[-1] == 1:
        depth = depth[..., 0]
    if depth.ndim != 2:
        raise FrameError(f"{name} has shape {list(depth.shape)}, expected (height, width)")
    return np.ascontiguousarray(depth)


def _samples(imu, name):
    """Times, angular rates and specific forces of a camera's samples."""
    if isinstance(imu, Imu):
        raise ArgumentError(f"imu of `{name}` is a ros.Imu, expected a list of them")
    samples = []
    for sample in imu:
        if not isinstance(sample, Imu):
            raise ArgumentError(f"a sample of `{name}` is a {type(sample).__name__}, expected a ros.Imu")
        rate, force = (
            _vector(getattr(sample, part), f"{part} of `{name}`")
            for part in ("angular_rate_rad_s", "specific_force_m_s2")
        )
        samples.append((nanoseconds(sample.t_ns), rate, force))
    return samples


def _vector(given, name):
    try:
        vector = np.asarray(on_host(given), np.float64)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name} is {given!r}, expected three numbers") from error
    if vector.shape != (3,):
        raise ArgumentError(f"{name} has shape {list(vector.shape)}, expected [3]: x, y, z")
    return vector.tolist()
