"""Isaac Lab: events as the observation of every environment, on the GPU from the renderer to the policy.

An environment needs `EventObservation`: give it a camera and read voxel grids. The environment below is the cart-pole
of Isaac Lab 3.0 seen by event cameras.

    ./isaaclab.sh -p kit_bridge/scripts/isaac_lab_env.py --num_envs 256

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
    """Voxel grids `(num_envs, bins, height, width)` of the events since a camera's last image.

    `camera` gives images as Isaac Lab's cameras do, in `data.output`: `"motion_vectors"` float32 `(num_envs, height,
    width, 2 to 4)`, and colour `(num_envs, height, width, 3 or 4)`. That is `"rgb_hdr"`, linear float32, if it is
    there; else `"rgb"`, sRGB bytes. Bytes have fewer levels: steps show where contrast is low.
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
        colour = "rgb_hdr" if "rgb_hdr" in output else "rgb"
        # Isaac Lab 3 wraps its arrays.
        hdr, motion = (getattr(output[name], "torch", output[name]) for name in (colour, "motion_vectors"))
        self.packet = self.camera.step(hdr, motion, t_ns=t_ns)
        grids = self.camera.voxel_grids(self.bins)
        if not isinstance(grids, esaac.Tensor):
            return grids
        import torch

        return torch.from_dlpack(grids)

    def close(self):
        self.camera.close()


def cartpole_cfg(num_envs, bins):
    """Isaac Lab's cart-pole seen by event cameras."""
    from isaaclab_tasks.core.cartpole.cartpole_direct_camera_env_cfg import CartpoleCameraEnvCfg
    from isaaclab_tasks.utils import resolve_presets

    # Motion vectors come from RTX renderers alone.
    cfg = resolve_presets(CartpoleCameraEnvCfg(), ["isaacsim_rtx"])
    cfg.scene.num_envs = num_envs
    camera = cfg.scene.tiled_camera
    camera.data_types = ["rgb_hdr", "motion_vectors"]
    cfg.observation_space = [bins, camera.height, camera.width]
    cfg.state_space = 0
    return cfg


def run(cfg, steps):
    import torch
    from isaaclab_tasks.core.cartpole.cartpole_direct_env import CartpoleEnv

    class EventCartpoleEnv(CartpoleEnv):
        def __init__(self, cfg, **kwargs):
            camera, bins = cfg.scene.tiled_camera, cfg.observation_space[0]
            self.events = EventObservation(
                cfg.scene.num_envs, camera.height, camera.width, bins, device=cfg.sim.device
            )
            self.clock_ns = 0
            super().__init__(cfg, **kwargs)

        def _get_observations(self):
            self.clock_ns += round(1e9 * self.step_dt)
            return {"policy": self.events(self.scene["tiled_camera"], self.clock_ns)}

        def _reset_idx(self, env_ids):
            super()._reset_idx(env_ids)
            self.events.reset(env_ids, stale_images(self.cfg))

    env = EventCartpoleEnv(cfg)
    env.reset()
    for _ in range(steps):
        action = 2 * torch.rand(env.num_envs, env.cfg.action_space, device=env.device) - 1
        observation, *_ = env.step(action)
    grids = observation["policy"]
    print(f"{len(env.events.packet)} events in the last step; grids {tuple(grids.shape)} on {grids.device}")
    env.close()


def main():
    from isaaclab.app import add_launcher_args, launch_simulation

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--num_envs", type=int, default=256)
    parser.add_argument("--steps", type=int, default=300)
    add_launcher_args(parser)
    arguments = parser.parse_args()
    cfg = cartpole_cfg(arguments.num_envs, bins=5)
    with launch_simulation(cfg, arguments):
        run(cfg, arguments.steps)


if __name__ == "__main__":
    main()
