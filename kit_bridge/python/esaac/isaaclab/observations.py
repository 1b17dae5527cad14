"""Observation terms. They read what the camera holds, so they may be computed any number of times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch

from esaac.errors import ArgumentError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def event_frame(
    env: Any, sensor_cfg: Any, clip: float | None = None, channels_first: bool = True
) -> torch.Tensor:
    """The number of OFF and of ON events of each pixel in the last environment step.

    A camera that is slower than the environment has no frame in some steps: then all is 0, so that no event is seen
    twice.

    * `env`: the environment, with the camera in its scene.
    * `sensor_cfg`: `SceneEntityCfg("name of the camera")`. Its `data_types` must have `event_frame`.
    * `clip`: the most events that count, at least 0, None for all.
    * `channels_first`: float32 `(num_envs, 2, height, width)`, else `(num_envs, height, width, 2)`.

    Raises `esaac.ArgumentError` if the camera has no such output, or more than one frame an environment step.
    """
    return image(env, sensor_cfg.name, "event_frame", clip, channels_first)


def voxel_grid(
    env: Any, sensor_cfg: Any, clip: float | None = None, channels_first: bool = True
) -> torch.Tensor:
    """Events of the last environment step in bins of time, ON as +1 and OFF as -1, each split between two bins.

    Without a frame in that step all is 0. Arguments and errors are those of `event_frame`. The result is float32
    `(num_envs, voxel_bins, height, width)`, or with the bins last. Values are clipped to -`clip` and `clip`.
    """
    return image(env, sensor_cfg.name, "voxel_grid", clip, channels_first)


def image(env: Any, name: str, output: str, clip: float | None, channels_first: bool) -> torch.Tensor:
    """An output of the camera with this name, as float32; 0 where no frame has come in the last environment step."""
    check_clip(clip)
    # A copy: the camera writes its next frame to its own.
    values: torch.Tensor = held(env, name, output).to(torch.float32, copy=True)
    new = _new(env, name, values.device)
    if new is not None:
        values *= new[:, None, None, None]
    if clip is not None:
        values.clamp_(-clip, clip)
    return values.permute(0, 3, 1, 2) if channels_first else values


def rows(env: Any, name: str) -> tuple[torch.Tensor, torch.Tensor]:
    """Events and their offsets, of the frames that have come in the last environment step."""
    events, offsets = held(env, name, "events"), held(env, name, "events_offsets")
    new = _new(env, name, events.device)
    if new is None:
        return events.clone(), offsets.clone()
    counts = offsets.diff()
    kept = offsets.clone()
    kept[1:] = (counts * new).cumsum(0)
    return events[new.repeat_interleave(counts)], kept


def check_clip(clip: float | None) -> None:
    """Fails if `clip` is no limit."""
    if clip is not None and not clip >= 0:
        raise ArgumentError(f"clip is {clip}, expected a number of at least 0, or None")


def _new(env: Any, name: str, device: Any) -> torch.Tensor | None:
    """Which environments have had a frame in the last environment step; None for all."""
    new: NDArray[np.bool_] = env.scene.sensors[name].frames_within(env.step_dt)
    return None if new.all() else torch.from_numpy(new).to(device)


def held(env: Any, name: str, output: str) -> torch.Tensor:
    """What the camera with this name holds, of each environment's last frame. This draws frames that are due."""
    camera = env.scene.sensors[name]
    period_s, step_s = camera.frame_period_s, env.step_dt
    if period_s < step_s * (1 - 1e-6):
        raise ArgumentError(
            f"camera `{name}` has a frame every {period_s:g} s and the environment steps every "
            f"{step_s:g} s, so events of frames in between would be lost; set the camera's update_period to "
            f"{step_s:g}, since events follow every physics step all the same"
        )
    outputs = camera.data.output
    if output not in outputs:
        raise ArgumentError(
            f"camera `{name}` has the outputs {sorted(outputs)}, expected `{output}`; add it to data_types"
        )
    values: torch.Tensor = outputs[output].torch
    return values
