"""`python -m esaac` is the command, and gives the same events as the package."""

import json
import pathlib
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest

import esaac


def command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "esaac", *map(str, arguments)], capture_output=True, text=True
    )


@pytest.fixture(scope="module")
def tumble():
    """The path-traced sequence that all suites share."""
    folder = pathlib.Path(__file__).parents[2].resolve() / "tests/data/tumble"
    assert folder.is_dir(), f"{folder} is missing"
    return folder.resolve()


def test_the_same_frames_give_the_same_bits_by_command_and_package(tumble, tmp_path):
    count, rate_hz = 3, json.loads((tumble / "sequence.json").read_text())["key_rate_hz"]
    paths = sorted(tumble.glob("key_*.exr"))[:count]
    assert len(paths) == count
    frames = tmp_path / "frames"
    frames.mkdir()
    for path in paths:
        (frames / path.name).symlink_to(path)
    out = tmp_path / "events.npz"
    flags = ["--sensor", "davis240", "--profile", "noisy", "--rate", rate_hz, "--seed", 5]
    ran = command("simulate", frames, *flags, "--out", out, "--json")
    assert ran.returncode == 0, ran.stderr
    expected = np.load(out)

    sensor = esaac.SensorModel("davis240", profile="noisy", seed=5)
    camera, packets = esaac.EventCamera(sensor), []
    for index, path in enumerate(paths):
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
        hdr = np.stack([channels[name].pixels for name in "RGB"], axis=-1)
        motion = np.stack([channels[f"motion.{axis}"].pixels for axis in "XY"], axis=-1)
        packets.append(camera.step(hdr, motion, t_ns=round(index * 1e9 / rate_hz)))
    events = {name: np.concatenate([getattr(p, name) for p in packets]) for name in ("x", "y", "t_ns", "p")}
    assert len(events["x"]) > 100_000
    np.testing.assert_array_equal(events["x"], expected["x"])
    np.testing.assert_array_equal(events["y"], expected["y"])
    np.testing.assert_array_equal(events["t_ns"], expected["t"])
    np.testing.assert_array_equal(events["p"].astype(np.int8) * 2 - 1, expected["p"])
    # The file says what `auto` has come to.
    assert esaac.SensorModel.from_toml(str(expected["sensor"])) == sensor.replace(synthesis=camera.synthesis)


def test_the_command_lists_fails_and_explains_itself():
    ran = command("sensors", "--json")
    assert ran.returncode == 0 and "davis346" in ran.stdout and json.loads(ran.stdout)
    assert command("--help").returncode == 0
    wrong = command("sensors", "--nonsense")
    assert wrong.returncode == 2 and "--nonsense" in wrong.stderr and not wrong.stdout
    missing = command("simulate", "/nowhere")
    assert missing.returncode == 1 and missing.stderr.startswith("error: ")


def test_the_demo_starts_its_renderer_through_python(tmp_path):
    ran = command("demo", "--out", tmp_path, "--scene", "edge", "--sensor", "dvs128", "--frames", 3, "--json")
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "events.npz").exists()
