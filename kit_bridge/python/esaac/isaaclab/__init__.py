"""Event cameras for Isaac Lab 3 with Newton physics: a camera of a scene's configuration that sends events.

Isaac Lab is imported with this module, and not with `esaac`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from esaac.isaaclab.cfg import EventCameraCfg, EventRendererCfg
from esaac.isaaclab.direct import EventReading
from esaac.isaaclab.observations import event_frame, voxel_grid
from esaac.isaaclab.randomization import randomize_sensor

if TYPE_CHECKING:
    from esaac.isaaclab.camera import EventCamera

__all__ = [
    "EventCamera",
    "EventCameraCfg",
    "EventReading",
    "EventRendererCfg",
    "event_frame",
    "randomize_sensor",
    "voxel_grid",
]


def __getattr__(name: str) -> Any:
    # Isaac Lab's sensors may be imported only once its application runs; configurations before that.
    if name == "EventCamera":
        from esaac.isaaclab.camera import EventCamera

        return EventCamera
    raise AttributeError(f"module `{__name__}` has no attribute `{name}`")
