"""Events to files, by suffix: `.npz` (as `esaac simulate` writes), `.h5` (layout of the DSEC data set),
`.aedat4`, `.raw` (EVT3).

HDF5 needs `h5py`, AEDAT4 and EVT3 need `faery`; both are optional: `pip install esaac[hdf5,aedat4]`.
"""

import pathlib

import numpy as np

from esaac._native import SensorModel, save_npz
from esaac.errors import ArgumentError

SUFFIXES = (".npz", ".h5", ".hdf5", ".aedat4", ".raw")


class EventWriter:
    """Gathers packets of one camera and writes them when it is closed.

    >>> with EventWriter("events.h5", camera.sensor) as events:
    ...     events.write(camera.step(hdr, motion, t_ns=t_ns))
    """

    def __init__(self, path, sensor):
        self.path = pathlib.Path(path)
        if self.path.suffix not in SUFFIXES:
            expected = ", ".join(SUFFIXES)
            raise ArgumentError(f"{self.path.name} ends in `{self.path.suffix}`, expected one of {expected}")
        if not isinstance(sensor, SensorModel):
            raise ArgumentError(f"sensor is a {type(sensor).__name__}, expected a SensorModel")
        # What is missing is better learnt before the simulation than after.
        {".h5": _h5py, ".hdf5": _h5py, ".aedat4": _faery, ".raw": _faery}.get(self.path.suffix, bool)()
        self.sensor = sensor
        self._parts, self._events = [], 0
        self._closed = False

    def write(self, packet):
        """Adds a packet, wherever its events lie."""
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

    def close(self):
        """Writes the file."""
        if self._closed:
            return
        self._closed = True
        types = (np.uint16, np.uint16, np.int64, np.uint8)
        columns = [
            np.ascontiguousarray(np.concatenate([part[i] for part in self._parts] or [np.empty(0)]), dtype)
            for i, dtype in enumerate(types)
        ]
        self._parts = []
        save(self.path, *columns, sensor=self.sensor)

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        # What a failed run has gathered is no record of it.
        if kind is None:
            self.close()


def save(path, x, y, t_ns, p, *, sensor):
    """Writes events, in order of time, as `path`'s suffix says."""
    path = pathlib.Path(path)
    if path.suffix == ".npz":
        save_npz(path, x, y, t_ns, p, sensor.to_toml())
    elif path.suffix in (".h5", ".hdf5"):
        _save_dsec(path, x, y, t_ns, p, sensor)
    elif path.suffix in (".aedat4", ".raw"):
        _save_by_faery(path, x, y, t_ns, p, sensor)
    else:
        raise ArgumentError(f"{path.name}: expected a suffix of {', '.join(SUFFIXES)}")


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
    with _h5py().File(path, "w") as file:
        for name, column in (("x", x), ("y", y), ("t", relative.astype(np.uint32)), ("p", p)):
            chunks = (min(len(column), 1 << 16),) if len(column) else None
            compression = "gzip" if len(column) else None
            file.create_dataset(
                f"events/{name}", data=column, chunks=chunks, compression=compression, shuffle=bool(chunks)
            )
        file["ms_to_idx"] = index
        file["t_offset"] = np.int64(offset_us)
        file.attrs["sensor"] = sensor.to_toml()


def _save_by_faery(path, x, y, t_ns, p, sensor):
    faery = _faery()
    events = np.empty(len(x), dtype=faery.EVENTS_DTYPE)
    events["t"], events["x"], events["y"] = t_ns // 1000, x, y
    events["on"] = p != 0
    stream = faery.events_stream_from_array(events, dimensions=(sensor.width, sensor.height))
    if path.suffix == ".raw":
        stream.to_file(path, version="evt3", zero_t0=False)
    else:
        stream.to_file(path)


def _host(array):
    return array.numpy() if hasattr(array, "numpy") else array


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
