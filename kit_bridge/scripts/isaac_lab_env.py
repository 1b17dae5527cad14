"""Isaac Lab: an observation of events for every environment, on the GPU from the renderer to the policy.

`EventObservation` is what an environment needs: give it a `TiledCamera` and read voxel grids. The environment below
is Isaac Lab's cart-pole seen by event cameras.

    ./isaaclab.sh -p kit_bridge/scripts/isaac_lab_env.py --num_envs 256 --headless --enable_cameras

Not run where this project is built: there is no Isaac Lab. `EventObservation` itself is, on the arrays that a tiled
camera gives (`kit_bridge/tests/test_scripts.py`).
"""

import argparse

import esaac


class EventObservation:
    """Voxel grids `(num_envs, bins, height, width)` of a tiled camera's last frame interval.

    `camera` gives `data.output["rgb"]` uint8 `(num_envs, height, width, 3 or 4)` and
    `data.output["motion_vectors"]` float32 `(num_envs, height, width, 2 to 4)`, as Isaac Lab's `TiledCamera` does.
    Isaac Lab's tiled colour is sRGB bytes: fewer levels than HDR, which shows where contrast is low.
    """

    def __init__(self, num_envs, height, width, bins=5, device="cuda:0", packets="cuda", **parameters):
        sensor = esaac.SensorModel("dvs128", width=width, height=height, **parameters)
        self.bins = bins
        self.camera = esaac.TiledEventCamera(sensor, num_envs, device=device, packets=packets)

    def reset(self, envs):
        """Environments that begin anew: their next frame is their first."""
        self.camera.reset(envs)

    def __call__(self, camera, t_ns):
        output = camera.data.output
        # Isaac Lab 3 wraps its arrays.
        rgb, motion = (getattr(output[name], "torch", output[name]) for name in ("rgb", "motion_vectors"))
        self.packet = self.camera.step(rgb, motion, t_ns=t_ns)
        grids = self.camera.voxel_grids(self.bins)
        if not isinstance(grids, esaac.Tensor):
            return grids
        import torch

        return torch.from_dlpack(grids)

    def close(self):
        self.camera.close()


def main():
    from isaaclab.app import AppLauncher

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--num_envs", type=int, default=256)
    parser.add_argument("--steps", type=int, default=300)
    AppLauncher.add_app_launcher_args(parser)
    arguments = parser.parse_args()
    app = AppLauncher(arguments).app

    import torch
    from isaaclab_tasks.direct.cartpole.cartpole_camera_env import CartpoleCameraEnv

    try:
        from isaaclab_tasks.direct.cartpole.cartpole_camera_env_cfg import CartpoleRGBCameraEnvCfg
    except ImportError:  # Isaac Lab 2 has it beside the environment.
        from isaaclab_tasks.direct.cartpole.cartpole_camera_env import CartpoleRGBCameraEnvCfg

    class EventCartpoleEnv(CartpoleCameraEnv):
        def __init__(self, cfg, **kwargs):
            camera, bins = cfg.tiled_camera, cfg.observation_space[0]
            self.events = EventObservation(
                cfg.scene.num_envs, camera.height, camera.width, bins, device=cfg.sim.device
            )
            self.clock_ns = 0
            super().__init__(cfg, **kwargs)

        def _setup_scene(self):
            # The camera draws motion as well; the environment insists on one kind of image in its configuration.
            one = self.cfg.tiled_camera
            self.cfg.tiled_camera = one.replace(data_types=["rgb", "motion_vectors"])
            super()._setup_scene()
            self.cfg.tiled_camera = one

        def _get_observations(self):
            self.clock_ns += round(1e9 * self.step_dt)
            return {"policy": self.events(self._tiled_camera, self.clock_ns)}

        def _reset_idx(self, env_ids):
            super()._reset_idx(env_ids)
            self.events.reset(env_ids)

    cfg = CartpoleRGBCameraEnvCfg()
    cfg.scene.num_envs = arguments.num_envs
    cfg.observation_space = [5, cfg.tiled_camera.height, cfg.tiled_camera.width]
    env = EventCartpoleEnv(cfg)
    env.reset()
    for _ in range(arguments.steps):
        action = 2 * torch.rand(arguments.num_envs, env.cfg.action_space, device=env.device) - 1
        observation, *_ = env.step(action)
    grids = observation["policy"]
    print(f"{len(env.events.packet)} events in the last step; grids {tuple(grids.shape)} on {grids.device}")
    env.close()
    app.close()


if __name__ == "__main__":
    main()
