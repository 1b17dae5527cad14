"""Where bodies, geoms and cameras are now, whatever the last physics step has left in the simulation's data."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import mujoco_warp
import numpy as np
import warp as wp

if TYPE_CHECKING:
    from numpy.typing import NDArray

_STATE = ("qpos", "qvel", "mocap_pos", "mocap_quat")
"""What poses follow from."""

_BODIES = (
    "xpos",
    "xquat",
    "xmat",
    "xipos",
    "ximat",
    "xanchor",
    "xaxis",
    "geom_xpos",
    "geom_xmat",
    "site_xpos",
)
_CENTRES = ("site_xmat", "subtree_com", "cinert", "cdof", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir")
_FLEXES = ("flexnode_xpos", "flexvert_xpos", "flexedge_J", "flexedge_length", "flexedge_velocity")
_COMPUTED = (*_BODIES, *_CENTRES, *_FLEXES, "face_xpos", "face_quat")
"""What MuJoCo Warp's functions write here."""


@wp.kernel(enable_backward=False)
def _gather(
    xpos: wp.array2d(dtype=wp.vec3f),
    xquat: wp.array2d(dtype=wp.quatf),
    cam_xpos: wp.array2d(dtype=wp.vec3f),
    cam_xmat: wp.array2d(dtype=wp.mat33f),
    camera: int,
    poses: wp.array(dtype=wp.transformf),
):
    world, body = wp.tid()
    row = world * xpos.shape[1] + body
    if body == 0:
        poses[row] = wp.transformf(cam_xpos[world, camera], wp.quat_from_matrix(cam_xmat[world, camera]))
    else:
        # MuJoCo Warp keeps the scalar first, in a type of Warp's that has it last.
        turn = xquat[world, body]
        poses[row] = wp.transformf(xpos[world, body], wp.quatf(turn[1], turn[2], turn[3], turn[0]))


class Present:
    """The poses of a `mujoco_warp.Data` at this moment. `data` are MuJoCo Warp's as well, with arrays of their own
    for all that follows from the state, so the simulation's are left as they are.

    `body_q` `(worlds * bodies,)`, transforms, has the bodies of one world after those of another. The camera takes
    the place of body 0, the world.
    """

    def __init__(self, model: Any, data: Any, camera: int) -> None:
        self._model, self._given, self._camera = model, data, camera
        self.device = data.qpos.device
        self.worlds, self.body_count = data.nworld, data.nworld * model.nbody
        # Copies: what hangs on the world is computed only when data are made.
        self.data = dataclasses.replace(data, **{name: wp.clone(getattr(data, name)) for name in _COMPUTED})
        self.body_q = wp.zeros(self.body_count, dtype=wp.transformf, device=self.device)

    def update(self) -> None:
        """Computes the poses of the simulation's present state. It only launches kernels."""
        for name in _STATE:
            setattr(self.data, name, getattr(self._given, name))
        with wp.ScopedDevice(self.device):
            mujoco_warp.kinematics(self._model, self.data)
            # Cameras and lights may follow a centre of mass.
            mujoco_warp.com_pos(self._model, self.data)
            mujoco_warp.camlight(self._model, self.data)
            inputs = [self.data.xpos, self.data.xquat, self.data.cam_xpos, self.data.cam_xmat, self._camera]
            wp.launch(_gather, (self.worlds, self._model.nbody), inputs, outputs=[self.body_q])

    def update_flexes(self) -> None:
        """Computes where flexes are, which only drawing needs. The poses must be of the present."""
        with wp.ScopedDevice(self.device):
            mujoco_warp.flex(self._model, self.data)

    def poses(self, steps: NDArray[np.int64], states: NDArray[Any]) -> NDArray[Any]:
        """Cameras `(steps, worlds, 7)` of rows of `body_q` `(steps, worlds * bodies, 7)`."""
        return states.reshape(len(states), self.worlds, -1, 7)[:, :, 0]

    def arranged(self, poses: NDArray[Any]) -> NDArray[Any]:
        """Bodies `(steps, worlds, bodies - 1, 7)` of rows of `body_q`."""
        return poses.reshape(len(poses), self.worlds, -1, 7)[:, :, 1:]
