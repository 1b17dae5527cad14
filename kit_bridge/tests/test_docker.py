"""The container's files: what can be checked of them without building an image."""

import pathlib
import re

import pytest

DOCKER = pathlib.Path(__file__).parents[2] / "docker"


def test_every_volume_belongs_to_the_user_of_the_container():
    """A new volume is root's unless the image has a folder at its place that belongs to somebody else."""
    dockerfile, compose = (DOCKER / "Dockerfile").read_text(), (DOCKER / "compose.yaml").read_text()
    root, user = re.findall(r"^USER (\d+):", dockerfile, re.M)
    assert (root, user) == ("0", "1234")
    (made,) = re.findall(rf"^RUN install -d -o {user} -g {user} (.*)$", dockerfile, re.M)
    assert dockerfile.index("USER 0:") < dockerfile.index("RUN install") < dockerfile.index(f"USER {user}")
    isaac_sim, rosbag = compose.split("\n  rosbag:\n")
    volumes = re.findall(r"^      - ([\w-]+):(/\S+)$", isaac_sim, re.M)
    declared = re.findall(r"^  ([\w-]+):$", compose.split("\nvolumes:\n")[1], re.M)
    assert {name for name, _ in volumes} == set(declared)
    assert {place for _, place in volumes} == set(made.split())
    # Other images have no such folders: theirs must not make the volume first.
    assert "depends_on: [isaac-sim]" in rosbag and "recordings:/recordings" in rosbag


def test_recordings_go_to_a_volume():
    dockerfile, compose = (DOCKER / "Dockerfile").read_text(), (DOCKER / "compose.yaml").read_text()
    (folder,) = re.findall(r'"--record", "([^"]+)"', dockerfile)
    assert f"recordings:{folder}\n" in compose


@pytest.mark.parametrize("name", ["compose.yaml", "pixi.toml"])
def test_recorders_know_the_messages_of_events(name):
    """Without the package of its type, a recorder leaves a topic out."""
    text = (DOCKER / name).read_text()
    assert (DOCKER.parent / "ros/esaac_msgs/package.xml").exists() and "../ros/esaac_msgs" in text
    (prefix,) = re.findall(r"--install-base ([^\s\"]+)", text)
    assert re.search(rf"\. {re.escape(prefix)}/setup\.(ba)?sh\s+&& (exec )?ros2 bag record --all", text)
