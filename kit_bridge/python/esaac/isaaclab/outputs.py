"""What a step's packet becomes for Isaac Lab: tensors on the device that stay until the next frame."""

import numpy as np
import torch
import warp as wp
from isaaclab.utils.warp import ProxyArray

from esaac.isaaclab.cfg import EVENT_TYPES

COLUMNS = ("x", "y", "t_ns", "p")

LISTS = ("events", "event_ids")
"""Outputs that have a row for each event."""


class Outputs:
    """Events of each environment's last frame. Environments that are not stepped keep theirs."""

    def __init__(self, types, count, height, width, bins, device):
        self._types = [name for name in EVENT_TYPES if name in types]
        self._count, self._bins, self._device = count, bins, device
        self.arrays = {}
        shapes = {"event_frame": (2, torch.int32), "voxel_grid": (bins, torch.float32)}
        for name in self._types:
            if name in shapes:
                channels, dtype = shapes[name]
                self._publish(name, torch.zeros((count, height, width, channels), dtype=dtype, device=device))
        self._lists = any(name in LISTS for name in self._types)
        columns = len(COLUMNS) + ("event_ids" in self._types)
        # Events that are kept: columns and, if they are asked for, ids.
        self._events = torch.zeros((0, columns), dtype=torch.int64, device=device)
        self._pack(self._events, self._none())

    def update(self, packet, camera, stepped):
        """Takes over a packet's events; `stepped` says whose they are (NumPy, bool)."""
        rows = None if stepped.all() else torch.from_numpy(stepped).to(self._device)
        if self._lists:
            self._take_events(packet, camera, rows)
        for name in self._types:
            if name in LISTS:
                continue
            new = camera.event_frames() if name == "event_frame" else camera.voxel_grids(self._bins)
            new, kept = _tensor(new).permute(0, 2, 3, 1), self.arrays[name].torch
            kept.copy_(new) if rows is None else kept.copy_(torch.where(rows[:, None, None, None], new, kept))

    def forget(self, envs):
        """Events of an episode that is over."""
        rows = torch.from_numpy(envs).to(self._device)
        if self._lists:
            events, env = self._all_but(rows)
            self._pack(events, torch.bincount(env, minlength=self._count))
        for name in self._types:
            if name not in LISTS:
                self.arrays[name].torch.masked_fill_(rows[:, None, None, None], 0)

    def _take_events(self, packet, camera, rows):
        shape = (len(packet), self._events.shape[1])
        new = torch.empty(shape, dtype=torch.int64, device=self._device)
        for column, name in enumerate(COLUMNS):
            new[:, column] = _tensor(getattr(packet, name))
        if "event_ids" in self._types:
            new[:, len(COLUMNS)] = _tensor(camera.event_ids())
        counts = torch.as_tensor(packet.offsets).diff().to(self._device)
        if rows is None:
            return self._pack(new, counts)
        old, env = self._all_but(rows)
        env = torch.cat(
            [env, torch.repeat_interleave(torch.arange(self._count, device=self._device), counts)]
        )
        order = torch.argsort(env, stable=True)
        self._pack(torch.cat([old, new])[order], torch.bincount(env, minlength=self._count))

    def _all_but(self, rows):
        """Events of the environments that are not in `rows`, and whose they are."""
        counts = self.arrays["events_offsets"].torch.diff()
        env = torch.repeat_interleave(torch.arange(self._count, device=self._device), counts)
        keep = ~rows[env]
        return self._events[keep], env[keep]

    def _pack(self, events, counts):
        if self._lists:
            self._events = events
            offsets = torch.zeros(self._count + 1, dtype=torch.int64, device=self._device)
            torch.cumsum(counts, 0, out=offsets[1:])
            if "events" in self._types:
                self._publish("events", events[:, : len(COLUMNS)])
            if "event_ids" in self._types:
                self._publish("event_ids", events[:, len(COLUMNS)])
            self._publish("events_offsets", offsets)

    def _none(self):
        return torch.zeros(self._count, dtype=torch.int64, device=self._device)

    def _publish(self, name, tensor):
        self.arrays[name] = ProxyArray(wp.from_torch(tensor.contiguous()))


def _tensor(array):
    """A view of a NumPy array or of an `esaac.Tensor`."""
    if not isinstance(array, np.ndarray):
        return torch.from_dlpack(array)
    # torch computes with few of the unsigned types.
    return torch.from_numpy(array.astype("int32") if array.dtype.kind == "u" else array)
