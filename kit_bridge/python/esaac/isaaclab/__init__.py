"""Event cameras for Isaac Lab 3 with Newton physics: a camera of a scene's configuration that sends events.

Isaac Lab is imported with this module, and not with `esaac`.
"""

from esaac.isaaclab.cfg import EventCameraCfg, EventRendererCfg
from esaac.isaaclab.direct import EventReading
from esaac.isaaclab.observations import event_frame, voxel_grid
from esaac.isaaclab.randomization import randomize_sensor

__all__ = [
    "EventCameraCfg",
    "EventReading",
    "EventRendererCfg",
    "event_frame",
    "randomize_sensor",
    "voxel_grid",
]
