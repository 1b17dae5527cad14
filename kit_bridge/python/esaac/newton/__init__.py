"""Event cameras for Newton: colour, depth and shapes from its tiled camera, poses from every physics substep.

`EventCameras` is all that a program with `newton` alone needs.
"""

from esaac.newton.bodies import WorldBodies
from esaac.newton.cameras import EventCameras
from esaac.newton.view import View
from esaac.on_warp import SubstepLog

__all__ = ["EventCameras", "SubstepLog", "View", "WorldBodies"]
