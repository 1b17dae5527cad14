"""An event camera at a fixed camera of a MuJoCo model."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

import esaac
from esaac import ArgumentError, ClosedError, FrameError, PoseRecorder
from esaac.attributes import KnownAttributes
from esaac.mujoco.lens import camera_number, lens_of
from esaac.mujoco.view import View

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from esaac import Packet, SensorModel


class EventCamera(KnownAttributes):
    """An event camera at a camera of a `mujoco.MjModel`.

    Call `record(data)` after each `mj_step`, and `step(data)` for each frame. Frames may be rare: between two of them
    events follow the poses that were recorded. The clock is `data.time`.

    Colours are MuJoCo's bytes, read as sRGB. `events` is the `esaac.EventCamera`, with `event_frame()`,
    `voxel_grid()` and `statistics`.
    """

    events: esaac.EventCamera

    _OWN = ("events",)
    _CHANGE = "camera.events.sensor = camera.events.sensor.replace({name}=...)"

    def __init__(
        self,
        model: Any,
        camera: str | int,
        sensor: SensorModel | str | None = None,
        *,
        antialiasing: int = 5,
        scene_option: Any = None,
        limit: int = 1024,
        **options: Any,
    ) -> None:
        """
        * `model`: a `mujoco.MjModel`.
        * `camera`: name or number of a camera of the model. It may sit on a body. Its lens is the model's, and its
          image has the sensor's size.
        * `sensor`: a preset or an `esaac.SensorModel`. `options` are more arguments of `esaac.EventCamera`:
          parameters of the sensor (`width=64, contrast_on=0.2`), `profile`, `packets`, `device`.
        * `antialiasing`: how many times as wide and high as the sensor MuJoCo draws: 1, 3, 5 or 7.
        * `scene_option`: a `mujoco.MjvOption`: what is visible.
        * `limit`: most samples of poses that are kept; at least those between two frames, and four.

        Wrong values raise `esaac.ArgumentError`, those of the sensor `esaac.SensorError`. MuJoCo's own errors are
        raised where it cannot draw; without a screen set the variable `MUJOCO_GL=egl` before it is imported.
        """
        number = camera_number(model, camera)
        given, camera_options = sensor_of(sensor, options)
        width, height = given.width, given.height
        self._lens = lens_of(model, number, width, height)
        self._recorder = PoseRecorder(order="wxyz", axes="opengl", limit=limit)
        self.events = esaac.EventCamera(given, intrinsics=self._lens, **camera_options)
        self._view = View(model, number, width, height, antialiasing, scene_option)
        self._model, self._number = model, number
        # The simulation's own data are left as they are.
        self._own = mujoco.MjData(model)
        self._recorded_ns: int | None = None
        self._stepped_ns: int | None = None

    @property
    def colour(self) -> NDArray[np.float32]:
        """Of the last frame, linear: `(height, width, 3)`."""
        return self._view.colour

    @property
    def depth(self) -> NDArray[np.float32]:
        """Of the last frame, metres along the optical axis: `(height, width)`. 0 where there is no geometry."""
        return self._view.depth

    @property
    def ids(self) -> NDArray[np.uint32]:
        """Of the last frame, numbers of bodies: `(height, width)`. Tendons, skins and flexes have 2^32 - 1."""
        return self._view.ids

    def record(self, data: Any) -> None:
        """Keeps the poses at `data.time`. `data` is not changed.

        After `mj_step` the poses in `data` are those of the step before, so they are computed here from `data.qpos`.
        A state that was set at a time that is recorded takes the place of the one before. Once the frame at that time
        is drawn, it counts from the next time on.
        A time before the last one raises `esaac.FrameError`; call `reset` where a simulation begins anew."""
        self._check(data)
        t_ns = _time_ns(data)
        own = self._own
        if t_ns == self._recorded_ns:
            names = ("qpos", "mocap_pos", "mocap_quat")
            same = all(np.array_equal(getattr(own, name), getattr(data, name)) for name in names)
            if same or t_ns == self._stepped_ns:
                return
        self._check_time(t_ns)
        own.qpos[:], own.mocap_pos[:], own.mocap_quat[:] = data.qpos, data.mocap_pos, data.mocap_quat
        self._compute()
        camera = np.zeros(7)
        camera[:3] = own.cam_xpos[self._number]
        mujoco.mju_mat2Quat(camera[3:], own.cam_xmat[self._number])
        self._recorder.forget_from(t_ns)
        self._recorder.record(t_ns, camera, np.concatenate([own.xpos[1:], own.xquat[1:]], axis=1))
        self._recorded_ns = t_ns

    def step(self, data: Any) -> Packet:
        """Draws the state at `data.time` and returns the events since the last frame. The first frame, and the first
        after a `reset`, sends nothing. Poses that are not recorded yet are.

        A time that is not after the last frame's raises `esaac.FrameError`, a lens that was changed in the model
        `esaac.ArgumentError`."""
        self._check(data)
        t_ns = _time_ns(data)
        if t_ns == self._stepped_ns:
            raise FrameError(f"the frame at {t_ns} ns has been drawn, expected mj_step in between")
        sensor = self.events.sensor
        if lens_of(self._model, self._number, sensor.width, sensor.height) != self._lens:
            raise ArgumentError(
                f"the lens of camera {self._number} is changed while it runs, expected it to stay; make a new camera"
            )
        self.record(data)
        mujoco.mj_copyData(self._own, self._model, data)
        self._compute()
        # Where tendons and what deforms are drawn.
        mujoco.mj_flex(self._model, self._own)
        mujoco.mj_tendon(self._model, self._own)
        self._view.draw(self._own)
        packet = self.events.step(
            self.colour, t_ns=t_ns, depth=self.depth, ids=self.ids, poses=self._recorder
        )
        self._stepped_ns = t_ns
        return packet

    def reset(self) -> None:
        """Begins anew, at any time: the next frame is the first."""
        self.events.reset()
        self._recorder.clear()
        self._recorded_ns = self._stepped_ns = None

    def close(self) -> None:
        """Frees the renderer and the memory of the event camera. A second call does nothing; any other call raises
        `esaac.ClosedError`."""
        self._view.close()
        self.events.close()

    def __enter__(self) -> EventCamera:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check(self, data: Any) -> None:
        """Fails if the camera is closed, or the data are of another model."""
        if self.events.closed:
            raise ClosedError("the camera is closed")
        sizes, expected = (
            (each.qpos.size, len(each.mocap_pos), len(each.xpos)) for each in (data, self._own)
        )
        if sizes != expected:
            raise ArgumentError(
                f"data have {sizes[0]} coordinates, {sizes[1]} mocap bodies and {sizes[2]} bodies, expected "
                f"{expected[0]}, {expected[1]} and {expected[2]}, those of the camera's model"
            )

    def _compute(self) -> None:
        mujoco.mj_kinematics(self._model, self._own)
        # Cameras may follow a centre of mass.
        mujoco.mj_comPos(self._model, self._own)
        mujoco.mj_camlight(self._model, self._own)

    def _check_time(self, t_ns: int) -> None:
        if self._recorded_ns is not None and t_ns < self._recorded_ns:
            raise FrameError(
                f"data.time is {t_ns} ns, expected a time after {self._recorded_ns} ns; call reset() where a "
                "simulation begins anew"
            )


def sensor_of(
    sensor: SensorModel | str | None, options: Mapping[str, Any]
) -> tuple[SensorModel, dict[str, Any]]:
    """The sensor that these options make, and those that are the camera's."""
    cameras = ("device", "packets", "packet_ring")
    own = {name: value for name, value in options.items() if name not in cameras}
    return esaac.SensorModel(sensor, **own), {name: options[name] for name in cameras if name in options}


def _time_ns(data: Any) -> int:
    if not np.isfinite(data.time):
        raise FrameError(f"data.time is {data.time}, expected finite seconds")
    return round(data.time * 1e9)
