"""Where events go: files."""

import itertools
import pathlib

import esaac

from . import id_table


class Recorder:
    """Writes a camera's events to files when the run ends.

    The first file has the camera's name. If there is such a file already, or another recorder is going to write it,
    a number follows: `camera.npz`, `camera_2.npz` and so on. Nothing is overwritten. Where the timeline is rewound or
    jumps, the camera begins anew and what follows goes into another file, as it does where the sensor is changed.

    If `esaac:outputs` has `event_ids`, each event has the id of what it shows, and `camera.ids.json` beside the file
    says which prim each id is. Only `.npz` and `.h5` have a place for ids; others raise `esaac.ArgumentError`.

    Recorders that share a set `claimed` do not choose each other's names. `log` has `info`, which is told the names.

    Raises `OSError` at once if the folder cannot be written. If writing fails in the end, the events stay and `close`
    may be called again, with another folder too.
    """

    name = "recorder"

    def __init__(self, folder, spec, suffix=".npz", claimed=None, log=None):
        self._folder, self._spec, self._suffix = pathlib.Path(folder), spec, suffix
        self._sensor, self._log = spec.sensor, log
        self._instances = {}
        if spec.with_ids and suffix not in esaac.files.ID_SUFFIXES:
            raise esaac.ArgumentError(
                f"{spec.path}.esaac:outputs has `event_ids`, for which a recording as {suffix} has no place, "
                f"expected one of {', '.join(esaac.files.ID_SUFFIXES)}"
            )
        self._claimed = set() if claimed is None else claimed
        self._folder.mkdir(parents=True, exist_ok=True)
        self._writers = []
        self._begin()

    def __call__(self, feed, packet):
        self._used = True
        if self._spec.with_ids:
            self._instances = feed.instances
            self._writers[-1].write(packet, feed.forms["event_ids"])
        else:
            self._writers[-1].write(packet)

    def restart(self):
        """The camera was reset."""
        self._begin()

    def changed(self, sensor):
        """The camera goes on with another sensor, and a file names one."""
        self._sensor = sensor
        self._begin()

    @property
    def path(self):
        return self._writers[0].path

    @property
    def ids_path(self):
        """The table of ids beside the first file, or None where events have none."""
        return id_table.beside(self.path) if self._spec.with_ids else None

    def __len__(self):
        return sum(map(len, self._writers))

    def close(self, folder=None):
        for writer in self._writers:
            own = writer.path.absolute()
            # Where no frame has come there is no recording.
            if not writer.closed and (self._used or writer is not self._writers[-1]):
                self._save(writer, folder, own)
            self._claimed.discard(own)

    def _save(self, writer, folder, own):
        path = writer.path
        if folder is not None or self._taken(path):
            path = self._free(pathlib.Path(folder or self._folder), own)
        count = len(writer)
        # First the table: without it the events stay, and can be saved again.
        table = id_table.write(path, self._spec.path, self._instances) if self._spec.with_ids else None
        try:
            writer.close(path)
        except BaseException:
            if table is not None:
                table.unlink()
            raise
        self._tell(f"{count} events are saved as {path}" + (f", their ids as {table}" if table else ""))

    def _begin(self):
        """Another file, if there are events in the last one."""
        if self._writers and not len(self._writers[-1]):
            self._claimed.discard(self._writers.pop().path.absolute())
        self._used = False
        path = self._free(self._folder)
        self._writers.append(esaac.EventWriter(path, self._sensor))
        self._claimed.add(path.absolute())
        self._tell(f"events are recorded as {path}")

    def _free(self, folder, own=None):
        """The first path that is not there and that nobody has claimed, but for a file's own."""
        stem = self._spec.path.strip("/").replace("/", "_")
        for number in itertools.count(1):
            path = folder / (stem + (f"_{number}" if number > 1 else "") + self._suffix)
            if path.absolute() not in self._claimed - {own} and not self._taken(path):
                return path

    def _taken(self, path):
        """Whether another file is in the place of a recording or of its table."""
        return path.exists() or (self._spec.with_ids and id_table.beside(path).exists())

    def _tell(self, text):
        if self._log is not None:
            self._log.info(f"{self._spec.path}: {text}")
