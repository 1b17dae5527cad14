"""The programs for Isaac Lab, run as a user runs them: few environments, few steps, on the CPU."""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from listening import domain, listening, recorded

from esaac.files import load_dsec

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


def test_what_the_quadrotor_sends_is_recorded_bit_for_bit(tmp_path):
    topics = {
        "/esaac/quadrotor_1/events": "esaac_msgs/msg/PackedEventPacket",
        "/esaac/quadrotor_1/image_raw": "sensor_msgs/msg/Image",
        "/esaac/quadrotor_1/depth/image_raw": "sensor_msgs/msg/Image",
        "/esaac/quadrotor_1/imu": "sensor_msgs/msg/Imu",
        "/clock": "rosgraph_msgs/msg/Clock",
    }
    command = [sys.executable, SCRIPTS / "isaaclab_quadrotor.py", "--device", "cpu", "--envs", "2"]
    command += ["--size", "48", "32", "--seconds", "0.2", "--out", tmp_path]
    command += ["--wait", "/esaac/quadrotor_1/events"]
    environment = {key: value for key, value in os.environ.items() if key != "CYCLONEDDS_URI"}
    environment |= {"ROS_LOCALHOST_ONLY": "1", "ROS_DOMAIN_ID": str(domain(3))}
    with (
        open(tmp_path / "errors", "w+") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment) as child,
    ):
        try:
            while not child.stdout.readline().startswith("topics:"):
                assert child.poll() is None, (tmp_path / "errors").read_text()
            with listening(domain(3), topics) as (wait, came):
                wait()
                printed, _ = child.communicate(timeout=400)
        finally:
            child.kill()
    assert child.returncode == 0, (tmp_path / "errors").read_text()
    told, recording = json.loads(printed.splitlines()[-1]), recorded(tmp_path / "run.mcap")
    assert told["dropped_ticks"] == 0 and all(count > 100 for count in told["events"].values())
    for topic in topics:
        assert came[topic] == recording[topic], topic
    frames = 7
    assert len(recording["/clock"]) == frames
    for name, count in told["events"].items():
        packets = recording[f"/esaac/{name}/events"]
        assert len(packets) == frames - 1
        x, y, p, t_ns = (np.concatenate(column) for column in zip(*map(columns, packets)))
        assert len(x) == count and (np.diff(t_ns) >= 0).all()
        for column, saved in zip((x, y, t_ns // 1000 * 1000, p), load_dsec(tmp_path / f"{name}.h5")):
            np.testing.assert_array_equal(column, saved)
    images = recording["/esaac/quadrotor_0/image_raw"]
    assert len(images) == frames and (images[0]["width"], images[0]["height"]) == (48, 32)
    assert np.ptp(np.array(images[0]["data"])) > 50 and images[0]["data"] != images[-1]["data"]
    depth_m = np.array(recording["/esaac/quadrotor_0/depth/image_raw"][0]["data"], np.uint8).view("<f4")
    assert 1.0 < np.nanmedian(depth_m) < 4.0
    imu = recording["/esaac/quadrotor_0/imu"]
    assert len(imu) == 8 * (frames - 1)
    # It hovers, so what its own axes feel on the whole is its weight; and it shakes.
    force = np.array([[sample["linear_acceleration"][axis] for axis in "xyz"] for sample in imu])
    assert 8.5 < np.linalg.norm(force[8:].mean(axis=0)) < 11.0
    assert max(abs(sample["angular_velocity"]["y"]) for sample in imu) > 0.2


def columns(message):
    """Of a packet's message: x, y, polarity, times."""
    times = message["base_ns"] + np.array(message["t_offset_ns"], np.int64)
    return message["x"], message["y"], message["polarity"], times
