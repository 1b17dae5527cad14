"""Event cameras of a MuJoCo Warp simulation, one in each world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from esaac.mujoco.camera import sensor_of
from esaac.mujoco.lens import camera_number, lens_of
from esaac.mujoco_warp.present import Present
from esaac.mujoco_warp.view import View
from esaac.on_warp import SubstepLog, WorldCameras

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from esaac import Packet, SensorModel


class EventCameras(WorldCameras):
    """An event camera in each world of a MuJoCo Warp simulation.

    Call `record()` before each `mujoco_warp.step`, and `step()` for each frame. Frames may be rare: between two of
    them events follow the poses of all physics steps. The simulation's data are not changed.

    `events` is the `esaac.TiledEventCamera`, with `event_frames()`, `voxel_grids()` and `statistics`. `view` has what
    was drawn last: `colour`, `depth` and `ids`, Warp arrays on the model's device.
    """

    view: View

    def __init__(
        self,
        host_model: Any,
        model: Any,
        data: Any,
        camera: str | int,
        sensor: SensorModel | str | None = None,
        *,
        substep_s: float | None = None,
        antialiasing: int = 3,
        background: Sequence[float] = (0.5, 0.5, 0.5),
        rendering: Mapping[str, Any] | None = None,
        limit: int = 256,
        **options: Any,
    ) -> None:
        """
        * `host_model`: the `mujoco.MjModel` that `model` was made of.
        * `model`, `data`: the simulation's `mujoco_warp.Model` and `mujoco_warp.Data`. Each world has a camera.
        * `camera`: name or number of a camera of the model. It may sit on a body. Its lens is that of `host_model`
          in all worlds, and its image has the sensor's size.
        * `sensor`: a preset or an `esaac.SensorModel`. `options` are more arguments of `esaac.TiledEventCamera`:
          parameters of the sensor (`width=64, contrast_on=0.2`), `profile`, `packets`, `device`.
        * `substep_s`: seconds from one `record` to the next, by default the time step of `host_model`. The clock
          counts calls of `record`, so it does not drift.
        * `antialiasing`: rays along each axis of a pixel: 1, 3, 5 or 7.
        * `background`: linear red, green and blue of what no ray hits, where the model has no skybox.
        * `rendering`: more arguments of `mujoco_warp.create_render_context`, `{"use_shadows": True}` for example.
        * `limit`: most substeps between two frames of a world.

        Wrong values raise `esaac.ArgumentError`, those of the sensor `esaac.SensorError`.
        """
        number = camera_number(host_model, camera)
        self._present = Present(model, data, number)
        substep_s = float(host_model.opt.timestep) if substep_s is None else substep_s
        log = SubstepLog(self._present, substep_s, limit)
        sensor, options = sensor_of(sensor, options)
        lens = lens_of(host_model, number, sensor.width, sensor.height, cropped=True)
        super().__init__(sensor, data.nworld, lens, log, self._present, options)
        self.view = View(
            host_model,
            model,
            self._present,
            number,
            sensor.width,
            sensor.height,
            antialiasing=antialiasing,
            background=background,
            rendering=rendering,
        )

    def record(self) -> None:
        """Keeps the poses that a physics step begins with: of the state as it is now, whatever step came before. It
        only launches kernels, so a CUDA graph may capture it."""
        self._check_open()
        self._present.update()
        self._log.record(self._present)

    def step(self, worlds: ArrayLike | None = None) -> Packet:
        """Draws the present state, which is not recorded yet, and returns the events since each world's last frame.

        `worlds` are the numbers of those that have a frame, or a mask, all for None. The others wait: they have no
        events in the packet, and their next interval begins at their last frame. The first frame of a world, and the
        first after a `reset`, sends nothing. A world whose poses are not finite has no frame: `held_counts` counts
        it, `esaac.PoseWarning` tells it once, and its next frame is a first one.

        Raises `esaac.ArgumentError` if nothing was recorded since a world's last frame, and `esaac.FrameError` if
        more than `limit` substeps were."""
        self._check_open()
        self._present.update()
        return self._step(self._present, worlds, self._present, lambda poses: self.view.draw())
