"""Where events go: files."""

import pathlib

import esaac


class Recorder:
    """Writes a camera's events to a file when the run ends. Where the timeline was rewound or jumped, the camera
    begins anew and what follows goes into another file: `camera.npz`, `camera_2.npz` and so on.

    Raises `OSError` at once if the folder cannot be written. If writing fails in the end, the events stay and `close`
    may be called again, with another folder too.
    """

    name = "recorder"

    def __init__(self, folder, spec, suffix=".npz"):
        self._folder, self._spec, self._suffix = pathlib.Path(folder), spec, suffix
        self._folder.mkdir(parents=True, exist_ok=True)
        self._writers = []
        self._begin()

    def __call__(self, feed, packet):
        self._writers[-1].write(packet)

    def restart(self):
        """The camera was reset."""
        if len(self._writers[-1]):
            self._begin()

    @property
    def path(self):
        return self._writers[0].path

    def __len__(self):
        return sum(map(len, self._writers))

    def close(self, folder=None):
        for writer in self._writers:
            writer.close(None if folder is None else pathlib.Path(folder) / writer.path.name)

    def _begin(self):
        number = len(self._writers) + 1
        name = self._spec.path.strip("/").replace("/", "_") + (f"_{number}" if number > 1 else "")
        self._writers.append(esaac.EventWriter(self._folder / (name + self._suffix), self._spec.sensor))
