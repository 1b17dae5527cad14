"""Configurations of the event camera and of its renderer."""

from __future__ import annotations

from isaaclab.sensors import CameraCfg
from isaaclab.utils import configclass
from isaaclab_newton.renderers import NewtonWarpRendererCfg

EVENT_TYPES = ("events", "event_frame", "voxel_grid")
"""Outputs that are made of events; all others are images of the renderer."""


@configclass
class EventRendererCfg(NewtonWarpRendererCfg):
    """Newton Warp, which also draws averaged colour, depth and ids for event cameras."""

    class_type: type | str = "esaac.isaaclab.renderer:EventRenderer"


@configclass
class EventCameraCfg(CameraCfg):
    """A camera that sends events."""

    class_type: type | str = "esaac.isaaclab.camera:EventCamera"

    data_types: list[str] = ["events", "event_frame"]
    """Which of `events`, `event_frame` and `voxel_grid`; and images, as of any camera. `rgb_hdr` is what the events
    are made of."""

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

    parameters: dict = {}
    """Parameters of the sensor that differ, such as `{"contrast_on": 0.2}`."""

    antialiasing: int = 3
    """Rays along each axis of a pixel, whose colours are averaged. 1 turns it off."""

    voxel_bins: int = 5

    def validate_config(self):
        # The renderer knows nothing of events.
        images = self.copy()
        images.data_types = [name for name in self.data_types if name not in EVENT_TYPES]
        CameraCfg.validate_config(images)
