"""What the tests share: examples, how MuJoCo draws, and an Isaac Lab environment, made once."""

import os
import pathlib
import sys

import pytest

# Read when MuJoCo is imported, which Newton does too.
os.environ.setdefault("MUJOCO_GL", "egl")
TESTS = pathlib.Path(__file__).parents[1]
sys.path[:0] = [str(TESTS.parent / "scripts"), str(TESTS)]


@pytest.fixture(scope="session")
def env():
    """Making it takes most of the tests' time, so tests share it. Each begins with a reset."""
    import lab
    from isaaclab.app import launch_simulation
    from isaaclab.envs import ManagerBasedEnv

    cfg = lab.EnvCfg()
    with launch_simulation(cfg, {"headless": True, "device": "cpu"}):
        made = ManagerBasedEnv(cfg)
        yield made
        made.close()
