"""Configurations of the event camera and of its renderer."""

from __future__ import annotations

from typing import Any

from isaaclab.sensors import CameraCfg
from isaaclab.utils import configclass
from isaaclab_newton.renderers import NewtonWarpRendererCfg

EVENT_TYPES = ("events", "event_ids", "event_frame", "voxel_grid")
"""Outputs that are made of events; all others are images of the renderer."""


@configclass
class EventRendererCfg(NewtonWarpRendererCfg):
    """Newton Warp, which also draws averaged colour, depth and ids for event cameras."""

    class_type: type | str = "esaac.isaaclab.renderer:EventRenderer"


@configclass
class EventCameraCfg(CameraCfg):
    """A camera of a scene that sends events: a `CameraCfg` with the settings below.

    `update_period` [s] is the time between frames, a whole number of physics steps; 0 is each of them. Between two
    frames events follow the poses of all physics substeps. `width` and `height` are in pixels. `spawn` must be a
    `PinholeCameraCfg` without distortion.

    `camera.data.output` has, of each environment's last frame:

    * `events`: int64 `(n, 4)`: x, y [px], t_ns (the simulation's time), p (0 OFF, 1 ON), one environment's events
      after the other's, each sorted by time. Environment i has rows `events_offsets[i]` to `events_offsets[i + 1]`.
    * `events_offsets`: int64 `(num_envs + 1,)`.
    * `event_ids`: int64 `(n,)`, the body that each of `events` shows when it is sent: 0 for what is static, i + 1 for
      body i of its environment in Newton's order, -1 where no path tells it. At a silhouette it is the body in front.
    * `event_frame`: int32 `(num_envs, height, width, 2)`, the number of OFF and of ON events.
    * `voxel_grid`: float32 `(num_envs, height, width, voxel_bins)`, +1 and -1 for each event, split between the two
      nearest of the bins in time.

    Each is there as `.torch` and `.warp`, on the simulation's device. `event_frame` and `voxel_grid` keep their
    memory; `events` and what goes with it is new with each frame.
    """

    class_type: type | str = "esaac.isaaclab.camera:EventCamera"

    data_types: list[str] = ["events", "event_frame"]
    """Which of `events`, `event_ids`, `event_frame` and `voxel_grid`; and images, as of any camera. `rgb_hdr` is what
    the events are made of."""

    renderer_cfg: EventRendererCfg = EventRendererCfg()

    update_latest_camera_pose: bool = True
    """An event camera follows its link."""

    background_color: tuple[float, float, float] | None = (0.5, 0.5, 0.5)
    """What rays see that hit nothing, in sRGB. There must be a colour: against black, every edge has endless
    contrast."""

    sensor: str = "davis346"
    """A preset or a TOML text of a sensor, whose size becomes `width` and `height`."""

    profile: str | None = None
    """`clean`, `noisy` or `paper`."""

    parameters: dict[str, Any] = {}
    """Parameters of the sensor that differ, such as `{"contrast_on": 0.2}`."""

    antialiasing: int = 3
    """Rays along each axis of a pixel, whose colours are averaged, 1 to 8. 1 turns it off."""

    voxel_bins: int = 5
    """Bins of `voxel_grid`, 1 to 256."""

    def validate_config(self) -> None:
        """Raises what Isaac Lab raises for any camera."""
        # The renderer knows nothing of events.
        images = self.copy()
        images.data_types = [name for name in self.data_types if name not in EVENT_TYPES]
        CameraCfg.validate_config(images)
