"""Images of events that fade from step to step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from esaac.errors import ArgumentError
from esaac.isaaclab.observations import check_clip, held

if TYPE_CHECKING:
    from numpy.typing import NDArray


class EventMemory:
    """Of one camera. Each of its frames counts once, however often it is read."""

    def __init__(self, camera: str, kept: tuple[float, ...], clip: float | None) -> None:
        check_clip(clip)
        self._camera, self._kept, self._clip = camera, kept, clip
        self._images: torch.Tensor | None = None
        self._frames: NDArray[np.int64] | None = None
        self._episodes: NDArray[np.int64] | None = None

    def read(self, env: Any) -> torch.Tensor:
        """Images `(num_envs, channels, height, width)`, with the environment's last step."""
        counts = held(env, self._camera, "event_frame").float()
        camera = env.scene.sensors[self._camera]
        frames, episodes = camera.frame_counts, camera.episode_counts
        if self._images is None or self._frames is None or self._episodes is None:
            count, height, width, _ = counts.shape
            self._images = torch.zeros((count, len(self._kept), height, width), device=counts.device)
            self._frames, self._episodes = frames - 1, episodes.copy()
        self._check((frames - self._frames) * (episodes == self._episodes))
        image = counts[..., 1] - counts[..., 0]
        if self._clip is not None:
            image = image.clamp(-self._clip, self._clip)
        begun = _rows(episodes != self._episodes, image.device)
        new = _rows(frames != self._frames, image.device)
        # New tensors: those of inference mode must not be written to outside of it.
        images = torch.where(begun, torch.zeros_like(self._images), self._images)
        shares = torch.tensor(self._kept, dtype=torch.float32, device=image.device)[:, None, None]
        self._images = torch.where(new, shares * images + image[:, None], images)
        self._frames, self._episodes = frames.copy(), episodes.copy()
        return self._images.clone()

    def _check(self, new: NDArray[np.int64]) -> None:
        """Fails if an episode has had more than one frame since the last call."""
        if (new > 1).any():
            env = int(np.flatnonzero(new > 1)[0])
            raise ArgumentError(
                f"camera `{self._camera}` has drawn {new[env]} frames of environment {env} since its memory was "
                "read, expected 1: read it in every environment step. It goes on when these environments are reset"
            )


def shares_of(kept: Sequence[float]) -> tuple[float, ...]:
    """What each channel keeps, as numbers."""
    try:
        shares = tuple(float(share) for share in kept)
    except (TypeError, ValueError):
        shares = ()
    if not shares or not all(0 <= share <= 1 for share in shares):
        raise ArgumentError(f"kept is {kept!r}, expected shares from 0 to 1, one for each channel")
    return shares


def _rows(envs: NDArray[np.bool_], device: Any) -> torch.Tensor:
    return torch.from_numpy(envs).to(device)[:, None, None, None]
