"""Event cameras of a Newton model, one in each world."""

import numpy as np
import warp as wp
from newton.sensors import SensorTiledCamera

from esaac.cameras import TiledEventCamera
from esaac.errors import ArgumentError
from esaac.newton.bodies import WorldBodies
from esaac.newton.substeps import Mounts, SubstepLog
from esaac.newton.view import View
from esaac.poses import Intrinsics


class EventCameras:
    def __init__(
        self,
        model,
        sensor=None,
        *,
        substep_s,
        intrinsics,
        places,
        bodies=-1,
        tiled_camera=None,
        antialiasing=3,
        background=(0.5, 0.5, 0.5),
        limit=256,
        **options,
    ):
        worlds = model.world_count
        self._model = model
        if tiled_camera is None:
            config = SensorTiledCamera.RenderConfig(enable_textures=True, enable_backface_culling=False)
            tiled_camera = SensorTiledCamera(model, default_render_config=config)
            tiled_camera.utils.create_default_light(enable_shadows=False)
        self._tiled_camera = tiled_camera
        places = np.asarray(places, np.float64)
        if places.shape not in ((7,), (worlds, 7)):
            raise ArgumentError(f"places have shape {places.shape}, expected (7,) or ({worlds}, 7)")
        bodies = np.broadcast_to(np.asarray(bodies), (worlds,))
        self._mounts = Mounts(bodies, np.broadcast_to(places, (worlds, 7)))
        self._lens = Intrinsics.of(intrinsics)
        device = {} if not model.device.is_cuda else {"device": str(model.device), "packets": "cuda"}
        self.events = TiledEventCamera(sensor, worlds, intrinsics=self._lens, **{**device, **options})
        width, height = self.events.sensor.width, self.events.sensor.height
        self._log = SubstepLog(model, substep_s, limit)
        self._bodies = WorldBodies(model)
        self.view = View(
            model, self._bodies, self._lens, width, height, antialiasing=antialiasing, background=background
        )
        self._last = np.full(worlds, -1, np.int64)

    def record(self, state):
        self._log.record(state)

    def step(self, state, worlds=None):
        now = self._log.substeps()
        stepped = _chosen(worlds, len(self._last))
        late = stepped & (self._last == now)
        if late.any():
            raise ArgumentError(
                f"world {np.flatnonzero(late)[0]} has had its frame at substep {now}, expected record() in between"
            )
        first = np.where(self._last < 0, now, self._last)[stepped].min(initial=now)
        poses = self._log.poses(first, now, state, self._bodies, self._mounts)
        self._draw(state, poses.camera[-1])
        t_ns = self._log.time_ns(now)
        times = t_ns if stepped.all() else [t_ns if one else None for one in stepped]
        view, stream = self.view, stream_of(self._model.device)
        packet = self.events.step(
            view.colour, t_ns=times, depth=view.depth, ids=view.ids, poses=poses, stream=stream
        )
        self._last[stepped] = now
        return packet

    def reset(self, worlds=None):
        chosen = _chosen(worlds, len(self._last))
        self.events.reset(np.flatnonzero(chosen))
        self._last[chosen] = -1

    def close(self):
        self.events.close()

    def _draw(self, state, cameras):
        self._model.bvh_refit_shapes(state)
        self._model.bvh_refit_particles(state)
        transforms = wp.array(cameras[None], dtype=wp.transformf, device=self._model.device)
        self.view.draw(self._tiled_camera, state, transforms)


def stream_of(device):
    """The stream in which Warp draws, for `step`; None on the host."""
    return wp.get_stream(device).cuda_stream if device.is_cuda else None


def _chosen(worlds, count):
    chosen = np.zeros(count, bool)
    chosen[slice(None) if worlds is None else np.asarray(worlds, np.int64)] = True
    return chosen
