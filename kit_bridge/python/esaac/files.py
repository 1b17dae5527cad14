"""Writes events to files. The suffix chooses the format: `.npz` (as `esaac simulate` writes it), `.h5` (layout of the
DSEC data set), `.aedat4` or `.raw` (EVT3).

HDF5 needs `h5py`, AEDAT4 and EVT3 need `faery`. Both are optional: `pip install esaac[hdf5,aedat4]`.
"""

import contextlib
import io
import os
import pathlib
import tempfile

import numpy as np

from esaac._native import SensorModel, save_npz
from esaac.errors import ArgumentError

SUFFIXES = (".npz", ".h5", ".hdf5", ".aedat4", ".raw")


class EventWriter:
    """Gathers packets of one camera and writes them when it is closed.

    >>> with EventWriter("events.h5", camera.sensor) as events:
    ...     events.write(camera.step(hdr, motion, t_ns=t_ns))

    A folder that is missing or cannot be written raises `OSError` at once. If writing fails in the end, on a full
    disk for example, the events stay: free some space and call `close` again, or `close("elsewhere.h5")`.
    """

    def __init__(self, path, sensor):
        if not isinstance(sensor, SensorModel):
            raise ArgumentError(f"sensor is a {type(sensor).__name__}, expected a SensorModel")
        self.path = _checked(path)
        # Better to fail before the simulation than after it.
        _probe(self.path.parent)
        self.sensor = sensor
        self._parts, self._events = [], 0
        self._closed = False

    def write(self, packet):
        """Adds a packet. Its events may be on the host or on a device."""
        if self._closed:
            raise ArgumentError(f"{self.path} is written and closed")
        if packet.offsets is not None:
            raise ArgumentError("this packet is of several cameras; write packet[i], a file a camera")
        if len(packet):
            part = [_host(array) for array in (packet.x, packet.y, packet.t_ns, packet.p)]
            self._parts.append(part)
            self._events += len(packet)

    def __len__(self):
        return self._events

    @property
    def closed(self):
        return self._closed

    def close(self, path=None):
        """Writes the file, to another `path` if one is given. After an error the events are still there."""
        if self._closed:
            return
        path = self.path if path is None else _checked(path)
        types = (np.uint16, np.uint16, np.int64, np.uint8)
        columns = [
            np.ascontiguousarray(np.concatenate([part[i] for part in self._parts] or [np.empty(0)]), dtype)
            for i, dtype in enumerate(types)
        ]
        save(path, *columns, sensor=self.sensor)
        self.path, self._parts, self._closed = path, [], True

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        # The events of a failed run are no recording.
        if kind is None:
            self.close()


def save(path, x, y, t_ns, p, *, sensor):
    """Writes events, in order of time, as `path`'s suffix says. The file appears whole or not at all."""
    path = _checked(path)
    if path.suffix == ".npz":
        save_npz(path, x, y, t_ns, p, sensor.to_toml())
        return
    fill = _save_dsec if path.suffix in (".h5", ".hdf5") else _save_by_faery
    with _appearing(path) as partial:
        fill(partial, x, y, t_ns, p, sensor)


def load_dsec(path):
    """Reads what `save` wrote as `.h5`, or a file of the DSEC data set: x, y, t_ns, p."""
    with _h5py().File(path, "r") as file:
        events = file["events"]
        offset_us = int(file["t_offset"][()]) if "t_offset" in file else 0
        t_ns = (events["t"][:].astype(np.int64) + offset_us) * 1000
        return events["x"][:], events["y"][:], t_ns, events["p"][:]


def _save_dsec(path, x, y, t_ns, p, sensor):
    t_us = t_ns // 1000
    offset_us = int(t_us[0]) if len(t_us) else 0
    relative = t_us - offset_us
    if len(relative) and relative[-1] >= 1 << 32:
        raise ArgumentError(f"{relative[-1]} us from first to last event, expected less than 2^32 (71 min)")
    # Event ms_to_idx[ms] is the first at or after that millisecond.
    last_ms = int(relative[-1]) // 1000 + 1 if len(relative) else 0
    index = np.searchsorted(relative, np.arange(last_ms + 1) * 1000).astype(np.uint64)
    # In memory first: HDF5 ends the process when a disk is full.
    image = io.BytesIO()
    with _h5py().File(image, "w") as file:
        for name, column in (("x", x), ("y", y), ("t", relative.astype(np.uint32)), ("p", p)):
            chunks = (min(len(column), 1 << 16),) if len(column) else None
            compression = "gzip" if len(column) else None
            file.create_dataset(
                f"events/{name}", data=column, chunks=chunks, compression=compression, shuffle=bool(chunks)
            )
        file["ms_to_idx"] = index
        file["t_offset"] = np.int64(offset_us)
        file.attrs["sensor"] = sensor.to_toml()
    path.write_bytes(image.getbuffer())


def _save_by_faery(path, x, y, t_ns, p, sensor):
    faery = _faery()
    events = np.empty(len(x), dtype=faery.EVENTS_DTYPE)
    events["t"], events["x"], events["y"] = t_ns // 1000, x, y
    events["on"] = p != 0
    stream = faery.events_stream_from_array(events, dimensions=(sensor.width, sensor.height))
    options = {"version": "evt3", "zero_t0": False} if path.suffix == ".raw" else {}
    try:
        stream.to_file(path, **options)
    except RuntimeError as error:
        # Faery passes on the system's errors as RuntimeError.
        raise OSError(f"cannot write {path.name}: {error}") from error


def _checked(path):
    """A path whose suffix names a format, and for which the library is there."""
    path = pathlib.Path(path)
    if path.suffix not in SUFFIXES:
        raise ArgumentError(f"{path.name} ends in `{path.suffix}`, expected one of {', '.join(SUFFIXES)}")
    {".h5": _h5py, ".hdf5": _h5py, ".aedat4": _faery, ".raw": _faery}.get(path.suffix, bool)()
    return path


def _probe(folder):
    """Raises `OSError` if no file can be made in a folder."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except FileNotFoundError as error:
        raise FileNotFoundError(
            error.errno, "there is no folder to write events into", str(folder)
        ) from error
    except OSError as error:
        who = f"user {os.geteuid()}" if hasattr(os, "geteuid") else "this user"
        raise type(error)(
            error.errno, f"{who} cannot write recordings there: {error.strerror}", str(folder)
        ) from error


@contextlib.contextmanager
def _appearing(path):
    """A path of the same name in a temporary folder beside `path`. Moved to `path` when it is written."""
    with tempfile.TemporaryDirectory(prefix=".esaac-", dir=path.parent) as folder:
        partial = pathlib.Path(folder) / path.name
        yield partial
        os.replace(partial, path)


def _host(array):
    """The array on the host. Mapped packets are copied: the camera wants their memory back."""
    array = array.numpy() if hasattr(array, "numpy") else array
    return array if array.flags.writeable else array.copy()


def _h5py():
    try:
        import h5py
    except ImportError as error:
        raise ImportError("HDF5 files need h5py: pip install esaac[hdf5]") from error
    return h5py


def _faery():
    try:
        import faery
    except ImportError as error:
        raise ImportError("AEDAT4 and EVT3 files need faery: pip install esaac[aedat4]") from error
    return faery
