"""What readers of an Isaac Lab camera get is their own, and what is wrong with what they ask for is told."""

import lab
import pytest
import torch
from test_isaaclab import STILL, Direct, act

import esaac
from esaac.isaaclab import event_frame, randomize_sensor, voxel_grid


def test_what_is_read_is_the_readers_own(env):
    env.reset()
    direct = Direct(env)
    readers = {
        "term grid": lambda: voxel_grid(env, STILL),
        "term frame": lambda: event_frame(env, STILL),
        "grid": lambda: direct.voxel_grid("still", channels_first=False),
        "frame": lambda: direct.event_frame("still"),
        "memory": lambda: direct.event_memory("still", kept=(0.5,)),
        "events": lambda: direct.events("still")[0],
        "offsets": lambda: direct.events("still")[1],
        "observation": lambda: env.observation_manager.compute()["policy"]["grid"],
    }
    act(env)
    for _ in range(2):
        read = {name: reader() for name, reader in readers.items()}
        kept = {name: values.clone() for name, values in read.items()}
        act(env)
        for name, values in read.items():
            # A later frame leaves it as it is.
            assert torch.equal(values, kept[name]), name
            assert values.any(), name
        # What is done to it is not seen by others.
        for name, reader in readers.items():
            before = reader().clone()
            reader().add_(7)
            assert torch.equal(reader(), before), name


def test_wrong_questions_are_told(env):
    env.reset()
    direct = Direct(env)
    for read in (direct.event_frame, direct.voxel_grid, direct.event_memory):
        with pytest.raises(esaac.ArgumentError, match="clip is -1, expected a number of at least 0"):
            read("still", clip=-1)
        with pytest.raises(esaac.ArgumentError, match="clip is nan, expected"):
            read("still", clip=float("nan"))
    for kept, told in ((0.5, "0.5"), ((), r"\(\)"), ((1.5,), r"\(1.5,\)"), ("ab", "'ab'")):
        with pytest.raises(esaac.ArgumentError, match=f"kept is {told}, expected shares from 0 to 1, one"):
            direct.event_memory("still", kept=kept)
    for given, told in ((0.1, "0.1"), ((0.1, 0.2, 0.3), r"\(0.1, 0.2, 0.3\)")):
        with pytest.raises(esaac.ArgumentError, match=f"`contrast_on` is {told}, expected two ascending"):
            randomize_sensor(env, None, STILL, {"contrast_on": given})


def test_a_memory_that_has_missed_frames_goes_on_when_its_environments_are_reset(env):
    env.reset()
    direct = Direct(env)
    direct.event_memory("still")
    act(env, 2)
    env.reset(env_ids=torch.tensor([1]))
    for _ in range(2):
        with pytest.raises(esaac.ArgumentError, match="It goes on when these environments are reset"):
            direct.event_memory("still")
    env.reset(env_ids=torch.tensor([0, 2]))
    assert not direct.event_memory("still").any()
    act(env)
    assert direct.event_memory("still").any()


def test_times_of_events_stay_on_the_simulations_clock(env):
    env.reset()
    act(env, 2)
    env.sim.reset()
    env.reset()
    (packet,) = act(env)
    camera = env.scene["still"]
    end_ns = camera._physics_step() * lab.PHYSICS_S * 1e9
    for events in packet:
        assert len(events) > 5
        assert end_ns - 1e9 / 30 - 2 <= events[:, 2].min() and events[:, 2].max() <= end_ns + 2
