"""What MuJoCo Warp's batch renderer draws for event cameras: averaged colour, depth and ids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import mujoco_warp
import numpy as np
import warp as wp

from esaac import ArgumentError
from esaac.checks import UNKNOWN
from esaac.srgb import linear_of

if TYPE_CHECKING:
    from esaac.mujoco_warp.present import Present

_GEOM = wp.constant(int(mujoco.mjtObj.mjOBJ_GEOM))
_UNKNOWN = wp.constant(wp.uint32(UNKNOWN))

_OWN = ("nworld", "cam_res", "cam_active", "render_rgb", "render_depth", "render_seg", "use_precomputed_rays")
"""Arguments of MuJoCo Warp's that are set here."""


@wp.kernel(enable_backward=False)
def _gather(
    colours: wp.array2d(dtype=wp.uint32),
    depths: wp.array2d(dtype=wp.float32),
    seen: wp.array2d(dtype=wp.vec2i),
    geom_body: wp.array(dtype=int),
    linear: wp.array(dtype=wp.float32),
    background: wp.vec3f,
    has_sky: int,
    times: int,
    colour: wp.array4d(dtype=wp.float32),
    depth: wp.array3d(dtype=wp.float32),
    ids: wp.array3d(dtype=wp.uint32),
):
    world, y, x = wp.tid()
    across = colour.shape[2] * times
    sum = wp.vec3f(0.0)
    for j in range(times):
        for i in range(times):
            ray = (y * times + j) * across + x * times + i
            if seen[world, ray][0] < 0 and has_sky == 0:
                sum += background
            else:
                packed = int(colours[world, ray])
                sum += wp.vec3f(
                    linear[(packed >> 16) & 255], linear[(packed >> 8) & 255], linear[packed & 255]
                )
    sum = sum / float(times * times)
    for channel in range(3):
        colour[world, y, x, channel] = sum[channel]
    middle = (y * times + times // 2) * across + x * times + times // 2
    number = seen[world, middle][0]
    if number < 0:
        depth[world, y, x] = 0.0
        ids[world, y, x] = wp.uint32(0)
    else:
        depth[world, y, x] = depths[world, middle]
        if seen[world, middle][1] == _GEOM:
            ids[world, y, x] = wp.uint32(geom_body[number])
        else:
            ids[world, y, x] = _UNKNOWN


class View:
    """A fixed camera of a model in each world, and its images.

    The renderer casts one ray a pixel of an image that is `antialiasing` times as wide and high. Colours are
    averaged; depth and ids are those of the ray through a pixel's middle.

    `colour` `(worlds, height, width, 3)`, float32 and linear, `depth` `(worlds, height, width)`, float32, metres
    along the optical axis (0: no geometry), and `ids` `(worlds, height, width)`, uint32, numbers of bodies (flexes
    have 2^32 - 1), are Warp arrays on the model's device.
    """

    colour: Any
    depth: Any
    ids: Any

    def __init__(
        self,
        host_model: Any,
        model: Any,
        present: Present,
        camera: int,
        width: int,
        height: int,
        *,
        antialiasing: int = 3,
        background: Sequence[float] = (0.5, 0.5, 0.5),
        rendering: Mapping[str, Any] | None = None,
    ) -> None:
        if antialiasing not in (1, 3, 5, 7):
            raise ArgumentError(f"antialiasing is {antialiasing}, expected 1, 3, 5 or 7")
        rendering = {"render_skybox": True, **(rendering or {})}
        for name in rendering:
            if name in _OWN or name.startswith(("background", "splat")):
                raise ArgumentError(f"rendering has `{name}`, which event cameras set or cannot follow")
        self._model, self._present, self._times = model, present, antialiasing
        self._background = wp.vec3f(*map(float, background))
        self._graph: Any = None
        self._graph_of: list[Any] = []
        device, worlds = present.device, present.worlds
        with wp.ScopedDevice(device):
            self._context = mujoco_warp.create_render_context(
                host_model,
                nworld=worlds,
                cam_res=(width * antialiasing, height * antialiasing),
                cam_active=[number == camera for number in range(host_model.ncam)],
                render_rgb=True,
                render_depth=True,
                render_seg=True,
                **rendering,
            )
        # MuJoCo Warp rounds down to bytes, so one stands for the middle of its step.
        linear = linear_of((np.arange(256) + 0.5) / 255)
        self._linear = wp.array(linear, dtype=wp.float32, device=device)
        self.colour = wp.zeros((worlds, height, width, 3), dtype=wp.float32, device=device)
        self.depth = wp.zeros((worlds, height, width), dtype=wp.float32, device=device)
        self.ids = wp.zeros((worlds, height, width), dtype=wp.uint32, device=device)

    def draw(self) -> None:
        """Draws the present, whose poses are computed, into `colour`, `depth` and `ids`.

        The renderer's launch is kept as a graph, as MuJoCo Warp makes its kernel anew each time. A model whose arrays
        were exchanged has a new one."""
        if self._model.nflex:
            self._present.update_flexes()
        # Not part of the graph: on the host, Warp's leave the meshes of flexes where they were.
        with wp.ScopedDevice(self._present.device):
            mujoco_warp.refit_bvh(self._model, self._present.data, self._context)
        arrays = list(vars(self._model).values())
        if len(arrays) == len(self._graph_of) and all(a is b for a, b in zip(arrays, self._graph_of)):
            wp.capture_launch(self._graph)
            return
        # This compiles and loads kernels, which a graph must not.
        self._launch()
        with wp.ScopedCapture(self._present.device) as capture:
            self._launch()
        self._graph, self._graph_of = capture.graph, arrays

    def _launch(self) -> None:
        drawn = self._context
        with wp.ScopedDevice(self._present.device):
            mujoco_warp.render(self._model, self._present.data, drawn)
            wp.launch(
                _gather,
                self.depth.shape,
                [drawn.rgb_data, drawn.depth_data, drawn.seg_data, self._model.geom_bodyid, self._linear]
                + [self._background, int(drawn.render_skybox), self._times],
                outputs=[self.colour, self.depth, self.ids],
            )
