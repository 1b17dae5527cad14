"""Files of events: `EventWriter` and `save` write them, `load` reads them back. The suffix chooses the format: `.npz`
(as `esaac simulate` writes it), `.h5` (layout of the DSEC data set), `.aedat4` or `.raw` (EVT3).

HDF5 needs `h5py`, and to write AEDAT4 needs `faery`. Both are optional: `pip install esaac[hdf5,aedat4]`.
"""

import contextlib
import io
import os
import pathlib
import tempfile
import warnings

import numpy as np

from esaac._native import Packet, SensorModel, save_evt3, save_npz
from esaac.checks import LEAST_NS, MOST_NS, ids_column, on_host
from esaac.columns import check_range, polarities
from esaac.errors import ArgumentError
from esaac.recordings import Events, h5py_library, load, load_dsec

__all__ = ["ID_SUFFIXES", "SUFFIXES", "EventWriter", "Events", "load", "load_dsec", "save"]

SUFFIXES = (".npz", ".h5", ".hdf5", ".aedat4", ".raw")

ID_SUFFIXES = (".npz", ".h5", ".hdf5")
"""Formats that have a place for the instance of each event."""

EVT3_SIDE_PX = 2048
"""A coordinate of EVT3 has 11 bits."""

EVT3_END_US = 1 << 40
"""An EVT3 file counts its time from 0 on, in 10 bytes for each 16.78 s: 655 kB up to here, 12.7 days."""

HDF5_SPAN_US = 1 << 32
"""Times in a file of DSEC's layout have 32 bits."""


class EventWriter:
    """Gathers packets of one camera and writes them when it is closed.

    >>> with EventWriter("events.h5", camera.sensor) as events:
    ...     events.write(camera.step(hdr, motion, t_ns=t_ns))

    Its packets are of one run of the camera: one that begins before the end of the last raises `ArgumentError`. So
    do a packet of another size than the sensor's, and what the format cannot hold.

    A `with` block that Ctrl-C or `sys.exit` leaves writes what there is. One that an error leaves does not: a warning
    tells how many events are not written, and `close` writes them nevertheless. So does a warning about a writer that
    is never closed.

    A folder that is missing or cannot be written raises `OSError` at once. If writing fails in the end, on a full
    disk for example, the events stay: free some space and call `close` again, or `close("elsewhere.h5")`.
    """

    __slots__ = (
        "__weakref__",
        "_closed",
        "_events",
        "_first_ns",
        "_last_ns",
        "_parts",
        "_warned",
        "_with_ids",
        "path",
        "sensor",
    )

    def __init__(self, path, sensor):
        _check_sensor(sensor)
        self.path = _checked(path)
        # Better to fail before the simulation than after it.
        _check_size(self.path, sensor)
        _probe(self.path.parent)
        self.sensor = sensor
        self._parts, self._events, self._with_ids = [], 0, None
        self._first_ns = self._last_ns = None
        self._closed = self._warned = False

    def write(self, packet, ids=None):
        """Adds a packet. Its events may be on the host or on a device. `ids` is what the camera's `event_ids()` gives
        for it: with all packets or with none, and only `.npz` and HDF5 have a place for it."""
        if self._closed:
            raise ArgumentError(f"{self.path} is written and closed")
        if not isinstance(packet, Packet):
            raise ArgumentError(f"packet is a {type(packet).__name__}, expected an esaac.Packet")
        if packet.offsets is not None:
            raise ArgumentError("this packet is of several cameras; write packet[i], a file a camera")
        if (packet.width, packet.height) != (self.sensor.width, self.sensor.height):
            raise ArgumentError(
                f"packet is of {packet.width} x {packet.height} pixels, expected {self.sensor.width} x "
                f"{self.sensor.height}, as the file's sensor has"
            )
        _check_ids(self.path, ids)
        with_ids = ids is not None
        if self._with_ids not in (None, with_ids):
            raise ArgumentError("ids are given for some packets, expected them for all of a file or for none")
        if not len(packet):
            self._with_ids = with_ids
            return
        part = _columns(*map(_host, (packet.x, packet.y, packet.t_ns, packet.p)), self.sensor)
        part.append(None if ids is None else ids_column(_host(ids), len(packet)))
        first_ns, last_ns = int(part[2][0]), int(part[2][-1])
        if self._last_ns is not None and first_ns < self._last_ns:
            raise ArgumentError(
                f"a packet begins at {first_ns} ns, expected {self._last_ns} ns or later, where the last one ended; "
                "after a reset of the camera, write to another file"
            )
        begin_ns = first_ns if self._first_ns is None else self._first_ns
        _check_times(self.path, begin_ns, last_ns)
        self._first_ns, self._last_ns, self._with_ids = begin_ns, last_ns, with_ids
        self._parts.append(part)
        self._events += len(packet)

    def __len__(self):
        return self._events

    @property
    def closed(self):
        return self._closed

    def close(self, path=None):
        """Writes the file, to another `path` if one is given. After an error the events are still there; once they
        are written, another call does nothing, and one with a `path` raises `ArgumentError`."""
        if self._closed:
            if path is not None:
                raise ArgumentError(f"{self.path} is written and closed, expected no other path: {path}")
            return
        path = self.path if path is None else _checked(path)
        columns = [np.concatenate([part[i] for part in self._parts] or [np.empty(0)]) for i in range(4)]
        ids = None
        if self._with_ids:
            ids = np.concatenate([part[4] for part in self._parts] or [np.empty(0, np.int64)])
        save(path, *columns, ids=ids, sensor=self.sensor)
        self.path, self._parts, self._closed = path, [], True

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        # Ctrl-C and `sys.exit` end a run early. The events of one that failed are no recording.
        if kind is None or not issubclass(kind, Exception):
            self.close()
        else:
            self._warn("the run failed; `close` writes them nevertheless")

    def __del__(self):
        # A writer that could not be made has no attributes.
        if not getattr(self, "_closed", True):
            self._warn("the writer was never closed")

    def _warn(self, why):
        if self._events and not self._warned:
            self._warned = True
            warnings.warn(f"{self._events} events are not written to {self.path}: {why}", RuntimeWarning, 3)


def save(path, x, y, t_ns, p, *, ids=None, sensor):
    """Writes events, in order of time, as `path`'s suffix says. The file appears whole or not at all.

    `p` is 0 or False (OFF) and 1 or True (ON), or -1 and 1. The file has what its format has. `ids` is the instance
    that each event shows: `id` in an `.npz`, `events/id` in HDF5.
    """
    _check_sensor(sensor)
    path = _checked(path)
    _check_size(path, sensor)
    _check_ids(path, ids)
    columns = _columns(x, y, t_ns, p, sensor)
    if ids is not None:
        ids = ids_column(ids, len(columns[2]))
    if len(columns[2]):
        _check_times(path, int(columns[2][0]), int(columns[2][-1]))
    if path.suffix == ".npz":
        save_npz(path, *columns, ids, sensor.to_toml())
        return
    if path.suffix == ".raw":
        save_evt3(path, (sensor.width, sensor.height), *columns)
        return
    with _appearing(path) as partial:
        if path.suffix == ".aedat4":
            _save_aedat4(partial, *columns, sensor)
        else:
            _save_dsec(partial, *columns, ids, sensor)


def _save_dsec(path, x, y, t_ns, p, ids, sensor):
    t_us = t_ns // 1000
    offset_us = int(t_us[0]) if len(t_us) else 0
    relative = t_us - offset_us
    # Event ms_to_idx[ms] is the first at or after that millisecond.
    last_ms = int(relative[-1]) // 1000 + 1 if len(relative) else 0
    index = np.searchsorted(relative, np.arange(last_ms + 1) * 1000).astype(np.uint64)
    # In memory first: HDF5 ends the process when a disk is full.
    image = io.BytesIO()
    with h5py_library().File(image, "w") as file:
        columns = {"x": x, "y": y, "t": relative.astype(np.uint32), "p": p, "id": ids}
        for name, column in columns.items():
            if column is None:
                continue
            chunks = (min(len(column), 1 << 16),) if len(column) else None
            compression = "gzip" if len(column) else None
            file.create_dataset(
                f"events/{name}", data=column, chunks=chunks, compression=compression, shuffle=bool(chunks)
            )
        file["ms_to_idx"] = index
        file["t_offset"] = np.int64(offset_us)
        file.attrs["sensor"] = sensor.to_toml()
    path.write_bytes(image.getbuffer())


def _save_aedat4(path, x, y, t_ns, p, sensor):
    faery = _faery()
    events = np.empty(len(x), dtype=faery.EVENTS_DTYPE)
    events["t"], events["x"], events["y"] = t_ns // 1000, x, y
    events["on"] = p != 0
    stream = faery.events_stream_from_array(events, dimensions=(sensor.width, sensor.height))
    try:
        stream.to_file(path)
    except RuntimeError as error:
        # Faery passes on the system's errors as RuntimeError.
        raise OSError(f"cannot write {path.name}: {error}") from error


def _checked(path):
    """A path whose suffix names a format, and for which the library is there."""
    path = pathlib.Path(path)
    if path.suffix not in SUFFIXES:
        raise ArgumentError(f"{path.name} ends in `{path.suffix}`, expected one of {', '.join(SUFFIXES)}")
    {".h5": h5py_library, ".hdf5": h5py_library, ".aedat4": _faery}.get(path.suffix, bool)()
    return path


def _check_sensor(sensor):
    if not isinstance(sensor, SensorModel):
        raise ArgumentError(f"sensor is a {type(sensor).__name__}, expected a SensorModel")


def _check_size(path, sensor):
    """Raises if a format has too few bits for a sensor's coordinates."""
    if path.suffix == ".raw" and max(sensor.width, sensor.height) > EVT3_SIDE_PX:
        raise ArgumentError(
            f"{path.name}: a sensor of {sensor.width} x {sensor.height} pixels, expected at most {EVT3_SIDE_PX} a "
            "side in EVT3"
        )


def _check_ids(path, ids):
    """Raises if instances of events are given that a format has no place for."""
    if ids is not None and path.suffix not in ID_SUFFIXES:
        raise ArgumentError(f"{path.name} has no place for ids, expected one of {', '.join(ID_SUFFIXES)}")


def _check_times(path, first_ns, last_ns):
    """Raises if a format cannot hold the times from first to last event."""
    first_us, last_us = first_ns // 1000, last_ns // 1000
    if path.suffix in (".aedat4", ".raw") and first_ns < 0:
        raise ArgumentError(f"{path.name}: the first event is at {first_ns} ns, expected 0 or later")
    if path.suffix == ".raw" and last_us >= EVT3_END_US:
        raise ArgumentError(
            f"{path.name}: an event is at {last_us} us, expected less than 2^40 us (12.7 days) in EVT3"
        )
    if path.suffix in (".h5", ".hdf5") and last_us - first_us >= HDF5_SPAN_US:
        raise ArgumentError(
            f"{path.name}: {last_us - first_us} us from first to last event, expected less than 2^32 us (71 min)"
        )


def _columns(x, y, t_ns, p, sensor):
    """Events of a sensor as all formats are made of them: uint16, uint16, int64, and 0 or 1 as uint8."""
    columns = {name: np.asarray(column) for name, column in (("x", x), ("y", y), ("t_ns", t_ns), ("p", p))}
    limits = {"x": (0, sensor.width - 1), "y": (0, sensor.height - 1), "t_ns": (LEAST_NS, MOST_NS)}
    count = columns["t_ns"].size
    for name, column in columns.items():
        if column.shape != (count,):
            raise ArgumentError(
                f"{name} has shape {column.shape}, expected ({count},), a value for each time"
            )
        if not count:
            continue
        if column.dtype.kind not in "iub":
            raise ArgumentError(f"{name} is {column.dtype}, expected integers")
        if name in limits:
            check_range(column, *limits[name], name)
    x, y, t_ns, p = columns.values()
    p = polarities(p, "p")
    if len(back := np.flatnonzero(t_ns[1:] < t_ns[:-1])):
        before, after = t_ns[back[0]], t_ns[back[0] + 1]
        raise ArgumentError(f"t_ns goes back from {before} to {after}, expected events in order of time")
    types = ((x, np.uint16), (y, np.uint16), (t_ns, np.int64))
    return [*(np.ascontiguousarray(column, dtype) for column, dtype in types), p]


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
    array = on_host(array)
    return array if array.flags.writeable else array.copy()


def _faery():
    try:
        import faery
    except ImportError as error:
        raise ImportError("AEDAT4 files need faery to be written: pip install esaac[aedat4]") from error
    return faery
