"""A program that uses event cameras for all simulators but Isaac Sim, for a type checker; it is not run."""

from typing import Any

import numpy as np

import esaac
from esaac.isaaclab import (
    EventCamera,
    EventCameraCfg,
    EventReading,
    EventRendererCfg,
    event_frame,
    randomize_sensor,
    voxel_grid,
)
from esaac.mujoco import EventCamera as MujocoCamera
from esaac.mujoco_warp import EventCameras as WarpCameras
from esaac.newton import EventCameras, SubstepLog, View, WorldBodies
from esaac.ovrtx import EventCamera as OvrtxCamera


def newton(model: Any, state: Any) -> None:
    lens = esaac.Intrinsics(60, 60, 32, 24, half_pixel_centres=True)
    place = np.array([0, 0, 1, 0, 0, 0, 1], float)
    cameras = EventCameras(
        model, "dvs128", substep_s=1 / 240, intrinsics=lens, places=place, bodies=[0, 2], width=64, height=48
    )
    cameras.record(state)
    packet: esaac.Packet = cameras.step(state, worlds=[0])
    cameras.reset(worlds=np.array([0]))
    frames = cameras.events.event_frames()
    colour, depth = cameras.view.colour, cameras.view.depth
    cameras.close()
    log, bodies = SubstepLog(model, 1 / 240, limit=64), WorldBodies(model)
    log.record(state)
    t_ns: int = log.time_ns(log.substeps())
    steps, states = log.since(0, log.substeps(), state)
    view = View(model, bodies, (60, 60, 32, 24), 64, 48, antialiasing=2)
    view.draw(None, state, None)
    print(len(packet), frames, colour, depth, t_ns, steps.dtype, bodies.arranged(states).shape)


def mujoco(model: Any, data: Any) -> None:
    with MujocoCamera(model, "eye", "dvs128", antialiasing=1, width=64, height=48, device="cuda:0") as camera:
        camera.record(data)
        packet: esaac.Packet = camera.step(data)
        camera.reset()
        print(len(packet), camera.colour.dtype, camera.depth.shape, camera.ids, camera.events.event_frame())


def mujoco_warp(host_model: Any, model: Any, data: Any) -> None:
    cameras = WarpCameras(
        host_model,
        model,
        data,
        "eye",
        "dvs128",
        substep_s=0.002,
        rendering={"use_shadows": True},
        width=64,
        height=48,
    )
    cameras.record()
    packet: esaac.Packet = cameras.step(worlds=[0])
    cameras.reset(worlds=np.array([0]))
    print(
        len(packet), cameras.view.colour, cameras.view.depth, cameras.view.ids, cameras.events.voxel_grids()
    )
    cameras.close()


def ovrtx(renderer: Any, poses: esaac.PoseRecorder) -> None:
    names = {"HdrColor": "/Render/Camera/colour"}
    with OvrtxCamera("/Render/Camera", "dvs128", intrinsics=(60, 60, 32, 24), variables=names) as camera:
        packet: esaac.Packet = camera.step(renderer.step(), t_ns=0, poses=poses)
        camera.reset()
        print(len(packet), camera.events.statistics)


def isaac_lab(env: Any, entity: Any) -> None:
    cfg = EventCameraCfg(
        prim_path="{ENV_REGEX_NS}/Robot/link/Events",
        width=64,
        height=64,
        update_period=1 / 30,
        sensor="dvs128",
        profile="noisy",
        parameters={"contrast_on": 0.2},
        renderer_cfg=EventRendererCfg(),
    )
    frame = event_frame(env, entity, clip=3, channels_first=False)
    grid = voxel_grid(env, entity)
    camera: EventCamera = env.scene["events"]
    period_s: float = camera.frame_period_s
    if camera.events is not None:
        camera.events.set_sensor(1, camera.events.sensors[0].replace(contrast_on=0.3))
        print(camera.events.statistics)
    camera.set_parameters(None, {"contrast_on": [0.2, 0.3]})
    randomize_sensor(env, None, entity, {"contrast_on": (0.1, 0.3)}, distribution="log_uniform")
    print(cfg, frame.shape, grid.shape, period_s)


class Direct(EventReading):
    def observed(self) -> dict[str, Any]:
        rows, offsets = self.events("camera")
        self.randomize_sensor([0], "camera", {"latency_ns": (0, 1000)})
        return {
            "rows": rows[: offsets[1]],
            "frame": self.event_frame("camera", clip=3),
            "grid": self.voxel_grid("camera", channels_first=False),
            "memory": self.event_memory("camera", kept=(0.0, 0.9), clip=4),
        }
