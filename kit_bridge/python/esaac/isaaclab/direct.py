"""What a direct environment reads of its event cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from esaac.isaaclab.memory import EventMemory, shares_of
from esaac.isaaclab.observations import image, rows
from esaac.isaaclab.randomization import Distribution, randomize

if TYPE_CHECKING:
    import torch


class EventReading:
    """Methods for a `DirectRLEnv` or `DirectMARLEnv` with event cameras in its scene.

        class Balance(EventReading, DirectRLEnv):
            def _get_observations(self):
                return {"policy": self.event_memory("camera", kept=(0, 0.8))}

    `camera` is the camera's name in the scene. A method may be called any number of times in an environment step, and
    gives the same each time, as tensors of the caller's own. A camera that is slower than the environment has no
    frame in some steps: then there are no events, and images are 0, but for those of `event_memory`, which stay as
    they are. All raise `esaac.ArgumentError` if the camera lacks the output that they read, or has more than one
    frame an environment step.
    """

    scene: Any

    def events(self, camera: str) -> tuple[torch.Tensor, torch.Tensor]:
        """Events of the last environment step: int64 `(n, 4)` of x, y [px], t_ns, p (0 OFF, 1 ON), and int64 offsets
        `(num_envs + 1,)`. Environment i has rows `offsets[i]` to `offsets[i + 1]`."""
        return rows(self, camera)

    def event_frame(
        self, camera: str, clip: float | None = None, channels_first: bool = True
    ) -> torch.Tensor:
        """The number of OFF and of ON events of each pixel in the last environment step.

        `clip` is the most events that count, None for all. The result is float32 `(num_envs, 2, height, width)`, or
        with the channels last."""
        return image(self, camera, "event_frame", clip, channels_first)

    def voxel_grid(self, camera: str, clip: float | None = None, channels_first: bool = True) -> torch.Tensor:
        """Events of the last environment step in bins of time, ON as +1 and OFF as -1, each split between two bins.

        Values are clipped to -`clip` and `clip`. The result is float32 `(num_envs, voxel_bins, height, width)`, or
        with the bins last."""
        return image(self, camera, "voxel_grid", clip, channels_first)

    def event_memory(
        self, camera: str, kept: Sequence[float] = (0.0,), clip: float | None = None
    ) -> torch.Tensor:
        """Images of ON minus OFF events that fade: what stands still for a moment is not lost.

        Channel i is the last frame's image plus `kept[i]` of what the channel was before; 0 is the last frame alone.
        `clip` limits a frame's image to -`clip` and `clip`. A reset empties the environment's images. The result is
        float32 `(num_envs, len(kept), height, width)`.

        Call it in every environment step: steps that are left out raise `esaac.ArgumentError`, until the environments
        that have missed frames are reset."""
        # The first call makes them.
        memories: dict[Any, EventMemory] = self.__dict__.setdefault("_event_memories", {})
        kept = shares_of(kept)
        key = camera, kept, clip
        if key not in memories:
            memories[key] = EventMemory(camera, kept, clip)
        return memories[key].read(self)

    def randomize_sensor(
        self,
        env_ids: Any,
        camera: str,
        parameters: Mapping[str, tuple[float, float]],
        distribution: Distribution = "uniform",
    ) -> None:
        """Draws parameters of the sensor for these environments, as `esaac.isaaclab.randomize_sensor` does. The place
        for it is `_reset_idx`."""
        randomize(self.scene.sensors[camera], env_ids, parameters, distribution)
