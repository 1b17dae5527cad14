"""Event cameras of a Newton model, one in each world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import newton.sensors
import numpy as np
import warp as wp

from esaac import ArgumentError
from esaac.newton.bodies import WorldBodies
from esaac.newton.mounts import Mounts
from esaac.newton.view import View
from esaac.on_warp import SubstepLog, WorldCameras

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from esaac import Intrinsics, Packet, SensorModel


class EventCameras(WorldCameras):
    """An event camera in each world of a Newton model.

    Call `record(state)` before each substep of the solver, and `step(state)` for each frame. Frames may be rare:
    between two of them events follow the poses of all substeps.

    `events` is the `esaac.TiledEventCamera`, with `event_frames()`, `voxel_grids()` and `statistics`. `view` has what
    was drawn last: `colour`, `depth` and `ids`, Warp arrays on the model's device.
    """

    view: View

    def __init__(
        self,
        model: Any,
        sensor: SensorModel | str | None = None,
        *,
        substep_s: float,
        intrinsics: Intrinsics | Sequence[float],
        places: ArrayLike,
        bodies: int | ArrayLike = -1,
        tiled_camera: Any = None,
        antialiasing: int = 3,
        background: Sequence[float] = (0.5, 0.5, 0.5),
        limit: int = 256,
        **options: Any,
    ) -> None:
        """
        * `model`: a finalised `newton.Model`. Each of its worlds has a camera.
        * `sensor`: a preset or an `esaac.SensorModel`. `options` are more arguments of `esaac.TiledEventCamera`:
          parameters of the sensor (`width=64, contrast_on=0.2`), `profile`, `packets`, `device`.
        * `substep_s`: seconds from one `record` to the next. The clock counts substeps, so it does not drift.
        * `intrinsics`: the pinhole of all cameras, an `esaac.Intrinsics` or `(fx, fy, cx, cy)` in pixels.
        * `places`: `(7,)` or `(worlds, 7)`, metres and a quaternion x y z w: where a camera is in the axes of its
          body, or in the world. It looks along -z, x right, y up.
        * `bodies`: the body of the model that each camera sits on, one number or `(worlds,)`; -1 is the world.
        * `tiled_camera`: a `newton.sensors.SensorCamera` (Newton 1.7 and later) or `SensorTiledCamera`, with lights
          and textures of its own. Without it there is one with textures and a light without shadows.
        * `antialiasing`: rays along each axis of a pixel, 1 to 8.
        * `background`: linear red, green and blue of what no ray hits.
        * `limit`: most substeps between two frames of a world.

        Wrong values raise `esaac.ArgumentError`, those of the sensor `esaac.SensorError`.
        """
        worlds = model.world_count
        self._model = model
        log = SubstepLog(model, substep_s, limit)
        self._tiled_camera = _tiled_camera(model) if tiled_camera is None else tiled_camera
        places = np.asarray(places, np.float64)
        if places.shape not in ((7,), (worlds, 7)):
            raise ArgumentError(f"places have shape {places.shape}, expected (7,) or ({worlds}, 7)")
        self._mounts = Mounts(_bodies(bodies, model), np.broadcast_to(places, (worlds, 7)))
        numbered = WorldBodies(model)
        super().__init__(sensor, worlds, intrinsics, log, numbered, options)
        width, height = self.events.sensor.width, self.events.sensor.height
        self.view = View(
            model, numbered, intrinsics, width, height, antialiasing=antialiasing, background=background
        )

    def record(self, state: Any) -> None:
        """Keeps the poses of a `newton.State` that a substep begins with. It only launches kernels, so a CUDA graph
        may capture it."""
        self._check_open()
        self._log.record(state)

    def step(self, state: Any, worlds: ArrayLike | None = None) -> Packet:
        """Draws the present state, which is not recorded yet, and returns the events since each world's last frame.

        `worlds` are the numbers of those that have a frame, or a mask, all for None. The others wait: they have no
        events in the packet, and their next interval begins at their last frame. The first frame of a world, and the
        first after a `reset`, sends nothing. A world whose poses are not finite has no frame: `held_counts` counts
        it, `esaac.PoseWarning` tells it once, and its next frame is a first one.

        Raises `esaac.ArgumentError` if nothing was recorded since a world's last frame, and `esaac.FrameError` if
        more than `limit` substeps were."""
        return self._step(state, worlds, self._mounts, lambda poses: self._draw(state, poses.camera[-1]))

    def _draw(self, state: Any, cameras: NDArray[np.float64]) -> None:
        self._model.bvh_refit_shapes(state)
        self._model.bvh_refit_particles(state)
        transforms = wp.array(cameras[None], dtype=wp.transformf, device=self._model.device)
        self.view.draw(self._tiled_camera, state, transforms)


def _tiled_camera(model: Any) -> Any:
    """Newton 1.7 has a new class for it, and deprecates the old one."""
    kind = getattr(newton.sensors, "SensorCamera", None) or newton.sensors.SensorTiledCamera
    config = kind.RenderConfig(enable_textures=True, enable_backface_culling=False)
    camera = kind(model, default_render_config=config)
    getattr(camera, "utils", camera).create_default_light(enable_shadows=False)
    return camera


def _bodies(given: int | ArrayLike, model: Any) -> NDArray[np.int64]:
    bodies = np.asarray(given)
    if bodies.shape not in ((), (model.world_count,)) or bodies.dtype.kind not in "iu":
        raise ArgumentError(f"bodies are {given!r}, expected a number of a body, or one for each world")
    if bodies.min() < -1 or bodies.max() >= model.body_count:
        raise ArgumentError(f"bodies are {given!r}, expected -1 to {model.body_count - 1}")
    bodies = np.broadcast_to(bodies, (model.world_count,)).astype(np.int64)
    for world in np.flatnonzero(bodies >= 0):
        own = int(model.body_world.numpy()[bodies[world]])
        if own not in (world, -1):
            raise ArgumentError(
                f"the camera of world {world} is on body {bodies[world]} of world {own}, expected one of its "
                "own world"
            )
    return bodies
