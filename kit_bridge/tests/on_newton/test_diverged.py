"""Worlds whose simulation has diverged: they miss frames, and the others go on."""

import warnings

import lab
import numpy as np
import pytest
import torch
from test_isaaclab import act, counts
from test_newton import COLUMNS, PHYSICS_HZ, cameras, on_host
from worlds import Moving

import esaac

WORLDS, PER_FRAME = 3, 8


class Diverging(Moving):
    """World 1 is NaN at some substeps."""

    def __init__(self):
        super().__init__(WORLDS)

    def at_substep(self, substep, bad=False):
        state = self.at(substep / PHYSICS_HZ)
        if bad:
            poses = state.body_q.numpy()
            poses[2:4] = np.nan
            state.body_q.assign(poses)
        return state


def frame(made, moving, index, bad=()):
    """The packet of a frame, whose substeps `bad` are NaN in world 1."""
    for substep in range(PER_FRAME * (index - 1), PER_FRAME * index):
        made.record(moving.at_substep(substep, substep in bad))
    return made.step(moving.at_substep(PER_FRAME * index, PER_FRAME * index in bad))


def same(packet, other, world):
    for name in COLUMNS:
        np.testing.assert_array_equal(*(on_host(getattr(each[world], name)) for each in (packet, other)))


@pytest.mark.parametrize("synthesis", ["rigid", "linear"])
def test_a_world_that_diverges_misses_frames_and_the_others_go_on(synthesis):
    moving = Diverging()
    made, sound = (cameras(moving, synthesis=synthesis) for _ in range(2))
    expected = [each.step(moving.at_substep(0)) for each in (made, sound)][1:]
    expected += [frame(sound, moving, index) for index in range(1, 6)]
    first = frame(made, moving, 1)
    same(first, expected[1], 1)
    with pytest.warns(esaac.PoseWarning, match="world 1: poses are not finite"):
        second = frame(made, moving, 2, bad=(12,))
    with warnings.catch_warnings():
        warnings.simplefilter("error", esaac.PoseWarning)
        # It is told once.
        third = frame(made, moving, 3, bad=(23, 24))
        packets = [first, second, third, *(frame(made, moving, index) for index in (4, 5))]
    for index, packet in enumerate(packets, 1):
        for world in (0, 2):
            assert len(packet[world]) > 20
            same(packet, expected[index], world)
    assert [len(packet[1]) for packet in packets[1:4]] == [0, 0, 0] < [len(packets[4][1])]
    assert made.held_counts.tolist() == [0, 2, 0]


def test_poses_of_before_a_worlds_reset_may_be_anything():
    moving = Diverging()
    made = cameras(moving)
    made.step(moving.at_substep(0))
    for substep in range(PER_FRAME):
        made.record(moving.at_substep(substep, bad=substep >= 6))
    made.reset([False, True, False])
    made.step(moving.at_substep(PER_FRAME), worlds=[1])
    with warnings.catch_warnings():
        warnings.simplefilter("error", esaac.PoseWarning)
        made.step(moving.at_substep(PER_FRAME), worlds=[0, 2])
        assert all(len(packet) > 20 for packet in (frame(made, moving, 2)[world] for world in range(WORLDS)))
    assert not made.held_counts.any()


def test_the_very_first_frame_needs_finite_poses():
    moving = Diverging()
    with pytest.raises(esaac.FrameError, match="environment 1, step 0: x is NaN, expected a finite number"):
        cameras(moving).step(moving.at_substep(0, bad=True))


def spoil(env, number):
    box = env.scene["box"]
    pose = torch.full((1, 7), torch.nan)
    box.write_root_pose_to_sim_index(root_pose=pose, env_ids=torch.tensor([number], dtype=torch.int32))


def test_an_environment_that_diverges_is_ended_by_its_reset_alone(env):
    env.reset()
    expected = counts(act(env, 4))
    env.reset()
    camera = env.scene["still"]
    before, frames = camera.held_counts, camera.frame_counts.copy()
    assert counts(act(env))[0] == expected[0]
    spoil(env, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", esaac.PoseWarning)
        (held,) = counts(act(env))
    assert held == [expected[1][0], 0, expected[1][2]]
    assert (camera.held_counts - before).tolist() == [0, 1, 0]
    assert (camera.frame_counts - frames).tolist() == [2, 1, 2]
    assert not camera.data.output["event_frame"].torch[1].any()
    env.reset(env_ids=torch.tensor([1]))
    after = counts(act(env, 2))
    for step in (0, 1):
        assert after[step][::2] == expected[step + 2][::2]
        assert after[step][1] > 5
    assert after[0][1] == expected[0][1] and (camera.held_counts - before).tolist() == [0, 1, 0]
    # One that is not reset, and is finite again, begins anew too.
    spoil(env, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", esaac.PoseWarning)
        act(env)
    env.event_manager.apply(
        mode="reset", env_ids=torch.tensor([1]), global_env_step_count=0, dt=lab.DECIMATION * lab.PHYSICS_S
    )
    assert counts(act(env, 2))[1][1] > 5
