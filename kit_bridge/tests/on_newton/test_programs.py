"""The programs for Isaac Lab, run as a user runs them: few environments, few steps, on the CPU."""

import json
import pathlib
import subprocess
import sys

import pytest

SCRIPTS = pathlib.Path(__file__).parents[2] / "scripts"


def ran(script, *arguments):
    command = [sys.executable, SCRIPTS / script, "--device", "cpu", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


def test_the_bench_tells_what_events_cost(tmp_path):
    result = tmp_path / "bench.json"
    options = {"--envs": 2, "--size": 32, "--steps": 3, "--warmup": 1, "--check-steps": 2, "--json": result}
    printed = ran("isaaclab_bench.py", *[word for option in options.items() for word in option])
    told = json.loads(result.read_text())
    assert "events" in printed and told["environments"] == 2 and told["size_px"] == 32
    assert abs(sum(told["share"].values()) - 1) < 1e-9 and told["share"]["physics"] > 0
    assert told["events_per_environment_and_step"] > 10
    assert told["memory_bytes"]["events"] > 0 and told["growth_bytes"]["events"] == 0


@pytest.mark.parametrize("given", ["events", "frames"])
def test_the_cart_pole_is_trained_and_judged(given, tmp_path):
    result = tmp_path / "curve.json"
    options = {"--envs": 4, "--iterations": 2, "--rollout": 4, "--episode-s": 0.05, "--input": given}
    ran("isaaclab_cartpole.py", *[word for option in options.items() for word in option], "--json", result)
    told = json.loads(result.read_text())
    assert told["input"] == given and [point["iteration"] for point in told["curve"]] == [0, 1]
    assert told["curve"][-1]["environment_steps"] == 2 * 4 * 4
    assert 0 < told["curve"][-1]["episode_s"] <= 0.05
    # Nobody falls in three steps.
    assert told["judged_survived"] == 1.0
