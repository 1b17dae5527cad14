"""The event camera of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from isaaclab.sensors import Camera
from isaaclab.sim import SimulationContext
from isaaclab_newton.physics import NewtonCfg, NewtonManager

from esaac import ArgumentError, Intrinsics, SensorModel, TiledEventCamera
from esaac.checks import indices_of, indices_of_mask
from esaac.isaaclab.cfg import EVENT_TYPES, EventRendererCfg
from esaac.isaaclab.outputs import Outputs
from esaac.isaaclab.schedule import Schedule
from esaac.newton.bodies import WorldBodies
from esaac.newton.mounts import Mounts
from esaac.newton.view import View
from esaac.on_warp import Frames, SubstepLog
from esaac.on_warp.substeps import Asked
from esaac.srgb import linear_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from esaac.isaaclab.cfg import EventCameraCfg


class EventCamera(Camera):
    """The sensor that an `EventCameraCfg` makes; `env.scene["name"]` in an environment.

    `data.output` has what `EventCameraCfg.data_types` asks for, of each environment's last frame. `events` is the
    `esaac.TiledEventCamera`, with `statistics` and `memory()`; None before the simulation plays. `frame_counts` and
    `episode_counts` say how many frames and resets each environment has had, and `held_counts` how many frames it has
    missed because its poses were not finite.

    After a reset the next frame, drawn when the camera is read or updated, is the first of the episode: it has no
    events. If nothing reads the camera before the next physics step, the episode's events begin after that step.

    A camera whose place was set (`set_world_poses`, `set_world_poses_from_view`) is taken to have moved there
    straight and at a steady speed since its last frame, and sends the events of that motion. If it was not moved but
    jumped, `reset` it: then its next frame is a first one.

    An environment with a pose that is not finite has no frame, and the others go on. `esaac.PoseWarning` tells it
    once. Its next frame is a first one.

    Settings without which events would be wrong in silence raise `esaac.ArgumentError`, which names them.
    """

    events: TiledEventCamera | None
    frame_counts: NDArray[np.int64]
    episode_counts: NDArray[np.int64]

    def __init__(self, cfg: EventCameraCfg) -> None:
        _check(cfg)
        self._event_types = [name for name in cfg.data_types if name in EVENT_TYPES]
        images = cfg.copy()
        images.data_types = [name for name in cfg.data_types if name not in EVENT_TYPES]
        self.events = None
        super().__init__(images)
        physics = SimulationContext.instance().cfg.physics
        if not isinstance(physics, NewtonCfg):
            actual = type(physics).__name__
            raise ArgumentError(
                f"physics is a {actual}, expected Newton's; set SimulationCfg(physics=NewtonCfg())"
            )
        # Newton keeps the hook for good, so it must not keep the camera.
        self._record = _Recorder()
        NewtonManager.register_state_force_callback(self._record)

    def __del__(self) -> None:
        recorder = getattr(self, "_record", None)
        if recorder is not None:
            recorder.log = None
        # One that was refused has registered nothing.
        if hasattr(self, "_initialize_handle"):
            super().__del__()

    @property
    def frame_period_s(self) -> float:
        """Seconds between frames, in whole physics steps."""
        return float(self._schedule.period_steps * self._sim_physics_dt)

    @property
    def held_counts(self) -> NDArray[np.int64]:
        """How many frames each environment has missed because its poses were not finite."""
        return self._frames.held_counts.copy()

    def env_numbers(self, env_ids: Any = None) -> NDArray[np.int64]:
        """Numbers of the environments that Isaac Lab names: a list or a tensor of numbers, a mask with a bool for
        each, a slice, or None for all."""
        return _numbers(env_ids, self._num_envs)

    def set_parameters(self, env_ids: Any, values: Mapping[str, Sequence[float]]) -> None:
        """Changes parameters of the sensor in some environments, from their next frame on.

        * `env_ids`: as for `env_numbers`.
        * `values`: for each parameter, by its name in `esaac.SensorModel`, a number for each of these environments.

        Raises `esaac.ArgumentError` for parameters that are no numbers or the same in all environments, and
        `esaac.SensorError` for values out of range. Then nothing has changed."""
        if self.events is None:
            raise ArgumentError(
                "the sensor's parameters are set before the simulation plays, expected it later; in an event term "
                'set mode="reset"'
            )
        numbers, sensors = self.env_numbers(env_ids), self.events.sensors
        for name, given in values.items():
            _check_parameter(sensors[0], name)
            if len(given) != len(numbers):
                raise ArgumentError(
                    f"{len(given)} values of `{name}` for {len(numbers)} environments, expected one for each"
                )
        changed = []
        for index, env in enumerate(numbers):
            sensor = sensors[env]
            own = {name: _value(sensor, name, given[index]) for name, given in values.items()}
            changed.append(sensor.replace(**own))
        for env, sensor in zip(numbers, changed):
            self.events.set_sensor(env, sensor)

    def frames_within(self, seconds: float) -> NDArray[np.bool_]:
        """Which environments have had a frame in the last so many seconds."""
        return self._schedule.since(self._physics_step() - max(1, round(seconds / self._sim_physics_dt)))

    def set_world_poses(
        self, positions: Any = None, orientations: Any = None, env_ids: Any = None, convention: Any = "ros"
    ) -> None:
        """Moves cameras. Arguments are those of Isaac Lab's camera."""
        super().set_world_poses(positions, orientations, env_ids, convention)
        self._begin_again(env_ids)

    def set_world_poses_from_view(self, eyes: Any, targets: Any, env_ids: Any = None) -> None:
        """Moves cameras. Arguments are those of Isaac Lab's camera."""
        super().set_world_poses_from_view(eyes, targets, env_ids)
        self._begin_again(env_ids)

    def _begin_again(self, env_ids: Any) -> None:
        """Episodes whose first frame was drawn just before the camera was moved: another takes its place."""
        envs = np.zeros(self._num_envs, bool)
        envs[self.env_numbers(env_ids)] = True
        envs &= self._schedule.begun_at(self._physics_step())
        if envs.any():
            self._schedule.reset(envs)
            self.frame_counts[envs] -= 1
            self._tell_due()

    def update(self, dt: float, force_recompute: bool = False) -> None:
        """Draws the frames that are due `dt` seconds after the last call. Isaac Lab calls it."""
        if not self._is_initialized:
            return
        self._schedule.check(dt)
        super().update(dt, force_recompute=False)
        self._schedule.advance(self._physics_step())
        self._tell_due()
        # Frames between two reads count too, so none waits for a read.
        self._update_outdated_buffers(force_recompute=True)

    def reset(self, env_ids: Sequence[int] | None = None, env_mask: Any = None) -> None:
        """Begins new episodes. Isaac Lab calls it."""
        if not self._is_initialized:
            # It raises, and says why.
            super().reset(env_ids, env_mask)
        envs = np.zeros(self._num_envs, bool)
        if env_mask is not None:
            envs[indices_of_mask(env_mask, self._num_envs, "environment")] = True
        else:
            envs[self.env_numbers(env_ids)] = True
            # Isaac Lab's camera takes no mask as `env_ids`.
            env_ids = None if env_ids is None else np.flatnonzero(envs).tolist()
        super().reset(env_ids, env_mask)
        self._schedule.reset(envs)
        self._outputs.forget(envs)
        self.episode_counts[envs] += 1
        self._tell_due()

    def _initialize_impl(self) -> None:
        super()._initialize_impl()
        self._tell_due()

    def _create_buffers(self) -> None:
        count, (height, width) = self._num_envs, self.image_shape
        self._schedule = Schedule(count, self.cfg.update_period, self._sim_physics_dt)
        self.frame_counts, self.episode_counts = (np.zeros(count, np.int64) for _ in range(2))
        model = NewtonManager.get_model()
        self._bodies = WorldBodies(model)
        # Newton's manager does not know its own substep yet.
        self._substeps = SimulationContext.instance().cfg.physics.num_substeps
        # The physics step of the last frame, and the substeps that there had been then.
        self._read_at = (self._physics_step(), 0)
        substep_s = self._sim_physics_dt / self._substeps
        limit = max(64, 4 * self._substeps * self._schedule.period_steps)
        advice = "call scene.update after each physics step, or reset the camera"
        begun = self._physics_step() * self._substeps
        self._log = self._record.log = SubstepLog(model, substep_s, limit, advice, begun)
        # Where each camera was at its last frame, in the axes of its body.
        self._places: NDArray[np.float64] | None = None
        # The renderer asks for it before the matrix is known.
        self._render_data.view = _Pending
        super()._create_buffers()
        lens = Intrinsics.from_matrix(self._data.intrinsic_matrices.torch[0], half_pixel_centres=True)
        self._render_data.view = View(
            model,
            self._bodies,
            lens,
            width,
            height,
            antialiasing=self.cfg.antialiasing,
            background=linear_of(self.cfg.background_color).tolist(),
        )
        on_gpu = {"device": str(self._device), "packets": "cuda"} if model.device.is_cuda else {}
        if self.events is not None:
            self.events.close()
        self.events = TiledEventCamera(_sensor(self.cfg), count, intrinsics=lens, **on_gpu)
        self._frames = Frames(self.events, self._log, self._bodies)
        self._outputs = Outputs(self._event_types, count, height, width, self.cfg.voxel_bins, self._device)
        self._publish()

    def _update_buffers_impl(self, env_mask: Any) -> None:
        if not self._schedule.due.any():
            return
        # Bodies that were placed since the last substep are where their joints say.
        NewtonManager.forward()
        self._frames.reset(self._schedule.due & self._schedule.restarts)
        asked = self._ask()
        super()._update_buffers_impl(env_mask)
        self._step(asked)
        self._schedule.done(self._physics_step())

    def _ask(self) -> Asked:
        """Sends for all poses before the frame is drawn: so the host works on them meanwhile."""
        before, substeps = self._read_at
        now = substeps + (self._physics_step() - before) * self._substeps
        due = self._schedule.due & ~self._frames.drawn_at(now)
        places = [one.warp for one in self._view.get_local_poses()]
        return self._frames.ask(due, now, NewtonManager.get_state_0(), [self._view._site_body, *places])

    def _step(self, asked: Asked) -> None:
        """Events of the environments that are due, from the frame that was just drawn."""
        now = asked.now
        self._read_at = (self._physics_step(), now)
        # What has been drawn at this very substep already, and not been reset, has nothing to add.
        due = self._schedule.due & ~self._frames.drawn_at(now)
        if not due.any():
            return
        bodies, positions, turns = asked.others
        places = np.concatenate([positions, turns], axis=1, dtype=np.float64)
        last = self._frames.last
        before = places if self._places is None else np.where(last[:, None] < 0, places, self._places)
        mounts = Mounts(bodies, places, before, last)
        poses = self._frames.poses(due, now, NewtonManager.get_state_0(), mounts, asked)
        held = self._frames.hold(due, now, poses)
        if held.any():
            self._schedule.restarts[held] = False
            self._outputs.forget(held)
            due &= ~held
        if due.any():
            packet = self._frames.step(due, now, self._render_data.view, poses, self._render_data.averaged)
            self._outputs.update(packet, self.events, due)
        self._places = np.where(due[:, None], places, before)
        self.frame_counts[due] += 1
        self._publish()

    def _physics_step(self) -> int:
        return round(NewtonManager.get_simulation_time() / self._sim_physics_dt)

    def _tell_due(self) -> None:
        """Isaac Lab's own flags follow the schedule."""
        self._is_outdated.assign(self._schedule.due)
        self._data_dirty = True

    def _publish(self) -> None:
        self._data._output.update(self._outputs.arrays)
        self._data.info.update(dict.fromkeys(self._outputs.arrays))


class _Recorder:
    """What Newton calls before every substep."""

    log: SubstepLog | None = None

    def __call__(self, state: Any) -> None:
        if self.log is not None:
            self.log.record(state)


class _Pending:
    """Stands for a view that is made later."""


def _check(cfg: EventCameraCfg) -> None:
    """Settings without which events would be wrong in silence."""
    if not isinstance(cfg.renderer_cfg, EventRendererCfg):
        actual = type(cfg.renderer_cfg).__name__
        raise ArgumentError(f"renderer_cfg is a {actual}, expected an esaac.isaaclab.EventRendererCfg")
    if cfg.background_color is None:
        raise ArgumentError(
            "background_color is None, expected a colour: what no ray hits would be black, and every edge before it "
            "of endless contrast"
        )
    if not cfg.update_latest_camera_pose:
        raise ArgumentError(
            "update_latest_camera_pose is False, expected True: else a camera does not follow its link"
        )
    if cfg.spawn is not None and (cfg.spawn.distortion is not None or "Fisheye" in type(cfg.spawn).__name__):
        raise ArgumentError(
            "spawn has a distorted or fisheye lens, expected a PinholeCameraCfg without distortion"
        )


def _sensor(cfg: EventCameraCfg) -> SensorModel:
    sensor = SensorModel.from_toml(cfg.sensor) if "\n" in cfg.sensor else SensorModel(cfg.sensor)
    return sensor.replace(profile=cfg.profile, width=cfg.width, height=cfg.height, **cfg.parameters)


def _check_parameter(sensor: SensorModel, name: str) -> None:
    """Fails if a parameter is no number, or if all environments share it."""
    numbers = [
        known
        for known, _, _ in SensorModel.parameters()
        if known not in ("width", "height") and type(getattr(sensor, known)) in (int, float)
    ]
    if name not in numbers:
        raise ArgumentError(
            f"`{name}` cannot differ from environment to environment, expected one of {', '.join(numbers)}"
        )


def _value(sensor: SensorModel, name: str, value: float) -> float:
    """Rounded, if the parameter is an integer."""
    return round(value) if isinstance(getattr(sensor, name), int) else float(value)


def _numbers(env_ids: Any, count: int) -> NDArray[np.int64]:
    """Environments that Isaac Lab names: by numbers of any library, a mask, a slice, or None for all."""
    if env_ids is None or isinstance(env_ids, slice):
        return np.arange(count)[slice(None) if env_ids is None else env_ids]
    return np.array(indices_of(env_ids, count, "environment"), np.int64)
