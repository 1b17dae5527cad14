"""Event cameras for MuJoCo Warp: colour, depth and bodies from its batch renderer, poses from every physics step.

MuJoCo Warp is imported with this module, and not with `esaac`.
"""

from esaac.mujoco_warp.cameras import EventCameras
from esaac.mujoco_warp.view import View

__all__ = ["EventCameras", "View"]
