"""Scripts say what they are, and are Python that an interpreter takes."""

import ast
import pathlib

import pytest

SCRIPTS = pathlib.Path(__file__).parents[1] / "scripts"


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda path: path.name)
def test_scripts_say_what_they_are_and_what_was_not_run(script):
    tree = ast.parse(script.read_text())
    words = ast.get_docstring(tree)
    assert script.name in words
    needs_kit = "isaacsim" in script.read_text() or "omni.replicator" in script.read_text()
    assert needs_kit == ("Not run where this project is built" in words)
