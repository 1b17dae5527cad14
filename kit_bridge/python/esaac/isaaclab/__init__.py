"""Event cameras for Isaac Lab 3 with Newton physics: a camera of a scene's configuration that sends events.

Isaac Lab is imported with this module, and not with `esaac`.
"""

from esaac.isaaclab.cfg import EventCameraCfg, EventRendererCfg
from esaac.isaaclab.observations import event_frame, voxel_grid

__all__ = ["EventCameraCfg", "EventRendererCfg", "event_frame", "voxel_grid"]
