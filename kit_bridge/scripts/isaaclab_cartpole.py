"""A cart-pole that is balanced from events alone, trained with RSL-RL in Isaac Lab.

    python kit_bridge/scripts/isaaclab_cartpole.py --envs 512 --device cuda:0 --json curve.json
    python kit_bridge/scripts/isaaclab_cartpole.py --input frames --json curve_frames.json

Needs Isaac Lab 3 with Newton physics and `rsl-rl-lib` 5. The script writes the robot as USD. The policy sees images
of events only: those of the last step, and three memories that forget them at different rates, so that what stands
still for a moment is not lost. `--input frames` trains the same network on as many grey frames. The critic, which is
used in training alone, knows the state.
"""

import argparse
import json
import os
import pathlib
import tempfile
import time

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--envs", type=int, default=512)
PARSER.add_argument("--device", default="cuda:0", help="cuda:N or cpu")
PARSER.add_argument("--input", default="events", choices=["events", "frames"])
PARSER.add_argument("--iterations", type=int, default=200)
PARSER.add_argument("--rollout", type=int, default=32, help="steps of each environment in an iteration")
PARSER.add_argument("--episode-s", type=float, default=5.0)
PARSER.add_argument("--seed", type=int, default=1)
PARSER.add_argument("--json", help="a file for the learning curve")

if __name__ == "__main__":
    # `--help` needs none of the packages below.
    PARSER.parse_args()

# RSL-RL imports GitPython, which needs no git here.
os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")

import isaaclab.sim as sim_utils
import torch
from isaaclab.actuators import ImplicitActuatorCfg
from isaaclab.app import launch_simulation
from isaaclab.assets import ArticulationCfg, AssetBaseCfg
from isaaclab.envs import DirectRLEnv, DirectRLEnvCfg
from isaaclab.scene import InteractiveSceneCfg
from isaaclab.sensors import CameraCfg
from isaaclab.sim import SimulationCfg
from isaaclab.sim.spawners.sensors.sensors_cfg import PinholeCameraCfg
from isaaclab.utils import configclass
from isaaclab_newton.physics import MJWarpSolverCfg, NewtonCfg
from isaaclab_rl.rsl_rl import RslRlVecEnvWrapper
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from esaac.isaaclab import EventCameraCfg, EventReading

PHYSICS_HZ, FRAME_HZ, SIZE_PX = 240, 60, 64
KEPT = (0.5, 0.8, 0.95)
"""What each memory keeps of its events from one step to the next."""
CHANNELS = 1 + len(KEPT)
FURTHEST_M, STEEPEST_RAD = 1.2, 0.6
"""Where an episode ends: how far the cart may go, and how far the pole may lean."""


def write_cartpole(path):
    """A rail, a cart on it and a pole on the cart, which swings in the plane of x and z."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    robot = UsdGeom.Xform.Define(stage, "/Robot").GetPrim()
    stage.SetDefaultPrim(robot)
    UsdPhysics.ArticulationRootAPI.Apply(robot)
    for name, height_m, size_m, mass_kg, colour in (
        ("rail", 0.0, (3.0, 0.04, 0.04), 1.0, (0.3, 0.3, 0.3)),
        ("cart", 0.0, (0.3, 0.2, 0.16), 1.0, (0.1, 0.15, 0.5)),
        ("pole", 0.5, (0.06, 0.06, 1.0), 0.2, (0.9, 0.75, 0.1)),
    ):
        body = UsdGeom.Xform.Define(stage, f"/Robot/{name}")
        body.AddTranslateOp().Set(Gf.Vec3d(0, 0, height_m))
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        UsdPhysics.MassAPI.Apply(body.GetPrim()).CreateMassAttr(mass_kg)
        box = UsdGeom.Cube.Define(stage, f"/Robot/{name}/box")
        box.CreateSizeAttr(1.0)
        box.AddScaleOp().Set(Gf.Vec3f(*size_m))
        box.CreateDisplayColorAttr([Gf.Vec3f(*colour)])
    fixed = UsdPhysics.FixedJoint.Define(stage, "/Robot/fixed")
    fixed.CreateBody1Rel().SetTargets(["/Robot/rail"])
    slider = UsdPhysics.PrismaticJoint.Define(stage, "/Robot/slider")
    slider.CreateAxisAttr("X")
    slider.CreateLowerLimitAttr(-1.5)
    slider.CreateUpperLimitAttr(1.5)
    hinge = UsdPhysics.RevoluteJoint.Define(stage, "/Robot/hinge")
    hinge.CreateAxisAttr("Y")
    hinge.CreateLocalPos1Attr(Gf.Vec3f(0, 0, -0.5))
    for joint, first, second in ((slider, "rail", "cart"), (hinge, "cart", "pole")):
        joint.CreateBody0Rel().SetTargets([f"/Robot/{first}"])
        joint.CreateBody1Rel().SetTargets([f"/Robot/{second}"])
    stage.Save()


@configclass
class SceneCfg(InteractiveSceneCfg):
    wall = AssetBaseCfg(
        prim_path="{ENV_REGEX_NS}/Wall",
        init_state=AssetBaseCfg.InitialStateCfg(pos=(0, 1.0, 1.5)),
        spawn=sim_utils.CuboidCfg(
            size=(4.0, 0.1, 4.0),
            visual_material=sim_utils.PreviewSurfaceCfg(diffuse_color=(0.4, 0.4, 0.45)),
        ),
    )
    robot = ArticulationCfg(
        prim_path="{ENV_REGEX_NS}/Robot",
        spawn=sim_utils.UsdFileCfg(),
        init_state=ArticulationCfg.InitialStateCfg(pos=(0, 0, 1.0), joint_pos={"slider": 0.0, "hinge": 0.0}),
        actuators={
            "cart": ImplicitActuatorCfg(joint_names_expr=["slider"], stiffness=0.0, damping=1.0),
            "pole": ImplicitActuatorCfg(joint_names_expr=["hinge"], stiffness=0.0, damping=0.0),
        },
    )
    camera = EventCameraCfg(
        prim_path="{ENV_REGEX_NS}/Camera",
        # It looks along y, with x to the right and z up.
        offset=CameraCfg.OffsetCfg(
            pos=(0, -3.4, 1.4), rot=(0.70710678, 0, 0, 0.70710678), convention="opengl"
        ),
        spawn=PinholeCameraCfg(focal_length=24.0, clipping_range=(0.01, 20.0)),
        update_period=1 / FRAME_HZ,
        width=SIZE_PX,
        height=SIZE_PX,
        sensor="dvs128",
        profile="clean",
        parameters={"contrast_on": 0.2, "contrast_off": 0.2},
        antialiasing=2,
    )


@configclass
class CartPoleCfg(DirectRLEnvCfg):
    decimation: int = PHYSICS_HZ // FRAME_HZ
    episode_length_s: float = 5.0
    action_space: int = 1
    observation_space: list[int] = [CHANNELS, SIZE_PX, SIZE_PX]
    state_space: int = 0
    sim: SimulationCfg = SimulationCfg(dt=1 / PHYSICS_HZ, use_newton_actuators=False)
    scene: SceneCfg = SceneCfg(num_envs=1, env_spacing=8.0)
    force_n: float = 10.0
    """Of an action of 1."""


class CartPole(EventReading, DirectRLEnv):
    """Observations are images `(num_envs, CHANNELS, SIZE_PX, SIZE_PX)` for the actor, the state for the critic."""

    def __init__(self, cfg):
        super().__init__(cfg)
        self.robot, self.camera = self.scene["robot"], self.scene["camera"]
        self._joints = _joints(self.robot)
        self._pushed = torch.tensor(self._joints[:1], device=self.device)
        shape = (self.num_envs, CHANNELS, SIZE_PX, SIZE_PX)
        self._frames = torch.zeros(shape, device=self.device)
        self._begun = torch.ones(self.num_envs, dtype=torch.bool, device=self.device)
        self._drawn = self.camera.frame_counts.copy()
        self.ended = self.survived = self.ended_steps = 0

    @property
    def state(self):
        """Places and speeds of cart and pole: m, rad, m/s, rad/s."""
        data = self.robot.data
        return torch.cat(
            [data.joint_pos.torch[:, self._joints], data.joint_vel.torch[:, self._joints]], dim=1
        )

    def _pre_physics_step(self, actions):
        self._force_n = self.cfg.force_n * actions.clamp(-1, 1)

    def _apply_action(self):
        self.robot.actuators.target_command.set_effort_index(value=self._force_n, joint_ids=self._pushed)

    def _get_observations(self):
        output = self.camera.data.output
        if "event_frame" in output:
            images = self.event_memory("camera", kept=(0.0, *KEPT), clip=4) / 2
        else:
            images = self._last_frames(output["rgb_hdr"].torch.mean(dim=-1) * 2 - 1)
        return {"policy": images, "critic": self.state}

    def _last_frames(self, image):
        """The newest first. An episode begins with its first frame in each place."""
        new = torch.from_numpy(self.camera.frame_counts != self._drawn).to(self.device)
        rows = lambda envs: envs[:, None, None, None]
        earlier = torch.where(rows(self._begun), image[:, None], self._frames[:, :-1])
        frames = torch.cat([image[:, None], earlier], dim=1)
        # Reading twice must not count twice.
        self._frames = torch.where(rows(new), frames, self._frames)
        self._begun = self._begun & ~new
        self._drawn = self.camera.frame_counts.copy()
        return self._frames

    def _get_rewards(self):
        place, lean, _, turning = self.state.unbind(dim=1)
        upright = 1 - (lean / STEEPEST_RAD) ** 2
        return (upright - 0.2 * place**2 - 0.01 * turning**2 - 5.0 * self.reset_terminated) * self.step_dt

    def _get_dones(self):
        place, lean, _, _ = self.state.unbind(dim=1)
        late = self.episode_length_buf >= self.max_episode_length - 1
        return (place.abs() > FURTHEST_M) | (lean.abs() > STEEPEST_RAD), late

    def _reset_idx(self, env_ids):
        envs = torch.as_tensor(env_ids, device=self.device)
        steps = int(self.episode_length_buf[envs].sum())
        super()._reset_idx(env_ids)
        if hasattr(self, "_begun"):
            self.ended += len(envs)
            self.ended_steps += steps
            self.survived += int((self.reset_time_outs & ~self.reset_terminated)[envs].sum())
            self._begun[envs] = True
        draw = lambda most: most * (2 * torch.rand(len(envs), 1, device=self.device) - 1)
        robot = self.scene["robot"]
        joints = _joints(robot)
        places, speeds = (
            values.torch[envs].clone()
            for values in (robot.data.default_joint_pos, robot.data.default_joint_vel)
        )
        places[:, joints] = torch.cat([draw(0.3), draw(0.15)], dim=1)
        speeds[:, joints] = torch.cat([draw(0.3), draw(0.5)], dim=1)
        robot.write_joint_position_to_sim_index(position=places, env_ids=envs)
        robot.write_joint_velocity_to_sim_index(velocity=speeds, env_ids=envs)


def _joints(robot):
    """Numbers of the cart's joint and the pole's."""
    return [robot.find_joints(name)[0][0] for name in ("slider", "hinge")]


def training_cfg(given):
    """PPO of RSL-RL, with a small convolutional network."""
    layers = {
        "output_channels": [16, 32, 32],
        "kernel_size": [5, 3, 3],
        "stride": [2, 2, 2],
        "activation": "relu",
    }
    return {
        "seed": given.seed,
        "num_steps_per_env": given.rollout,
        "save_interval": 10**9,
        "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
        "actor": {
            "class_name": "CNNModel",
            "cnn_cfg": layers,
            "hidden_dims": [128],
            "activation": "elu",
            "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0, "std_type": "scalar"},
        },
        "critic": {"class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "elu"},
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": 4,
            "num_mini_batches": 8,
            "learning_rate": 5e-4,
            "schedule": "adaptive",
            "gamma": 0.99,
            "lam": 0.95,
            "entropy_coef": 0.002,
            "desired_kl": 0.01,
            "max_grad_norm": 1.0,
            "value_loss_coef": 1.0,
            "use_clipped_value_loss": True,
            "clip_param": 0.2,
        },
    }


def train(env, given):
    """The learning curve, and how many episodes the policy without noise survives."""
    # Imported late: it is needed only here.
    from rsl_rl.runners import OnPolicyRunner

    wrapped = RslRlVecEnvWrapper(env, clip_actions=1.0)
    runner = OnPolicyRunner(wrapped, training_cfg(given), log_dir=None, device=given.device)
    curve, started = [], time.perf_counter()
    for iteration in range(given.iterations):
        env.ended = env.survived = env.ended_steps = 0
        runner.learn(1, init_at_random_ep_len=iteration == 0)
        runner.current_learning_iteration = iteration + 1
        curve.append(
            {
                "iteration": iteration,
                "seconds": time.perf_counter() - started,
                "environment_steps": (iteration + 1) * given.rollout * env.num_envs,
                "episode_s": env.ended_steps * env.step_dt / env.ended if env.ended else None,
                "survived": env.survived / env.ended if env.ended else None,
            }
        )
        print(json.dumps(curve[-1]), flush=True)
    return {
        "input": given.input,
        "environments": env.num_envs,
        "curve": curve,
        **judged(env, wrapped, runner),
    }


def judged(env, wrapped, runner):
    """The first episode of each environment, acted by the policy's mean."""
    policy = runner.get_inference_policy(device=env.device)
    steps = int(env.max_episode_length)
    with torch.inference_mode():
        observations, _ = wrapped.reset()
        upright = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
        for _ in range(steps):
            observations, _, done, extras = wrapped.step(policy(observations))
            upright &= ~(done.bool() & ~extras["time_outs"].bool())
    return {"judged_survived": float(upright.float().mean()), "judged_s": steps * env.step_dt}


def main():
    given = PARSER.parse_args()
    torch.manual_seed(given.seed)
    with tempfile.TemporaryDirectory() as folder:
        robot = pathlib.Path(folder) / "cartpole.usd"
        write_cartpole(robot)
        cfg = CartPoleCfg()
        cfg.seed, cfg.episode_length_s = given.seed, given.episode_s
        cfg.scene.num_envs, cfg.sim.device = given.envs, given.device
        cfg.sim.physics = NewtonCfg(
            solver_cfg=MJWarpSolverCfg(), use_cuda_graph=given.device.startswith("cuda")
        )
        cfg.scene.robot.spawn.usd_path = str(robot)
        cfg.scene.camera.data_types = ["event_frame" if given.input == "events" else "rgb_hdr"]
        with launch_simulation(cfg, {"headless": True, "device": given.device}):
            env = CartPole(cfg)
            told = train(env, given)
            env.close()
    print(json.dumps({name: value for name, value in told.items() if name != "curve"}))
    if given.json:
        pathlib.Path(given.json).write_text(json.dumps(told, indent=2))


if __name__ == "__main__":
    main()
