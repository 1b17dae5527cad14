"""How many environment steps a second Isaac Lab makes with event cameras, and what they cost.

    python kit_bridge/scripts/isaaclab_bench.py --envs 1024 --device cuda:0 --json bench.json

Needs Isaac Lab 3 with Newton physics. In each environment a box is thrown before a camera. The same environments are
stepped three times: with physics alone, with the images drawn that event cameras need, and with events. The
differences are what rendering and events cost. `--check-steps` makes more steps with events, and tells how much
memory grew over them, after each tenth.
"""

import argparse
import json
import resource
import time

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--envs", type=int, default=64)
PARSER.add_argument("--size", type=int, default=64, help="width and height of each camera, pixels")
PARSER.add_argument("--device", default="cuda:0", help="cuda:N or cpu")
PARSER.add_argument("--steps", type=int, default=60)
PARSER.add_argument("--warmup", type=int, default=10)
PARSER.add_argument("--check-steps", type=int, default=0)
PARSER.add_argument("--antialiasing", type=int, default=3)
PARSER.add_argument("--profile", default="noisy", choices=["clean", "noisy", "paper"])
PARSER.add_argument("--no-graph", action="store_true", help="physics without a CUDA graph")
PARSER.add_argument("--json", help="a file for the result")

if __name__ == "__main__":
    # `--help` needs none of the packages below.
    PARSER.parse_args()

import isaaclab.envs.mdp as mdp
import isaaclab.sim as sim_utils
import torch
import warp as wp
from isaaclab.app import launch_simulation
from isaaclab.assets import AssetBaseCfg, RigidObjectCfg
from isaaclab.envs import ManagerBasedEnv, ManagerBasedEnvCfg
from isaaclab.managers import EventTermCfg, ObservationGroupCfg, ObservationTermCfg, SceneEntityCfg
from isaaclab.scene import InteractiveSceneCfg
from isaaclab.sensors import CameraCfg
from isaaclab.sim import SimulationCfg
from isaaclab.sim.spawners.materials import RigidBodyMaterialBaseCfg
from isaaclab.sim.spawners.sensors.sensors_cfg import PinholeCameraCfg
from isaaclab.utils import configclass
from isaaclab.utils.math import create_rotation_matrix_from_view, quat_from_matrix
from isaaclab_newton.physics import MJWarpSolverCfg, NewtonCfg

import esaac
from esaac.isaaclab import EventCameraCfg, event_frame

PHYSICS_HZ, FRAME_HZ = 240, 30
EYE, TARGET = (2.2, -2.2, 1.6), (0.0, 0.0, 0.5)


def looking(eye, target):
    view = create_rotation_matrix_from_view(torch.tensor([eye]), torch.tensor([target]), up_axis="Z")
    return tuple(quat_from_matrix(view)[0].tolist())


def cuboid(size, colour, **more):
    surface = sim_utils.PreviewSurfaceCfg(diffuse_color=colour)
    solid = sim_utils.UsdPhysicsCollisionCfg()
    return sim_utils.CuboidCfg(size=size, collision_props=solid, visual_material=surface, **more)


@configclass
class SceneCfg(InteractiveSceneCfg):
    floor = AssetBaseCfg(
        prim_path="{ENV_REGEX_NS}/Floor",
        init_state=AssetBaseCfg.InitialStateCfg(pos=(0, 0, -0.05)),
        spawn=cuboid((3.0, 3.0, 0.1), (0.35, 0.35, 0.4)),
    )
    box = RigidObjectCfg(
        prim_path="{ENV_REGEX_NS}/Box",
        init_state=RigidObjectCfg.InitialStateCfg(pos=(0, 0, 0.9)),
        spawn=cuboid(
            (0.5, 0.4, 0.3),
            (0.8, 0.2, 0.1),
            rigid_props=sim_utils.UsdPhysicsRigidBodyCfg(),
            mass_props=sim_utils.MassCfg(mass=1.0),
            physics_material=RigidBodyMaterialBaseCfg(),
        ),
    )
    camera = EventCameraCfg(
        prim_path="{ENV_REGEX_NS}/Camera",
        offset=CameraCfg.OffsetCfg(pos=EYE, rot=looking(EYE, TARGET), convention="opengl"),
        spawn=PinholeCameraCfg(focal_length=18.0, clipping_range=(0.01, 30.0)),
        update_period=1 / FRAME_HZ,
        data_types=["events", "event_frame"],
        sensor="dvs128",
    )


@configclass
class ObservationsCfg:
    @configclass
    class PolicyCfg(ObservationGroupCfg):
        frame = ObservationTermCfg(func=event_frame, params={"sensor_cfg": SceneEntityCfg("camera")})

    policy: PolicyCfg = PolicyCfg()


@configclass
class ActionsCfg:
    pass


@configclass
class ThrowCfg:
    throw = EventTermCfg(
        func=mdp.reset_root_state_uniform,
        mode="reset",
        params={
            "pose_range": {"yaw": (-3, 3)},
            "velocity_range": {"x": (-0.5, 0.5), "z": (0.5, 1.5), "roll": (-4, 4), "yaw": (-4, 4)},
            "asset_cfg": SceneEntityCfg("box"),
        },
    )


@configclass
class EnvCfg(ManagerBasedEnvCfg):
    sim: SimulationCfg = SimulationCfg(dt=1 / PHYSICS_HZ, use_newton_actuators=False)
    scene: SceneCfg = SceneCfg(num_envs=1, env_spacing=6.0)
    observations: ObservationsCfg = ObservationsCfg()
    actions: ActionsCfg = ActionsCfg()
    events: ThrowCfg = ThrowCfg()
    decimation: int = PHYSICS_HZ // FRAME_HZ


def configured(given):
    cfg = EnvCfg()
    cfg.sim.device, cfg.scene.num_envs = given.device, given.envs
    graph = given.device.startswith("cuda") and not given.no_graph
    cfg.sim.physics = NewtonCfg(solver_cfg=MJWarpSolverCfg(), use_cuda_graph=graph)
    camera = cfg.scene.camera
    camera.width = camera.height = given.size
    camera.profile, camera.antialiasing = given.profile, given.antialiasing
    return cfg


class Bench:
    """Times of environment steps."""

    EPISODE_STEPS = 20
    """Steps after which all boxes are thrown again."""

    def __init__(self, env, camera):
        self._env, self._camera = env, camera
        self._action = torch.zeros(env.num_envs, env.action_manager.total_action_dim, device=env.device)
        self._made, self.sent = 0, 0

    def step(self):
        if self._made % self.EPISODE_STEPS == 0:
            self._env.reset()
        self._made += 1
        started = time.perf_counter()
        self._env.step(self._action)
        wp.synchronize()
        return time.perf_counter() - started

    def median_s(self, warmup, steps):
        """Of an environment step; throwing the boxes is not counted."""
        self._made = 0
        for _ in range(warmup):
            self.step()
        times, self.sent = [], 0
        for _ in range(steps):
            times.append(self.step())
            self.sent += len(self._camera.data.output["events"].torch)
        return sorted(times)[len(times) // 2]

    def without_events(self):
        """From now on images are drawn, and nothing is made of them."""
        self._camera._ask = self._camera._step = lambda *_: None

    def without_images(self):
        self._camera.update = lambda *_, **__: None
        self._camera._update_buffers_impl = lambda *_: None


def memory_bytes(camera, device):
    """In use: by the event cameras, on the device by everybody, and on the host by this process at most."""
    told = {"events": sum(entry["bytes"] for entry in camera.events.memory())}
    if device.startswith("cuda"):
        free, all_of_it = torch.cuda.mem_get_info(device)
        told["device"] = all_of_it - free
    # Linux counts in KiB.
    told["host_peak"] = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return told


def measure(env, given):
    camera = env.scene["camera"]
    bench, seconds = Bench(env, camera), {}
    seconds["events"] = bench.median_s(given.warmup, given.steps)
    per_step = bench.sent / given.steps / env.num_envs
    statistics = camera.events.statistics
    memory = memory_bytes(camera, given.device)
    grown = {}
    for step in range(1, given.check_steps + 1):
        bench.step()
        if step % max(1, given.check_steps // 10) == 0 or step == given.check_steps:
            after = memory_bytes(camera, given.device)
            grown = {name: after[name] - value for name, value in memory.items()}
            print(f"after {step} steps, growth in bytes:", json.dumps(grown), flush=True)
    bench.without_events()
    seconds["images"] = bench.median_s(given.warmup, given.steps)
    bench.without_images()
    seconds["physics"] = bench.median_s(given.warmup, given.steps)
    parts = {
        "physics": seconds["physics"],
        "rendering": seconds["images"] - seconds["physics"],
        "events": seconds["events"] - seconds["images"],
    }
    return {
        "device": camera.events.device["name"],
        "esaac": esaac.__version__,
        "environments": env.num_envs,
        "size_px": given.size,
        "antialiasing": given.antialiasing,
        "profile": given.profile,
        "steps": given.steps,
        "step_ms": {name: 1e3 * value for name, value in seconds.items()},
        "environment_steps_per_s": {name: env.num_envs / value for name, value in seconds.items()},
        "share": {name: value / seconds["events"] for name, value in parts.items()},
        "events_per_environment_and_step": per_step,
        "host_copies": statistics["host_copies"],
        "memory_bytes": memory,
        "growth_bytes": grown,
        "growth_steps": given.check_steps,
    }


def main():
    given = PARSER.parse_args()
    cfg = configured(given)
    with launch_simulation(cfg, {"headless": True, "device": given.device}):
        env = ManagerBasedEnv(cfg)
        told = measure(env, given)
        env.close()
    for name in ("physics", "images", "events"):
        rate, step_ms = told["environment_steps_per_s"][name], told["step_ms"][name]
        print(f"{name:8} {rate:10.0f} environment steps/s {step_ms:9.2f} ms a step")
    print(json.dumps(told, indent=2))
    if given.json:
        with open(given.json, "w") as file:
            json.dump(told, file, indent=2)


if __name__ == "__main__":
    main()
