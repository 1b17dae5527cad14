"""Event cameras in an Isaac Lab environment, and a test for each of its traps."""

import itertools

import isaaclab.sim as sim_utils
import lab
import numpy as np
import pytest
import torch
import warp as wp
from isaaclab.managers import EventManager, EventTermCfg, SceneEntityCfg
from isaaclab.utils.math import quat_mul
from isaaclab_newton.renderers import NewtonWarpRendererCfg

import esaac
from esaac.isaaclab import EventCamera, EventReading, event_frame, outputs, randomize_sensor
from esaac.isaaclab.schedule import Schedule
from esaac.newton.mounts import _between
from esaac.on_warp import SubstepLog
from esaac.poses import MARGIN

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
    ids = output["event_ids"].torch
    assert ids.dtype == torch.int64 and ids.shape == (sum(map(len, packet)),)
    bodies = env.scene["still"]._bodies._of_world.shape[1]
    assert ids.min() >= 0 and 0 < ids.max() <= bodies
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


def test_environments_are_chosen_by_numbers_a_mask_or_a_slice(env):
    env.reset()
    camera, mask = env.scene["still"], torch.tensor([False, True, False])
    for chosen in ([1], torch.tensor([1]), mask, mask.tolist(), mask.numpy(), slice(1, 2)):
        assert camera.env_numbers(chosen).tolist() == [1]
        before = camera.episode_counts.copy()
        camera.reset(chosen)
        assert (camera.episode_counts - before).tolist() == [0, 1, 0]
    camera.reset(env_mask=wp.array(mask.numpy(), dtype=wp.bool))
    assert (camera.episode_counts - before).tolist() == [0, 2, 0]
    for wrong, message in (
        (mask[:2], "mask of environments has 2 entries, expected 3"),
        ([3], "environment is 3, expected a number from 0 to 2"),
        ([-1], "environment is -1, expected"),
        (torch.tensor([1.0]), "environment is 1.0, expected"),
        ("1", "environment is '1', expected"),
    ):
        with pytest.raises(esaac.ArgumentError, match=message):
            camera.reset(wrong)
    with pytest.raises(esaac.ArgumentError, match="mask of environments is .*, expected 3 bools"):
        camera.reset(env_mask=wp.array([1], dtype=wp.int32))


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


def test_poses_are_sent_for_before_a_frame_is_drawn_and_not_waited_for_after_it(env, monkeypatch):
    env.reset()
    expected = act(env, 3)
    waited, since, ask = [], SubstepLog.since, EventCamera._ask

    def astray(camera):
        step, substeps = camera._read_at
        camera._read_at = (step, substeps + 3)
        return ask(camera)

    monkeypatch.setattr(SubstepLog, "since", lambda *given: waited.append(given) or since(*given))
    env.reset()
    act(env, 3)
    assert not waited
    # Where the number of substeps is not what was expected, they are read after all.
    monkeypatch.setattr(EventCamera, "_ask", astray)
    env.reset()
    late = act(env, 3)
    assert waited
    for got, wanted in zip(late, expected):
        assert [len(events) for events in got][::2] == [len(events) for events in wanted][::2]


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
    act(env, 2)
    camera = env.scene["still"]
    now = camera._log.substeps()
    steps, states = camera._log.since(now - lab.DECIMATION, now, camera._renderer.backend.state_0)
    assert steps.tolist() == list(range(now - lab.DECIMATION - MARGIN, now + 1))
    links = env.scene["box"].data.root_link_pose_w.torch.numpy()
    np.testing.assert_allclose(states[-1], links, atol=1e-6)
    # Each substep has a pose of its own.
    assert (np.abs(np.diff(states[MARGIN:, 0, 2])) > 1e-4).all()


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


@pytest.fixture
def moved(env):
    """The still camera is where it was after the test. Gives a function that moves it, and its paths."""
    camera, paths = env.scene["still"], []
    place = camera.data.pos_w.torch.clone(), camera.data.quat_w_opengl.torch.clone()
    step = camera.events.step

    def keep(*given, **named):
        paths.append(named["poses"].camera.copy())
        return step(*given, **named)

    def move(shift, turn=None, env_ids=None):
        chosen = slice(None) if env_ids is None else env_ids
        to = place[0] + torch.tensor(shift), place[1] if turn is None else quat_mul(turn, place[1])
        camera.set_world_poses(to[0][chosen], to[1][chosen], env_ids, convention="opengl")

    camera.events.step = keep
    yield move, paths
    del camera.events.step
    camera.set_world_poses(*place, convention="opengl")


def test_a_camera_that_is_moved_between_frames_has_moved_there_steadily(env, moved):
    move, paths = moved
    env.reset()
    act(env, 2)
    before = paths[-1][-1]
    turn = torch.tensor([[0.0, 0.0, np.sin(0.1), np.cos(0.1)]]).repeat(lab.ENVS, 1)
    move((0.08, 0.0, 0.0), turn)
    act(env)
    path = paths[-1]
    share = (np.arange(len(path)) - MARGIN) / lab.DECIMATION
    for number in range(lab.ENVS):
        np.testing.assert_allclose(path[:, number, 0] - before[number, 0], 0.08 * share, atol=1e-5)
        np.testing.assert_allclose(
            path[:, number, 1:3], before[None, number, 1:3].repeat(len(path), 0), atol=1e-5
        )
        cosines = np.abs(path[:, number, 3:] @ before[number, 3:])
        np.testing.assert_allclose(np.arccos(np.minimum(cosines, 1)), 0.1 * np.abs(share), atol=1e-3)
    # It stands there in the next interval.
    act(env)
    assert (paths[-1] == paths[-1][-1]).all()
    # One that is moved alone moves alone.
    move((0.16, 0.0, 0.0), turn, env_ids=[1])
    act(env)
    assert (np.ptp(paths[-1][..., 0], axis=0) > 0.01).tolist() == [False, True, False]


def test_a_camera_that_jumps_begins_anew_after_a_reset(env, moved):
    move, paths = moved
    env.reset()
    camera = env.scene["still"]
    act(env)
    move((0.5, 0.0, 0.0))
    camera.reset()
    act(env)
    assert (np.ptp(paths[-1][..., 0], axis=0) == 0).all()
    # The first frame was drawn before the move: another takes its place.
    env.reset()
    frames, episodes = camera.frame_counts.copy(), camera.episode_counts.copy()
    move((0.0, 0.5, 0.0))
    packet = act(env)[0]
    assert (np.ptp(paths[-1][..., 1], axis=0) == 0).all() and all(len(events) > 5 for events in packet)
    assert (camera.frame_counts - frames).tolist() == [1] * lab.ENVS
    assert (camera.episode_counts == episodes).all()


def test_the_turn_between_two_places_is_the_shorter_one():
    half = np.array([0, 0, 0, 0, 0, np.sin(0.25), np.cos(0.25)])
    start, end = np.array([0, 0, 0, 0, 0, 0, -1.0]), np.array([1, 2, 3, 0, 0, np.sin(0.5), np.cos(0.5)])
    path = _between(start, end, np.array([[0.0], [0.5], [1.0]]))
    np.testing.assert_allclose(path[:, :3], [[0, 0, 0], [0.5, 1, 1.5], [1, 2, 3]])
    np.testing.assert_allclose(np.abs(path[:, 3:] @ np.stack([start, half, end])[:, 3:].T).diagonal(), 1)
    np.testing.assert_array_equal(_between(start, start, np.array([[0.5]]))[0], start)


def test_a_slower_camera_gives_its_events_once(env):
    env.reset()
    camera, direct = env.scene["still"], Direct(env)
    camera._schedule.period_steps, kept = 2 * lab.DECIMATION, camera._schedule.period_steps
    try:
        seen = []
        for _ in range(6):
            frames = camera.frame_counts.copy()
            act(env)
            new = (camera.frame_counts > frames).all()
            held = camera.data.output["event_frame"].torch
            for _ in range(2):
                frame, (events, offsets) = (
                    event_frame(env, STILL, channels_first=False),
                    direct.events("still"),
                )
                assert torch.equal(frame, held.float() if new else torch.zeros_like(frame))
                assert (
                    frame.sum(dim=(1, 2, 3)).tolist() == offsets.diff().tolist()
                    and len(events) == offsets[-1]
                )
                assert direct.voxel_grid("still").any() == new
            seen.append(int(frame.sum()))
        assert [count > 0 for count in seen[-4:]] in ([True, False] * 2, [False, True] * 2)
        # One environment alone has a frame at its reset, and none of its own in the step before.
        env.reset(env_ids=torch.tensor([1]))
        assert not event_frame(env, STILL)[1].any()
    finally:
        camera._schedule.period_steps = kept


def test_steps_without_updates_of_the_scene_say_what_to_do(env):
    env.reset()
    for _ in range(80):
        env.sim.step(render=False)
    with pytest.raises(
        esaac.FrameError, match="expected at most 64: call scene.update after each physics step"
    ):
        env.scene.update(env.physics_dt)
    env.reset()
    assert all(len(events) > 5 for events in act(env, 2)[1])


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


class Direct(EventReading):
    """What a direct environment inherits, over the scene that the tests share."""

    def __init__(self, env):
        self.scene, self.step_dt = env.scene, env.step_dt


def test_a_direct_environment_reads_the_same_events_any_number_of_times(env):
    env.reset()
    direct = Direct(env)
    expected = direct.event_memory("still", kept=(0.0, 0.5), clip=2)
    assert expected.shape == (lab.ENVS, 2, lab.HEIGHT, lab.WIDTH) and not expected.any()
    for _ in range(3):
        (packet,) = act(env)
        frame = direct.event_frame("still", channels_first=False)
        image = (frame[..., 1] - frame[..., 0]).clamp(-2, 2)
        expected = torch.stack([image, 0.5 * expected[:, 1] + image], dim=1)
        for _ in range(2):
            read = direct.event_memory("still", kept=(0.0, 0.5), clip=2)
            torch.testing.assert_close(read, expected)
            # What a reader does with it is its own.
            read.zero_()
            events, offsets = direct.events("still")
            assert (
                offsets.diff().tolist() == [len(of_env) for of_env in packet] and len(events) == offsets[-1]
            )
            assert torch.equal(direct.event_frame("still"), event_frame(env, STILL))
            assert direct.voxel_grid("still").shape == (lab.ENVS, 5, lab.HEIGHT, lab.WIDTH)
    assert expected[:, 1].abs().sum() > expected[:, 0].abs().sum() > 20
    env.reset(env_ids=torch.tensor([1]))
    read = direct.event_memory("still", kept=(0.0, 0.5), clip=2)
    assert not read[1].any() and torch.equal(read[[0, 2], 1], expected[[0, 2], 1])


def test_memories_of_inference_mode_go_on_outside_of_it(env):
    env.reset()
    direct = Direct(env)
    with torch.inference_mode():
        direct.event_memory("still", kept=(0.5,))
        act(env)
        first = direct.event_memory("still", kept=(0.5,)).clone()
    act(env)
    second = direct.event_memory("still", kept=(0.5,))
    frame = direct.event_frame("still")
    torch.testing.assert_close(second[:, 0], 0.5 * first[:, 0] + frame[:, 1] - frame[:, 0])


def test_steps_that_a_memory_has_not_seen_are_told(env):
    env.reset()
    direct = Direct(env)
    direct.event_memory("still")
    act(env, 2)
    with pytest.raises(esaac.ArgumentError, match="has drawn 2 frames of environment 0 .*, expected 1"):
        direct.event_memory("still")
    with pytest.raises(esaac.ArgumentError, match=r"kept is \(1.5,\), expected shares from 0 to 1"):
        direct.event_memory("still", kept=(1.5,))
    with pytest.raises(esaac.ArgumentError, match="has the outputs .*expected `events`"):
        direct.events("mounted")


@pytest.fixture
def sensors(env):
    """The still camera's own sensors come back after the test."""
    camera = env.scene["still"]
    before = camera.events.sensors
    yield before
    for number, sensor in enumerate(before):
        camera.events.set_sensor(number, sensor)


def counts(packets):
    return [[len(events) for events in packet] for packet in packets]


def test_a_sensor_that_is_drawn_at_a_reset_sends_what_it_would_have_sent_from_the_start(env, sensors):
    camera, other = env.scene["still"], {"contrast_on": (0.08, 0.08), "refractory_ns": (1e4, 1e4)}
    env.reset()
    before = counts(act(env, 3))
    randomize_sensor(env, None, STILL, other)
    env.reset()
    everywhere = act(env, 3)
    for number, sensor in enumerate(sensors):
        camera.events.set_sensor(number, sensor)
    env.reset()
    term = EventTermCfg(
        func=randomize_sensor, mode="reset", params={"sensor_cfg": STILL, "parameters": other}
    )
    manager = EventManager({"sensor": term}, env)
    manager.apply(mode="reset", env_ids=torch.tensor([1], dtype=torch.int32), global_env_step_count=0)
    told = [(own.contrast_on, own.refractory_ns) for own in camera.events.sensors]
    assert told == [(0.15, sensors[0].refractory_ns), (0.08, 10_000), (0.15, sensors[2].refractory_ns)]
    after = act(env, 3)
    for step in range(3):
        assert [len(after[step][number]) for number in (0, 2)] == before[step][::2]
        own, expected = after[step][1], everywhere[step][1]
        assert 5 < before[step][1] < len(expected)
        shift_ns = after[0][1][0, 2] - everywhere[0][1][0, 2]
        assert torch.equal(own[:, [0, 1, 3]], expected[:, [0, 1, 3]])
        assert ((own - expected)[:, 2] - shift_ns).abs().max() <= 1


def test_draws_are_within_their_range_and_repeated_by_the_seed(env, sensors):
    camera, direct = env.scene["still"], Direct(env)
    ranges = {"contrast_off": (0.2, 0.4), "shot_noise_rate_hz": (0.1, 10.0), "latency_ns": (0, 1000)}
    drawn = []
    for seed in (7, 7, 8):
        torch.manual_seed(seed)
        randomize_sensor(env, torch.arange(lab.ENVS), STILL, ranges)
        drawn.append([tuple(getattr(own, name) for name in ranges) for own in camera.events.sensors])
        for values in drawn[-1]:
            assert all(low <= value <= high for value, (low, high) in zip(values, ranges.values()))
            assert isinstance(values[2], int)
    assert drawn[0] == drawn[1] != drawn[2] and len(set(drawn[0])) == lab.ENVS
    torch.manual_seed(7)
    direct.randomize_sensor([0, 2], "still", {"leak_rate_hz": (0.01, 1.0)}, distribution="log_uniform")
    rates = [own.leak_rate_hz for own in camera.events.sensors]
    assert rates[1] == sensors[1].leak_rate_hz and 0.01 <= rates[0] != rates[2] <= 1.0


def test_parameters_that_cannot_differ_are_named_and_nothing_changes(env, sensors, monkeypatch):
    camera = env.scene["still"]
    for name in ("width", "synthesis", "contrast"):
        with pytest.raises(
            esaac.ArgumentError, match=f"`{name}` cannot differ .*expected one of contrast_on"
        ):
            randomize_sensor(env, None, STILL, {name: (1, 2)})
    with pytest.raises(esaac.SensorError, match="contrast_on"):
        camera.set_parameters([0, 1], {"contrast_on": [0.2, 99.0]})
    with pytest.raises(esaac.ArgumentError, match="1 values of `contrast_on` for 2 environments"):
        camera.set_parameters([0, 1], {"contrast_on": [0.2]})
    with pytest.raises(esaac.ArgumentError, match="is 0.4 to 0.2, expected two ascending numbers"):
        randomize_sensor(env, None, STILL, {"contrast_on": (0.4, 0.2)})
    with pytest.raises(esaac.ArgumentError, match="is 0 to 0.2, expected two ascending numbers, above 0"):
        randomize_sensor(env, None, STILL, {"contrast_on": (0, 0.2)}, distribution="log_uniform")
    with pytest.raises(esaac.ArgumentError, match="is `normal`, expected uniform or log_uniform"):
        randomize_sensor(env, None, STILL, {"contrast_on": (0.1, 0.2)}, distribution="normal")
    assert camera.events.sensors == sensors
    monkeypatch.setattr(camera, "events", None)
    with pytest.raises(esaac.ArgumentError, match="before the simulation plays"):
        randomize_sensor(env, None, STILL, {"contrast_on": (0.1, 0.2)})


def test_a_tensor_of_a_device_is_viewed_though_it_could_be_copied_to_the_host():
    class Tensor:
        """As `esaac.Tensor`: DLPack, and a copy on the host for NumPy."""

        def __init__(self, inner):
            self.inner = inner
            self.dtype = inner.numpy().dtype

        def __dlpack__(self, **given):
            return self.inner.__dlpack__(**given)

        def __dlpack_device__(self):
            return self.inner.__dlpack_device__()

        def __array__(self, *_, **__):
            raise AssertionError("copied to the host")

    inner = torch.arange(5, dtype=torch.int16)
    assert outputs._tensor(Tensor(inner)).data_ptr() == inner.data_ptr()
    host = outputs._tensor(np.arange(5, dtype=np.uint16))
    assert host.dtype == torch.int32 and host.tolist() == [0, 1, 2, 3, 4]
