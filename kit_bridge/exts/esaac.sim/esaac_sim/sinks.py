"""Where events go: files."""

import pathlib

import esaac


class Recorder:
    """Writes a camera's events to a file when the run ends.

    Raises `OSError` at once if the folder cannot be written. If writing fails in the end, the events stay and `close`
    may be called again, with another folder too.
    """

    name = "recorder"

    def __init__(self, folder, spec, suffix=".npz"):
        folder = pathlib.Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        self._name = spec.path.strip("/").replace("/", "_") + suffix
        self._writer = esaac.EventWriter(folder / self._name, spec.sensor)

    def __call__(self, feed, packet):
        self._writer.write(packet)

    @property
    def path(self):
        return self._writer.path

    def __len__(self):
        return len(self._writer)

    def close(self, folder=None):
        self._writer.close(None if folder is None else pathlib.Path(folder) / self._name)
