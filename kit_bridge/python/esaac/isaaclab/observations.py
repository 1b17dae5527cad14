"""Observation terms. They read what the camera holds, so they may be computed any number of times."""

from esaac.errors import ArgumentError


def event_frame(env, sensor_cfg, clip=None, channels_first=True):
    return _read(env, sensor_cfg, "event_frame", clip, channels_first)


def voxel_grid(env, sensor_cfg, clip=None, channels_first=True):
    return _read(env, sensor_cfg, "voxel_grid", clip, channels_first)


def _read(env, sensor_cfg, name, clip, channels_first):
    camera = env.scene.sensors[sensor_cfg.name]
    period_s, step_s = camera.frame_period_s, env.step_dt
    if period_s < step_s * (1 - 1e-6):
        raise ArgumentError(
            f"camera `{sensor_cfg.name}` has a frame every {period_s:g} s and the environment steps every "
            f"{step_s:g} s, so events of frames in between would be lost; set the camera's update_period to "
            f"{step_s:g}, since events follow every physics step all the same"
        )
    output = camera.data.output
    if name not in output:
        raise ArgumentError(
            f"camera `{sensor_cfg.name}` has the outputs {sorted(output)}, expected `{name}`; add it to data_types"
        )
    values = output[name].torch.float()
    if clip is not None:
        values = values.clamp(-clip, clip)
    return values.permute(0, 3, 1, 2) if channels_first else values
