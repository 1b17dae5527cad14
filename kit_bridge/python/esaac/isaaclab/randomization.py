"""Parameters of sensors that differ from environment to environment, drawn anew at resets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import torch

from esaac.errors import ArgumentError

Distribution = Literal["uniform", "log_uniform"]
"""`log_uniform`: every factor is as likely as any other, for what spans decades."""


def randomize_sensor(
    env: Any,
    env_ids: Any,
    sensor_cfg: Any,
    parameters: Mapping[str, tuple[float, float]],
    distribution: Distribution = "uniform",
) -> None:
    """An event term that draws parameters of an event camera's sensor, for each environment its own.

        sensor = EventTermCfg(
            func=randomize_sensor, mode="reset",
            params={"sensor_cfg": SceneEntityCfg("camera"), "parameters": {"contrast_on": (0.15, 0.3)}},
        )

    * `env`: a manager-based environment, or a direct one with `events` in its configuration.
    * `env_ids`: its environments that are reset; None is all.
    * `sensor_cfg`: `SceneEntityCfg("name of the camera")`.
    * `parameters`: lowest and highest value of each parameter, by its name in `esaac.SensorModel`. Integers, such as
      times in nanoseconds, are rounded.
    * `distribution`: `uniform`, or `log_uniform` for ranges above 0.

    Draws come from torch's generator on the host, so the environment's seed repeats them. Raises
    `esaac.ArgumentError` for what cannot differ between environments, and `esaac.SensorError` for a value out of
    range; then no sensor has changed.
    """
    randomize(env.scene.sensors[sensor_cfg.name], env_ids, parameters, distribution)


def randomize(
    camera: Any, env_ids: Any, parameters: Mapping[str, tuple[float, float]], distribution: Distribution
) -> None:
    """Draws parameters of a camera's sensors for some environments."""
    for name, given in parameters.items():
        try:
            low, high = given
        except (TypeError, ValueError):
            raise ArgumentError(f"the range of `{name}` is {given}, expected two ascending numbers") from None
        if not low <= high or (distribution == "log_uniform" and low <= 0):
            above = ", above 0," if distribution == "log_uniform" else ""
            raise ArgumentError(
                f"the range of `{name}` is {low} to {high}, expected two ascending numbers{above}"
            )
    if distribution not in ("uniform", "log_uniform"):
        raise ArgumentError(f"distribution is `{distribution}`, expected uniform or log_uniform")
    count = len(camera.env_numbers(env_ids))
    values = {name: _draw(low, high, count, distribution) for name, (low, high) in parameters.items()}
    camera.set_parameters(env_ids, values)


def _draw(low: float, high: float, count: int, distribution: str) -> list[float]:
    share = torch.rand(count, dtype=torch.float64)
    if distribution == "uniform":
        drawn: list[float] = (low + (high - low) * share).tolist()
        return drawn
    ends = math.log(low), math.log(high)
    return [min(max(math.exp(at), low), high) for at in (ends[0] + (ends[1] - ends[0]) * share).tolist()]
