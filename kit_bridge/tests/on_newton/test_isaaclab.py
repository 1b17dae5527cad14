"""Event cameras in an Isaac Lab environment, and a test for each of its traps."""

import itertools

import isaaclab.sim as sim_utils
import lab
import numpy as np
import pytest
import torch
from isaaclab.managers import SceneEntityCfg
from isaaclab_newton.renderers import NewtonWarpRendererCfg

import esaac
from esaac.isaaclab import event_frame
from esaac.isaaclab.camera import EventCamera
from esaac.isaaclab.schedule import Schedule

STILL = SceneEntityCfg("still")


def act(env, count=1):
    """Environment steps; events `(n, 4)` of each environment and step."""
    action = torch.zeros(lab.ENVS, env.action_manager.total_action_dim)
    packets = []
    for _ in range(count):
        env.step(action)
        output = env.scene["still"].data.output
        events, offsets = (output[name].torch.clone() for name in ("events", "events_offsets"))
        packets.append([events[a:b] for a, b in itertools.pairwise(offsets)])
    return packets


def test_every_environment_sends_events_along_its_path(env):
    env.reset()
    start_ns = env.scene["still"]._log.time_ns(env.scene["still"]._log.substeps())
    for index, packet in enumerate(act(env, 4)):
        begin, end = (start_ns + round((index + k) * 1e9 / 30) for k in (0, 1))
        for events in packet:
            assert len(events) > 5
            assert begin - 2 <= events[:, 2].min() and events[:, 2].max() <= end + 2
    output = env.scene["still"].data.output
    frame, grid = (output[name].torch for name in ("event_frame", "voxel_grid"))
    assert frame.shape == (lab.ENVS, lab.HEIGHT, lab.WIDTH, 2) and grid.shape[-1] == 5
    assert frame.sum(dim=(1, 2, 3)).tolist() == [len(events) for events in packet]
    on = torch.stack([events[:, 3].sum() for events in packet])
    assert frame[..., 1].sum(dim=(1, 2)).tolist() == on.tolist()
    for name in ("still", "mounted"):
        camera = env.scene[name]
        assert camera.events.synthesis == "rigid" and camera.data.output["event_frame"].torch.sum() > 50
        assert all(not c["without_poses"] for c in camera.events.statistics["cameras"])


def test_an_observation_may_be_read_any_number_of_times(env):
    env.reset()
    act(env, 2)
    frames = [event_frame(env, STILL) for _ in range(3)]
    assert frames[0].sum() > 10 and all(torch.equal(frames[0], other) for other in frames)
    assert event_frame(env, STILL, clip=1, channels_first=False).max() == 1
    computed = env.observation_manager.compute()["policy"]["frame"]
    assert torch.equal(computed, frames[0])


def test_rollouts_in_inference_mode_and_without_take_turns(env):
    env.reset()
    expected = act(env, 3)
    env.reset()
    with torch.inference_mode():
        (first,) = act(env)
    (second,) = act(env)
    env.reset(env_ids=torch.tensor([1]))
    with torch.inference_mode():
        (third,) = act(env)
    for got, wanted in zip((first, second, third), expected):
        assert [len(events) for events in got][::2] == [len(events) for events in wanted][::2]
    assert len(third[1]) == len(expected[0][1])


def test_a_reset_sends_nothing_and_equals_a_fresh_run(env):
    env.reset()
    camera = env.scene["still"]
    # Three steps are a whole number of nanoseconds, so that later episodes have the same intervals.
    first = act(env, 3)
    before = camera.data.output["event_frame"].torch.clone()
    env.reset(env_ids=torch.tensor([1]))
    offsets = camera.data.output["events_offsets"].torch
    assert offsets.diff().tolist() == [len(first[2][0]), 0, len(first[2][2])]
    after = camera.data.output["event_frame"].torch
    assert not after[1].any() and torch.equal(after[[0, 2]], before[[0, 2]])
    second = act(env, 3)
    for early, late in zip(first, second):
        assert len(early[1]) > 5
        assert torch.equal(early[1] + torch.tensor([0, 0, 100_000_000, 0]), late[1])
    assert sum(len(late[0]) for late in second) != sum(len(late[1]) for late in second)


def act_unread(env, steps):
    """Environment steps as a loop of one's own does them: nothing reads the camera before the first physics step."""
    camera, packets = env.scene["still"], []
    for _ in range(steps):
        for _ in range(lab.DECIMATION):
            env.scene.write_data_to_sim()
            env.sim.step(render=False)
            env.scene.update(env.physics_dt)
        output = camera.data.output
        events, offsets = (output[name].torch.clone() for name in ("events", "events_offsets"))
        packets.append([events[a:b] for a, b in itertools.pairwise(offsets)])
    return packets


def reset_unread(env, envs):
    envs = torch.tensor(envs)
    env.scene.reset(envs)
    env.event_manager.apply(mode="reset", env_ids=envs, global_env_step_count=0)


def test_a_reset_that_is_not_read_begins_with_the_next_physics_step(env):
    env.reset()
    reset_unread(env, [0, 1, 2])
    first = act_unread(env, 3)
    events = env.scene["still"].data.output["events_offsets"].torch.diff().tolist()
    reset_unread(env, [1])
    kept = env.scene["still"]._outputs.arrays["events_offsets"].torch.diff().tolist()
    assert kept == [events[0], 0, events[2]]
    second = act_unread(env, 3)
    for early, late in zip(first, second):
        assert len(early[1]) > 5
        assert torch.equal(early[1] + torch.tensor([0, 0, 100_000_000, 0]), late[1])
    # The old episode goes on for the others, and the new one has no burst.
    assert all(len(late[0]) > 5 and len(late[1]) < 3 * len(first[0][0]) for late in second)


def test_trap_lazy_sensors_frames_between_reads_are_not_lost(env):
    env.reset()
    camera = env.scene["still"]
    frames = camera.frame.torch.clone()
    for _ in range(16):
        env.sim.step(render=False)
        env.scene.update(env.physics_dt)
    assert (camera.frame.torch - frames).tolist() == [2] * lab.ENVS


def test_trap_folded_decimation_is_followed_or_named(env):
    env.reset()
    unfolded = act(env, 2)[1]
    env.reset()
    # Newton runs all steps, and sensors are told once.
    for _ in range(2):
        for _ in range(lab.DECIMATION):
            env.sim.step(render=False)
        env.scene.update(lab.DECIMATION * env.physics_dt)
    offsets = env.scene["still"].data.output["events_offsets"].torch.diff()
    assert offsets.tolist() == [len(events) for events in unfolded]
    with pytest.raises(esaac.ArgumentError, match=r"use_newton_actuators=False"):
        Schedule(2, 1 / 120, 1 / 240).check(8 / 240)


def test_trap_stale_data_poses_are_those_of_newtons_state(env):
    env.reset()
    act(env)
    camera = env.scene["still"]
    now = camera._log.substeps()
    steps, states = camera._log.since(now - lab.DECIMATION, now, camera._renderer.backend.state_0)
    assert steps.tolist() == list(range(now - lab.DECIMATION - 2, now + 1))
    links = env.scene["box"].data.root_link_pose_w.torch.numpy()
    np.testing.assert_allclose(states[-1], links, atol=1e-6)
    # Each substep has a pose of its own.
    assert (np.abs(np.diff(states[2:, 0, 2])) > 1e-4).all()


def test_trap_black_misses_have_the_background_and_none_is_refused(env):
    env.reset()
    camera = env.scene["still"]
    missed = camera._render_data.view.depth.numpy() == 0
    colour = camera.data.output["rgb_hdr"].torch.numpy()
    assert missed.any() and np.allclose(np.median(colour[missed]), 0.2140, atol=1e-3)
    with pytest.raises(esaac.ArgumentError, match="background_color is None, expected a colour"):
        EventCamera(env.cfg.scene.still.replace(background_color=None))


def test_trap_float_clocks_frames_fall_on_whole_steps_for_hours():
    schedule = Schedule(1, 1 / 30, 1 / 240)
    for step in (0, 8, 240 * 86_400, 240 * 86_400 + 8):
        schedule.advance(step)
        assert schedule.due.all()
        schedule.done(step)
        schedule.advance(step + 7)
        assert not schedule.due.any()


def test_settings_that_would_lose_events_are_named(env):
    still = env.cfg.scene.still
    fisheye = sim_utils.FisheyeCameraCfg()
    for changed, message in (
        (still.replace(renderer_cfg=NewtonWarpRendererCfg()), "expected an esaac.isaaclab.EventRendererCfg"),
        (still.replace(update_latest_camera_pose=False), "update_latest_camera_pose is False"),
        (still.replace(spawn=fisheye), "distorted or fisheye lens"),
    ):
        with pytest.raises(esaac.ArgumentError, match=message):
            EventCamera(changed)
    with pytest.raises(ValueError, match="no_such_type"):
        still.replace(data_types=["events", "no_such_type"]).validate_config()
    camera = env.scene["still"]
    camera._schedule.period_steps, kept = 4, camera._schedule.period_steps
    with pytest.raises(esaac.ArgumentError, match=r"set the camera's update_period to 0\.0333333"):
        event_frame(env, STILL)
    camera._schedule.period_steps = kept
    with pytest.raises(esaac.ArgumentError, match="has the outputs .*expected `voxel_grid`"):
        esaac.isaaclab.voxel_grid(env, SceneEntityCfg("mounted"))
    with pytest.raises(esaac.ArgumentError, match="lens is changed while it runs"):
        camera.set_intrinsic_matrices(camera.data.intrinsic_matrices.torch * 1.5)
