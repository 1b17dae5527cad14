"""Scripts say what they are, and are Python that an interpreter takes."""

import ast
import pathlib
import re
import subprocess
import sys

import pytest

SCRIPTS = pathlib.Path(__file__).parents[1] / "scripts"


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda path: path.name)
def test_scripts_say_what_they_are_and_what_was_not_run(script):
    tree = ast.parse(script.read_text())
    words = ast.get_docstring(tree)
    assert script.name in words
    needs_kit = "isaacsim" in script.read_text() or "omni.replicator" in script.read_text()
    assert needs_kit == (
        "Not tested: the script as a whole, which needs Isaac Sim" in " ".join(words.split())
    )


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda path: path.name)
def test_help_needs_no_packages(script):
    # Isolated and without site-packages: Python's own modules are all that there is.
    bare = [sys.executable, "-I", "-S", script]
    done = subprocess.run([*bare, "--help"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    summary = ast.get_docstring(ast.parse(script.read_text())).splitlines()[0]
    # It is wrapped to the terminal's width.
    assert done.stdout.startswith("usage: ") and summary in " ".join(done.stdout.split())
    for written in re.findall(rf"{script.name} (--.*)", script.read_text()):
        assert set(re.findall(r"--[a-z-]+", written)) <= set(re.findall(r"--[a-z-]+", done.stdout))
    wrong = subprocess.run([*bare, "--no-such-flag"], capture_output=True, text=True)
    assert wrong.returncode == 2 and "unrecognized arguments: --no-such-flag" in wrong.stderr
