"""An event camera for MuJoCo: colour, depth and bodies from its renderer, poses from every physics step.

MuJoCo is imported with this module, and not with `esaac`.
"""

from esaac.mujoco.camera import EventCamera

__all__ = ["EventCamera"]
