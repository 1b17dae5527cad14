"""A quadrotor hovers in gusts with an event camera on its body: published to ROS 2 and recorded.

    python kit_bridge/scripts/isaaclab_quadrotor.py --seconds 4 --device cuda:0 --out flight

Needs Isaac Lab 3 with Newton physics and `h5py`. The script writes the quadrotor and what it flies over as USD. Each
environment has a quadrotor of its own, with topics below `/esaac/quadrotor_N`: events, images, depth, and samples of
an IMU at every physics step. `flight/run.mcap` has all messages, as rosbag2 writes them, and `flight/quadrotor_N.h5`
the events in DSEC's layout.
"""

import argparse
import contextlib
import json
import math
import pathlib
import tempfile
import time

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--envs", type=int, default=1)
PARSER.add_argument("--seconds", type=float, default=2.0)
PARSER.add_argument("--device", default="cuda:0", help="cuda:N or cpu")
PARSER.add_argument("--sensor", default="davis346")
PARSER.add_argument("--size", type=int, nargs=2, help="columns and rows, if other than the sensor's")
PARSER.add_argument("--profile", default="noisy", choices=["clean", "noisy", "paper"])
PARSER.add_argument("--seed", type=int, default=1)
PARSER.add_argument("--out", type=pathlib.Path, default=pathlib.Path("flight"), help="a folder")
PARSER.add_argument("--no-ros", action="store_true", help="only record")
PARSER.add_argument("--wait", metavar="TOPIC", help="fly once this topic has a subscriber")

if __name__ == "__main__":
    # `--help` needs none of the packages below.
    PARSER.parse_args()

import isaaclab.sim as sim_utils
import torch
from isaaclab.app import launch_simulation
from isaaclab.assets import AssetBaseCfg, RigidObjectCfg
from isaaclab.scene import InteractiveScene, InteractiveSceneCfg
from isaaclab.sensors import CameraCfg, ImuCfg
from isaaclab.sim import SimulationCfg, SimulationContext
from isaaclab.sim.spawners.sensors.sensors_cfg import PinholeCameraCfg
from isaaclab.utils import configclass
from isaaclab.utils.math import quat_apply
from isaaclab_newton.physics import MJWarpSolverCfg, NewtonCfg
from pxr import Gf, Usd, UsdGeom, UsdPhysics

import esaac
from esaac import ros
from esaac.isaaclab import EventCameraCfg

PHYSICS_HZ, FRAME_HZ = 240, 30
HEIGHT_M = 1.5
MASS_KG, INERTIA_KG_M2, GRAVITY_M_S2 = 0.8, (0.006, 0.006, 0.011), 9.81
EYE_M, EYE_DOWN = (0.16, 0.0, -0.02), math.radians(35)
"""Where the camera is on the body, and how far it looks down."""


def box(stage, path, size_m, place_m, colour, yaw_deg=0.0):
    cube = UsdGeom.Cube.Define(stage, path)
    cube.CreateSizeAttr(1.0)
    cube.AddTranslateOp().Set(Gf.Vec3d(*place_m))
    cube.AddRotateZOp().Set(yaw_deg)
    cube.AddScaleOp().Set(Gf.Vec3f(*size_m))
    cube.CreateDisplayColorAttr([Gf.Vec3f(*colour)])


def begin_stage(path, root):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    prim = UsdGeom.Xform.Define(stage, root).GetPrim()
    stage.SetDefaultPrim(prim)
    return stage, prim


def write_quadrotor(path):
    """A body with two crossed arms and four rotors: one rigid body, x forward, z up."""
    stage, prim = begin_stage(path, "/Quadrotor")
    UsdPhysics.RigidBodyAPI.Apply(prim)
    mass = UsdPhysics.MassAPI.Apply(prim)
    mass.CreateMassAttr(MASS_KG)
    mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*INERTIA_KG_M2))
    box(stage, "/Quadrotor/body", (0.14, 0.08, 0.05), (0, 0, 0), (0.15, 0.15, 0.17))
    for index, yaw_deg in enumerate((45, 135)):
        box(stage, f"/Quadrotor/arm_{index}", (0.42, 0.02, 0.02), (0, 0, 0.01), (0.2, 0.2, 0.2), yaw_deg)
    for index, (x, y) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        rotor = UsdGeom.Cylinder.Define(stage, f"/Quadrotor/rotor_{index}")
        rotor.CreateRadiusAttr(0.09)
        rotor.CreateHeightAttr(0.01)
        rotor.AddTranslateOp().Set(Gf.Vec3d(0.148 * x, 0.148 * y, 0.03))
        rotor.CreateDisplayColorAttr([Gf.Vec3f(0.7, 0.2, 0.1)])
    stage.Save()


def write_field(path):
    """Blocks of many heights and colours."""
    stage, _ = begin_stage(path, "/Field")
    for i in range(8):
        for j in range(-3, 4):
            height_m = 0.1 + 0.12 * ((3 * i + 5 * j) % 4)
            shade = 0.12 + 0.2 * ((i * i + 2 * j * j) % 5)
            colour = (shade, 0.8 * shade, 1 - shade)
            place_m = (0.5 * i, 0.5 * j, height_m / 2)
            box(stage, f"/Field/block_{i}_{j + 3}", (0.42, 0.42, height_m), place_m, colour)
    stage.Save()


def scene_cfg(given, sensor, folder):
    write_quadrotor(folder / "quadrotor.usd")
    write_field(folder / "field.usd")
    # A turn about y, which is to the left, looks down.
    eye_turn = (0.0, math.sin(EYE_DOWN / 2), 0.0, math.cos(EYE_DOWN / 2))

    @configclass
    class SceneCfg(InteractiveSceneCfg):
        field = AssetBaseCfg(
            prim_path="{ENV_REGEX_NS}/Field", spawn=sim_utils.UsdFileCfg(usd_path=str(folder / "field.usd"))
        )
        quadrotor = RigidObjectCfg(
            prim_path="{ENV_REGEX_NS}/Quadrotor",
            init_state=RigidObjectCfg.InitialStateCfg(pos=(0, 0, HEIGHT_M)),
            spawn=sim_utils.UsdFileCfg(usd_path=str(folder / "quadrotor.usd")),
        )
        camera = EventCameraCfg(
            prim_path="{ENV_REGEX_NS}/Quadrotor/Events",
            offset=CameraCfg.OffsetCfg(pos=EYE_M, rot=eye_turn, convention="world"),
            spawn=lens(),
            update_period=1 / FRAME_HZ,
            width=sensor.width,
            height=sensor.height,
            sensor=sensor.to_toml(),
            data_types=["rgb_hdr", "depth"],
        )
        # In the camera's axes, as ROS has them: x forward, y left, z up.
        imu = ImuCfg(prim_path="{ENV_REGEX_NS}/Quadrotor", offset=ImuCfg.OffsetCfg(pos=EYE_M, rot=eye_turn))

    return SceneCfg(num_envs=given.envs, env_spacing=12.0)


def lens():
    return PinholeCameraCfg(focal_length=18.0, clipping_range=(0.01, 30.0))


class Pilot:
    """Holds a quadrotor of each environment at its place, while gusts turn it."""

    PLACE_PER_S2, SPEED_PER_S = 6.0, 4.0
    TURN_PER_S2, SPIN_PER_S = 160.0, 18.0
    GUST_RAD_S2 = 60.0

    def __init__(self, quadrotor, seed):
        self._quadrotor = quadrotor
        self._target_m = quadrotor.data.root_link_pose_w.torch[:, :3].clone()
        self._device = self._target_m.device
        random = torch.Generator().manual_seed(seed)
        shape = (len(self._target_m), 3, 4)
        self._gusts_hz = (3 + 12 * torch.rand(shape, generator=random)).to(self._device)
        self._phases = (2 * math.pi * torch.rand(shape, generator=random)).to(self._device)

    def act(self, t_s):
        """Thrust along the body's axis, and torques, for the next physics step."""
        pose = self._quadrotor.data.root_link_pose_w.torch
        speed = self._quadrotor.data.root_link_vel_w.torch
        up = torch.tensor([[0.0, 0.0, 1.0]], device=self._device).expand(len(pose), 3)
        axis = quat_apply(pose[:, 3:], up)
        forward = quat_apply(pose[:, 3:], up.roll(1, dims=1))
        wanted = self.PLACE_PER_S2 * (self._target_m - pose[:, :3]) - self.SPEED_PER_S * speed[:, :3]
        wanted = wanted + GRAVITY_M_S2 * up
        thrust_n = MASS_KG * (wanted * axis).sum(dim=1, keepdim=True).clamp(min=0)
        # The axis turns to where thrust is wanted, and x stays forward.
        turn = torch.linalg.cross(axis, wanted / wanted.norm(dim=1, keepdim=True))
        turn = turn - torch.atan2(forward[:, 1], forward[:, 0])[:, None] * up
        spin = self.TURN_PER_S2 * turn - self.SPIN_PER_S * speed[:, 3:]
        waves = torch.sin(2 * math.pi * self._gusts_hz * t_s + self._phases).mean(dim=2)
        inertia = torch.tensor([INERTIA_KG_M2], device=self._device)
        self._quadrotor.instantaneous_wrench_composer.set_forces_and_torques_index(
            forces=(thrust_n * axis)[:, None],
            torques=(inertia * (spin + self.GUST_RAD_S2 * waves))[:, None],
            is_global=True,
        )


def name_of(env):
    return f"quadrotor_{env}"


def fly(sim, scene, given, send):
    """Calls `send` with each frame's time and, by name, what its cameras have."""
    camera, imu = scene["camera"], scene["imu"]
    pilot, step_s = Pilot(scene["quadrotor"], given.seed), sim.get_physics_dt()
    names = [name_of(env) for env in range(given.envs)]
    samples = {name: [] for name in names}
    steps_a_frame = PHYSICS_HZ // FRAME_HZ
    for step in range(round(given.seconds * FRAME_HZ) * steps_a_frame + 1):
        t_ns = round(step * step_s * 1e9)
        if step:
            pilot.act(step * step_s)
            scene.write_data_to_sim()
            sim.step(render=False)
            scene.update(step_s)
            rates, forces = (values.torch.tolist() for values in (imu.data.ang_vel_b, imu.data.lin_acc_b))
            for name, rate, force in zip(names, rates, forces):
                samples[name].append(ros.Imu(t_ns, rate, force))
        if step % steps_a_frame == 0:
            images = camera.data.output
            colours = srgb_bytes(images["rgb_hdr"].torch)
            depths = images["depth"].torch[..., 0]
            packet = camera.events.last_packet
            # A packet of one environment is not split.
            packets = [packet] if given.envs == 1 else [packet[env] for env in range(given.envs)]
            send(
                t_ns,
                {
                    # The first frame ends no interval, so it has no events.
                    name: ros.Frame(
                        packets[env] if step else None, rgb=colours[env], depth=depths[env], imu=samples[name]
                    )
                    for env, name in enumerate(names)
                },
            )
            samples = {name: [] for name in names}


def srgb_bytes(linear):
    linear = linear.clamp(0, 1)
    curved = torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (255 * curved + 0.5).to(torch.uint8)


def main():
    given = PARSER.parse_args()
    sensor = esaac.SensorModel(given.sensor, profile=given.profile)
    if given.size:
        sensor = sensor.replace(width=given.size[0], height=given.size[1])
    focal_px = lens().focal_length / lens().horizontal_aperture * sensor.width
    names = [name_of(env) for env in range(given.envs)]
    cameras = [ros.Camera(name, sensor, focal_px=focal_px, rgb=True, depth=True, imu=True) for name in names]
    given.out.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as open_files:
        writers = {
            name: open_files.enter_context(esaac.EventWriter(given.out / f"{name}.h5", sensor))
            for name in names
        }
        publisher = open_files.enter_context(
            ros.Publisher(cameras, network=not given.no_ros, record=given.out / "run.mcap")
        )
        print("topics:", *publisher.topics, flush=True)
        if given.wait:
            wait_for_subscriber(publisher, given.wait)

        def send(t_ns, frames):
            publisher.publish(t_ns, frames)
            for name, frame in frames.items():
                if frame.packet is not None:
                    writers[name].write(frame.packet)

        folder = pathlib.Path(open_files.enter_context(tempfile.TemporaryDirectory()))
        simulate(given, scene_cfg(given, sensor, folder), send)
        told = {"events": {name: len(writer) for name, writer in writers.items()}}
        told["dropped_ticks"] = publisher.close()["dropped_ticks"]
    print(json.dumps(told))


def wait_for_subscriber(publisher, topic):
    if topic not in publisher.topics:
        raise SystemExit(f"no topic {topic}, expected one of {', '.join(publisher.topics)}")
    while not any(each["topic"] == topic and each["subscribers"] for each in publisher.summary()["topics"]):
        time.sleep(0.1)


def simulate(given, scene, send):
    cuda = given.device.startswith("cuda")
    cfg = SimulationCfg(
        device=given.device,
        dt=1 / PHYSICS_HZ,
        use_newton_actuators=False,
        physics=NewtonCfg(solver_cfg=MJWarpSolverCfg(), use_cuda_graph=cuda),
    )
    with launch_simulation(cfg, {"headless": True, "device": given.device}):
        sim = SimulationContext(cfg)
        try:
            made = InteractiveScene(scene)
            sim.register_interactive_scene(made)
            sim.reset()
            fly(sim, made, given, send)
        finally:
            sim.clear_instance()


if __name__ == "__main__":
    main()
