"""Reads recordings back: `.npz`, as the command and `files.save` write it, and HDF5 in the layout of DSEC."""

from __future__ import annotations

import dataclasses
import os
import pathlib
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from esaac._native import SensorModel
from esaac.checks import nanoseconds
from esaac.errors import ArgumentError

SUFFIXES = (".npz", ".h5", ".hdf5")


@dataclasses.dataclass(frozen=True)
class Events:
    """Events of a recording in order of time, as packets have them and `files.save` takes them."""

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    t_ns: NDArray[np.int64]
    p: NDArray[np.uint8]
    """0 (OFF) and 1 (ON)."""
    ids: NDArray[np.int64] | None
    """The instance that each event shows; None if the recording has none."""
    sensor: SensorModel | None
    """None if the recording names none, as those of the DSEC data set."""

    def __len__(self) -> int:
        return len(self.t_ns)


def load(path: str | os.PathLike[str], *, from_ns: int | None = None, to_ns: int | None = None) -> Events:
    """Reads a recording, or its events from `from_ns` on and before `to_ns`. Of an HDF5 file only their part is read.

    A file that is no recording raises `ArgumentError`."""
    path = pathlib.Path(path)
    if path.suffix not in SUFFIXES:
        others = "; `faery.events_stream_from_file` reads .aedat4 and .raw"
        raise ArgumentError(f"{path.name}, expected one of {', '.join(SUFFIXES)}{others}")
    first_ns = None if from_ns is None else nanoseconds(from_ns, "from_ns")
    end_ns = None if to_ns is None else nanoseconds(to_ns, "to_ns")
    if path.suffix == ".npz":
        return _cut(_load_npz(path), first_ns, end_ns)
    return _cut(_load_hdf5(path, first_ns, end_ns), first_ns, end_ns)


def load_dsec(
    path: str | os.PathLike[str],
) -> tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.int64], NDArray[np.uint8]]:
    """Reads what `files.save` wrote as `.h5`, or a file of the DSEC data set: x, y, t_ns, p."""
    events = _load_hdf5(pathlib.Path(path), None, None)
    return events.x, events.y, events.t_ns, events.p


def h5py_library() -> Any:
    """The module `h5py`, or an error that says how to install it."""
    try:
        import h5py
    except ImportError as error:
        raise ImportError("HDF5 files need h5py: pip install esaac[hdf5]") from error
    return h5py


def _load_npz(path: pathlib.Path) -> Events:
    if path.exists() and not zipfile.is_zipfile(path):
        raise ArgumentError(f"{path.name} is no .npz archive, or not a whole one")
    try:
        with np.load(path) as file:
            _check_columns(path, file.keys(), "xytp")
            x, y, t_ns, p = (file[name] for name in "xytp")
            ids = file["id"] if "id" in file else None
            sensor = SensorModel.from_toml(str(file["sensor"])) if "sensor" in file else None
    except zipfile.BadZipFile as error:
        raise ArgumentError(f"{path.name} is damaged: {error}") from error
    return Events(x, y, t_ns, (p == 1).astype(np.uint8), ids, sensor)


def _load_hdf5(path: pathlib.Path, first_ns: int | None, end_ns: int | None) -> Events:
    """The events of a recording, or at least those of an interval."""
    library = h5py_library()
    if path.exists() and not library.is_hdf5(path):
        raise ArgumentError(f"{path.name} is no HDF5 file")
    with library.File(path, "r") as file:
        events = file.get("events", {})
        _check_columns(path, events.keys(), "xytp")
        offset_us = int(file["t_offset"][()]) if "t_offset" in file else 0
        first, end = 0, len(events["t"])
        if "ms_to_idx" in file:
            first, end = _rows(file["ms_to_idx"], end, offset_us, first_ns, end_ns)
        columns = {name: events[name][first:end] for name in "xytp"}
        t_ns = (columns["t"].astype(np.int64) + offset_us) * 1000
        ids = events["id"][first:end] if "id" in events else None
        sensor = SensorModel.from_toml(file.attrs["sensor"]) if "sensor" in file.attrs else None
    return Events(columns["x"], columns["y"], t_ns, columns["p"], ids, sensor)


def _rows(
    index: Any, count: int, offset_us: int, first_ns: int | None, end_ns: int | None
) -> tuple[int, int]:
    """Rows that contain the events of an interval. Entry `ms` of the index is the first row at or after it."""

    def row(t_ns: int | None, up: int, without: int) -> int:
        if t_ns is None or not len(index):
            return without
        ms = (t_ns // 1000 - offset_us) // 1000 + up
        if ms >= len(index):
            # The index may end before the events do.
            return count if up else int(index[len(index) - 1])
        return int(index[max(ms, 0)])

    return row(first_ns, 0, 0), row(end_ns, 1, count)


def _cut(events: Events, first_ns: int | None, end_ns: int | None) -> Events:
    first = 0 if first_ns is None else np.searchsorted(events.t_ns, first_ns)
    end = len(events) if end_ns is None else np.searchsorted(events.t_ns, end_ns)
    columns = {name: getattr(events, name) for name in ("x", "y", "t_ns", "p", "ids")}
    kept = {name: None if column is None else column[first:end] for name, column in columns.items()}
    return dataclasses.replace(events, **kept)


def _check_columns(path: pathlib.Path, names: Any, expected: str) -> None:
    missing = ", ".join(name for name in expected if name not in names)
    if missing and len(names):
        raise ArgumentError(f"{path.name} has {', '.join(sorted(names))}, expected also {missing}")
    if missing:
        raise ArgumentError(f"{path.name} has no events, expected {missing}")
