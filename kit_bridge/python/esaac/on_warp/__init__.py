"""What event cameras of simulators on Warp share: poses of every physics substep, and frames of worlds that may wait.

`esaac.newton`, `esaac.isaaclab` and `esaac.mujoco_warp` are made of it.
"""

from esaac.on_warp.cameras import WorldCameras
from esaac.on_warp.frames import Frames, Images
from esaac.on_warp.substeps import SubstepLog

__all__ = ["Frames", "Images", "SubstepLog", "WorldCameras"]
