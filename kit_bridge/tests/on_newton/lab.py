"""An Isaac Lab environment for the tests: a box is thrown before two event cameras, one still and one on the box."""

import isaaclab.envs.mdp as mdp
import isaaclab.sim as sim_utils
import torch
from isaaclab.assets import AssetBaseCfg, RigidObjectCfg
from isaaclab.envs import ManagerBasedEnvCfg
from isaaclab.managers import EventTermCfg, ObservationGroupCfg, ObservationTermCfg, SceneEntityCfg
from isaaclab.scene import InteractiveSceneCfg
from isaaclab.sensors import CameraCfg
from isaaclab.sim import SimulationCfg
from isaaclab.sim.spawners.materials import RigidBodyMaterialBaseCfg
from isaaclab.sim.spawners.sensors.sensors_cfg import PinholeCameraCfg
from isaaclab.utils import configclass
from isaaclab.utils.math import create_rotation_matrix_from_view, quat_from_matrix
from isaaclab_newton.physics import MJWarpSolverCfg, NewtonCfg

from esaac import isaaclab as events

WIDTH, HEIGHT, ENVS, DECIMATION, PHYSICS_S = 48, 36, 3, 8, 1 / 240
EYE, TARGET = (2.2, -2.2, 1.6), (0.0, 0.0, 0.5)


def looking(eye, target):
    view = create_rotation_matrix_from_view(torch.tensor([eye]), torch.tensor([target]), up_axis="Z")
    return tuple(quat_from_matrix(view)[0].tolist())


def cuboid(size, colour, **more):
    surface = sim_utils.PreviewSurfaceCfg(diffuse_color=colour)
    return sim_utils.CuboidCfg(
        size=size, collision_props=sim_utils.UsdPhysicsCollisionCfg(), visual_material=surface, **more
    )


def event_camera(prim, offset, **more):
    settings = {
        "update_period": 1 / 30,
        "width": WIDTH,
        "height": HEIGHT,
        "sensor": "dvs128",
        "data_types": ["events", "event_ids", "event_frame", "voxel_grid", "rgb_hdr"],
        "parameters": {"contrast_on": 0.15, "contrast_off": 0.15},
        "spawn": PinholeCameraCfg(focal_length=18.0, clipping_range=(0.01, 30.0)),
    }
    return events.EventCameraCfg(prim_path="{ENV_REGEX_NS}/" + prim, offset=offset, **{**settings, **more})


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
    still = event_camera("Still", CameraCfg.OffsetCfg(pos=EYE, rot=looking(EYE, TARGET), convention="opengl"))
    mounted = event_camera(
        "Box/Mounted",
        CameraCfg.OffsetCfg(pos=(0.35, 0, 0), rot=(0, 0.3826834, 0, 0.9238795), convention="world"),
        data_types=["event_frame"],
    )


@configclass
class ObservationsCfg:
    @configclass
    class PolicyCfg(ObservationGroupCfg):
        frame = ObservationTermCfg(func=events.event_frame, params={"sensor_cfg": SceneEntityCfg("still")})
        grid = ObservationTermCfg(func=events.voxel_grid, params={"sensor_cfg": SceneEntityCfg("still")})
        concatenate_terms = False

    policy: PolicyCfg = PolicyCfg()


@configclass
class ActionsCfg:
    pass


@configclass
class EventsCfg:
    # The same throw at every reset, so that episodes can be compared.
    throw = EventTermCfg(
        func=mdp.reset_root_state_uniform,
        mode="reset",
        params={
            "pose_range": {"yaw": (0.4, 0.4)},
            "velocity_range": {"x": (0.3, 0.3), "z": (1.2, 1.2), "roll": (3.0, 3.0), "yaw": (4.0, 4.0)},
            "asset_cfg": SceneEntityCfg("box"),
        },
    )


@configclass
class EnvCfg(ManagerBasedEnvCfg):
    sim: SimulationCfg = SimulationCfg(
        device="cpu",
        dt=PHYSICS_S,
        use_newton_actuators=False,
        physics=NewtonCfg(solver_cfg=MJWarpSolverCfg(), use_cuda_graph=False),
    )
    scene: SceneCfg = SceneCfg(num_envs=ENVS, env_spacing=6.0)
    observations: ObservationsCfg = ObservationsCfg()
    actions: ActionsCfg = ActionsCfg()
    events: EventsCfg = EventsCfg()
    decimation: int = DECIMATION
