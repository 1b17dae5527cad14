"""The table of ids beside a recording, `NAME.ids.json`: which prim each id of its events is."""

import json
import os


def beside(recording):
    """Where the table of a recording is."""
    return recording.with_suffix(".ids.json")


def write(recording, camera, instances):
    """Writes the table of a recording and returns its path. It appears whole or not at all."""
    path = beside(recording)
    told = {str(number): instances[number] for number in sorted(instances)}
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_text(json.dumps({"camera": camera, "instances": told}, indent=2) + "\n")
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
    return path
