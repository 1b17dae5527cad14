"""Where events go: files."""

import pathlib

import esaac


class Recorder:
    """Writes a camera's events to a file when the run ends."""

    name = "recorder"

    def __init__(self, folder, spec, suffix=".npz"):
        path = pathlib.Path(folder) / (spec.path.strip("/").replace("/", "_") + suffix)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._writer = esaac.EventWriter(path, spec.sensor)

    def __call__(self, feed, packet):
        self._writer.write(packet)

    def close(self):
        self._writer.close()
