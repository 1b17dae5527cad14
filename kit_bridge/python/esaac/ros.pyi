"""ROS 2 topics of event cameras, on machines with ROS 2 and without.

    from esaac import ros

    with ros.Publisher([ros.Camera("davis", camera.sensor, focal_px=300.0, rgb=True)]) as publisher:
        publisher.publish(t_ns, {"davis": ros.Frame(packet, aps=camera.aps, rgb=image)})

Topics, messages, stamps and qualities of service are those of `esaac demo`: below `/NAMESPACE/NAME` `events`,
`sensor`, `aps/image_raw`, `image_raw`, `depth/image_raw`, each with its `camera_info`, and `imu`; beside them
`/clock`, `/tf_static` and `/diagnostics`. An embedded Cyclone DDS sends; `ROS_DOMAIN_ID`, `ROS_LOCALHOST_ONLY`,
`ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_DISTRO` and `CYCLONEDDS_URI` mean what they mean to ROS.

A thread of its own sends, and the interpreter is free meanwhile.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Literal, Union

from esaac import ApsFrame, Packet, SensorModel
from esaac import RosError as RosError

def check_names(topic: str, frame_id: str | None) -> None:
    """Raises `ArgumentError` for a topic or a frame id that ROS would refuse."""

@dataclass(frozen=True)
class Camera:
    """A camera to be published, and what of it. APS frames are, where the sensor has them.

    Without `focal_px` (one number or x and y) its `camera_info` says that it is not calibrated. `centre_px` is the
    middle of the image by default; the centre of the first pixel is (0, 0). `frame_id` is made of the name by
    default.
    """

    name: str
    sensor: SensorModel | str
    focal_px: Union[float, tuple[float, float], None] = None
    centre_px: tuple[float, float] | None = None
    rgb: bool = False
    depth: bool = False
    imu: bool = False
    frame_id: str | None = None

@dataclass(frozen=True)
class Imu:
    """What an IMU measures in the frame `..._link`: x forward, y left, z up; 9.81 upwards at rest."""

    t_ns: int
    angular_rate_rad_s: Sequence[float]
    specific_force_m_s2: Sequence[float]

@dataclass(frozen=True)
class Frame:
    """What a camera has to say at one time.

    `rgb`: uint8 `(height, width, 3 or 4)`. `depth`: metres along the view axis, `(height, width)`; infinite, NaN or
    not positive where there is none. Arrays of a device are brought to the host.
    """

    packet: Packet | None = None
    aps: ApsFrame | None = None
    rgb: Any = None
    depth: Any = None
    imu: Iterable[Imu] = ()

class Publisher:
    """Publishes cameras, records them, or both.

    `events`: `packed`, `plain`, `evt3` or `mono`. `policy`: when sending falls behind, `latest` drops the oldest
    tick and counts it (the default), `lossless` waits (the default with `record`). `time`: stamps are times of the
    simulation, told on `/clock`, or `wall`. `qos`: as in `{"events": "best_effort,depth:10"}`; `all` is every
    topic. `slice_ns`, `max_bytes`: smaller messages. `network=False` records only.
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
        """Types by name."""
    def publish(self, t_ns: int, frames: Mapping[str, Frame]) -> None:
        """Sends what cameras have at `t_ns`, by name. Cameras may have calls of their own."""
    def set_sensor(self, name: str, sensor: SensorModel) -> None:
        """Tells a camera's parameters again: they have changed."""
    def restart(self) -> None:
        """Time may go back with the next call of `publish`."""
    def notices(self) -> list[str]:
        """What has happened since the last call that people should know: subscribers that cannot be served."""
    def summary(self) -> dict[str, Any]:
        """Messages, bytes, drops and subscribers by topic, and times."""
    def close(self) -> dict[str, Any] | None:
        """Sends what waits, and ends; the summary. A recording that is not whole raises `RosError`."""
    def __enter__(self) -> Publisher: ...
    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None: ...
