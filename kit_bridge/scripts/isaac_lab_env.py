"""Isaac Lab: events as the observation of every environment, on the GPU from the renderer to the policy.

An environment needs `EventObservation`: give it a `TiledCamera` and read voxel grids. The environment below is Isaac
Lab's cart-pole seen by event cameras.

    ./isaaclab.sh -p kit_bridge/scripts/isaac_lab_env.py --num_envs 256 --headless --enable_cameras

Not run where this project is built: there is no Isaac Lab. `EventObservation` itself is tested on the arrays that a
tiled camera gives (`kit_bridge/tests/test_scripts.py`).
"""

import argparse

import numpy as np

import esaac


def stale_images(cfg):
    """Images of the old episode that the camera still gives after a reset. Isaac Lab resets after it has rendered,
    so there is one, unless the environment's configuration asks for another rendering (its name has changed)."""
    renders = getattr(cfg, "num_rerenders_on_reset", 0) or getattr(cfg, "rerender_on_reset", False)
    return 0 if renders else 1


class Restarts:
    """For each image: the environments whose event camera must forget what it saw before.

    A camera that begins with an image of the old episode would take the step to the new one for motion, and send
    events of nearly every pixel. So it begins anew with every image until one of the new episode has come.
    """

    def __init__(self, num_envs):
        self._images = np.zeros(num_envs, np.int64)

    def reset(self, envs, stale):
        """These environments (all for None) were reset. Their next `stale` images are of the old episode."""
        envs = slice(None) if envs is None else envs.tolist() if hasattr(envs, "tolist") else list(envs)
        self._images[envs] = 1 + stale

    def before_image(self):
        """The environments that begin with the next image; to be asked once for each image."""
        due = np.flatnonzero(self._images)
        self._images[due] -= 1
        return due


class EventObservation:
    """Voxel grids `(num_envs, bins, height, width)` of the events since a tiled camera's last image.

    `camera` gives `data.output["rgb"]` uint8 `(num_envs, height, width, 3 or 4)` and
    `data.output["motion_vectors"]` float32 `(num_envs, height, width, 2 to 4)`, as Isaac Lab's `TiledCamera` does.
    Isaac Lab's tiled colour is sRGB bytes. They have fewer levels than HDR: steps show where contrast is low.
    """

    def __init__(self, num_envs, height, width, bins=5, device="cuda:0", packets="cuda", **parameters):
        sensor = esaac.SensorModel("dvs128", width=width, height=height, **parameters)
        self.bins = bins
        self.camera = esaac.TiledEventCamera(sensor, num_envs, device=device, packets=packets)
        self._restarts = Restarts(num_envs)

    def reset(self, envs, stale=0):
        """Environments that were reset, and how many of their next images are still of the old episode."""
        self._restarts.reset(envs, stale)

    def __call__(self, camera, t_ns):
        restarting = self._restarts.before_image()
        if len(restarting):
            self.camera.reset(restarting)
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
            # The camera draws motion too, but the environment's configuration must name one kind of image.
            one = self.cfg.tiled_camera
            self.cfg.tiled_camera = one.replace(data_types=["rgb", "motion_vectors"])
            super()._setup_scene()
            self.cfg.tiled_camera = one

        def _get_observations(self):
            self.clock_ns += round(1e9 * self.step_dt)
            return {"policy": self.events(self._tiled_camera, self.clock_ns)}

        def _reset_idx(self, env_ids):
            super()._reset_idx(env_ids)
            self.events.reset(env_ids, stale_images(self.cfg))

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
