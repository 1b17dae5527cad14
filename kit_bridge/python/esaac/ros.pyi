"""Publishes event cameras on ROS 2, on machines with ROS 2 and without.

    from esaac import ros

    with ros.Publisher([ros.Camera("davis", camera.sensor, focal_px=300.0, rgb=True)]) as publisher:
        publisher.publish(t_ns, {"davis": ros.Frame(packet, aps=camera.aps, rgb=image)})

Topics, messages, stamps and quality of service are those of `esaac demo`. Each camera has, below `/NAMESPACE/NAME`,
`events`, `sensor`, `imu`, the images `aps/image_raw`, `image_raw` and `depth/image_raw` with their `camera_info`, and
`event_ids` and `instances`, which say what each event shows.
All share `/clock`, `/tf_static` and `/diagnostics`. An embedded Cyclone DDS sends. `ROS_DOMAIN_ID`,
`ROS_LOCALHOST_ONLY`, `ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_DISTRO` and `CYCLONEDDS_URI` work as in ROS.

Sending happens on a thread of its own, without the interpreter's lock.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Literal, Union

from esaac import ApsFrame, Packet, SensorModel
from esaac import RosError as RosError

def check_names(topic: str, frame_id: str | None) -> None:
    """Raises `ArgumentError` for a topic or a frame id that ROS would refuse."""

@dataclass(frozen=True)
class Camera:
    """A camera to be published, and which of its topics. APS frames are published if the sensor has them.

    Without `focal_px` (one number or x and y) its `camera_info` says that it is not calibrated. `centre_px` is the
    middle of the image by default, where (0, 0) is the centre of the first pixel. `frame_id` comes from the name by
    default. With `event_ids` each `ros.Frame` with a packet should have `ids`.
    """

    name: str
    sensor: SensorModel | str
    focal_px: Union[float, tuple[float, float], None] = None
    centre_px: tuple[float, float] | None = None
    rgb: bool = False
    depth: bool = False
    imu: bool = False
    frame_id: str | None = None
    event_ids: bool = False

@dataclass(frozen=True)
class Imu:
    """A sample of an IMU in the frame `..._link`: x forward, y left, z up. At rest the force is 9.81 upwards."""

    t_ns: int
    angular_rate_rad_s: Sequence[float]
    specific_force_m_s2: Sequence[float]

@dataclass(frozen=True)
class Frame:
    """A camera's data at one time.

    `packet`: of this camera; of a `TiledEventCamera` it is `packet[i]`. `rgb`: uint8 `(height, width, 3 or 4)`.
    `depth`: float32 metres along the view axis, `(height, width)`; infinite, NaN or not positive if there is nothing.
    `ids`: what `camera.event_ids()` gives for the packet, one for each event; of a `TiledEventCamera` it is
    `ids[packet.offsets[i] : packet.offsets[i + 1]]`. Arrays on a device are copied to the host.
    """

    packet: Packet | None = None
    aps: ApsFrame | None = None
    rgb: Any = None
    depth: Any = None
    imu: Iterable[Imu] = ()
    ids: Any = None

@dataclass(frozen=True)
class Instance:
    """A thing that events show: for example the path of its prim, and lists of labels by their kind, such as
    `{"class": ["box"]}`."""

    name: str
    labels: Mapping[str, Iterable[str]] = field(default_factory=dict)

class Publisher:
    """Publishes cameras, records them, or both.

    `events`: `packed`, `plain`, `evt3` or `mono`. `policy`: if sending falls behind, `latest` (the default) drops
    the oldest tick and counts it, and `lossless` (the default with `record`) waits. `time`: `sim` stamps messages
    with the simulation's time and publishes it on `/clock`; `wall` uses the system's clock. `qos`: for example
    `{"events": "best_effort,depth:10"}`; `all` means every topic. `slice_ns` (from 1000 on) and `max_bytes` limit a
    message's time and size. `network=False` only records.

    `record` is a file whose name ends in `.mcap`. A file that is there is overwritten once the first second or MiB of
    messages is whole, or by `close`; a publisher that sends none leaves it as it was. What a killed process has
    recorded until a second before stays readable.
    """

    def __init__(
        self,
        cameras: Iterable[Camera],
        *,
        namespace: str = "/esaac",
        node: str = "esaac",
        events: Literal["packed", "plain", "evt3", "mono"] = "packed",
        policy: Literal["latest", "lossless"] | None = None,
        time: Literal["sim", "wall"] = "sim",
        qos: Mapping[str, str] | None = None,
        slice_ns: int = 0,
        max_bytes: int = 0,
        network: bool = True,
        domain: int | None = None,
        interface: str | None = None,
        record: str | os.PathLike[str] | None = None,
    ) -> None: ...
    @property
    def topics(self) -> dict[str, str]:
        """Each topic's type, by the topic's name."""
    def publish(self, t_ns: int, frames: Mapping[str, Frame]) -> None:
        """Sends cameras' data of time `t_ns`, by name. A call may have some of the cameras only.

        A packet of a camera with `event_ids` that comes without `ids` is sent without them, and a notice says so.

        Raises `FrameError` for images of other types and shapes and packets of another size, and `ArgumentError` for
        samples of an IMU and ids that do not fit, and for what was not announced.
        """
    def set_sensor(self, name: str, sensor: SensorModel) -> None:
        """Publishes a camera's parameters again after they have changed."""
    def set_instances(self, name: str, instances: Mapping[int, Instance | str]) -> None:
        """Publishes with the next `publish` which instance each of a camera's ids is, if that has changed: a
        `ros.Instance`, or its name alone. The camera must have `event_ids`. Give all instances, each time."""
    def set_status(
        self, name: str, values: Mapping[str, object] | None = None, warnings: Iterable[str] = ()
    ) -> None:
        """Shows what is known of a camera on `/diagnostics`, until the next call: names and values, for example
        `camera.statistics`, and warnings, with which the camera's status becomes WARN. `/diagnostics` is published
        once a second and by `close`."""
    def restart(self) -> None:
        """To be called after a reset of the simulation: allows the next `publish` to be earlier than the last, and
        takes `/clock` back with it. A camera whose time goes back without it gives a notice."""
    def notices(self) -> list[str]:
        """Messages for the user since the last call, for example of subscribers that cannot be served, or of a camera
        whose time went back without `restart`."""
    def summary(self) -> dict[str, Any]:
        """Counts of messages, bytes, drops and subscribers by topic, and times."""
    def close(self) -> dict[str, Any] | None:
        """Sends what is queued and ends. Returns the summary. An incomplete recording raises `RosError`."""
    def __enter__(self) -> Publisher: ...
    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None: ...
